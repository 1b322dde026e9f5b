"""Rows: what a sweep does to single rows of pixels (`sweep`, where the formulas are).

The last nine rows of every kind are kept, row y at y mod 9: the differences along y need them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.compiler import inner
from sixflow.engine.fir import reflect
from sixflow.engine.lines import copy_line, fill_line

DERIVATIVE = (4 / 5, -1 / 5, 4 / 105, -1 / 280)
"""Half-weights of the 8th-order central difference."""

HALO = len(DERIVATIVE)
KEPT = 2 * HALO + 1
LEAST_AREA = 0.05
"""det F of a map that does not press the window together."""

KINDS = 7
MEAN, RESIDUAL, SCALED, STILL, WARPED, U, V = range(KINDS)
"""Rows that are kept: the mean frame, which goes on by HALO on both sides; the residual, as it is and in units of the
noise; both frames; the displacement less the plane.
"""


@inner
def still_row(image: NDArray[Any], valid: NDArray[Any], still: NDArray[Any]) -> None:
    """A row of the reference at its own pixels; NaN where it does not count. `valid` is a row, or of size 0."""
    copy_line(image, still, image.size)
    for x in range(valid.size):
        if valid[x] == 0:
            still[x] = np.nan


@inner
def shifted_rows(kept: NDArray[Any], place: int, plane: NDArray[Any], y: int, position: NDArray[Any]) -> None:
    """Displacement of a row, with the plane that the maps are less; shape (2, width)."""
    kind, width = plane.dtype.type, position.shape[1]
    for c in range(2):
        part, target = kept[U + c, place], position[c]
        base, slope = plane[c] + plane[3 + 2 * c] * kind(y), plane[2 + 2 * c]
        for x in range(width):
            target[x] = part[x] + (base + slope * kind(np.int32(x)))


@inner
def compare_row(kept: NDArray[Any], place: int, lit: NDArray[Any], variance: NDArray[Any]) -> None:
    """Residual of a row, and its mean frame, continued by HALO on both sides.

    The mean is that of one frame where the other has no value: what is under a mask must not show in the gradients
    beside it.
    """
    width, kind = lit.size, lit.dtype.type
    still, r, scaled, mean = (
        kept[STILL, place],
        kept[RESIDUAL, place],
        kept[SCALED, place],
        kept[MEAN, place],
    )
    first, second = variance[0], variance[1]
    half, two = kind(0.5), kind(2)
    middle = mean[HALO : HALO + width]
    for x in range(width):
        r[x] = lit[x] - still[x]
        scaled[x] = (lit[x] - still[x]) * np.sqrt(two / (first[x] + second[x]))
    for x in range(width):
        one = still[x] if still[x] == still[x] else lit[x]
        middle[x] = still[x] + half * r[x] if r[x] == r[x] else one
    for x in range(HALO):  # odd extension: the gradient goes on as it was at the border
        mean[x] = two * mean[HALO] - mean[2 * HALO - x]
        mean[width + HALO + x] = two * mean[width + HALO - 1] - mean[width + HALO - 2 - x]


@inner
def gradient_row(
    mean: NDArray[Any], y: int, height: int, target_x: NDArray[Any], target_y: NDArray[Any]
) -> None:
    """8th-order differences of row y of the mean frame, row y at y mod 9; the frame goes on oddly."""
    width, kind = target_x.size, mean.dtype.type
    fill_line(target_x, 0, width, 0.0)
    fill_line(target_y, 0, width, 0.0)
    centre = mean[y % KEPT]
    for d in range(1, HALO + 1):
        weight = kind(DERIVATIVE[d - 1])
        left, right = centre[HALO - d : HALO - d + width], centre[HALO + d : HALO + d + width]
        for x in range(width):
            target_x[x] += weight * (right[x] - left[x])
        up_row, up_sign, up_first, up_last = reflect(y - d, height, True)
        down_row, down_sign, down_first, down_last = reflect(y + d, height, True)
        up, down = mean[up_row % KEPT][HALO:], mean[down_row % KEPT][HALO:]
        a, b = weight * kind(down_sign), weight * kind(up_sign)
        for x in range(width):
            target_y[x] += a * down[x] - b * up[x]
        for times, border_row in ((down_first - up_first, 0), (down_last - up_last, height - 1)):
            if times != 0:
                border, share = mean[border_row % KEPT][HALO:], weight * kind(times)
                for x in range(width):
                    target_y[x] += share * border[x]


@inner
def moved_axes_row(
    kept: NDArray[Any], y: int, height: int, plane: NDArray[Any], target_x: NDArray[Any], target_y: NDArray[Any],
    slopes: NDArray[Any],
) -> None:  # fmt: skip
    """Multiply the gradients of a row by F⁻ᵀ, from the dense displacement of the rows around it.

    `slopes` is scratch of shape (2, width), for ∂u/∂x and ∂v/∂x.
    """
    above, place, below = max(y - 1, 0), y % KEPT, min(y + 1, height - 1)
    width, kind = target_x.size, plane.dtype.type
    one, half, steep = kind(1), kind(0.5), kind(1 / max(below - above, 1))
    above, below = above % KEPT, below % KEPT
    for c in range(2):
        line, slope = kept[U + c, place], slopes[c]
        for x in range(1, width - 1):
            slope[x] = (line[x + 1] - line[x - 1]) * half
        slope[0], slope[width - 1] = (
            line[min(1, width - 1)] - line[0],
            line[width - 1] - line[max(width - 2, 0)],
        )
    u_x, v_x = slopes[0], slopes[1]
    u0, v0, u1, v1 = kept[U, above], kept[V, above], kept[U, below], kept[V, below]
    for x in range(width):
        F_xx, F_xy = one + plane[2] + u_x[x], plane[3] + (u1[x] - u0[x]) * steep
        F_yx, F_yy = plane[4] + v_x[x], one + plane[5] + (v1[x] - v0[x]) * steep
        area = F_xx * F_yy - F_xy * F_yx
        sound = area > kind(LEAST_AREA)
        inverse = one / (area if sound else one)
        g_x, g_y = target_x[x], target_y[x]
        target_x[x] = (F_yy * g_x - F_yx * g_y) * inverse if sound else g_x
        target_y[x] = (F_xx * g_y - F_xy * g_x) * inverse if sound else g_y


@inner
def right_row(
    kept: NDArray[Any], place: int, whole: float, masked: bool, target_x: NDArray[Any], target_y: NDArray[Any],
    right: NDArray[Any],
) -> None:  # fmt: skip
    """Right-hand side q = whole·g·U' − r of a row; takes the gradient from pixels without a partner.

    Where there is a mask, a pixel whose gradient would need one without a value has no partner either.
    """
    r, scaled, u, v = kept[RESIDUAL, place], kept[SCALED, place], kept[U, place], kept[V, place]
    width, kind = right.size, right.dtype.type
    zero, nothing, share = kind(0), kind(np.nan), kind(whole)
    if masked:
        for x in range(width):
            lacking = target_x[x] != target_x[x] or target_y[x] != target_y[x]
            r[x] = nothing if lacking else r[x]
        for x in range(width):
            scaled[x] = scaled[x] if r[x] == r[x] else nothing
    for x in range(width):
        target_x[x] = target_x[x] if r[x] == r[x] else zero
    for x in range(width):
        target_y[x] = target_y[x] if r[x] == r[x] else zero
    for x in range(width):
        right[x] = ((target_x[x] * u[x] + target_y[x] * v[x]) * share - r[x]) if r[x] == r[x] else zero
