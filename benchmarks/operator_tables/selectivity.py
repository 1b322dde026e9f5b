"""Selectivity: what every operator says of the motions that are not its own.

Each generator in turn moves the pattern about the point, by the same displacement at the distance σ of the window from
it, small beside the wavelengths, without noise; u, v and σ times the τ of the other four are then in px, and
comparable. All six are measured

- literally: by each generator's own family of the default bank, every operator alone, the mean of the family
  (`LiteralEstimate.combine`), which takes no account of the other generators;
- jointly: by the whole default bank (`JointOperator`).

A row is the motion that was made, a column what was measured, in units of what was made. The mean over an ensemble of
textures tells what is left of the others on average, the rms (about 1 on the diagonal, 0 elsewhere) what a single point
suffers.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cases import show, verdict
from operator_tables.own_law import TEXTURES, moved
from sixflow.convention import SIX
from sixflow.convention.affine import SIX_PER_COEFFICIENT
from sixflow.eigenfilters import FilterBank, JointOperator, LiteralOperator, default_bank
from sixflow.engine.window import window_sigma

WINDOW = 31
DISPLACEMENT = 0.1  # px, at the distance σ
DEPARTURE = 1.0  # the hyperbolic kernels of the default bank are nearly as broad as their orders
JOINT_TARGET = 0.01
UNITS = np.where(np.arange(6) < 2, 1.0, window_sigma(WINDOW))  # px per unit of τ


class Family(NamedTuple):
    """Operators and the numbers that they are to measure."""

    bank: FilterBank
    numbers: tuple[str, ...]


def _families() -> list[Family]:
    spiral, hyperbolic = (default_bank(WINDOW, family) for family in (["spiral"], ["hyperbolic"]))
    return [
        Family(default_bank(WINDOW, ["gabor"]), ("u", "v")),
        Family(spiral, ("divergence", "curl")),
        Family(hyperbolic, ("stretch", "shear")),
    ]


def _literal(frames: tuple[Any, Any], at: list[int], operators: list[tuple[LiteralOperator, Any]]) -> Any:
    """τ of all six by their own families."""
    tau = np.empty(6)
    for operator, numbers in operators:
        found = operator.estimate(*frames, at, at).combine()
        for name in numbers:
            tau[SIX.index(name)] = found.tau[0, SIX.index(name)]
    return tau


def responses(seeds: int) -> np.ndarray:
    """Shape (2, patterns, 6, 6): literal and joint, motion made × number measured, as parts of what was made."""
    operators = [
        (LiteralOperator(family.bank, noise=0, departure=DEPARTURE), family.numbers) for family in _families()
    ]
    joint = JointOperator(default_bank(WINDOW))
    radius = joint.bank.radius
    at = [radius]
    out = np.empty((2, len(TEXTURES) * seeds, 6, 6))
    patterns = [make(seed) for make in TEXTURES.values() for seed in range(seeds)]
    for n, pattern in enumerate(patterns):
        still = moved(pattern, "u", 0.0, radius)
        for k, name in enumerate(SIX):
            frames = still, moved(pattern, name, DISPLACEMENT / UNITS[k], radius)
            six = joint.estimate(*frames, np.array(at), np.array(at)).six[0]
            out[0, n, k] = _literal(frames, at, operators)
            out[1, n, k] = six / SIX_PER_COEFFICIENT
    return out * UNITS / DISPLACEMENT


def table(quick: bool = False) -> None:
    """Print both matrices, mean and rms over the ensemble."""
    seeds = 4 if quick else 24
    literal, joint = responses(seeds)
    patterns = f"{len(literal)} patterns (speckle, particles, texture)"
    about = (
        f"of {DISPLACEMENT:g} px at the window's σ = {window_sigma(WINDOW):.3g} px "
        "(u, v: everywhere; the others: τσ), as parts of it"
    )
    mean, rms = _mean(literal), _rms(literal)
    off = mean * ~np.eye(6, dtype=bool)
    dominant = np.abs(np.diagonal(mean)) > np.abs(off).max(axis=0)
    alone = np.abs(np.diagonal(mean)) > (rms * ~np.eye(6, dtype=bool)).max(axis=0)
    read = np.isfinite(literal).mean(axis=(0, 1))
    rows = [[name, *_cells(mean[k]), *_cells(rms[k])] for k, name in enumerate(SIX)]
    rows += [
        ["dominant", *(verdict(bool(good)) for good in dominant), *map(verdict, alone.tolist())],
        ["points", *(f"{100 * share:.1f} %" for share in read), *[""] * 6],
    ]
    header = ["motion made", *SIX, "rms: u", *SIX[1:]]
    show(
        f"Selectivity, literal: the mean of each generator's own family, departure ≤ {DEPARTURE:g}; {patterns}; "
        f"motions {about}; mean, then rms error",
        header,
        rows,
    )
    mean, rms = _mean(joint), _rms(joint)
    off = ~np.eye(6, dtype=bool)
    rows = [[name, *_cells(mean[k], 4), *_cells(rms[k], 4)] for k, name in enumerate(SIX)]
    worst = [np.abs(part * off).max(axis=0) for part in (mean, rms)]
    rows.append(
        [
            f"others ≤ {100 * JOINT_TARGET:g} %",
            *(verdict(bool(w <= JOINT_TARGET)) for w in np.concatenate(worst)),
        ]
    )
    show(f"Selectivity, joint: all six from the default bank; {patterns}; motions {about}", header, rows)


def _mean(found: np.ndarray) -> np.ndarray:
    return np.nanmean(found, axis=0)


def _rms(found: np.ndarray) -> np.ndarray:
    return np.sqrt(np.nanmean((found - np.eye(6)) ** 2, axis=0))


def _cells(values: np.ndarray, digits: int = 2) -> list[str]:
    return [f"{value + 0.0:.{digits}f}" for value in values]
