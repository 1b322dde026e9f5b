"""Part: some frames of a recording, which keep their numbers."""

from __future__ import annotations

import functools
from collections.abc import Generator, Iterator
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from sixflow.errors import InputError
from sixflow.frames.bad import BadFrame
from sixflow.frames.metadata import Metadata
from sixflow.frames.source import FrameSource, Raw, all_of, digest_of, strict

Array: TypeAlias = NDArray[Any]


class PartSource(FrameSource):
    """Some frames of a recording, evenly spaced.

    Parameters
    ----------
    whole : FrameSource
    frames : slice
        Of the frames of `whole`; runs forwards.

    Raises
    ------
    InputError
        If there are no such frames, or the slice runs backwards.
    """

    def __init__(self, whole: FrameSource, frames: slice) -> None:
        step = 1 if frames.step is None else frames.step
        ends = [end for end in (frames.start, frames.stop) if end is not None]
        if not isinstance(step, int) or not all(isinstance(end, int | np.integer) for end in ends):
            raise InputError(f"frames {_slice(frames)}: numbers of frames are whole")
        if step < 1:
            raise InputError(f"frames {_slice(frames)}: a recording runs forwards; take a step of at least 1")
        if whole.count is None and any(end < 0 for end in ends):
            raise InputError(
                f"frames {_slice(frames)}: the number of frames is unknown; count from the beginning"
            )
        self._whole = whole
        self._range = all_of(whole.count)[frames]
        if not self._range:
            known = f"has the frames 0 to {whole.count - 1}" if whole.count else "is of unknown length"
            raise InputError(f"frames {_slice(frames)}: there is none; the recording {known}")
        self.shape, self.dtype, self.rounding = whole.shape, whole.dtype, whole.rounding

    @property
    def count(self) -> int | None:
        """Number of frames."""
        return None if self._whole.count is None else len(self._range)

    @functools.cached_property
    def _digest(self) -> str:  # type: ignore[override]
        return digest_of(next(strict(self._whole._attempt(self._range))))

    @property
    def times(self) -> Array | None:
        """Time of each frame, s; None where it is not recorded."""
        times = self._whole.times
        return None if times is None else times[self._range.start : self._range.stop : self._range.step]

    @property
    def numbers(self) -> range:
        """Number of each frame in the whole recording."""
        return self._whole.numbers[self._range.start : self._range.stop : self._range.step]

    @property
    def metadata(self) -> Metadata:
        """What the whole recording says of itself."""
        return self._whole.metadata

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each frame."""
        return tuple(self._whole.names[self._range.start : self._range.stop : self._range.step])

    @property
    def files(self) -> tuple[str, ...]:
        """Name of the file of each frame; empty where frames do not come from several files."""
        return self._whole.files[self._range.start : self._range.stop : self._range.step]

    @property
    def gaps(self) -> tuple[int, ...]:
        """Numbers of the frames of the whole recording before which others may be missing."""
        return self._whole.gaps

    @property
    def joints(self) -> tuple[int, ...]:
        """Numbers of the frames of the whole recording with which a further file of several frames begins."""
        return self._whole.joints

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on the whole recording, as far as it has been read."""
        return self._whole.notes

    def _origin(self) -> str:
        last = "" if self.count is None else f" to {self.numbers[-1]}"
        first = self.numbers[0] if self.count is not None else self._range.start
        every = f", every {self._range.step}" if self._range.step > 1 else ""
        return f"{self._whole.description.partition(': ')[0]}, frames {first}{last}{every}"

    def _raw(self, numbers: range) -> Generator[Raw]:
        yield from self._whole._raw(self._range[numbers.start : numbers.stop : numbers.step])

    def _attempt(self, numbers: range) -> Iterator[Array | BadFrame]:
        return self._whole._attempt(self._range[numbers.start : numbers.stop : numbers.step])

    def _one(self, number: int) -> Array:
        return self._whole._one(self._range[number])


def _slice(frames: slice) -> str:
    ends = ["" if end is None else str(end) for end in (frames.start, frames.stop, frames.step)]
    return ":".join(ends[:2] if frames.step is None else ends)
