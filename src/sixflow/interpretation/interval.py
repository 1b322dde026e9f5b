"""From the mean over a frame interval to its middle: what a steady flow is not.

The eight of a region are the logarithm of a homography, X = log H, the steady flow that makes the displacement
(`model`). With constant velocities in the camera's axes the flow is not quite steady, since the plane comes nearer and
turns: n' = −Lᵀ n, so that with L = [ω]× + T nᵀ in the middle of the interval

    L' = −T nᵀ L,    L'' = −(L' L + L L') + [ω]× L',

and by Magnus's expansion of X about the middle

    X = L + L''/24 − [L, L']/12 + …,

the next terms being of fifth order. What X exceeds L by is of third order in the displacement gradient: with 6 px of
displacement and gradients of 0.03, 5e-4 px and 2e-6.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.scenes.flow import coefficients_from_matrix, velocity_matrix

Array = NDArray[Any]


def excess_of_mean(scaled_normal: Array, translation: Array, rotation: Array, focal: float) -> Array:
    """What the eight of the whole interval exceed those of its middle by, about the principal point.

    Parameters
    ----------
    scaled_normal, translation, rotation : arrays, shape (3,)
        n, T and ω of the scene in the middle of the interval.
    focal : float
        px.

    Returns
    -------
    array, shape (8,)
    """
    L = velocity_matrix(scaled_normal, translation, rotation)
    along = np.outer(translation, scaled_normal)
    first = -along @ L
    second = -(first @ L + L @ first) + (L - along) @ first
    return coefficients_from_matrix(second / 24 - (L @ first - first @ L) / 12, focal)
