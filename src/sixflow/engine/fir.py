"""Separable symmetric filters: the B-spline prefilter, smoothing for pyramids and local means.

A symmetric filter is given by its half: weights[0] at the centre, weights[k] at both ±k. Beyond its
borders an image is reflected, evenly (values mirrored about the border pixel, …cb|abcdef|ed…) or oddly
(about its value as well, 2a − b before a: a slope goes on).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.compiler import kernel
from sixflow.engine.threads import over_strips

STRIP = 64


@kernel
def reflect(index: int, size: int, odd: bool) -> tuple[int, int, int, int]:
    """Any index of a reflected line: value = sign · line[place] + first · line[0] + last · line[size − 1].

    Returns
    -------
    place, sign, first, last : int
    """
    sign, first, last = 1, 0, 0
    while size > 1 and (index < 0 or index >= size):
        if index < 0:
            index = -index
            if odd:
                first += 2 * sign
                sign = -sign
        else:
            index = 2 * (size - 1) - index
            if odd:
                last += 2 * sign
                sign = -sign
    return (index if size > 1 else 0), sign, first, last


@kernel
def _filter_rows(
    image: NDArray[Any],
    half: NDArray[Any],
    out: NDArray[Any],
    pad: int,
    stride: int,
    odd: bool,
    start: int,
    stop: int,
) -> None:
    """Rows start … stop of `out`; out[j, i] is the filtered image at row stride·j − pad, column
    stride·i − pad.
    """
    height, width = image.shape
    reach = half.size - 1
    margin = reach + pad
    down = np.empty(width, image.dtype)
    line = np.empty(width + 2 * margin, image.dtype)
    inner = width + 2 * pad
    across = np.empty(inner, image.dtype)
    for j in range(start, stop):
        y = stride * j - pad
        for x in range(width):
            down[x] = 0
        top, bottom = half[0] * 0, half[0] * 0
        for k in range(reach + 1):
            above_row, above_sign, above_first, above_last = reflect(y - k, height, odd)
            below_row, below_sign, below_first, below_last = reflect(y + k, height, odd)
            weight = half[k] / 2 if k == 0 else half[k]
            above, below = image[above_row], image[below_row]
            a, b = weight * above_sign, weight * below_sign
            for x in range(width):
                down[x] += a * above[x] + b * below[x]
            top += weight * (above_first + below_first)
            bottom += weight * (above_last + below_last)
        if top != 0:
            for x in range(width):
                down[x] += top * image[0, x]
        if bottom != 0:
            for x in range(width):
                down[x] += bottom * image[height - 1, x]
        for x in range(width):
            line[margin + x] = down[x]
        for x in range(margin):
            place, sign, first, last = reflect(x - margin, width, odd)
            line[x] = sign * down[place] + first * down[0] + last * down[width - 1]
            place, sign, first, last = reflect(width + x, width, odd)
            line[margin + width + x] = sign * down[place] + first * down[0] + last * down[width - 1]
        middle = line[reach : reach + inner]
        for x in range(inner):
            across[x] = half[0] * middle[x]
        for k in range(1, reach + 1):
            left, right, weight = (
                line[reach - k : reach - k + inner],
                line[reach + k : reach + k + inner],
                half[k],
            )
            for x in range(inner):
                across[x] += weight * (left[x] + right[x])
        target = out[j]
        if stride == 1:
            for x in range(inner):
                target[x] = across[x]
        else:
            for x in range(target.size):
                target[x] = across[stride * x]


def filter_separable(
    image: NDArray[Any], half: NDArray[Any], *, pad: int = 0, stride: int = 1, odd: bool = False
) -> NDArray[Any]:
    """Filter an image with the same symmetric weights along both axes.

    Parameters
    ----------
    image : float array, shape (height, width)
    half : float array, shape (reach + 1,)
        Half of the symmetric weights.
    pad : int
        Extend the result by this many pixels on each side (its values are those of the reflected image).
    stride : int
        Keep every stride-th row and column, the first included; only with pad = 0.
    odd : bool
        Reflect the image oddly beyond its borders, rather than evenly.

    Returns
    -------
    array of the image's dtype, shape (height + 2 pad, width + 2 pad), or (⌈height/stride⌉, ⌈width/stride⌉)

    Examples
    --------
    >>> point = np.zeros((5, 5))
    >>> point[2, 2] = 1
    >>> filter_separable(point, np.array([0.5, 0.25]))[2]
    array([0.   , 0.125, 0.25 , 0.125, 0.   ])
    """
    height, width = image.shape
    shape = tuple(-(-(size + 2 * pad) // stride) for size in (height, width))
    out = np.empty(shape, image.dtype)
    half = half.astype(image.dtype)
    over_strips(
        lambda start, stop: _filter_rows(image, half, out, pad, stride, odd, start, stop), shape[0], STRIP
    )
    return out


_HALVING = np.exp(-((np.arange(5) / 1.5) ** 2) / 2)
_HALVING /= _HALVING[0] + 2 * _HALVING[1:].sum()


def downsample(image: NDArray[Any]) -> NDArray[Any]:
    """Halve an image: pixel (j, i) of the result lies on pixel (2j, 2i) of the image.

    It is smoothed by a Gaussian of 1.5 px first, so that what is left can be interpolated and
    differentiated on the coarser pixels.
    """
    return filter_separable(image, _HALVING, stride=2)
