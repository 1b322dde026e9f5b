"""Measure: from frames to a field.

    frames → normalise → search → refine (→ sharpen) → validate → field

`measure` does it for a pair, `measure_sequence` for a recording; `iterate_sequence` hands out one field
per pair, for recordings that are written as they are measured.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Literal, Unpack, get_args

import xarray as xr
from numpy.typing import ArrayLike

from sixflow.errors import InputError
from sixflow.field import accessor as _accessor  # noqa: F401 - registers Dataset.sixflow
from sixflow.field.provenance import joined_attrs, said_of_pairs
from sixflow.search.guess import without_guess
from sixflow.session import Prepared, Session
from sixflow.settings import Settings, SettingsOptions

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
        Grey values: integers or floats of any range. frame0 is the reference: frame1(x + u) =
        frame0(x). Pixels that are NaN or infinite are masked.
    mask : array_like of bool, shape (height, width), optional
        Region of interest of frame 0: True where to measure.
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
    chosen, guess = without_guess(settings or Settings(), options)
    session = Session(chosen, mask)
    session.guess = guess
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
        Time of each frame, s. If not given, those of a `FrameSource`, or multiples of `frame_interval`,
        or frame numbers.
    settings, **options
        As for `measure`.
    progress : callable, optional
        Called with the number of pairs done, after each.

    Returns
    -------
    xarray.Dataset
        As from `measure`, one time per pair: the time of its reference frame (of its moved frame if
        `pairs="first"`).

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
    """Yield the field of each pair of a recording as soon as it is measured; arguments as for
    `measure_sequence`.

    Parameters
    ----------
    skip : int
        Leave out so many pairs, for going on with an interrupted recording.
    """
    if pairs not in get_args(Pairs):
        raise InputError(f"pairs={pairs!r}: must be one of 'consecutive', 'first'")
    chosen, guess = without_guess(settings or Settings(), options)
    session = Session(chosen, mask)
    session.guess = guess
    stamps = getattr(frames, "times", None) if times is None else times
    reference: Prepared | None = None
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


def _time_of(number: int, stamps: Sequence[float] | None, settings: Settings) -> tuple[float, str]:
    if stamps is not None:
        if number >= len(stamps):
            raise InputError(
                f"times has {len(stamps)} values, but there is a frame {number}: give one time per frame"
            )
        return float(stamps[number]), "s"
    if settings.frame_interval is not None:
        return number * settings.frame_interval, "s"
    return float(number), "frame"
