"""Coverage: are the predicted standard errors the errors' own size?

The spread of (found − true)/predicted must be 1, over complete points where the window resolves the truth. It does
not see

    t = (1 − T) d_true,   T(M) of `engine.response`, M = Gaussian mean of the window's σ, n = sharpen,

of the truth. A displacement counts as resolved if |t| is below 0.3 of its standard error for both components and
everywhere in the window; a gradient if the same holds for t's derivatives.

| symbol | name |
|---|---|
| M, σ | `gaussian_filter`, `Measured.sigma` |
| t | `unresolved` |
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from public_cases.case import Case
from public_cases.scores import Comparison
from sixflow.convention import SIX_FROM_GRADIENT
from sixflow.engine.response import quotient

RESOLVED = 0.3  # of a standard error
FEWEST = 100  # points, for a spread

Array = NDArray[Any]


def unresolved(case: Case, sigma: float, sharpen: int, x: Array, y: Array) -> Array:
    """Most that a window leaves of the true six around the points of a grid; shape (6, rows, columns)."""
    planes = []
    for plane in (case.truth.u, case.truth.v):
        smooth = partial(ndimage.gaussian_filter, sigma=sigma, truncate=3.5)
        before, here = plane, plane
        seen = quotient(sharpen)[0] * plane
        for k, coefficient in enumerate(quotient(sharpen)[1:]):
            after = 2 * smooth(here) - here
            before, here = here, after if k == 0 else 2 * after - before
            seen = seen + coefficient * here
        planes.append(plane - smooth(seen))
    maps = np.stack([*planes, *(np.gradient(plane, axis=axis) for plane in planes for axis in (1, 0))])
    six = np.abs(np.tensordot(SIX_FROM_GRADIENT, maps, axes=1))
    side = 2 * round(1.5 * sigma) + 1
    worst = np.stack([ndimage.maximum_filter(plane, side) for plane in six])
    return worst[:, y[:, None], x[None, :]]


def spreads(case: Case, comparison: Comparison) -> Array:
    """Spread of the standardised errors of the six; shape (6,), NaN where too few points are resolved."""
    measured = comparison.measured
    if measured.error is None or np.isnan(case.truth.u).any():
        return np.full(6, np.nan)
    left = unresolved(case, measured.sigma, measured.sharpen, measured.x, measured.y)
    out = np.full(6, np.nan)
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = comparison.difference / measured.error
        seen = left < RESOLVED * measured.error
    for kind in (slice(0, 2), slice(2, 6)):
        use = measured.complete & seen[kind].all(axis=0) & np.isfinite(ratio[kind]).all(axis=0)
        if use.sum() >= FEWEST:
            out[kind] = ratio[kind][:, use].std(axis=1)
    return out
