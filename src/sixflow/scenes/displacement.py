"""Finite rigid displacements of space, as a camera sees them.

A displacement takes the scene point X, in the axes of the camera, to X' = R X + t. An object that turns about its point
P while P moves by t₀ has t = P + t₀ − R P; a camera that goes to the place c and turns by R_c sees the scene displaced
by R = R_cᵀ, t = −R_cᵀ c.

| symbol | name | unit |
|---|---|---|
| R | `rotation`, matrix | 1 |
| t | `translation` | length |
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sixflow.array_checks import finite_floats
from sixflow.checks import require
from sixflow.scenes.arguments import Array, Triple, triple
from sixflow.scenes.rotation import rotation_matrix

_ORTHOGONAL = 1e-6  # largest entry of RᵀR − I that is taken for rounding
_ORIGIN: Triple = (0.0, 0.0, 0.0)


@dataclasses.dataclass(frozen=True)
class RigidDisplacement:
    """A finite rigid displacement of the scene, as seen from the camera: X' = R X + t.

    Parameters
    ----------
    rotation : 3×3 numbers, or 3
        Rotation matrix R, or rotation vector (axis times angle, rad).
    translation : (float, float, float)
        t, in units of length.

    Raises
    ------
    InputError
        If the matrix is no rotation, or a number is not finite.

    See Also
    --------
    RigidDisplacement.of_camera : from the new pose of a camera.
    RigidMotion.displacement : from velocities.

    Examples
    --------
    >>> turn = RigidDisplacement.of_object(rotation=(0, 0, 0.1), point=(0.5, 0, 2))
    >>> turn.apply([0.5, 0.0, 2.0]).round(12).tolist()
    [0.5, 0.0, 2.0]
    """

    rotation: tuple[Triple, Triple, Triple]
    translation: Triple = _ORIGIN

    def __post_init__(self) -> None:
        given = finite_floats("rotation", self.rotation)
        seen = given.tolist()
        remedy = "must be a 3×3 rotation matrix or a vector of 3 numbers, rad"
        require(given.shape in ((3,), (3, 3)), "rotation", seen, remedy)
        R = rotation_matrix(given) if given.shape == (3,) else given
        error = float(np.abs(R.T @ R - np.eye(3)).max())
        remedy = f"must be a rotation, RᵀR = I and det R = 1; RᵀR − I reaches {error:.2g}"
        require(error < _ORTHOGONAL and np.linalg.det(R) > 0, "rotation", seen, remedy)
        object.__setattr__(self, "rotation", tuple(tuple(row) for row in R.tolist()))
        meaning = "(X, Y, Z) in units of length"
        object.__setattr__(self, "translation", triple("translation", self.translation, meaning))

    @classmethod
    def of_object(
        cls, rotation: Any = _ORIGIN, translation: Any = _ORIGIN, point: Any = _ORIGIN
    ) -> RigidDisplacement:
        """Displacement of an object that turns about its point P while P moves: X' = P + t + R (X − P).

        Parameters
        ----------
        rotation : 3×3 numbers, or 3
            R, or its rotation vector, rad.
        translation, point : (float, float, float)
            t and P, in units of length.

        Raises
        ------
        InputError
            If a value cannot be used.
        """
        turned = cls(rotation)
        P = np.array(triple("point", point, "(X, Y, Z) in units of length"))
        t = np.array(triple("translation", translation, "(X, Y, Z) in units of length"))
        return cls(turned.rotation, tuple((P + t - turned._R @ P).tolist()))

    @classmethod
    def of_camera(cls, rotation: Any = _ORIGIN, translation: Any = _ORIGIN) -> RigidDisplacement:
        """Displacement of the scene that a camera sees which moves to a new pose: X' = Rᵀ (X − t).

        Parameters
        ----------
        rotation : 3×3 numbers, or 3
            R, whose columns are the new axes of the camera in the old ones, or its rotation vector, rad.
        translation : (float, float, float)
            t, the new place of the centre of projection in the old axes, in units of length.

        Raises
        ------
        InputError
            If a value cannot be used.
        """
        return cls(rotation, translation).inverse()

    @property
    def _R(self) -> Array:
        return np.array(self.rotation)

    @property
    def _t(self) -> Array:
        return np.array(self.translation)

    def apply(self, points: ArrayLike) -> Array:
        """Where scene points (..., 3) go: R X + t; InputError if they are not finite."""
        points = finite_floats("points", points, (3,))
        return np.asarray(points @ self._R.T + self._t)

    def inverse(self) -> RigidDisplacement:
        """The displacement back: X = Rᵀ (X' − t)."""
        return displacement_of(self._R.T, -self._R.T @ self._t)

    def then(self, later: RigidDisplacement) -> RigidDisplacement:
        """Follow this displacement by another."""
        require(isinstance(later, RigidDisplacement), "later", later, "must be a RigidDisplacement")
        return displacement_of(later._R @ self._R, later._R @ self._t + later._t)


def displacement_of(rotation: Array, translation: Array) -> RigidDisplacement:
    """The displacement of a rotation matrix (3, 3) and a translation (3,)."""
    return RigidDisplacement(tuple(rotation.tolist()), tuple(translation.tolist()))
