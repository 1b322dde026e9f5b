"""Session: everything that the pairs of one recording share, and the measurement of one pair.

`Session.measure_pair` is the method section: prepare, search, refine, judge.
"""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from sixflow.convention.flags import FLAGS
from sixflow.errors import BadFrameError
from sixflow.frames.floor import Floor
from sixflow.frames.times import PairTimes
from sixflow.judge.repeats import period_of
from sixflow.maps.grid import Grid
from sixflow.maps.six import six_of_maps
from sixflow.masks import AnyBodies, Bodies, Masks
from sixflow.masks.outlines import region_of
from sixflow.masks.said import said_of_mask
from sixflow.pair.bodies import PairBodies
from sixflow.pair.camera import seen_of_camera
from sixflow.pair.result import PairResult, field_of_pair, result_of_solution, same_content
from sixflow.pair.start import Start
from sixflow.pair.unmeasured import repeated
from sixflow.plan import Plan
from sixflow.prepare.image import Grey, check_frame, range_of, require_contrast
from sixflow.prepare.interlacing import InterlacingCheck
from sixflow.prepare.pattern import FixedPattern
from sixflow.prepare.prepare import Prepared, prepare_frame, prepare_pair
from sixflow.refine.solution import Solution
from sixflow.search.guess import Guess, is_stored_in_settings, maps_of_guess
from sixflow.settings import Settings


class Session:
    """Settings, plan and grey constant that all pairs of a recording share.

    Parameters
    ----------
    settings : Settings
    masks : Masks, optional
        Where to measure. Where there is one for each frame, that of the moved frame counts too.
    guess : optional
        A first guess of the motion of every pair, as `search` takes it.
    strict : bool
        Raise at a frame of a recording that cannot be used, instead of flagging its pairs.
    floor : Floor
        What is known of the frames' errors beforehand.

    Attributes
    ----------
    plan : Plan
        Resolved from the settings and the shape of the first good frame; not there before.
    """

    plan: Plan

    def __init__(
        self,
        settings: Settings,
        *,
        masks: Masks | None = None,
        guess: Guess | None = None,
        strict: bool = False,
        floor: Floor = Floor(),  # noqa: B008 - it is frozen
    ) -> None:
        self.asked = settings
        self.masks, self.guess, self.strict, self.floor = masks or Masks(None), guess, strict, floor
        self.shape: tuple[int, int] | None = None
        self.guess_maps: NDArray[np.float64] | None = None
        self.region: NDArray[np.bool_] | None = None
        self.grey = Grey(0.0, 1.0, np.float32)
        self.interlacing = InterlacingCheck()
        self.pattern: FixedPattern | None = None
        self._within: tuple[Bodies | None, Bodies] | None = None

    @property
    def grid(self) -> Grid:
        """Points of the field."""
        return self.plan.grid

    def prepare(
        self, raw: ArrayLike, name: str, bodies: AnyBodies = None, *, lasting: bool = False
    ) -> Prepared:
        """Check one frame and prepare it by itself.

        Parameters
        ----------
        raw : array_like, shape (height, width)
        name : str
            For messages.
        bodies : Bodies or Outlined, optional
            Of its mask, if there is one.
        lasting : bool
            The raw frame stays as it is until the pair is measured; a source may write the next one over it.

        Raises
        ------
        BadFrameError
            If others may do, but not this one: it is constant, has no value, or another shape than the first.
        InputError
            If no frame like this one can be measured so.
        """
        array = check_frame(raw, name)
        require_contrast(array, name)  # before it sets grid and grey constant for all others
        if self.shape is None:
            self._begin(array, name, bodies)
        if array.shape != self.shape:
            raise BadFrameError(
                f"{name} has shape {array.shape}, the first frame {self.shape}: "
                "all frames must have one shape; crop or resample them"
            )
        return prepare_frame(
            array, name, self.bodies_of(bodies), self.grey,
            floor=self.floor, interlacing=self.interlacing, lasting=lasting, pattern=self.pattern,
        )  # fmt: skip

    def bodies_of(self, mask: AnyBodies) -> Bodies | None:
        """What a frame's mask and the region of the settings leave of it."""
        assert self.shape is not None
        bodies = None if mask is None else mask.of_shape(self.shape)
        if self.region is None:
            return bodies
        if self._within is None or self._within[0] is not bodies:  # it is the same for many frames
            region = self.region
            left = Bodies.of(region, "region of interest") if bodies is None else bodies.within(region)
            self._within = bodies, left
        return self._within[1]

    def _begin(self, first: NDArray[Any], name: str, mask: AnyBodies) -> None:
        """Take shape, plan and the grey constant from the first frame, of the pixels that its mask leaves."""
        height, width = first.shape
        self.plan = Plan.of(self.asked, (height, width), name)
        self.shape = height, width
        self.guess_maps = None if self.guess is None else maps_of_guess(self.guess, self.grid)
        self.region = region_of(self.shape, self.asked.roi, self.asked.polygons, self.asked.holes)
        bodies, some = self.bodies_of(mask), (slice(None, None, 4),) * 2
        values = first[some] if bodies is None else first[some][bodies.labels[some] != 0]
        if bodies is not None and not values.size:
            values = first[bodies.labels != 0]
        self.grey = Grey(*range_of(values, name), self.plan.dtype)

    def measure_pair(
        self, reference: Prepared, moved: Prepared, numbers: tuple[int, int], start: Start | None = None
    ) -> PairResult:
        """Measure one pair.

        Parameters
        ----------
        reference, moved : Prepared
        numbers : (int, int)
            Of the two frames.
        start : Start, optional
            What is known of the motion. The search is left out where refining it succeeds.
        """
        if same_content(reference, moved):
            return repeated(self, reference, moved, numbers)
        asked, moving = self.asked, self.masks.moving
        pair = prepare_pair(
            reference, moved, masks_move=moving, robust=asked.robust, copies=self.floor.copies,
            lowpass=asked.lowpass,
        )  # fmt: skip
        undecided = asked.lighting == "auto" and asked.method != "eigenfilter"
        plan = self.plan
        if asked.lighting == "auto":
            plan = plan.replace(lighting="none")
        changed = pair.change.seen if undecided else None
        bodies = PairBodies(pair.reference, pair.moved, plan, moving, self.guess_maps, changed)
        found = bodies.measure(start)  # search, refine, judge
        notes = (*self._notes_of_masks(reference, moved), *reference.notes, *moved.notes)
        found, seen = seen_of_camera(pair, found, plan, asked, numbers, self.grey.scale)
        notes += seen + pair.notes(numbers)
        notes += self._notes_of_texture(pair.reference, found)
        return result_of_solution(
            found, pair, plan, numbers, notes, masks_move=moving, scale=self.grey.scale,
            replace=asked.replace_failed,
        )  # fmt: skip

    def _notes_of_texture(self, reference: Prepared, found: Solution) -> tuple[str, ...]:
        """What should be known of a texture that repeats."""
        doubtful = (found.flag & FLAGS["ambiguous"]) != 0
        period = period_of(reference.frame, self.plan.of_search.window.sigma) if doubtful.any() else None
        if period is None:
            return ()
        x, y = np.abs(period)
        return (
            f"the texture repeats every ({x:.3g}, {y:.3g}) px: the motion of {100 * doubtful.mean():.2g} % of the "
            "points is known up to a period only; a first guess (search) tells which",
        )

    def _notes_of_masks(self, reference: Prepared, moved: Prepared) -> tuple[str, ...]:
        """What should be known of the masks of a pair, each thing once."""
        notes = self.masks.notes
        for bodies in (reference.bodies, moved.bodies if self.masks.moving else None):
            if bodies is not None:
                notes += said_of_mask(bodies, self.plan.window.size)
        return tuple(dict.fromkeys(notes))

    def field(
        self, result: PairResult, times: PairTimes, names: NDArray[Any] | None = None, **attrs: Any
    ) -> xr.Dataset:
        """Return the dataset of one pair.

        Parameters
        ----------
        result : PairResult
        times : PairTimes
        names : array of str, shape (2,), optional
            Of the files of the two frames.
        **attrs
            Further attributes.
        """
        if self.masks.said:
            attrs["mask"] = self.masks.said
        kept = self.guess_maps is not None and not is_stored_in_settings(self.guess)
        if kept:
            digest = hashlib.sha256(np.ascontiguousarray(self.guess_maps).tobytes()).hexdigest()[:16]
            attrs["guess"] = f"the variable guess, sha256 {digest}"
        field = field_of_pair(result, times, names, self.plan, self.asked)
        field.attrs |= attrs
        if not kept or self.guess_maps is None:
            return field
        said = {"long_name": "first guess of the six numbers, in the order of param", "units": "px, 1"}
        six = six_of_maps(self.guess_maps)
        return field.assign(guess=(("time", "y", "x", "param"), six[None], said))
