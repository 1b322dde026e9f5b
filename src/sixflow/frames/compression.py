"""Compression: what a user is told of a lossy one."""

from __future__ import annotations

from sixflow.frames.metadata import Compression

_REMEDY = "record uncompressed, or as FFV1, PNG or TIFF, for measurements"


def compression_note(compression: Compression) -> str:
    """Return what a user should know of a lossy compression."""
    noise, codec = compression.noise, compression.codec
    if noise:
        known = f"standard errors allow for its quantisation (about {noise:.2g} grey), not for its pattern"
    else:
        known = "how much it left out is not known, and standard errors do not allow for it"
    copied = "; blocks may be copied from frame to frame" if compression.copies else ""
    return f"{codec} is lossy: {known}{copied}; {_REMEDY}"
