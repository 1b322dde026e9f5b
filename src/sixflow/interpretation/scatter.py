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
extent/2π, have the expected values tr PK and tr K_l PKP and standard deviations by chance d. An excess e over the
expected value is taken for [1 − d²/e²]₊ e, as in James and Stein's estimate: what chance makes counts little, what it
cannot make counts whole. Of the lengths from a window to the longest, that L is taken whose ratio of both powers is
nearest to that of the excesses, and s such that neither excess is larger than it explains. Slow deviations are mostly
taken for motion, and what is left of them is small: multiplying covariances by the misfit would take them for so much
noise, which averages out over a region, and they do not. Where an excess is beyond chance (`sixflow.chance`), the
region does not move as the model says.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.chance import normal_limit
from sixflow.interpretation.correlation import Correlation

Array = NDArray[Any]

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


@dataclasses.dataclass(frozen=True)
class Power:
    """A power of the residuals beside what is expected of it.

    Attributes
    ----------
    found, expected, spread : float
        By chance it scatters by `spread`.
    """

    found: float
    expected: float
    spread: float

    @property
    def excess(self) -> float:
        """[1 − d²/e²]₊ e, at least 0."""
        over = self.found - self.expected
        return max(0.0, over - self.spread**2 / over) if over > 0 else 0.0

    @property
    def by_chance(self) -> bool:
        """Whether chance makes it as large; two are asked for."""
        return self.found <= self.expected + normal_limit(2) * self.spread


def power_of(scatter: Scatter, left: Array, Q: Array) -> Power:
    """|q|², scattering by √(2 tr (PKP)²): the mean of |PKz|² over probes z."""
    z = probes(Q)
    seen = scatter.apply(z)
    seen -= Q @ (Q.T @ seen)
    spread = math.sqrt(2 * float((seen**2).sum()) / z.shape[1])
    return Power(float(left @ left), scatter.power(Q), spread)


@dataclasses.dataclass(frozen=True)
class Excess:
    """What a model leaves out, as a part of the errors.

    Attributes
    ----------
    scatter : Scatter
        s = 1.
    size : float
        s².
    by_chance : bool
        Whether chance makes as much.
    """

    scatter: Scatter
    size: float
    by_chance: bool


def unexplained(
    scatter: Scatter, left: Array, Q: Array, power: Power, candidates: Sequence[Scatter]
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
    power : Power
        |q|².
    candidates : sequence of Scatter
        Of s = 1, from short L to long.
    """
    if len(left) <= Q.shape[1]:
        return None  # nothing is left over
    slow, z = candidates[-1], probes(Q)

    def seen(by: Scatter, values: Array) -> Array:
        found = by.apply(values)
        return np.asarray(found - Q @ (Q.T @ found))

    # Var qᵀK_l q = 2 tr (AB)², A = P K_l P, B = PKP, by the mean of (BAz)·(ABz)
    slowly, known = seen(slow, z), seen(scatter, z)
    product = float((seen(scatter, slowly) * slow.apply(known)).sum()) / z.shape[1]
    in_slow = Power(
        float(left @ slow.apply(left[:, None])[:, 0]),
        float((slowly * known).sum()) / z.shape[1],
        math.sqrt(max(0.0, 2 * product)),
    )
    if power.excess == 0 and in_slow.excess == 0:
        return None
    powers = np.array([one.power(Q) for one in candidates])
    slow_powers = np.array([float((slowly * seen(one, z)).sum()) / z.shape[1] for one in candidates])
    ratios = slow_powers / powers
    wanted = in_slow.excess / power.excess if power.excess > 0 else np.inf
    k = int(np.abs(np.log(ratios / np.clip(wanted, ratios.min(), ratios.max()))).argmin())
    size = max(power.excess / powers[k], in_slow.excess / slow_powers[k])
    return Excess(candidates[k], float(size), power.by_chance and in_slow.by_chance)
