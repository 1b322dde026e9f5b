"""Separable symmetric filters: the B-spline prefilter, smoothing for pyramids and local means.

A symmetric filter is given by its half: weights[0] at the centre, weights[k] at both ±k. Beyond its
borders an image is reflected, evenly (values mirrored about the border pixel, …cb|abcdef|ed…) or oddly
(about its value as well, 2a − b before a: a slope goes on).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.compiler import inner, kernel
from sixflow.engine.threads import over_strips

STRIP = 64
TILE = 256
"""Columns that are filtered at a time."""


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


@inner
def _down_row(
    image: NDArray[Any], half: NDArray[Any], y: int, odd: bool, columns: tuple[int, int], out: NDArray[Any]
) -> None:
    """Filter some columns of an image down to row y: out[first … last] of a line."""
    height, (first, last) = image.shape[0], columns
    s, kind = out[first:last], image.dtype.type
    row, sign, top, bottom = reflect(y, height, odd)
    start, of_top, of_bottom = image[row][first:last], half[0] * kind(top), half[0] * kind(bottom)
    weight = half[0] * kind(sign)
    for x in range(last - first):
        s[x] = weight * start[x]
    for k in range(1, half.size, 2):  # four rows at a time; the last tap may have no partner
        near, far = half[k], half[k + 1] if k + 1 < half.size else half[0] * 0
        r0, s0, t0, b0 = reflect(y - k, height, odd)
        r1, s1, t1, b1 = reflect(y + k, height, odd)
        r2, s2, t2, b2 = reflect(y - k - 1, height, odd)
        r3, s3, t3, b3 = reflect(y + k + 1, height, odd)
        f0, f1, f2, f3 = (
            image[r0][first:last],
            image[r1][first:last],
            image[r2][first:last],
            image[r3][first:last],
        )
        w0, w1, w2, w3 = near * kind(s0), near * kind(s1), far * kind(s2), far * kind(s3)
        for x in range(last - first):
            s[x] += (w0 * f0[x] + w1 * f1[x]) + (w2 * f2[x] + w3 * f3[x])
        of_top += near * kind(t0 + t1) + far * kind(t2 + t3)
        of_bottom += near * kind(b0 + b1) + far * kind(b2 + b3)
    if of_top != 0:
        border = image[0][first:last]
        for x in range(last - first):
            s[x] += of_top * border[x]
    if of_bottom != 0:
        border = image[height - 1][first:last]
        for x in range(last - first):
            s[x] += of_bottom * border[x]


@inner
def _across_row(line: NDArray[Any], half: NDArray[Any], out: NDArray[Any]) -> None:
    """Filter a line, which is longer by the filter's reach at both ends."""
    n, reach = out.size, half.size - 1
    middle, weight = line[reach : reach + n], half[0]
    for x in range(n):
        out[x] = weight * middle[x]
    for k in range(1, reach, 2):
        l0, r0 = line[reach - k : reach - k + n], line[reach + k : reach + k + n]
        l1, r1 = line[reach - k - 1 : reach - k - 1 + n], line[reach + k + 1 : reach + k + 1 + n]
        near, far = half[k], half[k + 1]
        for x in range(n):
            out[x] += near * (l0[x] + r0[x]) + far * (l1[x] + r1[x])
    if reach % 2:
        l0, r0, near = line[:n], line[2 * reach : 2 * reach + n], half[reach]
        for x in range(n):
            out[x] += near * (l0[x] + r0[x])


@kernel
def _filter_rows(
    image: NDArray[Any], half: NDArray[Any], out: NDArray[Any], pad: int, stride: int, odd: bool, start: int,
    stop: int,
) -> None:  # fmt: skip
    """Rows start … stop of `out`; out[j, i] is the filtered image at row stride·j − pad, column stride·i − pad.

    First down the columns, a tile of them at a time, whose rows stay in the first cache; then along the rows.
    """
    width, reach = image.shape[1], half.size - 1
    margin, inner_width = reach + pad, width + 2 * pad
    down = np.empty((stop - start, width), image.dtype)
    line = np.empty(width + 2 * margin, image.dtype)
    across = np.empty(inner_width, image.dtype)
    for first in range(0, width, TILE):
        columns = first, min(first + TILE, width)
        for j in range(start, stop):
            _down_row(image, half, stride * j - pad, odd, columns, down[j - start])
    for j in range(start, stop):
        source, target = down[j - start], out[j]
        for x in range(width):
            line[margin + x] = source[x]
        for x in range(margin):
            place, sign, before, after = reflect(x - margin, width, odd)
            line[x] = sign * source[place] + before * source[0] + after * source[width - 1]
            place, sign, before, after = reflect(width + x, width, odd)
            line[margin + width + x] = sign * source[place] + before * source[0] + after * source[width - 1]
        if stride == 1:
            _across_row(line, half, target[:inner_width])
            continue
        _across_row(line, half, across)
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
