"""What a field shows of a plane in motion: the six that a window measures, as functions of the eight.

Between two frames the image of a plane is displaced by a homography, and the eight coefficients θ of the *steady* flow
that does it are its logarithm,

    x' ~ H x,    H = exp(X(θ)),                                                          (`sixflow.groups`)

so that the eight are rates, as mean over the frame interval, also where displacements are large.

They are those in the middle of the interval up to third order in the displacement gradient (`interval`).

*Window.* A point is measured by the least-squares affine fit under a Gaussian of standard deviation σ, which sees of
a curved displacement d its mean, d + ½σ²∇²d, and of its gradient the gradient there. For a homography, with w the third
homogeneous coordinate, F = ∂x'/∂x and g = ∇w/w,

    ∂²x'/∂x_i∂x_j = −(F_i g_j + F_j g_i),    ½σ²∇²d = −σ² F g ≈ σ² (E, F).

Sharpening takes this away.

*Derivatives.* exp(X + dX) = exp(φ(ad_X) dX) exp(X) with φ(z) = (e^z − 1)/z: a change dθ adds the flow of the
coefficients φ(ad) dθ, taken at x', to the displacement, and its gradient times F to the displacement gradient.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from sixflow.convention import SIX_FROM_GRADIENT
from sixflow.groups import (
    COEFFICIENTS_FROM_EIGHT,
    EIGHT_FROM_COEFFICIENTS,
    PROJECTIVE,
    coefficients_from_eight,
)
from sixflow.scenes import homography_six, recentring_matrix

Array = NDArray[Any]

_TERMS = 40  # exact to rounding for flows that turn or zoom by up to e in a frame interval


def plane_in_window(eight: Array, x: Array, y: Array, blur: float) -> tuple[Array, Array]:
    """The six that are measured of a plane's displacement, and their derivative.

    Raises InputError if a point goes to infinity or behind the camera.

    Parameters
    ----------
    eight : array, shape (8,)
        Rates per frame interval, in coordinates (x, y) of frame 0.
    x, y : arrays, shape (n,)
        px.
    blur : float
        Variance σ² over which a window averages the displacement, px²; 0 if it is sharpened.

    Returns
    -------
    six : array, shape (n, 6)
    derivative : array, shape (n, 6, 8)
    """
    H = expm(PROJECTIVE.algebra(coefficients_from_eight(eight)))
    six = homography_six(H, x, y)
    F = _deformation_gradient(six)
    w = x * H[2, 0] + y * H[2, 1] + H[2, 2]
    flow = recentring_matrix(x + six[:, 0], y + six[:, 1])[:, :6]
    gradient = flow[:, 2:].reshape(-1, 2, 2, 8)
    moved = np.concatenate([flow[:, :2], np.einsum("nijk,njl->nilk", gradient, F).reshape(-1, 4, 8)], axis=1)
    moved[:, 0, 6] += blur
    moved[:, 1, 7] += blur
    six = six.copy()
    six[:, :2] -= blur * np.einsum("nij,j->ni", F, H[2, :2]) / w[:, None]
    return six, SIX_FROM_GRADIENT @ moved @ _derivative_of_exp(eight)


def _deformation_gradient(six: Array) -> Array:
    _, _, divergence, curl, stretch, shear = six.T
    G = np.stack([divergence + stretch, shear - curl, shear + curl, divergence - stretch], axis=-1) / 2
    return np.asarray(G.reshape(-1, 2, 2) + np.eye(2))


def _derivative_of_exp(eight: Array) -> Array:
    """φ(ad) = Σ ad^k/(k + 1)! for the eight coefficients, shape (8, 8)."""
    ad = EIGHT_FROM_COEFFICIENTS @ PROJECTIVE.ad(coefficients_from_eight(eight)) @ COEFFICIENTS_FROM_EIGHT
    term = total = np.eye(8)
    for k in range(2, _TERMS):
        term = term @ ad / k
        total = total + term
    return total
