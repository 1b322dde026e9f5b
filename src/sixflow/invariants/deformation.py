"""Koenderink and van Doorn's decomposition of the displacement gradient: Grad V = Curl + Div + Def (Eagleson, §1.2.1).

    G = ½ curl [[0, −1], [1, 0]] + ½ div I + ½ def [[cos 2μ, sin 2μ], [sin 2μ, −cos 2μ]]

| symbol | name | formula |
|---|---|---|
| div | `divergence` | u_x + v_y = T |
| curl | `curl` | v_x − u_y = R |
| def | `magnitude` | √(stretch² + shear²), the size of S, at least 0 |
| μ | `axis` | ½ atan2(shear, stretch) = ½ arg S |

A small square is stretched by ½ def along the axis μ and compressed by as much across it. div, curl and def are the
same in any turned axes; μ is measured from x towards y and turns with them. Errors are those of `polar`: first order,
and at def = 0 an undetermined axis of infinite standard error.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sixflow.array_checks import Array, as_floats, require_broadcast, silent
from sixflow.invariants.kanatani import as_covariance
from sixflow.invariants.polar import polar, polar_covariance, polar_jacobian, roots


class Deformation(NamedTuple):
    """Divergence, curl and deformation of a motion.

    Attributes
    ----------
    divergence, curl : array, shape (...)
    magnitude : array, shape (...)
        def, at least 0.
    axis : array, shape (...)
        Of greatest extension, rad from x towards y, within (−π/2, π/2]; 0 where there is no deformation.
    covariance : array, shape (..., 4, 4), or None
        Of (divergence, curl, magnitude, axis). None if none was given.
    """

    divergence: Array
    curl: Array
    magnitude: Array
    axis: Array
    covariance: Array | None

    @property
    def standard_errors(self) -> Array | None:
        """Of (divergence, curl, magnitude, axis), shape (..., 4); infinite for an axis that is undetermined."""
        return None if self.covariance is None else roots(self.covariance)


class GradientParts(NamedTuple):
    """The three parts whose sum is the displacement gradient, each of shape (..., 2, 2)."""

    curl: Array
    divergence: Array
    deformation: Array


@silent
def deformation(six: ArrayLike, covariance: ArrayLike | None = None) -> Deformation:
    """Divergence, curl, and magnitude and axis of the deformation, with their covariance.

    Parameters
    ----------
    six : array, shape (..., 6)
    covariance : array, shape (..., 6, 6), optional
        Of the six. Leading dimensions are broadcast.

    Raises
    ------
    InputError
        If a shape or dtype is wrong.

    Examples
    --------
    >>> import numpy as np
    >>> found = deformation([0, 0, 0.1, 0, 0.03, 0.04], 0.001**2 * np.eye(6))
    >>> found.magnitude, found.standard_errors
    (np.float64(0.05), array([0.001, 0.001, 0.001, 0.01 ]))

    Without deformation there is no axis:

    >>> deformation(np.zeros(6), 0.001**2 * np.eye(6)).standard_errors
    array([0.001, 0.001, 0.001,   inf])
    """
    six = as_floats("six", six, (6,)).astype(np.float64)
    spread = None
    if covariance is not None:
        C = as_covariance(covariance, 6)[..., 2:, 2:]
        require_broadcast(six=six.shape[:-1], covariance=C.shape[:-2])
        spread = polar_covariance(six[..., 4:], 2, C)
    return Deformation(six[..., 2][()], six[..., 3][()], *polar(six[..., 4:], 2), spread)


@silent
def deformation_jacobian(six: ArrayLike) -> Array:
    """Derivative of (divergence, curl, magnitude, axis) by the six.

    ∂def = cos 2μ ∂stretch + sin 2μ ∂shear and ∂μ = (cos 2μ ∂shear − sin 2μ ∂stretch)/(2 def).

    Parameters
    ----------
    six : array, shape (..., 6)

    Returns
    -------
    float64 array, shape (..., 4, 6)
        The rows of magnitude and axis are NaN for stretch and shear where both are 0: there is no derivative.

    Raises
    ------
    InputError
        If the shape or dtype is wrong.

    Examples
    --------
    >>> deformation_jacobian([0, 0, 0, 0, 0.03, 0.04])[2:, 4:]
    array([[ 0.6,  0.8],
           [-8. ,  6. ]])
    """
    six = as_floats("six", six, (6,)).astype(np.float64)
    J = np.zeros((*six.shape[:-1], 4, 6))
    J[..., :2, 2:4] = np.eye(2)
    J[..., 2:, 4:] = polar_jacobian(six[..., 4:], 2)
    return J


def gradient_parts(six: ArrayLike) -> GradientParts:
    """The three parts of the displacement gradient: Grad V = Curl + Div + Def (Eagleson, §1.2.1).

    Parameters
    ----------
    six : array, shape (..., 6)

    Returns
    -------
    GradientParts
        Their sum is `sixflow.convention.gradient(six)`.

    Raises
    ------
    InputError
        If the shape or dtype is wrong.

    Examples
    --------
    >>> gradient_parts([0, 0, 0.5, 1.0, 0, 0]).divergence
    array([[0.25, 0.  ],
           [0.  , 0.25]])
    """
    half = as_floats("six", six, (6,)).astype(np.float64)[..., 2:] / 2
    units = np.array([[[1, 0], [0, 1]], [[0, -1], [1, 0]], [[1, 0], [0, -1]], [[0, 1], [1, 0]]])
    div, curl, stretch, shear = (half[..., k, None, None] * unit for k, unit in enumerate(units))
    return GradientParts(curl + 0.0, div + 0.0, stretch + shear)
