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
from sixflow.convention.flags import FAILING, FLAGS
from sixflow.engine.lowpass import lowpass_noise
from sixflow.engine.threads import beside
from sixflow.errors import BadFrameError, InputError
from sixflow.frames.floor import Floor, rounding_noise
from sixflow.frames.times import PairTimes
from sixflow.judge.replace import predictions
from sixflow.maps.grid import Grid
from sixflow.maps.placing import masked_points, placed
from sixflow.maps.restriction import ABSENT
from sixflow.masks import AnyBodies, Bodies, Masks
from sixflow.masks.outlines import region_of
from sixflow.masks.said import said_of_mask
from sixflow.pair.bodies import Found, Part, Start, room_to_move, share_failed, with_margin
from sixflow.pair.body import Between
from sixflow.pair.result import PairResult, Prepared, field_of_pair, same_content
from sixflow.pair.unmeasured import repeated
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
from sixflow.refine.resolution import search_settings
from sixflow.refine.workspace import Workspace
from sixflow.search.guess import Guess, is_stored_in_settings, maps_of_guess
from sixflow.search.pyramid import pyramid
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
        self.asked = self.settings = settings
        self.masks, self.guess, self.strict, self.floor = masks or Masks(None), guess, strict, floor
        self.masks_move = self.masks.moving
        self.dtype = np.float64 if settings.float64 else np.float32
        self.workspace = Workspace()
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
        if self.settings.lighting == "local":
            frame, unlit = flattened(frame, self.settings.sigma), frame
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
        self.settings = search_settings(self.asked, first.shape)
        if min(height, width) < self.settings.window:
            raise InputError(
                f"{name} has shape {first.shape}: smaller than window={self.settings.window:g}; "
                "take a smaller window or larger frames"
            )
        self.shape = (height, width)
        self.grid = Grid.over(self.shape, self.settings.step)
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
        bodies = reference.bodies
        if bodies is None or len(bodies.boxes) < 2:
            found = self._piece(reference, moved, settings, None, self.everywhere, self.everywhere, start)
        else:
            found = self._apart(reference, moved, settings, start)
        flag = found.flag
        failed = (flag & FAILING).astype(bool)
        six = np.moveaxis(np.tensordot(SIX_FROM_GRADIENT, found.maps, axes=1), 0, -1)
        six[..., ABSENT.get(settings.group, ())] *= 0.0  # by assumption, not by rounding; NaN stays NaN
        measured: dict[str, Any] = {
            "six": six,
            "covariance": found.covariance,
            "residual": found.residual,
            "noise": found.noise / (self.scale * math.sqrt(lowpass_noise(settings.lowpass))),
            "resolution": found.period,
        }
        for name, values in measured.items():
            # noise is in grey levels, which may be of any size
            measured[name] = values if name == "noise" else values.astype(self.dtype, copy=False)
            measured[name][failed] = np.nan
        if settings.replace_failed:
            flag |= _replace(measured["six"], measured["covariance"], flag, self.grid, self.settings)
        digest = hashlib.sha256(reference.digest + moved.digest + reference.mask_content)
        if self.masks_move:
            digest.update(moved.mask_content)
        memory = (
            self.workspace.nbytes
            + reference.frame.nbytes
            + moved.frame.nbytes
            + sum(m.nbytes for m in measured.values())
        )
        body = found.body
        if self.masks_move and body is None:
            number = 1 if bodies is None else next(iter(bodies.boxes))
            body = np.where(flag & FLAGS["masked"], 0, number).astype(np.int32)
        change_notes = change.notes(self.asked, found.lighting, numbers)
        notes = (*self._notes_of_masks(reference, moved), *reference.notes, *moved.notes, *change_notes)
        notes += _notes_of_pixels(numbers, blank, copied, dead)
        windows = found.window[~failed] if not failed.all() else found.window
        return PairResult(
            **measured, flag=flag, body=body, window=float(np.nanmedian(windows)), numbers=numbers,
            digest=digest.hexdigest()[:16], notes=notes, memory=memory, rho=found.rho,
        )  # fmt: skip

    def _notes_of_masks(self, reference: Prepared, moved: Prepared) -> tuple[str, ...]:
        """What should be known of the masks of a pair, each thing once."""
        notes = self.masks.notes
        for bodies in (reference.bodies, moved.bodies if self.masks_move else None):
            if bodies is not None:
                notes += said_of_mask(bodies, self.settings.window)
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
        return dataclasses.replace(prepared, frame=flattened(raw, self.settings.sigma), unlit=raw)

    @property
    def everywhere(self) -> Part:
        """All rows and columns of the frames."""
        assert self.shape is not None
        return slice(0, self.shape[0]), slice(0, self.shape[1])

    def _apart(self, reference: Prepared, moved: Prepared, settings: Settings, start: Start | None) -> Found:
        """Measure every body by itself, in a part of the frames that leaves room for its motion."""
        bodies, shape = reference.bodies, self.shape
        assert bodies is not None
        assert shape is not None
        whole = Found.nothing(self.grid.shape)
        if start is None and len(bodies.boxes) >= MANY_BODIES:
            start = self._in_common(reference, moved, settings)
        for number, box in bodies.boxes.items():
            near = with_margin(box, shape, room_to_move(box, self.settings.window))
            # off frame 0, its points may be anywhere near
            points = with_margin(box, shape, self.grid.step) if self.settings.reference == "first" else near
            if self.grid.within(*points, origin=near) is None or not self._reported(bodies, number):
                continue
            found = self._piece(reference, moved, settings, number, near, points, start)
            if near != self.everywhere and share_failed(found.flag) > FAILED:
                far = points if self.settings.reference == "first" else self.everywhere
                again = self._piece(reference, moved, settings, number, self.everywhere, far, start)
                if share_failed(again.flag) < share_failed(found.flag):
                    found, points = again, far
            whole.take(found, number, self._grid_in(points, points)[1])
        return whole

    def _in_common(self, reference: Prepared, moved: Prepared, settings: Settings) -> Start | None:
        """Search the motion of all bodies as one: a start for each; a body that it misses is searched by itself."""
        if (
            self.guess is not None
            or settings.search not in ("auto", "pyramid")
            or settings.reference != "first"
        ):
            return None
        assert reference.bodies is not None
        everything = reference.bodies.of_number(None, self.everywhere)
        frame = reference.frame.within(both_valid(everything, reference.frame.valid))
        frame = reference.evidence(frame, self.everywhere)
        if not frame.valid.any():
            return None
        single = search_settings(settings, frame.image.shape)
        other = moved.evidence(moved.frame, self.everywhere)
        return Start(pyramid(frame, other, self.grid, single, self.workspace))

    def _reported(self, bodies: Bodies, number: int) -> bool:
        """Whether any grid point may lie on a body."""
        if self.settings.reference != "first":
            return True
        return bool((bodies.labels[np.ix_(self.grid.y, self.grid.x)] == number).any())

    def _grid_in(self, points: Part, part: Part) -> tuple[Grid, Part]:
        within = self.grid.within(*points, origin=part)
        assert within is not None
        return within

    def _piece(
        self,
        reference: Prepared,
        moved: Prepared,
        settings: Settings,
        number: int | None,
        part: Part,
        points: Part,
        start: Start | None,
    ) -> Found:
        """Measure one body (None: all that the mask leaves) in a part of the frames, at the grid points of another."""
        grid, places = self._grid_in(points, part)
        region, asked, other = self._frames_of(reference, moved, number, part)
        known = None if start is None else start.of(number, places, grid)
        guess = None if self.guess_maps is None else self.guess_maps[(slice(None), *places)]
        light = self._light(reference, moved, number, part, grid)
        doubtful = self.asked.lighting == "auto" and settings.lighting == "gain+offset"
        if settings.reference == "second":
            # frame 1 is the one that stays: frame 0 is found from it, backwards
            known = None if known is None else known.backwards()
            swapped = settings.replace(reference="first")
            guess = None if guess is None else -placed(guess, grid, 1.0)
            found = Between(other, region, other, grid, swapped, self.workspace, light, doubtful).measure(
                known, guess
            )
            maps = -found.maps
        else:
            found = Between(region, other, asked, grid, settings, self.workspace, light, doubtful).measure(
                known, guess
            )
            maps = found.maps
        flag, quality = found.flag, found.quality
        flag[masked_points(maps, grid, asked.valid, settings.reference)] = FLAGS["masked"]
        return Found(
            maps, quality.covariance, quality.residual, quality.noise, quality.rho,
            found.window, found.period, flag, None, found.lighting,
        )  # fmt: skip

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
        backwards = self.settings.reference == "second"
        frames = reference.unlit.part(part), moved.unlit.part(part)
        return RegionLight(
            *frames, bodies.of_number(number, part), there, grid, self.settings.sigma, backwards
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


def _replace(
    six: NDArray[Any], covariance: NDArray[Any], flag: NDArray[np.uint16], grid: Grid, settings: Settings
) -> NDArray[np.uint16]:
    """Fill failed points of `six` and `covariance` in place from their neighbours; the flag bits that say so."""
    wanted = ((flag & FAILING) != 0) & ((flag & FLAGS["masked"]) == 0)
    predicted, spread, known = predictions(six, covariance, wanted, grid.step, settings.window)
    at = np.flatnonzero(wanted)[known]
    six.reshape(-1, 6)[at], covariance.reshape(-1, 6, 6)[at] = predicted[known], spread[known]
    bits = np.zeros(flag.shape, np.uint16)
    bits.ravel()[at] = FLAGS["replaced"]
    return bits
