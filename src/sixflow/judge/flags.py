"""Validate: the normalised median test between neighbours' affine maps, what stands in for a failed
point, and the flags of every point.

Westerweel and Scarano (2005), extended to affine maps: neighbour n predicts d_n + G_n(p − n) at the
point p, so that a deforming field is no outlier. With the median m of the predictions and the median ρ
of their distances from it, a point fails if

    |d − m| > limit · (ρ + floor)

in u or in v. Neighbours are taken half a window away, where windows begin to see other pixels.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sixflow.convention.flags import FAILING, FLAGS
from sixflow.convention.reference import SHARE
from sixflow.engine.compiler import kernel
from sixflow.engine.rows import LEAST_AREA
from sixflow.engine.threads import over_strips
from sixflow.engine.weigh import by_chance
from sixflow.engine.window import attenuation_period, plain_window
from sixflow.judge.contradiction import (
    at_edge,
    curvature,
    disagreement,
    gradient_outliers,
    gradient_variances,
    median,
    stands_out,
)
from sixflow.maps.grid import Grid
from sixflow.maps.placing import leaves, masked_points
from sixflow.prepare.frame import Frame
from sixflow.settings import Settings

if TYPE_CHECKING:
    from sixflow.refine.quality import Quality

LIMIT = 3.0
FLOOR = 0.1  # px: disagreement that is never held against a point
CURVED = 1.4  # times what a curved field makes neighbours mispredict is no contradiction

MINIMUM_TEXTURE = 1.0  # gradient power in the weakest direction, over that of noise
MAXIMUM_ERROR = 0.5  # px: a larger standard error is no measurement
MAXIMUM_RESIDUAL = 1.0  # of a zero-normalised residual: correlation 0.5
SUSPECT_RESIDUAL = 0.6  # enough to call a window unmatched whose texture does not rise above the residual
MINIMUM_WEIGHT = 0.2
MINIMUM_KEPT = 0.1  # what foreign pixels have to leave of a window: fewer pixels could match by chance
TYPICAL_SHARE = 0.98
COMPLETE_WEIGHT = 0.98


@kernel
def _test_strip(
    maps: NDArray[Any],
    step: int,
    reach: int,
    floor: NDArray[Any],
    start: int,
    stop: int,
    outlier: NDArray[Any],
) -> None:
    rows, columns = maps.shape[1:]
    predicted = np.empty(8)
    ordered = np.empty(8)
    for j in range(start, stop):
        for i in range(columns):
            outlier[j, i] = False
            if maps[0, j, i] != maps[0, j, i]:
                continue
            for component in range(2):
                count, furthest = 0, 0.0
                for dj in range(-reach, reach + 1, reach):
                    for di in range(-reach, reach + 1, reach):
                        y, x = j + dj, i + di
                        if (dj == 0 and di == 0) or y < 0 or x < 0 or y >= rows or x >= columns:
                            continue
                        guess = (
                            maps[component, y, x]
                            - maps[2 + 2 * component, y, x] * (di * step)
                            - maps[3 + 2 * component, y, x] * (dj * step)
                        )
                        if guess == guess:
                            predicted[count] = guess
                            ordered[count] = guess
                            count += 1
                            furthest = max(furthest, abs(guess - maps[component, j, i]))
                if count < 3 or furthest <= LIMIT * floor[j, i]:
                    continue
                middle = median(ordered, count)
                for k in range(count):
                    ordered[k] = abs(predicted[k] - middle)
                spread = median(ordered, count)
                if abs(maps[component, j, i] - middle) > LIMIT * (spread + floor[j, i]):
                    outlier[j, i] = True


def median_outliers(
    maps: NDArray[Any], step: int, window: float, floor: NDArray[Any] | float = FLOOR
) -> NDArray[np.bool_]:
    """Find points that contradict their neighbours.

    Parameters
    ----------
    maps : array, shape (6, rows, columns)
        u, v, u_x, u_y, v_x, v_y; NaN at failed points, which are neither tested nor asked.
    step : int
        Grid spacing, px.
    window : float
        px; sets how far away the neighbours are asked.
    floor : float or array, shape (rows, columns)
        Tolerance that noise alone deserves, px.

    Returns
    -------
    bool array, shape (rows, columns)
    """
    rows, columns = maps.shape[1:]
    outlier = np.zeros((rows, columns), dtype=np.bool_)
    reach = min(max(1, round(window / 2 / step)), max(1, (min(rows, columns) - 1) // 2))
    levels = np.broadcast_to(np.asarray(floor, dtype=np.float64), outlier.shape).copy()
    over_strips(lambda a, b: _test_strip(maps, step, reach, levels, a, b, outlier), rows, 16)
    return outlier


def fill_failed(maps: NDArray[Any], step: int) -> NDArray[Any]:
    """Give every failed (NaN) point the mean of its neighbours' affine maps, from the edge of each gap
    inwards.

    For the blend alone, which needs a map everywhere: a failed point is NaN in the result all the same.

    Parameters
    ----------
    maps : array, shape (6, rows, columns)
    step : int
        Grid spacing, px.

    Returns
    -------
    array of the same shape without NaN; zero motion if nothing is known anywhere
    """
    failed = np.isnan(maps).any(axis=0)
    if not failed.any():
        return maps
    if failed.all():
        return np.zeros_like(maps)
    filled, known = np.where(failed, 0, maps), ~failed
    usual = _usual_gradient(maps, known)
    while not known.all():
        _fill_ring(filled, known, step, usual)
    return filled


def _usual_gradient(maps: NDArray[Any], known: NDArray[np.bool_]) -> NDArray[Any]:
    """Median of u_x, u_y, v_x, v_y over the known points, or over a few thousand of them."""
    stride = max(1, math.isqrt(known.size // 2048))
    some = known[::stride, ::stride]
    if not some.any():
        return np.median(maps[2:, known], axis=1)
    return np.median(maps[2:, ::stride, ::stride][:, some], axis=1)


@kernel
def _fill_ring(filled: NDArray[Any], known: NDArray[Any], step: int, usual: NDArray[Any]) -> None:
    """Give the unknown points beside known ones what these predict, and mark them as known."""
    rows, columns = known.shape
    reached = np.zeros((rows, columns), np.bool_)
    total = np.empty(6)
    for j in range(rows):
        for i in range(columns):
            if known[j, i]:
                continue
            count = 0
            total[:] = 0
            for dj in range(-1, 2):
                for di in range(-1, 2):
                    y, x = j + dj, i + di
                    if y < 0 or x < 0 or y >= rows or x >= columns or not known[y, x]:
                        continue
                    count += 1
                    for k in range(6):
                        value = filled[k, y, x]
                        if k < 2:
                            value -= step * (filled[2 + 2 * k, y, x] * di + filled[3 + 2 * k, y, x] * dj)
                        total[k] += value
            if count == 0:
                continue
            reached[j, i] = True
            for k in range(6):
                mean = total[k] / count
                # let what is special in a guessed gradient fade with distance
                filled[k, j, i] = mean if k < 2 else usual[k - 2] + 0.8 * (mean - usual[k - 2])
    for j in range(rows):
        for i in range(columns):
            known[j, i] |= reached[j, i]


def settle(maps: NDArray[Any], step: int, window: float, *, curved: bool = False) -> NDArray[Any]:
    """Replace points that failed or contradict their neighbours by what the neighbours predict.

    With `curved` what a curved field makes them mispredict is no contradiction: for maps that have nearly settled.
    """
    floor = FLOOR + CURVED / LIMIT * curvature(maps, step, window) if curved else FLOOR
    outlier = median_outliers(maps, step, window, floor)
    if outlier.any():
        maps = np.where(outlier, np.nan, maps)
    return fill_failed(maps, step)


def typical(left: NDArray[Any], share: float = TYPICAL_SHARE) -> float:
    """What a share of the points does not exceed."""
    known = left[np.isfinite(left)]
    return float(np.quantile(known, share)) if known.size else np.inf


def flag_points(
    maps: NDArray[Any],
    quality: Quality,
    left: NDArray[Any],
    grid: Grid,
    reference: Frame,
    settings: Settings,
) -> NDArray[np.uint16]:
    """Judge every grid point; bits as in `sixflow.field.FLAGS`.

    Parameters
    ----------
    maps : array, shape (6, rows, columns)
        Solution of the last pass; NaN where its equations were singular.
    quality, left
        As `refine.refine` returns them.
    grid : Grid
    reference : Frame
        The reference frame at full resolution.
    """
    flag = np.zeros(grid.shape, np.uint16)
    variance = quality.covariance
    with np.errstate(invalid="ignore"):
        error = np.sqrt(np.maximum(variance[..., 0, 0], variance[..., 1, 1])).astype(np.float64)
        outside = leaves(maps, grid, reference.image.shape, settings.reference)
        unknown = np.isnan(maps).any(axis=0)
        measurable = (quality.texture > quality.minimum_texture) & (error < MAXIMUM_ERROR)
        partner = quality.weight if quality.partner is None else quality.partner
        flag[partner < COMPLETE_WEIGHT] |= FLAGS["border"]
        flag[unknown | ~measurable] |= FLAGS["low_texture"]
        unlike = quality.residual > np.where(measurable, MAXIMUM_RESIDUAL, SUSPECT_RESIDUAL)
        if quality.matched is not None:
            unlike |= ~(quality.matched > by_chance(quality.residual))
        gone = (outside & ~unknown) | (partner < MINIMUM_WEIGHT) | (quality.weight < MINIMUM_KEPT) | unlike
        flag[gone] |= FLAGS["unmatched"]
        flag[_collapses(maps, settings.reference)] |= FLAGS["outlier"]
        flag[left > np.maximum(2 * settings.tolerance, error / 2)] |= FLAGS["not_converged"]
    masked = masked_points(maps, grid, reference.valid, settings.reference)
    trusted = np.where((flag & FAILING).astype(bool) | masked, np.nan, maps)
    floor = np.maximum(FLOOR, np.nan_to_num(error, nan=FLOOR))
    reach = plain_window(settings.window, settings.sharpen)
    floor += CURVED / LIMIT * curvature(trusted, grid.step, reach)
    flag[median_outliers(trusted, grid.step, reach, floor)] |= FLAGS["outlier"]
    _compare_with_neighbours(
        flag, np.where((flag & FAILING).astype(bool), np.nan, trusted), quality, grid, settings
    )
    flag[_unsupported((flag & FAILING).astype(bool) & ~masked, masked)] |= FLAGS["outlier"]
    failed = (flag & FAILING).astype(bool) | masked
    flag[_islands(failed, quality.residual, (settings.window / grid.step) ** 2)] |= FLAGS["outlier"]
    flag[masked] = FLAGS["masked"]
    return flag


def _compare_with_neighbours(
    flag: NDArray[np.uint16], maps: NDArray[Any], quality: Quality, grid: Grid, settings: Settings
) -> None:
    """Flag outliers in gradient, edges, what is unresolved, and residuals that stand out (`consistency`)."""
    variances = gradient_variances(quality.covariance)
    period = attenuation_period(settings.sigma, settings.sharpen)
    flag[gradient_outliers(maps, variances, grid.step, period)] |= FLAGS["outlier"]
    apart = disagreement(maps, variances, grid.step, period)
    edge = at_edge(apart, quality.foreign, quality.foreign_centre)
    flag[edge] |= FLAGS["edge"]
    flag[(apart > 1) & ~edge] |= FLAGS["unresolved"]
    measured = np.isfinite(maps[0])
    flag[measured & stands_out(quality.noise, quality.residual, grid.step, settings.window)] |= FLAGS[
        "residual"
    ]


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
