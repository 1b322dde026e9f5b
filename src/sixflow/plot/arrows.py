"""Arrows: the translation (u, v) on the frame."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.quiver import Quiver
from matplotlib.transforms import ScaledTranslation, Transform, blended_transform_factory
from numpy.typing import ArrayLike, NDArray

from sixflow.checks import is_whole
from sixflow.drawing.look import ARROW, FONT, INK, nice_below, require_axes
from sixflow.errors import InputError
from sixflow.field.selection import reference_of
from sixflow.plot.missing import fill_missing, mark_failed
from sixflow.plot.view import Units, View

_PLACES = {
    "first": ("tail", ""),
    "middle": ("middle", ", seen half way"),
    "second": ("tip", ", seen in frame 1"),
}
"""Where an arrow lies on its point, and how the title says it, by the frame that the points lie in."""


def plot_arrows(
    field: xr.Dataset,
    ax: Axes,
    frame: ArrayLike | None = None,
    *,
    time: int = 0,
    y_up: bool = False,
    units: Units = "px",
    arrows: int = 28,
) -> Quiver:
    """Draw the translation as arrows, with a reference arrow, over the pale frame.

    The arrows are magnified so that they are easily seen; the reference arrow above the frame states the
    scale. Masked regions are hatched grey, failed points are crosses: neither looks like an arrow of length
    0, which is a dot.

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
    arrows : int
        About this many arrows along the longer side, at least 1; others are left out.

    Raises
    ------
    InputError
        If an argument cannot be used.
    """
    view = View.of(field, time=time, units=units, y_up=y_up)
    return draw_arrows(require_axes(ax), view, frame, arrows=arrows)


def draw_arrows(ax: Axes, view: View, frame: ArrayLike | None, *, arrows: int = 28) -> Quiver:
    """Draw the arrows of a view; see `plot_arrows`."""
    draw_frame(ax, view, frame)
    fill_missing(ax, view, failed=False)
    u, v = view.quantity("u"), view.quantity("v")
    shown, spacing = thin(view, arrows)
    mark_failed(ax, view, shown)
    x, y = np.meshgrid(view.x, view.y)
    masked, failed = view.missing
    shown &= ~(masked | failed)
    length = np.hypot(u.values[shown], v.values[shown])
    typical = float(np.quantile(length, 0.95)) if length.size else 0.0
    scale = typical / (1.1 * spacing) if typical > 0 else 1.0
    # Where y grows downwards, angles="xy" lets a positive v point down, as it shall.
    pivot, where = _PLACES[reference_of(view.pair)]
    style: dict[str, Any] = {
        "scale_units": "xy", "scale": scale, "units": "inches", "width": 0.0095, "color": ARROW,
        "headwidth": 3.6, "headlength": 4.2, "headaxislength": 3.8, "minlength": 0.6, "zorder": 4,
    }  # fmt: skip
    quiver = ax.quiver(
        x[shown], y[shown], u.values[shown], v.values[shown], angles="xy", pivot=pivot, **style
    )
    view.dress(ax, ("velocity" if view.calibration else "displacement") + where)
    if typical > 0:
        _draw_reference(ax, view, nice_below(typical), u.unit, style)
    return quiver


def _draw_reference(ax: Axes, view: View, length: float, unit: str, style: dict[str, Any]) -> None:
    """Draw an arrow of known length at the right end of the title line."""
    right = view.frame_extent[1]
    figure = ax.get_figure(root=True)
    assert figure is not None
    lift = ScaledTranslation(0, (4 + 0.45 * FONT) / 72, figure.dpi_scale_trans)
    place: Transform = blended_transform_factory(ax.transData, ax.transAxes) + lift
    start = right - length / style["scale"]
    ax.quiver([start], [1.0], [length], [0.0], angles="uv", transform=place, clip_on=False, **style)
    ax.annotate(
        f"{length:g} {unit}", (start, 1.0), (-3, 4), ("data", "axes fraction"), "offset points",
        fontsize=FONT, color=INK, ha="right", va="bottom",
    )  # fmt: skip


def draw_frame(ax: Axes, view: View, frame: ArrayLike | None) -> None:
    """Draw the frame, pale, so that what lies over it can be read.

    Raises InputError if the frame is no array of numbers of the size of the field's frames.
    """
    if frame is None:
        return
    picture = _as_picture(frame, view)
    ax.imshow(
        picture, cmap="gray", vmin=0, vmax=1, extent=view.frame_extent, origin="upper",
        interpolation="nearest", zorder=0,
    )  # fmt: skip


def thin(view: View, most: int) -> tuple[NDArray[np.bool_], float]:
    """Choose every n-th grid point, about `most` along the longer side; return them and their distance."""
    if not is_whole(most, 1):
        raise InputError(f"{most!r} marks along the longer side: must be a whole number, at least 1")
    rows, columns = len(view.y), len(view.x)
    every = max(1, math.ceil(max(rows, columns) / most))
    chosen = np.zeros((rows, columns), bool)
    chosen[(rows - 1) % every // 2 :: every, (columns - 1) % every // 2 :: every] = True
    return chosen, every * view.spacing


def _as_picture(frame: ArrayLike, view: View) -> NDArray[Any]:
    picture = np.asarray(frame)
    if picture.dtype.kind not in "uifb" or not (
        picture.ndim == 2 or (picture.ndim == 3 and picture.shape[2] in (3, 4))
    ):
        raise InputError(
            f"frame of shape {picture.shape} and dtype {picture.dtype}: "
            "must hold numbers, shape (height, width) or (height, width, 3)"
        )
    left, right, bottom, top = (edge / view.scale for edge in view.frame_extent)
    size = (round(abs(bottom - top)), round(right - left))
    if "frame_shape" in view.pair.attrs and picture.shape[:2] != size:
        raise InputError(
            f"frame of {picture.shape[0]}×{picture.shape[1]} px: the field was measured on frames of "
            f"{size[0]}×{size[1]} px; give the reference frame of the pair"
        )
    grey = (picture[..., :3] if picture.ndim == 3 else picture).astype(float)
    finite = grey[np.isfinite(grey)]
    low, high = np.quantile(finite, [0.005, 0.995]) if finite.size else (0.0, 1.0)
    grey = np.clip((grey - low) / (high - low if high > low else 1.0), 0, 1)
    return np.nan_to_num(0.6 + 0.4 * grey, nan=1.0)
