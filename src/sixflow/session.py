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
from sixflow.errors import InputError
from sixflow.field.dataset import FAILING, build_field
from sixflow.field.flags import FLAGS
from sixflow.grid import Grid
from sixflow.method import passes_of
from sixflow.normalise import Frame, both_valid, check_frame, flatten_lighting, to_image
from sixflow.passes import Quality, Workspace
from sixflow.refine import refine
from sixflow.rescue import FAILED, rescue
from sixflow.resolution import Level, choose, ladder, search_settings
from sixflow.restriction import ABSENT
from sixflow.search import search
from sixflow.settings import Settings
from sixflow.validate import flag_points, settle
from sixflow.version import __version__


@dataclasses.dataclass(frozen=True)
class PairResult:
    """What was measured of one pair; arrays (rows, columns, …) as in `sixflow.field.dataset`, NaN at failed points."""

    six: NDArray[Any]
    covariance: NDArray[Any]
    residual: NDArray[Any]
    noise: NDArray[Any]
    resolution: NDArray[Any]
    flag: NDArray[np.uint8]
    window: float
    numbers: tuple[int, int]
    digest: str
    notes: tuple[str, ...]
    memory: int


@dataclasses.dataclass(frozen=True)
class Refined:
    """A refined and judged field; `window` and `period`, attenuated by 10 %, of each point, px."""

    maps: NDArray[Any]
    quality: Quality
    flag: NDArray[np.uint8]
    window: NDArray[Any]
    period: NDArray[Any]


@dataclasses.dataclass
class Prepared:
    """A frame that has been checked and normalised, with what is remembered of the raw one."""

    frame: Frame
    digest: bytes
    mean: float
    spread: float
    notes: tuple[str, ...]


class Session:
    """Settings, region of interest, grid and working memory that all pairs of a recording share."""

    def __init__(self, settings: Settings, mask: ArrayLike | None) -> None:
        self.asked = settings
        self.settings = settings
        self.dtype = np.float64 if settings.float64 else np.float32
        self.mask = None if mask is None else _check_mask(mask)
        self.workspace = Workspace()
        self.shape: tuple[int, int] | None = None
        self.constant, self.scale = 0.0, 1.0

    def prepare(self, raw: ArrayLike, name: str) -> Prepared:
        """Check and normalise one frame."""
        array = check_frame(raw, name)
        if self.shape is None:
            self._begin(array, name)
        if array.shape != self.shape:
            raise InputError(
                f"{name} has shape {array.shape}, the first frame {self.shape}: "
                "all frames must have one shape; crop or resample them"
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
        if self.settings.lighting == "local":
            image = flatten_lighting(image, valid, self.settings.sigma)
        return Prepared(Frame(image, valid), digest, mean, spread, notes)

    def _begin(self, first: NDArray[Any], name: str) -> None:
        """Take shape, grid and the grey constant from the first frame."""
        height, width = first.shape
        self.settings = search_settings(self.asked, first.shape)
        if min(height, width) < self.settings.window:
            raise InputError(
                f"{name} has shape {first.shape}: smaller than window={self.settings.window:g}; "
                "take a smaller window or larger frames"
            )
        if self.mask is not None and self.mask.shape != first.shape:
            raise InputError(
                f"mask has shape {self.mask.shape}, the frames {first.shape}: the mask must have the frames' shape"
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

    def measure_pair(self, reference: Prepared, moved: Prepared, numbers: tuple[int, int]) -> PairResult:
        """Measure one pair: search, refine, judge."""
        settings, grid = self.settings, self.grid
        region = reference.frame
        if self.mask is not None:
            region = reference.frame.within(both_valid(self.mask, reference.frame.valid))
            if not region.valid.any():
                raise InputError(
                    "mask is True only where frame 0 has no value (NaN or infinite): nothing is left to measure"
                )
        refined = self._refined(
            region, moved.frame, search(region, moved.frame, grid, settings, self.workspace)
        )
        if settings.search == "auto" and _share_failed(refined.flag) > FAILED:
            start = rescue(region, moved.frame, grid, settings)
            if start is not None:
                again = self._refined(region, moved.frame, start)
                if _share_failed(again.flag) < _share_failed(refined.flag):
                    refined = again
        flag, quality = refined.flag, refined.quality
        failed = (flag & FAILING).astype(bool)
        six = np.moveaxis(np.tensordot(SIX_FROM_GRADIENT, refined.maps, axes=1), 0, -1)
        six[..., ABSENT.get(settings.group, ())] *= 0.0  # by assumption, not by rounding; NaN stays NaN
        measured = {
            "six": six,
            "covariance": quality.covariance,
            "residual": quality.residual,
            "noise": quality.noise / self.scale,
            "resolution": refined.period.copy(),
        }
        windows = refined.window[~failed] if not failed.all() else refined.window
        for name, values in measured.items():
            # noise is in grey levels, which may be of any size
            measured[name] = values if name == "noise" else values.astype(self.dtype, copy=False)
            measured[name][failed] = np.nan
        digest = hashlib.sha256(
            reference.digest + moved.digest + (self.mask.tobytes() if self.mask is not None else b"")
        )
        memory = (
            self.workspace.nbytes
            + reference.frame.nbytes
            + moved.frame.nbytes
            + sum(m.nbytes for m in measured.values())
        )
        notes = (*reference.notes, *moved.notes, *_lighting_notes(reference, moved, numbers, settings))
        return PairResult(
            **measured, flag=flag, window=float(np.median(windows)), numbers=numbers, digest=digest.hexdigest()[:16],
            notes=notes, memory=memory,
        )  # fmt: skip

    def _refined(self, region: Frame, moved: Frame, start: NDArray[Any]) -> Refined:
        """Refine a start and judge it."""
        if self.asked.window == "auto":
            levels: list[Level] = []
            for settings in reversed(ladder(self.asked, region.image.shape)):
                levels.insert(0, self._level(region, moved, start, settings, sharpened=bool(levels)))
                start = settle(
                    np.where(levels[0].usable, levels[0].maps, np.nan), self.grid.step, settings.window
                )
            chosen = choose(levels, self.grid)
            return Refined(chosen.maps, chosen.quality, chosen.flag, chosen.window, chosen.period)
        level = self._level(region, moved, start, self.settings)
        everywhere = np.ones(self.grid.shape)
        return Refined(
            level.maps,
            level.quality,
            level.flag,
            level.settings.window * everywhere,
            level.period * everywhere,
        )

    def _level(
        self, region: Frame, moved: Frame, start: NDArray[Any], settings: Settings, *, sharpened: bool = False
    ) -> Level:
        """Refine a start with one window and judge it."""
        passes = passes_of(settings)(region, moved, self.grid, settings, self.workspace)
        maps, quality, left = refine(passes, start, sharpened=sharpened)
        flag = flag_points(passes.dense(maps), quality, left, self.grid, region, settings)
        return Level(settings, maps, quality, left, flag)

    def field(self, result: PairResult, time: Sequence[float], unit: str) -> xr.Dataset:
        """Return the dataset of one pair."""
        settings = self.asked
        assert self.shape is not None
        resolutions = result.resolution[np.isfinite(result.resolution)]
        attrs = {
            "sixflow_version": __version__,
            "settings": settings.to_json(),
            "input_digest": result.digest,
            "frame_shape": list(self.shape),
            "effective_window": result.window,
            "attenuation_period_10": float(np.median(resolutions)) if resolutions.size else float("nan"),
            "memory_bytes": result.memory,
            "notes": "\n".join(result.notes),
        }
        return build_field(
            six=result.six[None],
            covariance=result.covariance[None],
            residual=result.residual[None],
            noise=result.noise[None],
            resolution=result.resolution[None],
            flag=result.flag[None],
            x=self.grid.x,
            y=self.grid.y,
            time=np.asarray(time, dtype=np.float64),
            time_unit=unit,
            frame_numbers=[result.numbers],
            attrs=attrs,
        )


def _share_failed(flag: NDArray[np.uint8]) -> float:
    """Share of the points that are not masked and failed."""
    asked = (flag & FLAGS["masked"]) == 0
    return float(((flag & FAILING) != 0)[asked].mean()) if asked.any() else 0.0


def _check_mask(mask: ArrayLike) -> NDArray[np.uint8]:
    array = np.asarray(mask)
    if array.dtype.kind not in "biu" or array.ndim != 2:
        raise InputError(
            f"mask has dtype {array.dtype} and shape {array.shape}: "
            "must be a (height, width) array of bool, True where to measure"
        )
    if not array.any():
        raise InputError(
            "mask is False everywhere: nothing is left to measure; True marks the region of interest"
        )
    return (array != 0).astype(np.uint8)


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
