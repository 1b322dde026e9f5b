"""Chain: the directories of a TIFF, each of which names the place of the next.

It is walked before anything else is read: a chain that leaves the file, or runs in a circle, is found at once, and what
comes before the break can still be read.
"""

from __future__ import annotations

import dataclasses
import struct
from pathlib import Path
from typing import BinaryIO

MOST_TAGS = 4096
"""More tags than this are no directory."""


@dataclasses.dataclass(frozen=True)
class Chain:
    """Where the directories lie, and why the chain ends early ("" if it ends as it should)."""

    offsets: tuple[int, ...]
    broken: str = ""


def read_chain(path: Path) -> Chain | None:
    """Return the chain of directories; None for a header that only special readers know."""
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(16)
        order = {b"II": "<", b"MM": ">"}.get(head[:2])
        if order is None or len(head) < 8:
            return Chain((), "it does not begin as a TIFF does")
        version = struct.unpack(order + "H", head[2:4])[0]
        if version == 42:
            return _walk(file, order, size, struct.unpack(order + "I", head[4:8])[0], "H", "I", 12)
        if version == 43 and len(head) == 16:
            return _walk(file, order, size, struct.unpack(order + "Q", head[8:16])[0], "Q", "Q", 20)
        return Chain((), "it does not begin as a TIFF does") if version == 43 else None


def _walk(file: BinaryIO, order: str, size: int, offset: int, count: str, place: str, tag: int) -> Chain:
    found: dict[int, None] = {}
    width, step = struct.calcsize(count), struct.calcsize(place)
    while offset:
        number = len(found)
        if offset in found:
            return Chain(tuple(found), f"after page {number - 1} its pages go round in a circle")
        if offset >= size:
            return Chain(tuple(found), f"page {number} should begin at byte {offset} of {size}")
        file.seek(offset)
        data = file.read(width)
        tags = struct.unpack(order + count, data)[0] if len(data) == width else MOST_TAGS + 1
        if tags > MOST_TAGS or offset + width + tags * tag + step > size:
            return Chain(tuple(found), f"the directory of page {number} is damaged or cut")
        found[offset] = None
        file.seek(tags * tag, 1)
        offset = struct.unpack(order + place, file.read(step))[0]
    return Chain(tuple(found), "" if found else "it holds no pages")
