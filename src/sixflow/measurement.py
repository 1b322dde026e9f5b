"""Measure: from frames to a field.

    frames → normalise → search → refine (→ sharpen) → validate → field

`measure` does it for a pair, `measure_sequence` for a recording; `iterate_sequence` hands out one field
per pair, for recordings that are written as they are measured.
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from typing import Any, Unpack

import xarray as xr
from numpy.typing import ArrayLike

from sixflow.engine.threads import each_in, limited
from sixflow.errors import InputError
from sixflow.field import accessor as _accessor  # noqa: F401 - registers Dataset.sixflow
from sixflow.field.provenance import join_attrs, said_of_pairs
from sixflow.frames import open_frames
from sixflow.frames.digests import FrameDigests
from sixflow.frames.floor import Floor
from sixflow.frames.times import FrameTimes, Pairs, Times
from sixflow.masks import MaskLike, Masks
from sixflow.pair.session import Session
from sixflow.prepare.pattern import FixedPattern
from sixflow.recording.consecutive import consecutive
from sixflow.recording.schedule import Recording, Schedule
from sixflow.recording.sequence import Update, check_update, follow
from sixflow.search.guess import Guess, without_guess
from sixflow.settings import Settings, SettingsOptions, require_names, require_settings


def measure(
    frame0: ArrayLike,
    frame1: ArrayLike,
    *,
    mask: MaskLike | None = None,
    threads: int | None = None,
    settings: Settings | None = None,
    **options: Unpack[SettingsOptions],
) -> xr.Dataset:
    """Measure the six-parameter flow field from frame 0 to frame 1, and its covariance.

    Parameters
    ----------
    frame0, frame1 : array_like, shape (height, width), or path
        Grey values: integers or floats of any range, or a file of one frame. frame0 is the reference: frame1(x + u) =
        frame0(x). Pixels that are NaN or infinite are masked. Two frames that are the same to the last bit are a copy,
        and flagged `repeated`.
    mask : array_like of bool or int, shape (height, width) or (2, height, width), or path, optional
        Region of interest of frame 0: True where to measure. Parts that a gap separates are measured apart. Whole
        numbers name the bodies: 0 is not measured, those of different numbers are measured apart and may touch.
        With one mask for each frame a pixel counts only where both allow it, at x and at x + u. The path of a file of a
        mask is read with `read_mask`; use that itself for numbers of bodies. Rectangles and polygons are settings:
        `roi`, `polygons`, `holes`.
    threads : int, optional
        How many threads may compute, at least 1: this one and others. If not given: the environment variable
        `SIXFLOW_THREADS`, or one for each processor. The result is the same, to the last bit.
    settings : Settings, optional
        How to measure; the defaults if not given.
    **options
        Single settings by name, such as `window=41`; they go over `settings`. See `Settings` for
        meaning and ranges.

    Returns
    -------
    xarray.Dataset
        u, v [px], divergence, curl, stretch, shear [1], their covariance, residual, noise and flag on a
        grid of whole pixels, dims (time, y, x) with one time. Failed points are NaN. More through its
        accessor, `field.sixflow`.

    Raises
    ------
    InputError
        If a frame, the mask or a setting cannot be used: not two-dimensional real frames of one shape,
        smaller than the window, without contrast; a mask of another shape or without True; a number of threads below 1.

    Notes
    -----
    Least squares of the residual and the gradients of the mean frame under a Gaussian window, solved
    for all six numbers at every grid point and iterated on a dense blend of the field (Eagleson's
    generators, eq. (3), as the window's affine model; the normal equations are derived in
    `sixflow.refine.passes`).

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
    masks = Masks(mask)
    masks.require(2)
    chosen, guess = without_guess(require_settings(settings), options)
    return limited(threads).run(_measure_pair, frame0, frame1, masks, chosen, guess)


def _measure_pair(
    frame0: Any, frame1: Any, masks: Masks, chosen: Settings, guess: Guess | None
) -> xr.Dataset:
    files = _files(frame0, frame1, chosen)
    chosen = chosen if files is None else files.settings
    if chosen.fixed_pattern:
        raise InputError(
            "fixed_pattern=True: two frames do not tell what all have in common; use measure_sequence"
        )
    floor = Floor() if files is None else Floor.of(files.source)
    session = Session(chosen, masks=masks, guess=guess, floor=floor)
    given = (frame0, frame1) if files is None else tuple(files.source)
    frames = [session.prepare(frame, f"frame{k}", masks.at(k), lasting=True) for k, frame in enumerate(given)]
    result = session.measure_pair(frames[0], frames[1], (0, 1))
    if files is None:
        times = FrameTimes(None, chosen.frame_interval)
        return session.field(result, times.of_pair((0, 1), (0, 1), "consecutive", chosen.reference))
    result = dataclasses.replace(result, notes=(*files.news(), *result.notes))
    return session.field(result, files.times_of((0, 1)), files.names_of((0, 1)), source=files.source.origin)


def measure_sequence(
    frames: Iterable[ArrayLike],
    *,
    pairs: Pairs = "consecutive",
    lag: int = 1,
    update: Update = None,
    mask: MaskLike | None = None,
    times: Times | None = None,
    strict: bool = False,
    threads: int | None = None,
    settings: Settings | None = None,
    progress: Callable[[int], None] | None = None,
    **options: Unpack[SettingsOptions],
) -> xr.Dataset:
    """Measure every pair of a recording.

    Parameters
    ----------
    frames : iterable of array_like, shape (height, width), or array, shape (n, height, width)
        Whatever `open_frames` takes: a generator, a list, an array, a path, or a `FrameSource`. Frames are taken one
        at a time.
    pairs : {"consecutive", "double", "first", "incremental"}
        Each frame against the next; frame 0 against 1, 2 against 3 …, as double-frame cameras record; the motion from
        the first frame to each later one, measured directly, each starting from the result before; or the same, joined
        from the motions between successive frames.
    lag : int
        With pairs="consecutive": each frame against the one so many frames later, at least 1.
    update : int, "lost" or None
        With pairs="first": renew the frame that is compared with, every so many frames, or when correlation is lost
        (less than `sequence.LOST` of the points that it had are valid), and join what is measured from it to the
        motion that led there. The covariance is accumulated; points that are lost stay lost.
    mask : array_like of bool or int, path, iterable or callable, optional
        As for `measure`: one, of the reference frames (with pairs other than "consecutive", of the first frame), or
        one for each frame: an array (n, height, width), an iterable, or a function of the frame's number.
    times : sequence, optional
        Time of each frame: seconds, dates (datetime64 or datetime) or durations (timedelta64 or timedelta). They have
        to grow, and count as they are. If not given: multiples of `frame_interval`; the time stamps of a `FrameSource`;
        the frame interval that it states; or frame numbers, with rates per frame.
    strict : bool
        Raise at the first frame that cannot be used. Otherwise the pairs of such a frame (constant, without a value, of
        another shape, not to be decoded) are NaN and flagged `bad_frame`, and a pair of two equal frames `repeated`;
        notes tell which and why, and the recording goes on.
    threads, settings, **options
        As for `measure`. `pixel_size`, `length_unit` and `frame_interval` are those of the recording's metadata where
        they are not given.
    progress : callable, optional
        Called with the number of pairs done, after each.

    Returns
    -------
    xarray.Dataset
        As from `measure`, one time per pair: the time at which its points lie (of its moved frame if pairs is "first"
        or "incremental"). `time0` and `time1` are the times of its frames, `interval` what passed between them, which
        rates are divided by; NaN where frames may be missing. Where motions are joined, also `moved_covariance`, the
        part of the covariance that is from the moved frame's noise, and `measured_from`, the frame that the moved one
        was compared with.

    Raises
    ------
    InputError
        As `measure`, and if there are fewer than two frames; if times do not grow, are not one per frame, or contradict
        `frame_interval`; if `update` or `lag` does not go with `pairs` and `reference`; if no frame can be used, or not
        the one that all motions start from.

    Examples
    --------
    >>> from sixflow import synth
    >>> made = synth.sequence(synth.Speckle(), synth.Affine.translation(0.5, 0), (64, 64), 3)
    >>> measure_sequence(made.frames, pairs="first").u.mean(("y", "x")).round(2).values
    array([0.5, 1. ], dtype=float32)
    """
    require_names(options)  # what only iterate_sequence knows is no option here
    fields = []
    measured = _measured(
        frames,
        Schedule(pairs, lag),
        update,
        mask=mask,
        times=times,
        settings=settings,
        strict=strict,
        options=options,
    )
    context, left_over = limited(threads), ()
    while True:
        try:
            fields.append(context.run(next, measured))
        except StopIteration as end:
            left_over = end.value
            break
        if progress is not None:
            progress(len(fields))
    joined = join_fields(fields)
    notes = "\n".join([*joined.attrs["notes"].splitlines(), *left_over])
    return joined.assign_attrs(notes=notes)


def iterate_sequence(
    frames: Iterable[ArrayLike],
    *,
    pairs: Pairs = "consecutive",
    lag: int = 1,
    update: Update = None,
    mask: MaskLike | None = None,
    times: Times | None = None,
    strict: bool = False,
    threads: int | None = None,
    settings: Settings | None = None,
    skip: int = 0,
    done: xr.Dataset | None = None,
    seen: FrameDigests | None = None,
    **options: Unpack[SettingsOptions],
) -> Iterator[xr.Dataset]:
    """Yield the field of each pair of a recording as soon as it is measured; arguments as for
    `measure_sequence`.

    Parameters
    ----------
    skip : int
        Leave out so many pairs, for going on with an interrupted recording.
    done : Dataset, optional
        The pairs that are left out. If pairs is not "consecutive", every result depends on those before: with `done`
        the rest is measured from them, without it they are measured again; the numbers are the same.
    seen : FrameDigests, optional
        Digests of the frames that were measured before, as `RecordingWriter.frames`: frames that have changed since are
        refused, and those of the others are added.

    Yields
    ------
    xarray.Dataset
        With one time.
    """
    measured = _measured(
        frames,
        Schedule(pairs, lag),
        update,
        mask=mask,
        times=times,
        settings=settings,
        strict=strict,
        skip=skip,
        done=done,
        seen=seen,
        options=options,
    )
    yield from each_in(limited(threads), measured)


def _measured(
    frames: Any,
    schedule: Schedule,
    update: Update,
    *,
    mask: MaskLike | None,
    times: Times | None,
    settings: Settings | None,
    strict: bool,
    options: SettingsOptions,
    skip: int = 0,
    done: xr.Dataset | None = None,
    seen: FrameDigests | None = None,
) -> Generator[xr.Dataset, None, tuple[str, ...]]:
    """Yield the field of each pair; what remains to be said in the end is returned."""
    masks = Masks(mask)
    asked, guess = without_guess(require_settings(settings), options)
    renewal = check_update(update, schedule.pairs, asked.reference)
    if not isinstance(strict, bool):
        raise InputError(f"strict={strict!r}: must be True or False")
    recording = Recording(open_frames(frames), schedule, times, asked, digests=seen)
    if recording.source.count is not None:
        masks.require(recording.source.count)
    session = Session(
        recording.settings,
        masks=masks,
        guess=guess,
        strict=strict,
        floor=Floor.of(recording.source),
    )
    notes: tuple[str, ...] = ()
    if recording.settings.fixed_pattern:
        session.pattern, notes = _pattern(recording)
    if schedule.pairs in ("first", "incremental"):
        results = follow(session, recording, masks, renewal, skip, done)
    else:
        results = consecutive(session, recording, masks, skip)
    attrs = (
        schedule.attrs | ({} if update is None else {"update": update}) | {"source": recording.source.origin}
    )
    for places, result in results:
        result = dataclasses.replace(result, notes=(*notes, *recording.news(), *result.notes))
        notes = ()
        yield session.field(result, recording.times_of(places), recording.names_of(places), **attrs)
    recording.check_count()
    return recording.left_over()


def _pattern(recording: Recording) -> tuple[FixedPattern, tuple[str, ...]]:
    """What all frames of a recording have in common, and a note on it."""
    source = recording.source
    if source.count is None:
        raise InputError(
            "fixed_pattern=True: the frames have to be read twice; give a list, an array or files"
        )
    pattern = FixedPattern.of(source.attempt(), source.count, source.shape)
    said = f"of {pattern.size:.2g} grey was taken out" if pattern.size else "was not found"
    return pattern, (f"a fixed pattern {said}: what all frames have in common at the same pixels",)


def _files(frame0: Any, frame1: Any, settings: Settings) -> Recording | None:
    """The recording of two files of one frame each, where a pair is given by paths."""
    are_paths = [isinstance(frame, str | os.PathLike) for frame in (frame0, frame1)]
    if not any(are_paths):
        return None
    if not all(are_paths):
        raise InputError("frame0 and frame1: a path and an array; give two paths, or open_frames(path)[0]")
    source = open_frames([frame0, frame1])
    if source.count != 2:
        raise InputError(
            f"frame0={str(frame0)!r}, frame1={str(frame1)!r}: hold {source.count} frames; a pair is two files of one "
            "each, and measure_sequence(open_frames(…)) measures a recording"
        )
    return Recording(source, Schedule("consecutive"), None, settings)


def join_fields(fields: Sequence[xr.Dataset]) -> xr.Dataset:
    """Join fields of one recording along time; what the attributes say of all of them is kept.

    Raises InputError if there is none.
    """
    if not fields:
        raise InputError("fields: none given; at least one is needed")
    joined = xr.concat(
        fields,
        "time",
        data_vars="minimal",
        coords="minimal",
        compat="override",
        join="override",
        combine_attrs="override",
    )
    joined.attrs = join_attrs(fields[0].attrs, [said_of_pairs(field.attrs) for field in fields])
    return joined
