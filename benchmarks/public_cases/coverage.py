"""Coverage: are the predicted standard errors the errors' own size?

(found − true)/predicted is counted over all points that are given and whose truth is known: at borders, and where the
window does not resolve the motion, too. What a window leaves out is in the standard errors.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from public_cases.scores import Comparison

Array = NDArray[Any]

BEYOND = 3.0  # standard errors: 0.27 % of normal errors exceed them
FEWEST = 100  # points, for a share


@dataclasses.dataclass(frozen=True)
class Coverage:
    """Share of errors beyond `BEYOND` standard errors and rms of error/predicted, of u, v and of the gradient.

    NaN where too few are known.
    """

    beyond: float
    rms: float
    gradient_beyond: float
    gradient_rms: float

    def cells(self) -> tuple[str, ...]:
        """Cells of a table."""
        shares, sizes = (self.beyond, self.gradient_beyond), (self.rms, self.gradient_rms)
        texts = ["–" if np.isnan(value) else f"{100 * value:.1f} %" for value in shares]
        sizes_text = ["–" if np.isnan(value) else f"{value:.2f}" for value in sizes]
        return texts[0], sizes_text[0], texts[1], sizes_text[1]


def coverage(comparison: Comparison) -> Coverage | None:
    """Count the points of a comparison; None if the method predicts no errors."""
    measured = comparison.measured
    if measured.error is None:
        return None
    with np.errstate(invalid="ignore", divide="ignore"):
        z = comparison.difference / measured.error
    parts = [_counted(z[kind][:, measured.given]) for kind in (slice(0, 2), slice(2, 6))]
    return Coverage(*parts[0], *parts[1])


def _counted(z: Array) -> tuple[float, float]:
    z = z[np.isfinite(z)]
    if z.size < FEWEST:
        return float("nan"), float("nan")
    return float((np.abs(z) > BEYOND).mean()), float(np.sqrt(np.mean(z**2)))
