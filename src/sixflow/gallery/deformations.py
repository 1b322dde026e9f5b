r"""Figures 1 and 3: the deformations themselves, as fields and as trajectories.

The displacement over τ is exp(τL) x − x; for the four generators of figure 1 its first-order part is

| generator | number, 2τ | G/τ |
|---|---|---|
| L_s | divergence = u_x + v_y | [[1, 0], [0, 1]] |
| L_r | curl = v_x − u_y | [[0, −1], [1, 0]] |
| L_b | stretch = u_x − v_y | [[1, 0], [0, −1]] |
| L_B | shear = u_y + v_x | [[0, 1], [1, 0]] |

The trajectories of figure 3 are those of eq. (4) of the paper; as corrected here: L_B has cosh and sinh, where the
print has x' = x cos τ − y sin τ, y' = x sin(−τ) + y cos(−τ). That is no one-parameter group; its curves are
ellipses, since it multiplies x + y by cos τ − sin τ and x − y by cos τ + sin τ. They are drawn dashed.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from sixflow.drawing.look import GLYPH_FACE, INK, new_figure
from sixflow.eigenfilters.generators import L_B, Generator, L_b, L_r, L_s, L_x, L_y
from sixflow.gallery.look import AFTER, BEFORE, PRINTED, WIDTH, Real, plane

TAU = 0.25
"""Of the deformations of figure 1: its four numbers are 2τ = 0.5."""
HALF = 10.0  # px

_DERIVATIVES = {
    L_s: r"divergence  $u_x + v_y$",
    L_r: r"curl  $v_x - u_y$",
    L_b: r"stretch  $u_x - v_y$",
    L_B: r"shear  $u_y + v_x$",
}


def draw_derivatives() -> Figure:
    """Figure 1: divergence, curl and two shears as vector fields, and what they make of a square grid."""
    figure = new_figure(WIDTH, 4.1)
    axes: Any = figure.subplots(2, 4, sharex=True, sharey=True)
    for (upper, lower), (generator, title) in zip(axes.T, _DERIVATIVES.items(), strict=True):
        _draw_field(upper, generator)
        _draw_grid(lower, generator)
        plane(upper, 1.18 * HALF, title)
        plane(lower, 1.18 * HALF)
    for ax in axes.flat:
        ax.label_outer()
    return figure


def _draw_field(ax: Axes, generator: Generator) -> None:
    """Arrows, true to scale, from points to where they go; and a square with its image."""
    nodes = np.linspace(-8, 8, 6)
    x, y = np.meshgrid(nodes, nodes)
    X, Y = generator.flow(TAU, x, y)
    corners = np.array([[-4.0, 4, 4, -4], [-4.0, -4, 4, 4]])
    ax.add_patch(Polygon(corners.T, fill=False, edgecolor=BEFORE, linewidth=0.8, linestyle="--"))
    moved = np.stack(generator.flow(TAU, *corners))
    ax.add_patch(Polygon(moved.T, facecolor=GLYPH_FACE, edgecolor=AFTER, linewidth=0.8))
    ax.quiver(
        x, y, X - x, Y - y, angles="xy", scale_units="xy", scale=1, color=INK, pivot="tail",
        width=0.006, headwidth=4.5, headlength=5, headaxislength=4.5, zorder=3,
    )  # fmt: skip


def _draw_grid(ax: Axes, generator: Generator) -> None:
    """A square grid, and its image, true to scale."""
    along = np.linspace(-8, 8, 65)
    for place in np.linspace(-8, 8, 9):
        for line in ((along, np.full_like(along, place)), (np.full_like(along, place), along)):
            ax.plot(*line, color=BEFORE, linewidth=0.5, alpha=0.55)
            ax.plot(*generator.flow(TAU, *line), color=AFTER, linewidth=0.8)


def draw_generators() -> Figure:
    """Figure 3: trajectories of the six one-parameter groups, two by two as in the paper."""
    figure = new_figure(WIDTH, 5.5)
    axes: Any = figure.subplots(2, 3, sharex=True, sharey=True)
    columns = ((L_x, L_y), (L_s, L_r), (L_b, L_B))
    for pair, column in zip(columns, axes.T, strict=True):
        for generator, ax in zip(pair, column, strict=True):
            _draw_generator(ax, generator)
            letter = generator.symbol[-1]
            plane(ax, HALF, rf"$\mathcal{{L}}_{letter}$  {_MEANING[generator]}")
    _draw_printed(axes[1, 2])
    for ax in axes.flat:
        ax.label_outer()
    return figure


_MEANING = {
    L_x: "translation in x", L_y: "translation in y", L_s: "divergence",
    L_r: "curl", L_b: "stretch", L_B: "shear (dashed: as printed)",
}  # fmt: skip

_STEP = {L_x: 2.5, L_y: 2.5, L_s: 0.5, L_r: np.pi / 6, L_b: 0.5, L_B: 0.5}
"""τ between two arrowheads."""


def _seeds(generator: Generator) -> Real:
    """Points that the trajectories go through at τ = 0, shape (n, 2)."""
    lines = np.arange(-8.0, 8.1, 2)
    distances = np.array([1.6, 3.2, 4.8, 6.4, 8.0])
    if generator in (L_x, L_y):
        seeds = np.stack([np.zeros_like(lines), lines], -1)
        return seeds if generator == L_x else seeds[:, ::-1]
    if generator == L_s:
        angles = np.arange(16) * np.pi / 8
        return 4 * np.stack([np.cos(angles), np.sin(angles)], -1)
    if generator == L_r:
        return np.stack([distances, np.zeros_like(distances)], -1)
    directions = np.array([[1.0, 1], [-1, 1], [-1, -1], [1, -1]]) / np.sqrt(2)
    if generator == L_B:
        directions = np.array([[1.0, 0], [0, 1], [-1, 0], [0, -1]])
    return (directions[:, None] * distances[:, None]).reshape(-1, 2)


def _draw_generator(ax: Axes, generator: Generator) -> None:
    """Curves exp(τL) x through the seeds, with arrowheads at equal steps of τ."""
    step, count = _STEP[generator], 6
    tau = np.linspace(-count, count, 40 * count + 1) * step
    heads = np.arange(-count, count) * step + step / 2
    nearest = 0.0 if generator in (L_x, L_y) else 1.4
    for x, y in _seeds(generator):
        ax.plot(*generator.flow(tau, x, y), color=AFTER, linewidth=0.8)
        X, Y = generator.flow(heads, x, y)
        inside = (np.maximum(np.abs(X), np.abs(Y)) < 0.97 * HALF) & (np.hypot(X, Y) > nearest)
        _draw_heads(ax, generator, X[inside], Y[inside])
    if generator not in (L_x, L_y):
        ax.plot(0, 0, "o", color=AFTER, markersize=2)


def _draw_heads(ax: Axes, generator: Generator, x: Real, y: Real) -> None:
    a_x, a_y = generator.field(x, y)
    size = np.hypot(a_x, a_y)
    ax.quiver(
        x, y, a_x / size, a_y / size, angles="xy", scale_units="inches", scale=1 / 0.065, units="inches",
        width=0.018, headwidth=3, headlength=3.6, headaxislength=3.6, pivot="mid", color=AFTER, minlength=0,
    )  # fmt: skip


def _draw_printed(ax: Axes) -> None:
    """The curves of the print of eq. (4) for L_B, through two points."""
    tau = np.linspace(-np.pi, np.pi, 241)
    for x, y in ((4.8, 0.0), (5.5, 3.5)):
        X = x * np.cos(tau) - y * np.sin(tau)
        Y = x * np.sin(-tau) + y * np.cos(-tau)
        ax.plot(X, Y, "--", color=PRINTED, linewidth=1, zorder=3)
        ax.plot(x, y, "o", color=PRINTED, markersize=3, zorder=3)
