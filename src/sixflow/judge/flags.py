"""Flags: which points of a solution were measured, and what is to be said of the others.

A point has to have texture above the noise (`sixflow.judge.texture`) and a standard error below `MAXIMUM_ERROR`, a
place in both frames, and has to stay where it is from pass to pass. Its neighbours have to predict it
(`sixflow.maps.neighbours`, `sixflow.judge.contradiction`), and its window has to match, by itself or with theirs
(`sixflow.judge.match`).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.convention.flags import FAILING, FLAGS
from sixflow.convention.reference import SHARE
from sixflow.engine.rows import LEAST_AREA
from sixflow.judge.chance import normal_limit
from sixflow.judge.contradiction import (
    at_edge,
    disagreement,
    gradient_outliers,
    gradient_variances,
    stands_out,
)
from sixflow.judge.match import matches
from sixflow.judge.texture import is_textured, noise_power
from sixflow.maps.grid import Grid
from sixflow.maps.neighbours import AGREEMENT, CURVED, LIMIT, curvature, median_outliers
from sixflow.maps.placing import leaves, masked_points
from sixflow.plan import Plan
from sixflow.prepare.frame import Frame
from sixflow.refine.problem import MINIMUM_KEPT, MINIMUM_WEIGHT, least_texture
from sixflow.refine.solution import Solution

MAXIMUM_ERROR = 0.5
"""px: a larger standard error is no measurement."""
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
    variances = gradient_variances(found.covariance)
    flag |= _among_neighbours(trusted, found, variances, grid, plan)
    trusted[:, (flag & FAILING).astype(bool)] = np.nan
    unmatched = ~matches(found, trusted, variances, grid.step)
    in_doubt = (flag & FLAGS["low_texture"] != 0) | (unmatched & (flag & FAILING == 0))
    flag[unmatched] |= FLAGS["unmatched"]
    flag[masked] = FLAGS["masked"]
    if (in_doubt & ~masked).any():
        flag = _with_reasons(flag, in_doubt & ~masked, unmatched, found, grid, reference, plan)
    return found.replace(flag=flag)


def _with_reasons(
    flag: NDArray[np.uint16],
    failed: NDArray[np.bool_],
    unmatched: NDArray[np.bool_],
    found: Solution,
    grid: Grid,
    frame: Frame,
    plan: Plan,
) -> NDArray[np.uint16]:
    """Tell windows without texture from those that have it and do not match: their residual is no noise."""
    low, window, noise = FLAGS["low_texture"], plan.window.size, found.statistics.noise
    power = noise_power(frame, window)
    textured = is_textured(frame, grid, window, noise[~unmatched])
    with np.errstate(invalid="ignore"):
        unlike = unmatched | ~(noise**2 < power * (1 + least_texture(window**2)))
    flag[failed & unlike & textured] &= np.uint16(~low & 0xFFFF)
    flag[failed & unlike & textured] |= FLAGS["unmatched"]
    flag[failed & ~textured] |= low
    return flag


def bias_rules(found: Solution) -> NDArray[np.bool_]:
    """Where what the window leaves out of the displacement stands out of its noise; of points that have a value."""
    if found.bias is None:
        return np.zeros(found.flag.shape, np.bool_)
    with np.errstate(invalid="ignore"):
        noise = np.diagonal(found.covariance, axis1=-2, axis2=-1)[..., :2]
        left_out = found.bias[..., :2] > normal_limit() ** 2 * noise
    return np.asarray(left_out.any(axis=-1) & ~found.failed)


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
        textured = statistics.texture > least_texture(found.window**2 * statistics.weight)
        measurable = textured & (error < MAXIMUM_ERROR)
        partner = statistics.weight if statistics.partner is None else statistics.partner
        flag[partner < COMPLETE_WEIGHT] |= FLAGS["border"]
        flag[unknown | ~measurable] |= FLAGS["low_texture"]
        gone = (outside & ~unknown) | (partner < MINIMUM_WEIGHT) | (statistics.weight < MINIMUM_KEPT)
        flag[gone] |= FLAGS["unmatched"]
        flag[_collapses(maps, plan.reference)] |= FLAGS["outlier"]
        flag[found.left > np.maximum(2 * plan.tolerance, error / 2)] |= FLAGS["not_converged"]
    return flag


def _among_neighbours(
    maps: NDArray[Any], found: Solution, variances: NDArray[np.float64], grid: Grid, plan: Plan
) -> NDArray[np.uint16]:
    """Flags of outliers in gradient, edges, what is unresolved, and residuals that stand out (`contradiction`)."""
    flag, statistics = np.zeros(grid.shape, np.uint16), found.statistics
    period = plan.window.period
    in_all = variances if found.bias is None else gradient_variances(found.covariance, found.bias)
    flag[gradient_outliers(maps, in_all, grid.step, period)] |= FLAGS["outlier"]
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


def _collapses(maps: NDArray[Any], reference: str) -> NDArray[np.bool_]:
    """Maps that fold the window, or press it together so that it matches anything smooth: det F < 0.05 on the way from
    either frame to the point.
    """
    found = np.zeros(maps.shape[1:], np.bool_)
    for way in (1 - SHARE[reference], -SHARE[reference]):
        determinant = (1 + way * maps[2]) * (1 + way * maps[5]) - way**2 * maps[3] * maps[4]
        found |= determinant < LEAST_AREA
    return found
