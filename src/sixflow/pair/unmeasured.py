"""Unmeasured: pairs of a recording that cannot be measured, since one of their frames cannot be used or is a copy.

Such a pair is NaN at every point, with a flag and a note that say why, and the recording goes on. A strict session
raises instead.
"""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sixflow.convention.flags import FLAGS
from sixflow.errors import BadFrameError, SixflowError
from sixflow.frames.bad import BadFrame
from sixflow.maps.placing import masked_points
from sixflow.masks import AnyBodies, Bodies
from sixflow.pair.result import PairResult
from sixflow.prepare.frame import NO_MASK, both_valid
from sixflow.prepare.prepare import Prepared

if TYPE_CHECKING:
    from sixflow.pair.session import Session
    from sixflow.pair.start import Start
    from sixflow.recording.schedule import Recording

Tried: TypeAlias = Prepared | BadFrame
"""A frame of a recording, ready to be measured, or why it cannot be."""


def try_frame(
    session: Session,
    recording: Recording,
    place: int,
    raw: ArrayLike | BadFrame,
    bodies: AnyBodies = None,
) -> Tried:
    """Check and normalise one frame of a recording.

    Raises
    ------
    SixflowError
        If the frame cannot be used, or repeats the one before, and the session is strict.
    InputError
        If no frame like this one can be measured so.
    """
    name = recording.name(place)
    try:
        if isinstance(raw, BadFrame):
            raise raw.error
        prepared = session.prepare(raw, name, bodies)
        copy = recording.remember(place, prepared.digest)
        if copy is not None and session.strict:
            raise BadFrameError(f"{copy}; leave one of them out")
        return prepared
    except SixflowError as error:
        if session.strict or not (isinstance(raw, BadFrame) or isinstance(error, BadFrameError)):
            raise
        return BadFrame(name, error)


def try_pair(
    session: Session,
    frames: tuple[Tried, Tried],
    numbers: tuple[int, int],
    bodies: AnyBodies,
    start: Start | None = None,
) -> PairResult:
    """Measure a pair of a recording; where a frame of it cannot be used, all its points are flagged.

    Parameters
    ----------
    session : Session
    frames : (Prepared or BadFrame, Prepared or BadFrame)
    numbers : (int, int)
        Of the two frames.
    bodies : Bodies, Outlined or None
        Of the first frame's mask.
    start : Start, optional
        As for `Session.measure_pair`.
    """
    reference, moved = frames
    bad = [frame for frame in frames if isinstance(frame, BadFrame)]
    try:
        if isinstance(reference, BadFrame) or isinstance(moved, BadFrame):
            raise bad[0].error
        return session.measure_pair(reference, moved, numbers, start)
    except SixflowError as error:
        if session.strict or not (bad or isinstance(error, BadFrameError)):
            raise
        note = f"frames {numbers[0]} and {numbers[1]} were not measured: {error}"
        left = session.bodies_of(bodies) if isinstance(reference, BadFrame) else reference.bodies
        return _unmeasured(session, frames, left, numbers, "bad_frame", note)


def repeated(session: Session, reference: Prepared, moved: Prepared, numbers: tuple[int, int]) -> PairResult:
    """Flag a pair of two frames that are the same.

    Raises
    ------
    BadFrameError
        If the session is strict.
    """
    first, second = numbers
    note = (
        f"frames {first} and {second} are the same to the last bit: a copy, and no measurement of no motion"
    )
    if session.strict:
        raise BadFrameError(f"{note}; leave one of them out")
    return _unmeasured(session, (reference, moved), reference.bodies, numbers, "repeated", note)


def _unmeasured(
    session: Session,
    frames: tuple[Tried, Tried],
    bodies: Bodies | None,
    numbers: tuple[int, int],
    flag: str,
    note: str,
) -> PairResult:
    """NaN at every point, with a flag that says why; masked points are flagged masked too."""
    grid, reference = session.grid, frames[0]

    def nothing(*more: int) -> NDArray[Any]:
        return np.full((*grid.shape, *more), np.nan, session.plan.dtype)

    valid = NO_MASK if isinstance(reference, BadFrame) else reference.frame.valid
    if bodies is not None:
        valid = both_valid((bodies.labels != 0).astype(np.uint8), valid)
    still = np.full((6, *grid.shape), np.nan)
    masked = masked_points(still, grid, valid, session.plan.reference)
    flags = np.full(grid.shape, FLAGS[flag], np.uint16)
    flags[masked] |= FLAGS["masked"]
    body = None
    if session.masks.moving or (bodies is not None and len(bodies.boxes) > 1):
        labels = 1 if bodies is None else bodies.labels[np.ix_(grid.y, grid.x)]
        body = np.where(masked, 0, labels).astype(np.int32)
    content = [b"" if isinstance(frame, BadFrame) else frame.digest for frame in frames]
    digest = hashlib.sha256(b"".join(content) + (b"" if bodies is None else bodies.content))
    window = session.asked.window
    return PairResult(
        six=nothing(6), covariance=nothing(6, 6), residual=nothing(), noise=nothing(), resolution=nothing(),
        flag=flags, body=body, window=float("nan") if window == "auto" else float(window),
        numbers=numbers, digest=digest.hexdigest()[:16], notes=(note,), memory=0, rho=nothing(), bias=nothing(6),
    )  # fmt: skip
