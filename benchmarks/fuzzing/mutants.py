"""Mutants: damaged copies of a file or of one file of a folder, each from a number.

| damage | what it stands for |
|---|---|
| bits, bytes | a bad disk or cable |
| number | a length, size or offset that became enormous, zero or negative |
| cut | a copy that was interrupted |
| zeros | blocks that never arrived |
| remove, insert, repeat, swap | lost, doubled and exchanged blocks |
| digits | text in which a number has become another |
| missing, empty | in folders: a file that did not arrive, or arrived empty |
"""

from __future__ import annotations

import random
import re
import shutil
from collections.abc import Callable
from pathlib import Path

HEADER = 512
"""Bytes at the beginning where half of the damage goes: that is where files say what they are."""

EXTREMES = (0, 1, 2, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 0x7FFFFFFFFFFFFFFF)
NUMBERS = (b"0", b"-1", b"1e999", b"nan", b"99999999999999999999", b"1.5", b"65536", b"2147483648", b"")


def make_mutant(seed: Path, target: Path, number: int) -> str:
    """Write mutant `number` of a file or folder to `target`; what was done to it.

    The same number gives the same mutant.
    """
    generator = random.Random(f"{seed.name} {number}")
    if seed.is_file():
        what, damaged = damage(seed.read_bytes(), generator)
        target.write_bytes(damaged)
        return what
    shutil.copytree(seed, target)
    file = generator.choice(sorted(path for path in target.rglob("*") if path.is_file()))
    name = file.relative_to(target)
    if generator.random() < 0.1:
        file.unlink()
        return f"{name} missing"
    if generator.random() < 0.05:
        file.write_bytes(b"")
        return f"{name} empty"
    what, damaged = damage(file.read_bytes(), generator)
    file.write_bytes(damaged)
    return f"{name}: {what}"


def damage(content: bytes, generator: random.Random) -> tuple[str, bytes]:
    """Damage content once to four times; what was done, and what is left."""
    done = []
    for _ in range(generator.choice((1, 1, 1, 2, 4))):
        kind = generator.choice(list(DAMAGE))
        content = DAMAGE[kind](content, generator)
        done.append(kind)
    return ", ".join(done), content


def _place(content: bytes, generator: random.Random) -> int:
    end = min(HEADER, len(content)) if generator.random() < 0.5 else len(content)
    return generator.randrange(max(1, end))


def _bits(content: bytes, generator: random.Random) -> bytes:
    damaged = bytearray(content)
    for _ in range(generator.choice((1, 1, 2, 8, 32))):
        if damaged:
            damaged[_place(content, generator)] ^= 1 << generator.randrange(8)
    return bytes(damaged)


def _bytes(content: bytes, generator: random.Random) -> bytes:
    at, length = _place(content, generator), generator.choice((1, 2, 4, 16, 200))
    return content[:at] + generator.randbytes(min(length, len(content) - at)) + content[at + length :]


def _number(content: bytes, generator: random.Random) -> bytes:
    size, order = generator.choice((1, 2, 4, 8)), generator.choice(("little", "big"))
    value = generator.choice(EXTREMES) % 256**size
    at = _place(content, generator)
    return content[:at] + value.to_bytes(size, order) + content[at + size :]


def _cut(content: bytes, generator: random.Random) -> bytes:
    return content[: _place(content, generator)]


def _zeros(content: bytes, generator: random.Random) -> bytes:
    at, length = _place(content, generator), generator.choice((4, 64, 512, 4096))
    return content[:at] + bytes(min(length, len(content) - at)) + content[at + length :]


def _remove(content: bytes, generator: random.Random) -> bytes:
    at, length = _place(content, generator), generator.choice((1, 2, 16, 256, 2048))
    return content[:at] + content[at + length :]


def _insert(content: bytes, generator: random.Random) -> bytes:
    at = _place(content, generator)
    return content[:at] + generator.randbytes(generator.choice((1, 2, 16, 256))) + content[at:]


def _repeat(content: bytes, generator: random.Random) -> bytes:
    at, length = _place(content, generator), generator.choice((1, 16, 256, 2048))
    return content[: at + length] + content[at:]


def _swap(content: bytes, generator: random.Random) -> bytes:
    first, second = sorted((_place(content, generator), _place(content, generator)))
    return content[second:] + content[first:second] + content[:first]


def _digits(content: bytes, generator: random.Random) -> bytes:
    found = list(re.finditer(rb"\d+(\.\d+)?", content))
    if not found:
        return _number(content, generator)
    one = generator.choice(found)
    return content[: one.start()] + generator.choice(NUMBERS) + content[one.end() :]


DAMAGE: dict[str, Callable[[bytes, random.Random], bytes]] = {
    "bits": _bits, "bytes": _bytes, "number": _number, "cut": _cut, "zeros": _zeros, "remove": _remove,
    "insert": _insert, "repeat": _repeat, "swap": _swap, "digits": _digits,
}  # fmt: skip
