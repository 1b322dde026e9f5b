"""Panels with the trajectories of steady motions."""

from __future__ import annotations

import math
import os
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch
from matplotlib.path import Path

from sixflow.array_checks import Array
from sixflow.errors import InputError
from sixflow.groups.group import Group
from sixflow.groups.trajectories import trajectory
from sixflow.plot.look import ARROW, FONT, INK, new_figure
from sixflow.plot.saving import save_figure

_PANEL = 1.9  # inches: four of them are two columns of a journal
_GRID = np.linspace(-0.75, 0.75, 7)
_WAY = 0.22  # median length of the blue ways, in half sides of the square
_ORBIT = "#b8b8b8"


def draw(group: Group, motions: Array, path: str | os.PathLike[str] | None) -> Figure:
    """Draw one panel for each motion; see `sixflow.groups.draw_trajectories`."""
    motions = np.atleast_2d(motions)
    if (
        motions.ndim > 2
        or not np.isfinite(motions).all()
        or not motions.any(axis=-1).all()
        or not len(motions)
    ):
        raise InputError(
            f"coefficients of shape {motions.shape}: must be one or more rows of {group.dimension} finite numbers, not "
            "all zero"
        )
    columns = min(4, len(motions))
    rows = math.ceil(len(motions) / columns)
    figure = new_figure(_PANEL * columns + 0.1, (_PANEL + 0.15) * rows + 0.1)
    axes: Any = figure.subplots(rows, columns, squeeze=False)
    for index, ax in enumerate(axes.flat):
        if index < len(motions):
            _panel(ax, group, motions[index])
        else:
            ax.set_axis_off()
    if path is not None:
        save_figure(figure, path)
    return figure


def _panel(ax: Axes, group: Group, motion: Array) -> None:
    points = np.stack(np.meshgrid(_GRID, _GRID), axis=-1).reshape(-1, 2)
    speed = np.hypot(*group.field(motion, points).T)
    moving = speed > 1e-9 * speed.max()
    points, usual = points[moving], float(np.median(speed[moving]))
    time = float(f"{_WAY / usual:.1g}")
    orbits = trajectory(group, motion, points, np.linspace(-4, 4, 801) / usual, invalid="nan")
    inside = (np.abs(orbits) <= 1.5).all(axis=-1, keepdims=True)
    x, y = np.moveaxis(np.where(inside, orbits, np.nan), -1, 0)
    ax.plot(x.T, y.T, color=_ORBIT, linewidth=0.4, zorder=1)
    for way in trajectory(group, motion, points, np.linspace(0, time, 25), invalid="nan"):
        if np.isfinite(way).all():
            ax.add_patch(
                FancyArrowPatch(
                    path=Path(way), arrowstyle="-|>,head_length=2.2,head_width=1.0", mutation_scale=1,
                    color=ARROW, linewidth=0.7, shrinkA=0, shrinkB=0, zorder=2, capstyle="butt", joinstyle="miter",
                )
            )  # fmt: skip
    ax.plot(*points.T, ".", color=ARROW, markersize=1.6, zorder=3)
    ax.set_xlim(-1.02, 1.02)
    ax.set_ylim(1.02, -1.02)
    ax.set_aspect("equal")
    ax.set_title(f"{_formula(group, motion)}, τ = {time:g}", fontsize=FONT + 0.5, color=INK, pad=3)
    ax.set_xticks([])
    ax.set_yticks([])
    for spine in ax.spines.values():
        spine.set_linewidth(0.4)
        spine.set_color(_ORBIT)


def _formula(group: Group, motion: Array) -> str:
    """Write a motion as a sum of generators; a single one with its name."""
    terms = [(value, symbol[2:]) for value, symbol in zip(motion, group.symbols, strict=True) if value]
    if len(terms) == 1 and terms[0][0] == 1:
        name = group.names[int(motion.argmax())].replace("_", " ")
        return rf"$\mathcal{{L}}_{{{terms[0][1]}}}$ {name}"
    signed = [rf"{value:+.2g}\,\mathcal{{L}}_{{{index}}}" for value, index in terms]
    return f"${''.join(signed).removeprefix('+')}$"
