"""Interpolate: a frame at displaced places, by its B-spline (`spline`).

A row is interpolated in runs over which the whole-pixel part of the displacement does not change; in a run the
coefficients stand side by side in memory, and the compiler makes vector code of it. All arithmetic is in the type of
the frame: a constant of another type would halve the lanes.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.compiler import inner, kernel
from sixflow.engine.lines import fill_line
from sixflow.engine.spline import PAD

_PAD = PAD
_FRACTIONS = 4  # rows of scratch for the whole and the fractional part of u and v


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
def _interpolate_run(
    coefficients: NDArray[Any], row: int, column: int, wx: NDArray[Any], wy: NDArray[Any], run: tuple[int, int],
    out: NDArray[Any],
) -> None:  # fmt: skip
    """Sum of taps for the pixels `run` of a row; [row, column] is the first coefficient of the first of them.

    Slices are of single rows, which the compiler knows to be contiguous.
    """
    first, last = run
    n = last - first
    target = out[first:last]
    for i in range(n):
        target[i] = 0
    taps = wx.shape[0]
    w0, w1, w2, w3 = wx[0][first:last], wx[1][first:last], wx[2][first:last], wx[3][first:last]
    for j in range(taps):
        source = coefficients[row + j]
        w = wy[j][first:last]
        c0, c1 = source[column : column + n], source[column + 1 : column + 1 + n]
        c2, c3 = source[column + 2 : column + 2 + n], source[column + 3 : column + 3 + n]
        for i in range(n):
            target[i] += w[i] * (w0[i] * c0[i] + w1[i] * c1[i] + w2[i] * c2[i] + w3[i] * c3[i])
        if taps == 6:
            w4, w5 = wx[4][first:last], wx[5][first:last]
            c4, c5 = source[column + 4 : column + 4 + n], source[column + 5 : column + 5 + n]
            for i in range(n):
                target[i] += w[i] * (w4[i] * c4[i] + w5[i] * c5[i])


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
    return 2 * taps + _FRACTIONS


@kernel
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
    width = u.size
    rows, columns = frame.coefficients.shape[0] - 2 * _PAD, frame.coefficients.shape[1] - 2 * _PAD
    taps = (scratch.shape[0] - _FRACTIONS) // 2
    before = taps // 2 - 1
    whole_u, whole_v, fx, fy = scratch[0], scratch[1], scratch[2], scratch[3]
    wx, wy = scratch[_FRACTIONS : _FRACTIONS + taps], scratch[_FRACTIONS + taps :]
    for x in range(width):
        whole_u[x] = np.floor(u[x])
        fx[x] = u[x] - whole_u[x]
    for x in range(width):
        whole_v[x] = np.floor(v[x])
        fy[x] = v[x] - whole_v[x]
    if taps == 4:
        _cubic_weights(fx, wx)
        _cubic_weights(fy, wy)
    else:
        _quintic_weights(fx, wx)
        _quintic_weights(fy, wy)
    if variance.size:
        _noise_row(fx, fy, frame.noise, variance)
    start = 0
    while start < width:
        run_u, run_v = whole_u[start], whole_v[start]
        if not (abs(run_u) < 1e9 and abs(run_v) < 1e9):
            out[start] = np.nan
            start += 1
            continue
        stop = start + 1
        while stop < width and whole_u[stop] == run_u and whole_v[stop] == run_v:
            stop += 1
        across, row = int(run_u), y + int(run_v)
        first, last = max(start, -across), min(stop, columns - across)
        if row < 0 or row >= rows or first >= last:
            fill_line(out, start, stop, np.nan)
            start = stop
            continue
        fill_line(out, start, first, np.nan)
        fill_line(out, last, stop, np.nan)
        place = first + across + _PAD - before
        _interpolate_run(frame.coefficients, row + _PAD - before, place, wx, wy, (first, last), out)
        if row == rows - 1:  # only exactly on the last row is still inside
            for x in range(first, last):
                if fy[x] > 0:
                    out[x] = np.nan
        if last + across == columns and fx[last - 1] > 0:
            out[last - 1] = np.nan
        if frame.valid.size:
            for x in range(first, last):
                if frame.valid[row, x + across] == 0:
                    out[x] = np.nan
        start = stop
