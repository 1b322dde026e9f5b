"""Merge: node moments of a lattice into those of one of twice the spacing, exactly (`moments`).

A hat is the sum of hats of half the width, hat_2b = ½ hat_b(−b) + hat_b(0) + ½ hat_b(+b). So a node of the coarser
lattice takes all of the node at its own place and half of each neighbour, along y and then along x, with moments about
itself:

    X'^a = (X/2 + d)^a = Σ_k (a over k) d^k (X/2)^(a−k),    d = 0, ±½.
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.compiler import inner, kernel
from sixflow.engine.lines import fill_line
from sixflow.engine.moments import plane_at, plane_count

_BINOMIAL = ((1, 0, 0), (1, 1, 0), (1, 2, 1))


class Lower(NamedTuple):
    """For every plane its power of X and of Y, shape (2, planes), and the planes of lower powers, (2, 3, planes)."""

    power: NDArray[np.int64]
    plane: NDArray[np.int64]


@cache
def lower_planes(ranks: tuple[int, int, int]) -> Lower:
    """Which planes a translation makes every plane of."""
    count = plane_count(ranks)
    power, plane = np.zeros((2, count), np.int64), np.zeros((2, 3, count), np.int64)
    plane[:, 0] = np.arange(count)
    for order, members in zip((2, 1), ranks[:2], strict=True):
        for a in range(order + 1):
            for c in range(order + 1 - a):
                here = plane_at(ranks, order, a, c) + np.arange(members)
                power[0, here], power[1, here] = a, c
                for k in range(3):
                    if k <= a:
                        plane[0, k, here] = plane_at(ranks, order, a - k, c) + np.arange(members)
                    if k <= c:
                        plane[1, k, here] = plane_at(ranks, order, a, c - k) + np.arange(members)
    return Lower(power, plane)


@inner
def _add_translated(
    source: NDArray[Any], lower: Lower, axis: int, d: float, weight: float, out: NDArray[Any]
) -> None:
    """Add moments of nodes that lie d from others, in units of these; source and out of shape (planes, nodes)."""
    n, kind = out.shape[1], out.dtype.type
    for p in range(out.shape[0]):
        power, target = lower.power[axis, p], out[p]
        for k in range(power + 1 if d != 0 else 1):
            share = kind(weight * _BINOMIAL[power][k] * d**k * 0.5 ** (power - k))
            f = source[lower.plane[axis, k, p]]
            for x in range(n):
                target[x] += share * f[x]


@kernel
def merge_strip(planes: NDArray[Any], lower: Lower, start: int, stop: int, out: NDArray[Any]) -> None:
    """Merge into the coarser node rows start … stop.

    Parameters
    ----------
    planes : array, shape (node rows, planes, node columns)
    lower : Lower
    out : array, shape (node rows // 2 + 1, planes, node columns // 2 + 1)
    """
    rows, count, nodes = planes.shape
    merged, coarse = np.empty((count, nodes), planes.dtype), out.shape[2]
    even = np.empty((count, coarse), planes.dtype)
    odd, before = np.empty_like(even), np.empty_like(even)
    for j in range(start, stop):
        fill_line(merged.reshape(-1), 0, count * nodes, 0.0)
        for side in range(-1, 2):
            row = 2 * j + side
            if 0 <= row < rows:
                _add_translated(planes[row], lower, 1, side / 2, 1 - abs(side) / 2, merged)
        for p in range(count):
            for i in range(coarse):
                even[p, i] = merged[p, 2 * i] if 2 * i < nodes else 0
                odd[p, i] = merged[p, 2 * i + 1] if 2 * i + 1 < nodes else 0
                before[p, i] = merged[p, 2 * i - 1] if i > 0 and 2 * i - 1 < nodes else 0
        fill_line(out[j].reshape(-1), 0, count * coarse, 0.0)
        _add_translated(even, lower, 0, 0.0, 1.0, out[j])
        _add_translated(odd, lower, 0, 0.5, 0.5, out[j])
        _add_translated(before, lower, 0, -0.5, 0.5, out[j])
