"""Sources: a recording as grey frames of one shape and scale, read one at a time."""

from __future__ import annotations

import abc
import contextlib
import hashlib
import sys
from collections.abc import Generator, Iterator, Sequence
from typing import Any, TypeAlias, overload

import numpy as np
from numpy.typing import NDArray

from sixflow.errors import InputError
from sixflow.frames.bad import BadFrame
from sixflow.frames.grey import luminance_rounding, to_grey
from sixflow.frames.masked import without_mask
from sixflow.frames.metadata import Metadata
from sixflow.frames.notebook import Notebook
from sixflow.frames.selection import Selection

Array: TypeAlias = NDArray[Any]
Raw: TypeAlias = tuple[int, str, Array | BadFrame]
"""Number, name and stored pixels of a frame."""

_COLOURS = ("red", "green", "blue")

_SQUARE = 1e-3
"""Pixels whose aspect is this near to 1 are square."""


class FrameSource(abc.ABC):
    """A recording: iterate over it for its frames, as often as you like.

    Iteration yields arrays of shape `shape` and type `dtype`, one at a time: the recording never stands in
    memory as a whole. ``len(source)`` is the number of frames, and of videos the number of frames announced
    by their packets; ``source[i]`` reads one frame where that is cheap, so not of videos. ``source[2:9:3]`` is a
    source of these frames.

    Attributes
    ----------
    shape : (int, int)
        Rows and columns of every frame, px.
    dtype : numpy.dtype
        Type of the grey values. A later frame with transparent pixels, or in colour, comes as floats of the same scale.
    rounding : float
        Standard deviation of what rounding left in the grey values where they no longer show it (luminance of
        colours); otherwise 0.

    Examples
    --------
    >>> from sixflow.frames import open_frames
    >>> source = open_frames([np.zeros((4, 5)), np.ones((4, 5))])
    >>> [float(frame.mean()) for frame in source]
    [0.0, 1.0]
    """

    _one_scale = True
    """Whether frames of another stored type than the first are unlike it; not those in memory."""

    def __init__(self, selection: Selection = Selection()) -> None:  # noqa: B008 - it is frozen
        self._colour = selection.channel
        self._book = Notebook()
        bad: BadFrame | None = None
        first: tuple[str, Array] | None = None
        with contextlib.closing(self._raw(all_of(self.count))) as frames:
            for _, name, frame in frames:  # the first that can be read
                if not isinstance(frame, BadFrame):
                    first = name, frame
                    break
                bad = bad or frame
        if first is None:
            raise (
                InputError(f"{self._origin()}: no frames; give at least two to measure a motion")
                if bad is None
                else bad.error
            )
        self._first_name, frame = first
        self._scale = _scale(frame)
        self.rounding: float = luminance_rounding(frame)
        grey, notes = self._grey(*first)
        self._book.take(notes, 0, self._first_name)
        self.shape: tuple[int, int] = (grey.shape[0], grey.shape[1])
        self.dtype: np.dtype[Any] = grey.dtype
        self._digest = digest_of(grey)

    @property
    @abc.abstractmethod
    def count(self) -> int | None:
        """Number of frames; None where only reading them would tell."""

    @abc.abstractmethod
    def _raw(self, numbers: range) -> Generator[Raw]:
        """Yield the frames of these numbers; where their number is unknown, as far as they go."""

    @abc.abstractmethod
    def _origin(self) -> str:
        """Return where the frames come from, in a few words."""

    @property
    def origin(self) -> str:
        """Where the frames come from, in a few words."""
        return self._origin()

    def _own_notes(self) -> tuple[str, ...]:
        """Notes on the recording, and on frames as they are read."""
        return ()

    @property
    def notes(self) -> tuple[str, ...]:
        """What was done to the frames and what a user should know about them; complete when all have been read."""
        aspect = self.metadata.pixel_aspect
        shape = f"pixels are not square: they are {aspect:.4g} times as high as wide, which is not corrected"
        notes = (*self._own_notes(), *((shape,) if abs(aspect - 1) > _SQUARE else ()), *self._book.notes)
        return tuple(dict.fromkeys(notes))

    @property
    def fingerprint(self) -> str:
        """Digest of the first frame, its shape and type: tells recordings apart without reading them."""
        return self._digest

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
    def files(self) -> tuple[str, ...]:
        """Name of the file of each frame; empty where frames do not come from several files."""
        return ()

    @property
    def gaps(self) -> tuple[int, ...]:
        """Numbers of the frames before which others may be missing, by the names of the files."""
        return ()

    @property
    def joints(self) -> tuple[int, ...]:
        """Numbers of the frames with which a further file of several frames begins."""
        return ()

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
        return strict(self.attempt(start))

    def attempt(self, start: int = 0) -> Iterator[Array | BadFrame]:
        """Yield the frames from number `start` on; in place of one that cannot be read or used, a `BadFrame`.

        Raises
        ------
        FrameFileError
            If nothing that follows can be read.
        """
        return self._attempt(all_of(self.count)[start:])

    def _attempt(self, numbers: range) -> Iterator[Array | BadFrame]:
        for number, name, frame in self._raw(numbers):
            yield frame if isinstance(frame, BadFrame) else self._alike(number, name, frame)

    def _alike(self, number: int, name: str, frame: Array) -> Array | BadFrame:
        """The frame in grey, if it is like the first."""
        try:
            grey, notes = self._grey(name, frame)
        except InputError as error:
            return BadFrame(name, error)
        if grey.shape == self.shape and (_scale(frame) == self._scale or not self._one_scale):
            self._book.take(notes, number, name)
            return grey.astype(np.result_type(grey.dtype, self.dtype), copy=False)
        return BadFrame(
            name,
            InputError(
                f"{name} has {_format(grey.shape, _scale(frame))}, but {self._first_name} has "
                f"{_format(self.shape, self._scale)}; all frames of a recording must be alike: "
                "crop, convert or leave out those that differ"
            ),
        )

    def _grey(self, name: str, frame: Array) -> tuple[Array, tuple[str, ...]]:
        """The frame in grey, or the channel of a colour picture that was chosen."""
        if isinstance(frame, np.ma.MaskedArray):
            grey, notes = self._grey(name, without_mask(frame))
            hidden = bool(np.ma.getmaskarray(frame).any())
            return grey, (*notes, *(("masked pixels have no value",) if hidden else ()))
        channel = self._colour
        if channel is None or frame.ndim < 3 or frame.shape[2] < 3:
            if channel not in (None, 0, "0"):
                raise InputError(
                    f"channel={channel!r}: {name} has one channel only, number 0; leave channel out"
                )
            return to_grey(frame, name)
        text = str(channel).lower()
        number = _COLOURS.index(text) if text in _COLOURS else int(text) if text.isdecimal() else 3
        if number > 2:
            raise InputError(f"channel={channel!r}: {name} has the channels 0 'red', 1 'green', 2 'blue'")
        picked = frame[..., number : number + 1] if frame.shape[2] == 3 else frame[..., [number, 3]]
        grey, notes = to_grey(picked, name)
        return grey, (*notes, f"the {_COLOURS[number]} of the colours is read")

    @overload
    def __getitem__(self, index: int) -> Array: ...

    @overload
    def __getitem__(self, index: slice) -> FrameSource: ...

    def __getitem__(self, index: int | slice) -> Array | FrameSource:
        """Read one frame, or return a source of some; negative numbers count from the end.

        Raises
        ------
        InputError
            If there are no such frames.
        """
        if isinstance(index, slice):
            from sixflow.frames.part import PartSource

            return PartSource(self, index)
        count = len(self)
        if not -count <= index < count:
            raise InputError(f"frame {index}: the recording has the frames 0 to {count - 1}")
        return self._one(index % count)

    def _one(self, number: int) -> Array:
        return next(strict(self._attempt(range(number, number + 1))))


def all_of(count: int | None) -> range:
    """Return the numbers of so many frames, or of any number."""
    return range(sys.maxsize if count is None else count)


def strict(frames: Iterator[Array | BadFrame]) -> Iterator[Array]:
    """Yield frames up to a bad one, and raise its error."""
    for frame in frames:
        if isinstance(frame, BadFrame):
            raise frame.error
        yield frame


def digest_of(grey: Array) -> str:
    """Return a digest of a frame, its shape and type."""
    content = f"{grey.dtype.str} {grey.shape}".encode() + np.ascontiguousarray(grey).tobytes()
    return hashlib.sha256(content).hexdigest()[:16]


def _scale(frame: Array) -> np.dtype[Any]:
    """Type of a frame as stored: what its grey values mean, whether or not colour or alpha makes them floats."""
    dtype = np.dtype(np.uint8) if frame.dtype == bool else frame.dtype
    return dtype.newbyteorder("=")


def _format(shape: Sequence[int], dtype: np.dtype[Any]) -> str:
    return f"{shape[1]}×{shape[0]} px of {dtype}"
