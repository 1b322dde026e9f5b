"""What the tests of `measure` share: exact frames, rendered once, and errors in units of their prediction."""

from functools import cache

import numpy as np

import sixflow
from sixflow.convention.flags import FAILING, FLAGS
from sixflow.field.dataset import SIX
from sixflow.synth import Affine, Pair, Particles, Sensor, Speckle, Texture, pair

SMALL = (0.8, -0.6, 0.004, 0.006, 0.003, -0.002)
PATTERNS = {
    "speckle": lambda seed: Speckle(sigma=2, seed=seed),
    "particles": lambda seed: Particles(diameter=4, seed=seed),
    "texture": lambda seed: Texture(shortest=6, longest=24, seed=seed),
}


WINDOW = 31
"""px: of tests that count windows, or compare a field with what theory says of one window."""


def measure(*frames, **options):
    """`sixflow.measure` with one window for all points, unless the options say another."""
    if "settings" not in options:
        options = {"window": WINDOW} | options
    return sixflow.measure(*frames, **options)


def affine(six, shape):
    """Affine motion about the centre of the frame."""
    return Affine.from_six(six, ((shape[1] - 1) / 2, (shape[0] - 1) / 2))


@cache
def ideal(kind: str, seed: int = 0, size: int = 256, six: tuple = SMALL) -> Pair:
    """Noise-free pair of a square frame."""
    return pair(PATTERNS[kind](seed), affine(six, (size, size)), (size, size))


def noisy(made: Pair, noise: float, seed: int = 0):
    """The two frames of a pair with grey noise."""
    sensor = Sensor(noise=noise, seed=seed)
    return sensor.expose(made.frame0, 0), sensor.expose(made.frame1, 1)


def six_of(field):
    """The six numbers of the first time; shape (rows, columns, 6)."""
    return np.stack([field[name].values[0] for name in SIX], axis=-1).astype(float)


def errors(field, made):
    x, y = np.meshgrid(field.x, field.y)
    return six_of(field) - made.truth(x, y)


def standard_errors(field):
    return np.sqrt(np.diagonal(field.covariance.values[0], axis1=-2, axis2=-1).astype(float))


def flagged(field, *names):
    """Where any of these flags is set."""
    return (field.flag.values[0] & sum(FLAGS[name] for name in names)) != 0


def failed(field):
    return (field.flag.values[0] & FAILING) != 0


def complete(field):
    """Points with a complete window that did not fail."""
    return field.flag.values[0] == 0


def on_border(field):
    """Points with a partial window that did not fail."""
    return field.flag.values[0] == FLAGS["border"]


def depth(field):
    """Distance of every grid point from the border of the frame, px."""
    height, width = field.attrs["frame_shape"]
    x, y = np.meshgrid(field.x, field.y)
    return np.minimum.reduce([x, y, width - 1 - x, height - 1 - y])


def rms(values):
    """Root mean square over all axes but the last."""
    return np.sqrt(np.mean(np.square(values).reshape(-1, values.shape[-1]), axis=0))


def windows(points: int, step: int, window: float) -> float:
    """How many independent windows so many grid points stand for."""
    return points * step**2 / window**2
