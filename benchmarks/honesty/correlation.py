"""Plain correlation of particle images: what any program for them measures, and the check of its vectors.

A square of the first frame is looked for in one of twice the side of the second, by the zero-normalised correlation
coefficient; its peak is fitted by a Gaussian through three points along each axis (Willert and Gharib 1991). A vector
counts as measured if the normalised median test of its eight neighbours, half a square apart, accepts it (Westerweel
and Scarano 2005: residual over 0.1 px + the median residual of the neighbours at most 2). Nothing is iterated.

| symbol | name |
|---|---|
| side of the square, px | `SIDE` |
| ε, limit of the test | `LEAST`, `LIMIT` |
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

SIDE = 32
LEAST, LIMIT = 0.1, 2.0
BATCH = 512


def correlate(frame0: Array, frame1: Array) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
    """Measure two frames in squares half of which overlap.

    Returns
    -------
    x, y : array
        Columns and rows of the squares' centres, between pixels.
    found : array, shape (rows, columns, 2)
        Displacement, px; NaN where the peak lies on the border of what was searched.
    accepted : bool array, shape (rows, columns)
        By the normalised median test.
    """
    half = SIDE // 2
    height, width = frame0.shape
    # a pixel of the square lies at its middle + (−16 … 15): the centre is half a pixel before
    rows, columns = np.arange(SIDE, height - SIDE + 1, half), np.arange(SIDE, width - SIDE + 1, half)
    places = [(y, x) for y in rows for x in columns]
    found = np.concatenate(
        [_batch(frame0, frame1, places[k : k + BATCH]) for k in range(0, len(places), BATCH)]
    ).reshape(len(rows), len(columns), 2)
    return columns - 0.5, rows - 0.5, found, _median_test(found)


def _batch(frame0: Array, frame1: Array, places: list[tuple[int, int]]) -> Array:
    half, twice = SIDE // 2, 2 * SIDE
    small = np.stack([frame0[y - half : y + half, x - half : x + half] for y, x in places]).astype(float)
    large = np.stack([frame1[y - SIDE : y + SIDE, x - SIDE : x + SIDE] for y, x in places]).astype(float)
    small -= small.mean(axis=(1, 2), keepdims=True)
    large -= large.mean(axis=(1, 2), keepdims=True)
    product = np.fft.irfft2(
        np.conj(np.fft.rfft2(small, (twice, twice))) * np.fft.rfft2(large), (twice, twice)
    )[:, : SIDE + 1, : SIDE + 1]
    mean, square = _box(large) / SIDE**2, _box(large**2)
    power = np.maximum(square - SIDE**2 * mean**2, 1e-9 * SIDE**2)
    coefficient = product / np.sqrt(power)
    at = coefficient.reshape(len(places), -1).argmax(axis=1)
    i, j = np.divmod(at, SIDE + 1)
    inside = (i > 0) & (i < SIDE) & (j > 0) & (j < SIDE)
    i, j, n = i.clip(1, SIDE - 1), j.clip(1, SIDE - 1), np.arange(len(places))
    peak = np.log(np.maximum(coefficient, 1e-6 * coefficient.max(axis=(1, 2), keepdims=True) + 1e-300))
    across = _vertex(*(peak[n, i, j + k] for k in (-1, 0, 1)))
    down = _vertex(*(peak[n, i + k, j] for k in (-1, 0, 1)))
    shift = np.stack([j - half + across, i - half + down], axis=-1)
    return np.where(inside[:, None], shift, np.nan)


def _box(values: Array) -> Array:
    """Sums over all squares of the side."""
    total = np.pad(values, ((0, 0), (1, 0), (1, 0))).cumsum(axis=1).cumsum(axis=2)
    return (
        total[:, SIDE:, SIDE:] - total[:, :-SIDE, SIDE:] - total[:, SIDE:, :-SIDE] + total[:, :-SIDE, :-SIDE]
    )


def _vertex(before: Array, here: Array, after: Array) -> Array:
    bend = before - 2 * here + after
    return np.where(bend < 0, (before - after) / (2 * np.where(bend < 0, bend, 1)), 0.0)


def _median_test(found: Array) -> NDArray[np.bool_]:
    rows, columns = found.shape[:2]
    padded = np.pad(found, ((1, 1), (1, 1), (0, 0)), constant_values=np.nan)
    around = np.stack(
        [
            padded[1 + dj : 1 + dj + rows, 1 + di : 1 + di + columns]
            for dj in (-1, 0, 1)
            for di in (-1, 0, 1)
            if (dj, di) != (0, 0)
        ]
    )
    known = np.isfinite(around).all(axis=-1).sum(axis=0) >= 3
    safe = np.where(known[..., None], around, 0.0)
    middle = np.nanmedian(safe, axis=0)
    usual = np.nanmedian(np.abs(safe - middle), axis=0)
    with np.errstate(invalid="ignore"):
        ratio = np.hypot(*np.moveaxis((found - middle) / (usual + LEAST), -1, 0))
        return np.asarray(known & (ratio <= LIMIT))
