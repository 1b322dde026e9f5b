"""Exact pairs of a sum of blobs in an affine motion about the middle of the frame, for maps of a neighbourhood."""

import numpy as np

HALF = 40
Y, X = np.mgrid[-HALF : HALF + 1, -HALF : HALF + 1].astype(np.float64)


def pattern(seed: int):
    """A sum of Gaussian blobs of radius 2 px, about unit standard deviation, as a function of position."""
    rng = np.random.default_rng(seed)
    centres, weights = rng.uniform(-70, 70, (1200, 2)), rng.normal(0, 1.2, 1200)

    def value(x, y):
        x, y = np.broadcast_arrays(x, y)
        total = np.zeros(x.shape)
        for (cx, cy), w in zip(centres, weights, strict=True):
            total += w * np.exp(-((x - cx) ** 2 + (y - cy) ** 2) / 8)
        return total

    return value


def pair(seed, first, second, tau_eta, tau_xi):
    """Two frames with I1(exp(τ₁L₁ + τ₂L₂) x) = I0(x), without any interpolation."""
    value = pattern(seed)
    return value(X, Y), value(*first.flow(-tau_eta, *second.flow(-tau_xi, X, Y)))
