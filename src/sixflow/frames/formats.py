"""Formats: which module reads a file, by its suffix."""

from __future__ import annotations

import abc
import dataclasses
import importlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeAlias, cast

from numpy.typing import NDArray

from sixflow.errors import FrameFileError
from sixflow.frames.bad import BadFrame
from sixflow.frames.metadata import Metadata
from sixflow.frames.selection import Selection

Array: TypeAlias = NDArray[Any]


class FrameFile(abc.ABC):
    """One file that holds frames; each format has one subclass.

    Parameters
    ----------
    path : Path
        An existing, readable file.
    selection : Selection
        Channel, slice and position of files that hold several. Which frames along time are wanted is not the file's
        business: it counts and reads all of them.
    """

    def __init__(self, path: Path, selection: Selection = Selection()) -> None:  # noqa: B008 - it is frozen
        self.path, self.selection = path, selection

    @property
    @abc.abstractmethod
    def count(self) -> int:
        """Number of frames in the file."""

    @abc.abstractmethod
    def read(self, start: int = 0) -> Iterator[Array | BadFrame]:
        """Yield the frames from number `start` on, as stored: shape (h, w) or (h, w, c).

        A frame that cannot be read is a `BadFrame` where those after it can be; a file that cannot be read at all
        raises `FrameFileError`.
        """

    def frames(self, numbers: range) -> Iterator[Array | BadFrame]:
        """Yield the frames of these numbers, which grow, as `read` does; those between are passed over."""
        for number, frame in enumerate(self.read(numbers.start), numbers.start):
            if number in numbers:
                yield frame
            if number >= numbers[-1]:
                return

    @property
    def times(self) -> Array | None:
        """Time of each frame, s, shape (count,); None where the file does not say."""
        return None

    @property
    def origin(self) -> str:
        """Names the moment from which the times of several files count; empty where each file has its own."""
        return ""

    @property
    def place(self) -> str:
        """Which position, channel and slice of a set of files this one holds; empty where it is by itself."""
        return ""

    @property
    def applied(self) -> tuple[str, ...]:
        """Which of channel, z and position the file has something to choose from for."""
        return ()

    @property
    def metadata(self) -> Metadata:
        """What the file says of itself; complete after the first frame."""
        return Metadata()

    @property
    def notes(self) -> tuple[str, ...]:
        """What a user should know about how the file was read; complete after the first frame."""
        return ()

    @property
    def detail(self) -> str:
        """Codec, rate or the like, for descriptions; may be empty."""
        return ""


@dataclasses.dataclass(frozen=True)
class Format:
    """A kind of file: its name, its suffixes, and the class that reads it as ``module:class``.

    A container holds arrays of any meaning; in a folder, pictures and videos go before it.
    """

    name: str
    suffixes: tuple[str, ...]
    reader: str
    is_video: bool = False
    is_container: bool = False

    def open(self, path: Path, selection: Selection = Selection()) -> FrameFile:  # noqa: B008 - it is frozen
        """Return the file, ready to be read."""
        module, name = self.reader.split(":")
        return cast(FrameFile, getattr(importlib.import_module(module), name)(path, selection))


FORMATS = (
    Format("TIFF", (".tif", ".tiff", ".btf", ".tf8"), "sixflow.frames.tiff:TiffFile"),
    Format("PNG", (".png",), "sixflow.frames.image:ImageFile"),
    Format("JPEG", (".jpg", ".jpeg"), "sixflow.frames.image:ImageFile"),
    Format("BMP", (".bmp",), "sixflow.frames.image:ImageFile"),
    Format("PNM", (".pgm", ".ppm", ".pnm"), "sixflow.frames.image:ImageFile"),
    Format("WebP", (".webp",), "sixflow.frames.image:ImageFile"),
    Format("JPEG 2000", (".jp2", ".j2k"), "sixflow.frames.image:ImageFile"),
    Format(
        "video",
        (
            *(".mp4", ".m4v", ".mov", ".avi", ".mkv", ".webm", ".mpg", ".mpeg", ".wmv"),
            *(".mts", ".m2ts", ".ts", ".ogv", ".flv", ".y4m", ".gif"),
        ),
        "sixflow.frames.video:VideoFile",
        is_video=True,
    ),
    Format("NumPy array", (".npy",), "sixflow.frames.numpyfile:NpyFile", is_container=True),
    Format("NumPy archive", (".npz",), "sixflow.frames.numpyfile:NpzFile", is_container=True),
    Format("Zarr", (".zarr",), "sixflow.frames.zarrfile:ZarrFile", is_container=True),
    Format(
        "HDF5", (".h5", ".hdf5", ".hdf", ".he5", ".nxs"), "sixflow.frames.hdf5:Hdf5File", is_container=True
    ),
    Format("netCDF", (".nc",), "sixflow.frames.netcdf:NetcdfFile", is_container=True),
)
"""The formats that can be read."""

_BY_SUFFIX = {suffix: kind for kind in FORMATS for suffix in kind.suffixes}


def find_format(path: Path) -> Format | None:
    """Return the format of a path by its suffix, or None where it is no format of frames.

    Examples
    --------
    >>> find_format(Path("run/A0001.TIF")).name
    'TIFF'
    """
    return _BY_SUFFIX[".zarr"] if is_store(path) else _BY_SUFFIX.get(path.suffix.lower())


def is_store(path: Path) -> bool:
    """Tell whether a folder is a Zarr store."""
    marks = ("zarr.json", ".zgroup", ".zarray")
    return path.suffix.lower() == ".zarr" or any((path / mark).is_file() for mark in marks)


def require_format(path: Path) -> Format:
    """Return the format of a path, or raise `FrameFileError` with the suffixes that can be read."""
    found = find_format(path)
    if found is None:
        seen = f"the suffix {path.suffix!r} is unknown" if path.suffix else "it has no suffix"
        known = " ".join(sorted(_BY_SUFFIX))
        raise FrameFileError(f"{path}: {seen}; sixflow reads {known}; convert the file to TIFF or PNG")
    return found
