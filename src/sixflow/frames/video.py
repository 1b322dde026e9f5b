"""Video files, read by PyAV: the recorded luma, with the true presentation time of every frame.

Frames are counted by reading the packets of the file once, without decoding them (`packets`). Of colour spaces with a
luma channel, that channel is returned as recorded, neither rescaled nor rounded; RGB video is returned in colour.
Depths above 8 bits are uint16 with the recorded values: 10-bit video runs from 0 to 1023. A frame whose data is
damaged, and those that are predicted from it, are `BadFrame`s (`decoder`, `dependence`).
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from sixflow.errors import FrameFileError
from sixflow.frames.bad import BadFrame
from sixflow.frames.compression import compression_note
from sixflow.frames.decoder import opened, video_stream
from sixflow.frames.dependence import frames_as_shown
from sixflow.frames.formats import FrameFile
from sixflow.frames.metadata import Compression, Metadata
from sixflow.frames.packets import Packets, read_packets
from sixflow.frames.planes import pixels_of
from sixflow.frames.quantiser import compression_of_video
from sixflow.frames.selection import Selection

Array: TypeAlias = NDArray[Any]


class VideoFile(FrameFile):
    """A video file; the first video stream counts."""

    def __init__(self, path: Path, selection: Selection = Selection()) -> None:  # noqa: B008 - it is frozen
        super().__init__(path, selection)
        self._frame_notes: tuple[str, ...] = ()

    @functools.cached_property
    def _packets(self) -> Packets:
        return read_packets(self.path)

    @functools.cached_property
    def _compression(self) -> Compression | None:
        return compression_of_video(self.path, self._packets)

    @property
    def count(self) -> int:
        """Number of frames, damaged ones too."""
        return len(self._packets.shown)

    @property
    def times(self) -> Array | None:
        """Presentation time of each frame, s; None where the time stamps cannot be right."""
        stamps = self._packets.stamps
        return None if stamps is None else np.array([float(stamp) for stamp in stamps])

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on colour, interlacing, turned pictures, lossy compression, times, and what is missing."""
        lossy = () if self._compression is None else (compression_note(self._compression),)
        return (*self._frame_notes, *lossy, *self._packets.notes)

    @functools.cached_property
    def metadata(self) -> Metadata:
        """The shape of pixels, the container's clock where it is too coarse for the times, and the compression."""
        with opened(self.path) as container:
            ratio = video_stream(container, self.path).sample_aspect_ratio
        stamps = self._packets.stamps or ()
        steps = {b - a for a, b in itertools.pairwise(stamps)}
        return Metadata(
            pixel_aspect=float(1 / ratio) if ratio else 1.0,
            time_resolution=float(self._packets.clock) if len(steps) > 1 else 0.0,
            compression=self._compression,
        )

    @property
    def detail(self) -> str:
        """Codec and mean rate."""
        stamps = self._packets.stamps or (Fraction(0),)
        span = float(stamps[-1] - stamps[0])
        rate = f", {(self.count - 1) / span:.4g} frames/s" if span > 0 else ""
        return self._packets.codec + rate

    def read(self, start: int = 0) -> Iterator[Array | BadFrame]:
        """Yield the frames from number `start` on; earlier ones are decoded and dropped.

        Raises FrameFileError if the file is no video, or holds no video stream or frames.
        """
        for number, (frame, damage) in enumerate(frames_as_shown(self.path, self._packets)):
            if number < start:
                continue
            if damage:
                yield BadFrame(
                    f"{self.path.name}[{number}]",
                    FrameFileError(
                        f"{self.path}: frame {number} cannot be used: {damage}; the file is damaged or was cut: "
                        "copy or record it again, or go without this frame"
                    ),
                )
            else:
                pixels, notes = pixels_of(frame)
                self._frame_notes = (*_notes(frame), *notes)
                yield pixels


def _notes(frame: Any) -> tuple[str, ...]:
    notes = []
    if frame.interlaced_frame:
        notes.append("interlaced: even and odd rows of a frame were taken at different times")
    if frame.rotation:
        notes.append(f"the recorded turn of {frame.rotation}° is not applied: pixels are read as stored")
    return tuple(notes)
