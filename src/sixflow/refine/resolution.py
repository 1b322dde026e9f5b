"""Resolution: the window that has the least error, chosen at every point.

Windows of a ladder, each √2 larger than the one before and all sharpened alike, are measured one after the other,
from coarse to fine, each from the field that the one before found. A window i measures θ_i = T_i θ + noise, with a
period P_i that it attenuates by 10 % and a covariance C_i. The noise of two windows is the same noise through
different responses, so that for i < j (i finer)

    E|θ_j − θ_i|² = |T_i θ − T_j θ|² + f_ij V_i,     f_ij = ∫(T_i − T_j)² / ∫T_i²,

V_i the variance, ∫ over wave numbers as in `engine.response`. What lies above the noise's part is bias that the
coarser window has and the finer has not. Averaged by a Gaussian kernel K of standard deviation P_j/2,

    B_j = max over i < j of [K|θ_j − θ_i|² − c (1 + z √(2/n_ij)) K(f_ij V_i)]₊
    R_j = K(V_j) + B_j                                             (expected squared error)

n_ij = m π² (P_j/P_i)² is the number of independent values of m components under K: white noise below the wave number
2π/P has π/P² of them per area. The allowance of z of its standard deviations keeps chance from being taken for bias
(Goldenshluger and Lepski, Annals of Statistics 39, 2011). V_i is many times V_j where i is much finer, so that a few
percent that it is wrong by would outweigh V_j: c is 1 for the three next finer windows, and 2 for those beyond, which
are to show only waves that all the others miss. R is formed for the displacement and for the gradient, and
the window with the least product of the two is taken: neither has a unit that outweighs the other.

The level chosen is averaged over a quarter of its period, and the two windows about it are blended, so that the field
has no steps. The noise of the coarser of two windows is nearly that part of the finer's which it lets pass: their
covariance is that of the coarser,

    C = (1 − t)² C_a + t (2 − t) C_b,       θ = (1 − t) θ_a + t θ_b.

| symbol | name |
|---|---|
| θ_i, C_i, P_i | `Solution.maps`, `Solution.covariance`, `Window.period` |
| f_ij | `difference_noise` |
| R_j | `risks` |
"""

from __future__ import annotations

import dataclasses
import math
from functools import cache
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from sixflow.engine.response import response
from sixflow.maps.grid import Grid
from sixflow.maps.six import six_of_maps
from sixflow.plan import Window
from sixflow.refine.solution import Solution

FINER = 3
"""How many of the next finer windows are taken at their word."""
DOUBTED = 2.0
"""c: factor on the noise's part for windows finer than these."""
SPREAD = 0.5
"""Standard deviation of K, in periods of the coarser window."""
ALLOWED = 2.0
"""z: standard deviations that the mean square of noise may exceed its expectation by."""

Array = NDArray[Any]


@cache
def difference_noise(ratio: float, sharpen: int) -> tuple[float, float]:
    """Variance of the difference of two windows over the finer's, of displacement and gradient.

    Parameters
    ----------
    ratio : float
        Of the coarser window to the finer.
    sharpen : int

    Examples
    --------
    >>> difference_noise(1.0, 2)
    (0.0, 0.0)
    >>> [round(part, 2) for part in difference_noise(2**0.5, 2)]
    [0.29, 0.5]
    """
    x = np.linspace(0, 40, 40001)
    fine, coarse = response(np.exp(-x), sharpen), response(np.exp(-x * ratio**2), sharpen)
    parts = [
        float(np.sum(weight * (fine - coarse) ** 2) / np.sum(weight * fine**2))
        for weight in (np.ones_like(x), x)
    ]
    return parts[0], parts[1]


def risks(levels: list[Solution], windows: tuple[Window, ...], grid: Grid) -> Array:
    """Product of the expected squared errors of displacement and gradient; (levels, rows, columns), inf where unusable.

    Parameters
    ----------
    levels : list of Solution
        From fine to coarse, judged.
    windows : tuple of Window
        That they were measured with.
    grid : Grid
    """
    six = [np.moveaxis(six_of_maps(level.maps), -1, 0) for level in levels]
    variances = [_variances(level, window) for level, window in zip(levels, windows, strict=True)]
    usable = np.stack([~level.failed for level in levels])
    product = np.ones((len(levels), *grid.shape))
    for kind, place in enumerate((slice(0, 2), slice(2, 6))):
        for j, coarse in enumerate(windows):
            reach = SPREAD * coarse.period / grid.step
            bias = np.zeros(grid.shape)
            for i, fine in enumerate(windows[:j]):
                both = usable[i] & usable[j]
                difference = ((six[j][place] - six[i][place]) ** 2).sum(axis=0)
                share = difference_noise(coarse.size / fine.size, fine.sharpen)[kind]
                noise = _mean(share * variances[i][kind], both, reach)
                independent = (2, 4)[kind] * (2 * math.pi * SPREAD * coarse.period / fine.period) ** 2
                allowed = (1 + ALLOWED * math.sqrt(2 / independent)) * (1 if j - i <= FINER else DOUBTED)
                bias = np.fmax(bias, _mean(difference, both, reach) - allowed * noise)
            product[j] *= _mean(variances[j][kind], usable[j], reach) + bias
    return np.where(usable & np.isfinite(product), product, np.inf)


def _variances(level: Solution, window: Window) -> tuple[Array, Array]:
    """Of the displacement and of the gradient, with what passes may have left; NaN where not known."""
    variance = np.diagonal(level.covariance, axis1=-2, axis2=-1).astype(np.float64)
    left = np.where(np.isfinite(level.left), level.left, 0.0) ** 2
    return variance[..., :2].sum(axis=-1) + left, variance[..., 2:].sum(axis=-1) + left / window.sigma**2


def _mean(values: Array, known: NDArray[np.bool_], reach: float) -> Array:
    """Gaussian mean over the known values about every point; NaN where there are none."""
    known = known & np.isfinite(values)
    weight = scipy.ndimage.gaussian_filter(known.astype(np.float64), reach, mode="constant")
    total = scipy.ndimage.gaussian_filter(np.where(known, values, 0.0), reach, mode="constant")
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(weight > 1e-6, total / weight, np.nan)


def choose(levels: list[Solution], windows: tuple[Window, ...], grid: Grid) -> Solution:
    """Blend the windows about the one of least risk.

    A point where no window is usable takes the flags of the coarsest.

    Parameters
    ----------
    levels : list of Solution
        From fine to coarse, on one grid, judged.
    windows : tuple of Window
        That they were measured with.
    grid : Grid
    """
    mix = _mix(levels, windows, grid)
    covariances = np.stack([level.covariance for level in levels])
    rows, columns = np.indices(grid.shape)
    a, b = covariances[mix.fine, rows, columns], covariances[mix.coarse, rows, columns]
    weight = mix.t[..., None, None]
    statistics = {
        name: mix.of(np.stack([getattr(level.statistics, name) for level in levels]))
        for name in ("weight", "noise", "residual", "left", "noise_gradient", "texture", "rho")
    }
    nearest = np.where(mix.t < 0.5, mix.fine, mix.coarse)

    def between(name: str) -> Array:
        return np.exp(mix.of(np.log(np.stack([getattr(level, name) for level in levels]))))

    coarsest = levels[-1]
    return Solution(
        maps=np.stack([mix.of(np.stack([level.maps[k] for level in levels])) for k in range(6)]),
        covariance=((1 - weight) ** 2 * a + weight * (2 - weight) * b).astype(covariances.dtype),
        statistics=dataclasses.replace(coarsest.statistics, **statistics),
        left=mix.of(np.stack([level.left for level in levels])),
        window=between("window"),
        period=between("period"),
        flag=np.stack([level.flag for level in levels])[nearest, rows, columns],
        light=coarsest.light,
        lighting=coarsest.lighting,
    )


def _mix(levels: list[Solution], windows: tuple[Window, ...], grid: Grid) -> _Mix:
    """Which two levels are blended at every point, and how."""
    risk = risks(levels, windows, grid)
    best = np.where(np.isfinite(risk).any(axis=0), risk.argmin(axis=0), len(levels) - 1)
    height = _smooth(best, windows, grid)
    usable = np.stack([~level.failed for level in levels])
    fine = _nearest(usable, np.floor(height).astype(int), upwards=False)
    coarse = _nearest(usable, np.ceil(height).astype(int), upwards=True)
    fine, coarse = np.where(fine < 0, coarse, fine), np.where(coarse < 0, fine, coarse)
    fine, coarse = np.where(fine < 0, best, fine), np.where(coarse < 0, best, coarse)
    with np.errstate(invalid="ignore", divide="ignore"):
        t = np.where(coarse > fine, np.clip((height - fine) / (coarse - fine), 0, 1), 0.0)
    return _Mix(fine, coarse, t)


@dataclasses.dataclass(frozen=True)
class _Mix:
    """(1 − t) of level `fine`, t of level `coarse`."""

    fine: NDArray[np.intp]
    coarse: NDArray[np.intp]
    t: Array

    def of(self, values: Array) -> Array:
        rows, columns = np.indices(self.t.shape)
        a, b = values[self.fine, rows, columns], values[self.coarse, rows, columns]
        with np.errstate(invalid="ignore"):
            between = (1 - self.t) * a + self.t * b
        return np.where(self.t == 0, a, np.where(self.t == 1, b, between))


def _smooth(best: NDArray[np.intp], windows: tuple[Window, ...], grid: Grid) -> Array:
    """Mean level about every point, each level over a quarter of its period."""
    shares = [
        scipy.ndimage.gaussian_filter(
            (best == k).astype(np.float64), window.period / 4 / grid.step, mode="nearest"
        )
        for k, window in enumerate(windows)
    ]
    return np.sum([k * share for k, share in enumerate(shares)], axis=0) / np.sum(shares, axis=0)


def _nearest(usable: NDArray[np.bool_], wanted: NDArray[np.intp], *, upwards: bool) -> NDArray[np.intp]:
    """The usable level nearest to the wanted one on its side; −1 where there is none."""
    found = np.full(wanted.shape, -1)
    for k in range(len(usable)) if not upwards else range(len(usable) - 1, -1, -1):
        here = usable[k] & ((k >= wanted) if upwards else (k <= wanted))
        found = np.where(here, k, found)
    return found
