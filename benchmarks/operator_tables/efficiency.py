"""Efficiency and coverage of the joint estimates, and what resolution they have.

`ratio` is the rms error over the rms of the Cramér–Rao value of the window's least-squares fit; `spread` is the rms of
error over predicted standard error, over u and v and over the four gradients. The operators' window need not be a
Gaussian: `reach` is the σ of the Gaussian that would answer a sine of displacement as they do (least squares:
window/√(4π) = 8.74 px). Where it is larger than that, a ratio below 1 is bought with resolution: noise falls with
1/reach in the displacement, with 1/reach² in the gradients.
"""

from __future__ import annotations

from typing import Any

import numpy as np

import sixflow
from cases import cramer_rao, rms, show, verdict
from operator_tables.ensemble import NOISE, SMALL, TEXTURES, WINDOW, limit, make_pair, measured
from sixflow import synth
from sixflow.convention import SIX
from sixflow.eigenfilters import FilterBank, JointOperator, PooledOperator, default_bank
from sixflow.eigenfilters.default import array_bank
from sixflow.maps.grid import Grid

TARGET, PHASE_TARGET, COVERAGE = 1.15, 2.0, (0.95, 1.05)
SIDE, POINT_SIDE = 512, 256
TINY = (0.05, -0.03, 3e-4, -4e-4, 2e-4, 1e-4)  # what one linear step can measure
POINTS = Grid(48, 48, 32, 6, 6)


def table(quick: bool = False) -> None:
    """Print the tables of efficiency, of the families, and of the reach."""
    seeds = 2 if quick else 6
    rows = []
    for name, texture in TEXTURES.items():
        for method in ("least_squares", "eigenfilter"):
            rows.append(_row(f"{name}: measure, {method}", *_fields(texture, seeds, method), TARGET))
        rows.append(
            _row(
                f"{name}: at points, eigenvalue", *_points(texture, 2 * seeds, PooledOperator(WINDOW)), TARGET
            )
        )
        phase = PooledOperator(WINDOW, phase_only=True)
        rows.append(_row(f"{name}: at points, phase", *_points(texture, 2 * seeds, phase), PHASE_TARGET))
        single = JointOperator(default_bank(WINDOW))
        rows.append(_row(f"{name}: one bank of 54, no array", *_points(texture, 2 * seeds, single), None))
    show(
        f"Efficiency: ratio to the limit, noise {NOISE:g}, window {WINDOW}; {len(array_bank(WINDOW))} kernels; "
        f"targets eigenvalue ≤ {TARGET}, phase ≤ {PHASE_TARGET:g}, spread {COVERAGE[0]} – {COVERAGE[1]}",
        ["what", "points", *SIX, "target", "spread u, v", "gradients", "target"],
        rows,
    )
    _families(2 * seeds)
    _reach(1 if quick else 3)


def _fields(texture: Any, seeds: int, method: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Errors, predicted and limiting standard errors of `measure` at points with complete windows."""
    found = []
    for seed in range(seeds):
        pattern = texture(seed)
        made = make_pair(pattern, SMALL, SIDE, NOISE, seed)
        error, predicted, flag = measured(made, method=method)
        good = flag == 0
        found.append((error[good], predicted[good], limit(pattern, SIDE, NOISE)[good]))
    errors, predicted, limits = (np.concatenate(part) for part in zip(*found, strict=True))
    return errors, predicted, limits


def _points(texture: Any, seeds: int, operator: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The same of an operator at points, with motion so small that one step suffices."""
    x, y = (a.ravel() for a in np.meshgrid(POINTS.x, POINTS.y))
    found = []
    for seed in range(seeds):
        pattern = texture(seed)
        made = make_pair(pattern, TINY, POINT_SIDE, NOISE, seed)
        estimate = operator.estimate(made.frame0, made.frame1, x, y)
        found.append(
            (
                estimate.six - made.truth(x.astype(float), y.astype(float)),
                np.sqrt(np.diagonal(estimate.covariance, axis1=1, axis2=2)),
                cramer_rao(pattern, POINT_SIDE, POINTS, WINDOW, NOISE).reshape(-1, 6),
            )
        )
    errors, predicted, limits = (np.concatenate(part) for part in zip(*found, strict=True))
    return errors, predicted, limits


def _row(
    name: str, errors: np.ndarray, predicted: np.ndarray, limits: np.ndarray, target: float | None
) -> list[Any]:
    ratio, standardised = rms(errors, 0) / rms(limits, 0), errors / predicted
    spread = [float(rms(part)) for part in (standardised[:, :2], standardised[:, 2:])]
    covered = COVERAGE[0] <= min(spread) and max(spread) <= COVERAGE[1]
    return [
        name,
        str(len(errors)),
        *(f"{r:.2f}" for r in ratio),
        "" if target is None else verdict(ratio.max() <= target),
        *(f"{s:.2f}" for s in spread),
        verdict(covered),
    ]


def _families(seeds: int) -> None:
    """What each family of kernels adds."""
    bank = array_bank(WINDOW)
    families = {
        "Gabor": ["Gabor"],
        "Gabor, spiral": ["Gabor", "Spiral"],
        "spiral, hyperbolic": ["Spiral", "Hyperbolic"],
        "Gabor, spiral, hyperbolic": ["Gabor", "Spiral", "Hyperbolic"],
    }
    rows = []
    for label, kinds in families.items():
        kernels = tuple(kernel for kernel in bank.kernels if type(kernel).__name__ in kinds)
        operator = PooledOperator(WINDOW, FilterBank(kernels, bank.radius))
        worst = []
        for texture in TEXTURES.values():
            _, predicted, limits = _points(texture, max(1, seeds // 4), operator)
            worst.append((rms(predicted, 0) / rms(limits, 0)).max())
        rows.append([label, str(len(kernels)), *(f"{value:.2f}" for value in worst)])
    show(
        "What the families contribute: predicted standard error over the limit, worst of the six",
        ["families", "kernels", *TEXTURES],
        rows,
    )


def _reach(seeds: int) -> None:
    """σ of the Gaussian that answers a sine of displacement as the method does."""
    side, period = 512, 96.0
    rows = []
    for name, texture in TEXTURES.items():
        row = [name]
        for method in ("least_squares", "eigenfilter"):
            response = []
            for seed in range(seeds):
                motion = synth.CellularVortices(amplitude=0.5, period=period)
                made = synth.pair(texture(seed), motion, (side, side))
                field = sixflow.measure(
                    made.frame0, made.frame1, window=WINDOW, method=method, tolerance=1e-3
                )
                x, y = np.meshgrid(field.x.values.astype(float), field.y.values.astype(float))
                truth = made.truth(x, y)
                good = field.flag.values[0] == 0
                for k in (0, 1, 3):
                    true, seen = truth[..., k][good], field[SIX[k]].values[0][good]
                    response.append((true * seen).sum() / (true**2).sum())
            wave = 2 * np.pi / period
            row.append(f"{np.sqrt(-2 * np.log(np.mean(response)) / (2 * wave**2)):.2f}")
        rows.append(row)
    show(
        "Reach: σ of the equivalent Gaussian window, px (window 31: 8.74)",
        ["texture", "least squares", "eigenfilter"],
        rows,
    )
