"""Compression: the note on a lossy one."""

from __future__ import annotations

from sixflow.frames.metadata import Compression

_REMEDY = "record uncompressed, or as FFV1, PNG or TIFF, for measurements"


def compression_note(compression: Compression, *, one_of_many: bool = False) -> str:
    """Return what a user should know of a lossy compression.

    Parameters
    ----------
    compression : Compression
    one_of_many : bool
        The frame is a file of its own: leave out its own noise, so that all of them say the same.

    Examples
    --------
    >>> compression_note(Compression("H.264", noise=1.23, copies=True)).split(";")[0]
    'H.264 is lossy: standard errors allow for its quantisation (about 1.23 grey), not for its pattern'
    """
    noise, codec = compression.noise, compression.codec
    if noise:
        size = "" if one_of_many else f" (about {noise:.2f} grey)"
        known = f"standard errors allow for its quantisation{size}, not for its pattern"
    else:
        known = "how much it left out is not known, and standard errors do not allow for it"
    copied = "; blocks may be copied from frame to frame" if compression.copies else ""
    return f"{codec} is lossy: {known}{copied}; {_REMEDY}"


def is_reversible(data: bytes) -> bool:
    """Tell from a JPEG 2000 codestream whether its wavelet is the one without rounding loss."""
    start = data.find(b"\xff\x4f\xff\x51")
    at = data.find(b"\xff\x52", start) if start >= 0 else -1
    return 0 <= at < len(data) - 13 and data[at + 13] == 1
