"""How the errors of neighbouring points are correlated, because they share pixels.

A point's estimate is the least-squares fit under a Gaussian window of standard deviation σ. White noise n of the
frames makes in it the error of a smoothed image, and in its gradient that of the image's derivative: with
w = exp(−|x|²/2σ²)/(2πσ²) and X/σ² · w = −∂w/∂X, the fit's constant is w ∗ n and its slope ∂(w ∗ n). So the errors
of all points are one smooth random function e(x) and its derivatives, of the autocorrelation

    c(d) = (w ∗ w)(d)/(w ∗ w)(0) = exp(−|d|²/4σ²),

and with d = q − p

    ⟨u_p u_q⟩ ∝ c,             ⟨u_p u_x,q⟩ ∝ ∂_x c,        ⟨u_x,p u_q⟩ ∝ −∂_x c,
    ⟨u_x,p u_x,q⟩ ∝ −∂²_xx c,   ⟨u_x,p u_y,q⟩ ∝ −∂²_xy c.

A sharpened window answers a wave number by T = Σ_j a_j M^j (`engine.response`), M the response of one window, so that
c is then a sum of Gaussians,

    c(d) = Σ_m b_m exp(−|d|²/2mσ²),     b_m ∝ (Σ_{j+l=m} a_j a_l)/m,     Σ b_m = 1.

Without sharpening, the noise in the gradients ties a point to its neighbours (`sixflow.engine.solve`) and holds back
errors that vary within a window: they answer by M/(1 + ρ(1 − M)), which is such a sum with a_j = ρ^{j−1}/(1 + ρ)^j.
The noise's share ρ follows from the precision P of points: 1/P_uu = 2s²/(window²⟨g_x²⟩) and
ρ = 2κs²/⟨g_x² + g_y²⟩ are made of the same noise s and texture g, so that with κ
(`sixflow.engine.spline.gradient_noise`)

    ρ (1 + ρ) f²(ρ) = κ window²/(P_uu + P_vv),

1 + ρ because the noise of the gradients makes errors, too, f the feedback's factor of the standard error of u.

R(d), 3×3, is this normalised to the unit diagonal, for the unknowns (u, σu_x, σu_y) of either component. The errors
of a field whose points have the covariance C_p then have the covariance C_p^½ R(q − p) C_q^½: exact for a uniform
texture, for which C_p^½ is the same everywhere, and interpolated between the points' own errors for any other.

Each entry of R is a sum of products of a function of d_x and one of d_y, so that R acts on the points of a grid as
small matrices on rows and on columns.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.response import powers
from sixflow.engine.solve import FEEDBACK_STEP, noise_feedback

Array = NDArray[Any]

_DERIVATIVES = ((0, 0), (1, 0), (0, 1))  # orders in x and y of u, u_x, u_y


_LEAST = 1e-4  # weights below this share are left out
_MOST = 4.0  # as in `noise_feedback`


class _Gaussians(NamedTuple):
    """Variances m (in σ²) and weights b of the Gaussians that make up c."""

    variances: Array
    weights: Array


def _autocorrelation(sharpen: int, noise_share: float) -> _Gaussians:
    """The Gaussians of a response Σ_j a_j M^j."""
    if sharpen:
        power = np.convolve(powers(sharpen), powers(sharpen))[2:]
    else:
        held = noise_share / (1 + noise_share)
        terms = 1 if held == 0 else math.ceil(math.log(_LEAST) / math.log(held)) + 1
        power = np.arange(1, terms + 1) * held ** np.arange(terms)
    m = np.arange(2, len(power) + 2)
    weights = power / m
    return _Gaussians(m.astype(float), weights / weights.sum())


def noise_share(precision: Array, sigma: float, gradient_noise: float) -> float:
    """Return ρ, the share of noise in the normal equations of points.

    Parameters
    ----------
    precision : array, shape (n, 6, 6)
        Of (u, σu_x, σu_y, v, σv_x, σv_y).
    sigma : float
        Standard deviation of the window, px.
    gradient_noise : float
        κ; 0 where no feedback is known.

    Returns
    -------
    float
        From 0 to 4.
    """
    known = np.arange(0, _MOST + FEEDBACK_STEP / 2, FEEDBACK_STEP)
    seen = gradient_noise * 4 * math.pi * sigma**2 / float(np.mean(precision[:, 0, 0] + precision[:, 3, 3]))
    return float(np.interp(seen, known * (1 + known) * noise_feedback()[0] ** 2, known))


class Correlation:
    """The correlation R of errors between the points of a grid.

    Parameters
    ----------
    x, y : arrays, shape (columns,), (rows,)
        Of the grid, px.
    sigma : float
        Standard deviation of the window, px.
    sharpen : int
        Sharpening passes.
    noise_share : float
        ρ, at least 0; counts without sharpening only.
    """

    def __init__(self, x: Array, y: Array, sigma: float, sharpen: int, noise_share: float = 0.0) -> None:
        variances, weights = _autocorrelation(sharpen, noise_share)
        slope = math.sqrt(float((weights / variances).sum()))  # standard deviation of σu_x over that of u
        self._scale = np.array([1.0, 1 / slope, 1 / slope])
        between_x, between_y = ((at - at[:, None]) / sigma for at in (x, y))
        self._terms = [
            (float(b), _profiles(between_x, float(m)), _profiles(between_y, float(m)))
            for m, b in zip(variances, weights, strict=True)
        ]

    def apply(self, values: Array) -> Array:
        """Return Σ_q R(q − p) values_q.

        Parameters
        ----------
        values : array, shape (rows, columns, 6, k)
            Components in the order u, σu_x, σu_y, v, σv_x, σv_y; 0 where there is no point.

        Returns
        -------
        array of the same shape
        """
        rows, columns, _, count = values.shape
        parts = values.reshape(rows, columns, 2, 3, count)
        out = np.zeros_like(parts)
        for weight, along_x, along_y in self._terms:
            for i, (ix, iy) in enumerate(_DERIVATIVES):
                for j, (jx, jy) in enumerate(_DERIVATIVES):
                    sign = -1.0 if (ix + iy) == 1 else 1.0  # ∂/∂p = −∂/∂q
                    factor = sign * weight * float(self._scale[i] * self._scale[j])
                    seen = np.tensordot(along_y[iy + jy], parts[:, :, :, j], axes=(1, 0))
                    seen = np.tensordot(along_x[ix + jx], seen, axes=(1, 1))
                    out[:, :, :, i] += factor * np.swapaxes(seen, 0, 1)
        return out.reshape(values.shape)


def _profiles(d: Array, m: float) -> tuple[Array, Array, Array]:
    """exp(−d²/2m) and its first two derivatives, [p, q], for d[p, q] = (x_q − x_p)/σ."""
    value = np.exp(-(d**2) / (2 * m))
    return value, -d / m * value, (d**2 / m**2 - 1 / m) * value


def unknowns_from_six(sigma: float) -> Array:
    """Matrix from the six numbers to (u, σu_x, σu_y, v, σv_x, σv_y), shape (6, 6)."""
    h = sigma / 2
    return np.array(
        [
            [1, 0, 0, 0, 0, 0],
            [0, 0, h, 0, h, 0],
            [0, 0, 0, -h, 0, h],
            [0, 1, 0, 0, 0, 0],
            [0, 0, 0, h, 0, h],
            [0, 0, h, 0, -h, 0],
        ]
    )
