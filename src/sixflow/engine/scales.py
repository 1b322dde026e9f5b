"""Scales: the typical residual around a pixel, and the contrast of the image there.

| symbol | meaning |
|---|---|
| r, g | residual and gradient of `warp` |
| s₀ | 1.4826 · median of ∣r∣ over a tile of 16 × 16 pixels: noise; at least 0.02 C |
| e | 1.4826 · median of ∣r∣/∣g∣ over its steeper pixels: displacement that the fit leaves, px; at least 0.02 px |
| C | standard deviation of the reference in the tile |

All three are taken over the pixels that have a partner, and that the pass before left any weight. Over all pixels the
medians would stand up to 40 % of outlying ones in principle; in fact they are too large long before, outlying pixels
are kept, and as outlying ones lie over several pixels, errors exceed what the covariance says. From pass to pass the
scales come down to those of the pixels that belong.

Of every scale the median over 5 × 5 tiles is used, so that what is outlying in some of them, or bright, changes nothing
beside them. A tile that is unknown, with all around it, takes the scales of the nearest known one.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.compiler import kernel
from sixflow.engine.threads import over_strips

TILE = 16
"""px: side of a tile. Its 256 pixels tell a median to 8 %."""
REACH = 2
"""Tiles on each side whose median is taken: scales are those of 80 × 80 px, of which 12 tiles of 25 may be outlying."""
NORMAL = 1.4826
"""Standard deviation of a Gaussian over its median absolute value."""
NEGLIGIBLE = 0.05
"""Weight that is taken for none: the rest would cost more noise than it tells."""
LEAST_MISFIT = 0.02
"""px: no fit is better than that on real pixels."""
OF_CONTRAST = 0.02
"""Share of the reference's contrast that rounding and interpolation may leave in a residual without noise."""
_STRIP = 4


@kernel
def select(values: NDArray[Any], count: int, k: int) -> float:
    """Element k of the first `count` values in order (Hoare's selection); reorders them."""
    low, high = 0, count - 1
    while low < high:
        pivot = values[(low + high) // 2]
        i, j = low, high
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i += 1
                j -= 1
        if k <= j:
            high = j
        elif k >= i:
            low = i
        else:
            break
    return values[k]


@kernel
def _deviation(count: int, total: float, square: float) -> float:
    """Standard deviation of so many values, from their sum and that of their squares."""
    mean = total / count
    return math.sqrt(max(square / count - mean * mean, 0.0))


@kernel
def contrasts_strip(
    image: NDArray[Any], valid: NDArray[Any], start: int, stop: int, contrasts: NDArray[Any]
) -> None:
    """C of the tile rows start … stop, NaN where a tile has less than a quarter of its pixels.

    Parameters
    ----------
    image : array, shape (height, width)
    valid : uint8 array of the same shape, or (0, 0) where every pixel counts
    contrasts : array, shape (tile rows, tile columns)
    """
    height, width = image.shape
    for tj in range(start, stop):
        for ti in range(contrasts.shape[1]):
            count, total, square = 0, 0.0, 0.0
            for y in range(tj * TILE, min((tj + 1) * TILE, height)):
                for x in range(ti * TILE, min((ti + 1) * TILE, width)):
                    if valid.size == 0 or valid[y, x]:
                        count += 1
                        total += image[y, x]
                        square += image[y, x] ** 2
            contrasts[tj, ti] = _deviation(count, total, square) if 4 * count >= TILE * TILE else np.nan


@kernel
def scales_strip(
    residual: NDArray[Any], gradient_x: NDArray[Any], gradient_y: NDArray[Any], still: NDArray[Any],
    weight: NDArray[Any], start: int, stop: int, scales: NDArray[Any],
) -> None:  # fmt: skip
    """s₀, e and C of the tile rows start … stop, from the pixels that have weight.

    Parameters
    ----------
    residual, gradient_x, gradient_y, still, weight : arrays, shape (height, width)
    scales : array, shape (3, tile rows, tile columns)
        NaN where a tile has less than a quarter of its pixels.
    """
    height, width = residual.shape
    sizes = np.empty(TILE * TILE, residual.dtype)
    ratios = np.empty(TILE * TILE, residual.dtype)
    for tj in range(start, stop):
        top, bottom = tj * TILE, min((tj + 1) * TILE, height)
        for ti in range(scales.shape[2]):
            left, right = ti * TILE, min((ti + 1) * TILE, width)
            count, power, total, square = 0, 0.0, 0.0, 0.0
            for y in range(top, bottom):
                for x in range(left, right):
                    r = residual[y, x]
                    if r == r and weight[y, x] >= NEGLIGIBLE:
                        sizes[count] = abs(r)
                        count += 1
                        power += gradient_x[y, x] ** 2 + gradient_y[y, x] ** 2
                        total += still[y, x]
                        square += still[y, x] ** 2
            if 4 * count < TILE * TILE:
                scales[:, tj, ti] = np.nan
                continue
            scales[2, tj, ti] = _deviation(count, total, square)
            noise = NORMAL * select(sizes, count, count // 2)
            mean_power = power / count
            steep, steepness = 0, 0.0
            for y in range(top, bottom):
                for x in range(left, right):
                    r = residual[y, x]
                    g = gradient_x[y, x] ** 2 + gradient_y[y, x] ** 2
                    if r == r and weight[y, x] >= NEGLIGIBLE and g > mean_power / 2:
                        ratios[steep] = abs(r) / math.sqrt(g)
                        steepness += 1 / g
                        steep += 1
            misfit = 0.0
            if steep > 0:
                ratio = NORMAL * select(ratios, steep, steep // 2)
                misfit = max(0.0, ratio * ratio - noise * noise * steepness / steep)
            scales[0, tj, ti] = noise
            scales[1, tj, ti] = math.sqrt(misfit)


def median_around(tiles: NDArray[Any], reach: int) -> NDArray[np.float64]:
    """Median over the tiles that are up to `reach` further; an unknown one (NaN) takes that of the nearest known.

    Parameters
    ----------
    tiles : array, shape (tile rows, tile columns)
    reach : int

    Returns
    -------
    float64 array of the same shape; without NaN, unless nothing is known

    Examples
    --------
    >>> median_around(np.array([[1.0, 3.0, 2.0, np.nan, np.nan]]), 1)
    array([[2. , 2. , 2.5, 2. , 2. ]])
    """
    padded = np.pad(tiles.astype(np.float64), reach, constant_values=np.nan)
    side = 2 * reach + 1
    around = np.lib.stride_tricks.sliding_window_view(padded, (side, side)).reshape(*tiles.shape, -1)
    ordered, count = np.sort(around, axis=-1), np.isfinite(around).sum(axis=-1)  # NaN come last
    middle = [np.maximum(place, 0)[..., None] for place in ((count - 1) // 2, count // 2)]
    low, high = (np.take_along_axis(ordered, place, axis=-1)[..., 0] for place in middle)
    out, known = np.asarray((low + high) / 2), count > 0
    if known.all() or not known.any():
        return out
    from scipy.ndimage import distance_transform_edt

    nearest = distance_transform_edt(~known, return_distances=False, return_indices=True)
    return np.asarray(out[tuple(nearest)])


def scales_of(
    residual: NDArray[Any], gradient_x: NDArray[Any], gradient_y: NDArray[Any], still: NDArray[Any],
    weight: NDArray[Any],
) -> NDArray[np.float64]:  # fmt: skip
    """s₀ and e around every tile.

    Parameters
    ----------
    residual, gradient_x, gradient_y, still, weight : arrays, shape (height, width)
        As for `weigh.find_weights`.

    Returns
    -------
    array, shape (2, tile rows, tile columns), without NaN; infinite, so that no weight is lost, if nothing is known
    """
    height, width = residual.shape
    tiles = np.empty((3, -(-height // TILE), -(-width // TILE)))
    over_strips(
        lambda a, b: scales_strip(residual, gradient_x, gradient_y, still, weight, a, b, tiles),
        tiles.shape[1],
        _STRIP,
    )
    noise, misfit, contrast = (median_around(plane, REACH) for plane in tiles)
    least = np.maximum(noise, OF_CONTRAST * contrast), np.maximum(misfit, LEAST_MISFIT)
    return np.nan_to_num(np.stack(least), nan=np.inf, posinf=np.inf)


def local_contrast(
    image: NDArray[Any], valid: NDArray[np.uint8], y: NDArray[Any], x: NDArray[Any]
) -> NDArray[np.float64]:
    """Contrast of an image around rows y and columns x: the median of the standard deviations of 5 × 5 tiles.

    Parameters
    ----------
    image : array, shape (height, width)
    valid : uint8 array of the same shape, or (0, 0) where every pixel counts
    y, x : int arrays, shapes (rows,) and (columns,)

    Returns
    -------
    array, shape (rows, columns); 0 where no pixel counts at all
    """
    height, width = image.shape
    tiles = np.empty((-(-height // TILE), -(-width // TILE)))
    over_strips(lambda a, b: contrasts_strip(image, valid, a, b, tiles), len(tiles), _STRIP)
    return np.nan_to_num(median_around(tiles, REACH))[np.ix_(y // TILE, x // TILE)]
