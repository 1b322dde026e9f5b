"""Refine: passes at full resolution until the points stay, to the noise limit."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.judge.flags import TYPICAL_SHARE, settle, typical
from sixflow.refine.passes import Passes
from sixflow.refine.quality import Quality
from sixflow.refine.sharpen import sharpen

NEAR = 0.2  # px: residuals of points so close to where they end tell foreign pixels
WEIGHED_PASSES = 2  # weighed passes over the limit of ordinary ones: they converge more slowly
WEIGHED_SHARE = (
    0.995  # of the points that have to stay where pixels are weighed: the last ones are those in doubt
)
EXPLAINED = 0.01  # share of the residual's power that a last pass may still take out


def refine(
    passes: Passes, start: NDArray[Any], *, sharpened: bool = False
) -> tuple[NDArray[Any], Quality, NDArray[Any]]:
    """Passes in total form until the points stay, then sharpening passes.

    A pass brings a point close to its fixed point at once. What is left is the update times the rate at
    which passes contract: the noise's share of the normal matrix, or a few percent where that is less
    (`Passes.contraction`). The passes end when this is below the tolerance and the
    last update no longer changed the residual, from which the covariance is taken. If the residual then shows
    pixels that do not belong (`Passes.distrust`), further passes give these little weight.

    Parameters
    ----------
    passes : Passes
    start : float64 array, shape (6, rows, columns)
        Without NaN.
    sharpened : bool
        The start was measured with sharpening by another window: sharpening passes alone.

    Returns
    -------
    maps : float64 array, shape (6, rows, columns)
        NaN where the equations of the last pass were singular.
    quality : Quality
    left : float64 array, shape (rows, columns)
        How far each point may still be from its fixed point, px.
    """
    settings, step = passes.settings, passes.grid.step
    maps, left = start, np.full(passes.grid.shape, np.inf)
    passes.begin()
    if sharpened:
        passes.solve(maps, total=False)
        passes.distrust()
    done = 0
    while not sharpened and done < settings.passes * (WEIGHED_PASSES if passes.robust else 1):
        filled = maps
        if done or passes.robust:
            filled = passes.dense(maps)
            if (
                passes.robust
            ):  # what foreign pixels leave without texture wanders, and would take its neighbours along
                filled = np.where(passes.measurable(), filled, np.nan)
            filled = settle(filled, step, settings.window, curved=passes.robust)
        maps = passes.solve(filled)
        done += 1
        update = np.hypot(maps[0] - filled[0], maps[1] - filled[1])
        left = update * passes.contraction()
        if (done > 1 or typical(update) < NEAR) and passes.distrust():
            done = 0
            continue
        most = typical(
            np.where(passes.measurable(), left, np.nan), WEIGHED_SHARE if passes.robust else TYPICAL_SHARE
        )
        if most < settings.tolerance and passes.explained() < EXPLAINED:
            if passes.changing and (left[passes.measurable()] > 2 * settings.tolerance).any():
                continue  # what is in doubt stays once the weights do
            break
    if not settings.sharpen:
        return maps, passes.quality(), left
    fine = sharpen(passes, maps, left, sharpened=sharpened)
    return fine.maps, passes.quality(settings.sharpen, fine.held), fine.left
