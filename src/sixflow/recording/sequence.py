"""Sequence: every frame of a recording against the first, directly or over frames in between.

The motion of frame n is measured from a reference frame r, at first frame 0, and starts from what was found for
frame n − 1. With `update` the reference is renewed: every k frames, or when correlation is lost. From then on what is
measured from r is joined to the motion from frame 0 to r along the trajectories of the points (`trajectory`).

| update | frame n is measured from |
|---|---|
| None | frame 0 |
| k | the last frame before n whose place is a multiple of k; 1: the frame before ("incremental") |
| "lost" | the same frame as n − 1; from n − 1 if fewer than `LOST` of its points that stay in the frame are valid |

A frame that cannot be used, or repeats the reference, is passed over: its own pair is flagged, and what follows goes on
from the last good frame. Frame 0 has to be good.

A mask of frame 0 goes along with the motion to every new reference frame.
"""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Iterator
from typing import Any, Literal, TypeAlias

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from sixflow.checks import is_whole
from sixflow.convention import SIX
from sixflow.convention.flags import FLAGS
from sixflow.errors import BadFrameError, InputError, SixflowError
from sixflow.frames.bad import BadFrame
from sixflow.maps.motion import Motion
from sixflow.maps.neighbours import fill_failed
from sixflow.maps.placing import leaves
from sixflow.masks import AnyBodies, Masks
from sixflow.pair.result import PairResult
from sixflow.pair.session import Session
from sixflow.pair.start import Start
from sixflow.pair.unmeasured import Tried, try_frame, try_pair
from sixflow.prepare.prepare import Prepared
from sixflow.recording.schedule import Recording
from sixflow.recording.trajectory import carried, composed

Update: TypeAlias = int | Literal["lost"] | None

LOST = 0.8
"""Share of the points valid at first, and still inside the frame, below which correlation counts as lost."""


def check_update(update: object, pairs: str, reference: str) -> Update:
    """Return how the reference is renewed, of the arguments of a sequence; 1 for pairs="incremental".

    Raises InputError if the arguments do not go together.
    """
    if not (update is None or update == "lost" or is_whole(update, 1)):
        raise InputError(
            f"update={update!r}: must be a whole number of frames, at least 1, or 'lost', or None for "
            "the first frame throughout"
        )
    if update is not None and pairs != "first":
        raise InputError(f"update={update!r}: goes with pairs='first' only, but pairs={pairs!r}")
    chosen: Update = 1 if pairs == "incremental" else update  # type: ignore[assignment]
    if chosen is not None and reference != "first":
        raise InputError(
            f"reference={reference!r}: steps are joined at the points of the first frame; take reference='first' with "
            f"pairs={pairs!r} and update={update!r}"
        )
    return chosen


@dataclasses.dataclass
class Stage:
    """A reference frame: what it is measured from, and the motion that leads to it.

    Attributes
    ----------
    place : int
    frame : Prepared
    base : Motion or None
        From frame 0 to this one; None for frame 0 itself.
    start : Start or None
        What was found for the last frame.
    valid : bool array, shape (rows, columns), or None
        Points that were valid in the first measurement from here.
    """

    place: int
    frame: Prepared
    base: Motion | None
    start: Start | None = None
    valid: NDArray[np.bool_] | None = None


class Follower:
    """Follows the points of frame 0 through a recording.

    Parameters
    ----------
    session : Session
    recording : Recording
    masks : Masks
    update : int, "lost" or None
    done : Dataset, optional
        What has been measured of the recording already, dims (time, …).
    skip : int
        How many pairs that are.
    """

    def __init__(
        self,
        session: Session,
        recording: Recording,
        masks: Masks,
        update: Update,
        done: xr.Dataset | None,
        skip: int,
    ) -> None:
        self.session, self.recording, self.masks, self.update = session, recording, masks, update
        self.done, self.skip = done, skip
        self.last_good = self._good(range(skip, 0, -1))
        self.begins = self._reference_after()
        self.stage: Stage | None = None
        self.first: Prepared | None = None
        self._before: tuple[int, Prepared, Motion] | None = None

    def _reference_after(self) -> int:
        """Place of the reference frame from which measuring goes on; 0 without what was done."""
        if self.done is None or self.skip == 0 or self.update is None:
            return 0
        if self.update == "lost":
            return self.recording.place(int(self.done["measured_from"].values[self.skip - 1]))
        return self._good(range(self.skip // self.update * self.update, 0, -self.update))

    def _good(self, places: range) -> int:
        """The first of some frames whose pair was done before and not passed over; 0 if there is none."""
        if self.done is None:
            return 0
        flags = self.done["flag"]
        return next((k for k in places if not passed_over(flags.isel(time=k - 1).values)), 0)

    def needs(self, place: int) -> bool:
        """Whether a frame has to be looked at: others lie between what is done and what the rest starts from."""
        if place in (0, self.begins) or (self.update == "lost" and place == self.last_good):
            return True
        return place > (self.skip if self._directly else self.begins)

    @property
    def _directly(self) -> bool:
        """Whether the last result that is done is itself the start of the next."""
        return self.done is not None and self.begins == 0

    def take(self, place: int, raw: ArrayLike | BadFrame, bodies: AnyBodies) -> PairResult | None:
        """Take the next frame; the motion from frame 0 to it, or None for a frame that begins or was done before."""
        if place == 0:
            self.first = self._first(raw, bodies)
            self.stage = Stage(0, self.first, None)
            if self.last_good and self._directly:
                assert self.done is not None
                self._resume_directly(self.stage, self.done)
            return None
        assert self.stage is not None
        own = bodies if self.masks.moving else None
        frame = try_frame(self.session, self.recording, place, raw, own)
        if self.done is not None and not isinstance(frame, BadFrame):
            if place == self.begins:
                base = _stored_motion(self.done, place - 1)
                self.stage = Stage(place, self._masked(frame, base), base)
                return None
            if place == self.last_good and self._directly:  # may become a reference yet
                self._before = (place, frame, _stored_motion(self.done, place - 1))
                return None
        result = self._measured(place, frame)
        return result if place > self.skip else None

    def _first(self, raw: ArrayLike | BadFrame, bodies: AnyBodies) -> Prepared:
        name = self.recording.name(0)
        try:
            if isinstance(raw, BadFrame):
                raise raw.error
            first = self.session.prepare(raw, name, bodies)
            self.recording.remember(0, first.digest)
            return first
        except SixflowError as error:
            if not isinstance(raw, BadFrame) and not isinstance(error, BadFrameError):
                raise
            raise BadFrameError(
                f"{error}. All motions of pairs={self.recording.schedule.pairs!r} start from {name}: leave it out, "
                "with open_frames(…, first=1) (--first 1)"
            ) from error

    def _resume_directly(self, stage: Stage, done: xr.Dataset) -> None:
        last = _stored_motion(done, self.last_good - 1)
        stage.start = Start.from_six(last.six, last.flag, last.body)
        stage.valid = _stored_motion(done, self._good(range(1, self.skip + 1)) - 1).valid

    def _masked(self, frame: Prepared, base: Motion) -> Prepared:
        """A frame with its own mask, or with that of frame 0, moved along, as it is to be a reference."""
        assert self.first is not None
        if self.masks.moving or self.first.bodies is None:
            return frame
        return dataclasses.replace(frame, bodies=carried(self.first.bodies, base, self.session.grid))

    def _measured(self, place: int, frame: Tried) -> PairResult:
        stage = self.stage
        assert stage is not None
        step = self._step(stage, place, frame)
        if isinstance(frame, BadFrame) or passed_over(step.flag):
            return step if self.update is None else self._joined(stage, step, None)
        before = self._before
        if (
            self.update == "lost"
            and before is not None
            and before[0] > stage.place
            and self._lost(stage, step)
        ):
            at, prepared, motion = before
            self.stage = stage = Stage(at, self._masked(prepared, motion), motion)
            step = self._step(stage, place, frame)
        stage.valid = step.motion.valid if stage.valid is None else stage.valid
        stage.start = Start.from_six(step.six, step.flag, step.body)
        if self.update is None:
            return step
        result = self._joined(stage, step, frame)
        self._before = (place, frame, result.motion)
        if self.update != "lost" and place % self.update == 0:
            self.stage = Stage(place, self._masked(frame, result.motion), result.motion)
        return result

    def _lost(self, stage: Stage, step: PairResult) -> bool:
        """Whether too many points fail that were valid at first and whose windows stay in the frame."""
        grid, shape = self.session.grid, self.session.shape
        assert shape is not None
        if stage.valid is None or stage.start is None:
            return False
        places = fill_failed(stage.start.maps, grid.step)
        asked = stage.valid & ~leaves(places, grid, shape, "first", self.session.plan.window.size / 2)
        return bool(step.motion.valid[asked].mean() < LOST) if asked.any() else False

    def _step(self, stage: Stage, place: int, frame: Tried) -> PairResult:
        numbers = self.recording.number(stage.place), self.recording.number(place)
        return try_pair(self.session, (stage.frame, frame), numbers, stage.frame.bodies, stage.start)

    def _joined(self, stage: Stage, step: PairResult, frame: Prepared | None) -> PairResult:
        """The result from frame 0, of one from the stage's frame; without a frame, of a pair that was passed over."""
        assert self.first is not None
        assert self.session.shape is not None
        motion, parts = step.motion, [self.first, stage.frame]
        if frame is not None:
            parts.append(frame)
        if stage.base is not None and frame is None:
            masked = np.uint16(FLAGS["masked"])
            flag = (step.flag & ~masked) | (stage.base.flag & masked)
            motion = dataclasses.replace(motion, flag=flag, body=stage.base.body)
        elif stage.base is not None:
            named = not self.masks.moving or (self.first.bodies is not None and self.first.bodies.named)
            motion = composed(stage.base, motion, self.session.grid, self.session.shape, named=named)
        digest = hashlib.sha256(b"".join(part.digest for part in parts) + self.first.mask_content)
        return dataclasses.replace(
            step, six=motion.six, covariance=motion.covariance, moved_covariance=motion.moved_covariance,
            flag=motion.flag, residual=motion.residual, noise=motion.noise, body=motion.body, bias=motion.bias,
            numbers=(self.recording.number(0), step.numbers[1]),
            measured_from=self.recording.number(stage.place),
            digest=digest.hexdigest()[:16] if stage.place else step.digest,
        )  # fmt: skip


def passed_over(flag: NDArray[Any]) -> bool:
    """Whether a pair was not measured, since one of its frames is bad or a copy."""
    return bool(((flag.astype(np.int64) & (FLAGS["bad_frame"] | FLAGS["repeated"])) != 0).all())


def _stored_motion(done: xr.Dataset, time: int) -> Motion:
    """The motion at a time of a field that has been measured."""
    pair = done.isel(time=time).transpose("y", "x", ...).load()
    covariance = pair["covariance"].values
    moved = pair["moved_covariance"].values if "moved_covariance" in pair else covariance / 2
    return Motion(
        np.stack([pair[name].values for name in SIX], axis=-1), covariance, moved.astype(covariance.dtype),
        pair["flag"].values, pair["residual"].values, pair["noise"].values,
        pair["body"].values if "body" in pair else None,
        pair["bias"].values if "bias" in pair else np.full((*pair["flag"].shape, len(SIX)), np.nan, covariance.dtype),
    )  # fmt: skip


def follow(
    session: Session,
    recording: Recording,
    masks: Masks,
    update: Update,
    skip: int = 0,
    done: xr.Dataset | None = None,
) -> Iterator[tuple[tuple[int, int], PairResult]]:
    """Yield the motion from frame 0 to each later one, and the places of the two frames.

    Parameters
    ----------
    session : Session
    recording : Recording
    masks : Masks
    update : int, "lost" or None
    skip : int
        Number of pairs that were done before; they are left out.
    done : Dataset, optional
        Those pairs. Without them, they are measured again.
    """
    if done is not None and done.sizes.get("time", 0) < skip:
        raise InputError(
            f"done holds {done.sizes.get('time', 0)} pairs, but skip={skip}: give all that are left out"
        )
    follower = Follower(session, recording, masks, update, done, skip)
    for place, raw in enumerate(recording.frames()):
        bodies = masks.at(place) if masks.moving or place == 0 else None
        result = follower.take(place, raw, bodies) if follower.needs(place) else None
        if result is not None:
            yield (0, place), result
