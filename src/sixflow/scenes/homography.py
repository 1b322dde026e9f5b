"""Finite displacement of a plane's image: a homography, and the six numbers of a homography.

A scene point X of the plane n·X = 1 goes to X' = R X + t = (R + t nᵀ) X, and its image from x to

    x' ~ H (x, y, 1),    H = K (R + t nᵀ) K⁻¹.

H is kept with the scale that it has here: its third row gives the ratio of the depths, w = Z'/Z, so that a point
with w > 0 is in front of the camera in both frames. det H = 1 + n·Rᵀt = d'/d, the ratio of the plane's
distances, is above 0 while the plane has not passed through the camera.

With (X, Y, w) = H (x, y, 1) the displacement gradient is

    G = 1/w [[H₁₁ − x' H₃₁, H₁₂ − x' H₃₂], [H₂₁ − y' H₃₁, H₂₂ − y' H₃₂]] − I.

For small motions H = I + L + … with L of `eight`; at any size `homography_six` is what `measure` finds, and log H is
the flow in the middle of the interval (`homography_flow`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sixflow.array_checks import finite_floats, image_points
from sixflow.convention import six_from_gradient
from sixflow.errors import InputError
from sixflow.scenes.arguments import Array, pair, refuse_points, require_kind
from sixflow.scenes.camera import Camera
from sixflow.scenes.displacement import RigidDisplacement
from sixflow.scenes.eight import Eight
from sixflow.scenes.flow import coefficients_from_matrix
from sixflow.scenes.motion import RigidMotion, as_displacement
from sixflow.scenes.plane import Plane

_SINGULAR = 1e-12  # smallest singular value over the largest, lengths in kilopixels
_LOGARITHM = 1e-9  # of exp(log H) relative to the largest entry of H
_KILOPIXELS = np.diag([1e3, 1e3, 1.0])


def plane_homography(camera: Camera, plane: Plane, motion: RigidMotion | RigidDisplacement) -> Array:
    """Homography that displaces the image of a plane over one frame interval.

    Parameters
    ----------
    camera : Camera
    plane : Plane
        As it is in frame 0.
    motion : RigidMotion or RigidDisplacement
        For several frame intervals give `motion.displacement(duration)`.

    Returns
    -------
    float64 array, shape (3, 3)
        H in px; its third row gives the ratio of depths Z'/Z.

    Raises
    ------
    InputError
        If the plane passes through the camera on the way, or an argument is of another kind.

    Examples
    --------
    >>> camera, wall = Camera(focal=800), Plane(normal=(0, 0, 1), distance=2.0)
    >>> H = plane_homography(camera, wall, RigidMotion(translation=(0, 0, 0.4)))
    >>> [float(part) for part in apply_homography(H, 100, 0)]
    [125.0, 0.0]
    """
    require_kind("camera", camera, Camera, "Camera(focal=800)")
    require_kind("plane", plane, Plane, "Plane.from_slant(distance=2, slant=0.5)")
    step = as_displacement(motion)
    plane.moved(step)
    H = np.array(step.rotation) + np.outer(step.translation, plane.scaled_normal)
    return np.asarray(camera.matrix @ H @ camera.inverse_matrix)


def apply_homography(matrix: ArrayLike, x: ArrayLike, y: ArrayLike) -> tuple[Array, Array]:
    """Where image points go.

    Parameters
    ----------
    matrix : array, shape (3, 3)
        A homography of det > 0, of any positive scale.
    x, y : arrays
        Image points, px; shapes that broadcast.

    Returns
    -------
    x', y' : float64 arrays of the broadcast shape
        px.

    Raises
    ------
    InputError
        If the matrix is singular or mirrors, or a point goes to infinity or behind the camera (w ≤ 0).
    """
    x, y = image_points(x, y)
    X, Y, _ = _moved(require_homography(matrix), x, y)
    return X, Y


def homography_six(matrix: ArrayLike, x: ArrayLike, y: ArrayLike) -> Array:
    """The six numbers of the displacement by a homography, exact at any size.

    Parameters
    ----------
    matrix : array, shape (3, 3)
        A homography of det > 0, of any positive scale.
    x, y : arrays
        Image points of frame 0, px; shapes that broadcast.

    Returns
    -------
    float64 array, shape (..., 6)
        u, v in px, the others without unit.

    Raises
    ------
    InputError
        If the matrix is singular or mirrors, or a point goes to infinity or behind the camera (w ≤ 0).

    Examples
    --------
    >>> homography_six([[1, 0, 3], [0, 1, 0], [0, 0, 1]], 5, 6)
    array([3., 0., 0., 0., 0., 0.])
    """
    x, y = image_points(x, y)
    H = require_homography(matrix)
    X, Y, w = _moved(H, x, y)
    seen = np.stack([X, Y], axis=-1)
    F = (H[:2, :2] - seen[..., :, None] * H[2, :2]) / w[..., None, None]
    return six_from_gradient(np.stack([X - x, Y - y], axis=-1), F - np.eye(2))


def homography_flow(matrix: ArrayLike, centre: tuple[float, float] = (0.0, 0.0)) -> Eight:
    """The eight coefficients of the steady flow that makes a homography in one frame interval: its logarithm.

    For a plane in steady motion log H = L(½) + third order, L(½) being the flow in the middle of the interval (the
    second order of Magnus's expansion vanishes there). So this is the way from a finite displacement to
    `planar_structure`, which then tells plane and motion half-way between the frames.

    Parameters
    ----------
    matrix : array, shape (3, 3)
        A homography of det > 0, of any positive scale, px.
    centre : (float, float)
        Image point about which the coefficients are wanted, px.

    Raises
    ------
    InputError
        If the matrix is singular or mirrors, or has no real logarithm.

    Examples
    --------
    >>> flow = homography_flow([[1.21, 0, 0], [0, 1.21, 0], [0, 0, 1]])
    >>> flow.six_at(0, 0)[2].round(6) == np.round(2 * np.log(1.21), 6)
    np.True_
    """
    x, y = pair("centre", centre, "(x, y) in px")
    shift = np.array([[1, 0, -x], [0, 1, -y], [0, 0, 1.0]])
    L = shift @ homography_log(matrix) @ np.linalg.inv(shift)
    return Eight(coefficients_from_matrix(L, 1.0), (x, y))


def homography_log(matrix: ArrayLike) -> Array:
    """Real logarithm of a homography of det 1, shape (3, 3); of trace 0.

    Raises InputError if the matrix is singular or mirrors, or has no real logarithm: no steady motion leads
    to it.
    """
    from scipy.linalg import expm, logm

    H = require_homography(matrix)
    H = H / np.cbrt(np.linalg.det(H))
    L = np.asarray(logm(H))
    error = np.abs(expm(L.real) - H).max() if np.isfinite(L).all() else np.inf
    if not error < _LOGARITHM * np.abs(H).max():
        raise InputError(
            f"matrix={H.tolist()!r}: has no real logarithm, so that no steady motion leads to it; give a smaller motion"
        )
    return np.asarray(L.real, dtype=np.float64)


def require_homography(matrix: ArrayLike) -> Array:
    """Return a homography as float64, shape (3, 3); InputError if it is singular or mirrors the image."""
    H = finite_floats("matrix", matrix)
    if H.shape != (3, 3):
        raise InputError(
            f"matrix of shape {H.shape}: must be one 3×3 matrix of homogeneous coordinates (x, y, 1)"
        )
    det = float(np.linalg.det(H))
    values = np.linalg.svd(np.linalg.inv(_KILOPIXELS) @ H @ _KILOPIXELS, compute_uv=False)
    if not values[2] > _SINGULAR * values[0]:
        raise InputError(
            f"matrix={H.tolist()!r}: is singular; the plane is seen edge-on, or three points coincide"
        )
    if det < 0:
        raise InputError(
            f"matrix={H.tolist()!r}: det = {det:.3g} is below 0, which mirrors the image; give it the sign of det > 0"
        )
    return H


def _moved(H: Array, x: Array, y: Array) -> tuple[Array, Array, Array]:
    parts = np.stack([x, y, np.ones_like(x)], axis=-1) @ H.T
    w = parts[..., 2]
    remedy = "they go to infinity or behind the camera; leave them out"
    size = np.abs(H[2, 0] * x) + np.abs(H[2, 1] * y) + np.abs(H[2, 2])
    refuse_points("matrix: w ≤ 0", ~(w > 1e-12 * size), x, y, remedy)
    return parts[..., 0] / w, parts[..., 1] / w, w
