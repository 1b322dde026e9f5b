"""JPEG pictures: whether their data is whole, and what their quantisation leaves, from the file's bytes (ITU-T T.81).

A decoder fills what damage has taken, and says nothing: Huffman codes find their way back after a few blocks. But then
the scan holds another number of blocks than the picture has. So a scan is walked through, code word by code word: it
is whole where its bits end with its last block, every bit pattern is a code word, no block has more than 64
coefficients, and no mean grey value lies outside the range. The later scans of progressive pictures, which refine
what others have begun, are not walked.

The error that quantisation leaves is computed under the common model: DCT coefficients of one frequency are Laplacian,
f(x) = exp(−|x|/b)/2b (Reininger and Gibson 1983). The share of zeros after quantisation, 1 − exp(−q/2b), tells b, and

    ε² = (1 − z)·E[x² | zero] + z·(c² + 2b² − 2bc·coth(c/b)),   c = q/2, z = exp(−c/b);

the mean of ε² over the 64 frequencies is the variance of a pixel's error. Where the step is fine it is q²/12; where
all coefficients are zero, b is at most that of lower frequencies. Of textured pictures this is 0.8 to 1.7 times the
true error.

| symbol | meaning |
|---|---|
| q | step of the quantiser of one frequency, grey values |
| b | scale of the Laplacian law, grey values |
| z | share of coefficients that are not zero |
"""

from __future__ import annotations

import dataclasses
import functools
import io
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.huffman import ENDS_EARLY, NO_CODE, OUT_OF_RANGE, TOO_MANY, WHOLE, walk_scan

Array: TypeAlias = NDArray[Any]

_PADDING = 16
"""Bits that may follow the last block besides those that fill its byte: some cameras pad to whole words."""

_SEEN = {
    ENDS_EARLY: "its data ends early",
    NO_CODE: "its data holds bits that are no code",
    TOO_MANY: "a block of it has too many coefficients",
    OUT_OF_RANGE: "a block of it is brighter or darker than any pixel can be",
}

_DIAGONAL = sorted(np.ndindex(8, 8), key=lambda yx: (sum(yx), yx[0] if sum(yx) % 2 else yx[1]))
_ZIGZAG = np.array([8 * y + x for y, x in _DIAGONAL])


@dataclasses.dataclass
class _Component:
    horizontal: int
    vertical: int
    table: int


@dataclasses.dataclass
class _Picture:
    """What the headers of one picture say."""

    steps: dict[int, Array] = dataclasses.field(default_factory=dict)
    words: dict[tuple[int, int], Array] = dataclasses.field(default_factory=dict)
    components: dict[int, _Component] = dataclasses.field(default_factory=dict)
    precision: int = 8
    width: int = 0
    height: int = 0
    restart: int = 0
    is_huffman: bool = False


def damage_of_jpeg(data: bytes) -> str:
    """Return what is wrong with a JPEG, in words; nothing where it is whole or of a kind that is not walked.

    Parameters
    ----------
    data : bytes
        A file, or a packet of a motion-JPEG video, which may hold several pictures (fields).

    Examples
    --------
    >>> damage_of_jpeg(b"no picture")
    ''
    """
    try:
        return _walk(data)
    except (IndexError, ValueError, KeyError, ZeroDivisionError, OverflowError):
        return "its headers are damaged"


def luma_steps(data: bytes) -> Array | None:
    """Return the quantiser steps of a JPEG's luma, shape (8, 8), lowest frequency first; None where there are none."""
    picture = _Picture()
    try:
        for marker, start, end in _segments(data):
            _read_header(picture, marker, data[start:end])
            if marker == 0xDA:
                break
    except (IndexError, ValueError, KeyError):
        return None
    first = next(iter(picture.components.values()), None)
    return None if first is None else picture.steps.get(first.table)


def quantisation_noise(luma: Array, steps: Array) -> float:
    """Return the standard deviation of the error that quantised DCT blocks leave in a pixel, grey values.

    Parameters
    ----------
    luma : array, shape (h, w)
        The picture as decoded.
    steps : array, shape (8, 8)
        Steps of the quantiser.

    Examples
    --------
    >>> noise = quantisation_noise(np.random.default_rng(1).normal(128, 40, (64, 64)), np.full((8, 8), 12.0))
    >>> round(noise, 1)  # 12/√12
    3.5
    """
    from scipy.fft import dctn

    rows, columns = (8 * min(64, size // 8) for size in luma.shape)
    if not rows or not columns:
        return float(np.sqrt(np.mean(np.square(steps)) / 12))
    blocks = luma[:rows, :columns].astype(np.float64).reshape(rows // 8, 8, columns // 8, 8)
    levels = np.rint(dctn(blocks, axes=(1, 3), norm="ortho") / steps[:, None, :])
    some = 32 / blocks.size  # half a block
    share = (levels != 0).mean(axis=(0, 2))
    b = _falling(steps / (-2 * np.log(np.clip(share, some, 1 - some))), share == 0)
    c = steps / 2
    half = c / b
    shown = np.exp(-half)
    zero = 2 * b**2 - shown * (c**2 + 2 * b * c + 2 * b**2)
    rest = np.where(half < 0.05, c**2 / 3, c**2 + 2 * b**2 - 2 * b * c / np.tanh(half))
    return float(np.sqrt(np.mean(zero + shown * rest)))


def _falling(b: Array, unknown: Array) -> Array:
    """Scales, of which those that are only known to be less are at most those of lower frequencies."""
    for y, x in _DIAGONAL[1:]:
        if unknown[y, x]:
            b[y, x] = min(b[y, x], max(b[max(y - 1, 0), x] if y else 0.0, b[y, max(x - 1, 0)] if x else 0.0))
    return b


def _segments(data: bytes) -> list[tuple[int, int, int]]:
    """Markers with the place of their content; of a scan (0xDA) its header."""
    found, at = [], data.find(b"\xff\xd8")
    while 0 <= at < len(data) - 1:
        if data[at] != 0xFF:
            at = data.find(b"\xff", at)
            continue
        marker = data[at + 1]
        if marker in (0xFF, 0x00, 0x01) or 0xD0 <= marker <= 0xD7:
            at += 1 if marker == 0xFF else 2
        elif marker == 0xD8:
            found.append((marker, at + 2, at + 2))
            at += 2
        elif marker == 0xD9:  # a second field may follow at once; anything else is none of the picture
            at = at + 2 if data[at + 2 : at + 4] == b"\xff\xd8" else -1
        else:
            length = int.from_bytes(data[at + 2 : at + 4], "big")
            if length < 2 or at + 2 + length > len(data):
                raise ValueError("a segment reaches beyond the end")
            found.append((marker, at + 4, at + 2 + length))
            at += 2 + length
    return found


def _read_header(picture: _Picture, marker: int, content: bytes) -> None:
    if marker == 0xDB:
        while content:
            wide, number = content[0] >> 4, content[0] & 15
            size = 128 if wide else 64
            values = np.frombuffer(content[1 : 1 + size], ">u2" if wide else "u1")
            if not values.all():
                raise ValueError("a step of the quantiser is 0")
            steps = np.zeros(64)
            steps[_ZIGZAG] = values
            picture.steps[number] = steps.reshape(8, 8)
            content = content[1 + size :]
    elif marker == 0xC4:
        while content:
            lengths = np.frombuffer(content[1:17], np.uint8)
            count = int(lengths.sum())
            symbols = np.frombuffer(content[17 : 17 + count], np.uint8)
            picture.words[content[0] >> 4, content[0] & 15] = _code_words(lengths, symbols)
            content = content[17 + count :]
    elif marker == 0xDD:
        picture.restart = int.from_bytes(content[:2], "big")
    elif 0xC0 <= marker <= 0xCF and marker != 0xCC:
        picture.is_huffman = marker <= 0xC2
        picture.precision = content[0]
        picture.height, picture.width = (int.from_bytes(content[k : k + 2], "big") for k in (1, 3))
        for k in range(6, 6 + 3 * content[5], 3):
            picture.components[content[k]] = _Component(
                content[k + 1] >> 4, content[k + 1] & 15, content[k + 2]
            )


def _code_words(lengths: Array, symbols: Array) -> Array:
    """For every 16 bits, 256 times the length of the code word they begin with plus its symbol (annex C)."""
    words = np.zeros(65536, np.uint16)
    at, number = 0, 0
    for length, count in enumerate(lengths.tolist(), 1):
        for _ in range(count):
            end = at + (1 << (16 - length))
            words[at:end] = length << 8 | int(symbols[number])
            at, number = end, number + 1
    return words


@functools.cache
def _standard_words() -> dict[tuple[int, int], Array]:
    """The tables of annex K, which motion JPEG may leave out."""
    from PIL import Image

    store, picture = io.BytesIO(), _Picture()
    Image.new("RGB", (8, 8)).save(store, "JPEG")
    for marker, start, end in _segments(store.getvalue()):
        if marker == 0xC4:
            _read_header(picture, marker, store.getvalue()[start:end])
    return picture.words


def _walk(data: bytes) -> str:
    picture, pending = _Picture(), set[int]()
    for marker, start, end in _segments(data):
        if marker == 0xD8:
            picture = _Picture(picture.steps, picture.words or dict(_standard_words()))
        elif marker == 0xDA and picture.is_huffman and picture.height:
            header = data[start:end]
            chosen = [header[1 + 2 * k] for k in range(header[0])]
            tables = [header[2 + 2 * k] for k in range(header[0])]
            found = _walk_scan(picture, chosen, tables, header[1 + 2 * header[0] :], data[end:])
            if found:
                return found
            pending -= set(chosen)
        else:
            _read_header(picture, marker, data[start:end])
            if 0xC0 <= marker <= 0xC2 and picture.height:
                pending = set(picture.components)
    return "some of its colours are missing" if pending else ""


def _walk_scan(picture: _Picture, chosen: list[int], tables: list[int], band: bytes, rest: bytes) -> str:
    first, last, high, low = band[0], band[1], band[2] >> 4, band[2] & 15
    if high:
        return ""
    parts = [picture.components[name] for name in chosen]
    widest, highest = (
        max(getattr(part, name) for part in picture.components.values())
        for name in ("horizontal", "vertical")
    )
    if len(parts) > 1:
        blocks = [k for k, part in enumerate(parts) for _ in range(part.horizontal * part.vertical)]
        across, down = -(-picture.width // (8 * widest)), -(-picture.height // (8 * highest))
    else:
        blocks = [0]
        across = -(-picture.width * parts[0].horizontal // (8 * widest))
        down = -(-picture.height * parts[0].vertical // (8 * highest))
    nothing = np.zeros(65536, np.uint16)
    words = np.stack(
        [
            [picture.words.get((0, table >> 4), nothing), picture.words.get((1, table & 15), nothing)]
            for table in tables
        ]
    )
    limits = np.array(
        [2.0 ** (picture.precision + 2) / picture.steps[part.table][0, 0] + 2 for part in parts]
    )
    left = units = across * down
    for interval in _intervals(rest):
        now = min(left, picture.restart or units)
        status, used = walk_scan(interval, np.array(blocks), now, words, limits, first, last, low)
        if status != WHOLE:
            return _SEEN[status]
        left -= now
        if not _is_padding(interval[:-4], used):
            return "its data goes on after its last block"
        if not left:
            return ""
    return "its data ends early"


def _is_padding(data: Array, used: int) -> bool:
    """Whether what follows the last block only fills up: a few bits, or zeros or ones throughout."""
    if 8 * data.size - used < 8 + _PADDING:
        return True
    if data[-1] not in (0, 255):
        return False
    unlike = np.flatnonzero(data != data[-1])
    return 8 * (int(unlike[-1]) + 1 if unlike.size else 0) > used - _PADDING


def _intervals(rest: bytes) -> list[Array]:
    """Entropy-coded bytes between restart markers, up to any other marker, without stuffing, four zeros behind each."""
    values = np.frombuffer(rest, np.uint8)
    at = np.flatnonzero(values[:-1] == 0xFF)
    after = values[at + 1]
    ends = at[(after != 0) & (after != 0xFF) & ~((after >= 0xD0) & (after <= 0xD7))]
    end = int(ends[0]) if ends.size else values.size
    cuts = [*at[(after >= 0xD0) & (after <= 0xD7) & (at < end)].tolist(), end]
    stuffed = np.ones(values.size, bool)
    stuffed[at[after == 0] + 1] = False
    stuffed[at[after == 0xFF]] = False
    found, start = [], 0
    for cut in cuts:
        kept = values[start:cut][stuffed[start:cut]]
        found.append(np.concatenate([kept, np.zeros(4, np.uint8)]))
        start = cut + 2
    return found
