"""The window: a Gaussian weight of standard deviation σ = window/√(4π), and tables of its moments' weights.

With this σ the weight has the effective area (Σw)²/Σw² = 4πσ² = window², that of a square subset of
side `window`: the same number of pixels share the noise. It is cut at 3.5 σ, where w = 0.002.

Coordinates inside a window are in units of σ, X = (x − p)/σ, which keeps the normal equations well
conditioned.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

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


def attenuation_period(sigma: float, sharpen: int = 0, attenuation: float = 0.1) -> float:
    """Period of a sine displacement, px, that a measurement attenuates by `attenuation`.

    One window responds to the wave number k by M = exp(−k²σ²/2), n sharpening passes by 1 − (1 − M)^(n+1).

    Examples
    --------
    >>> round(attenuation_period(window_sigma(31)), 1)
    119.7
    """
    response = 1 - attenuation ** (1 / (sharpen + 1))
    return 2 * math.pi * sigma / math.sqrt(-2 * math.log(response))


def sharpening_noise(sharpen: int) -> tuple[float, float]:
    """Factors by which n sharpening passes raise the noise of displacement and of gradients.

    √(2∫[1−(1−e^−x)^(n+1)]² dx) and √(4∫x[1−(1−e^−x)^(n+1)]² dx) over x from 0 to ∞: white noise through
    the response of `attenuation_period`, relative to that of one window.

    Examples
    --------
    >>> [round(factor, 2) for factor in sharpening_noise(2)]
    [1.56, 1.98]
    """
    x = np.linspace(0, 60, 60001)
    response: NDArray[Any] = 1 - (1 - np.exp(-x)) ** (sharpen + 1)
    return (
        math.sqrt(2 * float(np.trapezoid(response**2, x))),
        math.sqrt(4 * float(np.trapezoid(x * response**2, x))),
    )
