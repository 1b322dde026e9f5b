"""Weights of the points of a region.

The covariance C_p of a point is itself an estimate, from the residuals under one window. Weights C_p⁻¹ follow its
noise: they favour points that happen to claim too little, so that the fit is about a percent noisier than it could be
and claims to be a percent or two better than it is. The texture, which the weights are meant to follow, changes
from window to window only; so they are taken from the mean precision around a point,

    P_p = Σ_q c(q − p) C_q⁻¹ / Σ_q c(q − p),     c(d) = exp(−|d|²/4σ²),

c being how windows at a distance d overlap (`correlation`). A point may be much worse than its neighbours, or much
better, by more than noise: its window is cut, or half of it does not match. With λ, the eigenvalues of P^½ C P^½,

    W_p = P_p^½ V diag f(λ) Vᵀ P_p^½,     f(λ) = 1 for ½ ≤ λ ≤ 2,   2/λ above,   1/(2λ) below,

so that no combination of the numbers has more than twice, or less than half the weight that its own variance calls
for. C_p, with all its noise, is then needed linearly only, to say what errors the fit has.

| symbol | name |
|---|---|
| C, W | `covariance`, `weights` |
| P | `precision_around` |
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

BAND = 2.0
"""Factor by which a variance may differ from the neighbours' before it counts by itself."""


def symmetric_power(matrices: Array, power: float) -> Array:
    """Return powers of symmetric matrices, shape (n, k, k): positive definite ones, or but for rounding so."""
    values, axes = np.linalg.eigh(matrices)
    if power > 0:
        values = np.maximum(values, 0)
    return np.asarray(np.einsum("nij,nj,nkj->nik", axes, values**power, axes))


def precision_around(covariance: Array, used: NDArray[np.bool_], x: Array, y: Array, sigma: float) -> Array:
    """Return the mean precision around each point.

    Parameters
    ----------
    covariance : array, shape (n, 6, 6)
        Of the points that are used, row by row.
    used : bool array, shape (rows, columns)
        With n points.
    x, y : arrays, shape (columns,), (rows,)
        Of the grid, px.
    sigma : float
        Standard deviation of the window, px.

    Returns
    -------
    array, shape (n, 6, 6)
    """
    grid = np.zeros((*used.shape, 37))
    grid[used, :36] = np.linalg.inv(covariance).reshape(-1, 36)
    grid[used, 36] = 1
    along_x, along_y = (np.exp(-(((at - at[:, None]) / (2 * sigma)) ** 2)) for at in (x, y))
    seen = np.tensordot(along_y, grid, axes=(1, 0))
    sums = np.swapaxes(np.tensordot(along_x, seen, axes=(1, 1)), 0, 1)[used]
    return np.asarray((sums[:, :36] / sums[:, 36:]).reshape(-1, 6, 6))


def weights(covariance: Array, around: Array) -> Array:
    """Return the weight matrices of points.

    Parameters
    ----------
    covariance, around : arrays, shape (n, 6, 6)
        Of the points, and the mean precision around them.

    Returns
    -------
    array, shape (n, 6, 6)
        Symmetric, positive definite.
    """
    root = symmetric_power(around, 0.5)
    ratio, axes = np.linalg.eigh(root @ covariance @ root)
    side = root @ axes
    return np.asarray(np.einsum("nij,nj,nkj->nik", side, np.clip(ratio, 1 / BAND, BAND) / ratio, side))
