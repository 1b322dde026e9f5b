"""Sequence: every frame of a recording against the first, directly or over frames in between.

The motion of frame n is measured from a reference frame r, at first frame 0, and starts from what was found for
frame n − 1. With `update` the reference is renewed: every k frames, or when correlation is lost. From then on what is
measured from r is joined to the motion from frame 0 to r along the trajectories of the points (`trajectory`).

| update | frame n is measured from |
|---|---|
| None | frame 0 |
| k | the last frame before n whose number is a multiple of k; 1: the frame before ("incremental") |
| "lost" | the same frame as n − 1; from n − 1 if fewer than `LOST` of its points that stay in the frame are valid |

A mask of frame 0 goes along with the motion to every new reference frame.
"""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Iterable, Iterator
from typing import Literal, TypeAlias

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from sixflow.convention import SIX
from sixflow.errors import InputError
from sixflow.masks import AnyBodies, Masks
from sixflow.pair import PairResult, Prepared
from sixflow.pieces import Start
from sixflow.placing import leaves
from sixflow.session import Session
from sixflow.trajectory import Motion, carried, joined
from sixflow.validate import fill_failed

Update: TypeAlias = int | Literal["lost"] | None

LOST = 0.8
"""Share of the points valid at first, and still inside the frame, below which correlation counts as lost."""


def check_update(update: object, pairs: str, reference: str) -> Update:
    """Return how the reference is renewed, of the arguments of a sequence; 1 for pairs="incremental".

    Raises
    ------
    InputError
        If the arguments do not go together.
    """
    whole = isinstance(update, int) and not isinstance(update, bool) and update >= 1
    if not (update is None or update == "lost" or whole):
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
    number : int
    frame : Prepared
    base : Motion or None
        From frame 0 to this one; None for frame 0 itself.
    start : Start or None
        What was found for the last frame.
    valid : bool array, shape (rows, columns), or None
        Points that were valid in the first measurement from here.
    """

    number: int
    frame: Prepared
    base: Motion | None
    start: Start | None = None
    valid: NDArray[np.bool_] | None = None


class Follower:
    """Follows the points of frame 0 through a recording.

    Parameters
    ----------
    session : Session
    masks : Masks
    update : int, "lost" or None
    done : Dataset, optional
        What has been measured of the recording already, dims (time, …).
    skip : int
        How many pairs that are.
    """

    def __init__(
        self, session: Session, masks: Masks, update: Update, done: xr.Dataset | None, skip: int
    ) -> None:
        self.session, self.masks, self.update = session, masks, update
        self.done, self.skip = done, skip
        self.from_number = _stage_after(update, done, skip)
        self.stage: Stage | None = None
        self.first: Prepared | None = None
        self._before: tuple[int, Prepared, Motion] | None = None

    def needs(self, number: int) -> bool:
        """Whether a frame has to be looked at: others lie between what is done and what the rest starts from."""
        if number in (0, self.from_number) or (number == self.skip and self.update == "lost"):
            return True
        return number > (self.skip if self._directly else self.from_number)

    @property
    def _directly(self) -> bool:
        """Whether the last result that is done is itself the start of the next."""
        return self.done is not None and self.from_number == 0

    def take(self, number: int, raw: ArrayLike, bodies: AnyBodies) -> PairResult | None:
        """Take the next frame; the motion from frame 0 to it, or None for a frame that begins or was done before."""
        name = f"frame {number}"
        if number == 0:
            self.first = self.session.prepare(raw, name, bodies)
            self.stage = Stage(0, self.first, None)
            if self.skip and self._directly:
                assert self.done is not None
                self._resume_directly(self.stage, self.done)
            return None
        assert self.stage is not None
        if number == self.from_number:
            assert self.done is not None
            base = _stored_motion(self.done, number - 1)
            self.stage = Stage(number, self._prepared(number, raw, bodies, base), base)
            return None
        if number == self.skip and self._directly:  # may become a reference yet
            assert self.done is not None
            self._before = (
                number,
                self._prepared(number, raw, bodies, None),
                _stored_motion(self.done, number - 1),
            )
            return None
        result = self._measured(number, self._prepared(number, raw, bodies, None))
        return result if number > self.skip else None

    def _resume_directly(self, stage: Stage, done: xr.Dataset) -> None:
        last = _stored_motion(done, self.skip - 1)
        stage.start = Start.from_six(last.six, last.flag, last.body)
        stage.valid = _stored_motion(done, 0).valid

    def _prepared(self, number: int, raw: ArrayLike, bodies: AnyBodies, base: Motion | None) -> Prepared:
        """A frame with its own mask, or with that of frame 0, moved along, if it is to be a reference."""
        if not self.masks.moving:
            bodies = None
        prepared = self.session.prepare(raw, f"frame {number}", bodies)
        return prepared if base is None else self._masked(prepared, base)

    def _masked(self, frame: Prepared, base: Motion) -> Prepared:
        assert self.first is not None
        if self.masks.moving or self.first.bodies is None:
            return frame
        return dataclasses.replace(frame, bodies=carried(self.first.bodies, base, self.session.grid))

    def _measured(self, number: int, frame: Prepared) -> PairResult:
        stage = self.stage
        assert stage is not None
        step = self._step(stage, number, frame)
        before = self._before
        if (
            self.update == "lost"
            and before is not None
            and before[0] > stage.number
            and self._lost(stage, step)
        ):
            at, prepared, motion = before
            self.stage = stage = Stage(at, self._masked(prepared, motion), motion)
            step = self._step(stage, number, frame)
        stage.valid = step.motion.valid if stage.valid is None else stage.valid
        stage.start = Start.from_six(step.six, step.flag, step.body)
        result = step
        if self.update is not None:
            result = self._joined(stage, step, frame)
            self._before = (number, frame, result.motion)
            if self.update != "lost" and number - stage.number >= self.update:
                self.stage = Stage(number, self._masked(frame, result.motion), result.motion)
        return result

    def _lost(self, stage: Stage, step: PairResult) -> bool:
        """Whether too many points fail that were valid at first and whose windows stay in the frame."""
        grid, shape = self.session.grid, self.session.shape
        assert shape is not None
        if stage.valid is None or stage.start is None:
            return False
        places = fill_failed(stage.start.maps, grid.step)
        asked = stage.valid & ~leaves(places, grid, shape, "first", self.session.settings.window / 2)
        return bool(step.motion.valid[asked].mean() < LOST) if asked.any() else False

    def _step(self, stage: Stage, number: int, frame: Prepared) -> PairResult:
        return self.session.measure_pair(stage.frame, frame, (stage.number, number), stage.start)

    def _joined(self, stage: Stage, step: PairResult, frame: Prepared) -> PairResult:
        """The result from frame 0, of one from the stage's frame."""
        assert self.first is not None
        assert self.session.shape is not None
        motion = step.motion
        if stage.base is not None:
            named = not self.masks.moving or (self.first.bodies is not None and self.first.bodies.named)
            motion = joined(stage.base, motion, self.session.grid, self.session.shape, named=named)
        parts = (self.first, stage.frame, frame)
        digest = hashlib.sha256(b"".join(part.digest for part in parts) + self.first.mask_content)
        return dataclasses.replace(
            step, six=motion.six, covariance=motion.covariance, moved_covariance=motion.moved_covariance,
            flag=motion.flag, residual=motion.residual, noise=motion.noise, body=motion.body,
            numbers=(0, step.numbers[1]), measured_from=stage.number,
            digest=digest.hexdigest()[:16] if stage.number else step.digest,
        )  # fmt: skip


def _stage_after(update: Update, done: xr.Dataset | None, skip: int) -> int:
    """Number of the reference frame with which measuring goes on after so many pairs; 0 without what was done."""
    if done is None or skip == 0 or update is None:
        return 0
    if update == "lost":
        return int(done["measured_from"].values[skip - 1])
    return skip // update * update


def _stored_motion(done: xr.Dataset, time: int) -> Motion:
    """The motion at a time of a field that has been measured."""
    pair = done.isel(time=time).transpose("y", "x", ...).load()
    covariance = pair["covariance"].values
    moved = pair["moved_covariance"].values if "moved_covariance" in pair else covariance / 2
    return Motion(
        np.stack([pair[name].values for name in SIX], axis=-1), covariance, moved.astype(covariance.dtype),
        pair["flag"].values, pair["residual"].values, pair["noise"].values,
        pair["body"].values if "body" in pair else None,
    )  # fmt: skip


def follow(
    session: Session,
    frames: Iterable[ArrayLike],
    masks: Masks,
    update: Update,
    skip: int = 0,
    done: xr.Dataset | None = None,
) -> Iterator[PairResult | None]:
    """Yield, for each frame, the motion from frame 0 to it; None for frame 0 and what was done before.

    Parameters
    ----------
    session : Session
    frames : iterable of arrays
    masks : Masks
    update : int, "lost" or None
    skip : int
        Number of pairs that were done before.
    done : Dataset, optional
        Those pairs. Without them, they are measured again.
    """
    if done is not None and done.sizes.get("time", 0) < skip:
        raise InputError(
            f"done holds {done.sizes.get('time', 0)} pairs, but skip={skip}: give all that are left out"
        )
    follower = Follower(session, masks, update, done, skip)
    for number, raw in enumerate(frames):
        bodies = masks.at(number) if masks.moving or number == 0 else None
        yield follower.take(number, raw, bodies) if follower.needs(number) else None
