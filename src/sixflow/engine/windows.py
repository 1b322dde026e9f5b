"""Windows: Gaussian sums about the points of a grid, from node moments (`moments`).

With the weight G at a node, of variance σ_c², a pixel has the weight Σ_n G(n) hat((x − n)/b), the linear interpolant of
the Gaussian between the nodes, of variance

    σ² = σ_c² + (b² − 1)/6,

(b² − 1)/6 that of the hat on whole pixels. It differs from the Gaussian of σ by less than 0.09 of that, root mean
square in the plane, for b ≤ σ; with the same noise, results differ by that many of their standard errors. The second
moments of the hats are in the node moments themselves: a moment is translated from the node to the grid point, exactly,

    Σ p (X + d)^a … = Σ_k (a over k) d^k Σ p X^(a−k) …,    d = (node − point)/b.

The sandwich is summed under w², a Gaussian of σ/√2 times 1/(2√π σ) along each axis.

The window is separable. First along y, for the rows of the grid: Σ over node rows with the weights w, w d, w d², each
over the planes that a translation needs it for, which are contiguous. Then along x: nodes per grid column repeat after
the least common multiple of b and the step; nodes of one place in it are brought side by side, and the same code
serves.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.compiler import inner, kernel
from sixflow.engine.lines import add_taps, fill_line
from sixflow.engine.moments import plane_at
from sixflow.engine.window import CUT


class Down(NamedTuple):
    """Taps along y: for every grid row its first node row, and the weights w d^k from there, shape (rows, 3, taps)."""

    first: NDArray[np.int64]
    weights: NDArray[Any]


class Across(NamedTuple):
    """Taps along x, by the phase of a grid column.

    Attributes
    ----------
    weights : array, shape (phases, 3, taps)
    first : int array, shape (phases,)
        First node of the first column of each phase.
    stride : int
        Nodes between neighbouring columns of one phase.
    """

    weights: NDArray[Any]
    first: NDArray[np.int64]
    stride: int


class Layout(NamedTuple):
    """Where the planes of moments go: `ranks` as in `moments.Cells`; `place` and `scale`, shape (planes,)."""

    ranks: tuple[int, int, int]
    place: NDArray[np.int64]
    scale: NDArray[Any]


def _weights(fraction: NDArray[Any], spacing: float, sigma: float, power: int) -> tuple[int, NDArray[Any]]:
    """Weights w^power d^k at the nodes before … after a point, which lies `fraction` spacings after node 0.

    Returns
    -------
    before : int
        Node that the first weight belongs to.
    weights : array, shape (points, 3, taps)
        0 at nodes further than `CUT` σ and half a spacing: every pixel within `CUT` σ has its nearest node.
    """
    width = sigma / math.sqrt(power)
    variance = width**2 - (spacing**2 - 1) / 6
    reach = CUT * width / spacing + 0.5
    nodes = np.arange(math.floor(-reach), math.ceil(reach + 1) + 1)
    d = nodes - fraction[:, None]
    w = np.exp(-((d * spacing) ** 2) / (2 * variance)) / math.sqrt(2 * math.pi * variance)
    w = np.where(np.abs(d) <= reach, w, 0.0) * (2 * math.sqrt(math.pi) * sigma) ** (1 - power)
    used = np.flatnonzero(w.any(axis=0))
    kept = slice(int(used[0]), int(used[-1]) + 1)
    return int(nodes[kept.start]), np.stack([w * d**k for k in range(3)], axis=1)[..., kept]


@lru_cache(maxsize=64)
def taps_down(start: int, step: int, count: int, spacing: int, sigma: float, power: int, dtype: str) -> Down:
    """Taps of a grid axis whose first point lies `start` px after the first node."""
    place = start + step * np.arange(count)
    node, rest = np.divmod(place, spacing)
    before, weights = _weights(rest / spacing, spacing, sigma, power)
    return Down((node + before).astype(np.int64), weights.astype(dtype))


@lru_cache(maxsize=64)
def taps_across(start: int, step: int, spacing: int, sigma: float, power: int, dtype: str) -> Across:
    """Taps of one period of a grid axis whose first point lies `start` px after the first node."""
    period = math.lcm(step, spacing)
    down = taps_down(start, step, period // step, spacing, sigma, power, dtype)
    return Across(down.weights, down.first, period // spacing)


@inner
def _add_range(source: NDArray[Any], start: int, out: NDArray[Any], place: int, n: int, twice: bool) -> None:
    f, s = source[start : start + n], out[place : place + n]
    for x in range(n):
        s[x] += f[x]
    if twice:
        for x in range(n):
            s[x] += f[x]


@inner
def _raise(sums: NDArray[Any], ranks: tuple[int, int, int], nodes: int, axis: int) -> None:
    """Finish a translation along x (axis 0) or y (axis 1): add the parts with d and d² to the higher moments.

    `sums` holds the planes, of `nodes` each, under w, w d and w d².
    """
    two, one, _ = ranks
    n2, n1 = two * nodes, one * nodes
    x, y = 1 - axis, axis
    first, other = plane_at(ranks, 2, x, y) * nodes, plane_at(ranks, 2, y, x) * nodes
    square, mixed = plane_at(ranks, 2, 2 * x, 2 * y) * nodes, plane_at(ranks, 2, 1, 1) * nodes
    _add_range(sums[1], 0, sums[0], first, n2, False)
    _add_range(sums[1], n2, sums[0], plane_at(ranks, 1, x, y) * nodes, n1, False)
    _add_range(sums[1], other, sums[0], mixed, n2, False)
    _add_range(sums[1], first, sums[0], square, n2, True)
    _add_range(sums[2], 0, sums[0], square, n2, False)


@inner
def _raised(ranks: tuple[int, int, int], power: int) -> int:
    """How many planes, from the first, a translation raises by a power; for power 0 all."""
    if power == 0:
        return 6 * ranks[0] + 3 * ranks[1] + ranks[2]
    return 3 * ranks[0] + ranks[1] if power == 1 else ranks[0]


@inner
def _gather(line: NDArray[Any], planes: int, stride: int, before: int, out: NDArray[Any]) -> None:
    """out[r, p, m] = plane p of node stride·(m − before) + r, 0 beyond the nodes."""
    nodes = line.size // planes
    for r in range(stride):
        for p in range(planes):
            source, target = line[p * nodes : (p + 1) * nodes], out[r, p]
            for m in range(target.size):
                node = stride * (m - before) + r
                target[m] = source[node] if 0 <= node < nodes else 0


@kernel
def window_strip(
    moments: NDArray[Any],
    layout: Layout,
    down: Down,
    across: Across,
    start: int,
    stop: int,
    out: NDArray[Any],
) -> None:
    """Window sums of the grid rows start … stop.

    Parameters
    ----------
    moments : array, shape (node rows, planes, node columns)
    layout : Layout
    down, across : Down, Across
    out : array, shape (grid rows, grid columns, planes)
    """
    node_rows, planes, nodes = moments.shape
    columns, phases, stride, taps = out.shape[1], across.first.size, across.stride, across.weights.shape[2]
    ranks, size, source = layout.ranks, planes * nodes, moments.reshape(-1)
    low, high = across.first[0], across.first[0]
    for first in across.first:
        low, high = min(low, first), max(high, first)
    low, high = low // stride, (high + taps - 1) // stride
    before = max(0, -low)
    width = (columns - 1) // phases + 1 + before + max(0, high)
    kind = moments.dtype
    sums, lines = np.empty((3, size), kind), np.empty((3, planes * width), kind)
    gathered = np.empty((stride, planes, width), kind)
    offsets = np.empty(max(taps, down.weights.shape[2]), np.int64)
    flat = gathered.reshape(-1)
    for j in range(start, stop):
        first = down.first[j]
        above, below = max(0, -first), min(down.weights.shape[2], node_rows - first)
        for t in range(above, below):
            offsets[t] = (first + t) * size
        for k in range(3):
            n = _raised(ranks, k) * nodes
            fill_line(sums[k], 0, n, 0.0)
            add_taps(source, offsets[above:below], down.weights[j, k][above:below], sums[k], n)
        _raise(sums, ranks, nodes, 1)
        _gather(sums[0], planes, stride, before, gathered)
        for phase in range(phases):
            count = (columns - 1 - phase) // phases + 1
            for t in range(taps):
                node = across.first[phase] + t
                offsets[t] = (node % stride) * planes * width + node // stride + before
            for k in range(3):
                n = (_raised(ranks, k) - 1) * width + count
                if n > 0:
                    fill_line(lines[k], 0, n, 0.0)
                    add_taps(flat, offsets[:taps], across.weights[phase, k], lines[k], n)
            _raise(lines, ranks, width, 0)
            for p in range(planes):
                line, place, scale = lines[0][p * width :], layout.place[p], layout.scale[p]
                for i in range(count):
                    out[j, phase + i * phases, place] = scale * line[i]
