"""Size and direction of a quantity of weight n ≥ 1, and what is known of them.

For z = x + iy of weight n, with the covariance C of (x, y) and the unit vectors e = (cos, sin) along z and
e⊥ = (−sin, cos) across it,

    size |z|            variance eᵀ C e
    direction arg(z)/n  variance e⊥ᵀ C e⊥ / (n |z|)²    covariance eᵀ C e⊥ / (n |z|)

to first order in the errors: right while |z| is several standard errors. Nearer to 0 the size is too large on average,
E|z|² = |true z|² + C_xx + C_yy, and the direction's error is beyond first order; a direction of weight n that is
not known at all has the standard error 2π/(n√12).

*At z = 0* neither has a derivative. The size's variance is there the larger eigenvalue of C, the largest that any
direction would give. The direction is undetermined: it is returned as 0 with infinite variance, and covariances with
the two are NaN.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sixflow.array_checks import Array, require_broadcast, silent
from sixflow.errors import InputError
from sixflow.invariants.kanatani import PLACES, WEIGHTS, as_covariance, as_numbers


class Polar(NamedTuple):
    """Size and direction of one of Kanatani's quantities.

    Attributes
    ----------
    size : array, shape (...)
        At least 0; px for U₀, 1 for S, px⁻¹ for K.
    direction : array, shape (...)
        rad from x towards y, within (−π, π] for U₀ and K, and (−π/2, π/2] for the axis of S.
    covariance : array, shape (..., 2, 2), or None
        Of (size, direction). None if none was given.
    """

    size: Array
    direction: Array
    covariance: Array | None

    @property
    def standard_errors(self) -> Array | None:
        """Of (size, direction), shape (..., 2); infinite for a direction that is undetermined."""
        return None if self.covariance is None else roots(self.covariance)


@silent
def size_and_direction(name: str, numbers: ArrayLike, covariance: ArrayLike | None = None) -> Polar:
    """Size and direction of U₀, S or K, with their covariance (Eagleson, §2).

    Parameters
    ----------
    name : {"U0", "S", "K"}
        U₀: speed and heading. S: size and axis of the deformation, the direction of greatest extension. K: size and
        direction of the fanning.
    numbers : array, shape (..., 6) or (..., 8)
        The six, or the six and (E, F).
    covariance : array, shape (..., 6, 6) or (..., 8, 8), optional
        Of the numbers. Leading dimensions are broadcast.

    Raises
    ------
    InputError
        If the name is another (T and R have no direction), K is wanted of six numbers, or a shape or dtype is wrong.

    Examples
    --------
    >>> import numpy as np
    >>> found = size_and_direction("U0", [3.0, 4.0, 0, 0, 0, 0], 0.01**2 * np.eye(6))
    >>> found.size, found.standard_errors
    (np.float64(5.0), array([0.01 , 0.002]))
    """
    if name not in WEIGHTS or WEIGHTS[name] == 0:
        raise InputError(f"name={name!r}: must be 'U0', 'S' or 'K'; T and R are numbers without direction")
    n = as_numbers(numbers)
    k, weight = PLACES[name], WEIGHTS[name]
    if k >= n.shape[-1]:
        raise InputError(f"name='K': numbers of shape {n.shape} hold only the six; give the six and (E, F)")
    part = n[..., k : k + 2]
    spread = None
    if covariance is not None:
        C = as_covariance(covariance, n.shape[-1])[..., k : k + 2, k : k + 2]
        require_broadcast(numbers=n.shape[:-1], covariance=C.shape[:-2])
        spread = polar_covariance(part, weight, C)
    return Polar(*polar(part, weight), spread)


def polar(part: Array, weight: int) -> tuple[Array, Array]:
    """Size and direction of (x, y), shape (..., 2)."""
    x, y = part[..., 0] + 0.0, part[..., 1] + 0.0  # + 0.0: a negative zero would turn the direction
    return np.hypot(x, y), np.arctan2(y, x) / weight


def polar_jacobian(part: Array, weight: int) -> Array:
    """Derivative of (size, direction) by (x, y), shape (..., 2, 2); NaN where both are 0."""
    size = np.hypot(part[..., 0], part[..., 1])
    cos, sin = (part[..., k] / size for k in range(2))
    across = size * weight
    return np.stack([cos, sin, -sin / across, cos / across], axis=-1).reshape(*size.shape, 2, 2)


def polar_covariance(part: Array, weight: int, C: Array) -> Array:
    """Covariance when the last two of some numbers, (x, y), become size and direction.

    Parameters
    ----------
    part : array, shape (..., 2)
        (x, y).
    weight : int
    C : array, shape (..., m, m)
        Of the numbers, (x, y) the last of them.
    """
    J = np.zeros((*part.shape[:-1], *C.shape[-2:]))
    J[...] = np.eye(C.shape[-1])
    J[..., -2:, -2:] = polar_jacobian(part, weight)
    spread = np.einsum("...ij,...jk,...lk->...il", J, C, J)
    spread = (spread + spread.swapaxes(-1, -2)) / 2
    zero = (part == 0).all(axis=-1)
    xx, yy, xy = C[..., -2, -2], C[..., -1, -1], C[..., -2, -1]
    largest = (xx + yy) / 2 + np.hypot((xx - yy) / 2, xy)
    spread[..., -2, -2] = np.where(zero, largest, spread[..., -2, -2])
    spread[..., -1, -1] = np.where(zero, np.inf, spread[..., -1, -1])
    return spread


@silent
def roots(covariance: Array) -> Array:
    """Standard errors: the roots of the diagonal."""
    return np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
