"""What a method found on a pair: the same form for ours and for peers.

Peers that give two numbers per pixel are read at the points of our grid, and their gradients are differences over the
distance of two grid points, as their users form them.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.convention import SIX_FROM_GRADIENT

Array = NDArray[Any]

STEP = 8
"""Distance of the grid points at which all are compared, px."""
BORDER = 16
"""Peers have no flags: points at least so far from the border count as complete, px."""


@dataclasses.dataclass(frozen=True)
class Measured:
    """A field on a grid.

    Parameters
    ----------
    x, y : array
        Columns and rows of the grid, px.
    six : float array, shape (6, rows, columns)
        u, v, divergence, curl, stretch, shear; NaN where the method gives, or stands by, no number.
    error : float array, shape (6, rows, columns), or None
        Standard errors that the method predicts.
    complete : bool array, shape (rows, columns)
        Points whose whole window lies in both frames.
    middle : bool
        The field stands on the middle frame's grid, not on frame 0's.
    seconds : float
        Time of the call.
    """

    x: Array
    y: Array
    six: Array
    error: Array | None
    complete: NDArray[np.bool_]
    middle: bool
    seconds: float

    @property
    def given(self) -> NDArray[np.bool_]:
        """Points with a displacement."""
        return np.asarray(np.isfinite(self.six[:2]).all(axis=0))


def from_dense(flow: Array, x: Array, y: Array, seconds: float) -> Measured:
    """Read a dense flow (2, height, width) on frame 0's pixels at the points of a grid; gradients are differences."""
    dense = np.asarray(flow, dtype=float)
    u, v = dense[:, y[:, None], x[None, :]]
    return from_grid(u, v, x, y, seconds, dense.shape[1:], middle=False)


def from_grid(
    u: Array, v: Array, x: Array, y: Array, seconds: float, shape: tuple[int, ...], *, middle: bool
) -> Measured:
    """Take a displacement given on a grid, NaN where it is flagged, of a frame (height, width)."""
    gradient = [np.gradient(plane, at, axis=axis) for plane in (u, v) for axis, at in ((1, x), (0, y))]
    six = np.tensordot(SIX_FROM_GRADIENT, np.stack([u, v, *gradient]), axes=1)
    inside_y, inside_x = (
        np.minimum(at, size - 1 - at) >= BORDER for at, size in zip((y, x), shape, strict=True)
    )
    return Measured(x, y, six, None, inside_y[:, None] & inside_x, middle, seconds)
