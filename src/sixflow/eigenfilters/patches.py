"""Patches: the square neighbourhoods of points that kernels are applied to, gathered block by block.

Beyond its borders a frame is continued by reflection about the border pixel, …cb|abcdef|ed…, so that a patch may be
centred on any pixel. Overlapping patches hold every pixel many times: they are made for so many points at once
as fit into `BLOCK_BYTES`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike, NDArray

from sixflow.errors import InputError
from sixflow.prepare.image import check_frame

BLOCK_BYTES = 32 * 2**20
"""Bytes of the patches of one frame in a block."""


def finite_frame(frame: ArrayLike, name: str = "frame") -> NDArray[np.float64]:
    """Return a frame in double precision.

    Raises InputError if it is no two-dimensional array of real numbers, is empty, or has a pixel without a value.

    Parameters
    ----------
    frame : array of real numbers, shape (height, width)
    name : str
        What the caller calls it, for the message of the error.
    """
    array = check_frame(frame, name).astype(np.float64)
    missing = int(array.size - np.count_nonzero(np.isfinite(array)))
    if missing:
        raise InputError(f"{name} has {missing} pixels that are not finite: fill them, or crop the frame")
    return array


def require_patch(shape: tuple[int, ...], radius: int) -> None:
    """Raise an InputError if the patch of a radius is larger than a frame of a shape (height, width)."""
    side = 2 * radius + 1
    if side > min(shape):
        raise InputError(
            f"radius={radius}: the patch of {side} × {side} px is larger than the frame of {shape[0]} × {shape[1]} px; "
            "use kernels of a smaller window, or a larger frame"
        )


def reflected(frame: NDArray[Any], radius: int, dtype: type[np.floating[Any]] = np.float64) -> NDArray[Any]:
    """A frame with `radius` more pixels on every side, continued by reflection; shape (height + 2 radius, …).

    Raises InputError if the patch is larger than the frame.
    """
    require_patch(frame.shape, radius)
    return np.pad(frame.astype(dtype), radius, mode="reflect")


def patch_blocks(
    frames: Sequence[NDArray[Any]],
    x: ArrayLike,
    y: ArrayLike,
    radius: int,
    dtype: type[np.floating[Any]] = np.float64,
) -> Iterator[tuple[slice, list[NDArray[Any]]]]:
    """Gather the patches of one or more frames about the same points.

    Raises InputError if the frames differ in shape, the patch is larger than they are, or a point is not a pixel of
    them.

    Parameters
    ----------
    frames : sequence of arrays, shape (height, width) each
        All of one shape, finite.
    x, y : arrays of whole numbers, shape (points,)
        Centres, px: columns and rows inside the frame.
    radius : int
        Of the patch, px; its side is n = 2 radius + 1.
    dtype : float type
        Of the patches.

    Yields
    ------
    chosen : slice
        Which of the points are in the block.
    patches : list of arrays, shape (points in the block, n²), one for each frame
        Rows (y) first, as in `FilterBank.matrix`.

    Examples
    --------
    >>> frame = np.arange(12.0).reshape(3, 4)
    >>> [(chosen, (patches,))] = patch_blocks([frame], [0], [1], radius=1)
    >>> patches.reshape(3, 3)
    array([[1., 0., 1.],
           [5., 4., 5.],
           [9., 8., 9.]])
    """
    shape = frames[0].shape
    for k, frame in enumerate(frames):
        if frame.shape != shape:
            raise InputError(
                f"frame {k} has shape {frame.shape}, frame 0 {shape}: crop them to the same size"
            )
    columns, rows = pixels("x", x, shape[1]), pixels("y", y, shape[0])
    if len(columns) != len(rows):
        raise InputError(f"x and y have {len(columns)} and {len(rows)} points: they must be as many")
    side = 2 * radius + 1
    windows = [sliding_window_view(reflected(frame, radius, dtype), (side, side)) for frame in frames]
    return _blocks(windows, columns, rows, max(1, BLOCK_BYTES // (np.dtype(dtype).itemsize * side * side)))


def _blocks(
    windows: list[NDArray[Any]], x: NDArray[Any], y: NDArray[Any], count: int
) -> Iterator[tuple[slice, list[NDArray[Any]]]]:
    for start in range(0, len(x), count):
        chosen = slice(start, start + count)
        at = y[chosen], x[chosen]
        yield chosen, [window[at].reshape(len(at[0]), -1) for window in windows]


def pixels(name: str, values: ArrayLike, size: int) -> NDArray[np.intp]:
    """Coordinates of points as indices of pixels along an axis of `size` pixels.

    Raises InputError if they are no whole numbers from 0 to size − 1, shape (points,).
    """
    array = np.asarray(values)
    if array.ndim != 1 or array.dtype.kind not in "iuf":
        raise InputError(
            f"{name} of shape {array.shape} and dtype {array.dtype}: must be numbers, shape (points,)"
        )
    wrong = ~((array >= 0) & (array <= size - 1) & (array == np.round(array)))
    if wrong.any():
        raise InputError(
            f"{name}[{int(wrong.argmax())}]={array[wrong][0]}: must be a whole pixel of the frame, 0 … {size - 1}"
        )
    return array.astype(np.intp)
