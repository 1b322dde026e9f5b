"""Limits: how large a frame a file may claim, checked before memory is taken for it.

A damaged header can claim any size. A frame may take `default_limit` bytes as it is decoded, and not more than what is
stored of it can hold: compressed data can grow only so far. Both are checked before anything is allocated.
"""

from __future__ import annotations

import os

from sixflow.errors import FrameFileError, InputError

VARIABLE = "SIXFLOW_MAX_FRAME_MIB"
"""Environment variable that raises (or lowers) the limit, MiB."""

DEFAULT_MIB = 1024
"""Limit without the variable: 1 GiB, for instance 32,768 × 32,768 px of 8 bits."""


def frame_limit() -> int:
    """Return the most bytes that one decoded frame may take.

    Raises InputError if the environment variable is no positive number.

    Examples
    --------
    >>> frame_limit() // 2**20
    1024
    """
    text = os.environ.get(VARIABLE, "").strip()
    try:
        limit = float(text) if text else float(DEFAULT_MIB)
    except ValueError:
        limit = 0.0
    if not 0 < limit < 2**40:
        raise InputError(f"{VARIABLE}={text!r}: must be a number of MiB, above 0, such as {4 * DEFAULT_MIB}")
    return int(limit * 2**20)


def check_size(
    width: int,
    height: int,
    channels: int,
    itemsize: float,
    name: str,
    *,
    stored: int | None = None,
    growth: float = 1.0,
) -> None:
    """Refuse a frame whose claimed size is beyond the limit, or beyond what is stored of it.

    Raises FrameFileError if the frame would take more than `frame_limit` bytes, or more than `stored` times `growth`.

    Parameters
    ----------
    width, height, channels : int
        As the file claims them; width and height in px.
    itemsize : float
        Bytes of one sample; less than 1 where bits are packed.
    name : str
        Of the file, for the message.
    stored : int, optional
        Bytes that the file holds of this frame, or bytes of the whole file.
    growth : float
        Most by which decoding makes them grow: 1 for pixels that are stored as they are, about 1032 for Deflate.

    Examples
    --------
    >>> check_size(640, 480, 3, 1, "a.png")
    >>> check_size(10**6, 10**6, 1, 2, "a.tif")
    Traceback (most recent call last):
    sixflow.errors.FrameFileError: a.tif: claims a frame of 1000000×1000000 px, 1907349 MiB: more than the limit...
    """
    claimed = int(width) * int(height) * max(1, int(channels)) * itemsize
    size = f"claims a frame of {width}×{height} px"
    if stored is not None and claimed > stored * growth:
        raise FrameFileError(
            f"{name}: {size}, {_mebibytes(claimed)}, of which only {stored} bytes are stored; "
            "the file is cut short or damaged: copy or export it again"
        )
    limit = frame_limit()
    if claimed > limit:
        raise FrameFileError(
            f"{name}: {size}, {_mebibytes(claimed)}: more than the limit of {_mebibytes(limit)}; if the file is right, "
            f"set the environment variable {VARIABLE} to at least {int(claimed // 2**20) + 1}, or crop the frames"
        )


def _mebibytes(size: float) -> str:
    return f"{size / 2**20:.0f} MiB" if size >= 2**20 else f"{size:.0f} bytes"
