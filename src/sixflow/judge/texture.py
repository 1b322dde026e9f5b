"""Texture: do the gradients of a window rise above noise in every direction?

`refine.problem.least_texture` says how far they have to, by their scatter.

Where windows do not match, their residual is no noise. Then frame 0 alone is asked: differences of neighbours two
pixels apart have ½ n² of noise, n² the mean power of the frame at the frequencies above π/2 along both axes, where
white noise is as everywhere, and texture little; or that of the windows that match, if it is less.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.fir import filter_separable
from sixflow.engine.window import CUT, window_sigma
from sixflow.maps.grid import Grid
from sixflow.prepare.frame import Frame
from sixflow.refine.likeness import spectrum_of
from sixflow.refine.problem import least_texture

Array = NDArray[np.float64]


def gradient_power(frame: Frame, grid: Grid, window: float) -> tuple[Array, Array]:
    """λ₁ and λ₂ of every window, from every second pixel, of those that count; each (rows, columns)."""
    image, valid = frame.image, frame.counted()
    x, y = (
        (image[1:-1:2, 2::2] - image[1:-1:2, :-2:2]) / 2,
        (image[2::2, 1:-1:2] - image[:-2:2, 1:-1:2]) / 2,
    )
    height, width = min(len(x), len(y)), min(x.shape[1], y.shape[1])
    x, y = x[:height, :width], y[:height, :width]
    products = [x * x, x * y, y * y]
    if valid.size:
        part = slice(0, height), slice(0, width)
        known = (valid[1:-1:2, 2::2] & valid[1:-1:2, :-2:2])[part]
        known &= (valid[2::2, 1:-1:2] & valid[:-2:2, 1:-1:2])[part]
        products = [np.where(known, product, 0) for product in (*products, np.ones_like(x))]
    sigma = window_sigma(window) / 2
    half = np.exp(-((np.arange(math.ceil(CUT * sigma) + 1) / sigma) ** 2) / 2)
    half /= half[0] + 2 * half[1:].sum()
    at = np.ix_(np.clip(grid.y // 2, 0, height - 1), np.clip(grid.x // 2, 0, width - 1))
    a, b, c, *share = (
        filter_separable(np.ascontiguousarray(product), half)[at].astype(np.float64) for product in products
    )
    if share:
        a, b, c = (
            np.divide(part, share[0], out=np.zeros_like(part), where=share[0] > 0) for part in (a, b, c)
        )
    middle, radius = (a + c) / 2, np.hypot((a - c) / 2, b)
    return middle - radius, middle + radius


def is_textured(frame: Frame, grid: Grid, window: float, noise: NDArray[Any]) -> NDArray[np.bool_]:
    """Where frame 0 alone has texture in every direction.

    Parameters
    ----------
    frame : Frame
    grid : Grid
    window : float
        px.
    noise : array
        Of one frame, where its windows match.
    """
    power = noise_power(frame, window)
    if np.isfinite(noise).any():
        power = min(power, float(np.nanmedian(noise)) ** 2)
    weakest, _ = gradient_power(frame, grid, window)
    # every second pixel is asked
    return np.asarray(weakest > power / 2 * (1 + least_texture(window**2 / 4)))


def noise_power(frame: Frame, window: float) -> float:
    """Power of the white noise that a frame can have at most: that of its spectrum where frequencies are high."""
    power = spectrum_of(frame, window_sigma(window))
    quarter = len(power) // 4
    high = slice(quarter, len(power) - quarter + 1)
    return float(power[high, high].mean())
