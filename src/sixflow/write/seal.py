"""Seals: a checksum of what describes a netCDF file, looked at before any library interprets it.

The chunks of a file have checksums of their own, but the rest, which says what the chunks are and where, has not
everywhere; a changed byte there can make the HDF5 library wait for ever. So a table is appended, behind the end that
HDF5 knows: the byte ranges of the chunks, the CRC-32 of all other bytes, and a mark. Every reader ignores it. Whoever
writes into the file by HDF5 cuts it off, and with it goes the seal; then the file is read without one.
"""

from __future__ import annotations

import itertools
import struct
import zlib
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from sixflow.errors import FieldFileError

_MARK = b"6fl_seal"
_END = struct.Struct("<QI8s")
"""Bytes of the table, CRC-32, mark."""

_PIECE = 2**20


def seal(path: Path) -> None:
    """Append the seal to a complete file."""
    ranges = _chunk_ranges(path)
    table = np.array(ranges, dtype="<u8").tobytes()
    with path.open("rb+") as file:
        size = file.seek(0, 2)
        checksum = zlib.crc32(table, _checksum_outside(file, ranges, size))
        file.seek(size)
        file.write(table + _END.pack(len(table), checksum, _MARK))


def check_seal(path: Path) -> None:
    """Compare a file with its seal, if it has one; FieldFileError if they do not go together."""
    with path.open("rb") as file:
        size = file.seek(0, 2) - _END.size
        file.seek(max(0, size))
        end = file.read()
        if len(end) != _END.size or not end.endswith(_MARK):
            return
        length, checksum, _ = _END.unpack(end)
        size -= length
        if size >= 0 and length % 16 == 0:
            file.seek(size)
            table = file.read(length)
            ranges = np.frombuffer(table, dtype="<u8").reshape(-1, 2).tolist()
            if zlib.crc32(table, _checksum_outside(file, ranges, size)) == checksum:
                return
    raise FieldFileError(
        f"{path}: the file is damaged: its checksum does not fit; copy it again, or measure again"
    )


def _chunk_ranges(path: Path) -> list[tuple[int, int]]:
    """Byte ranges (start, stop) of all chunks, in the order of the file."""
    import h5py

    found: list[tuple[int, int]] = []

    def note(chunk: Any) -> None:
        found.append((chunk.byte_offset, chunk.byte_offset + chunk.size))

    with h5py.File(path) as file:
        for item in file.values():
            if item.chunks is not None:
                item.id.chunk_iter(note)
    return sorted(found)


def _checksum_outside(file: BinaryIO, ranges: Iterable[Sequence[int]], size: int) -> int:
    """CRC-32 of the first bytes of a file without some ranges."""
    checksum = 0
    ranges = list(ranges)
    stops = [0, *(stop for _, stop in ranges)]
    for stop, start in itertools.zip_longest(stops, (start for start, _ in ranges), fillvalue=size):
        file.seek(min(stop, size))
        left = min(start, size) - min(stop, size)
        while left > 0:
            piece = file.read(min(left, _PIECE))
            if not piece:
                break
            checksum = zlib.crc32(piece, checksum)
            left -= len(piece)
    return checksum
