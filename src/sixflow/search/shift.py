"""Shift: the displacement that two whole frames have in common, from their correlation.

Cross-correlation under a Hann window with the spectrum's magnitude under a square root, half way to phase
correlation: a peak as narrow as the texture allows, without raising empty frequencies to full height,

    c = F⁻¹[ Ĩ₀* Ĩ₁ / √|Ĩ₀ Ĩ₁| ].

A peak is clear if it rises `CLEAR_PEAK` standard deviations above the correlation surface.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.prepare.frame import Frame

CORRELATION_SIDE = 256
CLEAR_PEAK = 8.0


def common_shift(reference: Frame, moved: Frame) -> NDArray[np.float64]:
    """Shift (u, v) between the frames, px, to the pixels of a halved frame; (0, 0) if the correlation
    has no clear peak.
    """
    level = max(0, math.ceil(0.75 * math.log2(min(reference.image.shape) / CORRELATION_SIDE)))
    small, small_moved = reference.level(level), moved.level(level)
    window = np.outer(*(np.hanning(size + 2)[1:-1] for size in small.image.shape)).astype(small.image.dtype)
    spectra = [np.fft.rfft2(_centred(frame) * window) for frame in (small, small_moved)]
    product = np.conj(spectra[0]) * spectra[1]
    magnitude = np.abs(product)
    if not magnitude.any():
        return np.zeros(2)
    product /= np.sqrt(magnitude + 1e-12 * magnitude.max())
    surface = np.fft.irfft2(product, small.image.shape)
    peak = np.unravel_index(int(surface.argmax()), surface.shape)
    if surface[peak] < CLEAR_PEAK * surface.std():
        return np.zeros(2)
    v, u = (
        int(at) - size if at > size // 2 else int(at) for at, size in zip(peak, surface.shape, strict=True)
    )
    return 2.0**level * np.array([u, v])


def _centred(frame: Frame) -> NDArray[Any]:
    """Image less its mean, 0 where masked."""
    if not frame.valid.size:
        return frame.image - frame.image.mean()
    valid = frame.valid.astype(bool)
    return (
        np.where(valid, frame.image - frame.image[valid].mean(), 0)
        if valid.any()
        else np.zeros_like(frame.image)
    )
