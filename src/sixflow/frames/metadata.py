"""Metadata: what a recording says of itself besides its pixels."""

from __future__ import annotations

import dataclasses


@dataclasses.dataclass(frozen=True)
class Compression:
    """A lossy compression, and what it leaves in the pixels.

    Attributes
    ----------
    codec : str
        Its name, for notes: "JPEG", "h264".
    noise : float
        Standard deviation of the error that quantisation leaves in a pixel, grey values; 0 where it is unknown.
    copies : bool
        Whether blocks of pixels may be copied from one frame to the next (skipped blocks of a video).
    """

    codec: str
    noise: float = 0.0
    copies: bool = False


@dataclasses.dataclass(frozen=True)
class Metadata:
    """What a file, or a recording, states; None and the defaults where it states nothing.

    Attributes
    ----------
    pixel_size : float or None
        Side of a pixel along x in the object, in `length_unit`.
    length_unit : str or None
        Such as "µm".
    frame_interval : float or None
        Time between successive frames, s.
    pixel_aspect : float
        Height of a pixel over its width.
    time_resolution : float
        Unit in which the file counts time, s; its time stamps may be off by half of it. 0: as exact as the numbers.
    compression : Compression or None
        The lossy compression that the pixels went through, if any.
    """

    pixel_size: float | None = None
    length_unit: str | None = None
    frame_interval: float | None = None
    pixel_aspect: float = 1.0
    time_resolution: float = 0.0
    compression: Compression | None = None
