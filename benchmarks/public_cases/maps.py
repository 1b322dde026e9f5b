"""Figures of a set of cases: maps of the end-point error, one row per case, one column per method.

The colour is log₁₀ of the error, the same scale in all maps. Grey: no truth. Ochre: no number given. Small dots:
wrong, and not flagged (ours alone). The images themselves are not drawn: they belong to others.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib import colors
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from public_cases.run import CaseResult, Entry
from sixflow.drawing.look import FAILED_FACE, FONT, INK, MASKED_FACE, new_figure
from sixflow.plot.view import cell_edges

LIMITS = (1e-3, 1.0)  # px
LEFT_OUT = ("window=31, sharpen=2", "window=31, sharpen=5")
MOST_PEERS = 3
WIDTH, BAR = 7.6, 0.75  # inches
DOT = "#ff5a36"


def draw_maps(results: list[CaseResult], ours: tuple[str, ...], peers: tuple[str, ...]) -> Figure:
    """Draw the maps of a set: our columns, and the peers with the least median error."""
    ran = {name for result in results for name in result.entries}
    names = (*(name for name in ours if name in ran and name not in LEFT_OUT), *_best(results, peers))
    names = tuple(dict.fromkeys(names))
    cell = (WIDTH - BAR) / len(names)
    tall = [cell * result.case.truth.shape[0] / result.case.truth.shape[1] for result in results]
    figure = new_figure(WIDTH, sum(tall) + 0.1 * len(tall) + 0.65)
    axes = figure.subplots(len(results), len(names), squeeze=False, height_ratios=tall)
    norm = colors.LogNorm(*LIMITS, clip=True)
    for row, result in zip(axes, results, strict=True):
        for ax, name in zip(row, names, strict=True):
            _draw(ax, result, result.entries.get(name), norm)
        row[0].set_ylabel(_short(result), fontsize=FONT, color=INK, labelpad=3)
    for ax, name in zip(axes[0], names, strict=True):
        ax.set_title(name.replace(", ", ",\n"), fontsize=FONT + 1, color=INK, pad=4)
    _add_scale(figure, axes, norm)
    return figure


def _best(results: list[CaseResult], peers: tuple[str, ...]) -> list[str]:
    """Names of the peers that ran on all cases, in the order of their median error."""
    errors = {
        name: float(np.median([result.entries[name].scores.error for result in results]))
        for name in peers
        if all(name in result.entries for result in results)
    }
    return sorted(errors, key=lambda name: errors[name])[:MOST_PEERS]


def _short(result: CaseResult) -> str:
    """Name of a case within its set, broken where it is long."""
    name = result.case.name.removeprefix(result.case.set_name + "/")
    return name.replace("_", "\n", 1) if len(name) > 12 else name


def _draw(ax: Axes, result: CaseResult, entry: Entry | None, norm: Any) -> None:
    ax.set_xticks([])
    ax.set_yticks([])
    for spine in ax.spines.values():
        spine.set_linewidth(0.5)
    height, width = result.case.truth.shape
    ax.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), aspect="equal", facecolor=MASKED_FACE)
    if entry is None:
        ax.text(
            0.5, 0.5, "not run", transform=ax.transAxes, ha="center", va="center", fontsize=FONT, color=INK
        )
        return
    comparison = entry.comparison
    x, y = comparison.measured.x, comparison.measured.y
    columns, rows = cell_edges(x), cell_edges(y)
    extent = (columns[0], columns[-1], rows[-1], rows[0])
    distance = comparison.distance
    shade = colormap()(norm(np.nan_to_num(distance, nan=LIMITS[1])))
    shade[comparison.known & ~comparison.measured.given] = colors.to_rgba(FAILED_FACE)
    shade[~comparison.known] = colors.to_rgba(MASKED_FACE)
    ax.imshow(shade, extent=extent, interpolation="nearest")
    if comparison.measured.error is None:
        return  # wherever it is dark
    wrong_y, wrong_x = np.nonzero(comparison.wrong)
    ax.plot(
        x[wrong_x], y[wrong_y], linestyle="none", marker=".", markersize=1.6, markeredgewidth=0, color=DOT
    )


def colormap() -> Any:
    """Colours of an error: light where it is small."""
    import matplotlib as mpl

    return mpl.colormaps["YlGnBu"]


def _add_scale(figure: Figure, axes: Any, norm: Any) -> None:
    from matplotlib.cm import ScalarMappable

    bar = figure.colorbar(
        ScalarMappable(norm, colormap()),
        ax=axes,
        location="right",
        fraction=0.025,
        pad=0.01,
        aspect=28,
        extend="both",
    )
    bar.set_label("end-point error (px)", fontsize=FONT, color=INK)
    bar.ax.tick_params(labelsize=FONT, width=0.5, length=2)
    bar.outline.set_linewidth(0.5)
    handles = [
        Patch(facecolor=FAILED_FACE, label="not given"),
        Patch(facecolor=MASKED_FACE, label="no truth, or no point"),
        Line2D(
            [],
            [],
            linestyle="none",
            marker=".",
            markersize=4,
            markeredgewidth=0,
            color=DOT,
            label="ours: wrong, not flagged",
        ),
    ]
    figure.legend(
        handles=handles,
        loc="outside lower center",
        ncols=3,
        fontsize=FONT,
        frameon=False,
        labelcolor=INK,
        handlelength=1.2,
    )
