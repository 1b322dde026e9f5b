"""The differential flow of a scene: of any surface (Eagleson, eq. (1)) and of a plane (eq. (2)).

A scene point X = Z m, seen in the direction m = (m_x, m_y, 1), has the velocity Ẋ = T + ω × X relative to the
camera (`motion`), and the image point moves by

    u = f [(T_X − m_x T_Z)/Z + ω_Y (1 + m_x²) − ω_X m_x m_y − ω_Z m_y]
    v = f [(T_Y − m_y T_Z)/Z − ω_X (1 + m_y²) + ω_Y m_x m_y + ω_Z m_x].

With x = f m_x in px, and V = −T, Ω = −ω of the camera, this is

    v_x = (x V_Z − f V_X)/Z + (xy/f) Ω_X − (f + x²/f) Ω_Y + y Ω_Z                                    (1)
    v_y = (y V_Z − f V_Y)/Z + (f + y²/f) Ω_X − (xy/f) Ω_Y − x Ω_Z.

(As corrected here: the print has 1 + x² and 1 + y² where its translational part has f, so that its units
agree for f = 1 only.)

On the plane n·X = 1 the velocity is Ẋ = L X with L = [ω]× + T nᵀ, and the flow is quadratic in the image
coordinates, with the coefficients (all px from the principal point)

    u₀ = f L₁₃    A = L₁₁ − L₃₃    B = L₁₂           E = −L₃₁/f
    v₀ = f L₂₃    C = L₂₁          D = L₂₂ − L₃₃     F = −L₃₂/f,

which is eq. (2) in the convention of eq. (1); `kanatani` has it as printed.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sixflow.array_checks import broadcast, image_points
from sixflow.convention import six_from_gradient
from sixflow.scenes.arguments import Array, refuse_points, require_kind
from sixflow.scenes.camera import Camera, require_depth
from sixflow.scenes.displacement import RigidDisplacement
from sixflow.scenes.eight import Eight
from sixflow.scenes.motion import RigidMotion, as_displacement
from sixflow.scenes.plane import Plane
from sixflow.scenes.rotation import skew
from sixflow.scenes.surface import Surface, require_surface


def image_velocity(
    camera: Camera, motion: RigidMotion, x: ArrayLike, y: ArrayLike, depth: ArrayLike
) -> tuple[Array, Array]:
    """Velocity of image points of known depth (Eagleson, eq. (1)).

    Parameters
    ----------
    camera : Camera
    motion : RigidMotion
        Of the camera or of the object.
    x, y : arrays
        Image points, px.
    depth : array
        Z of what is seen there, in units of length, finite and above 0. All three broadcast together.

    Returns
    -------
    u, v : float64 arrays of the broadcast shape
        px per frame interval.

    Raises
    ------
    InputError
        If an argument cannot be used.

    Examples
    --------
    A camera that approaches by 0.1 m per frame: a point 100 px to the right and 2 m away.

    >>> camera = Camera(focal=800, centre=(320, 240))
    >>> u, v = image_velocity(camera, RigidMotion(translation=(0, 0, 0.1)), 420, 240, depth=2.0)
    >>> float(u), float(v)
    (5.0, 0.0)
    """
    _require_scene(camera, motion)
    m, depth = camera.direction(x, y), require_depth(depth)
    m_x, m_y, depth = broadcast(x=m[..., 0], y=m[..., 1], depth=depth)
    return _velocity(camera.focal, motion, m_x, m_y, 1 / depth)


def surface_flow(camera: Camera, surface: Surface, motion: RigidMotion, x: ArrayLike, y: ArrayLike) -> Array:
    """The six numbers of the flow of a surface: eq. (1) and its derivatives.

    Parameters
    ----------
    camera : Camera
    surface : Surface
        A Plane, a DepthMap or a surface of your own.
    motion : RigidMotion
        Of the camera or of the object.
    x, y : arrays
        Image points, px; shapes that broadcast.

    Returns
    -------
    float64 array, shape (..., 6)
        u, v in px per frame interval, divergence, curl, stretch and shear in 1 per frame interval.

    Raises
    ------
    InputError
        If an argument cannot be used, or the camera does not see the surface at one of the points.

    Examples
    --------
    >>> camera, wall = Camera(focal=800), Plane(normal=(0, 0, 1), distance=2.0)
    >>> surface_flow(camera, wall, RigidMotion(translation=(0, 0, 0.1)), 100, 0).round(6)
    array([5. , 0. , 0.1, 0. , 0. , 0. ])
    """
    _require_scene(camera, motion)
    x, y = image_points(x, y)
    Z, Z_x, Z_y = require_surface(surface).require_depth(camera, x, y)
    near, near_x, near_y = 1 / Z, -Z_x / Z**2, -Z_y / Z**2
    f, m = camera.focal, camera.direction(x, y)
    m_x, m_y = m[..., 0], m[..., 1]
    (T_X, T_Y, T_Z), (w_X, w_Y, w_Z) = motion.scene_translation, motion.scene_rotation
    along_x, along_y = f * (T_X - m_x * T_Z), f * (T_Y - m_y * T_Z)
    G = np.stack(
        [
            along_x * near_x - T_Z * near + 2 * m_x * w_Y - m_y * w_X,
            along_x * near_y - m_x * w_X - w_Z,
            along_y * near_x + m_y * w_Y + w_Z,
            along_y * near_y - T_Z * near - 2 * m_y * w_X + m_x * w_Y,
        ],
        axis=-1,
    ).reshape(*x.shape, 2, 2)
    return six_from_gradient(np.stack(_velocity(f, motion, m_x, m_y, near), axis=-1), G)


def surface_displacement(
    camera: Camera, surface: Surface, motion: RigidMotion | RigidDisplacement, x: ArrayLike, y: ArrayLike
) -> Array:
    """The six numbers of the exact displacement of a surface's image over one frame interval.

    The point Z m goes to R Z m + t and is projected there: nothing is linearised. For small motions this is
    `surface_flow`.

    Parameters
    ----------
    camera : Camera
    surface : Surface
        As it is in frame 0.
    motion : RigidMotion or RigidDisplacement
    x, y : arrays
        Image points of frame 0, px; shapes that broadcast.

    Returns
    -------
    float64 array, shape (..., 6)
        u, v in px, divergence, curl, stretch and shear without unit: of the displacement, as `measure` finds
        it.

    Raises
    ------
    InputError
        If an argument cannot be used, the camera does not see the surface at one of the points, or one of
        them goes behind the camera.

    Examples
    --------
    >>> camera, wall = Camera(focal=800), Plane(normal=(0, 0, 1), distance=2.0)
    >>> surface_displacement(camera, wall, RigidMotion(translation=(0, 0, 0.4)), 100, 0).round(6)
    array([25. ,  0. ,  0.5,  0. ,  0. ,  0. ])
    """
    require_kind("camera", camera, Camera, "Camera(focal=800)")
    step = as_displacement(motion)
    x, y = image_points(x, y)
    Z, Z_x, Z_y = require_surface(surface).require_depth(camera, x, y)
    R, t = np.array(step.rotation), np.array(step.translation)
    m = camera.direction(x, y)
    ray = m @ R.T
    X = Z[..., None] * ray + t
    depth = X[..., 2]
    remedy = "a surface that passes the camera is seen no more: shorten the motion"
    refuse_points(f"motion={motion!r}: leads behind the camera", ~(depth > 1e-12 * Z), x, y, remedy)
    seen = X / depth[..., None]
    d = camera.focal * (seen - m)[..., :2]
    columns = []
    for axis, slope in ((0, Z_x), (1, Z_y)):
        X_along = slope[..., None] * ray + (Z / camera.focal)[..., None] * R[:, axis]
        columns.append(camera.focal * (X_along - seen * X_along[..., 2:])[..., :2] / depth[..., None])
    return six_from_gradient(d, np.stack(columns, axis=-1) - np.eye(2))


def planar_flow(camera: Camera, plane: Plane, motion: RigidMotion) -> Eight:
    """The eight coefficients of the flow of a plane, about the principal point (Eagleson, eq. (2)).

    Parameters
    ----------
    camera : Camera
    plane : Plane
    motion : RigidMotion
        Of the camera or of the object.

    Returns
    -------
    Eight
        Exact; without covariance.

    Raises
    ------
    InputError
        If an argument is of another kind.

    Examples
    --------
    >>> camera = Camera(focal=800, centre=(320, 240))
    >>> plane = Plane.from_slant(distance=2.0, slant=0.5, tilt=0.0)
    >>> planar_flow(camera, plane, RigidMotion(translation=(0, 0, 0.1))).six_at(320, 240).round(6) + 0.0
    array([0. , 0. , 0.1, 0. , 0. , 0. ])
    """
    _require_scene(camera, motion)
    require_kind("plane", plane, Plane, "Plane.from_slant(distance=2, slant=0.5)")
    L = velocity_matrix(plane.scaled_normal, motion.scene_translation, motion.scene_rotation)
    return Eight(coefficients_from_matrix(L, camera.focal), camera.centre)


def velocity_matrix(scaled_normal: Array, translation: Array, rotation: Array) -> Array:
    """L = [ω]× + T nᵀ, shape (..., 3, 3): Ẋ = L X on the plane n·X = 1.

    Parameters
    ----------
    scaled_normal : array, shape (..., 3)
        n, 1/length.
    translation, rotation : arrays, shape (..., 3)
        T and ω of the scene.
    """
    return np.asarray(skew(rotation) + translation[..., :, None] * scaled_normal[..., None, :])


def coefficients_from_matrix(L: Array, focal: float) -> Array:
    """The eight coefficients, shape (..., 8), of velocity matrices, shape (..., 3, 3); linear, blind to κI."""
    scale = np.array([focal, focal, 1, 1, 1, 1, -1 / focal, -1 / focal])
    entries = (
        L[..., 0, 2], L[..., 1, 2], L[..., 0, 0] - L[..., 2, 2], L[..., 0, 1],
        L[..., 1, 0], L[..., 1, 1] - L[..., 2, 2], L[..., 2, 0], L[..., 2, 1],
    )  # fmt: skip
    return np.asarray(np.stack(entries, axis=-1) * scale)


def matrix_from_coefficients(coefficients: Array, focal: float) -> Array:
    """The velocity matrix L with L₃₃ = 0, shape (..., 3, 3), of eight coefficients about the principal point."""
    u0, v0, A, B, C, D, E, F = np.moveaxis(coefficients, -1, 0)
    entries = (A, B, u0 / focal, C, D, v0 / focal, -focal * E, -focal * F, np.zeros_like(A))
    return np.stack(entries, axis=-1).reshape(*A.shape, 3, 3)


def _velocity(focal: float, motion: RigidMotion, m_x: Array, m_y: Array, near: Array) -> tuple[Any, Any]:
    (T_X, T_Y, T_Z), (w_X, w_Y, w_Z) = motion.scene_translation, motion.scene_rotation
    u = (T_X - m_x * T_Z) * near + w_Y * (1 + m_x**2) - w_X * m_x * m_y - w_Z * m_y
    v = (T_Y - m_y * T_Z) * near - w_X * (1 + m_y**2) + w_Y * m_x * m_y + w_Z * m_x
    return focal * u, focal * v


def _require_scene(camera: object, motion: object) -> None:
    require_kind("camera", camera, Camera, "Camera(focal=800)")
    require_kind("motion", motion, RigidMotion, "RigidMotion(translation=(0, 0, 0.1))")
