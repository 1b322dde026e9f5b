"""The direction of the y coordinate: y down, as images are stored, or y up, as in textbooks and on plots.

Turning the coordinate round, y → −y, changes the sign of v, and of every derivative with one y or one v but
not both: curl = v_x − u_y and shear = u_y + v_x. The arrays are never flipped: row 0 stays row 0; only its y
*value* changes. With y up, positive curl turns anticlockwise. Turn the six first and derive measures
afterwards.
"""

from __future__ import annotations

from typing import overload

import numpy as np
from numpy.typing import ArrayLike

from sixflow.array_checks import Array, as_floats, require_broadcast

Y_UP_SIGNS = np.array([1, -1, 1, -1, 1, -1], dtype=np.float32)
"""Signs that take the six from y down to y up, and back. Read-only."""
Y_UP_SIGNS.flags.writeable = False


@overload
def to_y_up(six: ArrayLike) -> Array: ...
@overload
def to_y_up(six: ArrayLike, covariance: None) -> Array: ...
@overload
def to_y_up(six: ArrayLike, covariance: ArrayLike) -> tuple[Array, Array]: ...


def to_y_up(six: ArrayLike, covariance: ArrayLike | None = None) -> Array | tuple[Array, Array]:
    """The six numbers in a frame with y up: v, curl and shear change sign. The same call turns them back.

    Parameters
    ----------
    six : array, shape (..., 6)
    covariance : array, shape (..., 6, 6), optional
        Its entries change sign where exactly one of the two numbers does.

    Returns
    -------
    array, shape (..., 6), or that and the covariance, shape (..., 6, 6), if one was given

    Raises
    ------
    InputError
        If a shape or dtype is wrong.

    Examples
    --------
    >>> to_y_up([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    array([ 1., -2.,  3., -4.,  5., -6.])
    """
    six = as_floats("six", six, (6,))
    turned = six * Y_UP_SIGNS + 0.0  # + 0.0: no negative zeros
    if covariance is None:
        return turned
    covariance = as_floats("covariance", covariance, (6, 6))
    require_broadcast(six=six.shape[:-1], covariance=covariance.shape[:-2])
    return turned, covariance * np.outer(Y_UP_SIGNS, Y_UP_SIGNS) + 0.0
