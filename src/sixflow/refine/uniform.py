"""Uniform: what a window's affine fit makes of a motion where the texture is uniform, M, and what undoes it, Q.

Both work on the maps of a grid (`sixflow.refine.sharpen` says what for). Where the pixels that count fill a rectangle,
M is a product of one-dimensional sums (`sixflow.engine.fit`); windows that are cut otherwise are those of `cut`.
"""

from __future__ import annotations

import abc
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.blend import resample_strip
from sixflow.engine.fit import fit_strip, taps_of, twist_strip
from sixflow.engine.response import quotient
from sixflow.engine.threads import over_strips
from sixflow.maps.grid import Grid

GRID_STRIP = 16
FARTHEST = 1.31
"""Points of a grid over σ, at most: a cubic interpolant misses (kh)⁴/384 of a wave. Of the wave that a window sharpened
twice attenuates by a tenth, kσ = 1.117, this is an eighth of that."""
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
