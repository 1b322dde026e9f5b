"""`sixflow info`: what is in a file of frames, or in a field."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import cyclopts

from sixflow.cli.selection_flags import SelectionFlags

if TYPE_CHECKING:
    import xarray as xr

    from sixflow.frames import FrameSource

SUMMARISED_BYTES = 2**30
"""Longer recordings are summarised by their first pairs."""


def info(
    file: Annotated[str, cyclopts.Parameter(name="FILE")],
    /,
    *,
    selection: Annotated[SelectionFlags | None, cyclopts.Parameter(name="*")] = None,
) -> None:
    """Tell what is in a file of frames (a folder, a pattern, a video), or in a field.

    Parameters
    ----------
    file
        Frames as for `sixflow measure`, or a field: .nc or .zarr.
    """
    if selection is None and _is_field(Path(file).expanduser()):
        from sixflow.write import open_field

        with open_field(file) as field:
            print(describe_field(field, file))
    else:
        from sixflow.frames import open_frames

        print(describe_frames(open_frames(file, **(selection or {}))))


def _is_field(path: Path) -> bool:
    """Tell a field from frames: both may be netCDF files or Zarr stores."""
    from sixflow.frames.opening import holds_frames
    from sixflow.write.target import SUFFIXES, is_zarr

    return (path.suffix.lower() in SUFFIXES or is_zarr(path)) and not holds_frames(path)


def describe_frames(source: FrameSource) -> str:
    """Return number, size, type, grey values, times and notes of frames, as lines of text."""
    import numpy as np

    first = next(iter(source))
    finite = first[np.isfinite(first)]
    lines = [source.description]
    if finite.size:
        lines.append(
            f"grey        {finite.min():g} to {finite.max():g} in the first frame, mean {finite.mean():.4g}"
        )
    names = source.names
    if names and not names[0].startswith("frame "):
        lines.append(f"names       {names[0]}" + (f" to {names[-1]}" if len(names) > 1 else ""))
    times = source.times
    if times is None:
        lines.append("times       not recorded; give --frame-interval for rates per second")
    else:
        intervals = np.diff(times)
        text = f"{times[0]:.6g} s to {times[-1]:.6g} s"
        if intervals.size:
            even = np.ptp(intervals) <= 1e-3 * intervals.mean()
            text += f", {'every' if even else 'uneven, on average every'} {intervals.mean():.6g} s"
        lines.append(f"times       {text}")
    lines += [f"{label:11} {text}" for label, text in _stated(source)]
    lines += [f"note        {note}" for note in source.notes]
    return "\n".join(lines)


def _stated(source: FrameSource) -> list[tuple[str, str]]:
    """Pixel size and frame interval that the recording states."""
    stated, found = source.metadata, []
    if stated.pixel_size is not None:
        found.append(("pixel size", f"{stated.pixel_size:.6g} {stated.length_unit}"))
    if stated.frame_interval is not None:
        found.append(("interval", f"{stated.frame_interval:.6g} s"))
    return found


def describe_field(field: xr.Dataset, name: str) -> str:
    """Return pairs, times, summary, settings, version, digest and notes of a field, as lines of text."""
    import sixflow.field.accessor  # noqa: F401 - registers Dataset.sixflow
    from sixflow.field.selection import require_field

    field = require_field(field, name)
    pairs = field.sizes.get("time", 1)
    part = field
    if field.nbytes > SUMMARISED_BYTES and pairs > 1:
        part = field.isel(time=slice(max(1, SUMMARISED_BYTES * pairs // field.nbytes)))
    lines = [f"{name}: {_pairs_and_frames(field)}"]
    if part is not field:
        lines.append(f"a long recording: the summary is of its first {part.sizes['time']} pairs")
    lines += ["", part.sixflow.summary(), "", "provenance"]
    labels = {"sixflow_version": "version", "input_digest": "digest", "attenuation_period_10": "resolution"}
    for attribute, label in labels.items():
        if attribute in field.attrs:
            value = field.attrs[attribute]
            if label == "resolution":
                value = f"a sine of period {_number(value)} px is attenuated by 10 %{_range(field)}"
            lines.append(f"{label:14} {value}")
    if "attenuation_period_10" not in field.attrs and "resolution" in field:
        low, high = (f"{float(end):.3g}" for end in (part["resolution"].min(), part["resolution"].max()))
        lines.append(f"{'resolution':14} sines of periods from {low} to {high} px are attenuated by 10 %")
    lines += [f"{'note':14} {note}" for note in str(field.attrs.get("notes", "")).splitlines()]
    return "\n".join(lines)


def _range(field: xr.Dataset) -> str:
    """What the resolution of the points ranges over, where it is not the same for all."""
    if "resolution" not in field:
        return ""
    low, high = float(field["resolution"].min()), float(field["resolution"].max())
    return f" (median; {low:.3g} to {high:.3g} px)" if high > low * 1.001 else ""


def _number(value: object, digits: int = 3) -> str:
    """A number in few digits; anything else as it is."""
    return f"{value:.{digits}g}" if isinstance(value, int | float) else str(value)


def _pairs_and_frames(field: xr.Dataset) -> str:
    from sixflow.field.selection import frame_shape

    pairs = field.sizes.get("time", 1)
    text = f"a field of {pairs} pair{'s' * (pairs != 1)}"
    if "frame_shape" in field.attrs:
        height, width = frame_shape(field)
        text += f" of frames of {width}×{height} px"
    if "time" in field.coords:
        times, unit = field["time"].values.reshape(-1), field["time"].attrs.get("units", "")
        first, last = (_number(times[k].item(), 6) for k in (0, -1)) if times.size else ("", "")
        text += f", time {first} to {last} {unit}" if times.size > 1 else ""
    return f"{text}, {_intervals(field)}"


def _intervals(field: xr.Dataset) -> str:
    """The time between the two frames of the pairs, in words."""
    import numpy as np

    from sixflow.errors import InputError
    from sixflow.field.interval import elapsed

    try:
        known = elapsed(field)
    except InputError:
        return "times between frames lost"
    values = np.atleast_1d(known.values.values)
    finite = values[np.isfinite(values)]
    if not finite.size:
        return "times between frames unknown"
    low, high = finite.min(), finite.max()
    several = known.unit == "frame" and bool(high > 1)
    text = f"{low:.6g}" if high - low <= 1e-6 * high else f"{low:.6g} to {high:.6g}"
    text += f" {known.unit}{'s' * several} between the two frames of a pair"
    return text + f" (unknown in {values.size - finite.size})" * bool(finite.size < values.size)
