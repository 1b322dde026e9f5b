"""Kanatani's convention of a planar scene, as Eagleson's eq. (2) prints it, and the way there and back.

The view point is (0, 0, −f), the image plane Z = 0; the plane is Z = pX + qY + r; the object's point (0, 0, r) moves
by (a, b, c) while the object turns by Ω. Then

    u₀ = fa/(f + r)                         v₀ = fb/(f + r)
    A = pΩ_Y − (pa + c)/(f + r)             B = qΩ_Y − Ω_Z − qa/(f + r)
    C = −pΩ_X + Ω_Z − pb/(f + r)            D = −qΩ_X − (qb + c)/(f + r)                                (2)
    E = (Ω_Y + pc/(f + r))/f                F = (−Ω_X + qc/(f + r))/f.

Against eq. (1), which `Plane` and `RigidMotion` follow (`flow`):

| | eq. (1) | eq. (2) |
|---|---|---|
| origin | the centre of projection | the principal point, f in front of it |
| depth | Z | f + Z |
| what moves | the camera, by V and Ω | the object: opposite signs |
| the translation is that of | the centre of projection | the plane's point on the optical axis |

Only f + r, the depth on the axis, enters beside a, b, c, so that the unit of length stays free: lengths of the
scene are counted in px as if one of their units were 1 px.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sixflow.array_checks import broadcast, finite_floats
from sixflow.checks import number
from sixflow.errors import InputError
from sixflow.scenes.arguments import Array, Triple, require_kind, triple
from sixflow.scenes.camera import Camera
from sixflow.scenes.motion import RigidMotion
from sixflow.scenes.plane import Plane


class KanataniScene(NamedTuple):
    """A planar scene in Kanatani's convention.

    Attributes
    ----------
    p, q, r : float
        The plane Z = pX + qY + r, the view point being (0, 0, −f).
    translation : (float, float, float)
        (a, b, c), velocity of the plane's point (0, 0, r), length per frame interval.
    rotation : (float, float, float)
        Ω of the object, rad per frame interval.
    """

    p: float
    q: float
    r: float
    translation: Triple
    rotation: Triple


def kanatani_coefficients(
    focal: float, p: ArrayLike, q: ArrayLike, r: ArrayLike, translation: ArrayLike, rotation: ArrayLike
) -> Array:
    """Eagleson's eq. (2) as printed.

    Parameters
    ----------
    focal : float
        f, px, above 0.
    p, q, r : arrays
        The plane, with f + r above 0; shapes that broadcast with the leading ones of the others.
    translation, rotation : arrays, shape (..., 3)
        (a, b, c) and Ω.

    Returns
    -------
    float64 array, shape (..., 8)
        u0, v0, A, B, C, D, E, F about the principal point.

    Raises
    ------
    InputError
        If f or f + r is not above 0, or another argument cannot be used.

    Examples
    --------
    >>> kanatani_coefficients(800, 0.5, 0.0, 200.0, (10, 0, 0), (0, 0, 0))[:4].tolist()
    [8.0, 0.0, -0.005, 0.0]
    """
    f = number("focal", focal, above=0, unit="px")
    T = finite_floats("translation", translation, (3,))
    Omega = finite_floats("rotation", rotation, (3,))
    p, q, r = finite_floats("p", p), finite_floats("q", q), finite_floats("r", r)
    parts = broadcast(
        p=p, q=q, r=r, a=T[..., 0], b=T[..., 1], c=T[..., 2],
        rotation_x=Omega[..., 0], rotation_y=Omega[..., 1], rotation_z=Omega[..., 2],
    )  # fmt: skip
    p, q, r, a, b, c, w_X, w_Y, w_Z = parts
    depth = f + r
    if (depth <= 0).any():
        raise InputError(
            f"r={float(r[depth <= 0][0])!r}: f + r must be above 0; the plane passes through the view point or behind"
        )
    eight = (
        f * a / depth,
        f * b / depth,
        p * w_Y - (p * a + c) / depth,
        q * w_Y - w_Z - q * a / depth,
        -p * w_X + w_Z - p * b / depth,
        -q * w_X - (q * b + c) / depth,
        (w_Y + p * c / depth) / f,
        (-w_X + q * c / depth) / f,
    )
    return np.stack(eight, axis=-1)


def to_kanatani(camera: Camera, plane: Plane, motion: RigidMotion) -> KanataniScene:
    """State a scene in the convention of eq. (2).

    Parameters
    ----------
    camera : Camera
    plane : Plane
        One that meets the optical axis in front of the camera.
    motion : RigidMotion
        Of the camera or of the object.

    Raises
    ------
    InputError
        If the plane does not meet the optical axis, or an argument is of another kind.

    Examples
    --------
    >>> camera, plane = Camera(focal=800), Plane.from_slopes(0.5, 0.0, 1000.0)
    >>> scene = to_kanatani(camera, plane, RigidMotion(translation=(-10, 0, 0)))
    >>> scene.r, scene.translation
    (200.0, (10.0, 0.0, 0.0))
    """
    require_kind("camera", camera, Camera, "Camera(focal=800)")
    require_kind("plane", plane, Plane, "Plane.from_slant(distance=2, slant=0.5)")
    require_kind("motion", motion, RigidMotion, "RigidMotion(translation=(0, 0, 0.1))")
    p, q, r = plane.slopes
    moving = motion.seen_as("object").about((0.0, 0.0, r))
    return KanataniScene(p, q, r - camera.focal, moving.translation, moving.rotation)


def from_kanatani(focal: float, scene: KanataniScene) -> tuple[Plane, RigidMotion]:
    """State a scene of eq. (2) in the convention of eq. (1): the plane and the object's motion.

    Parameters
    ----------
    focal : float
        f, px, above 0.
    scene : KanataniScene

    Returns
    -------
    plane : Plane
    motion : RigidMotion
        Of the object, about the camera's centre; `motion.seen_as("camera")` for the camera's.

    Raises
    ------
    InputError
        If f or f + r is not above 0, or a number is not finite.

    Examples
    --------
    >>> plane, motion = from_kanatani(800, KanataniScene(0.5, 0.0, 200.0, (10, 0, 0), (0, 0, 0)))
    >>> motion.seen_as("camera").translation
    (-10.0, -0.0, -0.0)
    """
    require_kind("scene", scene, KanataniScene, "KanataniScene(0, 0, 200, (10, 0, 0), (0, 0, 0))")
    depth = number("focal", focal, above=0, unit="px") + number("r", scene.r)
    point = (0.0, 0.0, depth)
    translation = triple("translation", scene.translation, "(a, b, c)")
    moving = RigidMotion(translation, scene.rotation, of="object", point=point)
    if not depth > 0:
        raise InputError(
            f"r={scene.r!r}: f + r must be above 0; the plane passes through the view point or behind"
        )
    return Plane.from_slopes(scene.p, scene.q, depth), moving.about((0.0, 0.0, 0.0))
