"""Rigid motion: velocities of the camera or of the object, and finite displacements.

Everything is stated in the axes of the camera (X right, Y down, Z forward). What is seen depends only on how
the scene moves relative to the camera; the velocity of the scene point X is

    Ẋ = T + ω × X,                                                                       (of the scene)
    T = V − Ω × P,     ω = Ω       for an object whose point P moves by V while it turns by Ω,
    T = Ω × P − V,     ω = −Ω      for a camera whose point P moves by V while it turns by Ω.

Velocities that stay constant in the camera's axes make, after the time s, the displacement X' = R X + t with
R = exp(s [ω]×), t = s V(sω) T (`rotation.drift_matrix`): a screw.

| symbol | name | unit |
|---|---|---|
| V | `translation`, velocity of the point P | length per frame interval |
| Ω | `rotation`, right-handed | rad per frame interval |
| P | `point`; by default the camera's centre of projection | length |
| T, ω | `scene_translation`, `scene_rotation` | length, rad per frame interval |
| R, t | `rotation`, `translation` of the `displacement` | 1, length |

The unit of length is free; it is the same for all lengths of a scene.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sixflow.array_checks import finite_floats
from sixflow.checks import number, require
from sixflow.scenes.arguments import Array, Of, Triple, require_kind, require_of, triple
from sixflow.scenes.displacement import RigidDisplacement, displacement_of
from sixflow.scenes.rotation import drift_matrix, rotation_matrix, rotation_vector

_ORIGIN: Triple = (0.0, 0.0, 0.0)


@dataclasses.dataclass(frozen=True)
class RigidMotion:
    """Velocities of a rigid motion, constant over the time that is looked at.

    Parameters
    ----------
    translation : (float, float, float)
        Velocity (V_X, V_Y, V_Z) of `point`, length per frame interval.
    rotation : (float, float, float)
        Angular velocity (Ω_X, Ω_Y, Ω_Z), rad per frame interval, right-handed: positive Ω_Z turns X towards
        Y, clockwise on the screen for an object, and the picture anticlockwise for a camera.
    of : "camera" or "object"
        Whose motion the numbers are.
    point : (float, float, float)
        The point P of the moving body, in the camera's axes, whose velocity is `translation`. By default the
        camera's centre of projection; for an object that turns about itself, its own centre.

    Raises
    ------
    InputError
        If a number is not finite, or `of` is neither.

    Examples
    --------
    A camera that approaches by 0.1 m per frame, and the same as the motion of the scene:

    >>> RigidMotion(translation=(0, 0, 0.1)).seen_as("object").translation
    (-0.0, -0.0, -0.1)

    An object that turns about its own vertical axis, 2 m ahead: its nearest point goes to the right.

    >>> turning = RigidMotion(rotation=(0, 0.1, 0), of="object", point=(0, 0, 2))
    >>> turning.velocity([0, 0, 1.9]).round(3).tolist()
    [-0.01, 0.0, 0.0]
    """

    translation: Triple = _ORIGIN
    rotation: Triple = _ORIGIN
    of: Of = "camera"
    point: Triple = _ORIGIN

    def __post_init__(self) -> None:
        meaning = "(V_X, V_Y, V_Z) in length per frame interval"
        object.__setattr__(self, "translation", triple("translation", self.translation, meaning))
        meaning = "(Ω_X, Ω_Y, Ω_Z) in rad per frame interval"
        object.__setattr__(self, "rotation", triple("rotation", self.rotation, meaning))
        require_of(self.of)
        object.__setattr__(self, "point", triple("point", self.point, "(X, Y, Z) in units of length"))

    @classmethod
    def from_displacement(cls, displacement: RigidDisplacement) -> RigidMotion:
        """The steady motion (a screw) of the object that makes a displacement in one frame interval.

        The rotation is that of at most half a turn. The inverse of `displacement`.

        Raises
        ------
        InputError
            If the argument is no RigidDisplacement.

        Examples
        --------
        >>> step = RigidMotion((0.1, 0, 0.2), (0, 0.3, 0), of="object").displacement()
        >>> [round(part, 12) for part in RigidMotion.from_displacement(step).translation]
        [0.1, 0.0, 0.2]
        """
        require_kind("displacement", displacement, RigidDisplacement, "RigidDisplacement((0, 0.1, 0))")
        angle = rotation_vector(np.array(displacement.rotation))
        T = np.linalg.solve(drift_matrix(angle), np.array(displacement.translation))
        return cls(tuple(T.tolist()), tuple(angle.tolist()), of="object")

    @property
    def scene_translation(self) -> Array:
        """T, shape (3,): velocity of the scene at the camera's centre, relative to the camera."""
        V, Omega, P = np.array(self.translation), np.array(self.rotation), np.array(self.point)
        return self._sign * (V - np.cross(Omega, P))

    @property
    def scene_rotation(self) -> Array:
        """ω, shape (3,): angular velocity of the scene relative to the camera."""
        return self._sign * np.array(self.rotation)

    @property
    def _sign(self) -> float:
        return 1.0 if self.of == "object" else -1.0

    def velocity(self, points: ArrayLike) -> Array:
        """Velocity T + ω × X of scene points relative to the camera.

        Parameters
        ----------
        points : array, shape (..., 3)
            X, in units of length.

        Returns
        -------
        float64 array, shape (..., 3)
            Length per frame interval.

        Raises
        ------
        InputError
            If the points are not real, not finite, or of another shape.
        """
        points = finite_floats("points", points, (3,))
        return self.scene_translation + np.cross(self.scene_rotation, points)

    def seen_as(self, of: Of) -> RigidMotion:
        """The same relative motion, as that of the camera or of the object.

        Raises
        ------
        InputError
            If `of` is neither.
        """
        require_of(of)
        if of == self.of:
            return self
        return RigidMotion(_opposite(self.translation), _opposite(self.rotation), of, self.point)

    def about(self, point: Any) -> RigidMotion:
        """The same motion, with the velocity of another point P' of the body: V + Ω × (P' − P).

        Raises
        ------
        InputError
            If the point is not three finite numbers.

        Examples
        --------
        >>> RigidMotion(rotation=(0, 0, 0.1), of="object").about((2, 0, 5)).translation
        (0.0, 0.2, 0.0)
        """
        point = triple("point", point, "(X, Y, Z) in units of length")
        arm = np.array(point) - np.array(self.point)
        moved = np.array(self.translation) + np.cross(np.array(self.rotation), arm)
        return RigidMotion(tuple(moved.tolist()), self.rotation, self.of, point)

    def scaled(self, factor: float) -> RigidMotion:
        """Motion of all velocities times a factor: what happens in `factor` frame intervals, as one.

        Raises
        ------
        InputError
            If the factor is not a finite number.

        Examples
        --------
        >>> RigidMotion(translation=(0, 0, 0.1), rotation=(0, 0.2, 0)).scaled(0.5).rotation
        (0.0, 0.1, 0.0)
        """
        factor = number("factor", factor)
        V, Omega = (factor * np.array(vector) for vector in (self.translation, self.rotation))
        return RigidMotion(tuple(V.tolist()), tuple(Omega.tolist()), self.of, self.point)

    def displacement(self, duration: float = 1.0) -> RigidDisplacement:
        """Displacement of the scene after a time, the velocities being constant in the camera's axes.

        Parameters
        ----------
        duration : float
            Frame intervals; negative runs backwards.

        Raises
        ------
        InputError
            If the duration is not a finite number.

        Examples
        --------
        >>> step = RigidMotion(translation=(0, 0, 0.1)).displacement(5)
        >>> step.apply([0.2, 0.0, 2.0]).tolist()
        [0.2, 0.0, 1.5]
        """
        duration = number("duration", duration, unit="frame intervals")
        angle = duration * self.scene_rotation
        t = duration * drift_matrix(angle) @ self.scene_translation
        return displacement_of(rotation_matrix(angle), t)


def _opposite(vector: Triple) -> Triple:
    x, y, z = vector
    return -x, -y, -z


def as_displacement(motion: object) -> RigidDisplacement:
    """Return the displacement over one frame interval.

    Raises InputError if the motion is neither a RigidMotion nor a RigidDisplacement.
    """
    if isinstance(motion, RigidMotion):
        return motion.displacement()
    remedy = "must be a RigidMotion or a RigidDisplacement, such as RigidMotion(translation=(0, 0, 0.1))"
    require(isinstance(motion, RigidDisplacement), "motion", motion, remedy)
    return motion  # type: ignore[return-value]


def as_motion(motion: object) -> RigidMotion:
    """Return the steady motion; InputError if the motion is neither a RigidMotion nor a RigidDisplacement."""
    return (
        motion if isinstance(motion, RigidMotion) else RigidMotion.from_displacement(as_displacement(motion))
    )
