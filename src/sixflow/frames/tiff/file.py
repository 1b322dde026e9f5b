"""The frames of a TIFF file."""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import tifffile
from numpy.typing import NDArray

from sixflow.errors import FrameFileError, InputError
from sixflow.frames.axes import Axis, choose, pick, refuse_choices
from sixflow.frames.bad import BadFrame
from sixflow.frames.formats import FrameFile
from sixflow.frames.metadata import Metadata
from sixflow.frames.selection import Selection
from sixflow.frames.tiff import imagej
from sixflow.frames.tiff.chain import Chain, read_chain
from sixflow.frames.tiff.log import captured_log
from sixflow.frames.tiff.page import DAMAGE, Pages, Plane, damaged
from sixflow.frames.tiff.series import Series
from sixflow.frames.tiff.stacks import find_series
from sixflow.frames.units import length

Array: TypeAlias = NDArray[Any]

_MANY = 1000
"""Missing frames that are still named one by one, however few are there."""


@dataclasses.dataclass(frozen=True)
class _Layout:
    """What was found in a file: where its frames lie, and what it says of them."""

    planes: list[Plane | None]
    times: Array | None
    metadata: Metadata
    notes: tuple[str, ...]
    broken: str
    keep_indices: bool
    origin: str
    place: str
    applied: tuple[str, ...]


class TiffFile(FrameFile):
    """A TIFF file and its frames."""

    def __init__(self, path: Path, selection: Selection = Selection()) -> None:  # noqa: B008 - it is frozen
        super().__init__(path, selection)
        self._found: _Layout | None = None
        self._colour_notes: dict[str, None] = {}

    @property
    def count(self) -> int:
        """Number of frames, from the directories of pages; no pixels are read."""
        return len(self._layout.planes)

    @property
    def times(self) -> Array | None:
        """Times that the file states for its planes, or that follow from its frame interval, s."""
        return self._layout.times

    @property
    def origin(self) -> str:
        """Names the moment that times of several files count from; empty where each has its own."""
        return self._layout.origin

    @property
    def place(self) -> str:
        """Position, channel and slice that were taken of a set of files."""
        return self._layout.place

    @property
    def applied(self) -> tuple[str, ...]:
        """Which of channel, z and position the file has applied."""
        return self._layout.applied

    @property
    def metadata(self) -> Metadata:
        """Pixel size and frame interval of ImageJ and OME files."""
        return self._layout.metadata

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on axes, colours, missing pages and peculiar metadata."""
        return (*self._layout.notes, *self._colour_notes)

    @property
    def _layout(self) -> _Layout:
        if self._found is None:
            with self._opened() as (pages, chain), captured_log():
                self._found = self._look(pages, chain)
        return self._found

    def read(self, start: int = 0) -> Iterator[Array | BadFrame]:
        """Yield the frames from number `start` on.

        Raises
        ------
        FrameFileError
            If the file is no TIFF, or nothing in it can be read.
        InputError
            If it holds several channels, slices or positions of which none was chosen.
        """
        return self.frames(range(start, self.count))

    def frames(self, numbers: range) -> Iterator[Array | BadFrame]:
        """Yield the frames of these numbers; others are not read."""
        layout = self._layout
        with self._opened(layout.keep_indices) as (pages, _):
            for number in numbers:
                name = f"{self.path}[{number}]" if self.count > 1 else str(self.path)
                plane = layout.planes[number]
                if plane is None:
                    reason = f"frame {number} is not there{': ' * bool(layout.broken)}{layout.broken}"
                    yield BadFrame(name, damaged(self.path, reason, is_cut=True))
                    continue
                try:
                    pixels, notes = pages.decode(plane)
                except FrameFileError as error:
                    yield BadFrame(name, error)
                    continue
                self._colour_notes.update(dict.fromkeys(notes))
                yield pixels

    @contextlib.contextmanager
    def _opened(self, keep_indices: bool = False) -> Iterator[tuple[Pages, Chain]]:
        with contextlib.ExitStack() as resources:
            try:
                chain = read_chain(self.path)
                if chain is not None and not chain.offsets:
                    raise damaged(self.path, chain.broken, is_cut="begin as" not in chain.broken)
                with captured_log() as messages:
                    tif = resources.enter_context(tifffile.TiffFile(self.path, _multifile=False))
                    chain = Chain(tuple(range(len(tif.pages)))) if chain is None else chain
            except FrameFileError:
                raise
            except DAMAGE as error:
                raise damaged(self.path, str(error)) from error
            yield Pages(tif, self.path, keep_indices=keep_indices, messages=tuple(messages)), chain

    def _look(self, pages: Pages, chain: Chain) -> _Layout:
        """Find out where the frames are."""
        is_imagej = imagej.is_imagej(str(pages.tif.pages.first.description or ""))
        try:
            stacks = find_series(pages, chain, self.path)
        except DAMAGE as error:
            if isinstance(error, FrameFileError):
                raise
            raise damaged(self.path, str(error)) from error
        applied = []
        positions = Axis("P", [one.number for one in stacks], _names(stacks))
        if self.selection.position is not None and (len(stacks) > 1 or any(positions.names)):
            number = pick(self.selection.position, positions, "position", str(self.path))
            stacks = [one for one in stacks if one.number == number]
            applied.append("position")
        elif len(stacks) > 1:
            _refuse_several(stacks, self.path)
        series = stacks[0]
        choice = choose(series.axes, self.selection, str(self.path))
        codes = [axis.code for axis in series.axes]
        applied += [name for name, code in (("channel", "C"), ("z", "Z"), ("position", "P")) if code in codes]
        refuse_choices(self.selection, str(self.path), [*applied, "channel"])
        along = next((axis.numbers for axis in series.axes if axis.code == choice.along), range(1))
        _require_possible(len(along), series, chain, self.path)
        indices = [{**choice.fixed, **({choice.along: k} if choice.along else {})} for k in along]
        found = [series.plane(index) for index in indices]
        planes = [None if plane is None or plane.page >= len(chain.offsets) else plane for plane in found]
        if series.origin:  # frames of other channels and slices are other files' business
            kept = [k for k, plane in enumerate(planes) if plane is not None]
            indices, planes = [indices[k] for k in kept], [planes[k] for k in kept]
        missing = sum(plane is None for plane in planes)
        _require_most(len(planes), missing, self.path)
        notes = [*series.notes, *choice.notes, *_missing_notes(series, len(planes), missing, chain)]
        times, time_notes = _times(series, indices, choice.along)
        place = _place(series, choice.fixed) if series.origin else ""
        return _Layout(
            planes, times, _metadata(series), (*notes, *time_notes), chain.broken, is_imagej, series.origin, place,
            tuple(applied),
        )  # fmt: skip


def _names(stacks: list[Series]) -> tuple[str, ...]:
    names = [""] * (max(one.number for one in stacks) + 1)
    for one in stacks:
        names[one.number] = one.name
    return tuple(names)


def _refuse_several(stacks: list[Series], path: Path) -> None:
    shown = "; ".join(one.describe() for one in stacks[:8]) + ("; …" if len(stacks) > 8 else "")
    raise InputError(
        f"{path} holds {len(stacks)} positions or series (position=): {shown}; choose one: they are not frames of one "
        "recording"
    )


def _require_possible(count: int, series: Series, chain: Chain, path: Path) -> None:
    """Refuse a claim of more frames than the file has room for, before they are counted one by one."""
    room = path.stat().st_size // max(1, series.size[0] * series.size[1])
    if count > 2 * max(room, len(chain.offsets)) + 2 * _MANY:
        raise damaged(path, f"it states {count} frames, for which it is too short", is_cut=True)


def _require_most(count: int, missing: int, path: Path) -> None:
    """Refuse a file that claims far more frames than it holds."""
    if missing > _MANY and missing > count / 2:
        raise damaged(path, f"it states {count} frames, of which {count - missing} are there", is_cut=True)


def _missing_notes(series: Series, count: int, missing: int, chain: Chain) -> list[str]:
    notes = []
    if missing and series.stated:
        notes.append(
            f"the file states {count} frames, {count - missing} are there: it is cut short or damaged"
        )
    elif missing:
        notes.append(f"the file is cut short or damaged: {chain.broken or 'pages are missing'}")
    there = next((len(axis.numbers) for axis in series.axes if axis.code == "T"), 1)
    if series.times is not None and series.times > there:
        notes.append(f"the file states {series.times} times, {there} are there")
    return notes


def _times(
    series: Series, indices: Sequence[Mapping[str, int]], along: str | None
) -> tuple[Array | None, list[str]]:
    """Times of the frames: stated for each, or multiples of the interval."""
    places = [(index.get("T", 0), index.get("C", 0), index.get("Z", 0)) for index in indices]
    stamps = np.array([series.stamps.get(place, math.nan) for place in places])
    stated = np.isfinite(stamps)
    if stated.all() and stamps.size and (np.diff(stamps) > 0).all() and (stamps.size > 1 or series.origin):
        return stamps, []
    notes = []
    if stated.any() and stamps.size > 1:
        notes.append(
            "the times that the file states for single frames (DeltaT) are incomplete or do not grow: left out"
        )
    if series.interval is None or (along is None and not series.origin):
        return None, notes
    counted = [index.get(along, 0) for index in indices] if along else [place[0] for place in places]
    return np.array(counted, dtype=float) * series.interval, notes


def _place(series: Series, fixed: Mapping[str, int]) -> str:
    parts = [f"position {series.number} {series.name!r}"]
    parts += [f"{word} {fixed[code]}" for code, word in (("C", "channel"), ("Z", "slice")) if code in fixed]
    return ", ".join(parts)


def _metadata(series: Series) -> Metadata:
    """Pixel size in its unit, aspect and frame interval."""
    width, height = series.pixel
    aspect, size, unit = series.aspect, None, None
    found = length(width[1]) if width is not None else None
    if width is not None and found is not None:
        size, unit = width[0], found[0]
        other = length(height[1]) if height is not None else None
        if height is not None and other is not None:
            scale = 1.0 if other[0] == found[0] else other[1] / found[1]
            aspect = height[0] * scale / width[0] if math.isfinite(scale) else 1.0
    return Metadata(size, unit, series.interval, aspect)
