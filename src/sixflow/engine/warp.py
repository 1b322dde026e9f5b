"""Warp: the moved frame brought back onto the reference, and what a least-squares pass needs of it.

For every pixel x, with the dense displacement U (`blend`) and the moved frame's spline S₁ (`spline`)

    r = S₁(x + U) − I₀(x)                    residual
    (g_x, g_y) = F⁻ᵀ D ½(I₀ + S₁(x + U))     gradient of the mean of the two frames, 8th-order differences D
    q = g·U' − r                             right-hand side of the total form (q = −r in increment form)

F = I + ∂U/∂x: a displacement is counted along the axes of the moved frame, in which ∇S₁ = F⁻ᵀ ∇[S₁(x + U)]. A turn by
more than a right angle would otherwise make every pass go the wrong way. F is taken from differences of U from pixel
to pixel; where it folds the plane (det F < 0.05) it is left out.

U' is U less one plane over the whole frame, subtracted from all maps before and added to the solution
after: exact in exact arithmetic, and it keeps large displacements out of single-precision sums. D acts
on the *sampled* mean frame: noise that is stationary is uncorrelated with its own antisymmetric
difference, so that noise does not bias the solution.

Seen from the middle (`reference="middle"`) both frames are brought there by half: S₀(x − U/2) takes the place of
I₀(x), and S₁(x + U/2) that of S₁(x + U); the right-hand side still holds the whole U, and the axes of the middle
are those of both frames to first order: no F⁻ᵀ.

A pixel that has no partner (outside the moved frame, masked) gets g = 0 and a NaN residual: its weight
is missing.

A row is interpolated in runs over which the whole-pixel part of U does not change; in a run the
coefficients stand side by side in memory, and the compiler makes vector code of it.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.blend import blend_row, hermite_basis
from sixflow.engine.compiler import kernel
from sixflow.engine.fir import reflect
from sixflow.engine.spline import PAD

DERIVATIVE = (4 / 5, -1 / 5, 4 / 105, -1 / 280)
"""Half-weights of the 8th-order central difference."""

HALO = len(DERIVATIVE)
_D1, _D2, _D3, _D4 = DERIVATIVE
_PAD = PAD
LEAST_AREA = 0.05
"""det F of a map that does not press the window together."""


@kernel
def _weights(fraction: NDArray[Any], weights: NDArray[Any]) -> None:
    """B-spline weights, one row per tap; a loop each, so that the compiler makes vector code."""
    n = fraction.size
    taps = weights.shape[0]
    first, last = weights[0], weights[taps - 1]
    if taps == 4:
        for i in range(n):
            e = 1 - fraction[i]
            first[i] = e * e * e / 6
        for i in range(n):
            f = fraction[i]
            last[i] = f * f * f / 6
        w1, w2 = weights[1], weights[2]
        for i in range(n):
            f = fraction[i]
            w1[i] = (4 - 3 * f * f * (2 - f)) / 6
        for i in range(n):
            e = 1 - fraction[i]
            w2[i] = (4 - 3 * e * e * (2 - e)) / 6
        return
    for i in range(n):
        e = 1 - fraction[i]
        first[i] = e * e * e * e * e / 120
    for i in range(n):
        f = fraction[i]
        last[i] = f * f * f * f * f / 120
    w1, w2, w3, w4 = weights[1], weights[2], weights[3], weights[4]
    for i in range(n):
        f = fraction[i]
        w1[i] = (26 + f * (-50 + f * (20 + f * (20 + f * (-20 + f * 5))))) / 120
    for i in range(n):
        e = 1 - fraction[i]
        w4[i] = (26 + e * (-50 + e * (20 + e * (20 + e * (-20 + e * 5))))) / 120
    for i in range(n):
        f = fraction[i]
        w2[i] = (66 + f * f * (-60 + f * f * (30 - 10 * f))) / 120
    for i in range(n):
        e = 1 - fraction[i]
        w3[i] = (66 + e * e * (-60 + e * e * (30 - 10 * e))) / 120


@kernel
def _interpolate_run(
    coefficients: NDArray[Any],
    row: int,
    column: int,
    wx: NDArray[Any],
    wy: NDArray[Any],
    first: int,
    last: int,
    out: NDArray[Any],
) -> None:
    """Sum of taps for the pixels first … last of a row; [row, column] is the first coefficient of the
    first pixel.

    Slices are of single rows, which the compiler knows to be contiguous.
    """
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


@kernel
def warp_row(
    coefficients: NDArray[Any],
    moved_valid: NDArray[Any],
    u: NDArray[Any],
    v: NDArray[Any],
    y: int,
    scratch: NDArray[Any],
    out: NDArray[Any],
    variance: NDArray[Any],
    noise: tuple[float, float, float],
) -> None:
    """Interpolate the moved frame at (x + u, y + v) along one row; NaN where that is outside or not valid.

    Parameters
    ----------
    coefficients : array, shape (height + 2 PAD, width + 2 PAD)
    moved_valid : uint8 array, shape (height, width), or (0, 0) where every pixel is valid
    u, v : arrays, shape (width,)
    scratch : array, shape (2 (degree + 1) + 2, width)
    out : array, shape (width,)
        The interpolated row.
    variance : array, shape (width,), or (0,) where it is not wanted
        Noise variance of the interpolated value, in units of the frame's.
    noise : (float, float, float)
        From `spline.noise_variance`.
    """
    width = u.size
    rows, columns = coefficients.shape[0] - 2 * _PAD, coefficients.shape[1] - 2 * _PAD
    taps = (scratch.shape[0] - 2) // 2
    before = taps // 2 - 1
    fx, fy, wx, wy = scratch[0], scratch[1], scratch[2 : 2 + taps], scratch[2 + taps :]
    for x in range(width):
        fx[x] = u[x] - math.floor(u[x])
        fy[x] = v[x] - math.floor(v[x])
    _weights(fx, wx)
    _weights(fy, wy)
    if variance.size:
        a, b, c = noise
        for x in range(width):
            s, t = fx[x] * (1 - fx[x]), fy[x] * (1 - fy[x])
            variance[x] = (1 + s * (a + s * (b + s * c))) * (1 + t * (a + t * (b + t * c)))
    start = 0
    while start < width:
        if not (abs(u[start]) < 1e9 and abs(v[start]) < 1e9):
            out[start] = np.nan
            start += 1
            continue
        whole_u, whole_v = math.floor(u[start]), math.floor(v[start])
        stop = start + 1
        while stop < width and whole_u <= u[stop] < whole_u + 1 and whole_v <= v[stop] < whole_v + 1:
            stop += 1
        iu, iv = int(whole_u), int(whole_v)
        row = y + iv
        inside = 0 <= row < rows - 1 or row == rows - 1
        first, last = max(start, -iu), min(stop, columns - iu)
        if not inside or first >= last:
            for x in range(start, stop):
                out[x] = np.nan
            start = stop
            continue
        for x in range(start, first):
            out[x] = np.nan
        for x in range(last, stop):
            out[x] = np.nan
        _interpolate_run(
            coefficients,
            row + _PAD - before,
            first + iu + _PAD - before,
            wx,
            wy,
            first,
            last,
            out,
        )
        if row == rows - 1:  # only exactly on the last row is still inside
            for x in range(first, last):
                if fy[x] > 0:
                    out[x] = np.nan
        if last + iu == columns and fx[last - 1] > 0:
            out[last - 1] = np.nan
        if moved_valid.size:
            for x in range(first, last):
                if moved_valid[row, x + iu] == 0:
                    out[x] = np.nan
        start = stop


@kernel
def _position_row(
    maps: NDArray[Any], twist: NDArray[Any], grid: tuple[int, int, int], plane: NDArray[Any], y: int,
    basis: NDArray[Any], line: NDArray[Any], dense: NDArray[Any], whole: NDArray[Any],
) -> None:  # fmt: skip
    """Dense displacement of a row, less the plane (`dense`, shape (2, width)) and with it (`whole`)."""
    x0, y0, step = grid
    for c in range(2):
        value, slope_x, slope_y, part, target = maps[c], maps[2 + 2 * c], maps[3 + 2 * c], dense[c], whole[c]
        blend_row(value, slope_x, slope_y, twist[c], x0, y0, step, y, basis, line, part)
        base, slope = plane[c] + plane[3 + 2 * c] * y, plane[2 + 2 * c]
        for x in range(part.size):
            target[x] = part[x] + (base + slope * x)


@kernel
def _relight_row(
    lighting: NDArray[Any], grid: tuple[int, int, int], y: int, basis: NDArray[Any], line: NDArray[Any],
    tone: NDArray[Any], warped: NDArray[Any],
) -> None:  # fmt: skip
    """Take gain and offset out of a row of the warped frame; `tone` is scratch of shape (2, width)."""
    x0, y0, step = grid
    for c in range(2):
        light = lighting[c]
        blend_row(light[0], light[1], light[2], light[3], x0, y0, step, y, basis, line, tone[c])
    gain, offset = tone[0], tone[1]
    for x in range(warped.size):
        warped[x] = (warped[x] - offset[x]) / gain[x]


@kernel
def _compare_row(
    still: NDArray[Any], warped: NDArray[Any], valid: NDArray[Any], r: NDArray[Any], mean: NDArray[Any]
) -> None:
    """Residual of a row and its mean frame, continued by HALO on both sides; `valid` has size 0 or the row's."""
    width = still.size
    middle = mean[HALO : HALO + width]
    for x in range(width):
        r[x] = warped[x] - still[x]
    for x in range(width):
        middle[x] = still[x] + (r[x] / 2 if r[x] == r[x] else 0 * still[x])
    for x in range(valid.size):  # what is under the mask must not show in the gradients beside it
        if valid[x] == 0:
            middle[x] = warped[x]
            r[x] = np.nan
    for x in range(HALO):  # odd extension: the gradient goes on as it was at the border
        mean[x] = 2 * mean[HALO] - mean[2 * HALO - x]
        mean[width + HALO + x] = 2 * mean[width + HALO - 1] - mean[width + HALO - 2 - x]


@kernel
def _gradient_row(
    mean: NDArray[Any], low: int, y: int, height: int, target_x: NDArray[Any], target_y: NDArray[Any]
) -> None:
    """8th-order differences of row y of the mean frame, whose first row is `low`; the frame goes on oddly."""
    width = target_x.size
    centre = mean[y - low]
    l1, l2, l3, l4 = centre[3:], centre[2:], centre[1:], centre
    r1, r2, r3, r4 = centre[5:], centre[6:], centre[7:], centre[8:]
    for x in range(width):
        target_x[x] = (
            _D1 * (r1[x] - l1[x]) + _D2 * (r2[x] - l2[x]) + _D3 * (r3[x] - l3[x]) + _D4 * (r4[x] - l4[x])
        )
    for x in range(width):
        target_y[x] = 0
    for d in range(1, HALO + 1):
        up_row, up_sign, up_first, up_last = reflect(y - d, height, True)
        down_row, down_sign, down_first, down_last = reflect(y + d, height, True)
        up, down = mean[up_row - low, HALO:], mean[down_row - low, HALO:]
        weight = DERIVATIVE[d - 1]
        a, b = weight * down_sign, weight * up_sign
        for x in range(width):
            target_y[x] += a * down[x] - b * up[x]
        first, last = weight * (down_first - up_first), weight * (down_last - up_last)
        if first != 0:
            border = mean[0 - low, HALO:]
            for x in range(width):
                target_y[x] += first * border[x]
        if last != 0:
            border = mean[height - 1 - low, HALO:]
            for x in range(width):
                target_y[x] += last * border[x]


@kernel
def bring_strip(
    coefficients: NDArray[Any], source_valid: NDArray[Any], maps: NDArray[Any], twist: NDArray[Any],
    grid: tuple[int, int, int], plane: NDArray[Any], degree: int, noise: tuple[float, float, float],
    start: int, stop: int, out: NDArray[Any], valid: NDArray[Any], variance: NDArray[Any],
) -> None:  # fmt: skip
    """Blend maps and interpolate one frame at x + U(x), rows start … stop of the arrays at the end.

    Parameters
    ----------
    coefficients, source_valid
        Spline coefficients of the frame, and where it may be asked; (0, 0) for everywhere.
    maps, twist, grid, plane
        As for `warp_strip`.
    out : array, shape (height, width)
        0 where nothing is there.
    valid : uint8 array, shape (height, width)
    variance : array, shape (height, width)
        Noise variance of the interpolated values, in units of the frame's.
    """
    width = out.shape[1]
    dtype = out.dtype
    dense, position = np.empty((2, width), dtype), np.empty((2, width), dtype)
    line, basis = np.empty((2, maps.shape[2]), dtype), np.empty((4, grid[2]), dtype)
    hermite_basis(grid[2], basis)
    scratch = np.empty((2 * (degree + 1) + 2, width), dtype)
    for y in range(start, stop):
        _position_row(maps, twist, grid, plane, y, basis, line, dense, position)
        target, seen = out[y], valid[y]
        warp_row(coefficients, source_valid, position[0], position[1], y, scratch, target, variance[y], noise)
        for x in range(width):
            seen[x] = target[x] == target[x]
            if seen[x] == 0:
                target[x] = 0


@kernel
def _along_moved_axes(
    u_x: float, u_y: float, v_x: float, v_y: float, plane: NDArray[Any], x: int, target_x: NDArray[Any],
    target_y: NDArray[Any],
) -> None:  # fmt: skip
    """Multiply the gradient of one pixel by F⁻ᵀ."""
    one = plane.dtype.type(1)
    F_xx, F_xy, F_yx, F_yy = one + plane[2] + u_x, plane[3] + u_y, plane[4] + v_x, one + plane[5] + v_y
    area = F_xx * F_yy - F_xy * F_yx
    sound = area > plane.dtype.type(LEAST_AREA)
    inverse = one / (area if sound else one)
    g_x, g_y = target_x[x], target_y[x]
    target_x[x] = (F_yy * g_x - F_yx * g_y) * inverse if sound else g_x
    target_y[x] = (F_xx * g_y - F_xy * g_x) * inverse if sound else g_y


@kernel
def _moved_axes_row(
    before: NDArray[Any], here: NDArray[Any], after: NDArray[Any], apart: int, plane: NDArray[Any],
    target_x: NDArray[Any], target_y: NDArray[Any],
) -> None:  # fmt: skip
    """Multiply the gradients of a row by F⁻ᵀ, from its dense displacement (less the plane) and those of the rows
    beside it, `apart` rows from each other.
    """
    width, last = target_x.size, target_x.size - 1
    one, half = plane.dtype.type(1), plane.dtype.type(0.5)
    down = one / plane.dtype.type(max(apart, 1))
    u, v, u0, v0, u1, v1 = here[0], here[1], before[0], before[1], after[0], after[1]
    for x in range(1, last):
        du, dv = (u[x + 1] - u[x - 1]) * half, (v[x + 1] - v[x - 1]) * half
        _along_moved_axes(
            du, (u1[x] - u0[x]) * down, dv, (v1[x] - v0[x]) * down, plane, x, target_x, target_y
        )
    for x in range(0, width, max(last, 1)):
        left, right = max(x - 1, 0), min(x + 1, last)
        across = one / plane.dtype.type(max(right - left, 1))
        du, dv = (u[right] - u[left]) * across, (v[right] - v[left]) * across
        _along_moved_axes(
            du, (u1[x] - u0[x]) * down, dv, (v1[x] - v0[x]) * down, plane, x, target_x, target_y
        )


@kernel
def warp_strip(
    reference: NDArray[Any],
    coefficients: NDArray[Any],
    reference_valid: NDArray[Any],
    moved_valid: NDArray[Any],
    maps: NDArray[Any],
    twist: NDArray[Any],
    grid: tuple[int, int, int],
    plane: NDArray[Any],
    lighting: NDArray[Any],
    degree: int,
    total: bool,
    noise: tuple[float, float, float],
    whole: float,
    still_variance: NDArray[Any],
    start: int,
    stop: int,
    gradient_x: NDArray[Any],
    gradient_y: NDArray[Any],
    right: NDArray[Any],
    residual: NDArray[Any],
    moved: NDArray[Any],
) -> None:
    """Blend, warp, differentiate and combine the rows start … stop; the arrays at the end are written.

    Parameters
    ----------
    reference : array, shape (height, width)
    coefficients : array
        Spline coefficients of the moved frame.
    reference_valid, moved_valid : uint8 arrays of the frames' shapes, or of shape (0, 0) where every
    pixel is valid maps, twist, grid : arrays (6, …) and (2, …) of the grid, and its (x0, y0, step)
        Local affine maps, less `plane`.
    plane : array, shape (6,)
        (u, v at pixel (0, 0), u_x, u_y, v_x, v_y) subtracted from all maps.
    lighting : array, shape (2, 4, rows, columns), or of size 0 where light is steady
        Gain and offset at the grid points, moved ≈ gain·reference + offset, each with its x-slope,
        y-slope and twist.
    total : bool
        Total form (`right` = g·U' − r) or increment form (`right` = −r).
    whole : float
        The whole displacement over the part of it that the maps hold: 1, or 2 where the reference has been
        brought half way.
    still_variance : array, shape (height, width) or (0, 0)
        Noise variance of the reference's pixels in units of the frame's; 1 if not given.
    gradient_x, gradient_y, right : arrays, shape (height, width)
    residual : array, shape (height, width) or (0, 0)
        r scaled so that its variance is twice that of one frame's noise; NaN where a pixel has no partner.
    moved : array, shape (height, width) or (0, 0)
        The moved frame brought back; NaN where a pixel has no partner. Without lighting correction.
    """
    height, width = reference.shape
    step = grid[2]
    dtype = reference.dtype
    zero = dtype.type(0)
    low, high = max(0, start - HALO), min(height, stop + HALO)
    mean = np.empty((high - low, width + 2 * HALO), dtype)
    difference = np.empty((high - low, width), dtype)
    dense = np.empty((high - low, 2, width), dtype)
    line = np.empty((2, maps.shape[2]), dtype)
    basis = np.empty((4, step), dtype)
    hermite_basis(step, basis)
    scratch = np.empty((2 * (degree + 1) + 2, width), dtype)
    position, tone = np.empty((2, width), dtype), np.empty((2, width), dtype)
    warped = np.empty(width, dtype)
    variance = np.empty(width if residual.size else 0, dtype)
    everywhere = np.empty(0, np.uint8)
    for k in range(high - low):
        y = low + k
        _position_row(maps, twist, grid, plane, y, basis, line, dense[k], position)
        warp_row(coefficients, moved_valid, position[0], position[1], y, scratch, warped, variance, noise)
        if moved.size and start <= y < stop:
            target = moved[y]
            for x in range(width):
                target[x] = warped[x]
        if lighting.size:
            _relight_row(lighting, grid, y, basis, line, tone, warped)
        valid = reference_valid[y] if reference_valid.size else everywhere
        _compare_row(reference[y], warped, valid, difference[k], mean[k])
        if residual.size and start <= y < stop:
            r, target = difference[k], residual[y]
            if still_variance.size:
                still = still_variance[y]
                for x in range(width):
                    target[x] = r[x] * math.sqrt(2 / (still[x] + variance[x]))
            else:
                for x in range(width):
                    target[x] = r[x] * math.sqrt(2 / (1 + variance[x]))
    for y in range(start, stop):
        k = y - low
        target_x, target_y, target = gradient_x[y], gradient_y[y], right[y]
        _gradient_row(mean, low, y, height, target_x, target_y)
        if whole == 1:
            above, below = max(k - 1, 0), min(k + 1, high - low - 1)
            _moved_axes_row(dense[above], dense[k], dense[below], below - above, plane, target_x, target_y)
        u, v, r = dense[k, 0], dense[k, 1], difference[k]
        if reference_valid.size:  # a gradient that would need a pixel without a partner beside a masked one
            for x in range(width):
                if target_x[x] != target_x[x] or target_y[x] != target_y[x]:
                    r[x] = np.nan
                    if residual.size:
                        residual[y, x] = np.nan
        for x in range(width):
            target_x[x] = target_x[x] if r[x] == r[x] else zero
        for x in range(width):
            target_y[x] = target_y[x] if r[x] == r[x] else zero
        for x in range(width):
            target[x] = -r[x] if r[x] == r[x] else zero
        if total:
            if whole != 1:
                scale = dtype.type(whole)
                for x in range(width):
                    u[x] *= scale
                    v[x] *= scale
            for x in range(width):
                target[x] += target_x[x] * u[x] + target_y[x] * v[x]
