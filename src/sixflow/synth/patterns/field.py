"""Fields of Gaussian blobs over the whole plane: Σ A_i exp(−|x − c_i|²/(2σ_i²)), at any points.

A blob ends where it falls below 1e-10 of its amplitude, at 6.8 σ; that is the only approximation.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.threads import over_strips
from sixflow.errors import InputError
from sixflow.synth.arguments import Array
from sixflow.synth.motions.base import Motion
from sixflow.synth.patterns.base import CHUNK

_DROP = math.log(1e10)
REACH = math.sqrt(2 * _DROP)
"""Distance at which a blob ends, in σ."""

_PER_CELL = 4.0  # mean number of points in a cell of the generator
_MOST_BLOBS = 2e6  # at once; more are summed part by part
_MOST_CELLS = 4e6
_TOO_MANY = 3e7

Box = tuple[float, float, float, float]


def scatter(seed: int, density: float, box: Box) -> Array:
    """Random points of the plane inside (or just outside) a box.

    Raises InputError if the box would hold more than 30 million points.

    Parameters
    ----------
    seed : int
        Any whole number; its lowest 64 bits choose the points.
    density : float
        Mean number of points per px².
    box : (x0, x1, y0, y1)
        px.

    Returns
    -------
    float64 array, shape (n, 4)
        x, y, px, and two uniform numbers in [0, 1) for the traits of each point.
    """
    from sixflow.synth.patterns import _cells

    expected = density * (box[1] - box[0]) * (box[3] - box[2])
    if not expected < _TOO_MANY:
        raise InputError(
            f"density={density:g}: {expected:.3g} points in an area of the plane; use a lower density, or a "
            "motion that shrinks less"
        )
    side = math.sqrt(_PER_CELL / density)
    i0, i1, j0, j1 = (math.floor(edge / side) for edge in box)
    return _cells.scatter(np.uint64(seed & (2**64 - 1)), side, _PER_CELL, i0, i1 + 1, j0, j1 + 1)


def evaluate(
    x: Array, y: Array, density: float, reach: float, blobs_in: Callable[[Box], Array]
) -> tuple[Array, Array, Array]:
    """Value and derivatives of a field of blobs at points, shape (n,) each.

    Parameters
    ----------
    x, y : float64 arrays, shape (n,)
        Points, px.
    density : float
        Mean number of blobs per px², to share out the work.
    reach : float
        Largest distance at which a blob is felt, px.
    blobs_in : callable
        blobs_in(box) → array (m, 4) of x, y, amplitude, 1/(2σ²) of (at least) the blobs centred in the box.
    """
    out = np.zeros((3, x.size))
    if x.size:
        _evaluate(x, y, density, reach, blobs_in, np.arange(x.size), out)
    return out[0], out[1], out[2]


def _evaluate(
    x: Array,
    y: Array,
    density: float,
    reach: float,
    blobs_in: Callable[[Box], Array],
    which: NDArray[np.intp],
    out: Array,
) -> None:
    px, py = x[which], y[which]
    box = (px.min() - reach, px.max() + reach, py.min() - reach, py.max() + reach)
    area = (box[1] - box[0]) * (box[3] - box[2])
    large = area * density > _MOST_BLOBS or area > _MOST_CELLS * (reach / 2) ** 2
    width, height = np.ptp(px), np.ptp(py)
    if large and max(width, height) > 0:
        along = px if width >= height else py
        low = along <= (along.min() + along.max()) / 2
        for part in (which[low], which[~low]):
            _evaluate(x, y, density, reach, blobs_in, part, out)
        return
    out[:, which] = _sum(px, py, reach, blobs_in(box), box)


def _sum(x: Array, y: Array, reach: float, blobs: Array, box: Box) -> Array:
    from sixflow.synth.patterns import _cells

    side = reach / 2
    i0, i1, j0, j1 = (math.floor(edge / side) for edge in box)
    columns, rows = i1 - i0 + 1, j1 - j0 + 1
    i = np.floor(blobs[:, 0] / side).astype(np.int64) - i0
    j = np.floor(blobs[:, 1] / side).astype(np.int64) - j0
    inside = (i >= 0) & (i < columns) & (j >= 0) & (j < rows)
    cell = (j * columns + i)[inside]
    order = np.argsort(cell, kind="stable")
    blobs = np.ascontiguousarray(blobs[inside][order])
    start = np.concatenate([[0], np.cumsum(np.bincount(cell, minlength=rows * columns))]).astype(np.int64)
    out = np.empty((3, x.size))

    def task(first: int, last: int) -> None:
        part = slice(first, last)
        values = np.empty((3, x[part].size))
        _cells.gather(x[part], y[part], blobs, start, (side, i0, j0, columns), _DROP, values)
        out[:, part] = values

    over_strips(task, x.size, CHUNK)
    return out


def origin_box(box: Box, motion: Motion) -> Box:
    """Box in frame 0 that holds the origins of a box of the moved frame.

    The origins of a lattice of points are found exactly; the box around them is widened by the largest
    distance between the origins of neighbours.
    """
    x, y = np.meshgrid(np.linspace(box[0], box[1], 33), np.linspace(box[2], box[3], 33))
    X, Y = motion.inverse(x, y)
    margin_x = max(np.abs(np.diff(X, axis=0)).max(), np.abs(np.diff(X, axis=1)).max())
    margin_y = max(np.abs(np.diff(Y, axis=0)).max(), np.abs(np.diff(Y, axis=1)).max())
    return X.min() - margin_x, X.max() + margin_x, Y.min() - margin_y, Y.max() + margin_y
