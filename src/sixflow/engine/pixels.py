"""Pixels: kernels that prepare single pixels of a frame: outlying ones, and values beside those that are missing.

`lone` is the second difference B of a pixel, see `sixflow.prepare.defects`; `continue_strip` reflects an image beyond
what is known of it, see `sixflow.prepare.nodata`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.compiler import kernel
from sixflow.engine.scales import select

DEFECT_TILE = 64
"""px: side of the tiles in which defects are compared with their surroundings; 16 × 8 pixels of each are sampled."""
_ACROSS, _DOWN = 4, 8
_QUANTILE = 0.9


@kernel
def lone(image: NDArray[Any], y: int, x: int) -> float:
    """B of a pixel that has eight neighbours."""
    p, half = image[y, x], image.dtype.type(0.5)
    a = p - (image[y, x - 1] + image[y, x + 1]) * half
    b = p - (image[y - 1, x] + image[y + 1, x]) * half
    c = p - (image[y - 1, x - 1] + image[y + 1, x + 1]) * half
    d = p - (image[y - 1, x + 1] + image[y + 1, x - 1]) * half
    return max(min(min(a, b), min(c, d)), 0.0) + min(max(max(a, b), max(c, d)), 0.0)


@kernel
def tile_levels_strip(
    image: NDArray[Any], valid: NDArray[Any], start: int, stop: int, out: NDArray[Any]
) -> None:
    """The 90 % quantile of |B| and the standard deviation in the tile rows start … stop.

    Parameters
    ----------
    image : array, shape (height, width)
    valid : uint8 array of the same shape, or (0, 0) where every pixel counts
    out : array, shape (2, tile rows, tile columns)
        Receives both; NaN where less than a quarter of the sampled pixels counts.
    """
    height, width = image.shape
    sizes = np.empty((DEFECT_TILE // _DOWN) * (DEFECT_TILE // _ACROSS), image.dtype)
    for tj in range(start, stop):
        for ti in range(out.shape[2]):
            count, total, square = 0, 0.0, 0.0
            for y in range(tj * DEFECT_TILE + 1, min((tj + 1) * DEFECT_TILE, height - 1), _DOWN):
                for x in range(ti * DEFECT_TILE + 1, min((ti + 1) * DEFECT_TILE, width - 1), _ACROSS):
                    if valid.size and valid[y, x] == 0:
                        continue
                    sizes[count] = abs(lone(image, y, x))
                    total += image[y, x]
                    square += image[y, x] * image[y, x]
                    count += 1
            if 4 * count < sizes.size:
                out[0, tj, ti] = out[1, tj, ti] = np.nan
                continue
            out[0, tj, ti] = select(sizes, count, int(_QUANTILE * (count - 1)))
            out[1, tj, ti] = max(square / count - (total / count) ** 2, 0.0) ** 0.5


@kernel
def _is_rim(valid: NDArray[Any], y: int, x: int) -> bool:
    """Whether any of the eight neighbours of a pixel is not valid."""
    for j in range(y - 1, y + 2):
        for i in range(x - 1, x + 2):
            if valid[j, i] == 0:
                return True
    return False


@kernel
def _lone_at_rim(image: NDArray[Any], valid: NDArray[Any], y: int, x: int) -> float:
    """B of a pixel of whose neighbours some are not valid: the opposite one stands in for such a one."""
    p, least, most = float(image[y, x]), np.inf, -np.inf
    for j, i in ((0, 1), (1, 0), (1, 1), (1, -1)):
        here, there = valid[y + j, x + i] != 0, valid[y - j, x - i] != 0
        if not (here or there):
            continue
        a, b = float(image[y + j, x + i]), float(image[y - j, x - i])
        d = p - 0.5 * ((a if here else b) + (b if there else a))
        least, most = min(least, d), max(most, d)
    return max(least, 0.0) + min(most, 0.0) if least <= most else 0.0


@kernel
def find_lone_strip(
    image0: NDArray[Any], image1: NDArray[Any], levels: NDArray[Any], valid: NDArray[Any], at_rim: float,
    start: int, stop: int, found: NDArray[Any],
) -> None:  # fmt: skip
    """Mark pixels of the rows start … stop whose B exceeds the level of its tile in both images, with one sign.

    `levels` is (2, tile rows, tile columns); `valid` uint8 (height, width), or (0, 0) where every pixel counts. Beside
    one that does not, levels are `at_rim` times as high.
    """
    width, kind = image0.shape[1], image0.dtype.type
    half = kind(0.5)
    least0, least1 = np.empty(width, image0.dtype), np.empty(width, image0.dtype)
    for y in range(start, stop):
        if y == start or y % DEFECT_TILE == 0:
            for x in range(width):
                least0[x] = kind(levels[0, y // DEFECT_TILE, x // DEFECT_TILE])
                least1[x] = kind(levels[1, y // DEFECT_TILE, x // DEFECT_TILE])
        row0, row1, out, candidates = image0[y], image1[y], found[y], 0
        for x in range(1, width - 1):
            a = row0[x] - (row0[x - 1] + row0[x + 1]) * half
            b = row1[x] - (row1[x - 1] + row1[x + 1]) * half
            candidate = (abs(a) > least0[x]) & (abs(b) > least1[x])
            out[x] = candidate
            candidates += candidate
        if candidates == 0 and valid.size == 0:
            continue
        for x in range(1, width - 1):
            if valid.size and (valid[y, x] == 0 or _is_rim(valid, y, x)):
                out[x] = False
                if valid[y, x]:
                    a, b = _lone_at_rim(image0, valid, y, x), _lone_at_rim(image1, valid, y, x)
                    out[x] = abs(a) > at_rim * least0[x] and abs(b) > at_rim * least1[x] and a * b > 0
            elif out[x]:
                a, b = lone(image0, y, x), lone(image1, y, x)
                out[x] = abs(a) > least0[x] and abs(b) > least1[x] and a * b > 0


@kernel
def _nearest_row(known: NDArray[Any], y: int, reach: int, nearest: NDArray[Any]) -> bool:
    """Distance of every pixel of a row to the nearest known one of its row or column; more than `reach` if there is
    none so near. Whether any pixel of the row is not known.
    """
    height, width = known.shape
    row = known[y]
    gaps = False
    for x in range(width):
        nearest[x] = 0 if row[x] else reach + 1
        gaps |= row[x] == 0
    if not gaps:
        return False
    for distance in range(reach, 0, -1):
        closer = nearest.dtype.type(distance)
        left, right = row[: width - distance], row[distance:]
        here, there = nearest[distance:], nearest[: width - distance]
        for x in range(left.size):
            here[x] = min(here[x], closer) if left[x] else here[x]
        for x in range(right.size):
            there[x] = min(there[x], closer) if right[x] else there[x]
        for other in (y - distance, y + distance):
            if 0 <= other < height:
                line = known[other]
                for x in range(width):
                    nearest[x] = min(nearest[x], closer) if line[x] else nearest[x]
    return True


@kernel
def continue_strip(
    image: NDArray[Any], known: NDArray[Any], reach: int, start: int, stop: int, out: NDArray[Any],
    reached: NDArray[Any],
) -> None:  # fmt: skip
    """Give pixels within `reach` px of a known one of their row or column its reflection about the nearest, in the
    rows start … stop; `reached` receives 1 there.
    """
    height, width = image.shape
    nearest = np.empty(width, np.uint8)
    for y in range(start, stop):
        if not _nearest_row(known, y, reach, nearest):
            continue
        for x in range(width):
            distance = int(nearest[x])
            if distance == 0 or distance > reach:
                continue
            total, count = 0.0, 0
            for dy, dx in ((0, -1), (0, 1), (-1, 0), (1, 0)):
                b, a = y + distance * dy, x + distance * dx
                if b < 0 or a < 0 or b >= height or a >= width or not known[b, a]:
                    continue
                d, c = b + distance * dy, a + distance * dx
                inside = d >= 0 and c >= 0 and d < height and c < width
                total += image[b, a]
                if inside and known[d, c]:
                    total += image[b, a] - image[d, c]
                count += 1
            out[y, x] = total / count
            reached[y, x] = 1
