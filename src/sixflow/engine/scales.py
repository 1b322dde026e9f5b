"""Scales: the typical residual around a pixel, and the contrast of the image there.

| symbol | meaning |
|---|---|
| r, g | residual and gradient of `warp` |
| s₀ | 1.4826 · median of ∣r∣ over a tile of 16 × 16 pixels: noise; at least 0.02 C |
| e | 1.4826 · median of ∣r∣/∣g∣ over its steeper pixels: displacement that the fit leaves, px; at least 0.02 px |
| C | standard deviation of the reference in the tile |
| m | median of the reference in the tile: what there is without particles |
| D | ∣mean of both frames − m∣ of a pixel: its brightness |
| b | share of its brightness by which a pixel changes, see below |

Particles do not only move: they fade, flicker, leave the sheet, and the residual of one grows with its brightness. Over
the brighter pixels of the tile (D above s₀, D² above half its mean) the lower quartile of ∣r∣/D, times 3.1381, is a
scale of changes, b₀, and

    b² = [b₀² − s₀² · mean of 1/D² − e² · mean of g²/D²]₊

(with s₀ and e of the surroundings)
is what neither noise nor the misfit explains of it. A quartile, because bright pixels have the fewest partners: where a
share p of the particles is lost, 2p/(1 + p) of the particle images are seen in one frame alone, two thirds where half
of the particles are. Where brightness stays, b is 0, and what is seen in one frame alone is outlying; where it changes
as much as that from one particle to the next, nothing is.

All are taken over the pixels that have a partner, and that the pass before left any weight. Over all pixels the
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

from sixflow.engine.compiler import inner, kernel
from sixflow.engine.threads import over_strips

TILE = 16
"""px: side of a tile. Its 256 pixels tell a median to 8 %."""
REACH = 2
"""Tiles on each side whose median is taken: scales are those of 80 × 80 px, of which 12 tiles of 25 may be outlying."""
NORMAL = 1.4826
"""Standard deviation of a Gaussian over its median absolute value."""
NORMAL_QUARTILE = 3.1381
"""The same over the lower quartile of its absolute value."""
FEW = 8
"""Bright pixels, those of one particle image, of which a quartile says nothing."""
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


@inner
def _misfit(
    residual: NDArray[Any], power: NDArray[Any], count: int, noise: float, ratios: NDArray[Any]
) -> float:
    """Find e of so many pixels of a tile: residuals, and squares of their gradients."""
    least = power[:count].sum() / count / 2
    steep, steepness = 0, 0.0
    for k in range(count):
        if power[k] > least:
            ratios[steep] = residual[k] / math.sqrt(power[k])
            steepness += 1 / power[k]
            steep += 1
    if steep == 0:
        return 0.0
    ratio = NORMAL * select(ratios, steep, steep // 2)
    return math.sqrt(max(0.0, ratio * ratio - noise * noise * steepness / steep))


@inner
def _changes(
    residual: NDArray[Any], power: NDArray[Any], bright: NDArray[Any], count: int, noise: float,
    ratios: NDArray[Any],
) -> tuple[float, float, float]:  # fmt: skip
    """b₀², and means of 1/D² and g²/D², of so many pixels of a tile; NaN where too few of them are bright."""
    least, found, inverse, steepness = 0.0, 0, 0.0, 0.0
    for k in range(count):
        least += bright[k] * bright[k] / (2 * count)
    least = max(least, noise * noise)
    for k in range(count):
        square = bright[k] * bright[k]
        if square > least:
            ratios[found] = residual[k] / bright[k]
            inverse += 1 / square
            steepness += power[k] / square
            found += 1
    if found < FEW:
        return np.nan, np.nan, np.nan
    ratio = NORMAL_QUARTILE * select(ratios, found, found // 4)
    return ratio * ratio, inverse / found, steepness / found


@kernel
def scales_strip(
    residual: NDArray[Any], gradient_x: NDArray[Any], gradient_y: NDArray[Any], still: NDArray[Any],
    weight: NDArray[Any], start: int, stop: int, scales: NDArray[Any],
) -> None:  # fmt: skip
    """Of the tile rows start … stop, from the pixels that have weight: s₀, e, m, C, b₀², and means of 1/D² and g²/D².

    Parameters
    ----------
    residual, gradient_x, gradient_y, still, weight : arrays, shape (height, width)
    scales : array, shape (7, tile rows, tile columns)
        NaN where a tile has less than a quarter of its pixels.
    """
    height, width = residual.shape
    sizes, power, grey, bright, some = np.empty((5, TILE * TILE), residual.dtype)
    for tj in range(start, stop):
        for ti in range(scales.shape[2]):
            count, total, square = 0, 0.0, 0.0
            for y in range(tj * TILE, min((tj + 1) * TILE, height)):
                for x in range(ti * TILE, min((ti + 1) * TILE, width)):
                    r = residual[y, x]
                    if r == r and weight[y, x] >= NEGLIGIBLE:
                        sizes[count] = abs(r)
                        power[count] = gradient_x[y, x] ** 2 + gradient_y[y, x] ** 2
                        grey[count] = still[y, x]
                        bright[count] = still[y, x] + r / 2
                        total += still[y, x]
                        square += still[y, x] ** 2
                        count += 1
            if 4 * count < TILE * TILE:
                scales[:, tj, ti] = np.nan
                continue
            dark = select(grey, count, count // 2)
            for k in range(count):
                bright[k] = abs(bright[k] - dark)
                some[k] = sizes[k]
            noise = NORMAL * select(some, count, count // 2)
            scales[0, tj, ti] = noise
            scales[1, tj, ti] = _misfit(sizes, power, count, noise, some)
            scales[2, tj, ti] = dark
            scales[3, tj, ti] = _deviation(count, total, square)
            changes = _changes(sizes, power, bright, count, noise, some)
            for k in range(3):
                scales[4 + k, tj, ti] = changes[k]


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
    """s₀, e, b and m around every tile.

    Parameters
    ----------
    residual, gradient_x, gradient_y, still, weight : arrays, shape (height, width)
        As for `weigh.find_weights`.

    Returns
    -------
    array, shape (4, tile rows, tile columns), without NaN; s₀ infinite, so that no weight is lost, if nothing is known
    """
    height, width = residual.shape
    tiles = np.empty((7, -(-height // TILE), -(-width // TILE)))
    over_strips(
        lambda a, b: scales_strip(residual, gradient_x, gradient_y, still, weight, a, b, tiles),
        tiles.shape[1],
        _STRIP,
    )
    noise, misfit, dark, contrast = (median_around(plane, REACH) for plane in tiles[:4])
    changes, inverse, steepness = tiles[4:]
    with np.errstate(invalid="ignore"):
        changes = np.maximum(changes - noise**2 * inverse - misfit**2 * steepness, 0)
    change = np.sqrt(median_around(changes, REACH))
    noise, misfit = np.maximum(noise, OF_CONTRAST * contrast), np.maximum(misfit, LEAST_MISFIT)
    return np.stack(
        [np.nan_to_num(noise, nan=np.inf), *(np.nan_to_num(part) for part in (misfit, change, dark))]
    )


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
