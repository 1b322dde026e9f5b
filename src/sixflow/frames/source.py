"""Sources: a recording as grey frames of one shape and type, read one at a time."""

from __future__ import annotations

import abc
import contextlib
import hashlib
import itertools
import os
from collections.abc import Generator, Iterable, Iterator
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from sixflow.errors import FrameFileError, InputError
from sixflow.frames.bad import BadFrame
from sixflow.frames.formats import FrameFile
from sixflow.frames.grey import to_grey
from sixflow.frames.metadata import Metadata
from sixflow.frames.paths import FoundFiles, require_readable

Array: TypeAlias = NDArray[Any]


class FrameSource(abc.ABC):
    """A recording: iterate over it for its frames, as often as you like.

    Iteration yields arrays of shape `shape` and type `dtype`, one at a time: the recording never stands in
    memory as a whole. ``len(source)`` is the number of frames, and of videos the number of frames announced
    by their packets; ``source[i]`` reads one frame where that is cheap, so not of videos.

    Attributes
    ----------
    shape : (int, int)
        Rows and columns of every frame, px.
    dtype : numpy.dtype
        Type of the grey values.
    notes : tuple of str
        What was done to the frames and what a user should know about them.
    fingerprint : str
        Digest of the first frame, its shape and type: tells recordings apart without reading them.

    Examples
    --------
    >>> from sixflow.frames import open_frames
    >>> source = open_frames([np.zeros((4, 5)), np.ones((4, 5))])
    >>> [float(frame.mean()) for frame in source]
    [0.0, 1.0]
    """

    _one_type = True
    """Whether frames of another type than the first are unlike it, as in files, or as good as any, as in memory."""

    def __init__(self) -> None:
        with contextlib.closing(self._raw(0)) as frames:
            found = next(frames, None)
            bad = found
            while found is not None and isinstance(found[1], BadFrame):  # the first that can be read
                found = next(frames, None)
        if found is None:
            if bad is not None and isinstance(bad[1], BadFrame):
                raise bad[1].error
            raise InputError(f"{self._origin()}: no frames; give at least two to measure a motion")
        self._first_name, frame = found
        assert not isinstance(frame, BadFrame)
        grey, grey_notes = to_grey(frame, self._first_name)
        self.shape: tuple[int, int] = (grey.shape[0], grey.shape[1])
        self.dtype: np.dtype[Any] = grey.dtype
        content = f"{grey.dtype.str} {grey.shape}".encode() + np.ascontiguousarray(grey).tobytes()
        self.fingerprint: str = hashlib.sha256(content).hexdigest()[:16]
        self.notes: tuple[str, ...] = tuple(dict.fromkeys((*self._own_notes(), *grey_notes)))

    @property
    @abc.abstractmethod
    def count(self) -> int | None:
        """Number of frames; None where only reading them would tell."""

    @abc.abstractmethod
    def _raw(self, start: int) -> Generator[tuple[str, Array | BadFrame]]:
        """Yield name and stored pixels of the frames from number `start` on."""

    @abc.abstractmethod
    def _origin(self) -> str:
        """Return where the frames come from, in a few words."""

    @property
    def origin(self) -> str:
        """Where the frames come from, in a few words."""
        return self._origin()

    def _own_notes(self) -> tuple[str, ...]:
        return ()

    @property
    def times(self) -> Array | None:
        """Time of each frame, s, shape (count,); None where it is not recorded."""
        return None

    @property
    def numbers(self) -> range:
        """Number of each frame in the whole recording, of which this may be a part."""
        return range(self.count or 0)

    @property
    def metadata(self) -> Metadata:
        """What the recording says of itself besides its pixels."""
        return Metadata()

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each frame, for messages and plots; empty where the number of frames is unknown."""
        return tuple(f"frame {number}" for number in range(self.count or 0))

    @property
    def description(self) -> str:
        """One line about the recording."""
        number = "frames" if self.count is None else f"{self.count} frame{'s' * (self.count != 1)}"
        height, width = self.shape
        return f"{self._origin()}: {number} of {width}×{height} px, {self.dtype}"

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.description}>"

    def __len__(self) -> int:
        if self.count is None:
            raise TypeError("the number of frames is unknown until they have been read")
        return self.count

    def __bool__(self) -> bool:
        return True

    def __iter__(self) -> Iterator[Array]:
        return self.iterate()

    def iterate(self, start: int = 0) -> Iterator[Array]:
        """Yield the frames from number `start` on; earlier ones are skipped where the format allows.

        Raises
        ------
        FrameFileError
            If a file turns out to be damaged or missing.
        InputError
            If a frame has another shape or type than the first.
        """
        for frame in self.attempt(start):
            if isinstance(frame, BadFrame):
                raise frame.error
            yield frame

    def attempt(self, start: int = 0) -> Iterator[Array | BadFrame]:
        """Yield the frames from number `start` on; in place of one that cannot be read or used, a `BadFrame`.

        Raises
        ------
        FrameFileError
            If nothing that follows can be read.
        """
        for name, frame in self._raw(start):
            yield frame if isinstance(frame, BadFrame) else self._alike(name, frame)

    def _alike(self, name: str, frame: Array) -> Array | BadFrame:
        """The frame in grey, if it is like the first."""
        try:
            grey, _ = to_grey(frame, name)
        except InputError as error:
            return BadFrame(name, error)
        if grey.shape == self.shape and (grey.dtype == self.dtype or not self._one_type):
            return grey
        return BadFrame(
            name,
            InputError(
                f"{name} has {_format(grey.shape, grey.dtype)}, but {self._first_name} has "
                f"{_format(self.shape, self.dtype)}; all frames of a recording must be alike: "
                "crop, convert or leave out those that differ"
            ),
        )

    def __getitem__(self, index: int) -> Array:
        """Read one frame; negative numbers count from the end."""
        count = len(self)
        if not -count <= index < count:
            raise InputError(f"frame {index}: the recording has the frames 0 to {count - 1}")
        return next(self.iterate(index % count))


class FileSource(FrameSource):
    """Files of one format, or one video.

    Where the first file holds one frame, every file is taken to hold one, so that a folder of thousands opens
    at once; a file with more is refused when it is met. Otherwise the frames of all files are counted first.
    """

    def __init__(self, found: FoundFiles) -> None:
        self._found = found
        first = self._open(0)
        self._first_file = first
        others = range(1, len(found.paths))
        if first.count == 1:
            self._counts = [1] * len(found.paths)
        else:
            self._counts = [first.count, *(self._open(number).count for number in others)]
        super().__init__()

    def _open(self, number: int) -> FrameFile:
        path = self._found.paths[number]
        require_readable(path)
        return self._found.format.open(path)

    @property
    def count(self) -> int:
        """Number of frames."""
        return sum(self._counts)

    @property
    def times(self) -> Array | None:
        """Time of each frame as the file states it, s; None for several files."""
        return self._first_file.times if len(self._counts) == 1 else None

    @property
    def metadata(self) -> Metadata:
        """What the first file says of itself."""
        return self._first_file.metadata

    @property
    def names(self) -> tuple[str, ...]:
        """File names, with the number of the frame where a file holds several."""
        return tuple(
            _frame_name(path.name, number, count)
            for path, count in zip(self._found.paths, self._counts, strict=True)
            for number in range(count)
        )

    @property
    def description(self) -> str:
        """One line about the recording."""
        detail = self._first_file.detail
        return super().description + (f", {detail}" if detail else "")

    def _origin(self) -> str:
        number = len(self._found.paths)
        if number == 1 or self._found.origin == f"{number} files":
            return self._found.origin
        return f"{self._found.origin} ({number} {self._found.format.name} files)"

    def _own_notes(self) -> tuple[str, ...]:
        return (*self._found.notes, *self._first_file.notes)

    def _raw(self, start: int) -> Generator[tuple[str, Array | BadFrame]]:
        ends = list(itertools.accumulate(self._counts))
        for number, (path, count) in enumerate(zip(self._found.paths, self._counts, strict=True)):
            before = ends[number] - count
            if ends[number] <= start:
                continue
            file = self._open(number) if number else self._first_file
            first = max(0, start - before)
            read = first
            for read, frame in enumerate(file.read(first), first + 1):
                if read > count:
                    raise FrameFileError(
                        f"{path}: holds more than {count} frame{'s' * (count != 1)}, unlike the first file; "
                        "give files of one frame each, or stacks only"
                    )
                yield _frame_name(str(path), read - 1, count), frame
            if read < count:
                raise FrameFileError(f"{path}: changed while it was read: {read} of {count} frames are left")

    def __getitem__(self, index: int) -> Array:
        """Read one frame of images or stacks.

        Raises
        ------
        InputError
            If the source is a video, whose frames depend on earlier ones, or there is no such frame.
        """
        if self._found.format.is_video:
            raise InputError(
                f"{self._found.origin}: single frames of a video cannot be read cheaply; "
                f"iterate over the source, or over source.iterate({index})"
            )
        return super().__getitem__(index)


class ArraySource(FrameSource):
    """Frames in an array of shape (n, h, w[, c]), in anything indexed like one, or in a list of arrays."""

    _one_type = False

    def __init__(self, frames: Any) -> None:
        shape = tuple(getattr(frames, "shape", ()))
        if shape and (len(shape) not in (3, 4) or (len(shape) == 3 and shape[2] <= 4 < shape[0])):
            raise InputError(
                f"frames: an array of shape {shape} is no recording; "
                "give (n, h, w), or (n, h, w, c) for colour, with n = 1 for a single frame"
            )
        self._frames = frames
        super().__init__()

    @property
    def count(self) -> int:
        """Number of frames."""
        return len(self._frames)

    def _origin(self) -> str:
        return (
            f"a {'list of arrays' if isinstance(self._frames, list | tuple) else type(self._frames).__name__}"
        )

    def _raw(self, start: int) -> Generator[tuple[str, Array | BadFrame]]:
        for number in range(start, self.count):
            yield f"frame {number}", np.asarray(self._frames[number])


class StreamSource(FrameSource):
    """Frames from an iterable of arrays, such as a generator or a camera; its length is unknown."""

    _one_type = False

    def __init__(self, frames: Iterable[Any]) -> None:
        iterator = iter(frames)
        self._frames: Iterable[Any] | None = frames
        self._is_one_shot = iterator is frames
        self._head: list[Any] = list(itertools.islice(iterator, 1)) if self._is_one_shot else []
        self._is_open = False
        super().__init__()
        self._is_open = True

    @property
    def count(self) -> None:
        """None: only reading tells."""
        return None

    def _origin(self) -> str:
        return f"a {type(self._frames).__name__}"

    def _raw(self, start: int) -> Generator[tuple[str, Array | BadFrame]]:
        if self._is_one_shot and not self._is_open:
            frames: Iterable[Any] = self._head  # the first look must not use up the stream
        elif self._is_one_shot:
            if not self._head:
                raise InputError(
                    f"frames from a {type(self._frames).__name__} can be read once, and have been; "
                    "give a list or an array"
                )
            frames = itertools.chain([self._head.pop()], self._frames or ())
        else:
            frames = self._frames or ()
        for number, frame in enumerate(frames):
            if isinstance(frame, str | os.PathLike):
                raise InputError(
                    f"frames: a {type(self._frames).__name__} of paths has no certain order; "
                    "give the pattern itself, or a sorted list of paths"
                )
            if number >= start:
                yield f"frame {number}", np.asarray(frame)


def _frame_name(name: str, number: int, count: int) -> str:
    return name if count == 1 else f"{name}[{number}]"


def _format(shape: tuple[int, ...], dtype: np.dtype[Any]) -> str:
    return f"{shape[1]}×{shape[0]} px of {dtype}"
