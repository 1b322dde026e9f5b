"""Grey frames: one number per pixel, from whatever a file or an array holds.

Colour becomes luminance, 0.2126 R + 0.7152 G + 0.0722 B (Rec. 709), taken of the stored values. It is
returned as float32 and not rounded: rounding would add noise that the camera did not make. Pixels that are wholly
transparent (alpha 0) have no value: they become NaN. Partly transparent ones keep the value that is stored.

Readers hand over four channels only where they are red, green, blue and alpha; other colour spaces they convert or
refuse themselves.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from sixflow.errors import InputError
from sixflow.frames.floor import rounding_noise

Array: TypeAlias = NDArray[Any]

LUMINANCE = np.array([0.2126, 0.7152, 0.0722], dtype=np.float32)
"""Weights of red, green and blue, Rec. 709."""


def to_grey(frame: Array, name: str) -> tuple[Array, tuple[str, ...]]:
    """Return the frame as a 2-D array, with notes on what was done to it.

    Raises InputError if the array is no frame: wrong number of dimensions or channels, no pixels, or no real numbers.

    Parameters
    ----------
    frame : array, shape (h, w) or (h, w, c)
        Integers, floats or booleans; c is 1 (grey), 2 (grey, alpha), 3 (RGB) or 4 (RGBA). Alpha is straight, not
        multiplied into the colours.
    name : str
        Name of the frame, for messages.

    Returns
    -------
    grey : array, shape (h, w)
        Integers and floats keep their type, booleans become 0 and 255 in uint8, float16, colour and frames with
        transparent pixels float32 (float64 where that needs more digits). Transparent pixels are NaN.
    notes : tuple of str

    Examples
    --------
    >>> grey, notes = to_grey(np.full((2, 2, 3), 100, dtype=np.uint8), "a.png")
    >>> grey.shape, notes
    ((2, 2), ('colour → luminance (Rec. 709)',))
    """
    frame = _as_numbers(frame, name)
    if frame.ndim == 2 and frame.size:
        return frame, ()
    if frame.ndim != 3 or not frame.size or frame.shape[2] > 4:
        raise InputError(
            f"{name}: an array of shape {frame.shape} is no frame; a frame is (h, w) grey, "
            "or (h, w, c) with c = 1 grey, 2 grey and alpha, 3 RGB or 4 RGBA"
        )
    channels = frame.shape[2]
    grey = frame[..., 0]
    notes: tuple[str, ...] = ()
    if channels >= 3:
        weights = LUMINANCE.astype(np.result_type(np.float32, frame.dtype), copy=False)
        grey, notes = frame[..., :3].astype(weights.dtype) @ weights, ("colour → luminance (Rec. 709)",)
    if channels in (1, 3):
        return grey, notes
    shown, alpha_note = _without_transparent(grey, frame[..., -1])
    return shown, (alpha_note, *notes)


def _without_transparent(grey: Array, alpha: Array) -> tuple[Array, str]:
    """Grey values with NaN where nothing is shown, and a note on the alpha channel."""
    transparent = ~(alpha > 0)
    count = int(np.count_nonzero(transparent))
    opaque = np.iinfo(alpha.dtype).max if alpha.dtype.kind in "ui" else 1.0
    partial = " partly transparent pixels keep their value" if ((alpha > 0) & (alpha < opaque)).any() else ""
    if not count:
        return grey, "alpha channel dropped" + (":" + partial if partial else "")
    shown = grey.astype(np.result_type(np.float32, grey.dtype))
    shown[transparent] = np.nan
    said = f"alpha channel: {count} transparent pixels have no value"
    return shown, said + (";" + partial if partial else "")


def luminance_rounding(frame: Array) -> float:
    """Return the standard deviation that rounding of the colours leaves in their luminance; 0 for grey frames.

    The three channels were rounded independently: that of one times √(0.2126² + 0.7152² + 0.0722²) = 0.75.
    """
    if frame.ndim != 3 or frame.shape[2] < 3 or frame.dtype.kind not in "uif":
        return 0.0
    return float(np.linalg.norm(LUMINANCE)) * rounding_noise(frame[..., :3])


def _as_numbers(frame: Array, name: str) -> Array:
    if frame.dtype == bool:
        return frame.astype(np.uint8) * np.uint8(255)
    if frame.dtype == np.float16:
        return frame.astype(np.float32)
    if frame.dtype.kind not in "uif":
        raise InputError(
            f"{name}: values of type {frame.dtype} are no grey values; give integers, floats or booleans"
        )
    native = frame.dtype.newbyteorder("=")
    return frame.astype(native, copy=False).view(native)
