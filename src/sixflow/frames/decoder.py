"""Decoder: packets become frames, one packet at a time, and damage is reported.

A decoder tells damage in three ways: it refuses the packet, marks the frame that it makes of it, or writes a line to
the log. The log counts for codecs of which every frame stands by itself or no bit may be lost. Motion JPEG tells hardly
anything: its packets are checked by `jpeg`. Codecs without any check (raw video, Huffyuv, VP8, VP9) cannot tell.

Decoding uses one thread, so that what is said belongs to the packet that was given.
"""

from __future__ import annotations

import contextlib
import dataclasses
import logging
import threading
from collections.abc import Iterator, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import av

from sixflow.errors import FrameFileError
from sixflow.frames.jpeg import damage_of_jpeg
from sixflow.frames.limits import check_size, frame_limit

_CHECKS = "crccheck+bitstream+buffer+careful"

_STRICT = {"mjpeg", "hevc"}
"""Codecs that are to refuse what they doubt ("explode"), besides those whose log counts. The others mark the frame:
some cameras write remarks into H.264 for which its decoder would refuse whole frames."""

_FOREIGN = (av.FFmpegError, ValueError, MemoryError, OverflowError)
"""What PyAV raises for damaged files."""


@dataclasses.dataclass(frozen=True)
class Packet:
    """An encoded frame: times of its presentation and of its decoding, s, and what it says of itself."""

    stamp: Fraction | None
    decoding: Fraction | None
    shown: bool
    is_key: bool
    is_cut: bool
    is_disposable: bool

    @classmethod
    def of(cls, packet: Any, stream: Any) -> Packet:
        """Take over what PyAV knows of a packet."""
        base = Fraction(packet.time_base or stream.time_base)
        stamp, decoding = (None if value is None else value * base for value in (packet.pts, packet.dts))
        return cls(
            stamp,
            decoding,
            not packet.is_discard,
            packet.is_keyframe,
            packet.is_corrupt,
            packet.is_disposable,
        )


@contextlib.contextmanager
def opened(path: Path) -> Iterator[Any]:
    """Open a video file; FrameFileError if it cannot be opened."""
    try:
        container = av.open(str(path), mode="r", metadata_errors="replace")
    except (*_FOREIGN, LookupError, OSError) as error:
        raise FrameFileError(
            f"{path}: cannot be read as a video ({_reason(error)}); it is damaged, incomplete or of another "
            "type than its suffix tells: copy it again, or encode it again, for instance with ffmpeg"
        ) from error
    with contextlib.closing(container):
        yield container


def video_stream(container: Any, path: Path) -> Any:
    """Return the first video stream that is no cover picture.

    Raises FrameFileError if there is none, its codec is unknown, or its pictures are larger than the limit.
    """
    for stream in container.streams.video:
        if stream.disposition & stream.disposition.attached_pic:
            continue
        context = stream.codec_context
        if context is None:
            raise FrameFileError(
                f"{path}: its codec is unknown; encode the video again, for instance with ffmpeg"
            )
        check_size(context.width, context.height, 3, 1, str(path))
        return stream
    content = ", ".join(sorted({stream.type for stream in container.streams})) or "an empty container"
    raise FrameFileError(f"{path}: holds no video, only {content}; give a file with pictures")


def decoded(path: Path, packets: Sequence[Packet]) -> Iterator[tuple[int, Any, str]]:
    """Decode a video file.

    Parameters
    ----------
    path : Path
    packets : sequence of Packet
        As listed before. Those that have come since are left alone.

    Yields
    ------
    number : int
        Of the packet, in the order of decoding.
    frame : av.VideoFrame or None
        Frames come as they are shown. None where the packet was refused.
    damage : str
        What is wrong with it; empty if nothing.
    """
    with opened(path) as container:
        stream = video_stream(container, path)
        context = stream.codec_context
        context.thread_count = 1
        codec, is_motion_jpeg = context.codec, context.name == "mjpeg"
        hears = not is_motion_jpeg and (codec.intra_only or (codec.lossless and not codec.lossy))
        context.options = {
            "err_detect": _CHECKS + ("+explode" if hears or context.name in _STRICT else ""),
            "export_side_data": "venc_params",
            "max_pixels": str(_most_pixels()),
        }
        damaged: dict[int, str] = {}
        for number, packet in _numbered(container, stream, len(packets)):
            frames, damage = _decode(context, packet, hears)
            if packet is not None:
                if not damage and packets[number].is_cut:
                    damage = "its data is incomplete"
                if not damage and is_motion_jpeg:
                    damage = damage_of_jpeg(bytes(packet))
                if damage:
                    damaged[number] = damage
                    if not frames:
                        yield number, None, damage
            for frame in frames:
                own = number if frame.pts is None else int(frame.pts)
                yield own, frame, damaged.get(own, "its data is damaged" if frame.is_corrupt else "")


def _numbered(container: Any, stream: Any, count: int) -> Iterator[tuple[int, Any]]:
    """Packets of a stream with their numbers, which stand in place of their time stamps; None at the end."""
    number = 0
    try:
        for packet in container.demux(stream):
            if packet.size == 0:
                continue
            if number == count:
                break
            packet.pts = packet.dts = number
            yield number, packet
            number += 1
    except _FOREIGN:
        pass  # as when the packets were listed: what follows cannot be read
    yield number, None


def _decode(context: Any, packet: Any, hears: bool) -> tuple[list[Any], str]:
    """Frames that a packet completes, and what the decoder says against it."""
    with contextlib.ExitStack() as stack:
        said = stack.enter_context(_LOG.heard()) if hears else []
        try:
            frames = context.decode(packet)
        except _FOREIGN as error:
            return [], f"its data is damaged ({_reason(error)})"
    errors = [text.strip() for level, _, text in said if level <= av.logging.ERROR]
    return frames, f"its data is damaged ({errors[0]})" if errors else ""


class _Log:
    """FFmpeg's log, heard by one thread for as long as it decodes.

    PyAV switches the log on and off for the whole process: it is on while any thread wants to hear it. What other
    threads say meanwhile goes to Python's logging, where a handler that does nothing keeps it off the terminal.
    """

    def __init__(self) -> None:
        self._lock, self._listeners = threading.Lock(), 0
        self._before: tuple[int | None, bool] = (None, True)

    @contextlib.contextmanager
    def heard(self) -> Iterator[list[Any]]:
        """Give the list to which what this thread's decoder says is added."""
        with self._lock:
            if not self._listeners:
                self._before = av.logging.get_level(), av.logging.get_skip_repeated()
                if not logging.getLogger("libav").handlers:
                    logging.getLogger("libav").addHandler(logging.NullHandler())
                if self._before[0] is None or self._before[0] < av.logging.ERROR:
                    av.logging.set_level(av.logging.ERROR)
                av.logging.set_skip_repeated(False)
            self._listeners += 1
        try:
            with av.logging.Capture() as said:
                yield said
        finally:
            with self._lock:
                self._listeners -= 1
                if not self._listeners:
                    av.logging.set_level(self._before[0])
                    av.logging.set_skip_repeated(self._before[1])


_LOG = _Log()


def _most_pixels() -> int:
    """Pixels of the largest picture that may be decoded, in three planes of 8 bits."""
    return max(1, min(frame_limit() // 3, 2**31 - 1))


def _reason(error: BaseException) -> str:
    return str(getattr(error, "strerror", None) or error or type(error).__name__)
