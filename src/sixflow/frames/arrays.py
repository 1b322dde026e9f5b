"""Arrays: a recording in an array, in anything indexed like one, in a list of frames, or in a stream of them."""

from __future__ import annotations

import itertools
import os
from collections.abc import Generator, Iterable, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from sixflow.errors import InputError, SixflowError
from sixflow.frames.axes import refuse_choices
from sixflow.frames.bad import BadFrame
from sixflow.frames.labelled import Labelled, LabelledFrames, codes_of_shape
from sixflow.frames.metadata import Metadata
from sixflow.frames.selection import Selection
from sixflow.frames.source import FrameSource, Raw

Array: TypeAlias = NDArray[Any]


class ArraySource(FrameSource):
    """Frames in an array, or in anything indexed like one.

    Parameters
    ----------
    frames : Labelled or array-like, shape (n, h, w) or (n, h, w, c)
        What is indexed like an array: a memory map, an HDF5 dataset, a Zarr or Dask array.
    selection : Selection
        Of channel, slice and position.
    """

    _one_scale = False

    def __init__(self, frames: Any, selection: Selection = Selection()) -> None:  # noqa: B008 - it is frozen
        labelled = frames if isinstance(frames, Labelled) else _by_shape(frames)
        self._kind = type(labelled.data).__name__
        self._frames = LabelledFrames(labelled, selection, f"frames (a {self._kind})")
        has = [code in labelled.codes for code in "CZP"]
        applied = [name for name, there in zip(("channel", "z", "position"), has, strict=True) if there]
        refuse_choices(selection, "the array", [*applied, "channel"])
        super().__init__(Selection() if "channel" in applied else selection)

    @property
    def count(self) -> int:
        """Number of frames."""
        return self._frames.count

    @property
    def times(self) -> Array | None:
        """Time of each frame, s, where the array has a coordinate of it."""
        return self._frames.times

    @property
    def metadata(self) -> Metadata:
        """What coordinates and attributes say."""
        return self._frames.array.metadata

    def _origin(self) -> str:
        return f"a {self._kind}"

    def _own_notes(self) -> tuple[str, ...]:
        return self._frames.notes

    def _raw(self, numbers: range) -> Generator[Raw]:
        for number, frame in zip(numbers, self._frames.frames(numbers), strict=False):
            yield number, f"frame {number}", frame


def _by_shape(frames: Any) -> Labelled:
    """Give the axes of an array letters; a single picture is no recording."""
    shape = tuple(frames.shape)
    codes = codes_of_shape(shape, "frames") if len(shape) in (3, 4) else ()
    if "T" not in codes:
        raise InputError(
            f"frames: an array of shape {shape} is no recording; "
            "give (n, h, w), or (n, h, w, c) for colour, with n = 1 for a single frame"
        )
    if shape[0] == 0:
        raise InputError(f"a {type(frames).__name__}: no frames; give at least two to measure a motion")
    return Labelled(frames, codes, chunks=getattr(frames, "chunks", None))


class _IterableSource(FrameSource):
    """Frames that are handed out one by one; attributes `times` and `metadata` that their holder has are theirs."""

    _one_scale = False
    _frames: Iterable[Any]

    @property
    def times(self) -> Array | None:
        """Time of each frame, if their holder tells."""
        return getattr(self._frames, "times", None)

    @property
    def metadata(self) -> Metadata:
        """What their holder says of them."""
        said = getattr(self._frames, "metadata", None)
        return said if isinstance(said, Metadata) else Metadata()


class ListSource(_IterableSource):
    """Frames in a list or tuple of arrays."""

    def __init__(self, frames: Sequence[Any], selection: Selection = Selection()) -> None:  # noqa: B008 - it is frozen
        self._frames: Sequence[Any] = frames
        refuse_choices(selection, "the list of arrays", ["channel"])
        super().__init__(selection)

    @property
    def count(self) -> int:
        """Number of frames."""
        return len(self._frames)

    def _origin(self) -> str:
        return "a list of arrays"

    def _raw(self, numbers: range) -> Generator[Raw]:
        for number in numbers:
            name = f"frame {number}"
            yield number, name, _frame(self._frames[number], name)


class StreamSource(_IterableSource):
    """Frames from an iterable of arrays, such as a generator or a camera; its length is unknown."""

    def __init__(self, frames: Iterable[Any], selection: Selection = Selection()) -> None:  # noqa: B008 - it is frozen
        iterator = iter(frames)
        self._frames = frames
        self._is_one_shot = iterator is frames
        self._head: list[Any] = list(itertools.islice(iterator, 1)) if self._is_one_shot else []
        self._is_open = False
        refuse_choices(selection, "the stream of arrays", ["channel"])
        super().__init__(selection)
        self._is_open = True

    @property
    def count(self) -> None:
        """None: only reading tells."""
        return None

    def _origin(self) -> str:
        return f"a {type(self._frames).__name__}"

    def _raw(self, numbers: range) -> Generator[Raw]:
        if self._is_one_shot and not self._is_open:
            frames: Iterable[Any] = self._head  # the first look must not use up the stream
        elif self._is_one_shot:
            if not self._head:
                raise InputError(
                    f"frames from a {type(self._frames).__name__} can be read once, and have been; "
                    "give a list or an array"
                )
            frames = itertools.chain([self._head.pop()], self._frames)
        else:
            frames = self._frames
        for number, frame in enumerate(frames):
            if isinstance(frame, str | os.PathLike):
                raise InputError(
                    f"frames: a {type(self._frames).__name__} of paths has no certain order; "
                    "give the pattern itself, or a sorted list of paths"
                )
            if number in numbers:
                name = f"frame {number}"
                yield number, name, _frame(frame, name)
            if number >= numbers[-1]:
                return


def _frame(given: Any, name: str) -> Array | BadFrame:
    """One frame of a list or a stream as an array; a masked one stays masked."""
    if given is None or isinstance(given, str | bytes | os.PathLike):
        return BadFrame(
            name, InputError(f"{name} is {given!r}: give an array (h, w) or (h, w, c), or paths alone")
        )
    try:
        return np.asanyarray(given)
    except SixflowError as error:
        return BadFrame(name, error)
    except Exception as error:  # whatever the object raises that is asked for its values
        return BadFrame(
            name, InputError(f"{name}: a {type(given).__name__} is no array of grey values ({error})")
        )
