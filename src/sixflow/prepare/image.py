"""Image: a raw frame is checked, and becomes a finite floating-point image.

Pixels without a value (NaN, ±Inf) are masked: they get zero weight, not a guessed value. A constant, the mean of what
counts of the first frame, is subtracted from all frames, so that single precision is spent on contrast; values of
extreme size are multiplied by a power of two.
"""

from __future__ import annotations

import math
import os
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sixflow.engine.threads import over_strips
from sixflow.errors import BadFrameError, InputError
from sixflow.frames.masked import without_mask
from sixflow.prepare.frame import NO_MASK, both_valid

_STRIP = 64
_SMALLEST = 1e-305
LARGEST = 1e12
"""Largest distance of a grey value from the first frame's mean, in scaled grey: its square fits single precision."""


class Grey(NamedTuple):
    """How grey values become numbers to compute with: (value − constant) · scale, of a dtype."""

    constant: float
    scale: float
    dtype: Any


def check_frame(frame: ArrayLike, name: str) -> NDArray[Any]:
    """Return a frame as a 2-D real array; what is masked in a `numpy.ma` array is NaN.

    Raises
    ------
    InputError
        If it is not a 2-D array of real numbers, is empty, has no finite pixel or no contrast.
    """
    if isinstance(frame, str | bytes | os.PathLike):
        raise InputError(f"{name} is {frame!r}: give its pixels; sixflow.open_frames reads files")
    try:
        array = without_mask(frame)
    except (ValueError, TypeError) as error:
        raise InputError(f"{name}: a {type(frame).__name__} is no array of grey values ({error})") from error
    if array.dtype.kind == "f" and array.dtype.itemsize > 8:
        with np.errstate(over="ignore", under="ignore", invalid="ignore"):
            array = array.astype(np.float64)
    if array.dtype.kind not in "biuf":
        raise InputError(
            f"{name} has dtype {array.dtype}: frames are real grey values; take the real part, or luminance of colours"
        )
    if array.ndim != 2:
        raise InputError(
            f"{name} has shape {array.shape}: a frame is (height, width); reduce colours to luminance first"
        )
    if array.size == 0:
        raise InputError(f"{name} has shape {array.shape}: it holds no pixels")
    return array


def require_contrast(frame: NDArray[Any], name: str) -> None:
    """Require a frame to have texture.

    Raises
    ------
    BadFrameError
        If it has no finite pixel, or is constant.
    """
    low, high = frame.min(), frame.max()
    if not (np.isfinite(low) and np.isfinite(high)):
        finite = frame[np.isfinite(frame)]
        if not finite.size:
            raise BadFrameError(
                f"{name} has no finite pixel: all {frame.size} are NaN or infinite; check how it was read"
            )
        low, high = finite.min(), finite.max()
    if low == high:
        raise BadFrameError(
            f"{name} is constant ({low}): there is no texture to follow; check the frame or its exposure"
        )


def range_of(values: NDArray[Any], name: str) -> tuple[float, float]:
    """Return the grey constant that is taken from the frames of a recording, and the power of two that scales them.

    Squares of squares of what is left must fit single precision.

    Parameters
    ----------
    values : array of any shape
        The grey values of the first frame that count, or a sample of them.
    name : str
        For messages.

    Raises
    ------
    InputError
        If the values are so small that their differences have no digits.
    """
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        sample = values.astype(np.float64)
        finite = sample[np.isfinite(sample)]
        peak = float(np.abs(finite).max(initial=0.0))
        if not peak:
            return 0.0, 1.0
        finite = finite / peak  # whose sum is finite too
        constant = float(finite.mean())
        spread = float(np.abs(finite - constant).mean()) * peak
    if spread == 0 or 1e-3 < spread < 1e5:
        return constant * peak, 1.0
    if spread < _SMALLEST:
        raise InputError(
            f"{name} has values that differ by {spread:.1g}, which is too little to compute with: multiply all frames"
        )
    return constant * peak, 2.0 ** -round(math.log2(spread) - 5)


def within_range(
    image: NDArray[Any], valid: NDArray[np.uint8], inside: NDArray[np.uint8], scale: float, name: str
) -> NDArray[np.uint8]:
    """Return the validity of an image without pixels whose values are too large to be compared with the others.

    Parameters
    ----------
    image : array, shape (height, width)
    valid, inside : uint8 arrays of the same shape, or `NO_MASK`
        Which pixels have a value, and which the frame's mask leaves.
    scale : float
        Of the image.
    name : str
        For messages.

    Raises
    ------
    BadFrameError
        If the mask leaves pixels that are more than `LARGEST`.
    """
    largest = max(-float(image.min()), float(image.max()))
    if largest <= LARGEST:
        return valid
    beyond = np.abs(image) > LARGEST
    if not inside.size or (beyond & inside.astype(bool)).any():
        raise BadFrameError(
            f"{name} has values that differ by {largest / scale:.1g} from the first frame's, by orders more than "
            "these among themselves: give all frames in one unit, and NaN to pixels without a value"
        )
    return both_valid(valid, (~beyond).astype(np.uint8))


def to_image(frame: NDArray[Any], grey: Grey) -> tuple[NDArray[Any], NDArray[np.uint8]]:
    """Return the image of a frame, 0 where it has no value, and where it has one; arrays (height, width)."""
    constant, scale, dtype = grey
    if scale == 1:
        image: NDArray[Any] = np.empty(frame.shape, dtype)

        def subtract(a: int, b: int) -> None:
            with np.errstate(over="ignore", invalid="ignore"):  # what overflows has no value
                np.subtract(frame[a:b], constant, out=image[a:b], dtype=dtype)

        over_strips(subtract, len(frame), _STRIP)
    else:
        with np.errstate(over="ignore", under="ignore", invalid="ignore"):  # as above
            scaled = np.multiply(frame, scale, dtype=np.float64, order="C")
            image = np.subtract(scaled, constant * scale).astype(dtype)
    if frame.dtype.kind != "f":
        return image, NO_MASK
    with np.errstate(over="ignore", invalid="ignore"):
        if np.isfinite(np.dot(image.ravel(), image.ravel())):
            return image, NO_MASK
    finite = np.isfinite(image)
    if finite.all():
        return image, NO_MASK
    image[~finite] = 0
    return image, finite.astype(np.uint8)
