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
| θ_i, C_i, P_i | `Level.maps`, `Level.quality.covariance`, `Level.period` |
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

from sixflow.convention import SIX_FROM_GRADIENT
from sixflow.convention.flags import FAILING
from sixflow.engine.response import response
from sixflow.engine.window import attenuation_period
from sixflow.maps.grid import Grid
from sixflow.refine.quality import Quality
from sixflow.settings import Settings

LADDER = (8, 11, 16, 22, 31, 44, 62)
"""px"""
SEARCHED = 31
SHARPEN = 2
FINER = 3
"""How many of the next finer windows are taken at their word."""
DOUBTED = 2.0
"""c: factor on the noise's part for windows finer than these."""
SPREAD = 0.5
"""Standard deviation of K, in periods of the coarser window."""
ALLOWED = 2.0
"""z: standard deviations that the mean square of noise may exceed its expectation by."""

Array = NDArray[Any]


@dataclasses.dataclass(frozen=True)
class Level:
    """What one window of the ladder measured; arrays as from `refine.refine`, flags as from `validate.flag_points`."""

    settings: Settings
    maps: Array
    quality: Quality
    left: Array
    flag: NDArray[np.uint16]

    @property
    def period(self) -> float:
        """Period attenuated by 10 %, px."""
        return attenuation_period(self.settings.sigma, self.settings.sharpen)

    @property
    def usable(self) -> NDArray[np.bool_]:
        """Points that did not fail."""
        return (self.flag & FAILING) == 0

    def variances(self) -> tuple[Array, Array]:
        """Of the displacement and of the gradient, with what passes may have left; NaN where not known."""
        variance = np.diagonal(self.quality.covariance, axis1=-2, axis2=-1).astype(np.float64)
        left = np.where(np.isfinite(self.left), self.left, 0.0) ** 2
        return variance[..., :2].sum(axis=-1) + left, variance[..., 2:].sum(
            axis=-1
        ) + left / self.settings.sigma**2


def ladder(settings: Settings, shape: tuple[int, int]) -> list[Settings]:
    """Return the settings of each window, from fine to coarse: those of which a frame holds two, and the smallest.

    Parameters
    ----------
    settings : Settings
        With `window="auto"`; its `sharpen`, or 2 where that is 0, holds for every window.
    shape : (int, int)
        Height and width of the frames, px.
    """
    windows = [window for window in LADDER if window <= min(shape) / 2] or [LADDER[0]]
    sharpen = settings.sharpen or SHARPEN
    return [settings.replace(window=window, sharpen=sharpen) for window in windows]


def search_settings(settings: Settings, shape: tuple[int, int]) -> Settings:
    """Return the settings with the window that a search takes, where it is "auto": 31 px, or what a frame holds."""
    if settings.window != "auto":
        return settings
    fitting = [window for window in LADDER if window <= min(min(shape), SEARCHED)]
    return settings.replace(window=max(fitting, default=LADDER[0]))


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


def risks(levels: list[Level], grid: Grid) -> Array:
    """Product of the expected squared errors of displacement and gradient; (levels, rows, columns), inf where unusable.

    Parameters
    ----------
    levels : list of Level
        From fine to coarse.
    grid : Grid
    """
    six = [np.tensordot(SIX_FROM_GRADIENT, level.maps, axes=1) for level in levels]
    variances = [level.variances() for level in levels]
    product = np.ones((len(levels), *grid.shape))
    for kind, place in enumerate((slice(0, 2), slice(2, 6))):
        count = place.stop - place.start
        for j, coarse in enumerate(levels):
            reach = SPREAD * coarse.period / grid.step
            bias = np.zeros(grid.shape)
            for i, fine in enumerate(levels[:j]):
                both = fine.usable & coarse.usable
                seen = ((six[j][place] - six[i][place]) ** 2).sum(axis=0)
                share = difference_noise(
                    coarse.settings.window / fine.settings.window, fine.settings.sharpen
                )[kind]
                noise = _mean(share * variances[i][kind], both, reach)
                independent = count * (2 * math.pi * SPREAD * coarse.period / fine.period) ** 2
                allowed = (1 + ALLOWED * math.sqrt(2 / independent)) * (1 if j - i <= FINER else DOUBTED)
                excess = _mean(seen, both, reach) - allowed * noise
                bias = np.fmax(bias, excess)
            product[j] *= _mean(variances[j][kind], coarse.usable, reach) + bias
    usable = np.stack([level.usable for level in levels])
    return np.where(usable & np.isfinite(product), product, np.inf)


def _mean(values: Array, known: NDArray[np.bool_], reach: float) -> Array:
    """Gaussian mean over the known values about every point; NaN where there are none."""
    known = known & np.isfinite(values)
    weight = scipy.ndimage.gaussian_filter(known.astype(np.float64), reach, mode="constant")
    total = scipy.ndimage.gaussian_filter(np.where(known, values, 0.0), reach, mode="constant")
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(weight > 1e-6, total / weight, np.nan)


@dataclasses.dataclass(frozen=True)
class Chosen:
    """The field made of the levels; `window` and `period` in px, shape (rows, columns)."""

    maps: Array
    quality: Quality
    flag: NDArray[np.uint16]
    window: Array
    period: Array


def choose(levels: list[Level], grid: Grid) -> Chosen:
    """Blend the windows about the one of least risk.

    A point where no window is usable takes the flags of the coarsest.

    Parameters
    ----------
    levels : list of Level
        From fine to coarse, on one grid.
    grid : Grid
    """
    risk = risks(levels, grid)
    best = np.where(np.isfinite(risk).any(axis=0), risk.argmin(axis=0), len(levels) - 1)
    height = _smooth(best, levels, grid)
    usable = np.stack([level.usable for level in levels])
    fine = _nearest(usable, np.floor(height).astype(int), upwards=False)
    coarse = _nearest(usable, np.ceil(height).astype(int), upwards=True)
    fine, coarse = np.where(fine < 0, coarse, fine), np.where(coarse < 0, fine, coarse)
    fine, coarse = np.where(fine < 0, best, fine), np.where(coarse < 0, best, coarse)
    with np.errstate(invalid="ignore", divide="ignore"):
        t = np.where(coarse > fine, np.clip((height - fine) / (coarse - fine), 0, 1), 0.0)
    nearest = np.where(t < 0.5, fine, coarse)
    mix = _Mix(fine, coarse, t)
    covariances = np.stack([level.quality.covariance for level in levels])
    rows, columns = np.indices(grid.shape)
    a, b = covariances[fine, rows, columns], covariances[coarse, rows, columns]
    weight = t[..., None, None]

    def mixed(name: str) -> Array:
        return mix.of(np.stack([getattr(level.quality, name) for level in levels]))

    quality = dataclasses.replace(
        levels[-1].quality,
        covariance=((1 - weight) ** 2 * a + weight * (2 - weight) * b).astype(covariances.dtype),
        texture=mixed("texture"),
        weight=mixed("weight"),
        residual=mixed("residual"),
        noise=mixed("noise"),
    )
    sizes = np.log([level.settings.window for level in levels])
    window = np.exp((1 - t) * sizes[fine] + t * sizes[coarse])
    scale = levels[0].period / levels[0].settings.window
    maps = np.stack([mix.of(np.stack([level.maps[k] for level in levels])) for k in range(6)])
    flag = np.stack([level.flag for level in levels])[nearest, rows, columns]
    return Chosen(maps, quality, flag, window, scale * window)


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


def _smooth(best: NDArray[np.intp], levels: list[Level], grid: Grid) -> Array:
    """Mean level about every point, each level over a quarter of its period."""
    shares = [
        scipy.ndimage.gaussian_filter(
            (best == k).astype(np.float64), level.period / 4 / grid.step, mode="nearest"
        )
        for k, level in enumerate(levels)
    ]
    return np.sum([k * share for k, share in enumerate(shares)], axis=0) / np.sum(shares, axis=0)


def _nearest(usable: NDArray[np.bool_], wanted: NDArray[np.intp], *, upwards: bool) -> NDArray[np.intp]:
    """The usable level nearest to the wanted one on its side; −1 where there is none."""
    found = np.full(wanted.shape, -1)
    for k in range(len(usable)) if not upwards else range(len(usable) - 1, -1, -1):
        here = usable[k] & ((k >= wanted) if upwards else (k <= wanted))
        found = np.where(here, k, found)
    return found
