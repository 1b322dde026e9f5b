"""Errors of the points of a region: what each part of them adds to a fit, and what none of them explains.

The whitened errors of the points are a sum of independent parts, each of a scatter S_p at every point and a
correlation R between points,

    K_pq = Σ_parts S_p R_pq S_qᵀ.

| part | S_p | R falls over |
|---|---|---|
| noise | W_p^½ C_p^½ | a window (`correlation`) |
| what windows leave out | W_p^½ B_p^½ | P/2π, P the period that the windows attenuate by 10 % |
| what the model leaves out | s W_p^½ diag(1, σ/√2L, …) | L |

A wave of the period P has the autocorrelation 1 − (2πd/P)²/4 … in the plane, which is that of exp(−d²/4L²) with L =
P/2π. Windows leave out what is of the period P and less: it does not average down over less than that.

*What the model leaves out.* Let q = Pr be the whitened residuals, P = I − QQᵀ what a fit leaves. Their power |q|² and
their power in slow waves qᵀK_l q, with K_l the last part of s = 1 and the longest wave that fits into the region, L =
extent/2π, have the expected values tr PK and tr K_l PKP. Where one of them exceeds its own by more than three standard
errors, the region does not move as the model says. Of the lengths from a window to the longest, that L is taken whose
ratio of both powers is nearest to that of the excesses, and s such that neither excess is larger than it explains. Slow
deviations are mostly taken for motion, and what is left of them is small: multiplying covariances by the misfit would
take them for so much noise, which averages out over a region, and they do not.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.interpretation.correlation import Correlation

Array = NDArray[Any]

SUSPECT = 3.0
"""Standard errors by which a power may exceed what is expected of it."""

_PROBES = 24


@dataclasses.dataclass(frozen=True)
class Part:
    """One part of the errors of points.

    Attributes
    ----------
    scatter : array, shape (n, 6, 6)
    correlation : Correlation
    """

    scatter: Array
    correlation: Correlation


class Scatter:
    """The errors of the points of a region.

    Parameters
    ----------
    used : bool array, shape (rows, columns)
        With n points.
    parts : sequence of Part
    """

    def __init__(self, used: NDArray[np.bool_], parts: Sequence[Part]) -> None:
        self.used, self.parts = used, tuple(parts)

    def correlate(self, values: Array, part: Part) -> Array:
        """R of a part times columns of numbers at the points, shape (n, 6, k)."""
        grid = np.zeros((*self.used.shape, 6, values.shape[-1]))
        grid[self.used] = values
        return part.correlation.apply(grid)[self.used]

    def apply(self, values: Array) -> Array:
        """K times columns of numbers, shape (6n, k)."""
        out = np.zeros(values.shape)
        for part in self.parts:
            turned = np.swapaxes(part.scatter, 1, 2) @ values.reshape(-1, 6, values.shape[1])
            out += (part.scatter @ self.correlate(turned, part)).reshape(values.shape)
        return out

    def meat(self, Q: Array) -> Array:
        """QᵀKQ, shape (k, k)."""
        meat = Q.T @ self.apply(Q)
        return np.asarray((meat + meat.T) / 2)

    def power(self, Q: Array) -> float:
        """The expected |q|², tr PKP."""
        whole = sum(float((part.scatter**2).sum()) for part in self.parts)
        return whole - float(np.trace(self.meat(Q)))


def probes(Q: Array) -> Array:
    """Random signs less their projections on a fit, shape (6n, probes)."""
    z = np.random.default_rng(0).choice([-1.0, 1.0], (len(Q), _PROBES))
    return np.asarray(z - Q @ (Q.T @ z))


def power_spread(scatter: Scatter, Q: Array, z: Array) -> float:
    """√(2 tr (PKP)²), the standard deviation of |q|², by the mean of |PKz|² over probes z."""
    seen = scatter.apply(z)
    seen -= Q @ (Q.T @ seen)
    return math.sqrt(2 * float((seen**2).sum()) / z.shape[1])


@dataclasses.dataclass(frozen=True)
class Excess:
    """What a model leaves out, as a part of the errors.

    Attributes
    ----------
    scatter : Scatter
        s = 1.
    size : float
        s².
    length : float
        L, px.
    """

    scatter: Scatter
    size: float
    length: float


def unexplained(
    scatter: Scatter, left: Array, Q: Array, candidates: Sequence[tuple[float, Scatter]], significant: bool
) -> Excess | None:
    """What the errors of the points do not explain of the residuals; None if that is nothing.

    Parameters
    ----------
    scatter : Scatter
        All parts that are known.
    left : array, shape (6n,)
        q.
    Q : array, shape (6n, k)
        Orthonormal directions of the fit.
    candidates : sequence of (L, Scatter)
        From short to long.
    significant : bool
        Whether |q|² is too large already.
    """
    if len(left) <= Q.shape[1]:
        return None  # nothing is left over
    slow = candidates[-1][1]
    z = probes(Q)
    seen = slow.apply(z)  # K_l P z
    explained = scatter.apply(z)
    explained -= Q @ (Q.T @ explained)
    expected_slow = float((seen * explained).sum()) / z.shape[1]
    # Var qᵀK_l q = 2 tr (K_l PKP)², of which |PK P K_l P z|² is the trace without the order of its factors
    twice = scatter.apply(seen - Q @ (Q.T @ seen))
    twice -= Q @ (Q.T @ twice)
    spread_slow = math.sqrt(max(0.0, 2 * float((twice * _turned(scatter, slow, Q, z)).sum()) / z.shape[1]))
    excess_slow = float(left @ slow.apply(left[:, None])[:, 0]) - expected_slow
    if not significant and excess_slow <= SUSPECT * spread_slow:
        return None
    excess = float(left @ left) - scatter.power(Q)
    found = []
    for length, candidate in candidates:
        moved = candidate.apply(z)
        moved -= Q @ (Q.T @ moved)
        found.append((length, candidate, candidate.power(Q), float((seen * moved).sum()) / z.shape[1]))
    ratios = np.log([slow_power / power for _, _, power, slow_power in found])
    wanted = math.log(excess_slow / excess) if min(excess, excess_slow) > 0 else np.inf * excess_slow
    length, candidate, power, slow_power = found[
        int(np.abs(ratios - np.clip(wanted, *ratios[[0, -1]])).argmin())
    ]
    return Excess(candidate, max(excess / power, excess_slow / slow_power), length)


def _turned(scatter: Scatter, slow: Scatter, Q: Array, z: Array) -> Array:
    """K_l PKP z, whose product with PKP K_l z has the mean tr (K_l PKP)²."""
    seen = scatter.apply(z)
    seen -= Q @ (Q.T @ seen)
    return slow.apply(seen)
