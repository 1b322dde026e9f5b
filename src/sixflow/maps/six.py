"""Six: the six numbers of maps, and back.

Products of so small a matrix are summed without BLAS, whose threads would go on waiting for more work for longer than
the rest of a measurement takes.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.convention import GRADIENT_FROM_SIX, SIX_FROM_GRADIENT


def six_of_maps(maps: NDArray[Any]) -> NDArray[Any]:
    """Return u, v, divergence, curl, stretch, shear, shape (…, 6), of maps u, v, u_x, u_y, v_x, v_y, shape (6, …).

    Examples
    --------
    >>> six_of_maps(np.array([1.0, 2.0, 0.1, 0.0, 0.0, 0.3])).round(6)
    array([ 1. ,  2. ,  0.4,  0. , -0.2,  0. ])
    """
    return np.moveaxis(np.einsum("ij,j...->i...", SIX_FROM_GRADIENT, maps), 0, -1)


def maps_of_six(six: NDArray[Any]) -> NDArray[Any]:
    """Return maps of shape (6, …) of the six numbers, shape (…, 6).

    Examples
    --------
    >>> maps_of_six(np.array([1.0, 2.0, 0.4, 0.0, -0.2, 0.0])).round(6)
    array([1. , 2. , 0.1, 0. , 0. , 0.3])
    """
    return np.ascontiguousarray(np.einsum("ij,...j->i...", GRADIENT_FROM_SIX, six))
