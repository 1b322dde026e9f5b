"""Planes: the pixels of a decoded video frame as an array, as recorded."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[Any]


def pixels_of(frame: Any) -> tuple[Array, tuple[str, ...]]:
    """Return the recorded luma, shape (h, w), or the colours of an RGB frame, shape (h, w, 3), with notes.

    Where some pixels are not opaque, alpha comes last: shape (h, w, 2) or (h, w, 4).

    Parameters
    ----------
    frame : av.VideoFrame
    """
    form = frame.format
    is_deep, has_alpha = _is_deep(form), any(component.is_alpha for component in form.components)
    opaque = 65535 if is_deep else 255
    if form.is_rgb or form.name == "pal8" or form.name.startswith(("bayer", "gbr")):
        if not has_alpha and form.name != "pal8":
            return frame.to_ndarray(format="rgb48le" if is_deep else "rgb24"), ()
        colours = frame.to_ndarray(format="rgba64le" if is_deep else "rgba")
        return (colours if (colours[..., 3] < opaque).any() else colours[..., :3]), ()
    luma, notes = luma_of(frame)
    if not has_alpha:
        return luma, notes
    alpha = frame.to_ndarray(format="rgba64le" if is_deep else "rgba")[..., 3]
    return (np.stack([luma, alpha], axis=-1) if (alpha < opaque).any() else luma), notes


def luma_of(frame: Any) -> tuple[Array, tuple[str, ...]]:
    """Return the luma of a frame, shape (h, w), as recorded, with notes."""
    form = frame.format
    note = () if len(form.components) == 1 else ("colour → recorded luma",)
    planes = [component.plane for component in form.components]
    if form.name.startswith(("gray", "yuv", "nv")) and planes.count(0) == 1:
        return _first_plane(frame), note
    # Packed or shifted samples: the same values, sorted into planes.
    return _first_plane(frame.reformat(format="yuv444p16le" if _is_deep(form) else "yuv444p")), note


def _is_deep(form: Any) -> bool:
    return max(component.bits for component in form.components) > 8


def _first_plane(frame: Any) -> Array:
    bits = frame.format.components[0].bits
    order = ">" if frame.format.name.endswith("be") else "<"
    dtype = np.dtype("u1" if bits <= 8 else order + ("u2" if bits <= 16 else "f4"))
    plane = frame.planes[0]
    rows = np.frombuffer(plane, dtype=np.uint8).reshape(-1, plane.line_size)[: frame.height]
    return rows[:, : frame.width * dtype.itemsize].copy().view(dtype)
