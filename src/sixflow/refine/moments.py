"""Moments of a sweep at the nodes of a lattice: a value, which adds over parts of a frame and over pairs.

The nodes stand b px apart, b the largest power of two that is no larger than the window's σ, so that hats about them
make up a Gaussian (`sixflow.engine.windows`), and so that lattices of several windows merge into each other. A point of
the grid is a node, where that can be. X and Y are counted from each node in units of b.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.merge import lower_planes, merge_strip
from sixflow.engine.moments import Part, plane_count
from sixflow.engine.sweep import NORMAL_RANKS, POWER_RANKS, SANDWICH_RANKS
from sixflow.engine.threads import over_strips
from sixflow.errors import InputError
from sixflow.maps.grid import Grid

Ranks = tuple[int, int, int]
STRIP = 64
"""Pixel rows of a strip, at least: what a strip needs of its neighbours' rows is then a small part."""


MERGED_STRIP = 16


def node_spacing(sigma: float) -> int:
    """Largest power of two that is no larger than σ, at least 1.

    Examples
    --------
    >>> node_spacing(8.7), node_spacing(1.4)
    (8, 1)
    """
    spacing = 1
    while 2 * spacing <= sigma:
        spacing *= 2
    return spacing


@dataclasses.dataclass(frozen=True)
class Lattice:
    """Nodes at columns x0 + i·spacing and rows y0 + j·spacing, which cover a frame: px, x0 and y0 at most 0.

    Examples
    --------
    >>> Lattice.over((64, 48), Grid.over((64, 48), 8), 8)
    Lattice(x0=-5, y0=-5, spacing=8, columns=8, rows=10)
    """

    x0: int
    y0: int
    spacing: int
    columns: int
    rows: int

    @classmethod
    def over(cls, shape: tuple[int, int], grid: Grid, spacing: int) -> Lattice:
        """Return the nodes that cover a frame (height, width); the first point of the grid is one of them."""
        y0, x0 = (-(-origin % spacing) for origin in (grid.y0, grid.x0))
        rows, columns = (
            (size - 1 - first) // spacing + 2 for size, first in zip(shape, (y0, x0), strict=True)
        )
        return cls(x0, y0, spacing, columns, rows)

    def part(self, cells: tuple[int, int], rows: tuple[int, int]) -> Part:
        """Rows of cells first … last (exclusive), of which the pixel rows `rows`, at most, count."""
        top, bottom = (self.y0 + self.spacing * cell for cell in cells)
        return Part((self.x0, self.y0), (max(rows[0], top), min(rows[1], bottom)), cells)

    def coarser(self) -> Lattice:
        """Every second node, from the first on."""
        rows, columns = (size // 2 + 1 for size in (self.rows, self.columns))
        return Lattice(self.x0, self.y0, 2 * self.spacing, columns, rows)


@dataclasses.dataclass(frozen=True)
class Moments:
    """What a sweep has summed about every node, weighted by hats.

    Attributes
    ----------
    lattice : Lattice
    normal : array, shape (node rows, 24, node columns)
        g_x², g_x g_y, g_y² with 1, X, Y, X², XY, Y²; g_x q, g_y q with 1, X, Y; in the order of
        `sixflow.engine.moments.plane_at`.
    statistics : array, shape (node rows, 5 or 8, node columns)
        1, |r|, r², I₀, I₀² and, where they are asked for, I₁, I₁², I₀I₁ over the pixels that have a partner. I₁ is the
        warped frame before its light is corrected.
    sandwich : array, shape (node rows, 18, node columns), or None
        r²g_x², r²g_x g_y, r²g_y² with 1, X, Y, X², XY, Y². Or 2 planes, r²g_x² and r²g_y² alone.
    """

    lattice: Lattice
    normal: NDArray[Any]
    statistics: NDArray[Any]
    sandwich: NDArray[Any] | None = None

    def __add__(self, other: Moments) -> Moments:
        """Moments of two parts of a frame, or of two pairs.

        Raises
        ------
        InputError
            If their nodes are not the same, or one has a sandwich, or statistics of both frames, and the other has not.
        """
        if not isinstance(other, Moments):
            return NotImplemented
        if self.lattice != other.lattice:
            raise InputError(
                f"moments about {other.lattice} cannot be added to those about {self.lattice}: use one grid"
            )
        if (self.sandwich is None) != (other.sandwich is None):
            raise InputError(
                "moments with a sandwich cannot be added to those without: sum it in both, or in neither"
            )
        if self.statistics.shape != other.statistics.shape:
            raise InputError("moments with statistics of one frame and of both cannot be added: sum one kind")
        sandwich = None if self.sandwich is None or other.sandwich is None else self.sandwich + other.sandwich
        return Moments(self.lattice, self.normal + other.normal, self.statistics + other.statistics, sandwich)

    def coarser(self) -> Moments:
        """Moments about every second node, under hats of twice the width: exactly what a sweep would sum."""
        sandwich = None if self.sandwich is None else _merged(self.sandwich, sandwich_ranks(self.sandwich))
        normal = _merged(self.normal, NORMAL_RANKS)
        statistics = _merged(self.statistics, (0, 0, self.statistics.shape[1]))
        return Moments(self.lattice.coarser(), normal, statistics, sandwich)


def sandwich_ranks(planes: NDArray[Any]) -> Ranks:
    """Ranks of a sandwich, whole or of the gradients' power alone."""
    return SANDWICH_RANKS if planes.shape[1] == plane_count(SANDWICH_RANKS) else POWER_RANKS


def _merged(planes: NDArray[Any], ranks: Ranks) -> NDArray[Any]:
    """Merge moments of products along y, then along x."""
    rows, count, nodes = planes.shape
    out = np.empty((rows // 2 + 1, count, nodes // 2 + 1), planes.dtype)
    lower = lower_planes(ranks)
    over_strips(lambda a, b: merge_strip(planes, lower, a, b, out), len(out), MERGED_STRIP)
    return out


def summed(
    lattice: Lattice, ranks: tuple[Ranks, ...], dtype: Any,
    task: Callable[[tuple[int, int], list[NDArray[Any]], list[NDArray[Any]]], None],
) -> list[NDArray[Any]]:  # fmt: skip
    """Sum moments in strips of rows of cells, on all processors; the sums do not depend on how many there are.

    Parameters
    ----------
    lattice : Lattice
    ranks : tuple of (int, int, int)
        For each array of planes (`sixflow.engine.moments.Cells`).
    dtype : dtype
    task : callable
        Called with the first and last (exclusive) row of cells of a strip, arrays of shape (node rows, planes · nodes)
        to add to, and lines of shape (planes · nodes,) for the node row that the strip shares with the next.

    Returns
    -------
    list of arrays, shape (node rows, planes, node columns)
    """
    cells, height = lattice.rows - 1, max(1, STRIP // lattice.spacing)
    sizes = [plane_count(each) * lattice.columns for each in ranks]
    sums = [np.zeros((lattice.rows, size), dtype) for size in sizes]
    edges = [np.zeros((-(-cells // height), size), dtype) for size in sizes]

    def sum_strip(start: int, stop: int) -> None:
        task((start, stop), sums, [edge[start // height] for edge in edges])

    over_strips(sum_strip, cells, height)
    for total, edge in zip(sums, edges, strict=True):
        for strip, line in enumerate(edge):  # the shares of two strips are all that such a row has
            total[min((strip + 1) * height, cells)] += line
    return [total.reshape(lattice.rows, -1, lattice.columns) for total in sums]
