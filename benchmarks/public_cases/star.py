"""Noise × resolution on the star of the DIC Challenge 2.0.

Its motion is v = A cos(2π (y − y0)/p), u = 0, with a period p that grows from left to right. The response at a
period is the slope of what was measured against the truth,

    T(p) = Σ v v_true / Σ v_true²,

over the columns whose period is within 5 % of p and the rows within one and a half periods of the middle row, where
the wave runs straight down. The period at 10 % attenuation, P, is where T, from long periods to short, first falls
below 0.9. Noise is the rms of u and, for the gradient, of u_x and u_y, whose truth is 0, over the columns of
periods longer than P. A window of side L has noise ∝ 1/L and P ∝ L: their product tells a better method from a
larger window. For a gradient noise ∝ 1/L², and the product is noise × P².

| symbol | name |
|---|---|
| T | `response` |
| P | `period` |
| noise × P, noise × P² | `efficiency` |
"""

from __future__ import annotations

import dataclasses
import itertools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from public_cases.scores import Comparison
from sixflow.convention import GRADIENT_FROM_SIX

PERIODS = np.geomspace(16, 285, 120)
SPREAD = 0.05
NEAR = 1.5  # periods
ATTENUATED = 0.9

Array = NDArray[Any]


@dataclasses.dataclass(frozen=True)
class Resolution:
    """Response, period at 10 % attenuation (px), noise, and noise × period (× period² for a gradient)."""

    response: Array
    period: float
    noise: float
    efficiency: float


def is_star(case_name: str) -> bool:
    """Whether a case is the star, by its name."""
    return "star" in case_name


def local_period(truth_v: Array, columns: Array) -> Array:
    """Period of each column, px, from the truth itself: a straight line through the periods that its cosine shows.

    Parameters
    ----------
    truth_v : float array, shape (height, width)
    columns : array
        Where the period is wanted.
    """
    height, width = truth_v.shape
    rows = np.arange(height) - height // 2
    slope, offset = np.polyfit([0, width - 1], [_period(truth_v[:, k], rows) for k in (0, width - 1)], 1)
    return slope * columns + offset


def _period(column: Array, rows: Array) -> float:
    """Period of A cos(2π y/p) from its curvature in the middle: v'' = −(2π/p)² v, by the cosine's identity.

    v(h) + v(−h) = 2 v(0) cos(2π h/p) holds for any h; the shortest h with a cosine near 0 is the best conditioned.
    """
    middle = int(np.flatnonzero(rows == 0)[0])
    reach = np.arange(1, middle + 1)
    cosine = (column[middle + reach] + column[middle - reach]) / (2 * column[middle])
    quarter = int(np.flatnonzero(cosine < 0.5)[0])
    return float(2 * np.pi * reach[quarter] / np.arccos(cosine[quarter]))


def resolutions(comparison: Comparison, truth_v: Array) -> tuple[Resolution, Resolution]:
    """Resolution of v, and of its derivative v_y."""
    measured = comparison.measured
    period = local_period(truth_v, measured.x)
    middle = truth_v.shape[0] // 2
    near = np.abs(measured.y[:, None] - middle) <= NEAR * period
    found = np.tensordot(GRADIENT_FROM_SIX, measured.six, axes=1)
    true = np.tensordot(GRADIENT_FROM_SIX, comparison.truth, axes=1)
    return (
        _resolution(found[1], true[1], found[:1], near, period, 1),
        _resolution(found[5], true[5], found[2:4], near, period, 2),
    )


def _resolution(
    found: Array, true: Array, still: Array, near: NDArray[np.bool_], period: Array, power: int
) -> Resolution:
    """Resolution of one number; `still` are numbers of the same kind whose truth is 0."""
    use = near & np.isfinite(found) & np.isfinite(true)
    product = np.where(use, found * true, 0).sum(axis=0)
    square = np.where(use, true * true, 0).sum(axis=0)
    response = np.full(PERIODS.shape, np.nan)
    for k, wanted in enumerate(PERIODS):
        band = np.abs(period / wanted - 1) <= SPREAD
        if square[band].sum() > 0:
            response[k] = product[band].sum() / square[band].sum()
    shortest = _first_below(response)
    quiet = still[:, :, period > shortest] if np.isfinite(shortest) else still[:, :, :0]
    values = quiet[np.isfinite(quiet)]
    noise = float(np.sqrt((values**2).mean())) if values.size else np.nan
    return Resolution(response, shortest, noise, noise * shortest**power)


def _first_below(response: Array) -> float:
    """Period where the response, from long to short, first falls below 0.9; NaN if it starts below, or never falls."""
    known = np.flatnonzero(np.isfinite(response))[::-1]
    if not known.size or response[known[0]] < ATTENUATED:
        return np.nan
    for before, here in itertools.pairwise(known):
        if response[here] < ATTENUATED:
            share = (ATTENUATED - response[here]) / (response[before] - response[here])
            return float(PERIODS[here] + share * (PERIODS[before] - PERIODS[here]))
    return np.nan
