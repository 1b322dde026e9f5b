"""Video files, read by PyAV: the recorded luma, with the true presentation time of every frame.

Frames are counted by reading the packets of the file once, without decoding them; each packet carries the
time stamp of its frame. Of colour spaces with a luma channel, that channel is returned as recorded, neither
rescaled nor rounded; RGB video is returned in colour. Depths above 8 bits are uint16 with the recorded
values: 10-bit video runs from 0 to 1023.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any, TypeAlias

import av
import numpy as np
from numpy.typing import NDArray

from sixflow.errors import FrameFileError
from sixflow.frames.formats import FrameFile
from sixflow.frames.selection import Selection

Array: TypeAlias = NDArray[Any]

_HIDDEN_FRAMES = {"vp8"}
"""Codecs whose packets may hold frames that are never shown; their frames are counted by decoding."""


class VideoFile(FrameFile):
    """A video file; the first video stream counts."""

    def __init__(self, path: Path, selection: Selection = Selection()) -> None:  # noqa: B008 - it is frozen
        super().__init__(path, selection)
        self._notes: tuple[str, ...] = ()
        self._has_stamps = True

    @property
    def count(self) -> int:
        """Number of frames."""
        return len(self._stamps)

    @property
    def times(self) -> Array:
        """Presentation time of each frame, s."""
        return np.array([float(stamp) for stamp in self._stamps])

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on colour, interlacing and turned pictures."""
        guessed = "the file has no time stamps: times follow from its frame rate"
        return self._notes if self._has_stamps else (*self._notes, guessed)

    @property
    def detail(self) -> str:
        """Codec and mean rate."""
        span = float(self._stamps[-1] - self._stamps[0])
        rate = f", {(self.count - 1) / span:.4g} frames/s" if span > 0 else ""
        return self._codec + rate

    @functools.cached_property
    def _codec(self) -> str:
        with _opened(self.path) as container:
            return str(_stream(container, self.path).codec_context.name)

    @functools.cached_property
    def _stamps(self) -> list[Fraction]:
        """Time stamps in the order of presentation, s."""
        with _opened(self.path) as container:
            stream = _stream(container, self.path)
            try:
                if stream.codec_context.name in _HIDDEN_FRAMES:
                    stamps = [_stamp(frame, stream) for frame in container.decode(stream)]
                else:
                    packets = container.demux(stream)
                    stamps = [_stamp(packet, stream) for packet in packets if _is_shown(packet)]
            except av.FFmpegError as error:
                raise _damaged(self.path, error) from error
        if not stamps:
            raise FrameFileError(
                f"{self.path}: the video holds no frames; it is empty or cut short: record or export it again"
            )
        if None in stamps:
            self._has_stamps = False
            rate = stream.average_rate or stream.guessed_rate or Fraction(25)
            return [number / rate for number in range(len(stamps))]
        return sorted(stamp for stamp in stamps if stamp is not None)

    def read(self, start: int = 0) -> Iterator[Array]:
        """Yield the frames from number `start` on; earlier ones are decoded and dropped.

        Raises
        ------
        FrameFileError
            If the file is no video, holds no video stream or frames, or is damaged.
        """
        expected = self._stamps
        number = -1
        with _opened(self.path) as container:
            stream = _stream(container, self.path)
            stream.thread_type = "AUTO"
            frames = container.decode(stream)
            while (frame := _next(frames, self.path, number + 1)) is not None:
                number += 1
                self._check(frame, _stamp(frame, stream), number, expected)
                if number >= start:
                    pixels, colour_note = _pixels(frame)
                    self._notes = _notes(frame) + colour_note
                    yield pixels
        if number + 1 < len(expected):
            raise FrameFileError(
                f"{self.path}: only {number + 1} of {len(expected)} frames can be decoded; "
                "the file is damaged or was cut: encode it again, for instance with ffmpeg"
            )

    def _check(self, frame: Any, stamp: Fraction | None, number: int, expected: list[Fraction]) -> None:
        """Refuse a frame that is damaged, or not the one whose time was announced."""
        found = "cannot be decoded completely" if frame.is_corrupt else ""
        if number >= len(expected):
            found = f"is more than the {len(expected)} that were announced"
        elif self._has_stamps and stamp is not None and stamp != expected[number]:
            found = f"is of time {float(stamp):.6g} s where {float(expected[number]):.6g} s was announced"
        if found:
            raise FrameFileError(
                f"{self.path}: frame {number} {found}; the file is damaged or was cut: "
                "encode it again, for instance with ffmpeg"
            )


def _opened(path: Path) -> Any:
    try:
        return av.open(str(path), mode="r")
    except av.FFmpegError as error:
        raise FrameFileError(
            f"{path}: cannot be read as a video ({error.strerror}); it is damaged, incomplete or of another "
            "type than its suffix tells: copy it again, or encode it again, for instance with ffmpeg"
        ) from error


def _stream(container: Any, path: Path) -> Any:
    for stream in container.streams.video:
        if not stream.disposition & stream.disposition.attached_pic:
            if stream.codec_context is None:
                raise FrameFileError(
                    f"{path}: its codec is unknown; encode the video again, for instance with ffmpeg"
                )
            return stream
    raise FrameFileError(f"{path}: holds no video, only {_content(container)}; give a file with pictures")


def _content(container: Any) -> str:
    return ", ".join(sorted({stream.type for stream in container.streams})) or "an empty container"


def _damaged(path: Path, error: Any, number: int | None = None) -> FrameFileError:
    where = "" if number is None else f" at frame {number}"
    return FrameFileError(
        f"{path}: the video is damaged{where} ({error.strerror}); encode it again, for instance with ffmpeg"
    )


def _next(frames: Iterator[Any], path: Path, number: int) -> Any:
    try:
        return next(frames, None)
    except av.FFmpegError as error:
        raise _damaged(path, error, number) from error


def _is_shown(packet: Any) -> bool:
    """Tell the packets of frames from the empty last one and from those that an edit list cuts away."""
    return packet.size > 0 and not packet.is_discard


def _stamp(item: Any, stream: Any) -> Fraction | None:
    """Presentation time of a packet or frame, s."""
    return None if item.pts is None else item.pts * Fraction(item.time_base or stream.time_base)


def _pixels(frame: Any) -> tuple[Array, tuple[str, ...]]:
    """Return the recorded luma, shape (h, w), or the colours of an RGB frame, shape (h, w, 3)."""
    form = frame.format
    is_deep = max(component.bits for component in form.components) > 8
    if form.is_rgb or form.name == "pal8" or form.name.startswith(("bayer", "gbr")):
        return frame.to_ndarray(format="rgb48le" if is_deep else "rgb24"), ()
    note = () if len(form.components) == 1 else ("colour → recorded luma",)
    planes = [component.plane for component in form.components]
    if form.name.startswith(("gray", "yuv", "nv")) and planes.count(0) == 1:
        return _first_plane(frame), note
    # Packed or shifted samples: the same values, sorted into planes.
    return _first_plane(frame.reformat(format="yuv444p16le" if is_deep else "yuv444p")), note


def _first_plane(frame: Any) -> Array:
    bits = frame.format.components[0].bits
    order = ">" if frame.format.name.endswith("be") else "<"
    dtype = np.dtype("u1" if bits <= 8 else order + ("u2" if bits <= 16 else "f4"))
    plane = frame.planes[0]
    rows = np.frombuffer(plane, dtype=np.uint8).reshape(-1, plane.line_size)[: frame.height]
    return rows[:, : frame.width * dtype.itemsize].copy().view(dtype)


def _notes(frame: Any) -> tuple[str, ...]:
    notes = []
    if frame.interlaced_frame:
        notes.append("interlaced: even and odd rows of a frame were taken at different times")
    if frame.rotation:
        notes.append(f"the recorded turn of {frame.rotation}° is not applied: pixels are read as stored")
    return tuple(notes)
