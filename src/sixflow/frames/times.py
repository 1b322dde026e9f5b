"""Times: when the frames of a recording were taken, and how much time passes in a pair of them.

| what is known | time of frame i | time in a pair (i, j) |
|---|---|---|
| a time of every frame | t_i, s | t_j − t_i, s |
| the time Δ between successive frames | n_i Δ, s | (n_j − n_i) Δ, s |
| the time Δ between the two frames of a pair (pairs="double") | n_i, frame | Δ, s |
| nothing | n_i, frame | n_j − n_i, frame |

n_i is the number of the frame in the whole recording. Nothing is taken from a pair's neighbours. Where frames are
missing between i and j, and no frame has a time of its own, the time in the pair is unknown: NaN.

*Which times count.* Times that a user gives count as they are, and may not contradict a frame interval that is given
with them. A frame interval that is given counts before the time stamps of a file, and these before the
frame interval that the file states.

*Rounded stamps.* A container counts time in units of its own, such as whole milliseconds. Stamps that are those of a
constant rate, rounded to this unit, are replaced by the constant rate: if one exists with |t_i − a − b n_i| ≤ unit/2.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from sixflow.errors import InputError
from sixflow.frames.seconds import Real, in_seconds

Pairs = Literal["consecutive", "double", "first", "incremental"]
Times: TypeAlias = Sequence[Any] | NDArray[Any]
"""Seconds, dates (datetime64 or datetime) or durations (timedelta64 or timedelta), one for each frame."""

AGREEMENT = 0.05
"""Share of a frame interval by which rounded times may differ from it and still say the same."""

_ROUNDING = 8  # units in the last place of the largest time, which sums and products of doubles leave

MEANING = {
    "first": "time of the reference frame",
    "middle": "time of the middle between the frames, in which the points lie",
    "second": "time of the second frame, in which the points lie",
}


@dataclasses.dataclass(frozen=True)
class PairTimes:
    """Times of one pair.

    Attributes
    ----------
    time : float
        When its points lie where they are; `meaning` in words.
    time0, time1 : float
        Of its two frames.
    unit : {"s", "frame"}
        Of these three.
    interval : float
        Elapsed time between the two frames; NaN if unknown.
    interval_unit : {"s", "frame"}
    meaning : str
    """

    time: float
    time0: float
    time1: float
    unit: str
    interval: float
    interval_unit: str
    meaning: str


@dataclasses.dataclass(frozen=True)
class FrameTimes:
    """What is known of the times of the frames of a recording.

    Attributes
    ----------
    stamps : array, shape (n,), or None
        Time of each frame, s.
    frame_interval : float or None
        Δ, s.
    double : bool
        Δ is the time between the two frames of a pair.
    breaks : tuple of int
        Frames before which others may be missing, by their number in the whole recording.
    notes : tuple of str
    """

    stamps: Real | None = None
    frame_interval: float | None = None
    double: bool = False
    breaks: tuple[int, ...] = ()
    notes: tuple[str, ...] = ()

    def of_pair(
        self, places: tuple[int, int], numbers: tuple[int, int], pairs: Pairs, reference: str
    ) -> PairTimes:
        """Times of the pair of two frames; InputError if there are fewer times than frames.

        Parameters
        ----------
        places : (int, int)
            Of the frames among those at hand.
        numbers : (int, int)
            Of the frames in the whole recording.
        pairs : str
            How pairs are made; joined ones tell the time of the moved frame.
        reference : {"first", "middle", "second"}
            Frame in which the points lie.
        """
        unit = "s" if self.stamps is not None or self._counted else "frame"
        time0, time1 = (self._time(*frame) for frame in zip(places, numbers, strict=True))
        interval, interval_unit = time1 - time0, unit
        if self.frame_interval is not None:
            apart = 1 if self.double else numbers[1] - numbers[0]
            interval, interval_unit = apart * self.frame_interval, "s"
            if unit == "s":
                time1 = time0 + interval
        if self.stamps is None or self.frame_interval is not None:
            missing = any(numbers[0] < leap <= numbers[1] for leap in self.breaks)
            interval = float("nan") if missing else float(interval)
        if pairs in ("first", "incremental"):
            return PairTimes(time1, time0, time1, unit, interval, interval_unit, "time of the moved frame")
        time = {"first": time0, "middle": (time0 + time1) / 2, "second": time1}[reference]
        return PairTimes(time, time0, time1, unit, interval, interval_unit, MEANING[reference])

    def follow(self, frame_interval: float, numbers: Sequence[int]) -> bool:
        """Whether the times are those of frames of these numbers that follow each other so."""
        if self.stamps is None:
            return self.frame_interval == frame_interval
        steps, expected = _steps(self.stamps, numbers, frame_interval)
        return steps.size > 0 and bool(np.allclose(steps, expected, rtol=1e-6, atol=0))

    @property
    def _counted(self) -> bool:
        """Whether a frame's number tells its time."""
        return self.frame_interval is not None and not self.double and not self.breaks

    def _time(self, place: int, number: int) -> float:
        if self.stamps is not None:
            if place >= len(self.stamps):
                raise InputError(
                    f"times has {len(self.stamps)} values, but there is a frame {place}: give one time per frame"
                )
            return float(self.stamps[place])
        return number * self.frame_interval if self._counted and self.frame_interval else float(number)


def given_times(
    times: Times, count: int | None, numbers: Sequence[int], frame_interval: float | None, double: bool
) -> FrameTimes:
    """Take the times that a user gives.

    Raises InputError if they are no times, do not grow from frame to frame, are not one for each frame, or contradict
    `frame_interval`.

    Parameters
    ----------
    times : sequence
        Seconds, dates or durations.
    count : int or None
        Number of frames, if it is known.
    numbers : sequence of int
        Of the frames in the whole recording; empty if unknown.
    frame_interval : float or None
        What is given beside them, s.
    double : bool
        Frames 0 and 1, 2 and 3 … are pairs, and `frame_interval` is the time between the two of them.
    """
    stamps, notes = in_seconds(times, "times")
    if count is not None and len(stamps) != count:
        raise InputError(f"times has {len(stamps)} values for {count} frames: give one time per frame")
    if frame_interval is not None:
        odd = _contradiction(stamps, numbers, frame_interval, double)
        if odd is not None:
            raise InputError(
                f"times and frame_interval={frame_interval!r} contradict each other: from frame {odd} to {odd + 1} "
                f"the times say {stamps[odd + 1] - stamps[odd]:.6g} s; give one of the two"
            )
    return FrameTimes(stamps, notes=notes)


def recorded_times(
    times: Times | None,
    stated: float | None,
    resolution: float,
    numbers: Sequence[int],
    frame_interval: float | None,
    double: bool,
) -> FrameTimes:
    """Take the times that a recording has, or the frame interval that is given or stated.

    Parameters
    ----------
    times : sequence or None
        Its time stamps.
    stated : float or None
        The frame interval that it states, s.
    resolution : float
        Unit in which it counts time, s; 0 if its stamps are exact.
    numbers : sequence of int
        Of the frames in the whole recording; empty if unknown.
    frame_interval : float or None
        The one that a user gives, s: it counts before all others.
    double : bool
        As for `given_times`.
    """
    stamps: Real | None = None
    notes: tuple[str, ...] = ()
    if times is not None:
        try:
            stamps, notes = in_seconds(times, "the time stamps of the recording")
        except InputError as error:
            notes = (f"{error}. They are not used",)
    if frame_interval is not None:
        if stamps is not None and _contradiction(stamps, numbers, frame_interval, double) is not None:
            notes += (
                f"the time stamps of the recording say {_typical(stamps)}; frame_interval={frame_interval:g} s, as "
                "given, counts",
            )
        return FrameTimes(stamps if double else None, frame_interval, double, notes=notes)
    if stamps is not None:
        even, remark = _evened(stamps, numbers, stated, resolution)
        return FrameTimes(even, notes=(*notes, *remark))
    return FrameTimes(None, stated, double, notes=notes)


def _contradiction(stamps: Real, numbers: Sequence[int], frame_interval: float, double: bool) -> int | None:
    """Place of the first frame from which to the next another time passes than the frame interval says."""
    steps, expected = _steps(stamps, numbers, frame_interval)
    if double:
        steps, expected = steps[::2], np.full(len(steps[::2]), frame_interval)
    apart = np.flatnonzero(np.abs(steps - expected) > AGREEMENT * expected)
    return int(apart[0]) * (2 if double else 1) if apart.size else None


def _steps(stamps: Real, numbers: Sequence[int], frame_interval: float) -> tuple[Real, Real]:
    """Time from each frame to the next, as the stamps and as a frame interval say."""
    return np.diff(stamps), np.diff(_counts(len(stamps), numbers)) * frame_interval


def _counts(frames: int, numbers: Sequence[int]) -> Real:
    """Numbers of the frames in the whole recording; their places where these are unknown."""
    known = np.asarray(numbers[:frames], dtype=np.float64)
    return known if len(known) == frames else np.arange(frames, dtype=np.float64)


def _typical(stamps: Real) -> str:
    steps = np.diff(stamps)
    if not steps.size:
        return "nothing of it"
    low, high = steps.min(), steps.max()
    return f"{low:.6g} s" if high - low <= 1e-6 * high else f"{low:.6g} to {high:.6g} s"


def _evened(
    stamps: Real, numbers: Sequence[int], stated: float | None, resolution: float
) -> tuple[Real, tuple[str, ...]]:
    """The stamps at a constant rate, if they are such stamps rounded; as they are otherwise."""
    if len(stamps) < 2:
        return stamps, ()
    count = _counts(len(stamps), numbers)
    slack = _ROUNDING * float(np.spacing(np.abs(stamps).max()))
    rates = [stated] if stated else []
    rates.append(_best_rate(stamps, count, resolution))
    for rate in rates:
        rest = stamps - rate * count
        if np.ptp(rest) <= resolution + slack:
            near = np.abs(rest - rest[0]).max() <= resolution / 2 + slack
            even = (rest[0] if near else (rest.max() + rest.min()) / 2) + rate * count
            if np.abs(even - stamps).max() <= 2 * slack:
                return even, ()
            remark = (
                f"the time stamps are rounded to {resolution:g} s: those of the constant rate that they fit, one frame "
                f"every {rate:.6g} s, are used"
            )
            return even, (remark,)
    return stamps, ()


def _best_rate(stamps: Real, count: Real, resolution: float) -> float:
    """Rate b of least width max(t − b n) − min(t − b n), a convex function of b, by golden sections."""
    span = count[-1] - count[0]
    mean = (stamps[-1] - stamps[0]) / span
    low, high = mean - 2 * resolution / span, mean + 2 * resolution / span
    golden = (np.sqrt(5) - 1) / 2
    for _ in range(60):
        left, right = high - golden * (high - low), low + golden * (high - low)
        if np.ptp(stamps - left * count) <= np.ptp(stamps - right * count):
            high = right
        else:
            low = left
    return float((low + high) / 2)
