"""Panels of arrows over a frame: a flow field in each, to a scale of its own."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from sixflow.drawing.look import ARROW, FONT, INK, MASKED_FACE, new_figure
from sixflow.drawing.saving import save_figure

Array = NDArray[np.float64]

_COLUMNS = 11  # arrows along a row


def arrow_grid(shape: tuple[float, float]) -> tuple[Array, Array]:
    """Return x and y, px, of the arrows over a frame of some rows and columns, in its middle and evenly spaced."""
    rows, columns = shape
    spacing = columns / _COLUMNS
    x, y = np.arange(spacing / 2, columns, spacing) - 0.5, np.arange(spacing / 2, rows, spacing) - 0.5
    x, y = np.meshgrid(x, y)
    return x, y


def draw_flows(
    shape: tuple[float, float],
    flows: Array,
    titles: Sequence[str],
    *,
    centre: tuple[float, float],
    sees: Callable[[Array, Array], NDArray[np.bool_]],
    path: str | os.PathLike[str] | None = None,
) -> Figure:
    """Draw nine flow fields over a frame.

    Parameters
    ----------
    shape : (float, float)
        Rows and columns of the frame.
    flows : array, shape (rows, columns, 2, 9)
        (u, v) of each field at the points of `arrow_grid`; NaN where there is none.
    titles : sequence of str
        With "{}" where the length of the longest arrow goes.
    centre : (float, float)
        Where a cross goes, px.
    sees : callable
        Whether image points (x, y) are of the scene; the others are grey.
    path : path, optional
        Where to save the picture.
    """
    rows, columns = shape
    x, y = arrow_grid(shape)
    fine = np.meshgrid(np.linspace(-0.5, columns - 0.5, 200), np.linspace(-0.5, rows - 0.5, 150))
    seen = sees(*fine)
    figure = new_figure(6.6, 6.6 * rows / columns + 0.5)
    for k, axes in enumerate(figure.subplots(3, 3).flat):
        axes.set(xlim=(-0.5, columns - 0.5), ylim=(rows - 0.5, -0.5), xticks=[], yticks=[], aspect="equal")
        for spine in axes.spines.values():
            spine.set_linewidth(0.5)
        longest = _draw_arrows(axes, x, y, flows[..., k], columns / _COLUMNS)
        axes.plot(*centre, "x", color=INK, markersize=4, markeredgewidth=0.8, zorder=3)
        axes.set_title(titles[k].replace("{}", f"{longest:.3g}"), fontsize=FONT, color=INK, pad=3)
        if not seen.all():
            levels = (-0.5, 0.5)
            axes.contourf(*fine, seen.astype(float), levels=levels, colors=[MASKED_FACE], zorder=0)
    if path is not None:
        save_figure(figure, path)
    return figure


def _draw_arrows(axes: Axes, x: Array, y: Array, flow: Array, spacing: float) -> float:
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
