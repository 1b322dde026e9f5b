"""Combination of phases: the parameters of the six generators from the phase shifts of many operators.

Operator j shifts its phase by −Σ_k o_jk τ_k, with orders o_jk along the two generators of its own pair and 0 along all
others. At every point the weighted least squares

    minimise Σ_j |g_j|² (Δφ_j + Σ_k o_jk τ_k)²

over the stable operators gives τ. Where all operators of a generator have no other order this is the mean of
τ_j = −Δφ_j/o_j with the weights |g_j|² o_j², the inverse variances of single readings. An operator with both orders
of its pair cannot separate the two, and two or more of them can.

| symbol | name |
|---|---|
| o_jk | `rates` |
| Δφ_j | `phase` |
| abs(g_j)² | `weight`, 0 where an operator is not stable |
| q_fj | `sensitivity`: the noise n_fj of response j in frame f turns the phase by Im q_fj n_fj |
| C | `noise_covariance` of (Re n, Im n), per frame |

The solution is linear in the phases, τ = −B Δφ, and Im q n = (Im q) Re n + (Re q) Im n, so that with
A_f = B [diag Im q_f, diag Re q_f] its covariance is Σ_f A_f C A_fᵀ: kernels overlap, and their noise is correlated.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from sixflow.eigenfilters.geometry import Real
from sixflow.eigenfilters.kernel import Complex

_SINGULAR = 1e-9


@dataclasses.dataclass(frozen=True, eq=False)
class Combination:
    """Parameters of the six generators at each point; NaN where no stable operators determine one.

    Attributes
    ----------
    tau : array, shape (points, 6)
        τ_x, τ_y (px), τ_s, τ_r, τ_b, τ_B, per frame interval where velocities were asked for.
        `sixflow.convention.six_from_coefficients` makes the six numbers of them.
    covariance : array, shape (points, 6, 6)
        Of them, by the noise of the frames.
    operators : int array, shape (points, 6)
        How many stable operators have an order along each generator.
    """

    tau: Real
    covariance: Real
    operators: NDArray[np.intp]

    @property
    def standard_error(self) -> Real:
        """Square root of the diagonal of the covariance, shape (points, 6)."""
        return np.sqrt(np.diagonal(self.covariance, axis1=-2, axis2=-1))


def combine_phases(
    rates: Real, phase: Real, weight: Real, sensitivity: Complex, noise_covariance: Real
) -> Combination:
    """Solve for the parameters at every point.

    Parameters
    ----------
    rates : array, shape (points, K, 6)
        Orders, or instantaneous frequencies: the phase changes by −rates per unit of τ; 0 for other generators.
    phase : array, shape (points, K)
        Phase shifts, rad.
    weight : array, shape (points, K)
        At least 0; phases of weight 0 may be NaN.
    sensitivity : complex array, shape (2, points, K)
        Of the phases to the noise of two independent frames.
    noise_covariance : array, shape (2K, 2K)
        Of the real parts followed by the imaginary parts of the responses to one frame's noise.

    Examples
    --------
    Two Gabor pairs that each see u + v/2 and u − v/2 of (u, v) = (0.3, 0.2):

    >>> orders = np.array([[[1.0, 0.5, 0, 0, 0, 0], [1.0, -0.5, 0, 0, 0, 0]]])
    >>> phase = -np.array([[0.4, 0.2]])
    >>> found = combine_phases(orders, phase, np.ones((1, 2)), np.ones((2, 1, 2), complex), np.eye(4))
    >>> found.tau.round(3)
    array([[0.3, 0.2, nan, nan, nan, nan]])
    """
    used = weight > 0
    rates = np.where(used[..., None], rates, 0.0)
    weighted = np.swapaxes(rates * np.where(used, weight, 0.0)[..., None], -1, -2)
    normal = weighted @ rates
    size = np.sqrt(np.diagonal(normal, axis1=-2, axis2=-1))
    scale = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0)
    values, vectors = np.linalg.eigh(scale[:, :, None] * normal * scale[:, None, :])
    regular = values > _SINGULAR
    inverse = np.divide(1.0, values, out=np.zeros_like(values), where=regular)
    solve = (vectors * inverse[:, None, :]) @ np.swapaxes(vectors, -1, -2)
    known = (vectors**2 * ~regular[:, None, :]).sum(axis=-1) < _SINGULAR
    B = scale[:, :, None] * solve * scale[:, None, :] @ weighted
    tau = -(B @ np.where(used, phase, 0.0)[..., None])[..., 0]
    covariance = np.zeros_like(normal)
    for q in sensitivity:
        q = np.where(used, q, 0.0)[:, None, :]
        A = np.concatenate([B * q.imag, B * q.real], axis=-1)
        covariance += A @ noise_covariance @ np.swapaxes(A, -1, -2)
    return Combination(
        np.where(known, tau, np.nan),
        np.where(known[:, :, None] & known[:, None, :], covariance, np.nan),
        np.count_nonzero(rates, axis=1),
    )
