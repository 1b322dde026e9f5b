"""Random points without bounds, and sums of Gaussian blobs over them, in compiled code.

The plane is divided into square cells; the points of a cell come from a counter-based generator (SplitMix64)
keyed by (seed, cell), so a point is the same whichever part of the plane is looked at, and there is no frame
that it could depend on. Their number in a cell is Poisson distributed.

Sums of blobs sort the blobs into cells as wide as half their reach and visit only the cells within reach.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sixflow.synth.arguments import Array

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX2 = np.uint64(0x94D049BB133111EB)
_S30, _S27, _S31, _S11 = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(11)


@njit(nogil=True, cache=True)
def _mix(z: np.uint64) -> np.uint64:
    """Finaliser of SplitMix64 (Steele, Lea, Flood 2014)."""
    z = (z ^ (z >> _S30)) * _MIX1
    z = (z ^ (z >> _S27)) * _MIX2
    return z ^ (z >> _S31)


@njit(nogil=True, cache=True)
def _key(seed: np.uint64, i: int, j: int) -> np.uint64:
    h = _mix(seed + _GOLDEN)
    h = _mix((h ^ np.uint64(i)) + _GOLDEN)
    return _mix((h ^ np.uint64(j)) + _GOLDEN)


@njit(nogil=True, cache=True)
def _uniform(key: np.uint64, counter: int) -> float:
    """Uniform number in [0, 1), the counter-th of this key."""
    z = _mix(key + _GOLDEN * np.uint64(counter + 1))
    return np.float64(z >> _S11) * (1.0 / 9007199254740992.0)


@njit(nogil=True, cache=True)
def _count(key: np.uint64, limit: float) -> int:
    """Poisson number with mean −log(limit), by Knuth's product of uniforms."""
    n = 0
    product = _uniform(key, 0)
    while product > limit:
        n += 1
        product *= _uniform(key, n)
    return n


@njit(nogil=True, cache=True)
def scatter(seed: np.uint64, side: float, mean: float, i0: int, i1: int, j0: int, j1: int) -> Array:
    """Points of the cells i0 ≤ i < i1 (columns), j0 ≤ j < j1 (rows), in raster order of the cells.

    Returns an array of shape (n, 4): x, y, and two uniform numbers in [0, 1) for the traits of the point.
    """
    limit = np.exp(-mean)
    total = 0
    for j in range(j0, j1):
        for i in range(i0, i1):
            total += _count(_key(seed, i, j), limit)
    out = np.empty((total, 4))
    k = 0
    for j in range(j0, j1):
        for i in range(i0, i1):
            key = _key(seed, i, j)
            n = _count(key, limit)
            for m in range(n):
                first = n + 1 + 4 * m
                out[k, 0] = (i + _uniform(key, first)) * side
                out[k, 1] = (j + _uniform(key, first + 1)) * side
                out[k, 2] = _uniform(key, first + 2)
                out[k, 3] = _uniform(key, first + 3)
                k += 1
    return out


@njit(nogil=True, cache=True)
def gather(
    x: Array,
    y: Array,
    blobs: Array,
    start: NDArray[np.int64],
    cells: tuple[float, int, int, int],
    drop: float,
    out: Array,
) -> None:
    """Sum of blobs A exp(−r²/(2σ²)) and its two derivatives at points, written to out, shape (3, n).

    `blobs` has columns x, y, A, 1/(2σ²), sorted by cell; `start[c]` is the first blob of cell c. `cells` are the side
    of a cell, column and row of the first one, and their number in a row. A blob ends where −log of its relative value
    exceeds `drop`; no blob reaches further than two cells.
    """
    side, i0, j0, columns = cells
    rows = (start.size - 1) // columns
    for p in range(x.size):
        i = int(np.floor(x[p] / side)) - i0
        j = int(np.floor(y[p] / side)) - j0
        total = 0.0
        total_x = 0.0
        total_y = 0.0
        first, last = max(i - 2, 0), min(i + 3, columns)
        if first < last:
            for row in range(max(j - 2, 0), min(j + 3, rows)):
                for k in range(start[row * columns + first], start[row * columns + last]):
                    dx = x[p] - blobs[k, 0]
                    dy = y[p] - blobs[k, 1]
                    q = (dx * dx + dy * dy) * blobs[k, 3]
                    if q < drop:
                        value = blobs[k, 2] * np.exp(-q)
                        slope = -2.0 * blobs[k, 3] * value
                        total += value
                        total_x += slope * dx
                        total_y += slope * dy
        out[0, p] = total
        out[1, p] = total_x
        out[2, p] = total_y
