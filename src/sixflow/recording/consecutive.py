"""Consecutive: the motion between frames that follow each other in a recording, at once, at a lag, or in twos."""

from __future__ import annotations

from collections.abc import Iterator

from sixflow.errors import BadFrameError
from sixflow.frames.bad import BadFrame
from sixflow.masks import AnyBodies, Masks
from sixflow.pair.result import PairResult
from sixflow.pair.session import Session
from sixflow.pair.unmeasured import Tried, try_frame, try_pair
from sixflow.recording.schedule import Recording


def consecutive(
    session: Session, recording: Recording, masks: Masks, skip: int
) -> Iterator[tuple[tuple[int, int], PairResult]]:
    """Yield the motion of each consecutive or double pair, and the places of its frames; the first `skip` are left out.

    Raises BadFrameError if not a single frame can be used.
    """
    schedule = recording.schedule
    held: dict[int, tuple[Tried, AnyBodies]] = {}
    waiting: list[int] = []  # frames that end pairs before the first good one, which gives the grid
    for place, raw in enumerate(recording.frames()):
        bodies, first = masks.at(place), schedule.first(place)
        wanted = place > schedule.end(skip) if first is not None else False
        # a frame that is in no wanted pair is read but not prepared; the first good one gives the grey constant
        if session.shape is None or wanted or schedule.begins(place, skip):
            held[place] = try_frame(session, recording, place, raw, bodies), bodies
        if wanted:
            waiting.append(place)
        if session.shape is not None:
            for end in waiting:
                yield _pair(session, recording, held, end)
            waiting.clear()
            held = {k: frame for k, frame in held.items() if k > place - schedule.lag}
    if waiting:
        bad = held[waiting[0]][0]
        assert isinstance(bad, BadFrame)
        raise BadFrameError(f"no frame of the recording can be used; {bad.error}") from bad.error


def _pair(
    session: Session,
    recording: Recording,
    held: dict[int, tuple[Tried, AnyBodies]],
    place: int,
) -> tuple[tuple[int, int], PairResult]:
    """Measure the pair that a frame ends."""
    first = recording.schedule.first(place)
    assert first is not None
    (reference, bodies), (moved, _) = held[first], held[place]
    numbers = recording.number(first), recording.number(place)
    return (first, place), try_pair(session, (reference, moved), numbers, bodies)
