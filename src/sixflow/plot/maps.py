"""Maps: one number per point as colour."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.image import AxesImage

from sixflow.drawing.look import (
    ERROR_MAP,
    SIGNED_MAP,
    add_colour_bar,
    colour_map,
    error_limit,
    power_of_ten,
    require_axes,
    signed_limit,
    with_power,
)
from sixflow.errors import InputError
from sixflow.plot.missing import dot_unresolved, fill_missing
from sixflow.plot.view import Units, View, cell_edges


def plot_map(
    field: xr.Dataset,
    name: str,
    ax: Axes,
    *,
    standard_error: bool = False,
    time: int = 0,
    y_up: bool = False,
    units: Units = "px",
    limit: float | None = None,
) -> AxesImage:
    """Draw one number of the field as a map with a colour bar.

    A signed number has a diverging scale with symmetric limits, white at 0; any other has a sequential scale
    from 0. Masked points are hatched grey, failed ones hatched ochre; those whose motion is finer than their window
    resolves are dotted. Standard errors are those of noise and bias together.

    Parameters
    ----------
    field : Dataset
        A field as measured or read back.
    name : str
        One of the six (u, v, divergence, curl, stretch, shear), "residual", "noise", or a scalar of the
        accessor such as "vorticity",
        "rotation_angle", "area_ratio".
    ax : Axes
        Where to draw.
    standard_error : bool
        Draw its standard error instead of the number.
    time : int
        Position of the pair along time.
    y_up : bool
        Let the y axis point upwards: coordinates, v, curl and shear change sign, the picture does not.
    units : {"px", "physical"}
        "physical" draws velocities and rates, on axes in units of length; the field must be calibrated.
    limit : float or None
        The scale ends here (and at −limit); None chooses it so that about 1 % of the points lie beyond.

    Raises
    ------
    InputError
        If an argument cannot be used, or the field has no such number.

    Examples
    --------
    >>> from matplotlib.figure import Figure
    >>> six = ("u", "v", "divergence", "curl", "stretch", "shear")
    >>> grid = {"y": range(8, 40, 8), "x": range(8, 48, 8)}
    >>> field = xr.Dataset({name: (("y", "x"), np.full((4, 5), 0.1)) for name in six}, grid)
    >>> ax = Figure(layout="constrained").add_subplot()
    >>> image = plot_map(field, "curl", ax, limit=0.2)
    >>> ax.get_title(loc="left"), image.get_clim()
    ('curl (px/px)', (-0.2, 0.2))
    """
    if limit is not None and not (np.isfinite(limit) and limit > 0):
        raise InputError(f"limit={limit!r}: must be a positive number, or None to choose it from the field")
    view = View.of(field, time=time, units=units, y_up=y_up)
    return draw_map(require_axes(ax), view, name, standard_error=standard_error, limit=limit)


def draw_map(
    ax: Axes, view: View, name: str, *, standard_error: bool = False, limit: float | None = None
) -> AxesImage:
    """Draw a map of a view; see `plot_map`."""
    quantity = view.quantity(name)
    label, signed = quantity.label, quantity.signed
    values = quantity.values
    if standard_error:
        if quantity.error is None:
            raise InputError(f"name={name!r} has no standard error in this field; draw the number itself")
        label, signed, values = f"standard error of\n{label}", False, quantity.error
    values = np.where(view.missing[0] | view.missing[1], np.nan, values)
    if limit is None:
        limit = signed_limit(values, quantity.error) if signed else error_limit(values)
    power = power_of_ten(limit)
    columns = cell_edges(view.pair["x"].values) * view.scale
    rows = cell_edges(view.pair["y"].values) * view.scale * view.down
    image = ax.imshow(
        values / 10.0**power,
        cmap=colour_map(SIGNED_MAP if signed else ERROR_MAP),
        vmin=-limit / 10.0**power if signed else 0,
        vmax=limit / 10.0**power,
        extent=(columns[0], columns[-1], rows[-1], rows[0]),
        origin="upper",
        interpolation="nearest",
        zorder=1,
    )
    fill_missing(ax, view)
    dot_unresolved(ax, view)
    unit = with_power(quantity.unit, power)
    view.dress(ax, f"{label} ({unit})" if unit else label)
    above = bool(np.nanmax(values, initial=-np.inf) > limit)
    below = signed and bool(np.nanmin(values, initial=np.inf) < -limit)
    add_colour_bar(
        ax, image, extend={(0, 0): "neither", (0, 1): "max", (1, 0): "min", (1, 1): "both"}[below, above]
    )
    return image
