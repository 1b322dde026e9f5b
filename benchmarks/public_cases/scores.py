"""Measures of one field against the truth of its case.

With d the difference between a displacement and its truth:

| measure | meaning |
|---|---|
| end-point error | mean length of d over the points that are given, px |
| rms | of one component, over the complete points: √(mean d²/2), px |
| gradient | rms error of one component of the displacement gradient, over the complete points |
| angle | mean angle between (u, v, 1) and its truth, degrees (Barron et al. 1994) |
| valid | share of the points with known truth that are given |
| wrong | share of the given points that are wrong by more than 0.3 px and more than 5 predicted standard errors |
| textured | share of the textured points inside both frames that are given and right to 0.3 px |
| outside | share of the points without a known truth that are given |

*Given* is a point that has a number: for ours, one with no flag, or with the flag `border` alone, whose number
stands. *Complete* is one without any flag; for peers, one more than
16 px from the border. A point is *textured* if one grey level of noise in both frames would
move the fit of a Gaussian window of 16 px by less than 0.02 px in its worst direction: √2/(16 √λ) with λ the least
eigenvalue of the mean of ∇I ∇Iᵀ.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from public_cases.case import Case
from public_cases.measured import Measured
from sixflow.convention import SIX_FROM_GRADIENT
from sixflow.engine.window import window_sigma

WRONG, WRONG_ERRORS = 0.3, 5.0  # px, predicted standard errors
TEXTURE_WINDOW, TEXTURE_ERROR = 16, 0.02  # px

Array = NDArray[Any]


@dataclasses.dataclass(frozen=True)
class Comparison:
    """A field beside its truth, point by point; arrays (rows, columns), six on the first axis where they are."""

    measured: Measured
    difference: Array
    known: NDArray[np.bool_]
    stays: NDArray[np.bool_]
    textured: NDArray[np.bool_]
    truth: Array

    @property
    def distance(self) -> Array:
        """End-point error of every point, px; NaN where not given or not known."""
        return np.hypot(*self.difference[:2])

    @property
    def wrong(self) -> NDArray[np.bool_]:
        """Points given with a wrong number; where no standard error is predicted, 0.3 px alone decides."""
        error = self.measured.error
        allowed = 0.0 if error is None else WRONG_ERRORS * np.nan_to_num(np.hypot(*error[:2]) / np.sqrt(2))
        with np.errstate(invalid="ignore"):
            return self.distance > np.maximum(WRONG, allowed)


@dataclasses.dataclass(frozen=True)
class Scores:
    """The measures of this module's table; NaN where there is nothing to average."""

    error: float
    rms_complete: float
    gradient_complete: float
    angle: float
    valid: float
    wrong: float
    textured: float
    outside: float
    bias_u: float
    bias_v: float
    seconds: float


def compare(case: Case, measured: Measured, texture: NDArray[np.bool_]) -> Comparison:
    """Put a field beside the truth on its own grid; `texture` as from `textured_pixels`."""
    x, y = measured.x, measured.y
    truth = case.truth.displacement(x, y, middle=measured.middle)
    gradient = case.truth.gradient(x, y, middle=measured.middle)
    six = np.tensordot(SIX_FROM_GRADIENT, np.concatenate([truth, gradient]), axes=1)
    six[:2] = truth
    known = np.asarray(np.isfinite(truth).all(axis=0))
    textured = texture[np.ix_(np.round(y).astype(int), np.round(x).astype(int))]
    return Comparison(measured, measured.six - six, known, case.truth.stays(x, y), textured, six)


def score(comparison: Comparison) -> Scores:
    """Sum a comparison up."""
    measured, difference = comparison.measured, comparison.difference
    given = measured.given & comparison.known
    complete = given & measured.complete
    distance = comparison.distance
    rough = np.sqrt(
        (difference[2:] ** 2).sum(axis=0) / 8
    )  # rms over u_x, u_y, v_x, v_y: Σ G² = ½ Σ of the four
    judged = comparison.textured & comparison.stays
    return Scores(
        error=_mean(distance[given]),
        rms_complete=_rms(distance[complete]) / np.sqrt(2),
        gradient_complete=_rms(rough[complete]),
        angle=_mean(angles(measured.six[:2], comparison.truth[:2])[given]),
        valid=_share(given, comparison.known),
        wrong=_share(comparison.wrong, given),
        textured=_share(given & (np.nan_to_num(distance, nan=np.inf) <= WRONG), judged),
        outside=_share(measured.given, ~comparison.known),
        bias_u=_mean(difference[0][given]),
        bias_v=_mean(difference[1][given]),
        seconds=measured.seconds,
    )


def angles(found: Array, truth: Array) -> Array:
    """Angle between (u, v, 1) and its truth at every point, degrees."""
    (u, v), (true_u, true_v) = found, truth
    cosine = (u * true_u + v * true_v + 1) / np.sqrt((u**2 + v**2 + 1) * (true_u**2 + true_v**2 + 1))
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))


def textured_pixels(frame: Array) -> NDArray[np.bool_]:
    """Whether the texture around every pixel of a frame tells a shift in every direction."""
    image = frame.astype(np.float64)
    gradient_x, gradient_y = np.gradient(image, axis=1), np.gradient(image, axis=0)
    sigma = window_sigma(TEXTURE_WINDOW)
    xx, xy, yy = (
        ndimage.gaussian_filter(product, sigma)
        for product in (gradient_x**2, gradient_x * gradient_y, gradient_y**2)
    )
    least = (xx + yy) / 2 - np.hypot((xx - yy) / 2, xy)
    error: Array = np.sqrt(2) / (TEXTURE_WINDOW * np.sqrt(np.maximum(least, 1e-12)))
    return error < TEXTURE_ERROR


def _mean(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else np.nan


def _rms(values: Array) -> float:
    return float(np.sqrt(_mean(values**2)))


def _share(part: NDArray[np.bool_], whole: NDArray[np.bool_]) -> float:
    return float((part & whole).sum() / whole.sum()) if whole.any() else np.nan
