"""Composition, inverse, exponential and logarithm of affine maps, as 3×3 matrices and as the six numbers.

| 3×3 | six | meaning |
|---|---|---|
| `compose` | `compose_six` | the second map after the first |
| `inverse` | `inverse_six` | from the moved frame back to the reference |
| `exp` | `exp_six` | the displacement that a constant velocity field makes in one frame |
| `log` | `log_six` | the constant velocity field that makes the displacement in one frame |

The functions of the six calculate with d and G themselves, never with I + G, so that small motions keep all
their digits. The logarithm is the principal one: rotation within (−π, π]. It is real unless I + G has an
eigenvalue that is negative or zero (a map that folds, collapses, or turns by exactly π).

The parameters τ of the one-parameter groups of Eagleson, eq. (4), are `coefficients_from_six`: to first order
divergence = 2τ_s, curl = 2τ_r, stretch = 2τ_b, shear = 2τ_B; for the logarithm exactly so. (As corrected
here: the group of L_B is the hyperbolic rotation, the print having cos and sin for cosh and sinh:
x' = x cosh τ + y sinh τ, y' = x sinh τ + y cosh τ.)
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sixflow.array_checks import Array, Invalid, as_floats, refuse, require_broadcast, require_invalid, silent
from sixflow.convention._closed_form import (
    apply_pair,
    determinants,
    expm1_pair,
    half_log_determinant,
    inverse_phi_pair,
    log_factor,
    phi_pair,
    square,
)
from sixflow.convention.six import (
    affine_from_six,
    algebra_from_six,
    gradient,
    six_from_affine,
    six_from_algebra,
    six_from_gradient,
    times,
)

_SINGULAR = "singular (det(I + G) = 0), without inverse"
_NO_LOGARITHM = "without real logarithm (I + G has a negative or zero eigenvalue)"
SIX_PER_COEFFICIENT = np.array([1, 1, 2, 2, 2, 2], dtype=np.float32)
"""The six of each generator: (1, 1, 2, 2, 2, 2) times its coefficient. Read-only."""
SIX_PER_COEFFICIENT.flags.writeable = False


@silent
def compose_six(second: ArrayLike, first: ArrayLike) -> Array:
    """The six numbers of the map `second` after `first`: d = d₂ + d₁ + G₂ d₁, G = G₂ + G₁ + G₂ G₁.

    Both belong to the same point c. If `second` was measured at the point's new place c + d₁, hand over
    `recentre(second, -d1)`.

    Parameters
    ----------
    second, first : array, shape (..., 6)
        Leading dimensions are broadcast.

    Returns
    -------
    array, shape (..., 6)

    Examples
    --------
    A zoom by 1.5 after a shift by 2 px, which the zoom enlarges:

    >>> compose_six([0, 0, 1.0, 0, 0, 0], [2.0, 0, 0, 0, 0, 0])
    array([3., 0., 1., 0., 0., 0.])
    """
    second, first = as_floats("second", second, (6,)), as_floats("first", first, (6,))
    require_broadcast(second=second.shape[:-1], first=first.shape[:-1])
    d1, d2, G1, G2 = first[..., :2], second[..., :2], gradient(first), gradient(second)
    return six_from_gradient(d2 + (d1 + times(G2, d1)), G2 + G1 + np.matmul(G2, G1))


@silent
def inverse_six(six: ArrayLike, *, invalid: Invalid = "raise") -> Array:
    """The six numbers of the inverse map: G' = (I + G)⁻¹ − I, d' = −(I + G)⁻¹ d.

    Parameters
    ----------
    six : array, shape (..., 6)
    invalid : {"raise", "nan"}
        What to do where I + G is singular. NaN elements always stay NaN.

    Returns
    -------
    array, shape (..., 6)

    Raises
    ------
    InputError
        If I + G is singular somewhere and `invalid` is "raise".

    Examples
    --------
    >>> inverse_six([3.0, 0, 2.0, 0, 0, 0])
    array([-1.5,  0. , -1. ,  0. ,  0. ,  0. ])
    """
    six = as_floats("six", six, (6,))
    require_invalid(invalid)
    d, four = six[..., :2], six[..., 2:]
    det_G, det = determinants(four)
    singular = det == 0
    refuse("six", singular, _SINGULAR, invalid)
    trace = four[..., 0] + 2 * det_G
    back = -np.concatenate([trace[..., None], four[..., 1:]], axis=-1) / det[..., None]
    back_d = -apply_pair(1 + back[..., 0] / 2, np.ones_like(det), back, d)
    return np.where(singular[..., None], np.nan, np.concatenate([back_d, back], axis=-1)) + 0.0


@silent
def exp_six(rates: ArrayLike) -> Array:
    """The six of the displacement that a constant velocity field makes in one frame (Eagleson, eq. (4)).

    I + G = exp(A) and d = ∫₀¹ exp(τA) dτ b, where b and A are displacement and gradient of the rates.

    Parameters
    ----------
    rates : array, shape (..., 6)
        The six numbers of the velocity field about the point, per frame: px, px, 1, 1, 1, 1; `curl` is twice
        the angle of rotation, rad.

    Returns
    -------
    array, shape (..., 6)
        inf or NaN where the result is beyond the range of floating-point numbers.

    Examples
    --------
    A rotation by a quarter turn about the point:

    >>> import numpy as np
    >>> exp_six([0, 0, 0, np.pi, 0, 0]).round(12)
    array([ 0.,  0., -2.,  2.,  0.,  0.])
    """
    rates = as_floats("rates", rates, (6,))
    b, four = rates[..., :2], rates[..., 2:]
    s, q = four[..., 0] / 2, square(four)
    trace, factor = expm1_pair(s, q)
    moved = apply_pair(*phi_pair(s, q), four, b)
    return np.concatenate([moved, 2 * trace[..., None], factor[..., None] * four[..., 1:]], axis=-1)


@silent
def log_six(six: ArrayLike, *, invalid: Invalid = "raise") -> Array:
    """The six of the constant velocity field that makes the displacement in one frame: inverse of `exp_six`.

    A = log(I + G), the principal matrix logarithm, and b = (∫₀¹ exp(τA) dτ)⁻¹ d. Divided by the frame
    interval it is a rate; its divergence is the logarithm of the area ratio, its curl twice the angle of a
    pure rotation.

    Parameters
    ----------
    six : array, shape (..., 6)
    invalid : {"raise", "nan"}
        What to do where there is no real logarithm. NaN elements always stay NaN.

    Returns
    -------
    array, shape (..., 6)
        px, px, 1, 1, 1, 1 per frame; |curl| at most 2π.

    Raises
    ------
    InputError
        If I + G has an eigenvalue that is negative or zero somewhere and `invalid` is "raise".

    Examples
    --------
    >>> log_six([0, 0, 2.0, 0, 0, 0]).round(6)
    array([0.      , 0.      , 1.386294, 0.      , 0.      , 0.      ])
    >>> log_six([0, 0, -4.0, 0, 0, 0], invalid="nan")
    array([nan, nan, nan, nan, nan, nan])
    """
    six = as_floats("six", six, (6,))
    require_invalid(invalid)
    d, four = six[..., :2], six[..., 2:]
    p, q = 1 + four[..., 0] / 2, square(four)
    finite = np.isfinite(four).all(axis=-1)
    possible = (q < 0) | ((p > 0) & (determinants(four)[1] > 0))
    refuse("six", finite & ~possible, _NO_LOGARITHM, invalid)
    half_log_det = half_log_determinant(four)
    factor = log_factor(p, q, half_log_det)
    rates = np.concatenate([2 * half_log_det[..., None], factor[..., None] * four[..., 1:]], axis=-1)
    moved = apply_pair(*inverse_phi_pair(rates[..., 0] / 2, square(rates)), rates, d)
    return np.where((finite & possible)[..., None], np.concatenate([moved, rates], axis=-1), np.nan)


def coefficients_from_six(six: ArrayLike, *, invalid: Invalid = "raise") -> Array:
    """Coefficients (τ_x, τ_y, τ_s, τ_r, τ_b, τ_B) of the generators whose flow makes the displacement.

    exp(Σ τ_k L_k) is the map of the six (Eagleson, eqs. (3) and (4)). To first order τ = (u, v, divergence/2,
    curl/2, stretch/2, shear/2); exactly, the same of `log_six`.

    Parameters
    ----------
    six : array, shape (..., 6)
    invalid : {"raise", "nan"}
        What to do where there is no real logarithm, an InputError or NaN, as in `log_six`.

    Returns
    -------
    array, shape (..., 6)
        px, px, then four dimensionless numbers: logarithm of the zoom, angle in rad, two hyperbolic angles.

    Examples
    --------
    >>> coefficients_from_six([2.0, 0, 0, 0, 0, 0])
    array([2., 0., 0., 0., 0., 0.])
    """
    return log_six(six, invalid=invalid) / SIX_PER_COEFFICIENT


def six_from_coefficients(coefficients: ArrayLike) -> Array:
    """The six numbers of the map exp(Σ τ_k L_k): the inverse of `coefficients_from_six`.

    Parameters
    ----------
    coefficients : array, shape (..., 6)
        (τ_x, τ_y, τ_s, τ_r, τ_b, τ_B).

    Returns
    -------
    array, shape (..., 6)

    Examples
    --------
    >>> import numpy as np
    >>> six_from_coefficients([0, 0, np.log(1.5), 0, 0, 0]).round(12)
    array([0., 0., 1., 0., 0., 0.])
    """
    return exp_six(as_floats("coefficients", coefficients, (6,)) * SIX_PER_COEFFICIENT)


def compose(second: ArrayLike, first: ArrayLike) -> Array:
    """The affine map `second` after `first`, as 3×3 matrices: their product.

    Parameters
    ----------
    second, first : array, shape (..., 3, 3)
        Last row (0, 0, 1). Leading dimensions are broadcast.

    Raises
    ------
    InputError
        If a last row is not (0, 0, 1).

    Examples
    --------
    >>> compose([[1, 0, 2], [0, 1, 0], [0, 0, 1]], [[2, 0, 0], [0, 2, 0], [0, 0, 1]])
    array([[2., 0., 2.],
           [0., 2., 0.],
           [0., 0., 1.]])
    """
    return affine_from_six(compose_six(six_from_affine(second), six_from_affine(first)))


def inverse(affine: ArrayLike, *, invalid: Invalid = "raise") -> Array:
    """The inverse of an affine map, as a 3×3 matrix.

    Parameters
    ----------
    affine : array, shape (..., 3, 3)
        Last row (0, 0, 1).
    invalid : {"raise", "nan"}
        What to do where the map is singular; with "nan" its first two rows become NaN.

    Returns
    -------
    array, shape (..., 3, 3)

    Raises
    ------
    InputError
        If a last row is not (0, 0, 1), or a map is singular and `invalid` is "raise".

    Examples
    --------
    >>> inverse([[2, 0, 2], [0, 2, 0], [0, 0, 1]])
    array([[ 0.5,  0. , -1. ],
           [ 0. ,  0.5,  0. ],
           [ 0. ,  0. ,  1. ]])
    """
    return affine_from_six(inverse_six(six_from_affine(affine), invalid=invalid))


def exp(algebra: ArrayLike) -> Array:
    """The affine map exp(Σ τ_k X_k) of an element of the Lie algebra (Eagleson, eqs. (3) and (4)).

    Parameters
    ----------
    algebra : array, shape (..., 3, 3)
        Last row (0, 0, 0), such as `algebra_from_six` makes.

    Returns
    -------
    array, shape (..., 3, 3)
        Last row (0, 0, 1).

    Raises
    ------
    InputError
        If a last row is not (0, 0, 0).

    Examples
    --------
    >>> import numpy as np
    >>> exp(np.log(2) * np.diag([1, 1, 0])).round(12)
    array([[2., 0., 0.],
           [0., 2., 0.],
           [0., 0., 1.]])
    """
    return affine_from_six(exp_six(six_from_algebra(algebra)))


def log(affine: ArrayLike, *, invalid: Invalid = "raise") -> Array:
    """The element of the Lie algebra whose exponential is the affine map: the principal logarithm.

    Parameters
    ----------
    affine : array, shape (..., 3, 3)
        Last row (0, 0, 1).
    invalid : {"raise", "nan"}
        What to do where there is no real logarithm; with "nan" the first two rows become NaN.

    Returns
    -------
    array, shape (..., 3, 3)
        Last row (0, 0, 0).

    Raises
    ------
    InputError
        If a last row is not (0, 0, 1), or a map has no real logarithm and `invalid` is "raise".

    Examples
    --------
    >>> log([[2, 0, 0], [0, 2, 0], [0, 0, 1]]).round(6)
    array([[0.693147, 0.      , 0.      ],
           [0.      , 0.693147, 0.      ],
           [0.      , 0.      , 0.      ]])
    """
    return algebra_from_six(log_six(six_from_affine(affine), invalid=invalid))
