"""A sheet of complex kernels: the even and the odd operator of each side by side."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from sixflow.drawing.look import FONT, INK, SIGNED_MAP, new_figure
from sixflow.drawing.saving import save_figure

_WIDTH = 7.6  # inches: two columns of a journal


def draw_kernels(
    kernels: NDArray[np.complex128], captions: Sequence[str], path: str | os.PathLike[str] | None = None
) -> Figure:
    """Draw complex kernels, shape (n, size, size), each with its caption.

    Every kernel has a tile: left its real part (even), right its imaginary part (odd); blue is negative, red
    positive, white 0, each kernel on a scale of its own.
    """
    columns = min(6, len(kernels))
    rows = math.ceil(len(kernels) / columns)
    cell = _WIDTH / 6
    figure = new_figure(cell * columns + 0.1, rows * (cell / 2 + 0.17) + 0.1)
    layout: Any = figure.get_layout_engine()
    layout.set(w_pad=0.02, h_pad=0.02, wspace=0.06, hspace=0.03)
    axes: Any = figure.subplots(rows, columns, squeeze=False)
    n = kernels.shape[-1]
    gap = max(1, n // 12)
    for ax in axes.flat:
        ax.set_axis_off()
    for ax, w, caption in zip(axes.flat, kernels, captions, strict=False):
        tile = np.full((n, 2 * n + gap), np.nan)
        tile[:, :n], tile[:, n + gap :] = w.real, w.imag
        limit = float(np.nanmax(np.abs(tile)))
        ax.imshow(tile, cmap=SIGNED_MAP, vmin=-limit, vmax=limit, interpolation="nearest", aspect="equal")
        for left in (0, n + gap):
            frame = Rectangle((left - 0.5, -0.5), n, n, fill=False, edgecolor="#9a9a9a", linewidth=0.4)
            ax.add_patch(frame)
        ax.set_title(caption, fontsize=FONT - 1, color=INK, pad=2)
    if path is not None:
        save_figure(figure, path)
    return figure
