"""Draw the figures of the documentation: python docs/figures.py."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from sixflow.engine.window import sharpening_noise, window_sigma
from sixflow.groups import PROJECTIVE, draw_trajectories

IMAGES = Path(__file__).parent / "images"
COLOURS = ("#1b3a57", "#2f7f79", "#c98a2b", "#a23b3b")


def sharpening() -> None:
    """Response against period, and noise factors, for n = 0, 1, 2, 4."""
    figure = Figure(figsize=(7.6, 2.9), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    period = np.geomspace(15, 300, 400)
    whole = np.exp(-((2 * np.pi / period * window_sigma(31)) ** 2) / 2)
    counts = (0, 1, 2, 4)
    for n, colour in zip(counts, COLOURS, strict=True):
        left.semilogx(period, 1 - (1 - whole) ** (n + 1), color=colour, label=f"n = {n}")
    left.axhline(0.9, color="0.6", linewidth=0.8, linestyle=":")
    left.set_xticks([20, 30, 50, 100, 200, 300], labels=["20", "30", "50", "100", "200", "300"])
    left.minorticks_off()
    left.set(
        xlabel="period of the displacement (px), window 31", ylabel="response", ylim=(0, 1.03), xlim=(15, 300)
    )
    left.legend(frameon=False)
    factors = np.array([sharpening_noise(n) for n in counts])
    for k, (name, shift) in enumerate((("displacement", -0.18), ("gradients", 0.18))):
        right.bar(
            np.arange(4) + shift, factors[:, k], width=0.34, label=name, color=(COLOURS[0], COLOURS[2])[k]
        )
    right.set_xticks(np.arange(4), labels=[f"n = {n}" for n in counts])
    right.set(ylabel="noise, relative to n = 0")
    right.legend(frameon=False)
    for axes in (left, right):
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(IMAGES / "sharpening.png", dpi=150)


def group_trajectories() -> None:
    """The eight one-parameter groups of the plane's projective motions."""
    draw_trajectories(PROJECTIVE).savefig(IMAGES / "groups-trajectories.png", dpi=150)


def operators() -> None:
    """Four figures of the gallery that `sixflow operators` draws."""
    from sixflow.gallery import CATALOGUE

    images = {
        "figure-03-trajectories": "operators-trajectories.png",
        "figure-07-log-polar": "operators-log-polar.png",
        "figure-10-stretch": "operators-stretch.png",
        "beyond-stretch-map": "operators-hyperbolic.png",
    }
    for entry in CATALOGUE:
        if entry.name in images:
            entry.draw().savefig(IMAGES / images[entry.name], dpi=150)


if __name__ == "__main__":
    IMAGES.mkdir(exist_ok=True)
    sharpening()
    operators()
    group_trajectories()
