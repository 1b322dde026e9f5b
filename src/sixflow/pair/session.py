"""Session: everything that the pairs of one recording share, and the measurement of one pair.

`Session.measure_pair` is the method section: search, refine, judge.
"""

from __future__ import annotations

import hashlib
import math
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from sixflow.convention import SIX_FROM_GRADIENT
from sixflow.convention.flags import FAILING, FLAGS
from sixflow.engine.lowpass import lowpass_noise
from sixflow.errors import BadFrameError, InputError
from sixflow.frames.floor import Floor
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
from sixflow.pair.result import PairResult, field_of_pair, same_content
from sixflow.pair.unmeasured import repeated
from sixflow.prepare.frame import NO_MASK, Frame, both_valid
from sixflow.prepare.image import Grey, check_frame, range_of, require_contrast
from sixflow.prepare.interlacing import InterlacingCheck
from sixflow.prepare.light import BodyLight, body_lit
from sixflow.prepare.prepare import Prepared, prepare_frame, prepare_pair
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
            self._begin(array, name, bodies)
        if array.shape != self.shape:
            raise BadFrameError(
                f"{name} has shape {array.shape}, the first frame {self.shape}: "
                "all frames must have one shape; crop or resample them"
            )
        return prepare_frame(
            array, name, self.bodies_of(bodies), Grey(self.constant, self.scale, self.dtype),
            floor=self.floor, interlacing=self.interlacing, lasting=lasting,
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
        """Take shape, grid and the grey constant from the first frame, of the pixels that its mask leaves."""
        height, width = first.shape
        self.settings = search_settings(self.asked, first.shape)
        if min(height, width) < self.settings.window:
            raise InputError(
                f"{name} has shape {first.shape}: smaller than window={self.settings.window:g}; "
                "take a smaller window or larger frames"
            )
        self.shape = (height, width)
        self.grid = Grid.over(self.shape, self.settings.step)
        asked = self.asked
        self.guess_maps = None if self.guess is None else maps_of_guess(self.guess, self.grid)
        self.region = region_of(self.shape, asked.roi, asked.polygons, asked.holes)
        bodies, some = self.bodies_of(mask), (slice(None, None, 4),) * 2
        values = first[some] if bodies is None else first[some][bodies.labels[some] != 0]
        if bodies is not None and not values.size:
            values = first[bodies.labels != 0]
        self.constant, self.scale = range_of(values, name)

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
        pair = prepare_pair(
            reference, moved, masks_move=self.masks_move, robust=self.asked.robust, copies=self.floor.copies,
            lowpass=self.asked.lowpass, scale=self.scale,
        )  # fmt: skip
        reference, moved, change = pair.reference, pair.moved, pair.change
        settings = change.settings(self.asked)
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
        notes += pair.notes(numbers)
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
        frame, _, other, _ = self._frames_of(reference, moved, None, self.everywhere, self.grid)
        if frame.valid.size and not frame.valid.any():
            return None
        single = search_settings(settings, frame.image.shape)
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
        region, asked, other, light = self._frames_of(reference, moved, number, part, grid)
        if number is None:
            _require_pixels(asked, other)
        known = None if start is None else start.of(number, places, grid)
        guess = None if self.guess_maps is None else self.guess_maps[(slice(None), *places)]
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
        self, reference: Prepared, moved: Prepared, number: int | None, part: Part, grid: Grid
    ) -> tuple[Frame, Frame, Frame, BodyLight | None]:
        """Frame 0 where it counts for a body, frame 0 where that is asked for, and frame 1 where it may be; and what
        divides out the light of the body in frame 1.
        """
        asked, other, light = reference.frame.part(part), moved.frame.part(part), None
        bodies, there = reference.bodies, moved.bodies if self.masks_move else None
        if bodies is not None:
            asked = asked.within(_where(bodies.of_number(number, part), asked))
        if there is not None:
            # the region of the settings is that of frame 0: what moves out of it is still there
            partner = self._partner(reference, moved, number)
            other = other.within(_where((there.whole or there).of_number(partner, part), other))
        if self.settings.lighting == "local":
            carried = (
                None if bodies is None or there is not None else (grid, self.settings.reference == "second")
            )
            asked, other, light = body_lit(asked, other, self.settings.sigma, carried=carried)
        region = asked
        if bodies is not None and bodies.clear is not None:
            region = asked.within(both_valid(asked.valid, bodies.clear[part]))
        return reference.evidence(region, part), asked, moved.evidence(other, part), light

    @staticmethod
    def _partner(reference: Prepared, moved: Prepared, number: int | None) -> int | None:
        """Number of a body in frame 1; None for any, where the numbers are not given in both frames."""
        named = [frame.bodies is not None and frame.bodies.named for frame in (reference, moved)]
        return number if all(named) else None

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


def _where(region: NDArray[np.uint8], frame: Frame) -> NDArray[np.uint8]:
    """Where a frame is valid in a region; `NO_MASK` where that is everywhere."""
    valid = both_valid(region, frame.valid)
    return NO_MASK if valid.all() else valid


def _require_pixels(asked: Frame, other: Frame) -> None:
    """Require both frames to have values where their masks are True."""
    for frame, which, name in ((asked, "mask", "frame 0"), (other, "mask of the second frame", "that")):
        if frame.valid.size and not frame.valid.any():
            raise BadFrameError(
                f"{which} is True only where {name} has no value (NaN or infinite): nothing is left to measure"
            )


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
