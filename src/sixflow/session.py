"""Session: everything that the pairs of one recording share, and the measurement of one pair.

`Session.measure_pair` is the method section: search, refine, judge.
"""

from __future__ import annotations

import dataclasses
import hashlib
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from sixflow.convention import SIX_FROM_GRADIENT
from sixflow.convention.reference import SHARE
from sixflow.engine.window import attenuation_period
from sixflow.errors import InputError
from sixflow.field.dataset import FAILING, build_field
from sixflow.field.flags import FLAGS
from sixflow.grid import Grid
from sixflow.light import RegionLight
from sixflow.masks import Bodies
from sixflow.method import passes_of
from sixflow.normalise import Frame, both_valid, check_frame, flatten_lighting, to_image
from sixflow.passes import Passes, Quality, Workspace
from sixflow.pieces import Found, Part, Start, room_to_move, with_margin
from sixflow.placing import masked_points, placed
from sixflow.refine import refine
from sixflow.rescue import FAILED, rescue
from sixflow.restriction import ABSENT
from sixflow.search import search
from sixflow.settings import Settings
from sixflow.trajectory import Motion, one_frames_share
from sixflow.validate import flag_points
from sixflow.version import __version__


@dataclasses.dataclass(frozen=True)
class PairResult:
    """What was measured of one pair; arrays (rows, columns, …) as in `sixflow.field.dataset`, NaN at failed points."""

    six: NDArray[Any]
    covariance: NDArray[Any]
    residual: NDArray[Any]
    noise: NDArray[Any]
    flag: NDArray[np.uint8]
    body: NDArray[np.int32] | None
    numbers: tuple[int, int]
    digest: str
    notes: tuple[str, ...]
    memory: int
    rho: NDArray[Any]
    moved_covariance: NDArray[Any] | None = None
    measured_from: int | None = None

    @property
    def motion(self) -> Motion:
        """The result as a step of a trajectory."""
        moved = self.moved_covariance
        if moved is None:
            moved = self.covariance * one_frames_share(self.rho)[..., None, None]
        return Motion(
            self.six,
            self.covariance,
            moved.astype(self.six.dtype),
            self.flag,
            self.residual,
            self.noise,
            self.body,
        )


@dataclasses.dataclass
class Prepared:
    """A frame that has been checked and normalised, with what is remembered of the raw one.

    `unlit` is the frame before its local light was divided out.
    """

    frame: Frame
    digest: bytes
    mean: float
    spread: float
    notes: tuple[str, ...]
    bodies: Bodies | None = None
    unlit: Frame | None = None

    @property
    def mask_content(self) -> bytes:
        """The mask, for digests; empty without one."""
        return b"" if self.bodies is None else self.bodies.content


class Session:
    """Settings, grid and working memory that all pairs of a recording share.

    Parameters
    ----------
    settings : Settings
    masks_move : bool
        Whether the mask of a moved frame counts: there is one for each frame.
    """

    def __init__(self, settings: Settings, *, masks_move: bool = False) -> None:
        self.settings, self.masks_move = settings, masks_move
        self.dtype = np.float64 if settings.float64 else np.float32
        self.workspace = Workspace()
        self.shape: tuple[int, int] | None = None
        self.constant, self.scale = 0.0, 1.0

    def prepare(self, raw: ArrayLike, name: str, bodies: Bodies | None = None) -> Prepared:
        """Check and normalise one frame; `bodies` of its mask, if there is one."""
        array = check_frame(raw, name)
        if self.shape is None:
            self._begin(array, name)
        if array.shape != self.shape:
            raise InputError(
                f"{name} has shape {array.shape}, the first frame {self.shape}: "
                "all frames must have one shape; crop or resample them"
            )
        if bodies is not None and bodies.labels.shape != self.shape:
            raise InputError(
                f"mask has shape {bodies.labels.shape}, the frames {self.shape}: the mask must have the frames' shape"
            )
        image, valid, missing = to_image(array, self.constant, self.dtype, self.scale)
        if missing == array.size:
            raise InputError(
                f"{name} has no finite pixel: all {array.size} are NaN or infinite; check how it was read"
            )
        kept = image[valid.astype(bool)] if valid.size else image
        if kept.max() == kept.min():
            raise InputError(
                f"{name} is constant ({array.flat[0]}): there is no texture to follow; check the frame or its exposure"
            )
        notes = (f"{name}: {missing} pixels without a value (NaN or infinite) are masked",) if missing else ()
        sample = kept[::4, ::4] if kept.ndim == 2 else kept
        digest = hashlib.sha256(np.ascontiguousarray(array).data).digest()
        mean, spread = float(sample.mean()) / self.scale, float(sample.std()) / self.scale
        unlit = None
        if self.settings.lighting == "local":
            unlit = Frame(image, valid)
            image = flatten_lighting(image, valid, self.settings.sigma)
        return Prepared(Frame(image, valid), digest, mean, spread, notes, bodies, unlit)

    def _begin(self, first: NDArray[Any], name: str) -> None:
        """Take shape, grid and the grey constant from the first frame."""
        height, width = first.shape
        if min(height, width) < self.settings.window:
            raise InputError(
                f"{name} has shape {first.shape}: smaller than window={self.settings.window:g}; "
                "take a smaller window or larger frames"
            )
        self.shape = (height, width)
        self.grid = Grid.over(self.shape, self.settings.step)
        sample = first[::4, ::4].astype(np.float64)
        finite = sample[np.isfinite(sample)]
        if finite.size:
            self.constant = float(finite.mean())
            spread = float(np.abs(finite - self.constant).mean())
            if spread > 0 and not 1e-3 < spread < 1e5:  # squares of squares must fit single precision
                self.scale = 2.0 ** -round(math.log2(spread) - 5)

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
        bodies = reference.bodies
        if bodies is None or len(bodies.boxes) < 2:
            found = self._piece(reference, moved, None, self.everywhere, self.everywhere, start)
        else:
            found = self._apart(reference, moved, start)
        flag, settings = found.flag, self.settings
        failed = (flag & FAILING).astype(bool)
        six = np.moveaxis(np.tensordot(SIX_FROM_GRADIENT, found.maps, axes=1), 0, -1)
        six[..., ABSENT.get(settings.group, ())] *= 0.0  # by assumption, not by rounding; NaN stays NaN
        measured = {
            "six": six,
            "covariance": found.covariance,
            "residual": found.residual,
            "noise": found.noise / self.scale,
        }
        for name, values in measured.items():
            # noise is in grey levels, which may be of any size
            measured[name] = values if name == "noise" else values.astype(self.dtype, copy=False)
            measured[name][failed] = np.nan
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
        notes = (*reference.notes, *moved.notes, *_lighting_notes(reference, moved, numbers, settings))
        return PairResult(
            measured["six"], measured["covariance"], measured["residual"], measured["noise"], flag, body,
            numbers, digest.hexdigest()[:16], notes, memory, found.rho,
        )  # fmt: skip

    @property
    def everywhere(self) -> Part:
        """All rows and columns of the frames."""
        assert self.shape is not None
        return slice(0, self.shape[0]), slice(0, self.shape[1])

    def _apart(self, reference: Prepared, moved: Prepared, start: Start | None) -> Found:
        """Measure every body by itself, in a part of the frames that leaves room for its motion."""
        bodies, shape = reference.bodies, self.shape
        assert bodies is not None
        assert shape is not None
        whole = Found.nothing(self.grid.shape)
        for number, box in bodies.boxes.items():
            near = with_margin(box, shape, room_to_move(box, self.settings.window))
            # off frame 0, its points may be anywhere near
            points = with_margin(box, shape, self.grid.step) if self.settings.reference == "first" else near
            if self.grid.within(*points, origin=near) is None or not self._reported(bodies, number):
                continue
            found = self._piece(reference, moved, number, near, points, start)
            if near != self.everywhere and _share_failed(found.flag) > FAILED:
                far = points if self.settings.reference == "first" else self.everywhere
                again = self._piece(reference, moved, number, self.everywhere, far, start)
                if _share_failed(again.flag) < _share_failed(found.flag):
                    found, points = again, far
            whole.take(found, number, self._grid_in(points, points)[1])
        return whole

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
        number: int | None,
        part: Part,
        points: Part,
        start: Start | None,
    ) -> Found:
        """Measure one body (None: all that the mask leaves) in a part of the frames, at the grid points of another."""
        grid, places = self._grid_in(points, part)
        region, asked, other = self._frames_of(reference, moved, number, part)
        known = None if start is None else start.of(number, places, grid)
        light = self._light(reference, moved, number, part, grid)
        if self.settings.reference == "second":
            # frame 1 is the one that stays: frame 0 is found from it, backwards
            known = None if known is None else known.backwards()
            maps, quality, flag = self._measured(other, region, other, grid, known, light)
            maps = -maps
        else:
            maps, quality, flag = self._measured(region, other, asked, grid, known, light)
        flag[masked_points(maps, grid, asked.valid, self.settings.reference)] = FLAGS["masked"]
        return Found(maps, quality.covariance, quality.residual, quality.noise, quality.rho, flag, None)

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
                raise InputError(
                    "mask is True only where frame 0 has no value (NaN or infinite): nothing is left to measure"
                )
        if self.masks_move and moved.bodies is not None:
            own = moved.bodies.of_number(self._partner(reference, moved, number), part)
            other = other.within(both_valid(own, other.valid))
            if number is None and not other.valid.any():
                raise InputError(
                    "mask of the second frame is True only where that has no value (NaN or infinite): "
                    "nothing is left to measure"
                )
        return region, asked, other

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
            there = moved.bodies.of_number(self._partner(reference, moved, number), part)
        frames = reference.unlit.part(part), moved.unlit.part(part)
        return RegionLight(*frames, bodies.of_number(number, part), there, grid, self.settings)

    def _measured(
        self,
        region: Frame,
        moved: Frame,
        judged: Frame,
        grid: Grid,
        start: Start | None,
        light: RegionLight | None = None,
    ) -> tuple[NDArray[Any], Quality, NDArray[np.uint8]]:
        """Search, refine and judge: maps from `region` to `moved`, quality and flags."""
        settings = self.settings
        plain = settings.replace(reference="first")
        share = SHARE[settings.reference] if settings.reference == "middle" else 0.0

        def passes_from(begin: NDArray[Any]) -> Passes:
            lit = (region, moved) if light is None else light.divided_out(region, moved, begin)
            return passes_of(settings)(*lit, grid, settings if share else plain, self.workspace)

        begun = None
        if start is not None:
            begun = self._refined(passes_from(start.maps), start.maps, judged)
            if start.succeeded(begun[2], grid, region.image.shape, settings if share else plain):
                return begun
        maps = search(region, moved, grid, plain, self.workspace)
        maps = placed(maps, grid, share) if share else maps
        maps, quality, flag = self._refined(passes_from(maps), maps, judged)
        if settings.search == "auto" and _share_failed(flag) > FAILED:
            rescued = rescue(region, moved, grid, plain)
            if rescued is not None:
                rescued = placed(rescued, grid, share) if share else rescued
                again = self._refined(passes_from(rescued), rescued, judged)
                if _share_failed(again[2]) < _share_failed(flag):
                    maps, quality, flag = again
        if begun is not None and _share_failed(begun[2]) <= _share_failed(flag):
            return begun
        return maps, quality, flag

    def _refined(
        self, passes: Passes, start: NDArray[Any], judged: Frame
    ) -> tuple[NDArray[Any], Quality, NDArray[np.uint8]]:
        """Refine a start and judge it: maps, quality and flags."""
        maps, quality, left = refine(passes, start)
        flag = flag_points(passes.dense(maps), quality, left, passes.grid, judged, passes.settings)
        return maps, quality, flag

    def field(
        self,
        result: PairResult,
        time: Sequence[float],
        unit: str,
        meaning: str = "time of the reference frame",
    ) -> xr.Dataset:
        """Return the dataset of one pair."""
        settings = self.settings
        assert self.shape is not None
        attrs = {
            "sixflow_version": __version__,
            "settings": settings.to_json(),
            "input_digest": result.digest,
            "frame_shape": list(self.shape),
            "effective_window": float(settings.window),
            "attenuation_period_10": attenuation_period(settings.sigma, settings.sharpen),
            "memory_bytes": result.memory,
            "notes": "\n".join(result.notes),
        }
        field = build_field(
            six=result.six[None],
            covariance=result.covariance[None],
            residual=result.residual[None],
            noise=result.noise[None],
            flag=result.flag[None],
            body=None if result.body is None else result.body[None],
            x=self.grid.x,
            y=self.grid.y,
            time=np.asarray(time, dtype=np.float64),
            time_unit=unit,
            frame_numbers=[result.numbers],
            attrs=attrs,
        )
        field["time"].attrs["long_name"] = meaning
        if result.moved_covariance is None:
            return field
        part = field["covariance"].copy(data=result.moved_covariance[None])
        part.attrs["long_name"] = "part of the covariance that is from the noise of the moved frame"
        source = {"long_name": "number of the frame that the moved frame was compared with"}
        return field.assign(moved_covariance=part).assign_coords(
            measured_from=("time", np.array([result.measured_from], dtype=np.int64), source)
        )


def _share_failed(flag: NDArray[np.uint8]) -> float:
    """Share of the points that are not masked and failed."""
    asked = (flag & FLAGS["masked"]) == 0
    return float(((flag & FAILING) != 0)[asked].mean()) if asked.any() else 0.0


def _lighting_notes(
    reference: Prepared, moved: Prepared, numbers: tuple[int, int], settings: Settings
) -> tuple[str, ...]:
    """Say so when the light changed between the frames and the settings do not allow for it."""
    if settings.lighting != "none" or settings.method == "eigenfilter" or reference.spread == 0:
        return ()
    gain, shift = moved.spread / reference.spread, (moved.mean - reference.mean) / reference.spread
    if abs(gain - 1) < 0.1 and abs(shift) < 0.2:
        return ()
    return (
        f"frames {numbers[0]} and {numbers[1]}: the light changed (contrast × {gain:.2f}, "
        f"brightness {moved.mean - reference.mean:+.3g} grey); "
        'consider lighting="gain+offset"',
    )
