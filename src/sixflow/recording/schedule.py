"""Recording: the frames of a recording as they are measured, which of them are pairs, and what is said of them.

| pairs | frames of pair n |
|---|---|
| "consecutive" | n and n + lag |
| "double" | 2n and 2n + 1 |
| "first", "incremental" | 0 and n + 1 |

Frames are counted by their place among those at hand, 0 to n − 1; their *number* is that in the whole recording, of
which they may be a selection.
"""

from __future__ import annotations

import bisect
import dataclasses
from collections.abc import Iterator, Sequence
from typing import Any, get_args

import numpy as np

from sixflow.checks import is_whole, require, require_choice
from sixflow.errors import InputError
from sixflow.frames import BadFrame, FrameSource
from sixflow.frames.digests import FrameDigests
from sixflow.frames.doubles import Doubles
from sixflow.frames.metadata import Metadata
from sixflow.frames.source import Array
from sixflow.frames.times import FrameTimes, Pairs, PairTimes, Times, given_times, recorded_times
from sixflow.settings import Settings

DOUBLED = (
    'CHECK THE PAIRS: the files come in twos, such as {} and {}, which are the pairs of pairs="double"; here it is '
    "pairs={!r}"
)


@dataclasses.dataclass(frozen=True)
class Schedule:
    """Which frames make pairs.

    Attributes
    ----------
    pairs : {"consecutive", "double", "first", "incremental"}
    lag : int
        Frames from the first to the second of a consecutive pair, at least 1.

    Raises
    ------
    InputError
        If there is no such kind of pairs, or `lag` is no whole number of frames, or not meant for them.
    """

    pairs: Pairs
    lag: int = 1

    def __post_init__(self) -> None:
        require_choice("pairs", self.pairs, get_args(Pairs))
        lag = self.lag
        require(is_whole(lag, 1), "lag", lag, "must be a whole number of frames, at least 1")
        if lag != 1 and self.pairs != "consecutive":
            raise InputError(f"lag={lag}: goes with pairs='consecutive' only, but pairs={self.pairs!r}")

    def first(self, place: int) -> int | None:
        """Place of the frame that a frame is compared with; None for one that ends no pair."""
        if self.pairs == "double":
            return place - 1 if place % 2 else None
        if self.pairs == "consecutive":
            return place - self.lag if place >= self.lag else None
        return 0 if place else None

    def end(self, pair: int) -> int:
        """Place of the frame that ends the pair before this one; less than any if this is the first."""
        return 2 * pair - 1 if self.pairs == "double" else pair - 1 + self.lag

    def begins(self, place: int, skip: int) -> bool:
        """Whether a frame begins a pair that is not among the first `skip`."""
        return place >= (2 * skip if self.pairs == "double" else skip)

    def count(self, frames: int) -> int:
        """Number of pairs that so many frames make."""
        return frames // 2 if self.pairs == "double" else max(0, frames - self.lag)

    @property
    def attrs(self) -> dict[str, Any]:
        """What the attributes of a field say of it."""
        return {"pairs": self.pairs} | ({"lag": int(self.lag)} if self.lag != 1 else {})


class Recording:
    """The frames of a recording, in the order in which they are measured.

    Parameters
    ----------
    source : FrameSource
    schedule : Schedule
    times : sequence, optional
        As a user gives them.
    settings : Settings
        As a user gives them; `settings` of the object holds the calibration of the source as well.
    digests : FrameDigests, optional
        Compares the frames with those that were measured before, or remembers them.

    Raises
    ------
    InputError
        If the times cannot be used, or the files do not make the pairs that were asked for.

    Attributes
    ----------
    settings : Settings
    times : FrameTimes
    notes : tuple of str
        On times, calibration and the names of the files.
    seen : int
        Frames handed out so far.
    """

    def __init__(
        self,
        source: FrameSource,
        schedule: Schedule,
        times: Times | None,
        settings: Settings,
        digests: FrameDigests | None = None,
    ) -> None:
        self.source, self.schedule, self.seen = source, schedule, 0
        self._digests = digests
        self.numbers: Sequence[int] = source.numbers
        self.files = source.files
        self._width = max(map(len, self.files), default=1)
        self.times = self._times(times, settings.frame_interval)
        self.settings, remarks = _calibrated(settings, source.metadata, self.times, self.numbers)
        self.notes = (*self._on_files(), *self.times.notes, *remarks)
        self._told: set[str] = set()
        self._before: tuple[int, bytes | None] = (-1, None)

    def _times(self, times: Times | None, frame_interval: float | None) -> FrameTimes:
        source, double = self.source, self.schedule.pairs == "double"
        if times is not None:
            return given_times(times, source.count, self.numbers, frame_interval, double)
        stated, resolution = source.metadata.frame_interval, source.metadata.time_resolution
        known = recorded_times(source.times, stated, resolution, self.numbers, frame_interval, double)
        # what a user says of all frames holds for those of further files too
        leaps = sorted({*source.gaps, *(source.joints if frame_interval is None else ())})
        crossed = [k for k in range(1, len(self.numbers)) if self._between(leaps, k)]
        if not crossed or known.stamps is not None:
            return known
        names = source.names
        text = ", ".join(f"{names[k - 1]} and {names[k]}" for k in crossed[:3]) + ", …" * (len(crossed) > 3)
        note = f"frames may be missing between {text}: the time between them is unknown, and no rates are given there"
        return dataclasses.replace(known, breaks=tuple(leaps), notes=(*known.notes, note))

    def _between(self, leaps: Sequence[int], place: int) -> bool:
        """Whether others may be missing between a frame and the one before."""
        before, here = (bisect.bisect_right(leaps, self.numbers[k]) for k in (place - 1, place))
        return here > before

    def _on_files(self) -> tuple[str, ...]:
        """What the names of the files say of the pairs."""
        names, doubles = self.source.names, Doubles.among(self.files)
        if self.schedule.pairs != "double":
            return () if doubles is None else (DOUBLED.format(names[0], names[1], self.schedule.pairs),)
        odd = None if doubles is None else doubles.unmatched()
        if odd is not None:
            raise InputError(
                f"pairs='double': {names[odd]} and {names[odd + 1]} would be a pair, but their names say that they are "
                "not; leave out the file whose partner is missing, or list the files in the order of the pairs"
            )
        count = self.source.count
        if count is None or count % 2 == 0 or count < 2:
            return ()
        return (f"{self.name(count - 1)} is left over: it has no partner",)

    def number(self, place: int) -> int:
        """Number of a frame in the whole recording."""
        return self.numbers[place] if place < len(self.numbers) else place

    def place(self, number: int) -> int:
        """Place of a frame among those at hand, by its number in the whole recording."""
        return self.numbers.index(number) if number in self.numbers else number

    def name(self, place: int) -> str:
        """Name of a frame, for messages."""
        number = f"frame {self.number(place)}"
        return f"{number} ({self.files[place]})" if place < len(self.files) else number

    def frames(self) -> Iterator[Array | BadFrame]:
        """The frames one after the other; in place of one that cannot be read, a `BadFrame`."""
        frames = self.source.attempt()
        for frame in frames if self._digests is None else self._digests.watch(frames, self.name):
            self.seen += 1
            yield frame

    def remember(self, place: int, digest: bytes | None) -> str | None:
        """Compare a frame with the one before by their digests; what is to be said if it repeats that.

        Parameters
        ----------
        place : int
        digest : bytes or None
            None of a frame that has none, since it cannot be used.
        """
        before, self._before = self._before, (place, digest)
        if digest is None or before != (place - 1, digest):
            return None
        note = (
            f"{self.name(place)} repeats {self.name(place - 1)} to the last bit: other pairs of it may span another "
            "time than that between their frames"
        )
        self.notes = (*self.notes, note)
        return note

    def check_count(self) -> None:
        """Raise InputError if the frames that have been seen make no pair, or times were given for others."""
        least = 1 + self.schedule.lag
        if self.seen < least:
            lag = f"; lag={self.schedule.lag} needs" if self.schedule.lag > 1 else "; a motion needs"
            raise InputError(f"frames: {self.seen} given{lag} at least {least if least > 2 else 'two'}")
        stamps = self.times.stamps
        if self.source.count is None and stamps is not None and len(stamps) != self.seen:
            raise InputError(
                f"times has {len(stamps)} values for {self.seen} frames: give one time per frame"
            )

    def left_over(self) -> tuple[str, ...]:
        """Say that the last frame has no partner, where that shows only in the end."""
        if self.schedule.pairs != "double" or self.source.count is not None or self.seen % 2 == 0:
            return ()
        return (f"{self.name(self.seen - 1)} is left over: it has no partner",)

    def times_of(self, places: tuple[int, int]) -> PairTimes:
        """Times of a pair of frames."""
        numbers = self.number(places[0]), self.number(places[1])
        return self.times.of_pair(places, numbers, self.schedule.pairs, self.settings.reference)

    def names_of(self, places: tuple[int, int]) -> Array | None:
        """Names of the files of a pair, as text of one width for the whole recording."""
        if places[1] >= len(self.files):
            return None
        return np.array([self.files[place] for place in places], dtype=f"U{self._width}")

    def news(self) -> tuple[str, ...]:
        """Notes that have not been handed out yet."""
        fresh = [note for note in (*self.notes, *self.source.notes) if note not in self._told]
        self._told.update(fresh)
        return tuple(dict.fromkeys(fresh))


def _calibrated(
    settings: Settings, stated: Metadata, times: FrameTimes, numbers: Sequence[int]
) -> tuple[Settings, tuple[str, ...]]:
    """The settings with what a recording states where they say nothing, and notes on that."""
    changes: dict[str, Any] = {}
    notes = []
    if settings.pixel_size is None and stated.pixel_size is not None and stated.length_unit:
        size = f"{stated.pixel_size:g} {stated.length_unit}"
        if settings.length_unit in (Settings.length_unit, stated.length_unit):
            changes = {"pixel_size": float(stated.pixel_size), "length_unit": stated.length_unit}
            notes.append(f"the size of a pixel, {size}, is that of the recording's metadata")
        else:
            notes.append(
                f"the recording states {size} for the size of a pixel; it is not used, since "
                f"length_unit={settings.length_unit!r} was given: give pixel_size too"
            )
    interval = stated.frame_interval
    if settings.frame_interval is None and interval is not None and times.follow(interval, numbers):
        changes["frame_interval"] = float(interval)
        notes.append(f"the frame interval, {interval:g} s, is that of the recording's metadata")
    return settings.replace(**changes), tuple(notes)
