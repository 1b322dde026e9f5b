"""Match: is a window the same pattern in both frames, or alike by chance?

*By itself.* Windows that have nothing in common are correlated all the same, the more so as six numbers and the light
are chosen to make them so. With N independent cells of texture (`sixflow.refine.likeness`) and p = 7, ρ² has a beta
distribution then, and

    ε = −ln P(ρ² by chance),    P = I_{1−ρ²}(b, p/2) ≈ ρ^{p−2} (1 − ρ²)^b / (b B(b, p/2)),    b = (N − 1 − p)/2

is the evidence that the window matches, nats: about ½(N − p) ln 1/(1 − ρ²). Where outlying pixels are down-weighted,
the pixels that are kept are alike because the others are left out. Of patterns without anything in common κ₀ of the
texture would be kept (`engine.weigh.by_chance`); if κ is,

    ε = κ [N ln κ + ε] + (1 − κ) N ln[(1 − κ)/(1 − κ₀)].

*With its neighbours.* A window of chance lies anywhere within a cell of the texture. One that lies δ from where windows
beyond its own pixels predict it has besides

    ε' = ln [cell area/πδ²].

Independent windows add. In the square that reaches one window to all sides, points that failed having none,

    E = ⟨ε + ε'⟩ · square/window²,

while chance alone makes each of the m = square/window² windows have 1 in the mean, and all of them a sum with the
distribution Γ(m) (Fisher): −ln Γ(m; E) is what counts.

A window is a match if ε exceeds `evidence_limit` of the N places that it could have come to rest at, or if its square
does and the window itself is more like its surroundings than like chance: Fisher's z, atanh ρ, more than half of that
around it.

| symbol | name |
|---|---|
| ρ, N | `statistics.correlation`, `statistics.cells` |
| δ² | `apart` |
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from sixflow.engine.contradiction import apart_strip
from sixflow.engine.threads import over_strips
from sixflow.engine.weigh import by_chance
from sixflow.judge.chance import evidence_limit
from sixflow.refine.solution import Solution, WindowStatistics

PARAMETERS = 7
"""Six numbers and the light."""
_STRIP = 16

Array = NDArray[np.float64]


def evidence(correlation: NDArray[Any], cells: NDArray[Any]) -> Array:
    """ε of windows with a correlation and so many independent cells, nats; 0 where there is none.

    Examples
    --------
    >>> evidence(np.array([0.0, 0.5, 0.9]), np.array([100.0, 100.0, 8.0])).round(1)
    array([ 0. ,  8.3,  0. ])
    """
    a, b = PARAMETERS / 2, (np.asarray(cells, np.float64) - 1 - PARAMETERS) / 2
    with np.errstate(invalid="ignore", divide="ignore"):
        square = np.minimum(correlation, 1 - 1e-7) ** 2
        known = (b > 0) & (correlation > 0) & (square > (a - 1) / (a + b - 1))
        rising = b * np.log1p(-square) + (a - 1) * np.log(square)
        chance = rising - np.log(b) + a * np.log(b + (a - 1) / 2) - math.lgamma(a)
    return np.where(known, np.maximum(-chance, 0.0), 0.0)


def evidence_of(statistics: WindowStatistics) -> Array:
    """ε of the windows of a pass, nats; shape (rows, columns)."""
    correlation, cells = statistics.correlation, statistics.cells
    assert correlation is not None
    assert cells is not None
    alone = evidence(correlation, cells)
    if statistics.matched is None:
        return alone
    kept, chance = np.clip(statistics.matched, 0.0, 1.0), by_chance(statistics.residual)
    with np.errstate(invalid="ignore", divide="ignore"):
        lost = np.where(kept < 1, (1 - kept) * np.log((1 - kept) / (1 - np.minimum(chance, 1 - 1e-7))), 0.0)
        total = kept * (cells * np.log(kept) + alone) + cells * lost
    return np.where((kept > chance) & (total > 0), total, 0.0)


def apart(maps: NDArray[Any], variances: Array, step: int, window: float) -> Array:
    """δ²: how far each displacement is from what the maps one window away predict, px²; shape (rows, columns)."""
    out = np.empty(maps.shape[1:])
    reach = min(max(1, math.ceil(window / step)), max(1, (min(out.shape) - 1) // 2))
    over_strips(lambda a, b: apart_strip(maps, variances, reach, step, a, b, out), len(out), _STRIP)
    return out


def matches(found: Solution, known: NDArray[Any], variances: Array, step: int) -> NDArray[np.bool_]:
    """Find windows that match.

    Parameters
    ----------
    found : Solution
    known : array, shape (6, rows, columns)
        Its maps, NaN at points that failed.
    variances : array, shape (6, rows, columns)
        Of u, v, u_x, u_y, v_x, v_y.
    step : int
        Grid spacing, px.
    """
    statistics = found.statistics
    assert statistics.correlation is not None
    assert statistics.cells is not None
    alone, failed = evidence_of(statistics), np.isnan(known[0])
    with np.errstate(invalid="ignore", divide="ignore"):
        proven = alone > evidence_limit() + np.log(np.maximum(statistics.cells, 1.0))
    if (proven | failed).all():
        return proven
    window = float(np.nanmedian(found.window))
    distance = apart(known, variances, step, window)
    with np.errstate(invalid="ignore", divide="ignore"):
        area = found.window**2 * statistics.weight / statistics.cells
        together = np.nan_to_num(np.maximum(np.log(area / (math.pi * distance)), 0.0), posinf=0.0)
        height = np.arctanh(np.clip(statistics.correlation, 0.0, 1 - 1e-7))
    total = np.where(failed, 0.0, alone + together)
    side = 2 * max(1, round(window / step)) + 1
    mean, share, usual = (
        scipy.ndimage.uniform_filter(values, side, mode="constant")
        for values in (total, (~failed).astype(np.float64), np.where(failed, 0.0, np.nan_to_num(height)))
    )
    windows = (side * step / window) ** 2
    within = scipy.ndimage.uniform_filter(np.ones_like(total), side, mode="constant")
    supported = -_log_gamma_tail(np.maximum(windows * within, 1.0), windows * mean) > evidence_limit()
    with np.errstate(invalid="ignore", divide="ignore"):
        alike = height * share > usual / 2
    result: NDArray[np.bool_] = proven | (supported & alike & ~failed)
    return result


def _log_gamma_tail(shape: Array, value: Array) -> Array:
    """Logarithm of the probability that a Γ(shape) variable exceeds a value; 0 below its mean."""
    from scipy.special import gammaln

    far = value > shape
    value = np.where(far, value, shape + 1)
    # leading term of the continued fraction of the upper incomplete gamma function
    tail = -value + shape * np.log(value) - gammaln(shape) - np.log(value + 1 - shape)
    return np.where(far, np.minimum(tail, 0.0), 0.0)
