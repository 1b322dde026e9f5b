"""Pair: what goes into the measurement of one pair of frames, what comes out, and the field that it makes."""

from __future__ import annotations

import dataclasses
import hashlib
import math
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from sixflow.convention.flags import FLAGS
from sixflow.engine.lowpass import lowpass_noise
from sixflow.field.dataset import build_field
from sixflow.field.interval import statement
from sixflow.frames.times import PairTimes
from sixflow.judge.replace import replace_failed
from sixflow.maps.motion import Motion, one_frames_share
from sixflow.maps.restriction import ABSENT
from sixflow.maps.six import six_of_maps
from sixflow.plan import Plan
from sixflow.prepare.frame import both_valid
from sixflow.prepare.prepare import Prepared, PreparedPair
from sixflow.refine.solution import Solution
from sixflow.settings import Settings
from sixflow.version import __version__


@dataclasses.dataclass(frozen=True)
class PairResult:
    """What was measured of one pair; arrays (rows, columns, …) as in `sixflow.field.dataset`, NaN at failed points
    that were not replaced.
    """

    six: NDArray[Any]
    covariance: NDArray[Any]
    residual: NDArray[Any]
    noise: NDArray[Any]
    resolution: NDArray[Any]
    flag: NDArray[np.uint16]
    body: NDArray[np.int32] | None
    window: float
    numbers: tuple[int, int]
    digest: str
    notes: tuple[str, ...]
    memory: int
    rho: NDArray[Any]
    bias: NDArray[Any]
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
            self.bias,
        )


def same_content(reference: Prepared, moved: Prepared) -> bool:
    """Whether two frames are the same to the last bit, or what their masks leave of them is."""
    if reference.digest == moved.digest:
        return True
    masks = [
        (one.bodies.labels != 0).astype(np.uint8) for one in (reference, moved) if one.bodies is not None
    ]
    if not masks:
        return False
    frames = reference.frame, moved.frame
    counted = both_valid(*masks, *(frame.valid for frame in frames)).astype(bool)
    return bool(counted.any() and np.array_equal(*(frame.image[counted] for frame in frames)))


def result_of_solution(
    found: Solution,
    pair: PreparedPair,
    plan: Plan,
    numbers: tuple[int, int],
    notes: tuple[str, ...],
    *,
    masks_move: bool,
    scale: float,
    replace: bool,
) -> PairResult:
    """Bring a solution into the form of a field: the six numbers, NaN where failed, and noise in raw grey values.

    Parameters
    ----------
    found : Solution
    pair : PreparedPair
        What it was measured of.
    plan : Plan
    numbers : (int, int)
        Of the two frames.
    notes : tuple of str
    masks_move : bool
        Whether there is a mask for each frame.
    scale : float
        Of the images.
    replace : bool
        Give failed points what their neighbours predict.
    """
    flag, failed, statistics = found.flag, found.failed, found.statistics
    six = six_of_maps(found.maps)
    six[..., ABSENT.get(plan.group, ())] *= 0.0  # by assumption, not by rounding; NaN stays NaN
    measured: dict[str, Any] = {
        "six": six.astype(plan.dtype),
        "covariance": found.covariance.astype(plan.dtype),
        "bias": np.full(six.shape, np.nan, plan.dtype)
        if found.bias is None
        else found.bias.astype(plan.dtype),
        "residual": statistics.residual.astype(plan.dtype),
        # in grey levels, which may be of any size
        "noise": statistics.noise / (scale * math.sqrt(lowpass_noise(plan.lowpass))),
        "resolution": found.period.astype(plan.dtype),
    }
    for values in measured.values():
        values[failed] = np.nan
    if replace:
        wanted = failed & ((flag & FLAGS["masked"]) == 0)
        step, size = plan.grid.step, plan.window.size
        total = measured["covariance"] + _diagonal(measured["bias"])
        replaced = replace_failed(measured["six"], total, wanted, step, size)
        measured["covariance"][replaced], measured["bias"][replaced] = total[replaced], 0.0
        flag = flag | np.where(replaced, FLAGS["replaced"], 0).astype(np.uint16)
    reference, moved = pair.reference, pair.moved
    digest = hashlib.sha256(reference.digest + moved.digest + reference.mask_content)
    if masks_move:
        digest.update(moved.mask_content)
    body = found.body
    if masks_move and body is None:
        number = 1 if reference.bodies is None else next(iter(reference.bodies.boxes))
        body = np.where(flag & FLAGS["masked"], 0, number).astype(np.int32)
    windows = found.window[~failed] if not failed.all() else found.window
    memory = reference.frame.nbytes + moved.frame.nbytes + sum(m.nbytes for m in measured.values())
    return PairResult(
        **measured, flag=flag, body=body, window=float(np.nanmedian(windows)), numbers=numbers,
        digest=digest.hexdigest()[:16], notes=notes, memory=memory, rho=statistics.rho,
    )  # fmt: skip


def _diagonal(bias: NDArray[Any]) -> NDArray[Any]:
    """Matrices with the biases on their diagonals, 0 where not estimated."""
    matrices: NDArray[Any] = np.nan_to_num(bias)[..., None] * np.eye(6, dtype=bias.dtype)
    return matrices


def field_of_pair(
    result: PairResult,
    times: PairTimes,
    names: NDArray[Any] | None,
    plan: Plan,
    settings: Settings,
) -> xr.Dataset:
    """Return the dataset of one pair.

    Parameters
    ----------
    result : PairResult
    times : PairTimes
    names : array of str, shape (2,), or None
        Of the files of the two frames.
    plan : Plan
    settings : Settings
        As they were asked for.
    """
    resolutions = result.resolution[np.isfinite(result.resolution)]
    attrs = {
        "sixflow_version": __version__,
        "settings": settings.to_json(),
        "input_digest": result.digest,
        "frame_shape": list(plan.shape),
        "interval": statement(times.interval, times.interval_unit),
        "effective_window": result.window,
        "attenuation_period_10": float(np.median(resolutions)) if resolutions.size else float("nan"),
        "memory_bytes": result.memory,
        "notes": "\n".join(result.notes),
    }
    field = build_field(
        six=result.six[None],
        covariance=result.covariance[None],
        bias=result.bias[None],
        residual=result.residual[None],
        noise=result.noise[None],
        resolution=result.resolution[None],
        flag=result.flag[None],
        body=None if result.body is None else result.body[None],
        x=plan.grid.x,
        y=plan.grid.y,
        time=np.array([times.time]),
        time_unit=times.unit,
        frame_numbers=[result.numbers],
        attrs=attrs,
        coordinates=_coordinates(result, times, names),
    )
    field["time"].attrs["long_name"] = times.meaning
    if result.moved_covariance is None:
        return field
    part = field["covariance"].copy(data=result.moved_covariance[None])
    part.attrs["long_name"] = "part of the covariance that is from the noise of the moved frame"
    return field.assign(moved_covariance=part)


def _coordinates(result: PairResult, times: PairTimes, names: NDArray[Any] | None) -> dict[str, Any]:
    """Coordinates of a pair along time, besides those of every field."""

    def one(value: Any, long_name: str, unit: str | None = None) -> Any:
        return "time", np.array([value]), {"long_name": long_name} | ({"units": unit} if unit else {})

    coordinates = {
        "time0": one(times.time0, "time of the reference frame", times.unit),
        "time1": one(times.time1, "time of the moved frame", times.unit),
        "interval": one(times.interval, "time between the two frames", times.interval_unit),
    }
    if names is not None:
        for k, frame in enumerate(("reference", "moved")):
            said = {"long_name": f"file of the {frame} frame"}
            coordinates[f"name{k}"] = ("time", names[k : k + 1], said)
    if result.measured_from is not None:
        text = "number of the frame that the moved frame was compared with"
        coordinates["measured_from"] = one(np.int64(result.measured_from), text)
    return coordinates
