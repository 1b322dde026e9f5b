"""Particle images of PIV: Gaussian spots on a dark ground, some of them without a partner in the other frame.

I(x) = background + Σ A_i exp(−8 |x − c_i|²/d_i²); d_i is the e⁻² diameter (4σ), as in Raffel et al., Particle
Image Velocimetry (2018). Diameters and brightnesses are uniformly distributed about their mean.
"""

from __future__ import annotations

import dataclasses
import math
from functools import partial

import numpy as np

from sixflow.checks import number, require, whole
from sixflow.synth.arguments import Array, length, points
from sixflow.synth.motions.base import Motion
from sixflow.synth.patterns.base import Pattern
from sixflow.synth.patterns.field import REACH, Box, evaluate, origin_box, scatter

_LAYER = 0x9E3779B9  # separates the seeds of the particles of single frames


@dataclasses.dataclass(frozen=True, kw_only=True)
class Particles(Pattern):
    """Bright round particle images over the whole plane.

    Parameters
    ----------
    diameter : float
        Mean e⁻² diameter of the particle images, px, at least 0.1.
    diameter_spread : float
        Standard deviation of the diameter, px; less than diameter/√3.
    density : float
        Mean number of particle images per px² (ppp), 1e-6 to 10.
    brightness : float
        Mean grey value of a particle image's centre, above the background.
    brightness_spread : float
        Standard deviation of the brightness relative to its mean, 0 to 1/√3 = 0.577.
    unmatched : float
        Fraction, 0 to 1, of each frame's particles that this frame alone shows: they have entered or will
        have left the light sheet.
    rigid : bool
        True: the centres move with the motion and the images stay round, as in a real recording. False: the
        images deform with the motion, so that brightness is exactly constant along it.
    background : float
        Grey value between the particles.
    seed : int
        Chooses the pattern.

    Raises
    ------
    InputError
        If a value is outside its range.

    Notes
    -----
    A particle image ends where it falls below 1e-10 of its brightness.

    Examples
    --------
    >>> pattern = Particles(diameter=3.0, density=0.05, seed=1)
    >>> bool(pattern([10.0, 20.0, 30.0], 5.0).min() >= pattern.background)
    True
    """

    diameter: float = 3.0
    diameter_spread: float = 0.0
    density: float = 0.04
    brightness: float = 150.0
    brightness_spread: float = 0.2
    unmatched: float = 0.0
    rigid: bool = False
    background: float = 10.0
    seed: int = 0

    def __post_init__(self) -> None:
        root = math.sqrt(3)
        diameter = length("diameter", self.diameter)
        spread = number("diameter_spread", self.diameter_spread, least=0, unit="px")
        remedy = "must be less than diameter/√3, or some particles would have no size"
        require(spread * root < diameter, "diameter_spread", self.diameter_spread, remedy)
        values = {
            "diameter": diameter,
            "diameter_spread": spread,
            "density": number("density", self.density, least=1e-6, most=10, unit="particles per px²"),
            "brightness": number("brightness", self.brightness, least=0),
            "brightness_spread": number("brightness_spread", self.brightness_spread, least=0, most=1 / root),
            "unmatched": number("unmatched", self.unmatched, least=0, most=1),
            "background": number("background", self.background),
            "seed": whole("seed", self.seed, 0),
        }
        require(isinstance(self.rigid, bool), "rigid", self.rigid, "must be True or False")
        for name, value in values.items():
            object.__setattr__(self, name, value)

    @property
    def reach(self) -> float:
        """Distance at which the largest particle image ends, px."""
        return REACH * (self.diameter + math.sqrt(3) * self.diameter_spread) / 4

    def _evaluate(self, x: Array, y: Array) -> tuple[Array, Array, Array]:
        matched = self._layer(x, y, None)
        single = self._layer(x, y, 0)
        value, I_x, I_y = (a + b for a, b in zip(matched, single, strict=True))
        return self.background + value, I_x, I_y

    def _image(self, x: Array, y: Array, motion: Motion | None, number: int) -> Array:
        single = self._layer(x, y, number)[0]
        if motion is not None and self.rigid:
            return self.background + self._layer(x, y, None, motion)[0] + single
        if motion is not None:
            x, y = points(*motion.inverse(x, y))
        return self.background + self._layer(x, y, None)[0] + single

    def _layer(
        self, x: Array, y: Array, only: int | None, motion: Motion | None = None
    ) -> tuple[Array, Array, Array]:
        """Light of the particles of one frame only, or (None) of those that all frames share."""
        density = self.density * ((1 - self.unmatched) if only is None else self.unmatched)
        if density == 0:
            return np.zeros_like(x), np.zeros_like(x), np.zeros_like(x)
        seed = self.seed if only is None else self.seed + _LAYER * (only + 1)
        return evaluate(x, y, density, self.reach, partial(self._blobs, seed, density, motion))

    def _blobs(self, seed: int, density: float, motion: Motion | None, box: Box) -> Array:
        """Particle images of the box: x, y, brightness, 1/(2σ²) = 8/d²."""
        origins = box if motion is None else origin_box(box, motion)
        blobs = scatter(seed, density, origins)
        if motion is not None:
            blobs[:, 0], blobs[:, 1] = motion.forward(blobs[:, 0], blobs[:, 1])
        root = math.sqrt(3)
        diameter = self.diameter + self.diameter_spread * root * (2 * blobs[:, 2] - 1)
        brightness = self.brightness * (1 + self.brightness_spread * root * (2 * blobs[:, 3] - 1))
        blobs[:, 2] = brightness
        blobs[:, 3] = 8 / diameter**2
        return blobs
