"""Solve: the 6×6 normal equations of every grid point, and the covariance of their solution.

Unknowns of one window, in units of σ: θ = (u, σu_x, σu_y, v, σv_x, σv_y), J = (g_x, g_x X, g_x Y, g_y,
g_y X, g_y Y).

    H = Σ w J Jᵀ,   b = Σ w J q,   θ = H⁻¹b                       normal equations (total or increment form)
    C = H̃⁻¹ (Σ w² r² J Jᵀ) H̃⁻¹                                    covariance, the sandwich form

The sandwich takes the residual where it is: noise that is larger on bright pixels, or a few unmatched
particles, is counted with the weight it had in the solution. H̃ is H less what noise alone adds to the
gradients' squares: the residual's slope has no such part, because noise is not correlated with its own
difference. A point whose H̃ is not safely positive has no texture above its noise.

The noise part γ of H is not without effect: it ties a point to the blend of its neighbours, (H̃ + γ)e =
γ·(blend of e) − Σ w J n, which holds back the errors that vary within a window. White noise then
leaves, with ρ = γ/H̃ and M = exp(−k²σ²/2) as q = k²σ²,

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

LANES = 16
"""Points that are worked on side by side: every loop below ends in one over LANES points, which is
vector code.
"""

FEEDBACK_STEP = 0.01


@kernel
def assemble(moments: NDArray[Any], j: int, first: int, matrix: NDArray[Any]) -> None:
    """6×6 matrices Σ w f ⊗ (1, X, Y)(1, X, Y)ᵀ of LANES points from their 18 moments of g_x², g_x g_y, g_y².

    `moments` is (rows, columns, ≥ 18); lanes beyond the last column repeat it. `matrix` is (6, 6,
    LANES); its lower triangle is written.
    """
    last = moments.shape[1] - 1
    for lane in range(LANES):
        m = moments[j, min(first + lane, last)]
        for block in range(3):
            row, column, at = (3 if block > 0 else 0), (3 if block == 2 else 0), 6 * block
            matrix[row, column, lane] = m[at]
            matrix[row + 1, column, lane] = m[at + 1]
            matrix[row + 2, column, lane] = m[at + 2]
            matrix[row + 1, column + 1, lane] = m[at + 3]
            matrix[row + 2, column + 1, lane] = m[at + 4]
            matrix[row + 2, column + 2, lane] = m[at + 5]
            if block == 1:  # off-diagonal block, symmetric itself
                matrix[row, column + 1, lane] = m[at + 1]
                matrix[row, column + 2, lane] = m[at + 2]
                matrix[row + 1, column + 2, lane] = m[at + 4]


def normal_matrices(moments: NDArray[Any]) -> NDArray[np.float64]:
    """The 6×6 matrices of (rows, columns, ≥ 18) moments, as `assemble` makes them; (rows, columns, 6, 6)."""
    order = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])
    a, b, c = (moments[..., 6 * block + order].astype(np.float64) for block in range(3))
    return np.concatenate([np.concatenate([a, b], axis=-1), np.concatenate([b, c], axis=-1)], axis=-2)


@kernel
def cholesky(matrix: NDArray[Any]) -> None:
    """Lower Cholesky factors of (6, 6, LANES) matrices in place, with inverse diagonals.

    A matrix that is not safely positive definite (a pivot below 1e-6 of its diagonal element) becomes NaN.
    """
    for j in range(6):
        diagonal = matrix[j, j]
        for lane in range(LANES):
            pivot = diagonal[lane]
            for k in range(j):
                pivot -= matrix[j, k, lane] * matrix[j, k, lane]
            safe = pivot > 1e-6 * diagonal[lane] and diagonal[lane] > 0
            diagonal[lane] = 1 / math.sqrt(pivot) if safe else np.nan
        for i in range(j + 1, 6):
            below = matrix[i, j]
            for k in range(j):
                a, b = matrix[i, k], matrix[j, k]
                for lane in range(LANES):
                    below[lane] -= a[lane] * b[lane]
            for lane in range(LANES):
                below[lane] *= diagonal[lane]


@kernel
def cholesky_solve(factor: NDArray[Any], right: NDArray[Any]) -> None:
    """Solve L Lᵀ θ = right in place; factor (6, 6, LANES) from `cholesky`, right (6, LANES)."""
    for i in range(6):
        target, diagonal = right[i], factor[i, i]
        for k in range(i):
            a, b = factor[i, k], right[k]
            for lane in range(LANES):
                target[lane] -= a[lane] * b[lane]
        for lane in range(LANES):
            target[lane] *= diagonal[lane]
    for i in range(5, -1, -1):
        target, diagonal = right[i], factor[i, i]
        for k in range(i + 1, 6):
            a, b = factor[k, i], right[k]
            for lane in range(LANES):
                target[lane] -= a[lane] * b[lane]
        for lane in range(LANES):
            target[lane] *= diagonal[lane]


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
    matrix = np.empty((6, 6, LANES))
    theta = np.empty((6, LANES))
    columns = moments.shape[1]
    for j in range(start, stop):
        for first in range(0, columns, LANES):
            assemble(moments, j, first, matrix)
            for lane in range(LANES):
                m = moments[j, min(first + lane, columns - 1)]
                for k in range(6):
                    theta[k, lane] = m[18 + k]
            cholesky(matrix)
            cholesky_solve(matrix, theta)
            for lane in range(min(LANES, columns - first)):
                i = first + lane
                out[0, j, i], out[1, j, i] = theta[0, lane], theta[3, lane]
                out[2, j, i], out[3, j, i] = theta[1, lane] / sigma, theta[2, lane] / sigma
                out[4, j, i], out[5, j, i] = theta[4, lane] / sigma, theta[5, lane] / sigma


@kernel
def explained_strip(
    moments: NDArray[Any], update: NDArray[Any], sigma: float, start: int, stop: int, out: NDArray[Any]
) -> None:
    """ΔᵀHΔ: by how much a pass lowered Σ w r² when it moved the points by `update`, grid rows start … stop.

    The residual that a pass saw is that of its start; this is what its own update then took out of it.

    Parameters
    ----------
    moments : array, shape (rows, columns, ≥ 18)
    update : array, shape (6, rows, columns)
        Change of u, v, u_x, u_y, v_x, v_y.
    sigma : float
    out : array, shape (rows, columns)
    """
    for j in range(start, stop):
        for i in range(moments.shape[1]):
            m = moments[j, i]
            a0, a1, a2 = update[0, j, i], update[2, j, i] * sigma, update[3, j, i] * sigma
            b0, b1, b2 = update[1, j, i], update[4, j, i] * sigma, update[5, j, i] * sigma
            # products of the two displacement corrections, as coefficients of 1, X, Y, X², XY, Y²
            total = 0.0
            for block in range(3):
                p0, p1, p2 = (b0, b1, b2) if block == 2 else (a0, a1, a2)
                q0, q1, q2 = (a0, a1, a2) if block == 0 else (b0, b1, b2)
                n = 6 * block
                form = p0 * q0 * m[n] + (p0 * q1 + p1 * q0) * m[n + 1] + (p0 * q2 + p2 * q0) * m[n + 2]
                form += p1 * q1 * m[n + 3] + (p1 * q2 + p2 * q1) * m[n + 4] + p2 * q2 * m[n + 5]
                total += 2 * form if block == 1 else form
            out[j, i] = total


@cache
def noise_feedback() -> NDArray[np.float64]:
    """Factors of the standard errors of displacement and gradients at ρ = 0, 0.01, … 4; shape (2, 401)."""
    rho = FEEDBACK_STEP * np.arange(401)[:, None]
    q = (np.arange(4000) + 0.5) / 200
    held = np.exp(-q) / (1 + rho * (1 - np.exp(-q / 2))) ** 2 / 200
    return np.sqrt(np.stack([held.sum(axis=1), (q * held).sum(axis=1)]))


@kernel
def texture_strip(
    moments: NDArray[Any],
    noise_gradient: NDArray[Any],
    start: int,
    stop: int,
    texture: NDArray[Any],
    rho: NDArray[Any],
) -> None:
    """Signal-to-noise ratio of the gradients of every window, grid rows start … stop.

    Parameters
    ----------
    moments : array, shape (rows, columns, ≥ 18)
    noise_gradient : array, shape (rows, columns)
        γ, what noise alone adds to Σ w g_x² (and Σ w g_y²).
    texture : array, shape (rows, columns)
        Smallest eigenvalue of the 2×2 matrix Σ w g gᵀ, less noise, over the noise: the weakest
        direction's signal-to-noise ratio (power); 0 where there is one direction only.
    rho : array, shape (rows, columns)
        γ over the mean of the two eigenvalues less noise; negative where there is nothing but noise.
    """
    for j in range(start, stop):
        for i in range(moments.shape[1]):
            m, gamma = moments[j, i], noise_gradient[j, i]
            a, b, c = m[0] - gamma, m[6], m[12] - gamma
            weakest = (a + c) / 2 - math.sqrt((a - c) * (a - c) / 4 + b * b)
            rho[j, i] = 2 * gamma / (a + c)
            if not weakest > 1e-4 * (a + c):  # an edge or a grating: one direction only
                texture[j, i] = 0.0
            else:
                texture[j, i] = weakest / gamma if gamma > 0 else np.inf


@kernel
def _multiply(a: NDArray[Any], b: NDArray[Any], out: NDArray[Any]) -> None:
    """Σ_s a[s] b[s] of LANES points; a and b (6, LANES), out (LANES,)."""
    for lane in range(LANES):
        out[lane] = 0
    for s in range(6):
        x, y = a[s], b[s]
        for lane in range(LANES):
            out[lane] += x[lane] * y[lane]


@kernel
def _bread(
    matrix: NDArray[Any], transform: NDArray[Any], rho: NDArray[Any], feedback: NDArray[Any], first: int,
    bread: NDArray[Any],
) -> None:  # fmt: skip
    """Rows of transform · H̃⁻¹ of LANES points from the first on, with the feedback of noise; H̃ is overwritten."""
    cholesky(matrix)
    factor = np.empty((2, LANES))
    for lane in range(LANES):
        entry = int(
            min(max(rho[min(first + lane, rho.size - 1)] / FEEDBACK_STEP, 0.0), feedback.shape[1] - 1.0)
        )
        factor[0, lane], factor[1, lane] = feedback[0, entry], feedback[1, entry]
    for k in range(6):
        row, scale = bread[k], factor[0 if k < 2 else 1]
        for n in range(6):
            for lane in range(LANES):
                row[n, lane] = transform[k, n]
        cholesky_solve(matrix, row)
        for n in range(6):
            for lane in range(LANES):
                row[n, lane] *= scale[lane]


@kernel
def covariance_strip(
    moments: NDArray[Any],
    sandwich: NDArray[Any],
    noise_gradient: NDArray[Any],
    rho: NDArray[Any],
    feedback: NDArray[Any],
    transform: NDArray[Any],
    start: int,
    stop: int,
    out: NDArray[Any],
) -> None:
    """Covariance of the six numbers for the grid rows start … stop.

    Parameters
    ----------
    moments : array, shape (rows, columns, 24)
    sandwich : array, shape (rows, columns, 18)
    noise_gradient, rho : arrays, shape (rows, columns)
        As for `texture_strip`.
    feedback : array, shape (2, entries)
        From `noise_feedback`.
    transform : array, shape (6, 6)
        From the unknowns θ to the six numbers.
    out : array, shape (rows, columns, 6, 6)
        NaN where the texture does not rise above the noise.
    """
    full, meat = np.empty((6, 6, LANES)), np.empty((6, 6, LANES))
    bread, half, total = np.empty((6, 6, LANES)), np.empty((6, LANES)), np.empty(LANES)
    columns = moments.shape[1]
    for j in range(start, stop):
        for first in range(0, columns, LANES):
            assemble(moments, j, first, full)
            assemble(sandwich, j, first, meat)
            for k in range(6):
                for n in range(k + 1, 6):
                    upper, lower = meat[k, n], meat[n, k]
                    for lane in range(LANES):
                        upper[lane] = lower[lane]
            for lane in range(LANES):
                gamma = noise_gradient[j, min(first + lane, columns - 1)]
                for k in range(6):  # white noise adds γ Σw(1, X, Y)(1, X, Y)ᵀ, diagonal in a whole window
                    full[k, k, lane] -= gamma
            _bread(full, transform, rho[j], feedback, first, bread)
            count = min(LANES, columns - first)
            for k in range(6):
                for n in range(6):
                    _multiply(bread[k], meat[:, n], half[n])
                for n in range(k + 1):
                    _multiply(half, bread[n], total)
                    for lane in range(count):
                        out[j, first + lane, k, n] = out[j, first + lane, n, k] = total[lane]
