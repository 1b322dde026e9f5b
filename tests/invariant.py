"""What the tests of invariance share: frames with and without foreign pixels, settings, and how fields are compared.

How much may be left of a difference is derived, in units of the stated standard error s:

not a bit
    The same operations on the same numbers.
`ROUNDING` s
    Single precision. A grey value, and the place of a pixel among 128, are rounded by 2⁻²⁴ of themselves, 10⁻⁵ of a
    grey value and of a pixel, where noise is 2 and s is 10⁻² px: 10⁻³ s. Ten times that, since the pixels of a window
    may be rounded alike.
2 `TOLERANCE` px
    Passes end closer than `tolerance` to where they lead, in each of the two fields. A gradient has that over σ.
`LATTICE` s
    Window sums are taken over nodes of a lattice that is anchored at the grid. Where the nodes do not map onto
    themselves, each of the two windows lacks up to 0.09 of the Gaussian, root mean square (`sixflow.engine.windows`).
    With the same noise the results differ by √2 times that in standard errors; by four times as much for the largest
    of ten thousand numbers.
`in_doubt` s
    One pixel that is taken for foreign in one field and not in the other. It pulls by 3.5 times the noise, times its
    share of the window, w(0)/√Σw² = 1/(√π σ), times its gradient, which is up to twice the usual: 14/window, 0.45 for
    31 px. Whether pixels are weighed is decided for the whole frame: then noise has such pixels too, one in 2000.
`ARRAY` s
    Operators that stand at other places, or have other orientations, miss another part of what the pixels say. Their
    error is 1.05 times the limit, so that two such fields differ by √(2 (1 − 1.05⁻²)) = 0.43 s; 3.3 times that for the
    largest of a thousand numbers.
"""

import functools

import numpy as np

import measured
from sixflow import measure
from sixflow.synth import Particles, Sensor, Speckle, sequence

TOLERANCE = 1e-4  # px
ROUNDING, LATTICE, ARRAY = 0.01, 4 * 2**0.5 * 0.09, 1.4
SHAPE, STEP = (97, 129), 8  # a grid that maps onto itself
FOREIGN_SHAPE, FOREIGN_STEP = (96, 128), 5  # so do this one, and the tiles of 16 px that know the noise

_SETTINGS = {
    "default": {},
    "middle": {"reference": "middle"},
    "second": {"reference": "second"},
    "similarity": {"group": "similarity"},
    "euclidean": {"group": "euclidean"},
    "translation": {"group": "translation"},
    "gain+offset": {"lighting": "gain+offset"},
    "local": {"lighting": "local"},
    "lowpass": {"lowpass": 0.7},
    "sharpen": {"sharpen": 2},
    "auto": {"window": "auto"},
    "auto, middle": {"window": "auto", "reference": "middle"},
    "auto, gain+offset": {"window": "auto", "lighting": "gain+offset"},
    "eigenfilter": {"method": "eigenfilter"},
    "middle, local, lowpass": {"reference": "middle", "lighting": "local", "lowpass": 0.7},
    "middle, gain+offset, sharpen": {"reference": "middle", "lighting": "gain+offset", "sharpen": 2},
    "second, local, eigenfilter": {"reference": "second", "lighting": "local", "method": "eigenfilter"},
    "return, replace": {"forward_backward": True, "replace_failed": True},
}
SETTINGS = {name: {"window": 31} | options for name, options in _SETTINGS.items()}
CAMERAS = {
    "speckle": {},
    "dead": {"dead": 0.02},
    "glare": {"glare": 2.0},
    "unmatched": {},
}
CASES = [("speckle", name) for name in SETTINGS]
CASES += [(kind, "default") for kind in ("dead", "glare", "unmatched")]
CASES += [("dead", "local"), ("glare", "middle"), ("unmatched", "sharpen"), ("unmatched", "gain+offset")]


@functools.cache
def recording(kind="speckle", shape=None, count=2):
    """Frames (count, height, width) with noise; all kinds but "speckle" have foreign pixels."""
    shape = shape or (SHAPE if kind == "speckle" else FOREIGN_SHAPE)
    pattern = Particles(diameter=4, unmatched=0.2, seed=1) if kind == "unmatched" else Speckle(seed=1)
    camera = Sensor(noise=2, seed=1, **CAMERAS[kind])
    frames = sequence(pattern, measured.affine(measured.SMALL, shape), shape, count, sensor=camera).frames
    frames.flags.writeable = False
    return frames


def in_doubt(window=31):
    """What one pixel may make that is weighed in one field alone, in standard errors."""
    return 14 / window


def fraction_of(kind, name):
    """What may be left of a difference where nodes, operators or pixels in doubt may be others."""
    if "eigenfilter" in name:
        return ARRAY
    return ROUNDING if kind == "speckle" else in_doubt()


def field_of(frames, name="default", kind="speckle", **options):
    step = STEP if kind == "speckle" else FOREIGN_STEP
    return measure(*frames, **{"tolerance": TOLERANCE, "step": step} | SETTINGS[name] | options)


@functools.cache
def plain_field(kind, name):
    return field_of(recording(kind), name, kind)


def assert_identical(field, other):
    """All variables and their places, to the last bit."""
    assert set(field) == set(other)
    for key in field.variables:
        np.testing.assert_array_equal(field[key].values, other[key].values, err_msg=str(key))


def allowed(standard_errors, fraction, sigma):
    """Allowance for the six: a fraction of the standard error, and what two iterations may have left."""
    left = 2 * TOLERANCE * np.array([1, 1, *(2 * [2 / sigma]), *(2 * [2 / sigma])])
    return fraction * standard_errors + left


def assert_alike(six, flag, field, *, fraction=ROUNDING, where=True):
    """Numbers and flags that are those of a field but for a fraction of its standard error, and the tolerance.

    Flags are set where a number passes a limit. A change of it by the fraction f of its standard deviation makes some f
    of those change that lie within one of it, which few do: flags of 1 in 100 points may.
    """
    where = np.broadcast_to(where, flag.shape)
    expected = field.flag.values[0]
    assert (flag != expected)[where].mean() <= 0.01
    given = where & np.isfinite(six).all(axis=-1) & np.isfinite(measured.six_of(field)).all(axis=-1)
    assert given[where].mean() > 0.5
    # of pairs that differ a recording says none: the largest allows least
    window = field.attrs.get("effective_window", 62)
    limit = allowed(measured.standard_errors(field), fraction, window / np.sqrt(4 * np.pi))
    off = np.abs(six - measured.six_of(field))
    worst = (off / np.maximum(limit, 1e-12))[given].max()
    assert worst <= 1, f"{worst:.3g} times what is allowed"


TURNED = {
    # u and v change places, u_x with v_y, and u_y with v_x
    "transposed": [
        [0, 1, 0, 0, 0, 0],
        [1, 0, 0, 0, 0, 0],
        [0, 0, 1, 0, 0, 0],
        [0, 0, 0, -1, 0, 0],
        [0, 0, 0, 0, -1, 0],
        [0, 0, 0, 0, 0, 1],
    ],
    # u, u_y and v_x change their sign
    "left to right": np.diag([-1, 1, 1, -1, 1, -1]),
    # v, u_y and v_x change their sign
    "upside down": np.diag([1, -1, 1, -1, 1, -1]),
}
ARRAYS = {
    "transposed": lambda image: np.swapaxes(image, -1, -2),
    "left to right": lambda image: image[..., ::-1],
    "upside down": lambda image: image[..., ::-1, :],
}


TURNS = {how: (how,) for how in TURNED} | {"by 90°": ("transposed", "upside down")}


def turned(images, how):
    """Images with their axes turned, one step after the other."""
    for step in TURNS[how]:
        images = ARRAYS[step](images)
    return np.ascontiguousarray(images)


def turned_back(field, how):
    """The six, their covariance and the flags of turned frames, on the grid and in the axes of the frames."""
    six = np.moveaxis(measured.six_of(field), -1, 0)
    covariance = np.moveaxis(field.covariance.values[0].astype(float), (-2, -1), (0, 1))
    flag = field.flag.values[0]
    for step in reversed(TURNS[how]):  # each is its own inverse
        T = np.array(TURNED[step])
        six, flag = np.tensordot(T, ARRAYS[step](six), axes=1), ARRAYS[step](flag)
        covariance = np.einsum("ik,kl...,jl->ij...", T, ARRAYS[step](covariance), T)
    return np.moveaxis(six, 0, -1), np.moveaxis(covariance, (0, 1), (-2, -1)), flag


def assert_turned(field, other, how, fraction):
    """Numbers, covariance and flags of a field, from that of turned frames."""
    six, covariance, flag = turned_back(other, how)
    assert_alike(six, flag, field, fraction=fraction)
    s = measured.standard_errors(field)
    s = np.where(s > 0, s, np.inf)
    off = np.abs(covariance - field.covariance.values[0]) / (s[..., :, None] * s[..., None, :])
    assert np.nanmax(off) <= 2 * fraction  # a variance is a square
