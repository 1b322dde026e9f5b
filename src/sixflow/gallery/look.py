r"""The look of the gallery: its colours, and panels whose y axis points down.

Signed values take a diverging map that is perceptually uniform: in the colour space OKLab it goes straight from blue
to white and straight from white to red, with equal lightness and chroma at both ends, so that equal differences of the
value are equal distances of the colour, on both sides of 0, which is white.

| colour | meaning |
|---|---|
| blue – white – red | a kernel: negative, 0, positive; limits symmetric |
| grey | before the deformation, singular lines |
| dark blue | after the deformation; even operator |
| ochre | odd operator; what is printed in the paper where it is wrong |
| four hues | points of the pattern that are followed through a figure |
"""

from __future__ import annotations

import functools

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Colormap, ListedColormap
from numpy.typing import ArrayLike, NDArray

from sixflow.drawing.look import ARROW, REFERENCE, tidy

Real = NDArray[np.float64]

WIDTH = 7.6
"""Width of a figure, inches: two columns of a journal."""
BEFORE, AFTER = REFERENCE, ARROW
EVEN, ODD, PRINTED = ARROW, "#c4761b", "#c4761b"
POINTS = ("#d55e00", "#009e73", "#0072b2", "#cc79a7")
"""Colours of points that are followed, which can be distinguished without colour vision."""

_BLUE = (0.44, -0.0274, -0.1728)  # OKLab: L, a, b
_WHITE = (1.0, 0.0, 0.0)
_RED = (0.44, 0.1559, 0.0794)
_LAB_TO_LMS = np.array(
    [
        [1, 0.3963377774, 0.2158037573],
        [1, -0.1055613458, -0.0638541728],
        [1, -0.0894841775, -1.2914855480],
    ]
)
_LMS_TO_RGB = np.array(
    [
        [4.0767416621, -3.3077115913, 0.2309699292],
        [-1.2684380046, 2.6097574011, -0.3413193965],
        [-0.0041960863, -0.7034186147, 1.7076147010],
    ]
)


@functools.cache
def signed_map() -> Colormap:
    """Return the diverging colour map, blue – white – red, perceptually uniform; unknown values are transparent."""
    place = np.linspace(-1, 1, 513)[:, None]
    ends = np.where(place < 0, _BLUE, _RED)
    colours = oklab_to_rgb(_WHITE + np.abs(place) * (ends - np.array(_WHITE)))
    return ListedColormap(colours, name="sixflow_signed").with_extremes(bad=(0, 0, 0, 0))


def oklab_to_rgb(lab: ArrayLike) -> Real:
    """Colours of OKLab (L, a, b) as sRGB, 0 to 1, shape (..., 3); clipped to what a screen can show."""
    linear = (np.asarray(lab) @ _LAB_TO_LMS.T) ** 3 @ _LMS_TO_RGB.T
    linear = np.clip(linear, 0, 1)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def plane(ax: Axes, half: float, title: str = "", *, centre: float = 0.0) -> None:
    """Make axes a square piece of the image plane: px, equal aspect, y down."""
    ax.set_xlim(centre - half, centre + half)
    ax.set_ylim(centre + half, centre - half)
    ax.set_aspect("equal")
    tidy(ax, title=title, x_label="x (px)", y_label="y (px)")
