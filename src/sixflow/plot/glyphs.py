"""Glyphs: the deformation of a circle at every point, with a mark that shows its rotation.

The motion of a point is exaggerated by k along its one-parameter group: F_k = exp(k log F). A rotation by θ
is drawn as one by kθ and stays a circle; the plain I + k G would let it grow.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from numpy.typing import ArrayLike, NDArray

from sixflow.convention import deformation_gradient, exp_six, gradient, log_six
from sixflow.drawing.look import GLYPH_EDGE, GLYPH_FACE, REFERENCE, nice_below, require_axes
from sixflow.errors import InputError
from sixflow.field.derived import derived_error, six
from sixflow.plot.arrows import draw_frame, thin
from sixflow.plot.missing import fill_missing, mark_failed
from sixflow.plot.view import Units, View

_ROUND = 48  # corners of a drawn circle


def plot_glyphs(
    field: xr.Dataset,
    ax: Axes,
    frame: ArrayLike | None = None,
    *,
    time: int = 0,
    y_up: bool = False,
    units: Units = "px",
    exaggerate: float | None = None,
    glyphs: int = 16,
) -> PolyCollection:
    """Draw at every point the image of a circle under the deformation, with a rotation mark.

    The thin circle is the undeformed one; its tick points up. The ellipse is its image, and the tick inside
    shows where the upward radius went: a tilt is a rotation. The title states the exaggeration.

    Parameters
    ----------
    field : Dataset
        A field as measured or read back.
    ax : Axes
        Where to draw.
    frame : array, shape (height, width) or (height, width, 3), optional
        The reference frame, any grey or RGB values.
    time, y_up, units
        As in `plot_map`.
    exaggerate : float, optional
        Factor k of the exaggeration, greater than 0; None chooses one that makes the deformation easily seen.
    glyphs : int
        About this many glyphs along the longer side, at least 1.

    Returns
    -------
    PolyCollection
        The ellipses.

    Raises
    ------
    InputError
        If an argument cannot be used.
    """
    view = View.of(field, time=time, units=units, y_up=y_up)
    return draw_glyphs(require_axes(ax), view, frame, exaggerate=exaggerate, glyphs=glyphs)


def draw_glyphs(
    ax: Axes, view: View, frame: ArrayLike | None, *, exaggerate: float | None = None, glyphs: int = 16
) -> PolyCollection:
    """Draw the glyphs of a view; see `plot_glyphs`."""
    if exaggerate is not None and not (np.isfinite(exaggerate) and exaggerate > 0):
        raise InputError(f"exaggerate={exaggerate!r}: must be a positive number, or None to choose it")
    draw_frame(ax, view, frame)
    fill_missing(ax, view, failed=False)
    shown, spacing = thin(view, glyphs)
    mark_failed(ax, view, shown)
    rates = log_six(six(view.pair).values, invalid="nan").astype(float)
    shown &= ~(view.missing[0] | view.missing[1]) & np.isfinite(rates).all(axis=-1)
    factor = _exaggeration(view, rates[shown]) if exaggerate is None else float(exaggerate)
    F = deformation_gradient(gradient(exp_six(factor * rates[shown])))
    rows, columns = np.nonzero(shown)
    centres = np.stack([view.x[columns], view.y[rows]], axis=-1)
    radius = 0.40 * spacing
    turn = np.linspace(0, 2 * np.pi, _ROUND, endpoint=False)
    circle = radius * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    up = radius * np.array([0.0, -view.down])
    circles = list(centres[:, None, :] + circle)
    ellipses = list(centres[:, None, :] + circle @ np.swapaxes(F, -1, -2))
    ticks = list(np.stack([centres + 0.8 * up, centres + up], axis=1))
    marks = list(np.stack([centres, centres + F @ up], axis=1))
    drawn = PolyCollection(ellipses, facecolors=GLYPH_FACE, edgecolors=GLYPH_EDGE, linewidths=0.7, zorder=4)
    for collection in (
        PolyCollection(circles, facecolors="none", edgecolors=REFERENCE, linewidths=0.45, zorder=3),
        LineCollection(ticks, colors=REFERENCE, linewidths=0.6, zorder=3),
        drawn,
        LineCollection(marks, colors=GLYPH_EDGE, linewidths=0.9, zorder=5),
    ):
        ax.add_collection(collection)
    view.dress(ax, f"deformation × {factor:g}")
    return drawn


def _exaggeration(view: View, rates: NDArray[Any]) -> float:
    """A round factor at which deformation and rotation are at most 1 at 98 % of the points.

    It is no larger than makes four standard errors 1: glyphs of pure noise stay nearly round.
    """
    sizes = np.linalg.norm(gradient(rates), axis=(-2, -1))
    typical = float(np.quantile(sizes, 0.98)) if sizes.size else 0.0
    if "covariance" in view.pair and sizes.size:
        noise = np.linalg.norm(derived_error(view.pair, "displacement_gradient").values, axis=(-2, -1))
        typical = max(typical, 4 * float(np.nanmedian(noise)))
    return nice_below(max(1 / typical, 1.0), (1, 1.5, 2, 3, 4, 5, 6, 8)) if typical > 0 else 1.0
