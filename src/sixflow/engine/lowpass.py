"""Low-pass: a Gaussian over both frames before they are compared, g_k ∝ exp(−k²/2s²) along both axes.

Where an image holds much near the highest frequency of the pixels, ω = π, pixels tell little of what is between them:
what lies beyond has come back as aliasing, and splines, ours or those of software that has deformed a frame, do not
carry these frequencies with the right phase. Every frequency says by itself how far things moved, and least squares
gives it the weight of its power times ω². The low-pass takes the power Ĝ², Ĝ = exp(−s²ω²/2), of what misleads.

It costs little noise. The fit weighs frequencies by P ω² Ĝ², P the power of the texture, and white noise would have
them weighed by P ω². With T_n = Σ P ω² Ĝ²ⁿ over all frequencies the standard error is √(T₀ T₂)/T₁ times the least;
for a speckle of Gaussian blobs of radius σ that is (σ² + s²)²/(σ² (σ² + 2s²)), with s = 0.7: 1.01 for σ = 2, 1.12 for
σ = 1.

White noise of unit variance is left with the variance K = (Σ g²)², ≈ 1/(4πs²), and is no longer white. Its part of the
covariance is not Σ w² r² J Jᵀ but, E r² = 2 σ² K,

    Σ_xy w(x) w(y) J(x) E[r(x) r(y)] J(y)ᵀ ≈ Σ w² (r²/K) (g ∗ J)(g ∗ J)ᵀ

with the gradients J filtered once more, for a window that hardly changes over s.

| symbol | name |
|---|---|
| s | `lowpass` |
| g | `lowpass_half` |
| Ĝ² | `lowpass_power` |
| K | `lowpass_noise` |
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.fir import filter_separable

_CUT = 3.5


@cache
def lowpass_half(lowpass: float) -> NDArray[np.float64]:
    """Half of the symmetric weights g, of sum 1, cut at 3.5 s.

    Examples
    --------
    >>> lowpass_half(0.5).round(4)
    array([7.866e-01, 1.065e-01, 3.000e-04])
    """
    half = np.exp(-((np.arange(math.ceil(_CUT * lowpass) + 1) / lowpass) ** 2) / 2)
    return half / (half[0] + 2 * half[1:].sum())


def lowpass_power(lowpass: float, omega: NDArray[Any]) -> NDArray[np.float64]:
    """Ĝ² along one axis at frequencies in rad/px; 1 for `lowpass=0`."""
    if not lowpass:
        return np.ones(np.shape(omega))
    half = lowpass_half(lowpass)
    return np.asarray(
        (half[0] + 2 * np.cos(np.multiply.outer(omega, np.arange(1, half.size))) @ half[1:]) ** 2
    )


@cache
def lowpass_noise(lowpass: float) -> float:
    """K, the variance that white noise of unit variance is left with.

    Examples
    --------
    >>> round(lowpass_noise(1.0), 3), lowpass_noise(0.0)
    (0.08, 1.0)
    """
    if not lowpass:
        return 1.0
    half = lowpass_half(lowpass)
    return float((half[0] ** 2 + 2 * (half[1:] ** 2).sum()) ** 2)


def lowpass_reach(lowpass: float) -> int:
    """Pixels from one without a value beyond which what is not there weighs less than 3 %."""
    return math.ceil(2 * lowpass)


def smoothed(image: NDArray[Any], lowpass: float) -> NDArray[Any]:
    """The image after the low-pass; beyond its border it goes on oddly, as for the splines."""
    return filter_separable(image, lowpass_half(lowpass), odd=True)
