"""A sheet of all kernels of a bank: the even and the odd operator side by side."""

from __future__ import annotations

import math
import os
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from sixflow.eigenfilters.bank import FilterBank
from sixflow.plot.look import FONT, INK, SIGNED_MAP, new_figure
from sixflow.plot.saving import save_figure

_WIDTH = 7.6  # inches: two columns of a journal


def draw_bank(bank: FilterBank, path: str | os.PathLike[str] | None = None) -> Figure:
    """Draw a bank; see `FilterBank.picture`.

    Every kernel has a tile: left its real part (even), right its imaginary part (odd); blue is negative, red
    positive, white 0, each kernel on a scale of its own. Below it stand its orders u, v and what they belong to.
    """
    columns = min(6, len(bank))
    rows = math.ceil(len(bank) / columns)
    cell = _WIDTH / 6
    figure = new_figure(cell * columns + 0.1, rows * (cell / 2 + 0.17) + 0.1)
    layout: Any = figure.get_layout_engine()
    layout.set(w_pad=0.02, h_pad=0.02, wspace=0.06, hspace=0.03)
    axes: Any = figure.subplots(rows, columns, squeeze=False)
    n, gap = bank.size, max(1, bank.size // 12)
    for index, ax in enumerate(axes.flat):
        ax.set_axis_off()
        if index >= len(bank):
            continue
        w = bank.matrix[index].reshape(n, n)
        tile = np.full((n, 2 * n + gap), np.nan)
        tile[:, :n], tile[:, n + gap :] = w.real, w.imag
        limit = float(np.nanmax(np.abs(tile)))
        ax.imshow(tile, cmap=SIGNED_MAP, vmin=-limit, vmax=limit, interpolation="nearest", aspect="equal")
        for left in (0, n + gap):
            ax.add_patch(_frame(left - 0.5, n))
        ax.set_title(_caption(bank, index), fontsize=FONT - 1, color=INK, pad=2)
    if path is not None:
        save_figure(figure, path)
    return figure


def _caption(bank: FilterBank, index: int) -> str:
    kernel = bank.kernels[index]
    u, v = kernel.orders
    first, second = (name.replace("L_", "") for name in kernel.generators)
    return rf"$\mathcal{{L}}_{first}$ {_short(u)}, $\mathcal{{L}}_{second}$ {_short(v)}"


def _short(value: float) -> str:
    value = value if abs(value) > 5e-3 else 0.0
    text = f"{value:.2g}" if abs(value) < 9.95 else f"{value:.0f}"
    return text.replace("-", "−")


def _frame(left: float, size: int) -> Rectangle:
    return Rectangle((left, -0.5), size, size, fill=False, edgecolor="#9a9a9a", linewidth=0.4)
