"""Replace: what the neighbours of a failed point predict, on request, with a covariance that says so.

A measured point n at the offset h predicts T(h) six_n, the affine map carried to the failed point. The prediction is
the mean m over the measured points of the smallest square about it that holds four, with weights 1/(variance of the
predicted displacement), and its covariance

    C = Σ ŵ T C_n Tᵀ  +  mean of (T six_n − m)(T six_n − m)ᵀ over the square that reaches half a window further

the mean covariance, because neighbours share their windows and err together, and the scatter of the predictions, also
of those from beyond: where a motion ends, the nearest points may all lie on one side. Nothing is predicted further
than one window from a measured point.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

ENOUGH = 4


def carry(hx: float, hy: float) -> NDArray[np.float64]:
    """T(h): the six numbers of an affine map, (hx, hy) px further; shape (6, 6)."""
    T = np.eye(6)
    T[0, 2:] = [hx / 2, -hy / 2, hx / 2, hy / 2]  # u_x = ½(divergence + stretch), u_y = ½(shear − curl)
    T[1, 2:] = [hy / 2, hx / 2, -hy / 2, hx / 2]  # v_y = ½(divergence − stretch), v_x = ½(shear + curl)
    return T


def predictions(
    six: NDArray[Any], covariance: NDArray[Any], wanted: NDArray[np.bool_], step: int, window: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Predict the six numbers at points from the measured points around them.

    Parameters
    ----------
    six : array, shape (rows, columns, 6)
        NaN where not measured.
    covariance : array, shape (rows, columns, 6, 6)
    wanted : bool array, shape (rows, columns)
    step : int
        Grid spacing, px.
    window : float
        px.

    Returns
    -------
    six : array, shape (points, 6)
        In the order of `np.nonzero(wanted)`; NaN where too few points were measured nearby.
    covariance : array, shape (points, 6, 6)
    known : bool array, shape (points,)
    """
    measured = np.isfinite(six).all(axis=-1) & np.isfinite(covariance).all(axis=(-2, -1)) & ~wanted
    at = np.stack(np.nonzero(wanted), axis=-1)
    out, spread = np.full((len(at), 6), np.nan), np.full((len(at), 6, 6), np.nan)
    farther = max(1, round(window / 2 / step))
    for k, (j, i) in enumerate(at):
        for reach in range(1, max(1, int(window / step)) + 1):
            near = _around(measured, j, i, reach)
            if len(near[0]) >= ENOUGH:
                mean, within = _combined(*_predicted(six, covariance, j, i, step, near))
                off = (
                    _predicted(six, covariance, j, i, step, _around(measured, j, i, reach + farther))[0]
                    - mean
                )
                out[k], spread[k] = mean, within + off.T @ off / len(off)
                break
    return out, spread, np.isfinite(out).all(axis=-1)


def _around(measured: NDArray[np.bool_], j: int, i: int, reach: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """Rows and columns of the measured points of the square about (j, i)."""
    top, left = max(0, j - reach), max(0, i - reach)
    y, x = np.nonzero(measured[top : j + reach + 1, left : i + reach + 1])
    return y + top, x + left


def _predicted(
    six: NDArray[Any],
    covariance: NDArray[Any],
    j: int,
    i: int,
    step: int,
    at: tuple[NDArray[Any], NDArray[Any]],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Predictions of points for (j, i), shape (N, 6), and their covariances."""
    T = np.stack([carry(step * (i - x), step * (j - y)) for y, x in zip(*at, strict=True)])
    carried = T @ covariance[at].astype(np.float64) @ np.swapaxes(T, -1, -2)
    return (T @ six[at].astype(np.float64)[..., None])[..., 0], carried


def _combined(
    predicted: NDArray[np.float64], carried: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Weighted means of predictions and of their covariances."""
    variance = carried[:, 0, 0] + carried[:, 1, 1]
    weight = 1 / np.maximum(variance, 1e-3 * variance.max() + 1e-30)
    weight /= weight.sum()
    return weight @ predicted, np.einsum("n,nij->ij", weight, carried)


def replace_failed(
    six: NDArray[Any], covariance: NDArray[Any], wanted: NDArray[np.bool_], step: int, window: float
) -> NDArray[np.bool_]:
    """Write what the neighbours predict, in place, to the points of a field where it is wanted and known.

    Parameters
    ----------
    six, covariance, wanted, step, window
        As for `predictions`.

    Returns
    -------
    bool array, shape (rows, columns)
        Points that were replaced.
    """
    predicted, spread, known = predictions(six, covariance, wanted, step, window)
    at = np.flatnonzero(wanted)[known]
    six.reshape(-1, 6)[at], covariance.reshape(-1, 6, 6)[at] = predicted[known], spread[known]
    replaced = np.zeros(wanted.shape, np.bool_)
    replaced.ravel()[at] = True
    return replaced
