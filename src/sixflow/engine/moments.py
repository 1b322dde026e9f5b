"""Node moments: sums of products of image rows about the nodes of a lattice, which add.

Nodes stand on a lattice of spacing b that covers the frame. Every pixel is shared between its two nearest nodes along
each axis by the hat function hat(t) = 1 − |t|, t its distance over b (linear B-splines), and at every node the
moments of a product p are

    Σ_x hat(X) hat(Y) X^a Y^c p(x),    (X, Y) = (x − node)/b,    a + c ≤ the product's order.

A hat is the sum of hats of half the width, hat_2b = ½ hat_b(−b) + hat_b(0) + ½ hat_b(+b): moments merge exactly into
those of a lattice of twice the spacing. Windows are made of them in `windows`.

The way: between two rows of nodes lies a row of cells, b pixel rows. For a pixel t rows below the upper nodes, with
τ = t/b, Y = τ at the upper nodes and τ − 1 at the lower ones, so that their shares are polynomials in τ,

    upper (1 − τ) τ^c,    lower τ (τ − 1)^c:

sums of τ^k p down the columns, k up to one more than the order, give both. The same then along x.

| symbol | name |
|---|---|
| b | `spacing` |
| products | `recipe`: pairs of lines, those of order 2 first, then order 1, then order 0; `ranks` counts each |
| Σ τ^k σ^a p of each cell | `sums` |

Planes of moments are in an order by which a translation works on whole ranges (`plane_at`): all that a translation
raises by two powers of X or Y, then by one, stand first.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.compiler import inner, kernel
from sixflow.engine.lines import add_taps, copy_line, fill_line

TILE = 4096
"""Pixels whose products are held at a time: 16 kB in single precision, which stay in the first cache."""

POWERS = 4
"""Powers 0 … 3: up to one more than the highest order."""


class Cells(NamedTuple):
    """What is summed, and in which cells.

    Attributes
    ----------
    spacing : int
        b, px.
    recipe : int array, shape (products, 2)
        Lines whose product is summed.
    ranks : (int, int, int)
        How many products have moments up to order 2, order 1 and order 0; they stand in this order.
    powers : array, shape (4, b)
        (t/b)^k.
    """

    spacing: int
    recipe: NDArray[np.int64]
    ranks: tuple[int, int, int]
    powers: NDArray[Any]


class Part(NamedTuple):
    """Which part of the frame is summed.

    Attributes
    ----------
    origin : (int, int)
        x and y of the first node, at most 0.
    rows : (int, int)
        First and last (exclusive) row of the frame that counts; the images begin with the first.
    cells : (int, int)
        First and last (exclusive) row of cells.
    """

    origin: tuple[int, int]
    rows: tuple[int, int]
    cells: tuple[int, int]


class Scratch(NamedTuple):
    """Work space of one strip."""

    products: NDArray[Any]
    columns: NDArray[Any]
    phases: NDArray[Any]
    sums: NDArray[Any]
    shares: NDArray[Any]
    offsets: NDArray[np.int64]


def cells_of(
    spacing: int, recipe: tuple[tuple[int, int], ...], ranks: tuple[int, int, int], dtype: Any
) -> Cells:
    """Return the cells of a recipe for images of a type."""
    powers = (np.arange(spacing) / spacing) ** np.arange(POWERS)[:, None]
    return Cells(spacing, np.array(recipe, np.int64), ranks, powers.astype(dtype))


@kernel
def plane_count(ranks: tuple[int, int, int]) -> int:
    """How many planes of moments the products have: 6, 3 and 1 for orders 2, 1 and 0."""
    return 6 * ranks[0] + 3 * ranks[1] + ranks[2]


@kernel
def plane_at(ranks: tuple[int, int, int], order: int, along_x: int, along_y: int) -> int:
    """First plane of the moments X^along_x Y^along_y of the products of an order.

    1 of order 2, 1 of order 1, X and Y of order 2 (these are raised by a translation), X and Y of order 1, X², XY, Y²,
    and the products of order 0.
    """
    two, one, _ = ranks
    if order == 0:
        return 6 * two + 3 * one
    power = along_x + along_y
    if order == 1:
        return two if power == 0 else 3 * two + one + along_y * one
    if power == 0:
        return 0
    if power == 1:
        return two + one + along_y * two
    return 3 * two + 3 * one + along_y * two


@inner
def scratch_of(cells: Cells, count: int) -> Scratch:
    """Work space for rows of so many cells."""
    b, kind = cells.spacing, cells.powers.dtype
    tile = max(1, TILE // (b * b))
    most = max(cells.ranks[0], max(cells.ranks[1], cells.ranks[2])) * (count + 1)
    return Scratch(
        np.empty(b * b * tile, kind),
        np.empty((POWERS, b * tile), kind),
        np.empty(b * tile, kind),
        np.zeros((POWERS * POWERS, most), kind),
        np.empty((POWERS, most), kind),
        np.empty(b, np.int64),
    )


@inner
def _sum_product(
    lines: NDArray[Any], pair: NDArray[Any], rows: tuple[int, int], cells: Cells, order: int, place: int,
    scratch: Scratch,
) -> None:  # fmt: skip
    """Σ τ^k σ^a p over every cell of a row of cells into scratch.sums[4k + a, place …], a + k ≤ order + 1."""
    b, powers, offsets = cells.spacing, cells.powers, scratch.offsets
    first, last = rows
    count = lines.shape[2] // b
    tile = max(1, TILE // (b * b))
    for start in range(0, count, tile):
        n = min(tile, count - start)
        low, width = start * b, n * b
        for t in range(first, last):
            f, g = lines[pair[0], t][low : low + width], lines[pair[1], t][low : low + width]
            target = scratch.products[t * width : (t + 1) * width]
            for x in range(width):
                target[x] = f[x] * g[x]
            offsets[t] = t * width
        for k in range(order + 2):
            fill_line(scratch.columns[k], 0, width, 0.0)
            weights = powers[k][first:last]
            add_taps(scratch.products, offsets[first:last], weights, scratch.columns[k], width)
        for s in range(b):
            offsets[s] = s * n
        for k in range(order + 2):
            line = scratch.columns[k]
            for s in range(b):  # pixels of one place in the cells side by side
                target, x = scratch.phases[s * n : (s + 1) * n], s
                for i in range(n):
                    target[i] = line[x]
                    x += b
            for a in range(order + 2 - max(k - 1, 0)):
                total = scratch.sums[POWERS * k + a][place + start : place + start + n]
                fill_line(total, 0, n, 0.0)
                add_taps(scratch.phases, offsets[:b], powers[a], total, n)


@inner
def _share(
    sums: NDArray[Any], first: int, stride: int, side: int, power: int, out: NDArray[Any], n: int
) -> None:
    """Add what the node before (side 0) or after (side 1) a cell gets of a moment of a power.

    Row first + k·stride of `sums` holds Σ τ^k p. Before: (1 − τ) τ^power; after: τ (τ − 1)^power.
    """
    s = out[:n]
    if side == 0:
        f, g = sums[first + power * stride][:n], sums[first + (power + 1) * stride][:n]
        for x in range(n):
            s[x] += f[x] - g[x]
        return
    f1 = sums[first + stride][:n]
    if power == 0:
        for x in range(n):
            s[x] += f1[x]
        return
    f2 = sums[first + 2 * stride][:n]
    if power == 1:
        for x in range(n):
            s[x] += f2[x] - f1[x]
        return
    f3 = sums[first + 3 * stride][:n]
    for x in range(n):
        s[x] += (f3[x] - f2[x]) - (f2[x] - f1[x])


@inner
def add_cell_row(
    lines: NDArray[Any], rows: tuple[int, int], cells: Cells, scratch: Scratch, above: NDArray[Any],
    below: NDArray[Any],
) -> None:  # fmt: skip
    """Add one row of cells to the moments of the nodes above and below it.

    Parameters
    ----------
    lines : array, shape (lines, b, cells · b)
        Images of the row of cells; 0 in columns beyond the frame.
    rows : (int, int)
        First and last (exclusive) of the b rows that count.
    cells : Cells
    scratch : Scratch
    above, below : arrays, shape (planes · nodes,)
        Nodes are one more than cells.
    """
    nodes = lines.shape[2] // cells.spacing + 1
    product = 0
    for order in range(2, -1, -1):
        members = cells.ranks[2 - order]
        for member in range(members):
            _sum_product(lines, cells.recipe[product], rows, cells, order, member * nodes, scratch)
            product += 1
        n = (
            members * nodes
        )  # all products of an order side by side: the column of nodes after the last cell is 0
        for side in range(2 if n else 0):
            node_row = above if side == 0 else below
            for power in range(order + 1):
                left = order - power
                for a in range(left + 2):
                    fill_line(scratch.shares[a], 0, n, 0.0)
                    _share(scratch.sums, a, POWERS, side, power, scratch.shares[a], n)
                for a in range(left + 1):
                    place = plane_at(cells.ranks, order, a, power) * nodes
                    _share(scratch.shares, 0, 1, 0, a, node_row[place : place + n], n)
                    _share(scratch.shares, 0, 1, 1, a, node_row[place + 1 : place + n], n - 1)


@kernel
def product_strip(
    images: NDArray[Any], cells: Cells, part: Part, sums: NDArray[Any], edge: NDArray[Any]
) -> None:
    """Sum products of images into node moments.

    Parameters
    ----------
    images : array, shape (images, rows of the part, width)
        Line k of the recipe is image k.
    cells : Cells
    part : Part
    sums : array, shape (node rows, planes · nodes)
        Added to, in the node rows of the part but the last.
    edge : array, shape (planes · nodes,)
        Receives the part's share of its last node row, which it has in common with the part below.
    """
    b, left, width = cells.spacing, -part.origin[0], images.shape[2]
    count = edge.size // plane_count(cells.ranks) - 1
    lines, scratch = np.zeros((len(images), b, count * b), images.dtype), scratch_of(cells, count)
    for cell in range(part.cells[0], part.cells[1]):
        top = part.origin[1] + cell * b
        first, last = max(part.rows[0], top), min(part.rows[1], top + b)
        if first >= last:
            continue
        for y in range(first, last):
            for k in range(len(images)):
                copy_line(images[k, y - part.rows[0]], lines[k, y - top][left : left + width], width)
        below = sums[cell + 1] if cell + 1 < part.cells[1] else edge
        add_cell_row(lines, (first - top, last - top), cells, scratch, sums[cell], below)
