"""Solve: the 6×6 normal equations of every grid point, and the covariance of their solution.

Unknowns of one window, in units of σ: θ = (u, σu_x, σu_y, v, σv_x, σv_y), J = (g_x, g_x X, g_x Y, g_y, g_y X, g_y Y).

    H = Σ w J Jᵀ,   b = Σ w J q,   θ = H⁻¹b                       normal equations (total or increment form)
    C = H̃⁻¹ (Σ w² r² J Jᵀ) H̃⁻¹                                    covariance, the sandwich form

The sandwich takes the residual where it is: noise that is larger on bright pixels, or a few unmatched particles, is counted with the weight it
had in the solution. H̃ is H less what noise alone adds to the gradients' squares: the residual's slope has no such part, because noise is not correlated with its own
difference. A point whose H̃ is not safely positive has no texture above its noise.

The noise part γ of H is not without effect: it ties a point to the blend of its neighbours, (H̃ + γ)e = γ·(blend of e) − Σ w J n, which
holds back the errors that vary within a window. White noise then leaves, with ρ = γ/H̃ and M = exp(−k²σ²/2) as q = k²σ²,

    ∫ e^−q / (1 + ρ(1 − e^−q/2))² dq        of the displacement's variance, and
    ∫ q e^−q / (1 + ρ(1 − e^−q/2))² dq      of the gradients'                        (`noise_feedback`).
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.compiler import kernel


@kernel
def _assemble(moments: NDArray[Any], matrix: NDArray[Any]) -> None:
    """6×6 matrix Σ w f ⊗ (1, X, Y)(1, X, Y)ᵀ from the 18 moments of g_x², g_x g_y, g_y²."""
    for block in range(3):
        m = moments[6 * block : 6 * block + 6]
        row, column = (3 if block == 2 else 0), (0 if block == 0 else 3)
        matrix[row, column] = m[0]
        matrix[row, column + 1] = matrix[row + 1, column] = m[1]
        matrix[row, column + 2] = matrix[row + 2, column] = m[2]
        matrix[row + 1, column + 1] = m[3]
        matrix[row + 1, column + 2] = matrix[row + 2, column + 1] = m[4]
        matrix[row + 2, column + 2] = m[5]
    for i in range(3):
        for j in range(3):
            matrix[3 + j, i] = matrix[i, 3 + j]


@kernel
def cholesky(matrix: NDArray[Any], threshold: float) -> bool:
    """Lower Cholesky factor of a 6×6 matrix in place, with inverse diagonal; False where a pivot is not above `threshold` times its diagonal element."""
    for j in range(6):
        diagonal = matrix[j, j]
        pivot = diagonal
        for k in range(j):
            pivot -= matrix[j, k] * matrix[j, k]
        if not pivot > threshold * diagonal or not diagonal > 0:
            return False
        inverse = 1 / math.sqrt(pivot)
        matrix[j, j] = inverse
        for i in range(j + 1, 6):
            total = matrix[i, j]
            for k in range(j):
                total -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = total * inverse
    return True


@kernel
def cholesky_solve(factor: NDArray[Any], right: NDArray[Any]) -> None:
    """Solve L Lᵀ θ = right in place."""
    for i in range(6):
        total = right[i]
        for k in range(i):
            total -= factor[i, k] * right[k]
        right[i] = total * factor[i, i]
    for i in range(5, -1, -1):
        total = right[i]
        for k in range(i + 1, 6):
            total -= factor[k, i] * right[k]
        right[i] = total * factor[i, i]


@kernel
def solve_strip(moments: NDArray[Any], sigma: float, start: int, stop: int, out: NDArray[Any]) -> None:
    """Solve the normal equations of the grid rows start … stop.

    Parameters
    ----------
    moments : array, shape (rows, columns, 24)
    sigma : float
    out : array, shape (6, rows, columns)
        u, v, u_x, u_y, v_x, v_y; NaN where the equations are singular.
    """
    matrix = np.empty((6, 6))
    theta = np.empty(6)
    for j in range(start, stop):
        for i in range(moments.shape[1]):
            _assemble(moments[j, i], matrix)
            for k in range(6):
                theta[k] = moments[j, i, 18 + k]
            if cholesky(matrix, 1e-6):
                cholesky_solve(matrix, theta)
            else:
                theta[:] = np.nan
            out[0, j, i], out[1, j, i] = theta[0], theta[3]
            out[2, j, i], out[3, j, i] = theta[1] / sigma, theta[2] / sigma
            out[4, j, i], out[5, j, i] = theta[4] / sigma, theta[5] / sigma


FEEDBACK_STEP = 0.01


@cache
def noise_feedback() -> NDArray[np.float64]:
    """Factors of the standard errors of displacement and gradients at ρ = 0, 0.01, … 4; shape (2, 401)."""
    rho = FEEDBACK_STEP * np.arange(401)[:, None]
    q = (np.arange(4000) + 0.5) / 200
    held = np.exp(-q) / (1 + rho * (1 - np.exp(-q / 2))) ** 2 / 200
    return np.sqrt(np.stack([held.sum(axis=1), (q * held).sum(axis=1)]))


@kernel
def covariance_strip(
    moments: NDArray[Any],
    sandwich: NDArray[Any],
    noise_gradient: NDArray[Any],
    feedback: NDArray[Any],
    transform: NDArray[Any],
    start: int,
    stop: int,
    out: NDArray[Any],
    texture: NDArray[Any],
) -> None:
    """Covariance of the six numbers for the grid rows start … stop.

    Parameters
    ----------
    moments : array, shape (rows, columns, 24)
    sandwich : array, shape (rows, columns, 18)
    noise_gradient : array, shape (rows, columns)
        What noise alone adds to Σ w g_x² (and Σ w g_y²).
    feedback : array, shape (2, entries)
        From `noise_feedback`.
    transform : array, shape (6, 6)
        From the unknowns θ to the six numbers.
    out : array, shape (rows, columns, 6, 6)
        NaN where the texture does not rise above the noise.
    texture : array, shape (rows, columns)
        Smallest eigenvalue of the 2×2 matrix Σ w g gᵀ, less noise, over the noise: the weakest direction's signal-to-noise ratio (power); 0 where
        there is one direction only.
    """
    full, meat = np.empty((6, 6)), np.empty((6, 6))
    bread, half = np.empty((6, 6)), np.empty((6, 6))
    column = np.empty(6)
    for j in range(start, stop):
        for i in range(moments.shape[1]):
            m = moments[j, i]
            gamma = noise_gradient[j, i]
            a, b, c = m[0] - gamma, m[6], m[12] - gamma
            weakest = (a + c) / 2 - math.sqrt((a - c) * (a - c) / 4 + b * b)
            if weakest < 1e-4 * (a + c):  # an edge or a grating: one direction only
                texture[j, i] = 0.0
            else:
                texture[j, i] = weakest / gamma if gamma > 0 else np.inf
            _assemble(m, full)
            for k in range(2):  # white noise adds Σw(1, X, Y)(1, X, Y)ᵀ, which is diagonal in a whole window
                full[3 * k, 3 * k] -= gamma
                full[3 * k + 1, 3 * k + 1] -= gamma
                full[3 * k + 2, 3 * k + 2] -= gamma
            if not cholesky(full, 1e-6):
                out[j, i] = np.nan
                continue
            rho = 2 * gamma / (a + c) / FEEDBACK_STEP
            entry = int(min(rho, feedback.shape[1] - 1.0))
            _assemble(sandwich[j, i], meat)
            for k in range(6):  # bread = transform · H̃⁻¹, row by row
                for n in range(6):
                    column[n] = transform[k, n]
                cholesky_solve(full, column)
                factor = feedback[0 if k < 2 else 1, entry]
                for n in range(6):
                    bread[k, n] = factor * column[n]
            for k in range(6):
                for n in range(6):
                    total = 0.0
                    for s in range(6):
                        total += bread[k, s] * meat[s, n]
                    half[k, n] = total
            for k in range(6):
                for n in range(k + 1):
                    total = 0.0
                    for s in range(6):
                        total += half[k, s] * bread[n, s]
                    out[j, i, k, n] = total
                    out[j, i, n, k] = total
