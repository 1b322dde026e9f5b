"""Response: what sharpening makes of a window's answer to a wave, with the least noise for its resolution.

A window's affine fit answers a displacement of wave number k with M = exp(−x), x = k²σ²/2. On a field whose fit M U
can be computed, any polynomial T(M) with T(0) = 0 and T(1) = 1 can be made the response. White noise passes T too:

    displacement's variance ∝ ∫ T² dx,     gradient's variance ∝ ∫ x T² dx,

and resolution is x₉₀, where T = 0.9. `sharpen` = n sets it,

    M₉₀ = 1 − 0.1^(1/(n+1)),

as n repeated corrections would, T = 1 − (1 − M)^(n+1). But these are far from the least noise. T is the polynomial of
degree 10 that minimises

    ∫ T² dx / 2x₉₀ + ∫ x T² dx / 2x₉₀²       (noise powers relative to a sharp cut at 0.9: ∫ = x₉₀, x₉₀²/2)

subject to

    T(M₉₀) = 0.9,   T(1) = 1,   T' ≥ 0 on 0 … 1 (no overshoot),
    T ≥ 0.9^(x/x₉₀) for x < x₉₀ (nowhere below a plain window of the same resolution).

The degree does not depend on n: one more correction costs another fit of the field, a higher degree at the same M₉₀
too, and that buys less noise. Noise × period at 10 % attenuation, relative to one window's: 0.50 … 0.53 for the
displacement and 0.19 … 0.21 (× period²) for the gradient, where repeated corrections have 0.71, 0.64, 0.59, 0.55 and
0.44, 0.33, 0.27, 0.23 for n = 1, 2, 4, 8; a sharp cut at 0.9 has 0.46 and 0.15.

The quotient Q = T/M is what is applied to the frames' answer; its maximum says how much is asked of the texture: 1.3,
1.7, 2.5, 4.6 for n = 1, 2, 4, 8, and n + 1 for repeated corrections.

| symbol | name |
|---|---|
| M, T | `whole`, `response` |
| Q = Σ_k q_k T*_k(M), T*_k the Chebyshev polynomials of 0 … 1 | `quotient` |
| M₉₀ | `resolved` |
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

ATTENUATED = 0.1
DEGREE = 10
"""Of T."""

_QUOTIENTS = (
    (0.592806, 0.680165, -0.093544, -0.270087, -0.004170, 0.125267, 0.015467, -0.054176, -0.010559, 0.018831),
    (0.832085, 0.596563, -0.467384, -0.133788, 0.234699, 0.001322, -0.117771, 0.051726, 0.018370, -0.015822),
    (1.067710, 0.366237, -0.627808, 0.092285, 0.236001, -0.137148, -0.079738, 0.155514, -0.096165, 0.023112),
    (1.359873, -0.027123, -0.596259, 0.232906, 0.226622, -0.370304, 0.249305, -0.081881, -0.002469, 0.009330),
    (1.584051, -0.361122, -0.502162, 0.304929, 0.164838, -0.426516, 0.396926, -0.229753, 0.080306, -0.011497),
    (
        1.528732,
        -0.161915,
        -0.887922,
        0.823705,
        -0.340571,
        -0.072813,
        0.236607,
        -0.200296,
        0.097997,
        -0.023524,
    ),
    (
        1.825594,
        -0.634277,
        -0.704386,
        0.941766,
        -0.647411,
        0.266689,
        -0.020475,
        -0.060168,
        0.046679,
        -0.014011,
    ),
    (2.029854, -0.971358, -0.544237, 0.978410, -0.817183, 0.470725, -0.181964, 0.030182, 0.013530, -0.007959),
    (
        2.173070,
        -1.207439,
        -0.430309,
        0.997445,
        -0.927779,
        0.610306,
        -0.299089,
        0.101620,
        -0.015894,
        -0.001931,
    ),
    (2.292287, -1.409435, -0.322941, 1.002888, -1.017443, 0.731415, -0.405709, 0.170464, -0.046195, 0.004669),
    (2.399424, -1.595035, -0.216499, 0.996960, -1.090140, 0.840705, -0.509199, 0.242291, -0.083586, 0.015079),
    (2.673442, -2.100522, 0.182643, 0.729132, -0.952422, 0.802383, -0.523380, 0.268095, -0.101456, 0.022085),
    (3.215193, -3.127677, 1.061719, 0.049083, -0.481546, 0.514417, -0.371995, 0.203277, -0.080873, 0.018402),
    (3.629238, -3.915848, 1.740292, -0.476671, -0.119470, 0.297849, -0.262851, 0.158853, -0.067697, 0.016305),
    (3.949989, -4.524654, 2.263417, -0.884424, 0.166091, 0.120354, -0.167587, 0.117155, -0.054173, 0.013832),
    (4.212752, -5.024635, 2.694275, -1.220913, 0.403135, -0.027871, -0.087614, 0.081692, -0.042658, 0.011837),
)
"""q_k of n = 1, 2, …; `tests/test_engine_response.py` derives them."""


@cache
def quotient(sharpen: int) -> NDArray[np.float64]:
    """Coefficients q_k of Q = T/M in the Chebyshev polynomials of 2M − 1; shape (1,) without sharpening, (10,) with."""
    return np.array(_QUOTIENTS[sharpen - 1]) if sharpen else np.ones(1)


def resolved(sharpen: int) -> float:
    """The window's own response where T = 0.9.

    Examples
    --------
    >>> [round(resolved(n), 3) for n in (0, 2)]
    [0.9, 0.536]
    """
    return float(1 - ATTENUATED ** (1 / (sharpen + 1)))


def response(whole: Any, sharpen: int) -> Any:
    """T of the window's own response M, 0 to 1.

    Examples
    --------
    >>> response(np.array([0.0, 0.536, 1.0]), 2).round(3)
    array([0. , 0.9, 1. ])
    """
    return np.asarray(whole) * chebyshev.chebval(2 * np.asarray(whole) - 1, quotient(sharpen))


@cache
def powers(sharpen: int) -> NDArray[np.float64]:
    """Coefficients of T in powers of M, the constant 0 first."""
    shifted = np.polynomial.Chebyshev(quotient(sharpen), domain=[0, 1])
    return np.concatenate([[0.0], shifted.convert(kind=np.polynomial.Polynomial).coef])
