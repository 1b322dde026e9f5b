"""Patterns made of plane waves: band-limited random texture, grating, plaid.

I(x) = mean + Σ a_i cos(k_i · x + φ_i). A wave of amplitude a has the variance a²/2.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from sixflow.checks import number, numbers, require, whole
from sixflow.engine.threads import over_strips
from sixflow.synth.arguments import Array, length
from sixflow.synth.patterns.base import CHUNK, Pattern


def _waves(x: Array, y: Array, waves: Array) -> tuple[Array, Array, Array]:
    """Sum of waves a cos(k_x x + k_y y + φ) and its derivatives; `waves` has rows k_x, k_y, φ, a."""
    out = np.zeros((3, x.size))

    def task(first: int, last: int) -> None:
        part = slice(first, last)
        value, I_x, I_y = out[:, part]
        for k_x, k_y, phase, amplitude in waves:
            angle = k_x * x[part] + k_y * y[part] + phase
            value += amplitude * np.cos(angle)
            slope = amplitude * np.sin(angle)
            I_x -= k_x * slope
            I_y -= k_y * slope

    over_strips(task, x.size, CHUNK)
    return out[0], out[1], out[2]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Texture(Pattern):
    """Band-limited random texture: a sum of random plane waves over the whole plane.

    The wave vectors are uniformly distributed over the ring 2π/longest ≤ |k| ≤ 2π/shortest, so the spectrum
    is white within the band; all waves have the same amplitude.

    Parameters
    ----------
    shortest, longest : float
        Band of wavelengths, px; 0.1 ≤ shortest ≤ longest. Below 2 px the pattern is undersampled.
    waves : int
        Number of waves, at least 1; from about 50 on the grey values are nearly normally distributed.
    contrast : float
        Root mean square of the grey values about their mean, at least 0.
    mean : float
        Mean grey value.
    seed : int
        Chooses the pattern.

    Raises
    ------
    InputError
        If a value is outside its range.

    Examples
    --------
    >>> pattern = Texture(shortest=6.0, longest=24.0, seed=3)
    >>> pattern([0.0, 0.5, 1.0], 0.0).shape
    (3,)
    """

    shortest: float = 6.0
    longest: float = 24.0
    waves: int = 80
    contrast: float = 35.0
    mean: float = 128.0
    seed: int = 0

    def __post_init__(self) -> None:
        object.__setattr__(self, "shortest", length("shortest", self.shortest))
        object.__setattr__(self, "longest", length("longest", self.longest))
        remedy = f"must be at least shortest={self.shortest!r} px"
        require(self.longest >= self.shortest, "longest", self.longest, remedy)
        object.__setattr__(self, "waves", whole("waves", self.waves, 1, 100_000))
        object.__setattr__(self, "contrast", number("contrast", self.contrast, least=0))
        object.__setattr__(self, "mean", number("mean", self.mean))
        object.__setattr__(self, "seed", whole("seed", self.seed, 0))

    def _evaluate(self, x: Array, y: Array) -> tuple[Array, Array, Array]:
        rng = np.random.default_rng(self.seed)
        low, high = (2 * math.pi / self.longest) ** 2, (2 * math.pi / self.shortest) ** 2
        k = np.sqrt(rng.uniform(low, high, self.waves))
        direction = rng.uniform(0, 2 * math.pi, self.waves)
        phase = rng.uniform(0, 2 * math.pi, self.waves)
        amplitude = np.full(self.waves, self.contrast * math.sqrt(2 / self.waves))
        waves = np.stack([k * np.cos(direction), k * np.sin(direction), phase, amplitude], axis=1)
        value, I_x, I_y = _waves(x, y, waves)
        return self.mean + value, I_x, I_y


@dataclasses.dataclass(frozen=True, kw_only=True)
class Grating(Pattern):
    """Sine grating: one plane wave.

    Parameters
    ----------
    wavelength : float
        px, at least 0.1.
    angle : float
        Direction in which the grey value changes, rad, from x towards y.
    phase : float
        Phase at the origin, rad.
    contrast : float
        Root mean square of the grey values about their mean, at least 0; the amplitude is √2 contrast.
    mean : float
        Mean grey value.

    Raises
    ------
    InputError
        If a value is outside its range.

    Examples
    --------
    >>> [round(float(grey), 3) for grey in Grating(wavelength=8.0, contrast=50.0)([0.0, 2.0, 4.0], 0.0)]
    [198.711, 128.0, 57.289]
    """

    wavelength: float = 12.0
    angle: float = 0.0
    phase: float = 0.0
    contrast: float = 35.0
    mean: float = 128.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "wavelength", length("wavelength", self.wavelength))
        object.__setattr__(self, "angle", number("angle", self.angle, unit="radians"))
        object.__setattr__(self, "phase", number("phase", self.phase, unit="radians"))
        object.__setattr__(self, "contrast", number("contrast", self.contrast, least=0))
        object.__setattr__(self, "mean", number("mean", self.mean))

    def _evaluate(self, x: Array, y: Array) -> tuple[Array, Array, Array]:
        k = 2 * math.pi / self.wavelength
        wave = [k * math.cos(self.angle), k * math.sin(self.angle), self.phase, math.sqrt(2) * self.contrast]
        value, I_x, I_y = _waves(x, y, np.array([wave]))
        return self.mean + value, I_x, I_y


@dataclasses.dataclass(frozen=True, kw_only=True)
class Plaid(Pattern):
    """Sum of two sine gratings.

    Parameters
    ----------
    wavelengths : (float, float)
        px, at least 0.1.
    angles : (float, float)
        Directions in which the gratings change, rad, from x towards y.
    phases : (float, float)
        Phases at the origin, rad.
    contrast : float
        Root mean square of the grey values about their mean, at least 0; each grating has this amplitude.
    mean : float
        Mean grey value.

    Raises
    ------
    InputError
        If a value is outside its range.

    Examples
    --------
    >>> pattern = Plaid(wavelengths=(8.0, 8.0), contrast=30.0)
    >>> round(float(pattern(0.0, 0.0)), 6)
    188.0
    """

    wavelengths: tuple[float, float] = (12.0, 12.0)
    angles: tuple[float, float] = (0.0, math.pi / 2)
    phases: tuple[float, float] = (0.0, 0.0)
    contrast: float = 35.0
    mean: float = 128.0

    def __post_init__(self) -> None:
        for name, unit in (("wavelengths", "in px"), ("angles", "in rad"), ("phases", "in rad")):
            object.__setattr__(self, name, numbers(name, getattr(self, name), 2, unit))
        for k, wavelength in enumerate(self.wavelengths):
            length(f"wavelengths[{k}]", wavelength)
        object.__setattr__(self, "contrast", number("contrast", self.contrast, least=0))
        object.__setattr__(self, "mean", number("mean", self.mean))

    def _evaluate(self, x: Array, y: Array) -> tuple[Array, Array, Array]:
        k = 2 * math.pi / np.array(self.wavelengths)
        angles = np.array(self.angles)
        amplitude = np.full(2, self.contrast)
        waves = np.stack([k * np.cos(angles), k * np.sin(angles), np.array(self.phases), amplitude], axis=1)
        value, I_x, I_y = _waves(x, y, waves)
        return self.mean + value, I_x, I_y
