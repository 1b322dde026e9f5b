"""Uniform: what a window's affine fit makes of a motion where the texture is uniform, M, and what undoes it, Q.

Both work on the maps of a grid (`sixflow.refine.sharpen` says what for). Where the pixels that count fill a rectangle,
M is a product of one-dimensional sums (`sixflow.engine.fit`); where a mask cuts windows in any way it is summed over a
lattice of pixels.
"""

from __future__ import annotations

import abc
import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.blend import resample_strip
from sixflow.engine.fit import fit_strip, taps_of, twist_strip
from sixflow.engine.response import quotient
from sixflow.engine.threads import over_strips
from sixflow.engine.window import CUT
from sixflow.maps.grid import Grid
from sixflow.refine.sweep import Sweep
from sixflow.refine.windows import motion_sums

GRID_STRIP = 16
FARTHEST = 1.31
"""Points of a grid over σ, at most: a cubic interpolant misses (kh)⁴/384 of a wave. Of the wave that a window sharpened
twice attenuates by a tenth, kσ = 1.117, this is an eighth of that."""
STRAIGHT = 0.5
"""σ by which the outline of the pixels that count may be bent: the window's weight there is a fifth of the whole."""
BLOCK = 8
"""px."""
Array = NDArray[Any]
Sides = tuple[tuple[int, int], tuple[int, int]]


class UniformWindow(abc.ABC):
    """A window's affine fit of a displacement field, as it would be with a uniform texture."""

    @abc.abstractmethod
    def fit(self, maps: Array) -> Array:
        """M U: the affine fits of the blend of `maps`; shape (6, rows, columns).

        A point with too little of its window left for a fit keeps its map.
        """

    def deconvolve(self, maps: Array, sharpen: int) -> Array:
        """Q maps."""
        return self.deconvolved(maps, (sharpen,))[0]

    def deconvolved(self, maps: Array, orders: tuple[int, ...]) -> list[Array]:
        """Q maps for several sharpenings.

        By the Chebyshev polynomials' recurrence T*_{k+1} = 2 (2M − 1) T*_k − T*_{k−1}.
        """
        table = _coefficients(orders).astype(maps.dtype)
        before, here = maps, maps
        totals = table[:, 0, None, None, None] * maps
        for k in range(1, table.shape[1]):
            before, here = here, self._recurred(here, before, k, table[:, k], totals)
        return list(totals)

    def _recurred(self, here: Array, before: Array, k: int, parts: Array, totals: Array) -> Array:
        """T*_k of maps, of T*_{k−1} and T*_{k−2}; `parts` of it are added to the totals."""
        a, b, c = _recurrence(k)
        after = a * self.fit(here) + b * here + c * before
        totals += parts[:, None, None, None] * after
        return after


@cache
def _coefficients(orders: tuple[int, ...]) -> NDArray[np.float64]:
    """Chebyshev coefficients of Q for several sharpenings; shape (orders, 1 or 10)."""
    rows = [quotient(order) for order in orders]
    length = max(len(row) for row in rows)
    return np.stack([np.pad(row, (0, length - len(row))) for row in rows])


def _recurrence(k: int) -> tuple[float, float, float]:
    """Shares of M T*_{k−1}, T*_{k−1} and T*_{k−2} in T*_k."""
    return (2.0, -1.0, 0.0) if k == 1 else (4.0, -2.0, -1.0)


class Axis(NamedTuple):
    """Points of a grid along one axis: origin + i·step, px."""

    origin: float
    step: int
    points: int

    def coarser(self, times: int) -> Axis:
        """So many times further apart, about the same middle."""
        points = (self.points - 1) // times + 1
        rest = (self.points - 1 - (points - 1) * times) * self.step
        return Axis(self.origin + rest / 2, times * self.step, points)


class RectangularWindow(UniformWindow):
    """Windows that a rectangle cuts, if anything does.

    Parameters
    ----------
    axes : (Axis, Axis)
        Rows and columns of the grid.
    sigma : float
        Of the Gaussian weight, px.
    counted : ((int, int), (int, int))
        First and last (exclusive) row and column of the pixels that count.

    Examples
    --------
    >>> grid = Grid.over((64, 64), 8)
    >>> window = RectangularWindow.over(grid, 6.0, ((0, 64), (0, 61)))
    >>> plane = grid.plane(np.array([1, 2, 0.1, 0.2, 0.3, 0.4]))
    >>> bool(np.allclose(window.fit(plane), plane))
    True
    """

    def __init__(self, axes: tuple[Axis, Axis], sigma: float, counted: Sides) -> None:
        self.axes, self.sigma, self.counted = axes, sigma, counted

    @classmethod
    def over(cls, grid: Grid, sigma: float, counted: Sides) -> RectangularWindow:
        """Return the windows about the points of a grid."""
        axes = Axis(grid.y0, grid.step, grid.rows), Axis(grid.x0, grid.step, grid.columns)
        return cls(axes, sigma, counted)

    def fit(self, maps: Array) -> Array:
        """M U (`UniformWindow.fit`)."""
        nothing = np.empty((0, *maps.shape), maps.dtype)
        return self._step(maps, maps, (1.0, 0.0, 0.0), np.empty(0, maps.dtype), nothing)

    def deconvolved(self, maps: Array, orders: tuple[int, ...]) -> list[Array]:
        """Q maps (`UniformWindow.deconvolved`), by way of points further apart where these are close enough."""
        times = 1
        while 2 * times * self.axes[0].step <= FARTHEST * self.sigma:
            times *= 2
        coarse = self.axes[0].coarser(times), self.axes[1].coarser(times)
        if times == 1 or not any(orders) or min(axis.points for axis in coarse) < 3:
            return super().deconvolved(maps, orders)
        window = RectangularWindow(coarse, self.sigma, self.counted)
        made = window.deconvolved(_resampled(maps, self.axes, coarse), orders)
        return [
            _resampled(part, coarse, self.axes) if n else maps for n, part in zip(orders, made, strict=True)
        ]

    def _recurred(self, here: Array, before: Array, k: int, parts: Array, totals: Array) -> Array:
        return self._step(here, before, _recurrence(k), parts, totals)

    def _step(
        self, maps: Array, before: Array, shares: tuple[float, float, float], parts: Array, totals: Array
    ) -> Array:
        kind, rows = maps.dtype.str, maps.shape[1]
        down, across = (
            taps_of(*axis, counted, self.sigma, kind)
            for axis, counted in zip(self.axes, self.counted, strict=True)
        )
        twist, out, step = np.empty((2, *maps.shape[1:]), maps.dtype), np.empty_like(maps), self.axes[0].step
        how = np.array(shares, maps.dtype), np.ascontiguousarray(parts)
        over_strips(lambda a, b: twist_strip(maps, float(step), a, b, twist), rows, GRID_STRIP)
        over_strips(
            lambda a, b: fit_strip(maps, twist, (down, across), how, before, (a, b), out, totals),
            rows,
            GRID_STRIP,
        )
        return out


def _resampled(maps: Array, axes: tuple[Axis, Axis], wanted: tuple[Axis, Axis]) -> Array:
    """Value and gradient of a blend at the points of other axes."""
    rows, columns = axes
    out = np.empty((6, wanted[0].points, wanted[1].points), maps.dtype)
    twist = np.empty((2, *maps.shape[1:]), maps.dtype)
    target = wanted[1].origin - columns.origin, wanted[0].origin - rows.origin, float(wanted[0].step)
    over_strips(lambda a, b: twist_strip(maps, float(rows.step), a, b, twist), rows.points, GRID_STRIP)
    over_strips(
        lambda a, b: resample_strip(maps, twist, (0, 0, rows.step), target, a, b, out),
        wanted[0].points,
        GRID_STRIP,
    )
    return out


class LatticeWindow(UniformWindow):
    """The window's affine fit of a displacement field, as it would be with a uniform texture.

    The sums run over a lattice of spacing h, the largest divisor of the step that samples the Gaussian
    finely (h ≤ σ/2).

    Parameters
    ----------
    grid : Grid
    sigma : float
        Of the Gaussian weight, px.
    counted : bool array, shape (height, width)
        Pixels that have a partner.

    Examples
    --------
    >>> grid = Grid.over((64, 64), 8)
    >>> window = LatticeWindow(grid, 6.0, np.ones((64, 64), bool))
    >>> plane = grid.plane(np.array([1, 2, 0.1, 0.2, 0.3, 0.4]))
    >>> bool(np.allclose(window.fit(plane), plane))
    True
    """

    def __init__(self, grid: Grid, sigma: float, counted: NDArray[np.bool_]) -> None:
        spacing = max(h for h in range(1, grid.step + 1) if grid.step % h == 0 and (h <= sigma or h == 1))
        first_x, first_y = grid.x0 % spacing, grid.y0 % spacing
        self.grid, self.sigma, self.spacing = grid, sigma, spacing
        self.counted = np.ascontiguousarray(counted[first_y::spacing, first_x::spacing]).astype(np.float64)
        self.place = Grid(
            grid.x0 // spacing, grid.y0 // spacing, grid.step // spacing, grid.columns, grid.rows
        )

    def fit(self, maps: NDArray[Any]) -> NDArray[np.float64]:
        """M U: the affine fits of the blend of `maps`; shape (6, rows, columns).

        A point with too little of its window left for a fit keeps its map.
        """
        h = self.spacing
        lattice = maps.astype(np.float64)
        lattice[2:] *= h  # per lattice spacing
        sums = motion_sums(self.counted, lattice, self.place, self.sigma / h)
        m = np.moveaxis(sums, -1, 0)
        fitted = maps.astype(np.float64)
        # Cramer's rule for the symmetric matrix of (1, X, Y)
        c00, c01, c02 = m[3] * m[5] - m[4] ** 2, m[2] * m[4] - m[1] * m[5], m[1] * m[4] - m[2] * m[3]
        c11, c12, c22 = m[0] * m[5] - m[2] ** 2, m[1] * m[2] - m[0] * m[4], m[0] * m[3] - m[1] ** 2
        determinant = m[0] * c00 + m[1] * c01 + m[2] * c02
        known = determinant > 1e-6 * m[0] * m[3] * m[5]
        with np.errstate(invalid="ignore", divide="ignore"):
            for component in range(2):
                b0, b1, b2 = m[6 + 3 * component : 9 + 3 * component]
                value = (c00 * b0 + c01 * b1 + c02 * b2) / determinant
                slope_x = (c01 * b0 + c11 * b1 + c12 * b2) / determinant / self.sigma
                slope_y = (c02 * b0 + c12 * b1 + c22 * b2) / determinant / self.sigma
                for place, plane in (
                    (component, value),
                    (2 + 2 * component, slope_x),
                    (3 + 2 * component, slope_y),
                ):
                    fitted[place] = np.where(known, plane, fitted[place])
        return fitted


class MaskedWindow(UniformWindow):
    """Windows that a mask cuts here and there: `LatticeWindow` where it does, `RectangularWindow` elsewhere.

    Parameters
    ----------
    grid : Grid
    sigma : float
        Of the Gaussian weight, px.
    counted : bool array, shape (height, width)
        Pixels that have a partner; not without any.
    """

    def __init__(self, grid: Grid, sigma: float, counted: NDArray[np.bool_]) -> None:
        rows, columns = (
            (int(line[0]), int(line[-1]) + 1)
            for line in (np.flatnonzero(counted.any(axis=axis)) for axis in (1, 0))
        )
        self.whole = RectangularWindow.over(grid, sigma, (rows, columns))
        self.cut = _cut(counted, (rows, columns), grid, sigma)
        if not self.cut.any():
            return
        around = math.ceil(CUT * sigma / grid.step) + 2
        self.place = tuple(
            slice(max(0, int(line[0]) - around), int(line[-1]) + around + 1)
            for line in (np.flatnonzero(self.cut.any(axis=axis)) for axis in (1, 0))
        )
        y, x = self.place
        part = Grid(
            grid.x0 + x.start * grid.step, grid.y0 + y.start * grid.step, grid.step,
            min(x.stop, grid.columns) - x.start, min(y.stop, grid.rows) - y.start,
        )  # fmt: skip
        self.lattice = LatticeWindow(part, sigma, counted)

    def fit(self, maps: Array) -> Array:
        """M U (`UniformWindow.fit`)."""
        out = self.whole.fit(maps)
        if self.cut.any():
            y, x = self.place
            fitted = self.lattice.fit(np.ascontiguousarray(maps[:, y, x]))
            out[:, y, x] = np.where(self.cut[y, x], fitted, out[:, y, x])
        return out

    def deconvolved(self, maps: Array, orders: tuple[int, ...]) -> list[Array]:
        """Q maps (`UniformWindow.deconvolved`)."""
        return super().deconvolved(maps, orders) if self.cut.any() else self.whole.deconvolved(maps, orders)


def _cut(counted: NDArray[np.bool_], sides: Sides, grid: Grid, sigma: float) -> NDArray[np.bool_]:
    """Points whose window holds pixels that do not count, inside the rectangle of those that do."""
    inside = np.zeros(counted.shape, np.bool_)
    inside[sides[0][0] : sides[0][1], sides[1][0] : sides[1][1]] = True
    total = np.zeros((counted.shape[0] + 1, counted.shape[1] + 1), np.int64)
    np.cumsum(np.cumsum(inside & ~counted, axis=0), axis=1, out=total[1:, 1:])
    reach = math.ceil(CUT * sigma)
    (top, bottom), (left, right) = (
        (np.clip(line - reach, 0, size), np.clip(line + reach + 1, 0, size))
        for line, size in zip((grid.y, grid.x), counted.shape, strict=True)
    )
    return np.asarray(
        total[np.ix_(bottom, right)] - total[np.ix_(top, right)] - total[np.ix_(bottom, left)]
        + total[np.ix_(top, left)] > 0
    )  # fmt: skip


def uniform_windows(
    sweep: Sweep, sigmas: tuple[float, ...], maps: Array, light: Array | None, weight: Array | None = None,
    unknown: NDArray[np.bool_] | None = None,
) -> list[UniformWindow]:  # fmt: skip
    """Windows of several sizes, cut as the pixels of a pair cut them that have no partner by a motion.

    Parameters
    ----------
    sweep : Sweep
    sigmas : tuple of float
    maps : array, shape (6, rows, columns)
    light : array or None
        As for `Sweep.images`.
    weight : array, shape (height, width), optional
        Of pixels: where most pixels of a block of `BLOCK` are outlying there is another motion, or none.
    unknown : bool array, shape (rows, columns), optional
        Points about which nothing is known of the motion.
    """
    sides, bent = seen_by(maps, sweep.grid, sweep.shape, 0.5 if sweep.central else 0.0)
    whole = not sweep.masked and weight is None and (unknown is None or not unknown.any())
    if whole and all(bent <= sigma * STRAIGHT for sigma in sigmas):
        return [RectangularWindow.over(sweep.grid, sigma, sides) for sigma in sigmas]
    counted = np.isfinite(sweep.images(maps, light=light).residual)
    if weight is not None:
        counted &= ~_mostly_outlying(weight)
    if unknown is not None and unknown.any():
        counted &= ~_around(unknown, sweep.grid, sweep.shape)
    if not counted.any():
        return [RectangularWindow.over(sweep.grid, sigma, sides) for sigma in sigmas]
    return [
        RectangularWindow.over(sweep.grid, sigma, sides)
        if whole and bent <= sigma * STRAIGHT
        else MaskedWindow(sweep.grid, sigma, counted)
        for sigma in sigmas
    ]


def _around(points: NDArray[np.bool_], grid: Grid, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """The pixels nearest to some points of a grid."""
    row, column = (
        np.clip((np.arange(size) - first + grid.step // 2) // grid.step, 0, count - 1)
        for size, first, count in zip(shape, (grid.y0, grid.x0), points.shape, strict=True)
    )
    return np.asarray(points[np.ix_(row, column)])


def _mostly_outlying(weight: Array) -> NDArray[np.bool_]:
    """Blocks of pixels of which less than half counts."""
    height, width = weight.shape
    rows, columns = -(-height // BLOCK), -(-width // BLOCK)
    padded = np.pad(weight, ((0, rows * BLOCK - height), (0, columns * BLOCK - width)), mode="edge")
    lost = padded.reshape(rows, BLOCK, columns, BLOCK).mean(axis=(1, 3)) < 0.5
    return lost.repeat(BLOCK, axis=0).repeat(BLOCK, axis=1)[:height, :width]


def seen_by(maps: Array, grid: Grid, shape: tuple[int, int], share: float) -> tuple[Sides, float]:
    """Rows and columns of the pixels that have a partner, where a frame's rim alone takes it from them.

    Parameters
    ----------
    maps : array, shape (6, rows, columns)
    grid : Grid
    shape : (int, int)
        Of the frames, px.
    share : float
        Of the way at which the points lie; seen from the middle both frames have to hold a pixel's partner.

    Returns
    -------
    sides : ((int, int), (int, int))
        First and last (exclusive) row and column.
    bent : float
        How far the region's outline lies from these at most, px.
    """
    found, bent = [], 0.0
    for component, axis in ((1, 0), (0, 1)):
        size, place = shape[axis], (grid.y, grid.x)[axis]
        ends = []
        for end, border in ((0, 0), (-1, size - 1)):
            line = np.take(maps, end, axis=axis + 1)
            away = line[component] + (border - place[end]) * line[2 + 2 * component + 1 - axis]
            out = np.maximum((1 - share) * away, -share * away)  # in the moved frame, in the reference
            if not end:
                out = np.maximum(-(1 - share) * away, share * away)
            beyond = np.maximum(out, 0.0)
            middle = float(np.median(beyond))
            bent = max(bent, float(np.abs(beyond - middle).max()))
            ends.append(math.ceil(middle - 1e-6))
        found.append((min(ends[0], size - 1), max(size - ends[1], 1)))
    return (found[0], found[1]), bent
