"""The calibration as a picture: how the image flows for each of the nine parameters of structure and motion."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sixflow.checks import numbers, require
from sixflow.plot.look import ARROW, FONT, INK, MASKED_FACE, new_figure
from sixflow.plot.saving import save_figure
from sixflow.scenes.arguments import Array, require_kind
from sixflow.scenes.calibration import Calibration
from sixflow.scenes.eight import six_matrix

_COLUMNS = 11  # arrows along a row
_SYMBOLS = (
    "V_X", "V_Y", "V_Z", r"\Omega_X", r"\Omega_Y", r"\Omega_Z", "p", "q", "r",
)  # fmt: skip


def draw_calibration(
    calibration: Calibration,
    shape: tuple[int, int],
    path: str | os.PathLike[str] | None = None,
    *,
    length: str = "m",
) -> Figure:
    """Draw the change of the flow over the frame with each of the nine parameters.

    Each of the nine panels is the frame; its arrows are the derivative of (u, v) by one parameter, to a scale of
    their own: the number above is that of the longest arrow. The cross is the point of the six. Regions that do not
    show the plane are grey.

    Parameters
    ----------
    calibration : Calibration
    shape : (int, int)
        Rows and columns of the frame, at least 2.
    path : path, optional
        Where to save the picture: .png, .pdf or .svg.
    length : str
        Name of the unit of length of the scene.

    Returns
    -------
    Figure
        Of matplotlib.

    Raises
    ------
    InputError
        If an argument is of another kind.
    FieldFileError
        If the picture cannot be saved.

    Examples
    --------
    >>> from sixflow.scenes import Camera, Plane, RigidMotion, calibrate
    >>> camera = Camera(focal=500, centre=(319.5, 239.5))
    >>> scene = calibrate(camera, Plane.from_slant(2.0, slant=0.5), RigidMotion((0.02, 0, 0.1)))
    >>> figure = draw_calibration(scene, (480, 640))
    >>> len(figure.axes)
    9
    """
    require_kind("calibration", calibration, Calibration, "calibrate(camera, plane, motion)")
    rows, columns = numbers("shape", shape, 2, "rows and columns of the frame")
    require(min(rows, columns) >= 2, "shape", shape, "must be rows and columns of at least 2")
    spacing = columns / _COLUMNS
    x, y = np.meshgrid(
        np.arange(spacing / 2, columns, spacing) - 0.5, np.arange(spacing / 2, rows, spacing) - 0.5
    )
    seen = calibration.plane.sees(calibration.camera, x, y)
    centre = calibration.camera.centre
    flows = six_matrix(x - centre[0], y - centre[1])[..., :2, :] @ calibration.eight_jacobian
    flows = np.where(seen[..., None, None], flows, np.nan)
    units = (f"{length}/frame",) * 3 + ("rad/frame",) * 3 + ("", "", length)
    figure = new_figure(6.6, 6.6 * rows / columns + 0.5)
    for k, axes in enumerate(figure.subplots(3, 3).flat):
        axes.set(xlim=(-0.5, columns - 0.5), ylim=(rows - 0.5, -0.5), xticks=[], yticks=[], aspect="equal")
        for spine in axes.spines.values():
            spine.set_linewidth(0.5)
        longest = _draw_flow(axes, x, y, flows[..., k], spacing)
        axes.plot(*calibration.at, "x", color=INK, markersize=4, markeredgewidth=0.8, zorder=3)
        unit = f"px/frame per {units[k]}" if units[k] else "px/frame per 1"
        axes.set_title(
            f"$\\partial(u, v)/\\partial {_SYMBOLS[k]}$: {longest:.3g} {unit}",
            fontsize=FONT,
            color=INK,
            pad=3,
        )
        _shade_unseen(axes, calibration, rows, columns)
    if path is not None:
        save_figure(figure, path)
    return figure


def _draw_flow(axes: Axes, x: Array, y: Array, flow: Array, spacing: float) -> float:
    """Draw arrows, the longest as long as the spacing; return its length in px per frame interval."""
    length = np.hypot(flow[..., 0], flow[..., 1])
    known = np.isfinite(length)
    longest = float(length[known].max()) if known.any() else 0.0
    # lengths that differ from 0 by rounding are 0
    drawn = known & (length > 1e-9 * longest)
    u, v = flow[drawn].T
    style: dict[str, Any] = {
        "units": "inches", "width": 0.009, "headwidth": 3.6, "headlength": 4.2, "headaxislength": 3.8,
        "minlength": 0.3, "color": ARROW, "zorder": 2,
    }  # fmt: skip
    # where y grows downwards, angles="xy" lets a positive v point down
    scale = longest / spacing if longest > 0 else 1.0
    axes.quiver(x[drawn], y[drawn], u, v, angles="xy", scale_units="xy", scale=scale, pivot="mid", **style)
    still = known & ~drawn
    axes.plot(x[still], y[still], ".", color=ARROW, markersize=0.8, zorder=2)
    return longest


def _shade_unseen(axes: Axes, calibration: Calibration, rows: float, columns: float) -> None:
    x, y = np.meshgrid(np.linspace(-0.5, columns - 0.5, 200), np.linspace(-0.5, rows - 0.5, 150))
    seen = calibration.plane.sees(calibration.camera, x, y)
    if not seen.all():
        axes.contourf(x, y, seen.astype(float), levels=(-0.5, 0.5), colors=[MASKED_FACE], zorder=0)
