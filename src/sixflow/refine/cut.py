"""Cut: windows as the pixels of a pair cut them that have no partner, or another motion (`uniform`).

A mask cuts them in any way: M is then summed over a lattice of pixels, at the points whose windows hold any that do
not count. So do regions of outlying pixels, and points at which the search knew nothing: the fit does not see what is
there, and M must not read it.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.window import CUT
from sixflow.maps.grid import Grid
from sixflow.refine.sweep import Sweep
from sixflow.refine.uniform import RectangularWindow, Sides, UniformWindow
from sixflow.refine.windows import motion_sums

STRAIGHT = 2.5
"""σ by which the outline of the pixels that count may be bent, and be taken for straight."""
BLOCK = 8
"""px."""

Array = NDArray[Any]


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
