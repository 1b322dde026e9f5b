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
    T ≥ 1 − (1 − e^{−x x₉₀(m)/x₉₀(n)})^(m+1), m = min(n, 2), for x < x₉₀(n)

(in the pass band as flat as two repeated corrections of the same resolution, or one: smooth flows of many pixels are
not attenuated by the price of less noise). The degree does not depend on n: at one resolution, a higher degree buys
less noise. Noise × period at 10 % attenuation, relative to one window's: 0.51 … 0.54 for the
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
    (
        0.6514429,
        0.6066561,
        -0.0693524,
        -0.2972829,
        0.0384944,
        0.0913826,
        0.0251403,
        -0.0633039,
        0.0129173,
        0.0039056,
    ),
    (
        0.9061896,
        0.5111965,
        -0.4634975,
        -0.1043232,
        0.2026251,
        0.0108260,
        -0.1243216,
        0.0805629,
        -0.0209956,
        0.0017378,
    ),
    (
        1.1441929,
        0.2669601,
        -0.5967907,
        0.0755681,
        0.2843811,
        -0.2545516,
        0.0786411,
        0.0167422,
        -0.0193491,
        0.0042059,
    ),
    (
        1.4410392,
        -0.1579807,
        -0.4996102,
        0.1526541,
        0.2810007,
        -0.4062572,
        0.2793872,
        -0.1133696,
        0.0255252,
        -0.0023887,
    ),
    (
        1.4162550,
        0.0060869,
        -0.8976846,
        0.6927374,
        -0.1980137,
        -0.1281727,
        0.1917630,
        -0.1143143,
        0.0363709,
        -0.0050279,
    ),
    (
        1.7390929,
        -0.4967503,
        -0.7290896,
        0.8499036,
        -0.5214560,
        0.1807413,
        -0.0033795,
        -0.0314563,
        0.0148322,
        -0.0024383,
    ),
    (
        1.9306067,
        -0.8001958,
        -0.6137537,
        0.9229684,
        -0.6981820,
        0.3584438,
        -0.1199148,
        0.0195571,
        0.0012438,
        -0.0007735,
    ),
    (
        2.0672646,
        -1.0197403,
        -0.5232864,
        0.9667887,
        -0.8226526,
        0.4912230,
        -0.2111748,
        0.0610756,
        -0.0101508,
        0.0006530,
    ),
    (
        2.1810778,
        -1.2049952,
        -0.4404121,
        0.9932102,
        -0.9208279,
        0.6058090,
        -0.2970528,
        0.1036293,
        -0.0227850,
        0.0023467,
    ),
    (
        2.5509689,
        -1.8865425,
        0.0898939,
        0.6519212,
        -0.7500255,
        0.5516380,
        -0.2980971,
        0.1154993,
        -0.0286420,
        0.0033858,
    ),
    (
        3.1031384,
        -2.9253927,
        0.9533125,
        0.0218798,
        -0.3521228,
        0.3396520,
        -0.2067550,
        0.0858286,
        -0.0222513,
        0.0027105,
    ),
    (
        3.5028765,
        -3.6778117,
        1.5802247,
        -0.4387684,
        -0.0572801,
        0.1794406,
        -0.1360739,
        0.0623203,
        -0.0170840,
        0.0021560,
    ),
    (
        3.8043735,
        -4.2452127,
        2.0532615,
        -0.7877454,
        0.1682546,
        0.0550009,
        -0.0801578,
        0.0433894,
        -0.0128625,
        0.0016985,
    ),
    (
        4.0484414,
        -4.7057206,
        2.4396146,
        -1.0746270,
        0.3541943,
        -0.0473372,
        -0.0344888,
        0.0280622,
        -0.0094723,
        0.0013334,
    ),
    (
        4.2465162,
        -5.0785034,
        2.7509732,
        -1.3060998,
        0.5063401,
        -0.1334694,
        0.0053887,
        0.0141745,
        -0.0063049,
        0.0009848,
    ),
    (
        4.4226082,
        -5.4119151,
        3.0334416,
        -1.5188362,
        0.6464640,
        -0.2118154,
        0.0408292,
        0.0021571,
        -0.0036291,
        0.0006957,
    ),
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
    >>> response(np.array([0.2, 0.536, 1.0]), 2).round(3)
    array([0.056, 0.9  , 1.   ])
    """
    return np.asarray(whole) * chebyshev.chebval(2 * np.asarray(whole) - 1, quotient(sharpen))


@cache
def powers(sharpen: int) -> NDArray[np.float64]:
    """Coefficients of T in powers of M, the constant 0 first."""
    shifted = np.polynomial.Chebyshev(quotient(sharpen), domain=[0, 1])
    return np.concatenate([[0.0], shifted.convert(kind=np.polynomial.Polynomial).coef])
