"""Speckle: a dense random pattern of light and dark Gaussian blobs, as on a sprayed specimen.

I(x) = mean + Σ ± A exp(−|x − c_i|²/(2σ²)) with centres c_i of a Poisson process of N = density/σ² points per
px². Campbell's theorem gives the variance N A² π σ², hence A = contrast / √(π density). The autocorrelation
is exp(−r²/(4σ²)).
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from sixflow.checks import number, whole
from sixflow.synth.arguments import Array, length
from sixflow.synth.patterns.base import Pattern
from sixflow.synth.patterns.field import REACH, Box, evaluate, scatter


@dataclasses.dataclass(frozen=True, kw_only=True)
class Speckle(Pattern):
    """Random light and dark Gaussian blobs over the whole plane.

    Parameters
    ----------
    sigma : float
        Radius of the blobs (standard deviation of the Gaussian), px, at least 0.1.
    density : float
        Mean number of blobs on an area of sigma², 1e-4 to 100. From 0.3 on the grey values are
        nearly normally distributed; small densities leave flat areas.
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

    Notes
    -----
    A blob ends where it falls below 1e-10 of its amplitude; nothing else is approximated.

    Examples
    --------
    >>> pattern = Speckle(sigma=2.0, seed=7)
    >>> float(pattern(12.25, -3.5)) == float(Speckle(sigma=2.0, seed=7)(12.25, -3.5))
    True
    """

    sigma: float = 2.0
    density: float = 0.5
    contrast: float = 35.0
    mean: float = 128.0
    seed: int = 0

    def __post_init__(self) -> None:
        object.__setattr__(self, "sigma", length("sigma", self.sigma))
        object.__setattr__(self, "density", number("density", self.density, least=1e-4, most=100))
        object.__setattr__(self, "contrast", number("contrast", self.contrast, least=0))
        object.__setattr__(self, "mean", number("mean", self.mean))
        object.__setattr__(self, "seed", whole("seed", self.seed, 0))

    def _evaluate(self, x: Array, y: Array) -> tuple[Array, Array, Array]:
        per_px = self.density / self.sigma**2
        value, I_x, I_y = evaluate(x, y, per_px, REACH * self.sigma, self._blobs)
        return self.mean + value, I_x, I_y

    def _blobs(self, box: Box) -> Array:
        """Blobs of the box: x, y, amplitude, 1/(2σ²)."""
        blobs = scatter(self.seed, self.density / self.sigma**2, box)
        amplitude = self.contrast / math.sqrt(math.pi * self.density)
        blobs[:, 2] = np.where(blobs[:, 2] < 0.5, -amplitude, amplitude)
        blobs[:, 3] = 1 / (2 * self.sigma**2)
        return blobs
