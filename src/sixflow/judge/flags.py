"""Flags: which points of a solution were measured, and what is to be said of the others.

A point has to have texture above the noise and a standard error below `MAXIMUM_ERROR`, a window that looks alike in
both frames, a place in both, and has to stay where it is from pass to pass. Its neighbours have to predict it
(`sixflow.maps.neighbours`, `sixflow.judge.contradiction`), and most of them have to be measured too.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.convention.flags import FAILING, FLAGS
from sixflow.convention.reference import SHARE
from sixflow.engine.rows import LEAST_AREA
from sixflow.engine.weigh import by_chance
from sixflow.judge.contradiction import (
    at_edge,
    disagreement,
    gradient_outliers,
    gradient_variances,
    stands_out,
)
from sixflow.maps.grid import Grid
from sixflow.maps.neighbours import AGREEMENT, CURVED, LIMIT, curvature, median_outliers
from sixflow.maps.placing import leaves, masked_points
from sixflow.plan import Plan
from sixflow.prepare.frame import Frame
from sixflow.refine.problem import MINIMUM_KEPT, MINIMUM_TEXTURE, MINIMUM_WEIGHT
from sixflow.refine.solution import Solution

MAXIMUM_ERROR = 0.5
"""px: a larger standard error is no measurement."""
MAXIMUM_RESIDUAL = 1.0
"""Of a zero-normalised residual: correlation 0.5."""
SUSPECT_RESIDUAL = 0.6
"""Residual that is enough to call a window unmatched whose texture does not rise above it."""
COMPLETE_WEIGHT = 0.98
"""Share of a window on pixels that have a partner, below which it is cut by a border."""


def judged(found: Solution, grid: Grid, reference: Frame, plan: Plan) -> Solution:
    """Judge every grid point; bits as in `sixflow.field.FLAGS`.

    Parameters
    ----------
    found : Solution
        As it was refined, with one window.
    grid : Grid
    reference : Frame
        The reference frame at full resolution, masked where no point is asked for.
    plan : Plan
    """
    flag = _by_itself(found, grid, reference.image.shape, plan)
    masked = masked_points(found.maps, grid, reference.valid, plan.reference)
    trusted = np.where((flag & FAILING).astype(bool) | masked, np.nan, found.maps)
    reach = plan.window.resolving
    agreement = np.maximum(AGREEMENT, np.nan_to_num(_error(found), nan=AGREEMENT))
    agreement += CURVED / LIMIT * curvature(trusted, grid.step, reach)
    flag[median_outliers(trusted, grid.step, reach, agreement)] |= FLAGS["outlier"]
    trusted[:, (flag & FAILING).astype(bool)] = np.nan
    flag |= _among_neighbours(trusted, found, grid, plan)
    flag[_unsupported((flag & FAILING).astype(bool) & ~masked, masked)] |= FLAGS["outlier"]
    failed = (flag & FAILING).astype(bool) | masked
    islands = _islands(failed, found.statistics.residual, (plan.window.size / grid.step) ** 2)
    flag[islands] |= FLAGS["outlier"]
    flag[masked] = FLAGS["masked"]
    return found.replace(flag=flag)


def _error(found: Solution) -> NDArray[np.float64]:
    """The larger standard error of u and v, px; shape (rows, columns)."""
    variance = found.covariance
    with np.errstate(invalid="ignore"):
        return np.sqrt(np.maximum(variance[..., 0, 0], variance[..., 1, 1])).astype(np.float64)


def _by_itself(found: Solution, grid: Grid, shape: tuple[int, ...], plan: Plan) -> NDArray[np.uint16]:
    """Flags of every point that its own window tells."""
    flag, maps, statistics = np.zeros(grid.shape, np.uint16), found.maps, found.statistics
    with np.errstate(invalid="ignore"):
        error = _error(found)
        outside = leaves(maps, grid, (shape[0], shape[1]), plan.reference)
        unknown = np.isnan(maps).any(axis=0)
        measurable = (statistics.texture > MINIMUM_TEXTURE) & (error < MAXIMUM_ERROR)
        partner = statistics.weight if statistics.partner is None else statistics.partner
        flag[partner < COMPLETE_WEIGHT] |= FLAGS["border"]
        flag[unknown | ~measurable] |= FLAGS["low_texture"]
        unlike = statistics.residual > np.where(measurable, MAXIMUM_RESIDUAL, SUSPECT_RESIDUAL)
        if statistics.matched is not None:
            unlike |= ~(statistics.matched > by_chance(statistics.residual))
        gone = (outside & ~unknown) | (partner < MINIMUM_WEIGHT) | (statistics.weight < MINIMUM_KEPT) | unlike
        flag[gone] |= FLAGS["unmatched"]
        flag[_collapses(maps, plan.reference)] |= FLAGS["outlier"]
        flag[found.left > np.maximum(2 * plan.tolerance, error / 2)] |= FLAGS["not_converged"]
    return flag


def _among_neighbours(maps: NDArray[Any], found: Solution, grid: Grid, plan: Plan) -> NDArray[np.uint16]:
    """Flags of outliers in gradient, edges, what is unresolved, and residuals that stand out (`contradiction`)."""
    flag, statistics = np.zeros(grid.shape, np.uint16), found.statistics
    variances, period = gradient_variances(found.covariance), plan.window.period
    flag[gradient_outliers(maps, variances, grid.step, period)] |= FLAGS["outlier"]
    apart = disagreement(maps, variances, grid.step, period)
    edge = at_edge(apart, statistics.outlying, statistics.outlying_centre)
    flag[edge] |= FLAGS["edge"]
    flag[(apart > 1) & ~edge] |= FLAGS["unresolved"]
    alone = stands_out(statistics.noise, statistics.residual, grid.step, plan.window.size)
    flag[np.isfinite(maps[0]) & alone] |= FLAGS["residual"]
    return flag


def _unsupported(failed: NDArray[np.bool_], masked: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Points most of whose neighbours failed: an island in a region that could not be measured is chance."""
    return ~failed & (_neighbours(failed) > 2 * _neighbours(~failed & ~masked))


def isolated(flag: NDArray[np.uint16]) -> NDArray[np.bool_]:
    """Points of a finished field most of whose neighbours failed, and those that lose their neighbours by that."""
    masked = (flag & FLAGS["masked"]) != 0
    failed, alone = ((flag & FAILING) != 0) & ~masked, np.zeros(flag.shape, np.bool_)
    while (more := _unsupported(failed | alone, masked) & ~masked).any():
        alone |= more
    return alone


def _neighbours(points: NDArray[np.bool_]) -> NDArray[np.int8]:
    """How many of the eight neighbours of every point are among some points."""
    around = np.pad(points.astype(np.int8), 1)
    rows, columns = points.shape
    total = np.zeros(points.shape, np.int8)
    for j in range(3):
        for i in range(3):
            if (j, i) != (1, 1):
                total += around[j : j + rows, i : i + columns]
    return total


def _islands(failed: NDArray[np.bool_], residual: NDArray[Any], window: float) -> NDArray[np.bool_]:
    """Connected points, no more than one window holds, that match poorly: they see the same pixels and confirm nothing.

    `window` is the number of grid points in one.
    """
    if not failed.any() or failed.all():
        return np.zeros(failed.shape, np.bool_)
    from scipy.ndimage import label, median

    number, count = label(~failed, np.ones((3, 3)))
    every = np.arange(1, count + 1)
    small = np.bincount(number.ravel(), minlength=count + 1)[1:] <= window
    if not small.any():
        return np.zeros(failed.shape, np.bool_)
    poor = np.asarray(median(residual, number, every)) > SUSPECT_RESIDUAL
    return np.append(False, small & poor)[number]


def _collapses(maps: NDArray[Any], reference: str) -> NDArray[np.bool_]:
    """Maps that fold the window, or press it together so that it matches anything smooth: det F < 0.05 on the way from
    either frame to the point.
    """
    found = np.zeros(maps.shape[1:], np.bool_)
    for way in (1 - SHARE[reference], -SHARE[reference]):
        determinant = (1 + way * maps[2]) * (1 + way * maps[5]) - way**2 * maps[3] * maps[4]
        found |= determinant < LEAST_AREA
    return found
