"""Neighbours: kernels that compare the affine map of a grid point with those of the points around it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.compiler import kernel

LIMIT = 3.0
"""Of the normalised median test."""
AGREEMENT = 0.1
"""px: a difference from the neighbours that is never held against a point."""


@kernel
def median(values: NDArray[Any], count: int) -> float:
    """Median of the first `count` values, which are sorted in place."""
    for k in range(1, count):
        value = values[k]
        n = k
        while n > 0 and values[n - 1] > value:
            values[n] = values[n - 1]
            n -= 1
        values[n] = value
    middle = count // 2
    return values[middle] if count % 2 else (values[middle - 1] + values[middle]) / 2


@kernel
def neighbours(values: NDArray[Any], j: int, i: int, reach: int, out: NDArray[Any]) -> int:
    """Known values of the eight points `reach` away, into `out`; returns how many."""
    rows, columns = values.shape
    count = 0
    for y in range(j - reach, j + reach + 1, reach):
        for x in range(i - reach, i + reach + 1, reach):
            if y < 0 or x < 0 or y >= rows or x >= columns or (y == j and x == i):
                continue
            value = values[y, x]
            if value == value:
                out[count] = value
                count += 1
    return count


@kernel
def median_test_strip(
    maps: NDArray[Any],
    step: int,
    reach: int,
    floor: NDArray[Any],
    start: int,
    stop: int,
    outlier: NDArray[Any],
) -> None:
    """The normalised median test of `sixflow.maps.neighbours`, grid rows start … stop."""
    rows, columns = maps.shape[1:]
    predicted = np.empty(8)
    ordered = np.empty(8)
    for j in range(start, stop):
        for i in range(columns):
            outlier[j, i] = False
            if maps[0, j, i] != maps[0, j, i]:
                continue
            for component in range(2):
                count, furthest = 0, 0.0
                for dj in range(-reach, reach + 1, reach):
                    for di in range(-reach, reach + 1, reach):
                        y, x = j + dj, i + di
                        if (dj == 0 and di == 0) or y < 0 or x < 0 or y >= rows or x >= columns:
                            continue
                        guess = (
                            maps[component, y, x]
                            - maps[2 + 2 * component, y, x] * (di * step)
                            - maps[3 + 2 * component, y, x] * (dj * step)
                        )
                        if guess == guess:
                            predicted[count] = guess
                            ordered[count] = guess
                            count += 1
                            furthest = max(furthest, abs(guess - maps[component, j, i]))
                if count < 3 or furthest <= LIMIT * floor[j, i]:
                    continue
                middle = median(ordered, count)
                for k in range(count):
                    ordered[k] = abs(predicted[k] - middle)
                spread = median(ordered, count)
                if abs(maps[component, j, i] - middle) > LIMIT * (spread + floor[j, i]):
                    outlier[j, i] = True


@kernel
def fill_ring(filled: NDArray[Any], known: NDArray[Any], step: int, typical: NDArray[Any]) -> None:
    """Give the unknown points beside known ones what these predict, and mark them as known."""
    rows, columns = known.shape
    reached = np.zeros((rows, columns), np.bool_)
    total = np.empty(6)
    for j in range(rows):
        for i in range(columns):
            if known[j, i]:
                continue
            count = 0
            total[:] = 0
            for dj in range(-1, 2):
                for di in range(-1, 2):
                    y, x = j + dj, i + di
                    if y < 0 or x < 0 or y >= rows or x >= columns or not known[y, x]:
                        continue
                    count += 1
                    for k in range(6):
                        value = filled[k, y, x]
                        if k < 2:
                            value -= step * (filled[2 + 2 * k, y, x] * di + filled[3 + 2 * k, y, x] * dj)
                        total[k] += value
            if count == 0:
                continue
            reached[j, i] = True
            for k in range(6):
                mean = total[k] / count
                # let what is special in a guessed gradient fade with distance
                filled[k, j, i] = mean if k < 2 else typical[k - 2] + 0.8 * (mean - typical[k - 2])
    for j in range(rows):
        for i in range(columns):
            known[j, i] |= reached[j, i]


@kernel
def curvature_strip(
    maps: NDArray[Any], reach: int, step: int, start: int, stop: int, most: NDArray[Any]
) -> None:
    """Raise `most` to what the curvature of the field makes neighbours mispredict, grid rows start … stop."""
    rows, columns = maps.shape[1:]
    for j in range(start, stop):
        for i in range(columns):
            for di, dj in ((1, 0), (0, 1), (1, 1), (1, -1)):
                x, y = di * reach, dj * reach
                if min(j - y, j + y, i - x) < 0 or max(j - y, j + y) >= rows or i + x >= columns:
                    continue
                for c in (2, 4):
                    along = (maps[c, j + y, i + x] - maps[c, j - y, i - x]) * di
                    across = (maps[c + 1, j + y, i + x] - maps[c + 1, j - y, i - x]) * dj
                    bent = abs(along + across) * reach * step / 4
                    if bent > most[j, i]:
                        most[j, i] = bent
