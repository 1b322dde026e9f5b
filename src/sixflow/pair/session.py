"""Session: everything that the pairs of one recording share, and the measurement of one pair.

`Session.measure_pair` is the method section: search, refine, judge.
"""

from __future__ import annotations

import dataclasses
import hashlib
import math
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from sixflow.convention import SIX_FROM_GRADIENT
from sixflow.convention.flags import FLAGS
from sixflow.engine.lowpass import lowpass_noise
from sixflow.engine.threads import beside
from sixflow.errors import BadFrameError
from sixflow.frames.floor import Floor, rounding_noise
from sixflow.frames.times import PairTimes
from sixflow.judge.replace import replace_failed
from sixflow.maps.grid import Grid
from sixflow.maps.restriction import ABSENT
from sixflow.masks import AnyBodies, Bodies, Masks
from sixflow.masks.outlines import region_of
from sixflow.masks.said import said_of_mask
from sixflow.pair.bodies import Bodies as BodiesOfPair
from sixflow.pair.result import PairResult, Prepared, field_of_pair, same_content
from sixflow.pair.start import Start
from sixflow.pair.unmeasured import repeated
from sixflow.plan import Plan
from sixflow.prepare.copies import copied_pixels
from sixflow.prepare.defects import without_defects
from sixflow.prepare.frame import (
    Frame,
    both_valid,
    check_frame,
    flattened,
    range_of,
    require_contrast,
    require_range,
    to_image,
)
from sixflow.prepare.interlacing import InterlacingCheck
from sixflow.prepare.lighting import Change
from sixflow.prepare.nodata import without_blanks
from sixflow.prepare.region_light import RegionLight
from sixflow.refine.solution import Part, Solution
from sixflow.search.guess import Guess, is_stored_in_settings, maps_of_guess
from sixflow.settings import Settings

FAILED = 0.5  # share of a body's points that have to fail near where it was, before it is sought in the whole frame

MANY_BODIES = 4  # from which one search for all, to begin with, is cheaper than one for each


class Session:
    """Settings, grid and working memory that all pairs of a recording share.

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
    """

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
        self.masks_move = self.masks.moving
        self.dtype = np.float64 if settings.float64 else np.float32
        self.shape: tuple[int, int] | None = None
        self.guess_maps: NDArray[np.float64] | None = None
        self.region: NDArray[np.bool_] | None = None
        self._within: tuple[Bodies | None, Bodies] | None = None
        self.constant, self.scale = 0.0, 1.0
        self.interlacing = InterlacingCheck()

    def prepare(
        self, raw: ArrayLike, name: str, bodies: AnyBodies = None, *, lasting: bool = False
    ) -> Prepared:
        """Check and normalise one frame.

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
            self._begin(array, name)
        if array.shape != self.shape:
            raise BadFrameError(
                f"{name} has shape {array.shape}, the first frame {self.shape}: "
                "all frames must have one shape; crop or resample them"
            )
        within = self.bodies_of(bodies)
        digest = beside(lambda: hashlib.sha256(np.ascontiguousarray(array).data).digest())
        image, valid, missing = to_image(array, self.constant, self.dtype, self.scale)
        if missing == array.size:
            raise BadFrameError(
                f"{name} has no pixel of a size that can be computed with; scale its grey values"
            )
        require_range(image, self.scale, name)
        notes = self.interlacing.notes(image, name)
        notes += (
            (f"{name}: {missing} pixels without a value (NaN or infinite) are masked",) if missing else ()
        )
        sample = _sample(
            image, valid if within is None else both_valid((within.labels != 0).astype(np.uint8), valid)
        )
        mean, spread = float(sample.mean()) / self.scale, float(sample.std()) / self.scale
        floor, rounded = self.floor.under(array)
        frame, unlit = Frame(image, valid, floor=floor * self.scale, rounded=rounded), None
        if self.asked.lighting == "local":
            frame, unlit = flattened(frame, self.plan.window.sigma), frame
        if not lasting:
            digest.result()
        return Prepared(frame, digest, mean, spread, notes, within, unlit)

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

    def _begin(self, first: NDArray[Any], name: str) -> None:
        """Take shape, grid and the grey constant from the first frame."""
        height, width = first.shape
        self.plan = Plan.of(self.asked, (height, width), name)
        self.shape, self.grid = self.plan.shape, self.plan.grid
        self.constant, self.scale = range_of(first[::4, ::4], name)
        asked = self.asked
        self.guess_maps = None if self.guess is None else maps_of_guess(self.guess, self.grid)
        self.region = region_of(self.shape, asked.roi, asked.polygons, asked.holes)

    def measure_pair(
        self, reference: Prepared, moved: Prepared, numbers: tuple[int, int], start: Start | None = None
    ) -> PairResult:
        """Measure one pair: every body apart, and each by search, refinement and judgement.

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
        change, dead, blank = Change.between(reference, moved), 0, (0, 0)
        settings = change.settings(self.asked)
        reference, moved, copied = self._without_copies(reference, moved)
        if settings.robust:
            reference, moved, blank = self._without_blanks(reference, moved)
            frame, moved_frame, dead = without_defects(reference.frame, moved.frame)
            reference = dataclasses.replace(reference, frame=frame)
            moved = dataclasses.replace(moved, frame=moved_frame)
        if settings.lowpass:
            reference, moved = (
                self._with_raw(one, one.raw.lowpassed(settings.lowpass)) for one in (reference, moved)
            )
        plan = self.plan.replace(lighting=settings.lighting)
        found = BodiesOfPair(self, reference, moved, plan).measure(start)
        notes = (*self._notes_of_masks(reference, moved), *reference.notes, *moved.notes)
        notes += change.notes(self.asked, found.lighting, numbers)
        notes += _notes_of_pixels(numbers, blank, copied, dead)
        return self._result(found, reference, moved, numbers, notes)

    def _result(
        self,
        found: Solution,
        reference: Prepared,
        moved: Prepared,
        numbers: tuple[int, int],
        notes: tuple[str, ...],
    ) -> PairResult:
        """Bring a solution into the form of a field: six numbers, NaN where failed, in the frames' grey values."""
        flag, failed, statistics = found.flag, found.failed, found.statistics
        six = np.moveaxis(np.tensordot(SIX_FROM_GRADIENT, found.maps, axes=1), 0, -1)
        six[..., ABSENT.get(self.plan.group, ())] *= 0.0  # by assumption, not by rounding; NaN stays NaN
        measured: dict[str, Any] = {
            "six": six.astype(self.plan.dtype),
            "covariance": found.covariance.astype(self.plan.dtype),
            "residual": statistics.residual.astype(self.plan.dtype),
            # noise is in grey levels, which may be of any size
            "noise": statistics.noise / (self.scale * math.sqrt(lowpass_noise(self.plan.lowpass))),
            "resolution": found.period.astype(self.plan.dtype),
        }
        for values in measured.values():
            values[failed] = np.nan
        if self.asked.replace_failed:
            wanted = failed & ((flag & FLAGS["masked"]) == 0)
            replaced = replace_failed(
                measured["six"], measured["covariance"], wanted, self.grid.step, self.plan.window.size
            )
            flag = flag | np.where(replaced, FLAGS["replaced"], 0).astype(np.uint16)
        digest = hashlib.sha256(reference.digest + moved.digest + reference.mask_content)
        if self.masks_move:
            digest.update(moved.mask_content)
        body = found.body
        if self.masks_move and body is None:
            number = 1 if reference.bodies is None else next(iter(reference.bodies.boxes))
            body = np.where(flag & FLAGS["masked"], 0, number).astype(np.int32)
        windows = found.window[~failed] if not failed.all() else found.window
        memory = reference.frame.nbytes + moved.frame.nbytes + sum(m.nbytes for m in measured.values())
        return PairResult(
            **measured, flag=flag, body=body, window=float(np.nanmedian(windows)), numbers=numbers,
            digest=digest.hexdigest()[:16], notes=notes, memory=memory, rho=statistics.rho,
        )  # fmt: skip

    def _notes_of_masks(self, reference: Prepared, moved: Prepared) -> tuple[str, ...]:
        """What should be known of the masks of a pair, each thing once."""
        notes = self.masks.notes
        for bodies in (reference.bodies, moved.bodies if self.masks_move else None):
            if bodies is not None:
                notes += said_of_mask(bodies, self.plan.window.size)
        return tuple(dict.fromkeys(notes))

    def _without_blanks(
        self, reference: Prepared, moved: Prepared
    ) -> tuple[Prepared, Prepared, tuple[int, int]]:
        """The frames without what lies beyond their content, and the number of these pixels in each."""
        first, second, count = without_blanks(reference.raw, moved.raw)
        if not any(count):
            return reference, moved, count
        return self._with_raw(reference, first), self._with_raw(moved, second), count

    def _without_copies(self, reference: Prepared, moved: Prepared) -> tuple[Prepared, Prepared, float]:
        """The frames, with what a codec copied from one to the other, and its share of the pixels."""
        if not self.floor.copies:
            return reference, moved, 0.0
        images = reference.raw.image, moved.raw.image
        copied = copied_pixels(*images, math.sqrt(12) * rounding_noise(images[0]))
        if not copied.any():
            return reference, moved, 0.0
        pair = [dataclasses.replace(one, copied=copied) for one in (reference, moved)]
        return pair[0], pair[1], float(copied.mean())

    def _with_raw(self, prepared: Prepared, raw: Frame) -> Prepared:
        """Replace a frame as it was before its local light was divided out."""
        if prepared.unlit is None:
            return dataclasses.replace(prepared, frame=raw)
        return dataclasses.replace(prepared, frame=flattened(raw, self.plan.window.sigma), unlit=raw)

    def _frames_of(
        self, reference: Prepared, moved: Prepared, number: int | None, part: Part
    ) -> tuple[Frame, Frame, Frame]:
        """Frame 0 where it counts for a body, frame 0 where that is asked for, and frame 1 where it may be."""
        region = asked = reference.frame.part(part)
        other = moved.frame.part(part)
        bodies = reference.bodies
        if bodies is not None:
            asked = region.within(both_valid(bodies.of_number(number, part), region.valid))
            region = asked
            if bodies.clear is not None:
                region = region.within(both_valid(asked.valid, bodies.clear[part]))
            if number is None and not region.valid.any():
                raise BadFrameError(
                    "mask is True only where frame 0 has no value (NaN or infinite): nothing is left to measure"
                )
        if self.masks_move and moved.bodies is not None:
            # the region of the settings is that of frame 0: what moves out of it is still there
            there = moved.bodies.whole or moved.bodies
            own = there.of_number(self._partner(reference, moved, number), part)
            other = other.within(both_valid(own, other.valid))
            if number is None and not other.valid.any():
                raise BadFrameError(
                    "mask of the second frame is True only where that has no value (NaN or infinite): "
                    "nothing is left to measure"
                )
        return reference.evidence(region, part), asked, moved.evidence(other, part)

    @staticmethod
    def _partner(reference: Prepared, moved: Prepared, number: int | None) -> int | None:
        """Number of a body in frame 1; None for any, where the numbers are not given in both frames."""
        named = [frame.bodies is not None and frame.bodies.named for frame in (reference, moved)]
        return number if all(named) else None

    def _light(
        self,
        reference: Prepared,
        moved: Prepared,
        number: int | None,
        part: Part,
        grid: Grid,
    ) -> RegionLight | None:
        """What divides out the local light inside a body alone; None where there is no body, or no need."""
        bodies = reference.bodies
        if bodies is None or reference.unlit is None or moved.unlit is None:
            return None
        there = None
        if self.masks_move and moved.bodies is not None:
            there = (moved.bodies.whole or moved.bodies).of_number(
                self._partner(reference, moved, number), part
            )
        backwards = self.plan.reference == "second"
        frames = reference.unlit.part(part), moved.unlit.part(part)
        return RegionLight(
            *frames, bodies.of_number(number, part), there, grid, self.plan.window.sigma, backwards
        )

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
        assert self.shape is not None
        if self.masks.said:
            attrs["mask"] = self.masks.said
        kept = self.guess_maps is not None and not is_stored_in_settings(self.guess)
        if kept:
            digest = hashlib.sha256(np.ascontiguousarray(self.guess_maps).tobytes()).hexdigest()[:16]
            attrs["guess"] = f"the variable guess, sha256 {digest}"
        field = field_of_pair(result, times, names, self.grid, self.shape, self.asked)
        field.attrs |= attrs
        if not kept or self.guess_maps is None:
            return field
        said = {"long_name": "first guess of the six numbers, in the order of param", "units": "px, 1"}
        six = np.moveaxis(np.tensordot(SIX_FROM_GRADIENT, self.guess_maps, axes=1), 0, -1)
        return field.assign(guess=(("time", "y", "x", "param"), six[None], said))


def _notes_of_pixels(
    numbers: tuple[int, int], blank: tuple[int, int], copied: float, dead: int
) -> tuple[str, ...]:
    """What was done to pixels of a pair: the number that is blank in each frame, the share of copies, dead ones."""
    notes = [
        f"frame {number}: {count} pixels of one value at the rim, where the other frame has content, are taken for "
        "beyond its end"
        for number, count in zip(numbers, blank, strict=True)
        if count
    ]
    pair = f"frames {numbers[0]} and {numbers[1]}"
    if copied:
        notes.append(
            f"{pair}: {copied:.0%} of the pixels are copies that the video codec made of the frame before; they are no "
            "evidence of motion, and are left out"
        )
    if dead:
        notes.append(f"{pair}: {dead} dead or hot pixels were replaced")
    return tuple(notes)


def _sample(image: NDArray[Any], valid: NDArray[np.uint8]) -> NDArray[Any]:
    """Every fourth pixel of every fourth row, of those that count; one zero if none does."""
    if not valid.size:
        return image[::4, ::4]
    counted = valid.astype(bool)
    some = image[::4, ::4][counted[::4, ::4]]
    return some if some.size else image[counted] if counted.any() else np.zeros(1, image.dtype)
