"""Principal values and axes of a symmetric 2×2 tensor, such as the measures of deformation return.

With m = ½ (T_xx + T_yy), a = ½ (T_xx − T_yy) and r = √(a² + T_xy²) (Mohr's circle):

    principal values m ± r,   angle of the first axis ½ atan2(T_xy, a),   maximum engineering shear γ = 2r
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sixflow.array_checks import Array, as_floats, silent
from sixflow.errors import InputError


@silent
def principal_values(tensor: ArrayLike) -> Array:
    """Principal values of a symmetric tensor, the algebraically larger one first.

    Parameters
    ----------
    tensor : array, shape (..., 2, 2)
        Symmetric, with the tensor shear (half the engineering shear) off the diagonal.

    Returns
    -------
    array, shape (..., 2)

    Raises
    ------
    InputError
        If a tensor is not symmetric.

    Examples
    --------
    >>> principal_values([[1.0, 2.0], [2.0, 1.0]])
    array([ 3., -1.])
    """
    mean, a, xy = circle(as_symmetric(tensor))
    radius = np.hypot(a, xy)
    return np.stack([mean + radius, mean - radius], axis=-1)


@silent
def principal_angle(tensor: ArrayLike) -> Array:
    """Angle from the x axis to the axis of the larger principal value.

    Parameters
    ----------
    tensor : array, shape (..., 2, 2)
        Symmetric, with the tensor shear (half the engineering shear) off the diagonal.

    Returns
    -------
    array, shape (...)
        rad, within (−π/2, π/2]; from x towards y, which is clockwise on the screen. 0 where both values are
        equal and every axis is principal.

    Raises
    ------
    InputError
        If a tensor is not symmetric.

    Examples
    --------
    >>> import numpy as np
    >>> np.degrees(principal_angle([[1.0, 2.0], [2.0, 1.0]]))
    np.float64(45.0)
    """
    _, a, xy = circle(as_symmetric(tensor))
    return np.arctan2(xy + 0.0, a + 0.0) / 2  # + 0.0: a negative zero would turn the axis by half a turn


@silent
def max_shear(tensor: ArrayLike) -> Array:
    """Maximum engineering shear γ: the difference of the principal values, twice the largest tensor shear.

    Parameters
    ----------
    tensor : array, shape (..., 2, 2)
        Symmetric, with the tensor shear (half the engineering shear) off the diagonal.

    Returns
    -------
    array, shape (...)
        At least 0; found in the axes at 45° to the principal ones.

    Raises
    ------
    InputError
        If a tensor is not symmetric.

    Examples
    --------
    >>> max_shear([[1.0, 2.0], [2.0, 1.0]])
    np.float64(4.0)
    """
    _, a, xy = circle(as_symmetric(tensor))
    return 2 * np.hypot(a, xy)


def circle(tensor: Array) -> tuple[Array, Array, Array]:
    """Mohr's circle: m, a and T_xy."""
    xx, yy = tensor[..., 0, 0], tensor[..., 1, 1]
    return (xx + yy) / 2, (xx - yy) / 2, (tensor[..., 0, 1] + tensor[..., 1, 0]) / 2


def as_symmetric(tensor: ArrayLike) -> Array:
    """Return the tensor as floats; raise InputError if it is not symmetric to within rounding."""
    tensor = as_floats("tensor", tensor, (2, 2))
    difference = np.abs(tensor[..., 0, 1] - tensor[..., 1, 0])
    scale = np.abs(tensor).max(axis=(-1, -2))
    bad = np.asarray(difference > 64 * np.finfo(tensor.dtype).eps * np.maximum(scale, 1))
    if bad.any():
        first = tuple(int(k) for k in np.argwhere(bad)[0])
        raise InputError(
            f"tensor: {int(bad.sum())} of {bad.size} are not symmetric, the first at index {first}; "
            "give a symmetric measure, such as green_lagrange(gradient), not a gradient"
        )
    return tensor
