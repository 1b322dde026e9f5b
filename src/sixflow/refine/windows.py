"""Window sums at the points of a grid, from the moments of a sweep or from images (`sixflow.engine.windows`)."""

from __future__ import annotations

import dataclasses
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.blend import blend_strip, twist_of
from sixflow.engine.moments import cells_of, plane_at, plane_count, product_strip
from sixflow.engine.sweep import NORMAL_RANKS, SANDWICH_RANKS
from sixflow.engine.threads import over_strips
from sixflow.engine.windows import Layout, taps_across, taps_down, window_strip
from sixflow.maps.grid import Grid
from sixflow.refine.moments import Lattice, Moments, Ranks, node_spacing, sandwich_ranks, summed

GRID_STRIP = 16


@dataclasses.dataclass(frozen=True)
class WindowSums:
    """Sums under the window of every grid point; X and Y in units of σ from the point.

    Attributes
    ----------
    normal : array, shape (rows, columns, 24)
        Of g_x², g_x g_y, g_y² times 1, X, Y, X², XY, Y²; of g_x q, g_y q times 1, X, Y.
    statistics : array, shape (rows, columns, 5 or 8)
        Of 1, |r|, r², I₀, I₀², I₁, I₁², I₀I₁ over the pixels that have a partner; without I₁ the first five.
    sandwich : array, shape (rows, columns, 18), or None
        Of r²g_x², r²g_x g_y, r²g_y² times 1, X, Y, X², XY, Y², under the square of the window. Or of r²g_x² and r²g_y²
        under the window itself, shape (rows, columns, 2).
    """

    normal: NDArray[Any]
    statistics: NDArray[Any]
    sandwich: NDArray[Any] | None


def window_sums(moments: Moments, grid: Grid, sigma: float) -> WindowSums:
    """Sum the moments under a Gaussian window about every point of a grid.

    Parameters
    ----------
    moments : Moments
        About nodes that are no further apart than σ: `Moments.coarser` for a larger window.
    grid : Grid
    sigma : float
        Of the Gaussian, px; ∫w = 1.
    """
    planes, lattice = moments, moments.lattice
    statistics = 0, 0, planes.statistics.shape[1]
    sandwich = None
    if planes.sandwich is not None:
        ranks = sandwich_ranks(planes.sandwich)
        power = 2 if ranks == SANDWICH_RANKS else 1
        sandwich = sums_of(planes.sandwich, ranks, lattice, grid, sigma, power=power)
    return WindowSums(
        sums_of(planes.normal, NORMAL_RANKS, lattice, grid, sigma),
        sums_of(planes.statistics, statistics, lattice, grid, sigma),
        sandwich,
    )


def squared_window_sums(moments: Moments, grid: Grid, sigma: float) -> NDArray[Any]:
    """Sums of `Moments.normal` under the square of the window; shape (rows, columns, 24).

    The first 18 are the sandwich of a residual that is 1 everywhere.
    """
    return sums_of(moments.normal, NORMAL_RANKS, moments.lattice, grid, sigma, power=2)


def window_means(images: tuple[NDArray[Any], ...], grid: Grid, sigma: float) -> NDArray[np.float64]:
    """Means of images without NaN under the window of every grid point; shape (images, rows, columns)."""
    sums = image_sums(images, grid, sigma)
    return sums[1:] / sums[0]


def image_sums(images: tuple[NDArray[Any], ...], grid: Grid, sigma: float) -> NDArray[np.float64]:
    """Window sums of 1 and of images without NaN; shape (1 + images, rows, columns).

    Parameters
    ----------
    images : tuple of arrays, shape (height, width)
    grid : Grid
    sigma : float
        Of the Gaussian, px.
    """
    shape, dtype = images[0].shape, images[0].dtype
    lattice = Lattice.over(shape, grid, node_spacing(sigma))
    recipe = ((0, 0), *((0, k + 1) for k in range(len(images))))
    ranks = 0, 0, len(recipe)
    cells = cells_of(lattice.spacing, recipe, ranks, dtype)

    def task(strip: tuple[int, int], sums: list[NDArray[Any]], edges: list[NDArray[Any]]) -> None:
        part = lattice.part(strip, (0, shape[0]))
        top, bottom = part.rows
        stack = np.ones((len(recipe), bottom - top, shape[1]), dtype)
        for k, image in enumerate(images):
            stack[k + 1] = image[top:bottom]
        product_strip(stack, cells, part, sums[0], edges[0])

    (planes,) = summed(lattice, (ranks,), dtype, task)
    return np.moveaxis(sums_of(planes, ranks, lattice, grid, sigma), -1, 0).astype(np.float64)


def motion_sums(
    valid: NDArray[Any], maps: NDArray[np.float64], grid: Grid, sigma: float
) -> NDArray[np.float64]:
    """Window sums of 1 (six moments), u and v (1, X, Y) of a blended motion where `valid` is 1; (rows, columns, 12).

    Parameters
    ----------
    valid : float64 array, shape (height, width)
        1 or 0.
    maps : array, shape (6, rows, columns)
        Local affine maps at the points of the grid.
    grid : Grid
        In pixels of `valid`.
    sigma : float
    """
    lattice, ranks = Lattice.over(valid.shape, grid, node_spacing(sigma)), (1, 2, 0)
    cells = cells_of(lattice.spacing, ((0, 0), (0, 1), (0, 2)), ranks, valid.dtype)
    twist, (x0, y0, step) = twist_of(maps, grid.step), grid.origin_and_step

    def task(strip: tuple[int, int], sums: list[NDArray[Any]], edges: list[NDArray[Any]]) -> None:
        part = lattice.part(strip, (0, len(valid)))
        top, bottom = part.rows
        stack = np.empty((3, bottom - top, valid.shape[1]))
        stack[0] = valid[top:bottom]
        blend_strip(maps, twist, x0, y0 - top, step, 0, bottom - top, stack[1], stack[2])
        product_strip(stack, cells, part, sums[0], edges[0])

    (planes,) = summed(lattice, (ranks,), valid.dtype, task)
    return sums_of(planes, ranks, lattice, grid, sigma)


@cache
def _layout(ranks: Ranks, ratio: float, dtype: str) -> Layout:
    """Moments of a product side by side, in units of σ = spacing/ratio."""
    place, scale, first = np.empty(plane_count(ranks), np.int64), np.empty(plane_count(ranks)), 0
    for order, count in zip((2, 1, 0), ranks, strict=True):
        powers = [(total - c, c) for total in range(order + 1) for c in range(total + 1)]
        for k, (a, c) in enumerate(powers):
            planes = plane_at(ranks, order, a, c) + np.arange(count)
            place[planes] = first + k + len(powers) * np.arange(count)
            scale[planes] = ratio ** (a + c)
        first += len(powers) * count
    return Layout(ranks, place, scale.astype(dtype))


def sums_of(
    planes: NDArray[Any], ranks: Ranks, lattice: Lattice, grid: Grid, sigma: float, *, power: int = 1
) -> NDArray[Any]:
    """Sums of planes of moments under w^power about every point; shape (rows, columns, planes), product by product.

    Parameters
    ----------
    planes : array, shape (node rows, planes, node columns)
    ranks : (int, int, int)
        As in `sixflow.engine.moments.Cells`.
    lattice : Lattice
    grid : Grid
    sigma : float
    power : {1, 2}
    """
    dtype, b = planes.dtype.str, lattice.spacing
    down = taps_down(grid.y0 - lattice.y0, grid.step, grid.rows, b, sigma, power, dtype)
    across = taps_across(grid.x0 - lattice.x0, grid.step, b, sigma, power, dtype)
    layout, out = _layout(ranks, b / sigma, dtype), np.empty((*grid.shape, planes.shape[1]), planes.dtype)
    over_strips(
        lambda start, stop: window_strip(planes, layout, down, across, start, stop, out),
        grid.rows,
        GRID_STRIP,
    )
    return out
