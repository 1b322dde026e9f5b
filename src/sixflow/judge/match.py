"""Match: is a window the same pattern in both frames, or alike by chance?

*By itself*, ε nats of evidence tell (`sixflow.refine.likeness`).

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
from sixflow.judge.chance import evidence_limit
from sixflow.refine.likeness import evidence_of
from sixflow.refine.solution import Solution

_STRIP = 16

Array = NDArray[np.float64]


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
