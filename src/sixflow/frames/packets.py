"""Packets: the encoded frames of a video in the order of presentation, found without decoding them.

Each packet carries the time stamp of its frame. Where stamps are missing, repeat, jump back, or are those of decoding
(AVI with frames stored out of order), the order of presentation is that in which the decoder puts out its frames.
Stamps that repeat because the container's clock is coarse are those of a constant rate; of others that repeat or jump
back nothing is made: times are not known.
"""

from __future__ import annotations

import collections
import dataclasses
import itertools
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np

from sixflow.errors import FrameFileError
from sixflow.frames.containers import missing_bytes
from sixflow.frames.decoder import Packet, decoded, opened, video_stream

_HIDDEN_FRAMES = {"vp8"}
"""Codecs whose packets may hold frames that are never shown; their frames are counted by decoding."""

_COUNTED = ("avi", "mov", "flv")
"""Containers whose header states frames, or a time that ends with the last frame."""


@dataclasses.dataclass(frozen=True)
class Packets:
    """What the packets of a video say.

    Attributes
    ----------
    codec : str
    intra_only : bool
        Whether every frame stands by itself.
    in_order : tuple of Packet
        In the order in which they are decoded, hidden ones too.
    shown : tuple of int
        Numbers of the packets in the order in which their frames are shown.
    stamps : tuple of Fraction, or None
        Time of every frame, s; None where it is not known.
    clock : Fraction
        Unit of the time stamps, s.
    notes : tuple of str
        On times, and on what is missing.
    """

    codec: str
    intra_only: bool
    in_order: tuple[Packet, ...]
    shown: tuple[int, ...]
    stamps: tuple[Fraction, ...] | None
    clock: Fraction
    notes: tuple[str, ...]


def read_packets(path: Path) -> Packets:
    """Read the packets of a video file once.

    Raises FrameFileError if the file is no video, holds no video stream, or no frames.
    """
    with opened(path) as container:
        stream = video_stream(container, path)
        codec = str(stream.codec_context.name)
        listed, end = _listed(container, stream)
        if not any(packet.shown for packet in listed):
            raise FrameFileError(
                f"{path}: the video holds no frames; it is empty or cut short: record or export it again"
            )
        rate = stream.average_rate or stream.guessed_rate
        intra_only = bool(stream.codec_context.codec.intra_only)
        trouble = _trouble(listed, intra_only)
        cut = _cut(path, container, stream, len(listed), end, rate)
        clock = Fraction(stream.time_base)
        moved = bool(getattr(stream.codec_context, "has_b_frames", False)) and _follow_decoding(listed)
    by_decoding = codec in _HIDDEN_FRAMES or moved or (trouble is not None and not _is_simple(listed))
    shown = [number for number, packet in enumerate(listed) if packet.shown]
    if by_decoding:
        shown = list(_order_of_decoding(path, listed)) or shown
    if trouble is None and not by_decoding:
        shown.sort(key=lambda number: listed[number].stamp or 0)
    stamps = [listed[number].stamp for number in shown]
    if moved and trouble is None:
        stamps.sort(key=lambda stamp: stamp or 0)
    times, trouble = _times(stamps, trouble, rate, clock)
    notes = tuple(note for note in (cut, trouble) if note)
    return Packets(codec, intra_only, tuple(listed), tuple(shown), times, clock, notes)


_MISSING = "the file has no time stamps: times follow from its frame rate"
_UNKNOWN = "the file has neither time stamps nor a frame rate: times are not known"
_REPEAT = "time stamps repeat or go back: times are not known"


def _listed(container: Any, stream: Any) -> tuple[list[Packet], Fraction]:
    """Packets of a stream as they are stored, and the time at which the last of any stream ends, s."""
    listed, start, end = [], None, Fraction(0)
    try:
        for packet in container.demux():
            time = packet.pts if packet.pts is not None else packet.dts
            if time is not None and packet.time_base:
                start = min(start, time * packet.time_base) if start is not None else time * packet.time_base
                end = max(end, (time + (packet.duration or 0)) * packet.time_base)
            if packet.stream_index == stream.index and packet.size > 0:
                listed.append(Packet.of(packet, stream))
    except (av.FFmpegError, ValueError):
        pass  # what follows cannot be read; the count states what is missing
    return listed, max(end, end - (start or 0))


def _trouble(listed: list[Packet], intra_only: bool) -> str | None:
    """What is wrong with the time stamps of the packets, as a note."""
    shown = [packet for packet in listed if packet.shown]
    stamps = [packet.stamp for packet in shown]
    if None in stamps:
        return _MISSING
    order = [packet.decoding for packet in shown if packet.decoding is not None]
    falls = any(b < a for a, b in itertools.pairwise(order))
    falls |= intra_only and any(b < a for a, b in itertools.pairwise(stamps))  # type: ignore[operator]
    return _REPEAT if falls or len(set(stamps)) < len(stamps) else None


def _times(
    stamps: list[Fraction | None], trouble: str | None, rate: Fraction | None, clock: Fraction
) -> tuple[tuple[Fraction, ...] | None, str | None]:
    """Times of the frames as they are shown, s, None where they are not known, and a note on them."""
    if trouble == _MISSING and not rate:
        return None, _UNKNOWN
    if trouble == _MISSING and rate:
        return tuple(number / rate for number in range(len(stamps))), trouble
    known = [stamp for stamp in stamps if stamp is not None]
    if trouble is None and all(b > a for a, b in itertools.pairwise(known)):
        return tuple(known), None
    even = _even(known, clock)
    if even is None:
        return None, _REPEAT
    return (
        even,
        f"time stamps repeat, as the file counts in {float(clock):g} s: they are those of a constant rate",
    )


def _even(stamps: list[Fraction], clock: Fraction) -> tuple[Fraction, ...] | None:
    """Times of the constant rate that stamps are when rounded to the clock, |t_k − a − bk| ≤ clock/2; or None."""
    count = len(stamps)
    if count < 3:
        return None
    measured, number = np.array([float(stamp) for stamp in stamps]), np.arange(count)
    span, unit = float(stamps[-1] - stamps[0]), float(clock)
    low, high = (span - unit) / (count - 1), (span + unit) / (count - 1)
    for _ in range(60):  # the spread of t − bk is convex in b
        third = (high - low) / 3
        spreads = [np.ptp(measured - b * number) for b in (low + third, high - third)]
        low, high = (low, high - third) if spreads[0] < spreads[1] else (low + third, high)
    rest = measured - low * number
    if low <= 0 or np.ptp(rest) > unit * (1 + 1e-6):
        return None
    begin = float(rest.max() + rest.min()) / 2
    return tuple(Fraction(begin + low * k) for k in range(count))


def _follow_decoding(listed: list[Packet]) -> bool:
    """Whether the time stamps only repeat the order in which packets are decoded."""
    return len({(p.stamp or 0) - (p.decoding or 0) for p in listed}) == 1


def _is_simple(listed: list[Packet]) -> bool:
    """Whether each packet is a frame by itself, so that they are shown as they are stored."""
    return all(packet.is_key for packet in listed)


def _order_of_decoding(path: Path, listed: list[Packet]) -> Iterator[int]:
    """Numbers of the packets as their frames come out of the decoder; those that fail, at their place in the file."""
    failed: collections.deque[int] = collections.deque()
    for number, frame, _ in decoded(path, listed):
        if frame is None:
            failed.append(number)
            continue
        while failed and failed[0] < number:
            yield failed.popleft()
        yield number
    yield from failed


def _cut(path: Path, container: Any, stream: Any, count: int, end: Fraction, rate: Fraction | None) -> str:
    """Return a note where the file states more frames, time or bytes than it has."""
    frames, kind = stream.frames or 0, container.format.name
    stated = Fraction(container.duration or 0, av.time_base)
    if kind == "avi":
        stated = frames / rate if rate else Fraction(0)
    missing = missing_bytes(path)
    ends_early = rate is not None and stated > end + Fraction(3, 2) / rate
    there = f"{count} frame{'s are' if count != 1 else ' is'} there"
    if frames > count and (missing or ends_early):
        return f"the file is cut short or damaged: it states {frames} frames ({float(stated):.4g} s), {there}"
    if rate is not None and not frames and ends_early and (missing or kind.startswith(_COUNTED)):
        about = f"about {round(stated * rate)} frames ({float(stated):.4g} s)"
        return f"the file is cut short or damaged: it states {about}, {there}"
    if missing:
        last = (
            "its end is missing"
            if missing[0] == missing[1] + 1
            else "it states {} bytes, {} are there".format(*missing)
        )
        return f"the file is cut short: {last}; {there}"
    return ""
