"""`sixflow plot`: a picture of one pair of a field file."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from sixflow.cli.flags import Output, Switch, Whole
from sixflow.cli.settings_flags import CalibrationFlags
from sixflow.errors import InputError

if TYPE_CHECKING:
    import xarray as xr


def plot(
    field: Annotated[Path, Parameter(name="FIELD")],
    /,
    *,
    output: Output,
    frame: str | None = None,
    time: Whole = 0,
    y_up: Switch = False,
    units: Literal["px", "physical"] = "px",
    arrows: Whole = 28,
    glyphs: Whole = 16,
    exaggerate: float | None = None,
    standard_errors: Annotated[bool, Parameter(show_default=False)] = True,
    title: str | None = None,
    calibration: Annotated[CalibrationFlags | None, Parameter(name="*")] = None,
    overwrite: Switch = False,
) -> None:
    """Draw one pair of a field: arrows, deformation, maps of the six numbers and of their standard errors.

    Parameters
    ----------
    field
        A field file, .nc or .zarr.
    output
        The picture: .png, .pdf or .svg.
    frame
        Frames to draw on: an image, or the recording that was measured.
    time
        Position of the pair along time; negative ones count from the end.
    y_up
        Let the y axis point upwards: coordinates, v, curl and shear change sign, the picture does not.
    units
        "physical" draws velocities and rates; the field or the flags below must say the calibration.
    arrows
        About this many arrows along the longer side.
    glyphs
        About this many deformed squares along the longer side.
    exaggerate
        Factor on the deformation of the squares; chosen, and stated in the picture, if not given.
    standard_errors
        Draw the standard errors beside the numbers, or leave them out.
    title
        Line above the figure.
    overwrite
        Replace the picture if it exists.
    """
    from sixflow.cli.figures import check_figure
    from sixflow.write import open_field

    output = check_figure(output, overwrite)
    with open_field(field) as opened:
        import sixflow.field.accessor  # noqa: F401 - registers Dataset.sixflow
        from sixflow.field.selection import require_field
        from sixflow.plot import plot_field

        shown = require_field(opened, str(field))
        if calibration:
            shown = shown.sixflow.calibrate(**calibration)
        options: dict[str, Any] = {
            "arrows": arrows,
            "glyphs": glyphs,
            "exaggerate": exaggerate,
            "title": title,
        }
        background = None if frame is None else _read_frame(frame, shown, time)
        with _in_flags(units):
            plot_field(
                shown,
                background,
                time=time,
                y_up=y_up,
                units=units,
                path=output,
                standard_errors=standard_errors,
                **options,
            )
    print(output)


@contextlib.contextmanager
def _in_flags(units: str) -> Iterator[None]:
    """Add to an error of physical units which flags give the calibration."""
    try:
        yield
    except InputError as error:
        if units == "physical":
            error.add_note("the calibration can be given by --pixel-size, --length-unit and --frame-interval")
        raise


def _read_frame(path: str, field: xr.Dataset, time: int) -> Any:
    """Return the reference frame of a pair from an image, or from the recording that was measured.

    Raises InputError if the field has no such pair, or the recording no such frame.
    """
    from sixflow.field.selection import one_pair, reference_of
    from sixflow.frames import open_frames

    pair, source = one_pair(field, time), open_frames(path)
    name, part = ("frame1", "ends") if reference_of(pair) == "second" else ("frame0", "begins")
    number = int(pair[name]) if len(source) > 1 and name in pair.coords else 0
    if number >= len(source):
        raise InputError(f"--frame {path}: {len(source)} frames, but the pair {part} with frame {number}")
    return next(source.iterate(number))
