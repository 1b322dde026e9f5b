"""Capture range: how large a motion is found, at one scale and with the pyramid.

Each generator alone moves the pattern about the point by a growing τ, in one direction for even seeds and in the other
for odd ones, without noise. A point counts if u and v are within 0.1 px, the other four within 0.01 of the truth, and
the point is accepted (`Captured.converged`; not failed in the field).

- *One scale*: `capture` at the centre of the frame.
- *Pyramid*: `measure(method="eigenfilter")` with the levels that it chooses itself, and what it does when these do not
  help, at the nine central points of a frame of 257 × 257 px. All of it moves, and the further from the centre, the
  more.

A second table has harder cases: all six at once, noise, and frames that have nothing to do with each other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cases import rms, show, verdict
from large_motion.capture import Captured, capture
from operator_tables.own_law import TEXTURES
from sixflow import measure, synth
from sixflow.convention import SIX, six_from_coefficients

WINDOW, RADIUS, PYRAMID_RADIUS, STEP = 31, 80, 128, 16
SHIFT_ERROR, GRADIENT_ERROR = 0.1, 0.01
TARGET = 0.95
MARKS = (("#0072b2", "o", 7.0), ("#d55e00", "s", 4.5), ("#009e73", "^", 2.6))  # colour, marker, size


class Motion(NamedTuple):
    """Sizes of the motion of one generator, in its own unit, and what they are in τ."""

    label: str
    unit: str
    sizes: tuple[float, ...]
    pyramid: tuple[float, ...]
    target: float
    reach: float | None

    def tau(self, size: float) -> float:
        """τ of the generator."""
        if self.label == "divergence":
            return math.log(size)
        if self.label == "curl":
            return math.radians(size)
        return size if self.unit == "px" else math.asinh(size / 2)


_SHIFTS = (10.5, 20, 30, 40), (10.5, 60, 100), 10.5, float(WINDOW)
_SHEARS = (0.2, 0.5, 1.0, 2.0), (0.2, 0.5, 1.0), 0.2, 2 * math.sinh(0.5)
MOTIONS = (
    Motion("u", "px", *_SHIFTS),
    Motion("v", "px", *_SHIFTS),
    Motion(
        "divergence",
        "zoom, or 1/zoom",
        (1.34, 1.7, 2.0, 3.0),
        (1.34, 1.7, 2.0),
        1.34,
        2.0,
    ),
    Motion("curl", "°", (30, 60, 120, 180), (10, 30, 60), 30, None),
    Motion("stretch", "", *_SHEARS),
    Motion("shear", "", *_SHEARS),
)
"""The targets are half of the longest wavelength of the bank (21 px), a zoom of 0.75 to 1.33, 30°, and 0.2."""


def six_of(motion: Motion, size: float, sign: int) -> np.ndarray:
    """The six of a motion along one generator."""
    coefficients = np.zeros(6)
    coefficients[SIX.index(motion.label)] = sign * motion.tau(size)
    return six_from_coefficients(coefficients)


def moved(pattern: Any, six: np.ndarray, radius: int) -> np.ndarray:
    """Frame 1, moved by the six about the middle."""
    return synth.render(
        pattern, (2 * radius + 1,) * 2, synth.Affine.from_six(tuple(six), centre=(radius, radius))
    )


def right(found: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Whether the six are right."""
    error = np.abs(found - truth)
    return (error[..., :2] < SHIFT_ERROR).all(axis=-1) & (error[..., 2:] < GRADIENT_ERROR).all(axis=-1)


def at_one_scale(motion: Motion, sizes: Sequence[float], patterns: Sequence[Any]) -> np.ndarray:
    """Whether the motion was found, and whether a wrong one was accepted; shape (2, sizes, patterns)."""
    out = np.zeros((2, len(sizes), len(patterns)), dtype=bool)
    for n, pattern in enumerate(patterns):
        still = moved(pattern, np.zeros(6), RADIUS)
        for k, size in enumerate(sizes):
            six = six_of(motion, size, (-1) ** n)
            found = capture(still, moved(pattern, six, RADIUS), [RADIUS], [RADIUS], window=WINDOW)
            good, accepted = right(found.six, six)[0], found.converged[0]
            out[:, k, n] = good & accepted, accepted & ~good
    return out


def with_pyramid(motion: Motion, sizes: Sequence[float], patterns: Sequence[Any]) -> np.ndarray:
    """Share of the central points at which the motion was found; shape (sizes, patterns)."""
    centre, side = (PYRAMID_RADIUS, PYRAMID_RADIUS), 2 * PYRAMID_RADIUS + 1
    out = np.zeros((len(sizes), len(patterns)))
    for n, pattern in enumerate(patterns):
        for k, size in enumerate(sizes):
            truth = synth.Affine.from_six(tuple(six_of(motion, size, (-1) ** n)), centre=centre)
            made = synth.pair(pattern, truth, (side, side))
            field = measure(made.frame0, made.frame1, method="eigenfilter", window=WINDOW, step=STEP).isel(
                time=0
            )
            near = {axis: np.abs(field[axis].values - PYRAMID_RADIUS) < 1.5 * STEP for axis in ("x", "y")}
            field = field.isel(near)
            x, y = np.meshgrid(field.x.values.astype(float), field.y.values.astype(float))
            found = np.stack([field[name].values for name in SIX], axis=-1)
            out[k, n] = right(found, made.truth(x, y)).mean()
    return out


def hard(patterns: Sequence[Any], others: Sequence[Any]) -> list[list[str]]:
    """Rows of the second table for one texture."""
    rng = np.random.default_rng(0)
    most = np.array([10.5, 10.5, math.log(4 / 3), math.radians(30), 0.1, 0.1])
    rows = []
    for name, part, decibel in (
        ("half", 0.5, math.inf),
        ("all", 1.0, math.inf),
        ("half, 6 dB", 0.5, 6.0),
        ("half, 0 dB", 0.5, 0.0),
    ):
        seen = []
        for pattern in patterns:
            tau = rng.uniform(-part, part, 6) * most
            six = six_from_coefficients(tau)
            six[:2] = tau[:2]
            frames = [moved(pattern, motion, RADIUS) for motion in (np.zeros(6), six)]
            noise = frames[0].std() * 10 ** (-decibel / 20)
            frames = [frame + noise * rng.normal(size=frame.shape) for frame in frames]
            seen.append((six, capture(*frames, [RADIUS], [RADIUS], window=WINDOW)))
        shares, ratio = _judged(seen)
        cells = [f"{100 * share:.0f} %" for share in shares]
        rows.append([f"all six, {name}", *cells, f"{ratio:.2f}" if noise else "–"])
    accepted = []
    for pair in zip(patterns, others, strict=True):
        frames = [moved(pattern, np.zeros(6), RADIUS) for pattern in pair]
        accepted.append(capture(*frames, [RADIUS], [RADIUS], window=WINDOW).converged[0])
    return [*rows, ["unrelated frames", f"{100 * np.mean(accepted):.0f} %", "–", "–", "–"]]


def _judged(seen: list[tuple[np.ndarray, Captured]]) -> tuple[list[float], float]:
    """Shares that are accepted, accepted and roughly right, accepted and wrong; errors over the predicted ones."""
    accepted = np.array([found.converged[0] for _, found in seen])
    error = np.array([found.six[0] - six for six, found in seen])
    near = (np.abs(error[:, :2]) < 1).all(axis=1) & (np.abs(error[:, 2:]) < 0.1).all(axis=1)
    predicted = np.sqrt([np.diagonal(found.covariance[0]) for _, found in seen])
    both = accepted & near
    ratio = rms(error[both] / predicted[both]) if both.any() else math.nan
    return [share.mean() for share in (accepted, both, accepted & ~near)], ratio


Curves = dict[tuple[str, str], tuple[list[float], np.ndarray]]


def table(quick: bool = False, folder: Path | None = None) -> None:
    """Print the tables; draw `capture.png` into the folder if one is given."""
    seeds, pyramid_seeds = (2, 1) if quick else (8, 2)
    keep, coarse_keep = (slice(0, 3, 2), slice(0, 1)) if quick else (slice(None), slice(None))
    patterns = {name: [make(seed) for seed in range(seeds)] for name, make in TEXTURES.items()}
    wide: Curves = {}
    deep: Curves = {}
    wrong = []
    for motion in MOTIONS:
        for name, own in patterns.items():
            sizes, coarse = list(motion.sizes[keep]), list(motion.pyramid[coarse_keep])
            found = at_one_scale(motion, sizes, own)
            wide[motion.label, name] = sizes, found[0].mean(axis=1)
            wrong.append(found[1])
            deep[motion.label, name] = coarse, with_pyramid(motion, coarse, own[:pyramid_seeds]).mean(axis=1)
    rule = f"u, v within {SHIFT_ERROR:g} px, the others within {GRADIENT_ERROR:g}, and accepted"
    _show_curves(f"Capture at one scale, window {WINDOW}, {seeds} patterns of each kind: {rule}", wide)
    share = np.concatenate([part.ravel() for part in wrong]).mean()
    side = 2 * PYRAMID_RADIUS + 1
    _show_curves(
        f"Capture with the pyramid, frames of {side}², {pyramid_seeds} patterns of each kind × 9 points: {rule}",
        deep,
    )
    header = ["motion", "texture", "accepted", "right", "wrong, yet accepted", "error / predicted"]
    rows = [["all of the first table", "all", "–", "–", f"{100 * share:.2f} %", "–"]]
    for name, make in TEXTURES.items():
        rows += [
            [motion, name, *cells]
            for motion, *cells in hard(patterns[name], [make(seed + 1000) for seed in range(seeds)])
        ]
    show(
        "Capture at one scale of harder cases: all six at random, up to the targets or to half of them; noise in both "
        "frames, as signal to noise; right: within 1 px and 0.1",
        header,
        rows,
    )
    if folder is not None:
        _draw(wide, deep, Path(folder) / "capture.png")


def _show_curves(title: str, curves: Curves) -> None:
    rows = []
    most = max(len(sizes) for sizes, _ in curves.values())
    for motion in MOTIONS:
        for name in TEXTURES:
            sizes, shares = curves[motion.label, name]
            cells = [f"{size:g}: {100 * share:.0f}" for size, share in zip(sizes, shares, strict=True)]
            low = np.flatnonzero(shares < TARGET)
            reached = sizes[low[0] - 1] if low.size and low[0] else 0 if low.size else sizes[-1]
            unit = f", {motion.unit}" if motion.unit else ""
            rows.append(
                [
                    f"{motion.label}{unit}",
                    name,
                    *cells,
                    *[""] * (most - len(cells)),
                    f"{reached:g}",
                    f"{motion.target:g}",
                    verdict(reached >= motion.target),
                ]
            )
    show(
        title,
        ["motion", "texture", "size: %", *[""] * (most - 1), f"≥ {100 * TARGET:.0f} % to", "target", ""],
        rows,
    )


def _draw(wide: Curves, deep: Curves, path: Path) -> None:
    """Six panels: success against the size of the motion; the grey range is where `capture` looks."""
    from sixflow.drawing.look import FONT, INK, MASKED_FACE, new_figure, tidy

    figure = new_figure(7.6, 4.6)
    axes = figure.subplots(2, 3, sharey=True)
    units = {"px": "shift, px", "°": "turn, °"}
    for ax, motion in zip(axes.flat, MOTIONS, strict=True):
        unit = units.get(motion.unit, motion.unit or motion.label)
        tidy(ax, title=motion.label, x_label=unit, y_label="found, %" if ax in axes[:, 0] else "")
        far = max(*motion.sizes, *motion.pyramid) * 1.04
        ax.axvspan(0, min(motion.reach or far, far), color=MASKED_FACE, alpha=0.45, linewidth=0)
        ax.axvline(motion.target, color=INK, linewidth=0.7, linestyle=":")
        for curves, style, label in ((wide, "-", "one scale"), (deep, "--", "pyramid")):
            for name, (colour, marker, size) in zip(TEXTURES, MARKS, strict=True):
                sizes, shares = curves[motion.label, name]
                ax.plot(
                    sizes,
                    100 * shares,
                    style,
                    color=colour,
                    linewidth=1.0,
                    marker=marker,
                    markersize=size,
                    markerfacecolor="none",
                    markeredgewidth=0.9,
                    label=f"{name}, {label}",
                )
        ax.set(xlim=(1 if motion.label == "divergence" else 0, far), ylim=(-5, 107))
        ax.set_yticks([0, 25, 50, 75, 100])
    figure.legend(
        *axes[0, 0].get_legend_handles_labels(),
        loc="outside lower center",
        ncols=2,
        fontsize=FONT,
        frameon=False,
    )
    figure.savefig(path, dpi=300)
