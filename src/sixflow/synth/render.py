"""Frames of a pattern in motion, by the exact inverse of the motion: nothing is interpolated."""

from __future__ import annotations

import numpy as np

from sixflow.checks import whole
from sixflow.synth.arguments import Array, frame_shape
from sixflow.synth.motions.base import Motion
from sixflow.synth.patterns.base import Pattern, require_pattern


def render(
    pattern: Pattern,
    shape: tuple[int, int],
    motion: Motion | None = None,
    *,
    number: int | None = None,
    pixel_integration: int = 0,
) -> Array:
    """Render one frame.

    Frame 0 is the pattern at the pixel centres, I0(x) = pattern(x). A moved frame is the pattern at the
    origins of its pixels, so that I1(x + u(x)) = I0(x).

    Parameters
    ----------
    pattern : Pattern
        What is seen.
    shape : (int, int)
        Rows and columns of the frame, at least 1 each.
    motion : Motion or None
        Motion from frame 0 to this frame; None renders frame 0.
    number : int or None
        Number of the frame, for particles that only one frame shows. None: 0 without a motion, 1 with one.
    pixel_integration : int
        0: the grey value of the pixel's centre. n from 1 to 16: the mean over the area of the pixel, by n × n
        Gauss–Legendre points, as a sensor of full fill factor sees it. The motion then carries an image
        blurred by the pixel, and I1(x + u) = I0(x) holds exactly for translations only.

    Returns
    -------
    float64 array, shape (rows, columns)
        Grey values, neither clipped nor rounded.

    Raises
    ------
    InputError
        If an argument is outside its range, or the motion folds the plane inside the frame.

    Examples
    --------
    >>> from sixflow.synth import Affine, Grating
    >>> render(Grating(wavelength=8.0), (2, 3), Affine.translation(2.0, 0.0)).round(3).tolist()
    [[128.0, 163.0, 177.497], [128.0, 163.0, 177.497]]
    """
    require_pattern("pattern", pattern)
    rows, columns = frame_shape(shape)
    n = whole("pixel_integration", pixel_integration, 0, 16)
    x, y = np.meshgrid(np.arange(columns, dtype=np.float64), np.arange(rows, dtype=np.float64))
    if n == 0:
        return pattern.image(x, y, motion, number)
    nodes, weights = np.polynomial.legendre.leggauss(n)
    frame = np.zeros((rows, columns))
    for dy, wy in zip(nodes / 2, weights / 2, strict=True):
        for dx, wx in zip(nodes / 2, weights / 2, strict=True):
            frame += wx * wy * pattern.image(x + dx, y + dy, motion, number)
    return frame
