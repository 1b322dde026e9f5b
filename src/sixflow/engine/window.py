"""The window: a Gaussian weight of standard deviation σ = window/√(4π), and tables of its moments' weights.

With this σ the weight has the effective area (Σw)²/Σw² = 4πσ² = window², that of a square subset of
side `window`: the same number of pixels share the noise. It is cut at 3.5 σ, where w = 0.002.

Coordinates inside a window are in units of σ, X = (x − p)/σ, which keeps the normal equations well
conditioned.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.response import powers, resolved, response

CUT = 3.5


def window_sigma(window: float) -> float:
    """Standard deviation of the Gaussian weight, px."""
    return window / math.sqrt(4 * math.pi)


def moment_weights(sigma: float, *, power: int = 1) -> NDArray[np.float64]:
    """Tables w(X)^power · X^k for k = 0, 1, 2 at the pixels −R … R, R = ⌈3.5 σ/√power⌉; shape (3, 2R + 1).

    w is normalised to ∫w = 1 along the axis.
    """
    reach = math.ceil(CUT * sigma / math.sqrt(power))
    scaled = np.arange(-reach, reach + 1) / sigma
    weight = np.exp(-(scaled**2) / 2)
    weight /= math.sqrt(2 * math.pi) * sigma
    return np.stack([weight**power * scaled**k for k in range(3)])


@cache
def attenuation_period(sigma: float, sharpen: int = 0, attenuation: float = 0.1) -> float:
    """Period of a sine displacement, px, that a measurement attenuates by `attenuation`.

    One window responds to the wave number k by M = exp(−k²σ²/2), a sharpened one by `response.response`.

    Examples
    --------
    >>> round(attenuation_period(window_sigma(31)), 1)
    119.7
    """
    low, high = 0.0, 1.0
    while high - low > 1e-12:
        middle = (low + high) / 2
        low, high = (middle, high) if response(middle, sharpen) < 1 - attenuation else (low, middle)
    return 2 * math.pi * sigma / math.sqrt(-2 * math.log(high))


@cache
def plain_window(window: float, sharpen: int) -> float:
    """Window, px, that resolves without sharpening what `window` resolves with it: where neighbours may differ.

    Examples
    --------
    >>> round(plain_window(31, 2), 1)
    12.7
    """
    return window * math.sqrt(math.log(resolved(0)) / math.log(resolved(sharpen)))


@cache
def sharpening_noise(sharpen: int) -> tuple[float, float]:
    """Factors by which sharpening changes the noise of displacement and of gradients.

    √(2∫T² dx) and √(4∫x T² dx) over x from 0 to ∞, T(e^−x): white noise through the response of
    `attenuation_period`, relative to that of one window. Less than 1 where the smoother response of one window
    lets more pass than the sharpened.

    Examples
    --------
    >>> [round(factor, 2) for factor in sharpening_noise(2)]
    [1.29, 1.22]
    """
    power = np.convolve(powers(sharpen), powers(sharpen))[2:]
    order = np.arange(2, len(power) + 2)  # ∫ e^−mx dx = 1/m, ∫ x e^−mx dx = 1/m²
    return math.sqrt(2 * float((power / order).sum())), math.sqrt(4 * float((power / order**2).sum()))
