"""Measure: from frames to a field.

    frames → normalise → search → refine (→ sharpen) → validate → field

`measure` does it for a pair, `measure_sequence` for a recording; `iterate_sequence` hands out one field per pair, for recordings that are written as
they are measured.
"""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, Literal, Unpack, get_args

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from sixflow.engine.window import attenuation_period
from sixflow.errors import InputError
from sixflow.field import accessor as _accessor  # noqa: F401 - registers Dataset.sixflow
from sixflow.field.dataset import FAILING, build_field
from sixflow.grid import Grid
from sixflow.normalise import Frame, both_valid, check_frame, flatten_lighting, to_image
from sixflow.refine import Passes, Workspace, refine
from sixflow.search import search
from sixflow.settings import Settings, SettingsOptions
from sixflow.validate import flag_points
from sixflow.version import __version__

Pairs = Literal["consecutive", "first"]


def measure(
    frame0: ArrayLike,
    frame1: ArrayLike,
    *,
    mask: ArrayLike | None = None,
    settings: Settings | None = None,
    **options: Unpack[SettingsOptions],
) -> xr.Dataset:
    """Measure the six-parameter flow field from frame 0 to frame 1, and its covariance.

    Parameters
    ----------
    frame0, frame1 : array_like, shape (height, width)
        Grey values: integers or floats of any range. frame0 is the reference: frame1(x + u) = frame0(x). Pixels that
        are NaN or infinite are masked.
    mask : array_like of bool, shape (height, width), optional
        Region of interest of frame 0: True where to measure.
    settings : Settings, optional
        How to measure; the defaults if not given.
    **options
        Single settings by name, such as `window=41`; they go over `settings`. See `Settings` for meaning and ranges.

    Returns
    -------
    xarray.Dataset
        u, v [px], divergence, curl, stretch, shear [1], their covariance, residual, noise and flag on a grid of whole
        pixels, dims (time, y, x) with one time. Failed points are NaN. More through its accessor, `field.sixflow`.

    Raises
    ------
    InputError
        If a frame, the mask or a setting cannot be used: not two-dimensional real frames of one shape, smaller than the window, without
        contrast; a mask of another shape or without True.

    Notes
    -----
    Least squares of the residual and the gradients of the mean frame under a Gaussian window, solved for all six numbers at every grid point
    and iterated on a dense blend of the field (Eagleson's generators, eq. (3), as the window's affine model; the normal equations are
    derived in `sixflow.refine`).

    Examples
    --------
    >>> from sixflow import synth
    >>> motion = synth.Affine.zoom(1.02, centre=(63.5, 63.5))
    >>> made = synth.pair(synth.Speckle(), motion, (128, 128), sensor=synth.Sensor(noise=2))
    >>> field = measure(made.frame0, made.frame1, step=16)
    >>> field.divergence.shape
    (1, 8, 8)
    >>> float(abs(field.divergence - 0.04).max()) < 0.02
    True
    """
    session = _Session((settings or Settings()).replace(**options), mask)
    frames = [session.prepare(frame, f"frame{k}") for k, frame in enumerate((frame0, frame1))]
    return session.field(session.measure_pair(frames[0], frames[1], (0, 1)), [0.0], "frame")


def measure_sequence(
    frames: Iterable[ArrayLike],
    *,
    pairs: Pairs = "consecutive",
    mask: ArrayLike | None = None,
    times: Sequence[float] | None = None,
    settings: Settings | None = None,
    progress: Callable[[int], None] | None = None,
    **options: Unpack[SettingsOptions],
) -> xr.Dataset:
    """Measure every pair of a recording.

    Parameters
    ----------
    frames : iterable of array_like, shape (height, width), or array, shape (n, height, width)
        Taken one at a time: a generator, a `FrameSource` of `open_frames`, a list or an array.
    pairs : {"consecutive", "first"}
        Each frame against the next, or the first frame against each later one.
    mask : array_like of bool, optional
        Region of interest of the reference frames.
    times : sequence of float, optional
        Time of each frame, s. If not given, those of a `FrameSource`, or multiples of `frame_interval`, or frame numbers.
    settings, **options
        As for `measure`.
    progress : callable, optional
        Called with the number of pairs done, after each.

    Returns
    -------
    xarray.Dataset
        As from `measure`, one time per pair: the time of its reference frame (of its moved frame if `pairs="first"`).

    Raises
    ------
    InputError
        As `measure`, and if there are fewer than two frames, or they differ in shape.

    Examples
    --------
    >>> from sixflow import synth
    >>> made = synth.sequence(synth.Speckle(), synth.Affine.translation(0.5, 0), (64, 64), 3)
    >>> measure_sequence(made.frames, pairs="first").u.mean(("y", "x")).round(2).values
    array([0.5, 1. ], dtype=float32)
    """
    fields = []
    source = iterate_sequence(frames, pairs=pairs, mask=mask, times=times, settings=settings, **options)
    for done, field in enumerate(source, start=1):
        fields.append(field)
        if progress is not None:
            progress(done)
    return join_fields(fields)


def iterate_sequence(
    frames: Iterable[ArrayLike],
    *,
    pairs: Pairs = "consecutive",
    mask: ArrayLike | None = None,
    times: Sequence[float] | None = None,
    settings: Settings | None = None,
    skip: int = 0,
    **options: Unpack[SettingsOptions],
) -> Iterator[xr.Dataset]:
    """Yield the field of each pair of a recording as soon as it is measured; arguments as for `measure_sequence`.

    Parameters
    ----------
    skip : int
        Leave out so many pairs, for going on with an interrupted recording.
    """
    if pairs not in get_args(Pairs):
        raise InputError(f"pairs={pairs!r}: must be one of 'consecutive', 'first'")
    session = _Session((settings or Settings()).replace(**options), mask)
    stamps = getattr(frames, "times", None) if times is None else times
    reference: Frame | None = None
    count = 0
    # a frame that is in no wanted pair is read but not prepared
    for number, raw in enumerate(frames):
        count += 1
        if reference is None or number > skip or (pairs == "consecutive" and number == skip):
            frame = session.prepare(raw, f"frame {number}")
            if reference is not None and number > skip:
                first = 0 if pairs == "first" else number - 1
                result = session.measure_pair(reference, frame, (first, number))
                time, unit = _time_of(number if pairs == "first" else first, stamps, session.settings)
                yield session.field(result, [time], unit)
            if reference is None or pairs == "consecutive":
                reference = frame
    if count < 2:
        raise InputError(f"frames: {count} given; a motion needs at least two")


def join_fields(fields: Sequence[xr.Dataset]) -> xr.Dataset:
    """Join fields of one recording along time; what the attributes say of all of them is kept.

    Raises
    ------
    InputError
        If there is none.
    """
    if not fields:
        raise InputError("fields: none given; at least one is needed")
    joined = xr.concat(fields, "time", data_vars="minimal", coords="minimal", compat="override", join="override", combine_attrs="override")
    digest = hashlib.sha256("".join(field.attrs["input_digest"] for field in fields).encode())
    notes = dict.fromkeys(note for field in fields for note in field.attrs["notes"].splitlines())
    return joined.assign_attrs(input_digest=digest.hexdigest()[:16] if len(fields) > 1 else fields[0].attrs["input_digest"], notes="\n".join(notes))


@dataclasses.dataclass(frozen=True)
class _PairResult:
    six: NDArray[Any]
    covariance: NDArray[Any]
    residual: NDArray[Any]
    noise: NDArray[Any]
    flag: NDArray[np.uint8]
    numbers: tuple[int, int]
    digest: str
    notes: tuple[str, ...]
    memory: int


@dataclasses.dataclass
class _Prepared:
    """A frame that has been checked and normalised, with what is remembered of the raw one."""

    frame: Frame
    digest: bytes
    mean: float
    spread: float
    notes: tuple[str, ...]


class _Session:
    """Settings, region of interest, grid and working memory that all pairs of a recording share."""

    def __init__(self, settings: Settings, mask: ArrayLike | None) -> None:
        self.settings = settings
        self.dtype = np.float64 if settings.float64 else np.float32
        self.mask = None if mask is None else _check_mask(mask)
        self.workspace = Workspace()
        self.shape: tuple[int, int] | None = None
        self.constant = 0.0

    def prepare(self, raw: ArrayLike, name: str) -> _Prepared:
        """Check and normalise one frame."""
        array = check_frame(raw, name)
        if self.shape is None:
            self._begin(array, name)
        if array.shape != self.shape:
            raise InputError(f"{name} has shape {array.shape}, the first frame {self.shape}: all frames must have one shape; crop or resample them")
        image, valid, missing = to_image(array, self.constant, self.dtype)
        if missing == array.size:
            raise InputError(f"{name} has no finite pixel: all {array.size} are NaN or infinite; check how it was read")
        kept = image[valid.astype(bool)] if valid.size else image
        if kept.max() == kept.min():
            raise InputError(f"{name} is constant ({array.flat[0]}): there is no texture to follow; check the frame or its exposure")
        notes = (f"{name}: {missing} pixels without a value (NaN or infinite) are masked",) if missing else ()
        sample = kept[::4, ::4] if kept.ndim == 2 else kept
        digest = hashlib.sha256(np.ascontiguousarray(array).data).digest()
        mean, spread = float(sample.mean()), float(sample.std())
        if self.settings.lighting == "local":
            image = flatten_lighting(image, valid, self.settings.sigma)
        return _Prepared(Frame(image, valid), digest, mean, spread, notes)

    def _begin(self, first: NDArray[Any], name: str) -> None:
        """Take shape, grid and the grey constant from the first frame."""
        height, width = first.shape
        if min(height, width) < self.settings.window:
            raise InputError(
                f"{name} has shape {first.shape}: smaller than window={self.settings.window:g}; take a smaller window or larger frames"
            )
        if self.mask is not None and self.mask.shape != first.shape:
            raise InputError(f"mask has shape {self.mask.shape}, the frames {first.shape}: the mask must have the frames' shape")
        self.shape = (height, width)
        self.grid = Grid.over(self.shape, self.settings.step)
        sample = first[::4, ::4].astype(np.float64)
        finite = sample[np.isfinite(sample)]
        self.constant = float(finite.mean()) if finite.size else 0.0

    def measure_pair(self, reference: _Prepared, moved: _Prepared, numbers: tuple[int, int]) -> _PairResult:
        """Measure one pair: search, refine, judge."""
        settings, grid = self.settings, self.grid
        region = reference.frame
        if self.mask is not None:
            region = reference.frame.within(both_valid(self.mask, reference.frame.valid))
            if not region.valid.any():
                raise InputError("mask is True only where frame 0 has no value (NaN or infinite): nothing is left to measure")
        start = search(region, moved.frame, grid, settings, self.workspace)
        passes = Passes(region, moved.frame, grid, settings, self.workspace)
        maps, quality, left = refine(passes, start)
        flag = flag_points(maps, quality, left, grid, region, settings)
        failed = (flag & FAILING).astype(bool)
        six = np.stack([maps[0], maps[1], maps[2] + maps[5], maps[4] - maps[3], maps[2] - maps[5], maps[3] + maps[4]], axis=-1)
        result = [six, quality.covariance, quality.residual, quality.noise]
        for k, values in enumerate(result):
            result[k] = values.astype(self.dtype, copy=False)
            result[k][failed] = np.nan
        digest = hashlib.sha256(reference.digest + moved.digest + (self.mask.tobytes() if self.mask is not None else b""))
        memory = self.workspace.nbytes + reference.frame.nbytes + moved.frame.nbytes + sum(r.nbytes for r in result)
        notes = (*reference.notes, *moved.notes, *_lighting_notes(reference, moved, numbers, settings))
        return _PairResult(*result, flag, numbers, digest.hexdigest()[:16], notes, memory)

    def field(self, result: _PairResult, time: Sequence[float], unit: str) -> xr.Dataset:
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
        return build_field(
            six=result.six[None],
            covariance=result.covariance[None],
            residual=result.residual[None],
            noise=result.noise[None],
            flag=result.flag[None],
            x=self.grid.x,
            y=self.grid.y,
            time=np.asarray(time, dtype=np.float64),
            time_unit=unit,
            frame_numbers=[result.numbers],
            attrs=attrs,
        )


def _check_mask(mask: ArrayLike) -> NDArray[np.uint8]:
    array = np.asarray(mask)
    if array.dtype.kind not in "biu" or array.ndim != 2:
        raise InputError(f"mask has dtype {array.dtype} and shape {array.shape}: must be a (height, width) array of bool, True where to measure")
    if not array.any():
        raise InputError("mask is False everywhere: nothing is left to measure; True marks the region of interest")
    return (array != 0).astype(np.uint8)


def _lighting_notes(reference: _Prepared, moved: _Prepared, numbers: tuple[int, int], settings: Settings) -> tuple[str, ...]:
    """Say so when the light changed between the frames and the settings do not allow for it."""
    if settings.lighting != "none" or reference.spread == 0:
        return ()
    gain, shift = moved.spread / reference.spread, (moved.mean - reference.mean) / reference.spread
    if abs(gain - 1) < 0.1 and abs(shift) < 0.2:
        return ()
    return (
        f"frames {numbers[0]} and {numbers[1]}: the light changed (contrast × {gain:.2f}, brightness {moved.mean - reference.mean:+.3g} grey); "
        'consider lighting="gain+offset"',
    )


def _time_of(number: int, stamps: Sequence[float] | None, settings: Settings) -> tuple[float, str]:
    if stamps is not None:
        if number >= len(stamps):
            raise InputError(f"times has {len(stamps)} values, but there is a frame {number}: give one time per frame")
        return float(stamps[number]), "s"
    if settings.frame_interval is not None:
        return number * settings.frame_interval, "s"
    return float(number), "frame"
