"""One figure of a whole field: arrows, deformation, maps of the six, and maps of their standard errors."""

from __future__ import annotations

import os
import string
from typing import Any

import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from sixflow.drawing.look import FONT, INK, new_figure
from sixflow.drawing.saving import save_figure
from sixflow.field.dataset import SIX
from sixflow.plot.arrows import draw_arrows
from sixflow.plot.glyphs import draw_glyphs
from sixflow.plot.maps import draw_map
from sixflow.plot.missing import legend_handles
from sixflow.plot.view import Units, View

_WIDTH = 7.6  # inches: two columns of a journal


def plot_field(
    field: xr.Dataset,
    frame: ArrayLike | None = None,
    *,
    time: int = 0,
    y_up: bool = False,
    units: Units = "px",
    path: str | os.PathLike[str] | None = None,
    arrows: int = 28,
    glyphs: int = 16,
    exaggerate: float | None = None,
    standard_errors: bool = True,
    title: str | None = None,
) -> Figure:
    """Draw one pair of a field: arrows on the frame, deformation, the six and their standard errors.

    Parameters
    ----------
    field : Dataset
        A field as measured or read back.
    frame : array, shape (height, width) or (height, width, 3), optional
        The reference frame of the pair, any grey or RGB values.
    time : int
        Position of the pair along time.
    y_up : bool
        Let the y axis point upwards: coordinates, v, curl and shear change sign, the picture does not.
    units : {"px", "physical"}
        "physical" draws velocities and rates, on axes in units of length; the field must be calibrated.
    path : str or path, optional
        Save the figure here at 300 dpi; the suffix chooses the format: .png, .pdf, .svg.
    arrows, glyphs : int
        About this many of them along the longer side, at least 1.
    exaggerate : float, optional
        Factor of the exaggeration of the deformation, greater than 0; None chooses one and states it.
    standard_errors : bool
        Draw the standard errors beside the numbers.
    title : str, optional
        Line above the figure.

    Returns
    -------
    Figure
        A matplotlib figure that belongs to no window; its `savefig` writes it to a file.

    Raises
    ------
    InputError
        If an argument cannot be used, such as a time without a pair, a frame of another size, or physical
        units of a field without calibration.
    FieldFileError
        If the figure cannot be saved.
    """
    view = View.of(field, time=time, units=units, y_up=y_up)
    with_errors = standard_errors and "covariance" in view.pair
    figure, panels = _layout(view, 4 if with_errors else 3)
    draw_arrows(panels[0], view, frame, arrows=arrows)
    draw_glyphs(panels[1], view, frame, exaggerate=exaggerate, glyphs=glyphs)
    kinds = (False, True) if with_errors else (False,)
    for ax, (name, error) in zip(panels[2:], ((n, e) for n in SIX for e in kinds), strict=True):
        draw_map(ax, view, name, standard_error=error)
    for letter, ax in zip(string.ascii_lowercase, panels, strict=False):
        ax.label_outer()
        ax.annotate(
            letter, (0, 1), (-4, 4), "axes fraction", "offset points",
            fontsize=FONT + 1.5, fontweight="bold", color=INK, ha="right", va="bottom",
        )  # fmt: skip
    handles = legend_handles(view, crosses=True)
    if handles:
        figure.legend(
            handles=handles, loc="outside lower center", ncols=len(handles), fontsize=FONT, frameon=False,
            labelcolor=INK, handlelength=2.2, handleheight=1.1,
        )  # fmt: skip
    if title is not None:
        figure.suptitle(title, fontsize=FONT + 3, color=INK)
    if path is not None:
        save_figure(figure, path)
    return figure


def _layout(view: View, columns: int) -> tuple[Figure, list[Axes]]:
    left, right, bottom, top = view.frame_extent
    aspect = abs(bottom - top) / (right - left)
    rows = 6 * (2 if columns == 4 else 1) // columns
    # Heights at which the widths of the panels, less their labels and colour bars, are what limits them.
    upper_height = min(aspect * (_WIDTH / 2 - 0.4) + 0.5, 5.0)
    lower_height = (
        rows * min(aspect * (_WIDTH / columns - 0.68) + (0.48 if columns == 4 else 0.36), 2.4) + 0.3
    )
    figure = new_figure(_WIDTH, upper_height + lower_height + 0.2)
    grid: Any = figure.add_gridspec(2, 1, height_ratios=[upper_height, lower_height])
    upper, lower = grid[0].subgridspec(1, 2), grid[1].subgridspec(rows, columns)
    panels: list[Axes] = [figure.add_subplot(upper[0, k]) for k in range(2)]
    panels += [figure.add_subplot(lower[k // columns, k % columns]) for k in range(rows * columns)]
    return figure, panels
