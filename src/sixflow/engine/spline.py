"""B-spline interpolation (Unser, Aldroubi and Eden 1993): prefilter, and the noise that interpolation leaves.

An image is represented by coefficients c with I(x) = Σ_k c_k β(x − k), β the B-spline of degree 3 or 5.
The coefficients are the image filtered by the inverse of the sampled spline, cut where it falls below
the rounding of the dtype.

Interpolating white noise of unit variance at a fraction f between pixels leaves noise of variance V(f)
= Σ_k h_k(f)², h the cardinal spline: 1 on a pixel, less between. `noise_variance` gives V, so that the
noise of a frame can be read off a residual.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.fir import filter_separable
from sixflow.engine.lowpass import lowpass_power

PAD = 3
"""Pixels by which a coefficient image is larger than its frame, on each side."""

DEGREE = {"cubic": 3, "quintic": 5}
_SAMPLES = {3: (4 / 6, 1 / 6), 5: (66 / 120, 26 / 120, 1 / 120)}
_PERIOD = 4096


def _sampled_spectrum(degree: int) -> NDArray[np.float64]:
    """Spectrum of the B-spline sampled at the pixels, at the frequencies 2πn/4096."""
    omega = 2 * np.pi * np.fft.fftfreq(_PERIOD)
    samples = _SAMPLES[degree]
    return samples[0] + sum(2 * s * np.cos((k + 1) * omega) for k, s in enumerate(samples[1:]))


@cache
def _prefilter_half(degree: int, precision: float) -> NDArray[np.float64]:
    inverse = np.fft.ifft(1 / _sampled_spectrum(degree)).real
    reach = int(np.nonzero(np.abs(inverse[: _PERIOD // 2]) > precision)[0].max())
    half = inverse[: reach + 1].copy()
    return half / (half[0] + 2 * half[1:].sum())  # a constant stays a constant


def spline_coefficients(image: NDArray[Any], degree: int) -> NDArray[Any]:
    """Coefficients of the interpolating B-spline, padded by `PAD` on each side.

    Beyond its border the image is reflected about the border pixel's value, so that a slope goes on: an
    extension that bends it would bias the displacements near the border.

    Parameters
    ----------
    image : float32 or float64 array, shape (height, width)
    degree : {3, 5}

    Returns
    -------
    array of the image's dtype, shape (height + 6, width + 6); [PAD + y, PAD + x] belongs to pixel (y, x)
    """
    precision = 1e-7 if image.dtype == np.float32 else 1e-15
    return filter_separable(image, _prefilter_half(degree, precision), pad=PAD, odd=True)


def spline_weights(fraction: NDArray[Any], degree: int) -> NDArray[Any]:
    """Weights of the degree + 1 coefficients around a position `fraction` ∈ [0, 1) past a pixel; shape
    (…, degree + 1).

    The first weight belongs to the pixel (degree − 1)/2 before.
    """
    f = np.asarray(fraction, dtype=np.float64)[..., None]
    distance = np.abs(f + (degree - 1) // 2 - np.arange(degree + 1))
    return _bspline(distance, degree)


def _bspline(distance: NDArray[Any], degree: int) -> NDArray[Any]:
    d = distance
    if degree == 3:
        return np.where(d < 1, 2 / 3 - d**2 + d**3 / 2, np.clip(2 - d, 0, None) ** 3 / 6)
    inner = 11 / 20 - d**2 / 2 + d**4 / 4 - d**5 / 12
    middle = 17 / 40 + 5 * d / 8 - 7 * d**2 / 4 + 5 * d**3 / 4 - 3 * d**4 / 8 + d**5 / 24
    return np.where(d < 1, inner, np.where(d < 2, middle, np.clip(3 - d, 0, None) ** 5 / 120))


def _cardinal_spectra(degree: int, fractions: NDArray[Any]) -> NDArray[Any]:
    """Spectra of the interpolator at each fraction, shape (fractions, frequencies)."""
    omega = 2 * np.pi * np.fft.fftfreq(_PERIOD)
    offsets = np.arange(degree + 1) - (degree - 1) // 2
    return (
        spline_weights(fractions, degree) @ np.exp(1j * np.outer(offsets, omega)) / _sampled_spectrum(degree)
    )


def _noise_power(lowpass: float) -> NDArray[np.float64]:
    """Power spectrum of unit noise along one axis, white before the low-pass."""
    power = lowpass_power(lowpass, 2 * np.pi * np.fft.fftfreq(_PERIOD))
    return power / power.mean()


@cache
def noise_variance(degree: int, lowpass: float = 0.0) -> tuple[float, float, float]:
    """Coefficients (a, b, c) of V(f) ≈ 1 + a s + b s² + c s³ with s = f(1 − f), good to 1e-3.

    White noise may have gone through a low-pass: V is relative to what that has left.
    """
    fractions = np.linspace(0, 0.5, 65)
    share = _noise_power(lowpass)
    variance = (np.abs(_cardinal_spectra(degree, fractions)) ** 2 * share).mean(axis=1)
    s = fractions * (1 - fractions)
    a, b, c = np.linalg.lstsq(np.stack([s, s**2, s**3], axis=1), variance - 1, rcond=None)[0]
    return float(a), float(b), float(c)


@cache
def gradient_noise(
    degree: int, derivative: tuple[float, ...], interpolated: int = 1, lowpass: float = 0.0
) -> float:
    """Power that unit noise in both frames, white before a low-pass, adds to each gradient component, averaged
    over fractions between pixels.

    ⟨g²⟩ for g = ½D(n₀ + S n₁), D the antisymmetric difference with half-weights `derivative`, S the
    interpolation at a fraction, along both axes. Where both frames are interpolated (`interpolated=2`) n₀ is
    smoothed as well.
    """
    fractions = (np.arange(32) + 0.5) / 32
    omega = 2 * np.pi * np.fft.fftfreq(_PERIOD)
    response = sum(2 * d * np.sin((k + 1) * omega) for k, d in enumerate(derivative))
    share = _noise_power(lowpass)
    power = np.abs(_cardinal_spectra(degree, fractions)) ** 2 * share
    still = float((response**2 * share).mean())
    moved = float((response**2 * power).mean() * power.mean())
    return ((2 - interpolated) * still + interpolated * moved) / 4
