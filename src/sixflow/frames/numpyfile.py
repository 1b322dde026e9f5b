"""NumPy files: .npy, mapped into memory, and .npz, read frame by frame. Pickled objects are never loaded."""

from __future__ import annotations

import contextlib
import math
import zipfile
from collections.abc import Iterator, Mapping
from typing import Any, BinaryIO, TypeAlias, cast

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from sixflow.errors import FrameFileError
from sixflow.frames.arrayfile import ArrayFile, is_frames
from sixflow.frames.labelled import Labelled, codes_of_shape
from sixflow.frames.limits import check_size

Array: TypeAlias = NDArray[Any]


def _read_header(file: BinaryIO, name: str) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Return shape, whether columns run fastest, and type of an array that is stored in NumPy's format."""
    version = npy.read_magic(file)
    read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    shape, fortran, dtype = read(file)
    if dtype.hasobject:
        raise FrameFileError(f"{name}: holds Python objects, which are not loaded; save an array of numbers")
    return shape, fortran, dtype


class NpyFile(ArrayFile):
    """An array in a .npy file: one picture (h, w) or (h, w, c), or a recording (n, h, w) or (n, h, w, c)."""

    @contextlib.contextmanager
    def _arrays(self) -> Iterator[Mapping[str, Any]]:
        with self.path.open("rb") as file:
            shape, fortran, dtype = _read_header(file, str(self.path))
            offset = file.tell()
        if not shape or 0 in shape:
            raise FrameFileError(f"{self.path}: an array of shape {shape} holds no pixels")
        size, needed = self.path.stat().st_size, math.prod(shape) * dtype.itemsize
        if offset + needed > size:
            raise FrameFileError(
                f"{self.path}: its array of shape {shape} needs {offset + needed} bytes, the file has {size}: it is "
                "cut short or damaged; copy or export it again"
            )
        yield {
            self.path.stem: np.memmap(
                self.path, dtype, mode="r", offset=offset, shape=shape, order="F" if fortran else "C"
            )
        }

    def _label(self, array: Any, name: str) -> Labelled:
        return Labelled(array, codes_of_shape(array.shape, name))


class NpzFile(ArrayFile):
    """One of the arrays in a .npz archive."""

    @contextlib.contextmanager
    def _arrays(self) -> Iterator[Mapping[str, Any]]:
        with zipfile.ZipFile(self.path) as archive:
            found = {}
            for info in archive.infolist():
                if info.filename.endswith(".npy"):
                    member = _Member(archive, info, f"{self.path}:/{info.filename.removesuffix('.npy')}")
                    if is_frames(member.shape, member.dtype):
                        found[info.filename.removesuffix(".npy")] = member
            try:
                yield found
            finally:
                for member in found.values():
                    member.close()

    def _label(self, array: Any, name: str) -> Labelled:
        return Labelled(array, codes_of_shape(array.shape, name))


class _Member:
    """An array in an archive, which can only be read from its beginning on: earlier frames begin again."""

    def __init__(self, archive: zipfile.ZipFile, info: zipfile.ZipInfo, name: str) -> None:
        self._archive, self._info, self._name = archive, info, name
        with archive.open(info) as file:
            self.shape, self._fortran, self.dtype = _read_header(cast(BinaryIO, file), name)
            self._begin = file.tell()
        needed = self._begin + math.prod(self.shape) * self.dtype.itemsize
        if needed > info.file_size:
            raise FrameFileError(
                f"{name}: its array of shape {self.shape} is cut short or damaged; export it again"
            )
        self._file: Any = None
        self._at = 0

    def close(self) -> None:
        """Close the archive's stream."""
        if self._file is not None:
            self._file.close()

    def __getitem__(self, index: tuple[Any, ...]) -> Array:
        rest = index[1:] if isinstance(index[0], int) else index
        if any(part != slice(None) for part in rest) or self._fortran:
            return self._whole()[index]
        if not isinstance(index[0], int):
            return self._whole()
        return self._frame(index[0])

    def _whole(self) -> Array:
        check_size(self.shape[-1], math.prod(self.shape[:-1]), 1, self.dtype.itemsize, self._name)
        with self._archive.open(self._info) as file:
            return npy.read_array(cast(BinaryIO, file), allow_pickle=False)

    def _frame(self, number: int) -> Array:
        size = math.prod(self.shape[1:]) * self.dtype.itemsize
        if self._file is None or number < self._at:
            self.close()
            self._file, self._at = self._archive.open(self._info), 0
            self._file.read(self._begin)
        while self._at < number:
            self._read(size)
            self._at += 1
        data = self._read(size)
        self._at += 1
        return np.frombuffer(data, self.dtype).reshape(self.shape[1:])

    def _read(self, size: int) -> bytes:
        data: bytes = self._file.read(size)
        if len(data) < size:
            raise ValueError("it ends early")
        return data
