"""Resolution: the window that has the least error, chosen at every point.

Every window of a ladder has noise, of variance V_j, and leaves something out, of expected square B_j
(`sixflow.refine.bias`). Its expected squared error is

    R_j = V_j + B_j

with V_j the mean about the point where that is more, because the noise of small windows is known least where it is
least. R is formed
for the displacement and for the gradient, and the window with the least product of the two is taken: neither has a unit
that outweighs the other.

The level chosen is averaged over a quarter of its period, and the two windows about it are blended, so that the field
has no steps (`sixflow.refine.mix`); of the one that is worse here no more than the ratio of their risks,
t ≤ R_a/R_b or 1 − t ≤ R_b/R_a. What both leave out may be the same, so that the blend leaves out
((1 − t) √B_a + t √B_b)², here with what is known at the point itself.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from sixflow.maps.grid import Grid
from sixflow.plan import Window
from sixflow.refine.bias import Bands, bands_of
from sixflow.refine.mix import Mix
from sixflow.refine.solution import Solution

Array = NDArray[Any]


def risks(bands: Bands, usable: NDArray[np.bool_]) -> Array:
    """Expected squared errors of displacement and gradient; (2, levels, rows, columns), infinite where unusable.

    Parameters
    ----------
    bands : Bands
    usable : bool array, shape (levels, rows, columns)
    """
    error = bands.noise + bands.expected
    both = np.stack([error[..., :2].sum(axis=-1), error[..., 2:].sum(axis=-1)])
    return np.where(usable & np.isfinite(both), both, np.inf)


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
    bands = bands_of(levels, windows, grid)
    usable = np.stack([~level.failed for level in levels])
    mix = _mix(risks(bands, usable), usable, windows, grid)
    rows, columns = np.indices(grid.shape)
    fine, coarse = (np.sqrt(bands.seen[k, rows, columns]) for k in (mix.fine, mix.coarse))
    t = mix.t[..., None]
    blended = mix.blend({k: levels[k] for k in mix.used})
    return blended.replace(bias=((1 - t) * fine + t * coarse) ** 2)


def _mix(risk: Array, usable: NDArray[np.bool_], windows: tuple[Window, ...], grid: Grid) -> Mix:
    """Which two levels are blended at every point, and how."""
    product = risk[0] * risk[1]
    best = np.where(np.isfinite(product).any(axis=0), product.argmin(axis=0), len(windows) - 1)
    height = _smooth(best, windows, grid)
    fine = _nearest(usable, np.floor(height).astype(int), upwards=False)
    coarse = _nearest(usable, np.ceil(height).astype(int), upwards=True)
    fine, coarse = np.where(fine < 0, coarse, fine), np.where(coarse < 0, fine, coarse)
    fine, coarse = np.where(fine < 0, best, fine), np.where(coarse < 0, best, coarse)
    rows, columns = np.indices(grid.shape)
    with np.errstate(invalid="ignore", divide="ignore"):
        t = np.where(coarse > fine, np.clip((height - fine) / (coarse - fine), 0, 1), 0.0)
        ratio = risk[:, fine, rows, columns] / risk[:, coarse, rows, columns]
        t = np.where(
            np.isfinite(ratio).all(axis=0), t.clip((1 - 1 / ratio).max(axis=0), ratio.min(axis=0)), t
        )
    return Mix(fine, coarse, t.clip(0, 1))


def _smooth(best: NDArray[np.intp], windows: tuple[Window, ...], grid: Grid) -> Array:
    """Mean level about every point, each level over a quarter of its period."""
    shares = [
        scipy.ndimage.gaussian_filter(
            (best == k).astype(np.float64), window.period / 4 / grid.step, mode="nearest"
        )
        for k, window in enumerate(windows)
    ]
    return np.asarray(np.sum([k * share for k, share in enumerate(shares)], axis=0) / np.sum(shares, axis=0))


def _nearest(usable: NDArray[np.bool_], wanted: NDArray[np.intp], *, upwards: bool) -> NDArray[np.intp]:
    """The usable level nearest to the wanted one on its side; −1 where there is none."""
    found = np.full(wanted.shape, -1)
    for k in range(len(usable)) if not upwards else range(len(usable) - 1, -1, -1):
        here = usable[k] & ((k >= wanted) if upwards else (k <= wanted))
        found = np.where(here, k, found)
    return found
