"""Uniform: what a window's affine fit makes of a motion where the texture is uniform, M, and what undoes it, Q.

Both work on the maps of a grid (`sixflow.refine.sharpen` says what for). Where the pixels that count fill a rectangle,
M is a product of one-dimensional sums (`sixflow.engine.fit`); where a mask cuts windows in any way it is summed over a
lattice of pixels.
"""

from __future__ import annotations

import abc
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.fit import fit_strip, taps_of, twist_strip
from sixflow.engine.response import quotient
from sixflow.engine.threads import over_strips
from sixflow.maps.grid import Grid
from sixflow.refine.sweep import Sweep
from sixflow.refine.windows import motion_sums

GRID_STRIP = 16
Array = NDArray[Any]


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
        coefficients = [quotient(order) for order in orders]
        before, here = maps, maps
        totals = [part[0] * here for part in coefficients]
        for k in range(1, max(len(part) for part in coefficients)):
            after = self.fit(here)
            after *= 4 if k > 1 else 2
            after -= 2 * here if k > 1 else here
            if k > 1:
                after -= before
            before, here = here, after
            for total, part in zip(totals, coefficients, strict=True):
                if k < len(part):
                    total += part[k] * here
        return totals


class RectangularWindow(UniformWindow):
    """Windows that a rectangle cuts, if anything does.

    Parameters
    ----------
    grid : Grid
    sigma : float
        Of the Gaussian weight, px.
    rows, columns : (int, int)
        First and last (exclusive) of the pixels that count.

    Examples
    --------
    >>> grid = Grid.over((64, 64), 8)
    >>> window = RectangularWindow(grid, 6.0, (0, 64), (0, 61))
    >>> plane = grid.plane(np.array([1, 2, 0.1, 0.2, 0.3, 0.4]))
    >>> bool(np.allclose(window.fit(plane), plane))
    True
    """

    def __init__(self, grid: Grid, sigma: float, rows: tuple[int, int], columns: tuple[int, int]) -> None:
        self.grid = grid
        self._down = grid.y0, grid.step, grid.rows, rows, sigma
        self._across = grid.x0, grid.step, grid.columns, columns, sigma

    def fit(self, maps: Array) -> Array:
        """M U (`UniformWindow.fit`)."""
        kind, step = maps.dtype.str, float(self.grid.step)
        down, across = taps_of(*self._down, kind), taps_of(*self._across, kind)
        twist, out = np.empty((2, *maps.shape[1:]), maps.dtype), np.empty_like(maps)
        rows = self.grid.rows
        over_strips(lambda a, b: twist_strip(maps, step, a, b, twist), rows, GRID_STRIP)
        over_strips(lambda a, b: fit_strip(maps, twist, down, across, a, b, out), rows, GRID_STRIP)
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
        spacing = max(h for h in range(1, grid.step + 1) if grid.step % h == 0 and (h <= sigma / 2 or h == 1))
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


def uniform_windows(
    sweep: Sweep, sigmas: tuple[float, ...], maps: Array, light: Array | None
) -> list[UniformWindow]:
    """Windows of several sizes, cut as the pixels of a pair cut them that have no partner by a motion.

    Parameters
    ----------
    sweep : Sweep
    sigmas : tuple of float
    maps : array, shape (6, rows, columns)
    light : array or None
        As for `Sweep.images`.
    """
    if sweep.masked:
        counted = np.isfinite(sweep.images(maps, light=light).residual)
        return [LatticeWindow(sweep.grid, sigma, counted) for sigma in sigmas]
    rows, columns = seen_by(maps, sweep.grid, sweep.shape, 0.5 if sweep.central else 0.0)
    return [RectangularWindow(sweep.grid, sigma, rows, columns) for sigma in sigmas]


def seen_by(
    maps: Array, grid: Grid, shape: tuple[int, int], share: float
) -> tuple[tuple[int, int], tuple[int, int]]:
    """Rows and columns of the pixels that have a partner, where a frame's rim alone takes it from them.

    Parameters
    ----------
    maps : array, shape (6, rows, columns)
    grid : Grid
    shape : (int, int)
        Of the frames, px.
    share : float
        Of the way at which the points lie; seen from the middle both frames have to hold a pixel's partner.
    """
    found = []
    for component, axis in ((1, 0), (0, 1)):
        size, place = shape[axis], (grid.y, grid.x)[axis]
        ends = []
        for end, border in ((0, 0), (-1, size - 1)):
            line = np.take(maps, end, axis=axis + 1)
            away = np.median(line[component] + (border - place[end]) * line[2 + 2 * component + 1 - axis])
            out = [(1 - share) * away, -share * away]  # in the moved frame, in the reference
            beyond = max(0.0, *out) if end else max(0.0, *(-each for each in out))
            ends.append(math.ceil(beyond - 1e-6) if math.isfinite(beyond) else 0)
        found.append((min(ends[0], size - 1), max(size - ends[1], 1)))
    return found[0], found[1]
