"""Containers: how many bytes a video file states for itself, to tell one that is cut short.

| container | what states its size |
|---|---|
| AVI | the RIFF chunks, one after another |
| MP4, MOV | the boxes, one after another |
| Matroska, WebM | the segment |
| ASF, WMV | the file properties |
| GIF | its last byte, 0x3B |
| MPEG-TS | packets of 188 or 192 bytes |
| YUV4MPEG | frames of one size |

Those that state none (MPEG-PS, FLV, unfinished recordings) pass.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

_CHUNKS = 100_000
"""Chunks or boxes that are walked at most."""

_ASF_HEADER = bytes.fromhex("3026b2758e66cf11a6d900aa0062ce6c")
_ASF_PROPERTIES = bytes.fromhex("a1dcab8c47a9cf118ee400c00c205365")


def missing_bytes(path: Path) -> tuple[int, int] | None:
    """Return the bytes that a video file states and those that are there, where it has fewer; else None.

    Parameters
    ----------
    path : Path
        A readable file.
    """
    there = path.stat().st_size
    with path.open("rb") as file:
        start = file.read(16)
        stated = _ways(start)(file, there) if len(start) == 16 else 0
    return (stated, there) if stated > there else None


def _ways(start: bytes) -> Callable[[BinaryIO, int], int]:
    if start[:4] == b"RIFF":
        return _of_riff
    if start[4:8] in (b"ftyp", b"moov", b"mdat", b"free", b"wide", b"skip", b"pnot"):
        return _of_boxes
    if start[:4] == b"\x1a\x45\xdf\xa3":
        return _of_matroska
    if start == _ASF_HEADER:
        return _of_asf
    return _of_gif if start[:4] == b"GIF8" else _of_frames if start[:9] == b"YUV4MPEG2" else _of_packets


def _of_riff(file: BinaryIO, there: int) -> int:
    at = 0
    for _ in range(_CHUNKS):
        file.seek(at)
        head = file.read(8)
        if len(head) < 8 or head[:4] != b"RIFF":
            return 0
        size = int.from_bytes(head[4:], "little")
        if size == 0xFFFFFFFF or at + size > there:
            return 0 if size == 0xFFFFFFFF else at + 8 + size
        at += 8 + size + size % 2
    return 0


def _of_boxes(file: BinaryIO, there: int) -> int:
    at = 0
    for _ in range(_CHUNKS):
        file.seek(at)
        head = file.read(16)
        if len(head) < 8:
            return 0
        size = int.from_bytes(head[:4], "big")
        if size == 1:
            size = int.from_bytes(head[8:], "big")
        if size < 8 or not head[4:8].isalnum():
            return 0
        at += size
        if at > there:
            return at
    return 0


def _of_matroska(file: BinaryIO, there: int) -> int:
    file.seek(4)
    size, width = _variable(file)
    at = 4 + width + size
    file.seek(at)
    if file.read(4) != b"\x18\x53\x80\x67":
        return 0
    size, width = _variable(file)
    return at + 4 + width + size if size else 0


def _variable(file: BinaryIO) -> tuple[int, int]:
    """Return an EBML number and its width, bytes; 0 where it says that it is unknown."""
    first = file.read(1)
    if not first or not first[0]:
        return 0, 1
    width = 9 - first[0].bit_length()
    value = int.from_bytes(bytes([first[0] & (0xFF >> width)]) + file.read(width - 1), "big")
    return (0 if value == (1 << (7 * width)) - 1 else value), width


def _of_asf(file: BinaryIO, there: int) -> int:
    file.seek(0)
    head = file.read(8192)
    at = head.find(_ASF_PROPERTIES)
    return int.from_bytes(head[at + 40 : at + 48], "little") if at >= 0 else 0


def _of_packets(file: BinaryIO, there: int) -> int:
    file.seek(0)
    head = file.read(4 * 192)
    for size, start in ((188, 0), (192, 4)):
        if len(head) >= 4 * size and all(head[start + k * size] == 0x47 for k in range(4)):
            return -(-there // size) * size
    return 0


def _of_frames(file: BinaryIO, there: int) -> int:
    file.seek(0)
    head = file.readline(1024)
    said = {word[:1]: word[1:].decode("latin-1") for word in head.split()[1:]}
    colours = said.get(b"C", "420jpeg")
    try:
        width, height = int(said[b"W"]), int(said[b"H"])
    except (KeyError, ValueError):
        return 0
    across, down = -(-width // (1 if colours[:3] == "444" else 4 if colours[:3] == "411" else 2)), height
    if colours[:3] == "420":
        down = -(-height // 2)
    samples = width * height + (0 if colours.startswith("mono") else 2 * across * down)
    if colours == "444alpha":
        samples += width * height
    is_deep = (colours[3:4] == "p" and colours[4:].isdigit()) or colours in (
        "mono9",
        "mono10",
        "mono12",
        "mono16",
    )
    frame = len(b"FRAME\n") + samples * (2 if is_deep else 1)
    return len(head) + -(-(there - len(head)) // frame) * frame if samples > 0 else 0


def _of_gif(file: BinaryIO, there: int) -> int:
    file.seek(max(0, there - 1024))
    return 0 if file.read().rstrip(b"\0")[-1:] == b"\x3b" else there + 1
