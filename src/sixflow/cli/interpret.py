"""`sixflow interpret`: time to contact, slant, heading and motion from a region of a field."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

from cyclopts import Parameter

from sixflow.cli.flags import Switch, Whole
from sixflow.cli.interpret_table import checked, print_tables, write_csv
from sixflow.errors import InputError

if TYPE_CHECKING:
    import xarray as xr
    from rich.table import Table

    from sixflow.interpretation import Estimate, Interpretation
    from sixflow.scenes import Camera, Plane

Series: TypeAlias = Annotated[str | None, Parameter(allow_leading_hyphen=True, show_default=False)]
"""Numbers in one word, separated by commas, the first of which may be negative."""


def interpret(
    field: Annotated[Path, Parameter(name="FIELD")],
    /,
    *,
    focal: float,
    centre: Series = None,
    region: Series = None,
    point: Series = None,
    time: Whole = 0,
    heading: Series = None,
    rotation: Series = None,
    of: Literal["camera", "object"] = "camera",
    distance: float | None = None,
    height: float | None = None,
    pitch: float = 90.0,
    roll: float = 0.0,
    length_unit: str = "m",
    coefficients: Literal["eight", "six"] = "eight",
    border: Switch = False,
    frame_interval: float | None = None,
    every_pair: Annotated[Switch, Parameter(name="--all")] = False,
    output: Annotated[Path | None, Parameter(name=("--output", "-o"))] = None,
    overwrite: Switch = False,
) -> None:
    """Tell time to contact, slant, heading and motion from a region of a field, with standard errors.

    Each result states its assumptions. What the field does not determine is called undetermined.

    Parameters
    ----------
    field
        A field file, .nc or .zarr.
    focal
        Focal length, px: that in mm divided by the side of a pixel in mm.
    centre
        Principal point X,Y, px; the middle of the frame if not given.
    region
        X0,Y0,X1,Y1, px: the surface that is looked at; the whole frame if not given.
    point
        Image point X,Y, px, for time to contact and slant; the middle of the region's points if not given.
    time
        Position of the pair along time; negative ones count from the end.
    heading
        Known direction of the translation X,Y,Z (right, down, forward), of any length; 0,0,1 is forward.
    rotation
        Known rotation X,Y,Z, rad/s if the frame interval is known, else rad per frame; 0,0,0 for none.
    of
        Whose motion is given: the camera's or the object's.
    distance
        Perpendicular distance of the surface from the camera, in units of length: sets the scale.
    height
        Height of the camera above level ground that the region shows, in units of length: gives the ego-motion.
    pitch
        With --height: angle by which the camera looks down, degrees; 90 is straight down, 0 to the horizon.
    roll
        With --height: angle by which it is turned about its axis, degrees, clockwise from behind.
    length_unit
        Unit of --distance and --height.
    coefficients
        Fit the flow of a plane (eight), or an affine one (six), with less noise in small regions.
    border
        Use points whose window is cut by the border of the frame or mask, too.
    frame_interval
        Time between successive frames, s, if the field does not know it.
    every_pair
        All pairs, as tables with a row for each, instead of one.
    output
        Write the table of all pairs to a .csv file, instead of printing it.
    overwrite
        Replace that file if it exists.
    """
    from sixflow.field.selection import require_field
    from sixflow.interpretation import interpret as interpret_field
    from sixflow.interpretation import interpret_all
    from sixflow.write import open_field

    known = {"heading": _numbers("heading", heading, 3), "rotation": _numbers("rotation", rotation, 3)}
    middle, limits, place = (
        _numbers(name, text, count)
        for name, text, count in (("centre", centre, 2), ("region", region, 4), ("point", point, 2))
    )
    if (every_pair or output is not None) and time != 0:
        raise InputError(f"--time {time}: goes without --all and --output, which take all pairs")
    target = None if output is None else checked(output, overwrite)
    with open_field(field) as opened:
        shown = require_field(opened, str(field))
        options: dict[str, Any] = {
            "point": place,
            "of": of,
            "plane": _ground(height, pitch, roll),
            "distance": distance,
            "length_unit": length_unit,
            "coefficients": coefficients,
            "border": border,
            "frame_interval": frame_interval,
            **known,
        }
        camera = _camera(shown, focal, middle)
        if every_pair or target is not None:
            table = interpret_all(shown, camera, limits, **options)
            if target is None:
                print_tables(table, str(field))
            else:
                write_csv(table, target, overwrite)
            return
        found = interpret_field(shown, camera, limits, time=time, **options)
    _print(field, found)


def _print(field: Path, found: tuple[Interpretation, ...]) -> None:
    """Write the results of one pair, and their assumptions."""
    from rich.console import Console

    console = Console(highlight=False)
    print(_region_line(field, found[0]))
    for one in found:
        print(f"\n{one.title}")
        console.print(_table(one))
        for statement in one.assumptions:
            console.print(f"  assumed: {statement}", soft_wrap=True, markup=False)


def _numbers(name: str, text: str | None, count: int) -> Any:
    """Numbers of a flag that are separated by commas; InputError if they are not so many finite numbers."""
    if text is None:
        return None
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = ()
    if len(values) != count or not all(math.isfinite(value) for value in values):
        raise InputError(f"--{name} {text}: must be {count} numbers, separated by commas without spaces")
    return values


def _camera(field: xr.Dataset, focal: float, centre: tuple[float, float] | None) -> Camera:
    from sixflow.field.selection import frame_shape
    from sixflow.scenes import Camera

    if centre is None:
        rows, columns = frame_shape(field)
        centre = ((columns - 1) / 2, (rows - 1) / 2)
    return Camera(focal, centre)


def _ground(height: float | None, pitch: float, roll: float) -> Plane | None:
    from sixflow.scenes import Plane

    return None if height is None else Plane.ground(height, math.radians(pitch), math.radians(roll))


def _region_line(path: Path, fit: Interpretation) -> str:
    from sixflow.interpretation import RegionFit

    assert isinstance(fit, RegionFit)
    x0, y0, x1, y1 = (f"{part:g}" for part in fit.region)
    return (
        f"{path}: region {x0},{y0} to {x1},{y1}, {fit.points} points, which stand for "
        f"{fit.independent_points:.1f} independent ones"
    )


def _table(interpretation: Interpretation) -> Table:
    from rich.table import Table

    from sixflow.interpretation.estimate import label

    table = Table(box=None, show_header=False, padding=(0, 2, 0, 0), pad_edge=False)
    table.add_column()
    table.add_column(justify="right")
    table.add_column(justify="right")
    table.add_column()
    for name, estimate in interpretation.estimates.items():
        value, error, unit = _in_degrees(estimate).written()
        table.add_row(f"  {label(name)}", value, f"± {error}" if error else "", unit)
    return table


def _in_degrees(estimate: Estimate) -> Estimate:
    """Angles in degrees; their rates stay in radians."""
    from sixflow.interpretation import Estimate

    if estimate.unit != "rad":
        return estimate
    return Estimate(math.degrees(estimate.value), math.degrees(estimate.standard_error), "°")
