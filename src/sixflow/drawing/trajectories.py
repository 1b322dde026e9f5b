"""Panels of trajectories: whole ones in grey, and the displacement of points over a short time in blue."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch
from matplotlib.path import Path
from numpy.typing import NDArray

from sixflow.drawing.look import ARROW, FONT, INK, new_figure
from sixflow.drawing.saving import save_figure

_PANEL = 1.9  # inches: four of them are two columns of a journal
_ORBIT = "#b8b8b8"


class Panel(NamedTuple):
    """What one panel shows, on the square |x|, |y| ≤ 1.

    Attributes
    ----------
    points : array, shape (n, 2)
        Where trajectories begin.
    orbits, paths : array, shape (n, times, 2)
        Whole trajectories, and their parts over a short time; NaN where a point leaves to infinity.
    title : str
    """

    points: NDArray[Any]
    orbits: NDArray[Any]
    paths: NDArray[Any]
    title: str


def draw_panels(panels: Sequence[Panel], path: str | os.PathLike[str] | None) -> Figure:
    """Draw panels of trajectories, at most four in a row."""
    columns = min(4, len(panels))
    rows = math.ceil(len(panels) / columns)
    figure = new_figure(_PANEL * columns + 0.1, (_PANEL + 0.15) * rows + 0.1)
    axes: Any = figure.subplots(rows, columns, squeeze=False)
    for ax in axes.flat[len(panels) :]:
        ax.set_axis_off()
    for ax, panel in zip(axes.flat, panels, strict=False):
        _draw_panel(ax, panel)
    if path is not None:
        save_figure(figure, path)
    return figure


def _draw_panel(ax: Axes, panel: Panel) -> None:
    inside = (np.abs(panel.orbits) <= 1.5).all(axis=-1, keepdims=True)
    x, y = np.moveaxis(np.where(inside, panel.orbits, np.nan), -1, 0)
    ax.plot(x.T, y.T, color=_ORBIT, linewidth=0.4, zorder=1)
    for path in panel.paths:
        if np.isfinite(path).all():
            ax.add_patch(
                FancyArrowPatch(
                    path=Path(path), arrowstyle="-|>,head_length=2.2,head_width=1.0", mutation_scale=1,
                    color=ARROW, linewidth=0.7, shrinkA=0, shrinkB=0, zorder=2, capstyle="butt", joinstyle="miter",
                )
            )  # fmt: skip
    ax.plot(*panel.points.T, ".", color=ARROW, markersize=1.6, zorder=3)
    ax.set(xlim=(-1.02, 1.02), ylim=(1.02, -1.02), aspect="equal", xticks=[], yticks=[])
    ax.set_title(panel.title, fontsize=FONT + 0.5, color=INK, pad=3)
    for spine in ax.spines.values():
        spine.set_linewidth(0.4)
        spine.set_color(_ORBIT)
