"""Windows that localise kernels, as logarithms with their gradients: a product of windows is a sum."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sixflow.eigenfilters.geometry import Real


class Window(NamedTuple):
    """Logarithm of a window, (n,), and its gradient, (2, n); windows are multiplied by `times`."""

    log: Real
    gradient: Real

    def times(self, other: Window) -> Window:
        """Product of two windows."""
        return Window(self.log + other.log, self.gradient + other.gradient)


def gaussian(x: Real, y: Real, sigma: float | None) -> Window:
    """Window exp(−(x² + y²)/(2σ²)); 1 if σ is None."""
    if sigma is None:
        return Window(np.zeros_like(x), np.zeros((2, *x.shape)))
    return Window(-(x * x + y * y) / (2 * sigma**2), -np.stack([x, y]) / sigma**2)


def log_gaussian(x: Real, y: Real, scale: float, bandwidth: float) -> Window:
    """Window exp(−log²(r/scale)/(2 bandwidth²))."""
    square = x * x + y * y
    log = np.log(square / scale**2) / 2
    return Window(-(log**2) / (2 * bandwidth**2), -log / bandwidth**2 * np.stack([x, y]) / square)
