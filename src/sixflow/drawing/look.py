r"""The look of all plots: sizes, colours, and axes without ornament.

Every artist is given its look explicitly: no global setting of matplotlib is read for it or changed by it.

| colour | meaning |
|---|---|
| blue – white – red | a signed number; white is 0, limits symmetric |
| white – violet | a standard error; white is 0 |
| grey, hatched //// | masked: outside the region of interest |
| ochre, hatched \\\\\\\\ | failed: no number could be measured |

The two maps and the two hatches differ in lightness and direction, so that they are distinguished without
colour vision.
"""

from __future__ import annotations

import math
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from sixflow.errors import InputError

Array = NDArray[Any]

FONT = 7.0
"""Size of tick labels, pt; titles are one point larger."""
INK = "#1a1a1a"
ARROW = "#0b3c6f"
GLYPH_FACE, GLYPH_EDGE, REFERENCE = (0.0, 0.45, 0.70, 0.28), "#0b3c6f", "#777777"
MASKED_FACE, MASKED_EDGE = "#dcdcdc", "#9a9a9a"
FAILED_FACE, FAILED_EDGE = "#f3c13a", "#8a5a00"
SIGNED_MAP, ERROR_MAP = "RdBu_r", "BuPu"


def new_figure(width: float, height: float) -> Figure:
    """Make a figure that needs no display and is known to no global list.

    Parameters
    ----------
    width, height : float
        Size, inches.
    """
    figure = Figure(figsize=(width, height), dpi=150, layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def require_axes(ax: object) -> Axes:
    """Return `ax` if it is axes of matplotlib; InputError if it is not."""
    if not isinstance(ax, Axes):
        raise InputError(
            f"ax is a {type(ax).__name__}: give axes of matplotlib, such as Figure().add_subplot()"
        )
    return ax


def tidy(ax: Axes, *, title: str, x_label: str, y_label: str) -> None:
    """Give axes their title, labels and thin frame."""
    ax.set_title(title, fontsize=FONT + 1, color=INK, pad=4, loc="left", linespacing=1.15)
    ax.set_xlabel(x_label, fontsize=FONT, color=INK, labelpad=2)
    ax.set_ylabel(y_label, fontsize=FONT, color=INK, labelpad=2)
    ax.tick_params(labelsize=FONT, width=0.5, length=2.5, color=INK, labelcolor=INK, direction="out")
    ax.xaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 4, 5, 10]))
    ax.yaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 4, 5, 10]))
    for spine in ax.spines.values():
        spine.set_linewidth(0.5)
        spine.set_color(INK)
    ax.set_facecolor("white")
    ax.grid(False)


def add_colour_bar(ax: Axes, image: Any, *, extend: str) -> Axes:
    """Put a colour bar of the same height beside axes, and return its axes."""
    bar_axes = ax.inset_axes((1.04, 0.0, 0.055, 1.0))
    figure = ax.get_figure(root=True)
    assert figure is not None  # the axes are in use
    bar = figure.colorbar(image, cax=bar_axes, extend=extend, extendfrac=0.04)
    (left, right), (bottom, top) = ax.get_xlim(), ax.get_ylim()
    flat = abs(top - bottom) < 0.45 * abs(right - left)
    bar.locator = MaxNLocator(3 if flat else 5, steps=[1, 2, 4, 5, 10])
    bar.update_ticks()
    bar.outline.set_linewidth(0.5)
    bar_axes.tick_params(labelsize=FONT, width=0.5, length=2, color=INK, labelcolor=INK)
    return bar_axes


def signed_limit(values: Array, error: Array | None) -> float:
    """Symmetric limit of a colour scale: exceeded by 1 % of the points, at least three standard errors.

    The second rule keeps pure noise pale: saturated colours mean numbers that differ from 0.
    """
    limit = _quantile(np.abs(values), 0.99)
    return max(limit, 3 * _quantile(error, 0.5) if error is not None else 0.0) or 1.0


def error_limit(error: Array) -> float:
    """Upper limit of the colour scale of a standard error: exceeded by 2 % of the points."""
    return _quantile(error, 0.98) or 1.0


def power_of_ten(limit: float) -> int:
    """Multiple of 3, such that `limit` divided by 10**power has at most three digits before the point."""
    if 0.1 <= limit < 1000:
        return 0
    return 3 * math.floor(math.log10(limit) / 3)


def with_power(unit: str, power: int) -> str:
    """Write a unit with its power of ten, such as "10⁻³ px/px"."""
    if power == 0:
        return unit
    return f"10{str(power).translate(str.maketrans('-0123456789', '⁻⁰¹²³⁴⁵⁶⁷⁸⁹'))} {unit}".rstrip()


def nice_below(value: float, digits: tuple[float, ...] = (1, 2, 5)) -> float:
    """Largest product of one of `digits` and a power of ten that is at most `value` (positive)."""
    decade = 10.0 ** math.floor(math.log10(value))
    return decade * max(digit for digit in digits if digit * decade <= value * (1 + 1e-9))


def colour_map(name: str) -> Any:
    """Return a colour map of matplotlib whose unknown values are transparent."""
    return mpl.colormaps[name].with_extremes(bad=(0, 0, 0, 0))


def _quantile(values: Array, q: float) -> float:
    finite = values[np.isfinite(values)]
    return float(np.quantile(finite, q)) if finite.size else 0.0
