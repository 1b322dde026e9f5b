"""TIFF files: one page or many, BigTIFF, ImageJ and OME stacks, packed bits, read by tifffile frame by frame.

Frames are taken along the one axis that is neither rows, columns nor colours: time, or slices of a stack.
What tifffile cannot decode without the package imagecodecs is tried with Pillow, which knows LZW and others.
"""

from __future__ import annotations

import contextlib
import logging
import re
import struct
import threading
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import tifffile
from numpy.typing import NDArray

from sixflow.errors import FrameFileError
from sixflow.frames.formats import FrameFile
from sixflow.frames.packed import unpack_rows
from sixflow.frames.selection import Selection

Array: TypeAlias = NDArray[Any]

_DAMAGE = (OSError, ValueError, TypeError, KeyError, IndexError, RuntimeError, struct.error, zlib.error)

_SECONDS = {
    "s": 1.0,
    "sec": 1.0,
    "second": 1.0,
    "seconds": 1.0,
    "ms": 1e-3,
    "msec": 1e-3,
    "µs": 1e-6,
    "min": 60.0,
}


_NOT_TIME = {"Z": "slices (Z)", "C": "channels (C)"}


class TiffFile(FrameFile):
    """A TIFF file and its frames."""

    def __init__(self, path: Path, selection: Selection = Selection()) -> None:  # noqa: B008 - it is frozen
        super().__init__(path, selection)
        self._count: int | None = None
        self._interval: float | None = None
        self._notes: tuple[str, ...] = ()

    @property
    def count(self) -> int:
        """Number of frames, from the directory of pages; no pixels are read."""
        if self._count is None:
            with self._opened():
                pass
        assert self._count is not None
        return self._count

    @property
    def times(self) -> Array | None:
        """Times from the frame interval that ImageJ or OME metadata state, s."""
        count = self.count
        return None if self._interval is None else np.arange(count) * self._interval

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on axes, palettes and peculiar metadata."""
        return self._notes

    def read(self, start: int = 0) -> Iterator[Array]:
        """Yield the frames from number `start` on.

        Raises
        ------
        FrameFileError
            If the file is no TIFF, is damaged or cut short, is compressed in a way that needs imagecodecs, or
            has more than one axis along which frames could lie.
        """
        with self._opened() as stacks:
            for stack in stacks:
                for index in range(min(start, stack.count), stack.count):
                    yield stack.frame(index)
                start = max(0, start - stack.count)

    @contextlib.contextmanager
    def _opened(self) -> Iterator[list[_Stack]]:
        with contextlib.ExitStack() as resources:
            with _captured_log() as messages:
                try:
                    tif = resources.enter_context(tifffile.TiffFile(self.path))
                    stacks = [_Stack(tif, one, self.path) for one in tif.series if not _is_preview(one)]
                except FrameFileError:
                    raise
                except _DAMAGE as error:
                    raise _damaged(self.path, str(error)) from error
            for message in messages:
                if "TiffPage" in message:
                    raise _damaged(self.path, message.split("> ")[-1])
            if not stacks:
                raise _damaged(self.path, "it holds no pages")
            self._count = sum(stack.count for stack in stacks)
            self._interval = _frame_interval(tif)
            notes = [note for stack in stacks for note in stack.notes]
            self._notes = tuple(dict.fromkeys(notes + messages))
            yield stacks


class _Stack:
    """Pages of the same kind: frames along one axis."""

    def __init__(self, tif: Any, series: Any, path: Path) -> None:
        self._tif, self._series, self._path = tif, series, path
        page = series.keyframe
        if 0 in series.shape or page.ndim < 2:
            raise _damaged(path, f"its first page has the shape {page.shape}")
        leading = [
            (axis, size) for axis, size in zip(series.axes, series.shape, strict=True) if axis not in "YXS"
        ]
        frames = [(axis, size) for axis, size in leading if size > 1]
        if len(frames) > 1:
            seen = " × ".join(f"{axis}={size}" for axis, size in frames)
            raise FrameFileError(
                f"{path}: the stack has the axes {seen} beside rows and columns, where only time may be; "
                "save one channel and one slice over time as a file of its own, for instance in ImageJ"
            )
        self.count: int = frames[0][1] if frames else 1
        self.notes: list[str] = []
        if frames and frames[0][0] in _NOT_TIME:
            self.notes.append(f"the {_NOT_TIME[frames[0][0]]} of the stack are read as frames over time")
        self._has_palette = page.photometric == tifffile.PHOTOMETRIC.PALETTE and not tif.is_imagej
        if self._has_palette:
            self.notes.append("palette colours read as colour")
        self._pixels = None if self._has_palette else self._mapped()

    def frame(self, index: int) -> Array:
        """Read one frame, shape (h, w) or (h, w, c)."""
        if self._pixels is not None:
            return np.array(self._pixels[index])
        page = self._series[index]
        if page is None:
            raise _damaged(self._path, f"page {index} is missing")
        pixels = self._decoded(page, index)
        if self._has_palette:
            return np.moveaxis(self._series.keyframe.colormap[:, pixels], 0, -1)
        return np.moveaxis(pixels, 0, -1) if self._series.keyframe.axes == "SYX" else pixels

    def _mapped(self) -> Array | None:
        """Map frames that lie uncompressed one after another, shape (count, h, w[, c]); None for others."""
        offset = self._series.dataoffset
        if offset is None:
            return None
        shape = self._series.shape
        dtype = self._series.dtype.newbyteorder(self._tif.byteorder)
        end, size = offset + int(np.prod(shape)) * dtype.itemsize, self._path.stat().st_size
        if end > size:
            raise _damaged(
                self._path, f"cut short: its frames need {end} bytes, the file has {size}", is_cut=True
            )
        pixels: Array = np.memmap(self._path, dtype=dtype, mode="r", offset=offset, shape=shape)
        axes = [axis for axis in self._series.axes if axis in "YXS"]
        pixels = pixels.reshape(self.count, *shape[len(shape) - len(axes) :])
        return np.moveaxis(pixels, 1, -1) if axes[0] == "S" else pixels

    def _decoded(self, page: Any, index: int) -> Array:
        try:
            if _is_packed(self._series.keyframe):
                return _unpacked(page, self._series.keyframe, self._tif.filehandle)
            with _captured_log():
                pixels: Array = page.asarray(maxworkers=1)
                return pixels
        except _DAMAGE as error:
            if "imagecodecs" in str(error):
                return _by_pillow(self._path, page.index, self._series.keyframe)
            raise _damaged(self._path, f"page {index}: {error}", is_cut=_is_cut(error)) from error


def _is_preview(series: Any) -> bool:
    return bool(series.keyframe.is_reduced)


def _is_packed(keyframe: Any) -> bool:
    return (
        isinstance(keyframe.bitspersample, int)
        and keyframe.bitspersample < 16
        and keyframe.bitspersample not in (1, 8)
        and keyframe.compression == 1
        and keyframe.fillorder == 1
        and keyframe.samplesperpixel == 1
        and not keyframe.is_tiled
    )


def _unpacked(page: Any, keyframe: Any, file: Any) -> Array:
    height, width, bits = keyframe.imagelength, keyframe.imagewidth, keyframe.bitspersample
    strips = []
    for number, (offset, size) in enumerate(zip(page.dataoffsets, page.databytecounts, strict=True)):
        file.seek(offset)
        rows = min(keyframe.rowsperstrip, height - number * keyframe.rowsperstrip)
        data = file.read(size)
        if len(data) < rows * -(-width * bits // 8):
            raise ValueError(f"failed to read {size} bytes, got {len(data)}")
        strips.append(unpack_rows(data, rows, width, bits))
    return np.concatenate(strips)


def _by_pillow(path: Path, index: int, keyframe: Any) -> Array:
    from PIL import Image

    try:
        with Image.open(path) as image:
            image.seek(index)
            pixels = np.array(image)
    except (OSError, SyntaxError, ValueError, EOFError, TypeError) as error:
        pixels, reason = np.zeros(0), str(error)
    else:
        reason = f"Pillow reads it as {pixels.dtype} of shape {pixels.shape}"
    if pixels.shape != keyframe.shape or pixels.dtype.itemsize < keyframe.dtype.itemsize:
        name = getattr(keyframe.compression, "name", keyframe.compression)
        raise FrameFileError(
            f"{path}: its {keyframe.bitspersample}-bit pages are stored with {name} and need imagecodecs: "
            f"pip install sixflow[codecs]; or save the file uncompressed ({reason})"
        )
    return pixels


def _frame_interval(tif: Any) -> float | None:
    """Return the frame interval in ImageJ or OME metadata, s."""
    interval, unit = None, "s"
    if tif.is_imagej:
        metadata = tif.imagej_metadata or {}
        interval, unit = metadata.get("finterval"), str(metadata.get("tunit", "s"))
    elif tif.is_ome and (found := re.search(r'\bTimeIncrement="([^"]+)"', tif.ome_metadata or "")):
        interval = found[1]
        unit_found = re.search(r'\bTimeIncrementUnit="([^"]+)"', tif.ome_metadata)
        unit = unit_found[1] if unit_found else "s"
    try:
        seconds = float(interval) * _SECONDS[unit.strip().lower()] if interval is not None else 0.0
    except (ValueError, KeyError):
        return None
    return seconds if seconds > 0 else None


def _is_cut(error: BaseException) -> bool:
    return any(word in str(error) for word in ("failed to read", "incomplete or truncated"))


def _damaged(path: Path, reason: str, is_cut: bool = False) -> FrameFileError:
    cut = is_cut or "invalid page offset" in reason or "corrupted IFD" in reason
    state = "the file is cut short or damaged" if cut else "cannot be read as a TIFF"
    return FrameFileError(f"{path}: {state} ({reason}); copy or export it again")


class _Recorder(logging.Filter):
    """Keeps the messages of one thread from the log and remembers them."""

    def __init__(self) -> None:
        super().__init__()
        self.messages: list[str] = []
        self._thread = threading.get_ident()

    def filter(self, record: logging.LogRecord) -> bool:
        if record.thread != self._thread:
            return True
        if record.levelno >= logging.WARNING:
            self.messages.append(record.getMessage())
        return False


@contextlib.contextmanager
def _captured_log() -> Iterator[list[str]]:
    """Return what tifffile logs as a list, instead of letting it reach stderr."""
    logger, recorder = logging.getLogger("tifffile"), _Recorder()
    logger.addFilter(recorder)
    try:
        yield recorder.messages
    finally:
        logger.removeFilter(recorder)
