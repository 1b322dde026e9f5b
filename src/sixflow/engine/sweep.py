"""Sweep: one pass over the pixels, the moved frame brought back onto the reference and what least squares needs of it.

For every pixel x, with the dense displacement U (`blend`) and the moved frame's spline S₁ (`interpolate`)

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

Seen from the middle both frames are brought there by half: S₀(x − U/2) takes the place of I₀(x), and S₁(x + U/2) that
of S₁(x + U); the right-hand side still holds the whole U, and the axes of the middle are those of both frames to first
order: no F⁻ᵀ.

A pixel that has no partner (outside the moved frame, masked) gets g = 0 and a NaN residual: its weight is missing.

Rows are worked on in order; the last nine, which the differences along y need, are kept (`Rows`). What comes out of a
strip goes into images (`image_strip`), which are summed into node moments while they are in the cache (`moment_strip`).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.blend import blend_line, blender
from sixflow.engine.compiler import inner, kernel
from sixflow.engine.interpolate import Interpolant, scratch_rows, warp_row
from sixflow.engine.lines import copy_line
from sixflow.engine.moments import Cells, Part, add_cell_row, plane_count, scratch_of
from sixflow.engine.rows import (
    HALO,
    KEPT,
    KINDS,
    MEAN,
    SCALED,
    STILL,
    WARPED,
    U,
    compare_row,
    gradient_row,
    moved_axes_row,
    right_row,
    shifted_rows,
    still_row,
)
from sixflow.engine.weigh import NEGLIGIBLE

LINES = 9
"""Lines of a row that moments are summed of; the last two for the sandwich alone."""

_GX, _GY, _RIGHT, _SIZE, _COUNTED, _I0, _I1, _RX, _RY = range(LINES)

NORMAL = ((_GX, _GX), (_GX, _GY), (_GY, _GY), (_GX, _RIGHT), (_GY, _RIGHT))
SANDWICH = ((_RX, _RX), (_RX, _RY), (_RY, _RY))
STATISTICS = (
    (_COUNTED, _COUNTED), (_SIZE, _COUNTED), (_SIZE, _SIZE), (_I0, _COUNTED), (_I0, _I0),
    (_I1, _COUNTED), (_I1, _I1), (_I0, _I1),
)  # fmt: skip
"""Products of lines: of g and q; of r g; of 1, |r|, I₀ and I₁."""
OF_REFERENCE = 5
"""How many of the statistics, from the first, need no I₁."""
ON_GRADIENTS = ((_RX, _RX), (_RY, _RY))
"""Products of r g, for the residual's power where the gradient is."""

NORMAL_RANKS, SANDWICH_RANKS, POWER_RANKS = (3, 2, 0), (3, 0, 0), (0, 0, 2)


class Pair(NamedTuple):
    """The two frames.

    Attributes
    ----------
    image : array, shape (height, width)
        The reference.
    valid : uint8 array of the same shape, or (0, 0) where every pixel is valid
        Of the reference.
    still, moved : Interpolant
        The reference between its pixels, which is asked from the middle alone; the moved frame.
    """

    image: NDArray[Any]
    valid: NDArray[np.uint8]
    still: Interpolant
    moved: Interpolant


class Motion(NamedTuple):
    """The motion and the light as they are known.

    Attributes
    ----------
    maps, twist : arrays, shape (6, rows, columns), (2, rows, columns)
        Local affine maps less `plane`, and their mixed derivatives; half of them where seen from the middle.
    grid : (int, int, int)
        x0, y0, step.
    plane : array, shape (6,)
        (u, v at pixel (0, 0), u_x, u_y, v_x, v_y), subtracted from all maps.
    light : array, shape (8, rows, columns), or of size 0 where light is steady
        Gain and offset at the grid points, moved ≈ gain·reference + offset, with their slopes and twists: like the six
        planes of `maps` and the two of `twist`.
    """

    maps: NDArray[Any]
    twist: NDArray[Any]
    grid: tuple[int, int, int]
    plane: NDArray[Any]
    light: NDArray[Any]


class Form(NamedTuple):
    """What is asked: `taps` of the spline (degree + 1); the total form, or increments; seen from the middle, or not."""

    taps: int
    total: bool
    central: bool


class Images(NamedTuple):
    """What a sweep finds at every pixel; arrays of shape (height, width).

    Attributes
    ----------
    gradient_x, gradient_y, right : arrays
        0 where a pixel has no partner.
    residual : array
        r scaled so that its variance is twice that of one frame's noise; NaN where a pixel has no partner.
    still : array
        The reference as it was compared: at its own pixels, or brought to the middle.
    warped : array
        The moved frame brought back, before its light is corrected; NaN where a pixel has no partner.
    """

    gradient_x: NDArray[Any]
    gradient_y: NDArray[Any]
    right: NDArray[Any]
    residual: NDArray[Any]
    still: NDArray[Any]
    warped: NDArray[Any]


@inner
def _lines_row(
    seen: tuple[NDArray[Any], NDArray[Any], NDArray[Any]],
    lines: NDArray[Any],
    row: int,
    left: int,
    sandwich: bool,
) -> None:
    """Fill the lines that moments are summed of, but for gradient and right-hand side, in row `row` of the cells.

    `seen` has residual, reference and warped frame of the row, which goes to the columns from `left`.
    """
    residual, still, warped = seen
    width = residual.size
    zero, one = residual.dtype.type(0), residual.dtype.type(1)
    size, counted = lines[_SIZE, row][left : left + width], lines[_COUNTED, row][left : left + width]
    i0, i1 = lines[_I0, row][left : left + width], lines[_I1, row][left : left + width]
    for x in range(width):
        counted[x] = one if residual[x] == residual[x] else zero
    for x in range(width):
        size[x] = abs(residual[x]) if residual[x] == residual[x] else zero
    for x in range(width):
        i0[x] = still[x] if residual[x] == residual[x] else zero
    for x in range(width):
        i1[x] = warped[x] if residual[x] == residual[x] else zero
    if sandwich:
        for gradient, product in ((_GX, _RX), (_GY, _RY)):
            g, target = lines[gradient, row][left : left + width], lines[product, row][left : left + width]
            for x in range(width):
                target[x] = size[x] * g[x]


@kernel
def image_strip(pair: Pair, motion: Motion, form: Form, start: int, stop: int, images: Images) -> None:
    """Sweep the rows start … stop.

    Parameters
    ----------
    pair : Pair
    motion : Motion
    form : Form
    images : Images
        Written; their first row is row `start` of the frame. `still` is written where seen from the middle alone.
    """
    height, width = pair.image.shape
    kind, masked = pair.image.dtype, form.central or pair.valid.size > 0
    kept = np.empty((KINDS, KEPT, width + 2 * HALO), kind)
    position, variance, lit = np.empty((2, width), kind), np.ones((2, width), kind), np.empty(width, kind)
    scratch, step = np.empty((scratch_rows(form.taps), width), kind), motion.grid[2]
    work, lamp = blender(motion.maps, step, width), blender(motion.maps, step, width)
    everywhere, whole = np.empty(0, np.uint8), (2.0 if form.central else 1.0) if form.total else 0.0
    ahead = max(0, start - HALO)
    for y in range(start, stop):
        while ahead < min(height, y + HALO + 1):
            place = ahead % KEPT
            for c in range(2):
                blend_line(motion.maps, motion.twist, motion.grid, ahead, c, work, kept[U + c, place][:width])
            shifted_rows(kept, place, motion.plane, ahead, position)
            for frame in range(2 if form.central else 1):  # the moved one, then the still one
                asked, row = (pair.moved, lit) if frame == 0 else (pair.still, kept[STILL, place][:width])
                warp_row(asked, position[0], position[1], ahead, scratch, row, variance[1 - frame])
                for x in range(width if form.central else 0):
                    position[0, x], position[1, x] = -position[0, x], -position[1, x]
            copy_line(lit, kept[WARPED, place], width)
            if not form.central:
                valid = pair.valid[ahead] if masked else everywhere
                still_row(pair.image[ahead], valid, kept[STILL, place])
            if motion.light.size:
                for c in range(2):
                    blend_line(motion.light[:6], motion.light[6:], motion.grid, ahead, c, lamp, scratch[c])
                gain, offset = scratch[0], scratch[1]
                for x in range(width):
                    lit[x] = (lit[x] - offset[x]) / gain[x]
            compare_row(kept, place, lit, variance)
            ahead += 1
        place, k = y % KEPT, y - start
        gradient_x, gradient_y = images.gradient_x[k], images.gradient_y[k]
        gradient_row(kept[MEAN], y, height, gradient_x, gradient_y)
        if not form.central:
            moved_axes_row(kept, y, height, motion.plane, gradient_x, gradient_y, scratch)
        right_row(kept, place, whole, masked, gradient_x, gradient_y, images.right[k])
        copy_line(kept[SCALED, place], images.residual[k], width)
        copy_line(kept[WARPED, place], images.warped[k], width)
        if form.central:
            still, target = kept[STILL, place], images.still[k]
            for x in range(width):
                target[x] = still[x] if still[x] == still[x] else 0


@inner
def _weigh_row(
    images: Images, weight: NDArray[Any], y: int, root: NDArray[Any], residual: NDArray[Any], lines: NDArray[Any],
    place: tuple[int, int],
) -> None:  # fmt: skip
    """Row y of the images times √ω: gradient and right-hand side into the lines, row and column `place`, residual."""
    kind, (t, a) = root.dtype.type, place
    if weight.size:
        w, least, zero = weight[y], kind(NEGLIGIBLE), kind(0)
        for x in range(root.size):
            root[x] = np.sqrt(w[x]) if w[x] >= least else zero
    for line, image in ((_GX, images.gradient_x), (_GY, images.gradient_y), (_RIGHT, images.right)):
        target, source = lines[line, t][a : a + root.size], image[y]
        for x in range(root.size):
            target[x] = source[x] * root[x]
    r, nothing = images.residual[y], kind(np.nan)
    for x in range(root.size):
        residual[x] = r[x] * root[x] if root[x] > 0 else nothing


@kernel
def moment_strip(
    images: Images, weight: NDArray[Any], recipes: tuple[Cells, Cells, Cells], part: Part,
    sums: tuple[NDArray[Any], NDArray[Any], NDArray[Any]], edges: tuple[NDArray[Any], NDArray[Any], NDArray[Any]],
) -> None:  # fmt: skip
    """Sum rows of images, with pixel weights ω, into node moments.

    Gradient, right-hand side and residual are multiplied by √ω: the normal equations then have ω, the sandwich ω². A
    pixel with almost no weight has none, like one without a partner.

    Parameters
    ----------
    images : Images
        Of the rows of the part.
    weight : array of their shape, or (0, 0) for 1 everywhere
    recipes : three Cells
        `NORMAL`, `STATISTICS` and `SANDWICH` or `ON_GRADIENTS`.
    part : Part
    sums : three arrays, shape (node rows, planes · nodes)
        Added to, in the node rows of the part but the last; the third may be of size 0, for no sandwich.
    edges : three arrays, shape (planes · nodes,)
        Receive the part's share of its last node row, which it has in common with the part below.
    """
    width, kind = images.right.shape[1], images.right.dtype
    b, left, sandwich = recipes[0].spacing, -part.origin[0], edges[2].size > 0
    count = edges[0].size // plane_count(recipes[0].ranks) - 1
    lines, scratch = np.zeros((LINES, b, count * b), kind), scratch_of(recipes[1], count)
    root, residual = np.ones(width, kind), np.empty(width, kind)
    for cell in range(part.cells[0], part.cells[1]):
        top = part.origin[1] + cell * b
        first, last = max(part.rows[0], top), min(part.rows[1], top + b)
        if first >= last:
            continue
        for y in range(first, last):
            row = y - part.rows[0]
            _weigh_row(images, weight, row, root, residual, lines, (y - top, left))
            _lines_row((residual, images.still[row], images.warped[row]), lines, y - top, left, sandwich)
        for k in range(3 if sandwich else 2):
            below = sums[k][cell + 1] if cell + 1 < part.cells[1] else edges[k]
            add_cell_row(lines, (first - top, last - top), recipes[k], scratch, sums[k][cell], below)
