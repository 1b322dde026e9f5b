"""Kanatani's planar flow: the motions of the projective group under the names of Eagleson, eq. (2).

    u = u₀ + A x + B y + (E x + F y) x
    v = v₀ + C x + D y + (E x + F y) y

is what a camera sees of a plane in rigid motion, to first order in time. The eight coefficients are linear in those of
the generators, so that the field is `PROJECTIVE.field`:

| Kanatani | u₀ | v₀ | A | B | C | D | E | F |
|---|---|---|---|---|---|---|---|---|
| τ | τ_x | τ_y | τ_s + τ_b | τ_B − τ_r | τ_B + τ_r | τ_s − τ_b | τ_E | τ_F |

x, y are px from the point that is the origin, u, v px per unit of time, E and F px⁻¹ per unit of time.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sixflow.array_checks import Array, as_floats, silent
from sixflow.convention import GRADIENT_FROM_SIX, SIX_FROM_GRADIENT
from sixflow.errors import InputError
from sixflow.groups.generators import NUMBER_PER_COEFFICIENT, constant
from sixflow.groups.projective import PROJECTIVE

EIGHT = ("u0", "v0", "A", "B", "C", "D", "E", "F")
"""Names of the eight coefficients of the planar flow, in their order."""


def _with_fanning(matrix: Array) -> Array:
    return np.block([[matrix, np.zeros((6, 2))], [np.zeros((2, 6)), np.eye(2)]])


COEFFICIENTS_FROM_EIGHT = constant(_with_fanning(SIX_FROM_GRADIENT) / NUMBER_PER_COEFFICIENT[:, None])
"""Matrix, shape (8, 8), that takes the eight coefficients of the planar flow to those of the generators. Read-only."""

EIGHT_FROM_COEFFICIENTS = constant(_with_fanning(GRADIENT_FROM_SIX) * NUMBER_PER_COEFFICIENT)
"""Its inverse. Read-only."""


@silent
def coefficients_from_eight(eight: ArrayLike) -> Array:
    """Coefficients τ of the projective group's generators, of a planar flow (Eagleson, eq. (2)).

    Parameters
    ----------
    eight : array, shape (..., 8)
        (u₀, v₀, A, B, C, D, E, F): px, px, 1, 1, 1, 1, px⁻¹, px⁻¹, per unit of time.

    Returns
    -------
    float64 array, shape (..., 8)
        In the order of `PROJECTIVE.symbols`. Covariance goes along as J C Jᵀ, J = `COEFFICIENTS_FROM_EIGHT`.

    Raises
    ------
    InputError
        If the shape or dtype is wrong.

    Examples
    --------
    >>> coefficients_from_eight([3, 0, 0.1, -0.2, 0.2, 0.1, 0, 0.01])
    array([3.  , 0.  , 0.1 , 0.2 , 0.  , 0.  , 0.  , 0.01])
    """
    array = as_floats("eight", eight, ()).astype(np.float64)
    if array.shape[-1:] != (8,):
        raise InputError(
            f"eight of shape {array.shape}: the last dimension must be 8, the coefficients {', '.join(EIGHT)} of the "
            "planar flow"
        )
    return np.einsum("kl,...l->...k", COEFFICIENTS_FROM_EIGHT, array) + 0.0


@silent
def eight_from_coefficients(coefficients: ArrayLike) -> Array:
    """The planar flow (u₀, v₀, A, B, C, D, E, F) of a motion: the inverse of `coefficients_from_eight`.

    Parameters
    ----------
    coefficients : array, shape (..., 8)
        Of the generators of `PROJECTIVE`.

    Returns
    -------
    float64 array, shape (..., 8)

    Raises
    ------
    InputError
        If the shape or dtype is wrong.

    Examples
    --------
    A rotation by 0.2 per unit of time:

    >>> eight_from_coefficients([0, 0, 0, 0.2, 0, 0, 0, 0])
    array([ 0. ,  0. ,  0. , -0.2,  0.2,  0. ,  0. ,  0. ])
    """
    tau = PROJECTIVE.vector("coefficients", coefficients)
    return np.einsum("kl,...l->...k", EIGHT_FROM_COEFFICIENTS, tau) + 0.0
