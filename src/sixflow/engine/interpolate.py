"""Interpolate: a frame at displaced places, by its B-spline (`spline`).

The weights along y are lines, one per tap; the sum over the taps of a pixel is in `pixel`. All arithmetic is in the
type of the frame: a constant of another type would halve the lanes.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.compiler import inner, kernel
from sixflow.engine.pixel import spline_sum
from sixflow.engine.spline import PAD

_PAD = PAD
_LINES = 6
_COLUMN, _ROW, _FX, _FY, _INSIDE, _WITHIN = range(_LINES)
"""Lines of scratch: the whole and the fractional part of where a pixel comes from, and whether that is in the frame."""


class Interpolant(NamedTuple):
    """A frame between its pixels.

    Attributes
    ----------
    coefficients : array, shape (height + 2 PAD, width + 2 PAD)
        Of its B-spline.
    valid : uint8 array, shape (height, width), or (0, 0) where every pixel is valid
        Where the spline may be asked.
    noise : (float, float, float)
        From `spline.noise_variance`.
    """

    coefficients: NDArray[Any]
    valid: NDArray[np.uint8]
    noise: tuple[float, float, float]


@inner
def _cubic_weights(fraction: NDArray[Any], weights: NDArray[Any]) -> None:
    """Weights of the four coefficients around every position, one row each; a loop each, which is vector code."""
    kind = fraction.dtype.type
    one, two, three, four, sixth = kind(1), kind(2), kind(3), kind(4), kind(1 / 6)
    first, second, third, last = weights[0], weights[1], weights[2], weights[3]
    for i in range(fraction.size):
        e = one - fraction[i]
        first[i] = e * e * e * sixth
    for i in range(fraction.size):
        f = fraction[i]
        last[i] = f * f * f * sixth
    for i in range(fraction.size):
        f = fraction[i]
        second[i] = (four - three * f * f * (two - f)) * sixth
    for i in range(fraction.size):
        e = one - fraction[i]
        third[i] = (four - three * e * e * (two - e)) * sixth


@inner
def _quintic_weights(fraction: NDArray[Any], weights: NDArray[Any]) -> None:
    """Weights of the six coefficients around every position, as `_cubic_weights`."""
    kind = fraction.dtype.type
    one, share = kind(1), kind(1 / 120)
    a0, a1, a2, a3 = kind(26 / 120), kind(-50 / 120), kind(20 / 120), kind(5 / 120)
    b0, b2, b4, b5 = kind(66 / 120), kind(-60 / 120), kind(30 / 120), kind(-10 / 120)
    w0, w1, w2, w3, w4, w5 = weights[0], weights[1], weights[2], weights[3], weights[4], weights[5]
    for i in range(fraction.size):
        e = one - fraction[i]
        square = e * e
        w0[i] = square * square * e * share
    for i in range(fraction.size):
        f = fraction[i]
        square = f * f
        w5[i] = square * square * f * share
    for i in range(fraction.size):
        f = fraction[i]
        w1[i] = a0 + f * (a1 + f * (a2 + f * (a2 + f * (f * a3 - a2))))
    for i in range(fraction.size):
        e = one - fraction[i]
        w4[i] = a0 + e * (a1 + e * (a2 + e * (a2 + e * (e * a3 - a2))))
    for i in range(fraction.size):
        f = fraction[i]
        square = f * f
        w2[i] = b0 + square * (b2 + square * (b4 + b5 * f))
    for i in range(fraction.size):
        e = one - fraction[i]
        square = e * e
        w3[i] = b0 + square * (b2 + square * (b4 + b5 * e))


@inner
def _noise_row(
    fx: NDArray[Any], fy: NDArray[Any], noise: tuple[float, float, float], variance: NDArray[Any]
) -> None:
    """Noise variance of values interpolated at the fractions fx, fy, in units of the frame's."""
    kind = fx.dtype.type
    one, a, b, c = kind(1), kind(noise[0]), kind(noise[1]), kind(noise[2])
    for x in range(fx.size):
        s, t = fx[x] * (one - fx[x]), fy[x] * (one - fy[x])
        variance[x] = (one + s * (a + s * (b + s * c))) * (one + t * (a + t * (b + t * c)))


@kernel
def scratch_rows(taps: int) -> int:
    """How many rows `warp_row` wants as scratch, for so many taps a direction (degree + 1)."""
    return taps + _LINES


@inner
def _places(
    displacement: NDArray[Any], first: int, ahead: int, last: int, whole: NDArray[Any], fraction: NDArray[Any],
    inside: NDArray[Any],
) -> None:  # fmt: skip
    """Whole and fractional part of first + ahead·x + displacement[x], 0 … last, and whether it is in 0 … last.

    The last pixel is the one before it and a fraction of 1. Beyond, the places are any that can be asked.
    """
    kind = displacement.dtype.type
    zero, one, end, before, start = kind(0), kind(1), kind(last), kind(last - 1), kind(first)
    slope = kind(ahead)
    for x in range(displacement.size):
        floor = np.floor(displacement[x])
        part, place = displacement[x] - floor, (start + slope * kind(np.int32(x))) + floor
        within = (place >= zero) & ((place < end) | ((place == end) & (part == zero)))
        inside[x] = one if within else zero
        fraction[x] = part if place < end else one
        place = place if place > zero else zero  # NaN too
        whole[x] = place if place < end else before


@inner
def _sum_row(coefficients: NDArray[Any], scratch: NDArray[Any], wy: NDArray[Any], out: NDArray[Any]) -> None:
    """Splines at the places of a row; `scratch` and `wy` as `warp_row` has them."""
    flat, stride = coefficients.reshape(-1), coefficients.shape[1]
    column, row, fx = scratch[_COLUMN], scratch[_ROW], scratch[_FX]
    if wy.shape[0] == 4:
        a, b, c, d = wy[0], wy[1], wy[2], wy[3]
        for x in range(out.size):
            start = (int(row[x]) + _PAD - 1) * stride + int(column[x]) + _PAD - 1
            out[x] = spline_sum(flat, start, stride, fx[x], (a[x], b[x], c[x], d[x]))
        return
    a, b, c, d, e, f = wy[0], wy[1], wy[2], wy[3], wy[4], wy[5]
    for x in range(out.size):  # eight values are loaded, from the one before the first that counts
        start = (int(row[x]) + _PAD - 2) * stride + int(column[x]) + _PAD - 3
        out[x] = spline_sum(flat, start, stride, fx[x], (a[x], b[x], c[x], d[x], e[x], f[x]))


@inner
def warp_row(
    frame: Interpolant, u: NDArray[Any], v: NDArray[Any], y: int, scratch: NDArray[Any], out: NDArray[Any],
    variance: NDArray[Any],
) -> None:  # fmt: skip
    """Interpolate a frame at (x + u, y + v) along one row; NaN where that is outside or not valid.

    Parameters
    ----------
    frame : Interpolant
    u, v : arrays, shape (width,)
    scratch : array, shape (scratch_rows(degree + 1), width)
    out : array, shape (width,)
        The interpolated row.
    variance : array, shape (width,), or (0,) where it is not wanted
        Noise variance of the interpolated value, in units of the frame's.
    """
    rows, columns = frame.coefficients.shape[0] - 2 * _PAD, frame.coefficients.shape[1] - 2 * _PAD
    wy, fx, fy = scratch[_LINES:], scratch[_FX], scratch[_FY]
    inside, within = scratch[_INSIDE], scratch[_WITHIN]
    _places(u, 0, 1, columns - 1, scratch[_COLUMN], fx, inside)
    _places(v, y, 0, rows - 1, scratch[_ROW], fy, within)
    if wy.shape[0] == 4:
        _cubic_weights(fy, wy)
    else:
        _quintic_weights(fy, wy)
    if variance.size:
        _noise_row(fx, fy, frame.noise, variance)
    _sum_row(frame.coefficients, scratch, wy, out)
    nothing = out.dtype.type(np.nan)
    for x in range(u.size):
        out[x] = out[x] if inside[x] * within[x] > 0 else nothing
    if frame.valid.size:
        for x in range(u.size):  # every pixel around the place has to be valid: the same in all directions
            column, row = int(scratch[_COLUMN, x]), int(scratch[_ROW, x])
            left, right, top, bottom = (
                column + (fx[x] == 1),
                column + (fx[x] > 0),
                row + (fy[x] == 1),
                row + (fy[x] > 0),
            )
            above, below = frame.valid[top], frame.valid[bottom]
            valid = above[left] and above[right] and below[left] and below[right]
            if inside[x] * within[x] > 0 and not valid:
                out[x] = nothing
