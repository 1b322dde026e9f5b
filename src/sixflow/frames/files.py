"""Files: a recording in one file or many of a kind."""

from __future__ import annotations

import bisect
import dataclasses
import itertools
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from sixflow.errors import FrameFileError, InputError, SixflowError
from sixflow.frames.axes import refuse_choices
from sixflow.frames.bad import BadFrame
from sixflow.frames.formats import FrameFile
from sixflow.frames.metadata import Metadata
from sixflow.frames.notebook import Notebook
from sixflow.frames.paths import FoundFiles, require_readable
from sixflow.frames.selection import Selection
from sixflow.frames.source import FrameSource, Raw

Array: TypeAlias = NDArray[Any]


@dataclasses.dataclass(frozen=True)
class _Known:
    """What is known of a file before it is read; as of `FrameFile`."""

    count: int
    place: str
    origin: str
    times: Array | None


class FileSource(FrameSource):
    """Files of one format, of which each holds one frame or several.

    Where the first file holds one frame, every file is taken to hold one, so that a folder of thousands opens
    at once; a file with more is refused when it is met. Otherwise the frames of all files are counted first. A file
    that cannot be read among others is a bad frame.

    Parameters
    ----------
    found : FoundFiles
    selection : Selection
        Of its channel, slice and position.
    """

    def __init__(self, found: FoundFiles, selection: Selection = Selection()) -> None:  # noqa: B008 - it is frozen
        self._found, self._selection = found, selection
        self._first_place, self._first = self._first_that_opens()
        self._file_notes = Notebook()
        self._own: list[str] = []
        known = self._survey()
        self._counts = [1 if one is None else one.count for one in known]
        self._ends = list(itertools.accumulate(self._counts))
        _require_one_recording(found, known)
        self._known_times = self._join_times(known)
        applied = self._first.applied
        refuse_choices(selection, str(self._first.path), [*applied, "channel"])
        taken = dataclasses.replace(selection, channel=None) if "channel" in applied else selection
        super().__init__(taken)

    def _open(self, number: int) -> FrameFile:
        path, selection = self._found.paths[number], self._selection
        require_readable(path)
        dataset = self._found.datasets[number] if self._found.datasets else None
        if dataset is not None:
            if selection.position not in (None, dataset):
                raise InputError(
                    f"position={selection.position!r}: the array {dataset!r} is named with the file already; "
                    "leave one out"
                )
            selection = dataclasses.replace(selection, position=dataset)
        return self._found.format.open(path, selection)

    def _file(self, place: int) -> FrameFile:
        return self._first if place == self._first_place else self._open(place)

    def _first_that_opens(self) -> tuple[int, FrameFile]:
        """The first file that can be read, and its place: a recording may begin with one that cannot."""
        error: FrameFileError | None = None
        for place in range(len(self._found.paths)):
            try:
                file = self._open(place)
                if file.count > 0:
                    return place, file
            except FrameFileError as problem:
                error = error or problem
        raise error or FrameFileError(f"{self._found.origin}: no frames")

    def _survey(self) -> list[_Known | None]:
        """What is known of each file before it is read; None of one that cannot be opened."""
        if self._first.count == 1 and not self._first.place:
            return [_Known(1, "", "", self._first.times if len(self._found.paths) == 1 else None)] * len(
                self._found.paths
            )
        known: list[_Known | None] = []
        for place in range(len(self._found.paths)):
            try:
                file = self._file(place)
                known.append(_Known(file.count, file.place, file.origin, file.times))
            except FrameFileError:
                known.append(None)  # a bad frame in its place
        return known

    def _join_times(self, known: list[_Known | None]) -> Array | None:
        """Times of all frames, where the files count them from one moment."""
        first = self._first
        if len(known) == 1 or first.times is None:
            return first.times
        if not first.origin:
            if max(self._counts) > 1:
                self._own.append(
                    "the times of the files are not used: each file counts from its own beginning, and the time "
                    "between them is unknown"
                )
            return None
        times = [
            one.times
            for one in known
            if one is not None and one.origin == first.origin and one.times is not None
        ]
        if len(times) < len(known):
            return None
        joined = np.concatenate(times)
        if (np.diff(joined) > 0).all():
            return joined
        self._own.append("the times that the files state do not grow in this order: left out")
        return None

    @property
    def count(self) -> int:
        """Number of frames."""
        return sum(self._counts)

    @property
    def times(self) -> Array | None:
        """Time of each frame as the files state it, s; None where each file counts from its own beginning."""
        return self._known_times

    @property
    def metadata(self) -> Metadata:
        """What the first file says of itself."""
        return self._first.metadata

    @property
    def names(self) -> tuple[str, ...]:
        """File names, with the number of the frame where a file holds several."""
        return tuple(
            _frame_name(path.name, number, count)
            for path, count in zip(self._found.paths, self._counts, strict=True)
            for number in range(count)
        )

    @property
    def files(self) -> tuple[str, ...]:
        """Name of the file of each frame; empty for one file."""
        if len(self._counts) == 1:
            return ()
        counted = zip(self._found.paths, self._counts, strict=True)
        return tuple(path.name for path, count in counted for _ in range(count))

    @property
    def gaps(self) -> tuple[int, ...]:
        """Numbers of the frames before which others may be missing, by the names of the files."""
        return tuple(self._ends[place - 1] for place in self._found.gaps)

    @property
    def joints(self) -> tuple[int, ...]:
        """Numbers of the frames with which a further file begins, where files hold several."""
        return tuple(self._ends[:-1]) if max(self._counts) > 1 else ()

    @property
    def description(self) -> str:
        """One line about the recording."""
        detail = self._first.detail
        return super().description + (f", {detail}" if detail else "")

    def _origin(self) -> str:
        number = len(self._found.paths)
        if number == 1 or self._found.origin == f"{number} files":
            return self._found.origin
        return f"{self._found.origin} ({number} {self._found.format.name} files)"

    def _own_notes(self) -> tuple[str, ...]:
        return (*self._found.notes, *self._own, *self._first.notes, *self._file_notes.notes)

    def _raw(self, numbers: range) -> Generator[Raw]:
        if not numbers:
            return
        for place in range(bisect.bisect_right(self._ends, numbers[0]), len(self._counts)):
            before = self._ends[place] - self._counts[place]
            wanted = _inside(numbers, before, self._ends[place])
            if before > numbers[-1]:
                return
            if wanted:
                yield from self._of_file(place, before, wanted)

    def _of_file(self, place: int, before: int, wanted: range) -> Iterator[Raw]:
        """Yield frames of one file, which are numbered from `before` on."""
        path, count = self._found.paths[place], self._counts[place]
        inside = range(wanted.start - before, wanted.stop - before, wanted.step)
        given = iter(inside)
        try:
            file = self._file(place)
            if count == 1 and file.count > 1:
                raise FrameFileError(
                    f"{path}: holds more than {count} frame{'s' * (count != 1)}, unlike the first file; "
                    "give files of one frame each, or stacks only"
                )
            for frame in file.frames(inside):
                k = next(given, None)
                if k is None:
                    break
                self._take_notes(file, place, path)
                yield before + k, _frame_name(str(path), k, count), frame
            self._take_notes(file, place, path)
        except SixflowError as error:
            if len(self._counts) == 1:
                raise
            for k in given:
                yield before + k, _frame_name(str(path), k, count), BadFrame(str(path), error)
        for k in given:
            lost = FrameFileError(f"{path}: changed while it was read: {k} of {count} frames are left")
            yield before + k, _frame_name(str(path), k, count), BadFrame(str(path), lost)

    def _take_notes(self, file: FrameFile, place: int, path: Path) -> None:
        if file is self._first:
            return
        stated, first = file.metadata, self._first.metadata
        notes = [note for note in file.notes if note not in self._first.notes]
        for name in ("pixel_size", "length_unit", "frame_interval", "pixel_aspect"):
            if getattr(stated, name) != getattr(first, name):
                notes.append(f"states {name} {getattr(stated, name)}, the first file {getattr(first, name)}")
        self._file_notes.take(notes, place + 1, path.name)

    def _one(self, number: int) -> Array:
        """Read one frame of images or stacks.

        Raises InputError if the source is a video, whose frames depend on earlier ones.
        """
        if self._found.format.is_video:
            raise InputError(
                f"{self._found.origin}: single frames of a video cannot be read cheaply; "
                f"iterate over the source, or over source.iterate({number})"
            )
        return super()._one(number)


def _require_one_recording(found: FoundFiles, known: list[_Known | None]) -> None:
    """Refuse files of one set that hold several positions, channels or slices."""
    places: dict[str, str] = {}
    for one, path in zip(known, found.paths, strict=True):
        if one is not None:
            places.setdefault(one.place, path.name)
    if len(places) > 1:
        shown = "; ".join(
            f"{place or 'another recording'} in {name}" for place, name in list(places.items())[:8]
        )
        raise InputError(
            f"{found.origin}: the files of one set hold several recordings: {shown}; give those of one"
        )


def _inside(numbers: range, begin: int, end: int) -> range:
    """Those of a range of numbers that lie in [begin, end)."""
    skipped = max(0, -(-(begin - numbers.start) // numbers.step))
    return range(numbers.start + skipped * numbers.step, min(end, numbers.stop), numbers.step)


def _frame_name(name: str, number: int, count: int) -> str:
    return name if count == 1 else f"{name}[{number}]"
