"""Noise: all methods on the same frames, from a signal-to-noise ratio of 40 dB down to −6 dB.

The ratio is that of the pattern's standard deviation to the noise's, in one frame. Every method is judged on the points
that it declares valid, away from the borders, by its rms error over the rms of the Cramér–Rao value of the
window there. A ratio below 1 at low signal-to-noise is no merit where the method answers too little: `response` is
the slope of the measured displacement on the true one, 1 if it is right, 0 if noise has drawn it to nothing.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from cases import make_pair, rms, show, verdict
from operator_tables.ensemble import STEP, TEXTURES, WINDOW, limit, measured
from sixflow.eigenfilters.historical import differentiated_flow, fleet_jepson, gradient_ratio
from sixflow.maps.grid import Grid

SIDE, MARGIN = 320, 6  # px; grid points left out at every border
LEVELS = (40, 30, 20, 15, 10, 6, 3, 0, -3, -6)
MOTION = (0.3, -0.2, 0.003, -0.004, 0.002, 0.0015)  # at most 0.9 px in the corners
TARGET, DOWN_TO = 1.5, 6  # ratio; dB
PARTS = {"u, v": slice(0, 2), "gradients": slice(2, 6)}
RESPONSE = "response"


def methods() -> dict[str, Any]:
    """Error and validity of every method on a pair, by name; both on the grid of `measure`."""

    def ours(method: str) -> Any:
        def run(made: Any) -> tuple[np.ndarray, np.ndarray]:
            error, _, flag = measured(made, method=method)
            return error, flag == 0

        return run

    def theirs(method: Any) -> Any:
        def run(made: Any) -> tuple[np.ndarray, np.ndarray]:
            field = method(made.frame0, made.frame1, grid_step=STEP, window=float(WINDOW))
            x, y = np.meshgrid(field.x.astype(float), field.y.astype(float))
            return field.six - made.truth(x, y), field.valid

        return run

    return {
        "least squares": ours("least_squares"),
        "eigenfilter": ours("eigenfilter"),
        "gradient ratio": theirs(gradient_ratio),
        "Fleet–Jepson": theirs(fleet_jepson),
        "differentiated flow": theirs(differentiated_flow),
    }


def table(quick: bool = False, folder: Path | None = None) -> None:
    """Print one table per texture; with a folder, draw the curves there."""
    for name, texture in TEXTURES.items():
        found = _sweep(texture, (0,) if quick else (0, 1, 2))
        rows = []
        for method in methods():
            for part in (*PARTS, RESPONSE):
                cells = [_cell(*found[method, level, part]) for level in LEVELS]
                rows.append([f"{method}: {part}", *cells])
        show(
            f"Noise, {name}: error over the limit (share of valid points, if not all), and response",
            ["dB", *map(str, LEVELS)],
            rows,
        )
        worst = max(
            found["eigenfilter", level, part][0] for level in LEVELS if level >= DOWN_TO for part in PARTS
        )
        share = min(found["eigenfilter", level, "u, v"][1] for level in LEVELS if level >= DOWN_TO)
        good = worst <= TARGET and share > 0.99
        show(
            f"Eigenfilter down to {DOWN_TO} dB, target ≤ {TARGET}",
            ["texture", "worst ratio", "least share of valid points", ""],
            [[name, f"{worst:.2f}", f"{share:.1%}", verdict(good)]],
        )
        if folder is not None:
            _draw(name, found, folder)


def _cell(value: float, share: float) -> str:
    if not np.isfinite(value):
        return "–"
    return f"{value:.2f}" + ("" if share > 0.995 else f" ({share:.0%})")


def _sweep(texture: Any, seeds: tuple[int, ...]) -> dict[tuple[str, float, str], tuple[float, float]]:
    """Value and share of valid points by method, level and part."""
    inner = slice(MARGIN, -MARGIN)
    found = {}
    for level in LEVELS:
        pairs = []
        for seed in seeds:
            pattern = texture(seed)
            contrast = make_pair(pattern, MOTION, SIDE, 0, seed).frame0.std()
            noise = contrast * 10 ** (-level / 20)
            made = make_pair(pattern, MOTION, SIDE, noise, seed)
            grid = Grid.over((SIDE, SIDE), STEP)
            x, y = np.meshgrid(grid.x.astype(float), grid.y.astype(float))
            pairs.append((made, limit(pattern, SIDE, noise)[inner, inner], made.truth(x, y)[inner, inner]))
        for method, run in methods().items():
            parts = []
            for made, bound, truth in pairs:
                error, valid = (array[inner, inner] for array in run(made))
                parts.append((error[valid], bound[valid], truth[valid], valid.ravel()))
            error, bound, truth, valid = (np.concatenate(part) for part in zip(*parts, strict=True))
            enough, share = len(error) >= 30, float(valid.mean())
            for part, at in PARTS.items():
                ratio = rms(error[:, at]) / rms(bound[:, at]) if enough else np.nan
                found[method, level, part] = (float(ratio), share)
            true, off = truth[:, :2], error[:, :2]
            slope = 1 + (true * off).sum() / (true**2).sum() if enough else np.nan
            found[method, level, RESPONSE] = (float(slope), share)
    return found


def _draw(name: str, found: Any, folder: Path) -> None:
    """Errors and shares against the signal-to-noise ratio."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.6, 2.8), layout="constrained")
    axes = figure.subplots(1, 4)
    colours = ("#0072b2", "#d55e00", "#999999", "#009e73", "#cc79a7")
    for method, colour in zip(methods(), colours, strict=True):
        style = {"color": colour, "marker": "o", "markersize": 3, "linewidth": 1.2, "label": method}
        for axis, part in zip(axes, PARTS, strict=False):
            axis.plot(LEVELS, [found[method, level, part][0] for level in LEVELS], **style)
        axes[2].plot(LEVELS, [found[method, level, RESPONSE][0] for level in LEVELS], **style)
        axes[3].plot(LEVELS, [100 * found[method, level, RESPONSE][1] for level in LEVELS], **style)
    for axis, part in zip(axes, PARTS, strict=False):
        axis.axhline(1, color="black", linewidth=0.8, linestyle="--")
        axis.set(yscale="log", ylim=(0.7, 100), title=f"{part}: error over the limit")
    axes[2].axhline(1, color="black", linewidth=0.8, linestyle="--")
    axes[2].set(ylim=(-0.03, 1.15), title="response of u, v")
    axes[3].set(ylim=(-3, 103), title="valid points (%)")
    for axis in axes:
        axis.set(xlim=(max(LEVELS) + 1, min(LEVELS) - 1), xlabel="signal-to-noise ratio (dB)")
        axis.title.set_fontsize(9)
        axis.grid(alpha=0.3, linewidth=0.5)
    figure.suptitle(name, fontsize=9)
    figure.legend(
        *axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=5, fontsize=7, frameon=False
    )
    figure.savefig(folder / f"noise-{name.split()[0]}.png", dpi=200)
