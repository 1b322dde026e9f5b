"""Measure: from frames to a field.

    frames → normalise → search → refine (→ sharpen) → validate → field

`measure` does it for a pair, `measure_sequence` for a recording; `iterate_sequence` hands out one field
per pair, for recordings that are written as they are measured.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Literal, Unpack, get_args

import xarray as xr
from numpy.typing import ArrayLike

from sixflow.errors import InputError
from sixflow.field import accessor as _accessor  # noqa: F401 - registers Dataset.sixflow
from sixflow.field.provenance import joined_attrs, said_of_pairs
from sixflow.floor import Floor
from sixflow.masks import MaskLike, Masks
from sixflow.pair import PairResult, Prepared
from sixflow.search.guess import without_guess
from sixflow.sequence import Update, check_update, follow
from sixflow.session import Session
from sixflow.settings import Settings, SettingsOptions

Pairs = Literal["consecutive", "first", "incremental"]


def measure(
    frame0: ArrayLike,
    frame1: ArrayLike,
    *,
    mask: MaskLike | None = None,
    settings: Settings | None = None,
    **options: Unpack[SettingsOptions],
) -> xr.Dataset:
    """Measure the six-parameter flow field from frame 0 to frame 1, and its covariance.

    Parameters
    ----------
    frame0, frame1 : array_like, shape (height, width)
        Grey values: integers or floats of any range. frame0 is the reference: frame1(x + u) =
        frame0(x). Pixels that are NaN or infinite are masked.
    mask : array_like of bool or int, shape (height, width) or (2, height, width), or path, optional
        Region of interest of frame 0: True where to measure. Parts that a gap separates are measured apart. Whole
        numbers name the bodies: 0 is not measured, those of different numbers are measured apart and may touch.
        With one mask for each frame a pixel counts only where both allow it, at x and at x + u. The path of a file of a
        mask is read with `read_mask`; use that itself for numbers of bodies. Rectangles and polygons are settings:
        `roi`, `polygons`, `holes`.
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
        smaller than the window, without contrast; a mask of another shape or without True.

    Notes
    -----
    Least squares of the residual and the gradients of the mean frame under a Gaussian window, solved
    for all six numbers at every grid point and iterated on a dense blend of the field (Eagleson's
    generators, eq. (3), as the window's affine model; the normal equations are derived in
    `sixflow.passes`).

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
    chosen, guess = without_guess(settings or Settings(), options)
    session = Session(chosen, masks=masks, guess=guess)
    frames = [
        session.prepare(frame, f"frame{k}", masks.at(k), lasting=True)
        for k, frame in enumerate((frame0, frame1))
    ]
    return session.field(session.measure_pair(frames[0], frames[1], (0, 1)), [0.0], "frame")


def measure_sequence(
    frames: Iterable[ArrayLike],
    *,
    pairs: Pairs = "consecutive",
    update: Update = None,
    mask: MaskLike | None = None,
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
    pairs : {"consecutive", "first", "incremental"}
        Each frame against the next; the motion from the first frame to each later one, measured directly, each
        starting from the result before; or the same, joined from the motions between successive frames.
    update : int, "lost" or None
        With pairs="first": renew the frame that is compared with, every so many frames, or when correlation is lost
        (less than `sequence.LOST` of the points that it had are valid), and join what is measured from it to the
        motion that led there. The covariance is accumulated; points that are lost stay lost.
    mask : array_like of bool or int, path, iterable or callable, optional
        As for `measure`: one, of the reference frames (with pairs other than "consecutive", of the first frame), or
        one for each frame: an array (n, height, width), an iterable, or a function of the frame's number.
    times : sequence of float, optional
        Time of each frame, s. If not given, those of a `FrameSource`, or multiples of `frame_interval`,
        or frame numbers.
    settings, **options
        As for `measure`.
    progress : callable, optional
        Called with the number of pairs done, after each.

    Returns
    -------
    xarray.Dataset
        As from `measure`, one time per pair: the time at which its points lie (of its moved frame if pairs is not
        "consecutive"). Where motions are joined, also `moved_covariance`, the part of the covariance that is from
        the moved frame's noise, and `measured_from`, the frame that the moved one was compared with.

    Raises
    ------
    InputError
        As `measure`, and if there are fewer than two frames, or they differ in shape, or `update` does not go with
        `pairs` and `reference`.

    Examples
    --------
    >>> from sixflow import synth
    >>> made = synth.sequence(synth.Speckle(), synth.Affine.translation(0.5, 0), (64, 64), 3)
    >>> measure_sequence(made.frames, pairs="first").u.mean(("y", "x")).round(2).values
    array([0.5, 1. ], dtype=float32)
    """
    fields = []
    source = iterate_sequence(
        frames, pairs=pairs, update=update, mask=mask, times=times, settings=settings, **options
    )
    for done, field in enumerate(source, start=1):
        fields.append(field)
        if progress is not None:
            progress(done)
    return join_fields(fields)


def iterate_sequence(
    frames: Iterable[ArrayLike],
    *,
    pairs: Pairs = "consecutive",
    update: Update = None,
    mask: MaskLike | None = None,
    times: Sequence[float] | None = None,
    settings: Settings | None = None,
    skip: int = 0,
    done: xr.Dataset | None = None,
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

    Yields
    ------
    xarray.Dataset
        With one time.
    """
    if pairs not in get_args(Pairs):
        raise InputError(f"pairs={pairs!r}: must be one of {', '.join(map(repr, get_args(Pairs)))}")
    masks = Masks(mask)
    with contextlib.suppress(TypeError):  # of generators the number is not known
        masks.require(len(frames))  # type: ignore[arg-type]
    chosen, guess = without_guess(settings or Settings(), options)
    renewal = check_update(update, pairs, chosen.reference)
    session = Session(chosen, masks=masks, guess=guess, floor=Floor.of(frames))
    stamps = getattr(frames, "times", None) if times is None else times
    if pairs == "consecutive":
        results = _consecutive(session, frames, masks, skip)
    else:
        results = follow(session, frames, masks, renewal, skip, done)
    count = 0
    for number, result in enumerate(results):
        count += 1
        if result is not None:
            time, unit, meaning = _time_of(number, pairs, stamps, chosen)
            yield session.field(result, [time], unit, meaning)
    if count < 2:
        raise InputError(f"frames: {count} given; a motion needs at least two")


def _consecutive(
    session: Session, frames: Iterable[ArrayLike], masks: Masks, skip: int
) -> Iterator[PairResult | None]:
    """Yield, for each frame, the motion from the one before; None for frame 0 and what is left out."""
    before: Prepared | None = None
    # a frame that is in no wanted pair is read but not prepared; the first one gives the grey constant
    for number, raw in enumerate(frames):
        result = None
        bodies = masks.at(number)
        if before is None or number >= skip:
            frame = session.prepare(raw, f"frame {number}", bodies)
            if before is not None and number > skip:
                result = session.measure_pair(before, frame, (number - 1, number))
            before = frame
        yield result


def join_fields(fields: Sequence[xr.Dataset]) -> xr.Dataset:
    """Join fields of one recording along time; what the attributes say of all of them is kept.

    Raises
    ------
    InputError
        If there is none.
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
    return joined.assign_attrs(joined_attrs([said_of_pairs(field.attrs) for field in fields]))


def _time_of(
    number: int, pairs: Pairs, stamps: Sequence[float] | None, settings: Settings
) -> tuple[float, str, str]:
    """Time of a pair whose moved frame has a number, its unit, and what it is the time of."""
    if pairs != "consecutive":
        return *_stamp(number, stamps, settings), "time of the moved frame"
    before, unit = _stamp(number - 1, stamps, settings)
    if settings.reference == "first":
        return before, unit, "time of the reference frame"
    after, _ = _stamp(number, stamps, settings)
    if settings.reference == "second":
        return after, unit, "time of the second frame, in which the points lie"
    return (before + after) / 2, unit, "time of the middle between the frames, in which the points lie"


def _stamp(number: int, stamps: Sequence[float] | None, settings: Settings) -> tuple[float, str]:
    if stamps is not None:
        if number >= len(stamps):
            raise InputError(
                f"times has {len(stamps)} values, but there is a frame {number}: give one time per frame"
            )
        return float(stamps[number]), "s"
    if settings.frame_interval is not None:
        return number * settings.frame_interval, "s"
    return float(number), "frame"
