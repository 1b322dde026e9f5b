"""One of the two solutions for structure and motion of a plane, and what follows from it."""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sixflow.checks import number, require
from sixflow.errors import InputError
from sixflow.scenes.arguments import Array, Of
from sixflow.scenes.motion import RigidMotion
from sixflow.scenes.plane import Plane

REASONS = {
    "general": "two solutions; direction of motion and normal are exchanged between them",
    "along normal": "the motion is along the plane's normal, or cannot be distinguished from it: the two solutions "
    "are one, or differ by no more than their errors",
    "pure rotation": "no translation, or the plane is too far away to show it: its normal, its tilt and the time "
    "to contact are undetermined",
    "unknown": "a coefficient or a variance is not a finite number",
}
"""The cases, and what is determined in each."""


class PlanarErrors(NamedTuple):
    """Standard errors of a solution, to first order; infinite for what is undetermined, NaN where unknown.

    Attributes
    ----------
    normal, translation, rotation : arrays, shape (..., 3)
        1, 1 per frame interval, rad per frame interval.
    speed : array, shape (...)
        1 per frame interval.
    slant, tilt : arrays, shape (...)
        rad.
    time_to_contact : array, shape (...)
        Frame intervals.
    """

    normal: Array
    translation: Array
    rotation: Array
    speed: Array
    slant: Array
    tilt: Array
    time_to_contact: Array


@dataclasses.dataclass(frozen=True, eq=False)
class PlanarSolution:
    """A plane and its motion relative to the camera, up to scale.

    Attributes
    ----------
    normal : array, shape (..., 3)
        n̂, unit vector from the camera towards the plane; NaN where undetermined.
    translation : array, shape (..., 3)
        Velocity over the plane's distance, 1 per frame interval: that of the camera's centre, or with
        of="object" that of the object at the camera's centre.
    rotation : array, shape (..., 3)
        Angular velocity of the camera or object, rad per frame interval.
    approach : array, shape (...)
        Share of the distance that is lost per frame interval: 1/time to contact, the same in both solutions.
        0 where that is so to rounding, or undetermined.
    case : array of str, shape (...)
        "general", "along normal", "pure rotation" or "unknown"; see `reason`.
    fronto_parallel : bool array, shape (...)
        The slant is 0, or cannot be distinguished from it: there is no tilt.
    visible : bool array, shape (...)
        The camera sees this plane at all of the given image points.
    of : "camera" or "object"
        Whose motion it is.
    covariance : array, shape (..., 9, 9), or None
        Of normal, translation and rotation; its diagonal is infinite for an undetermined normal.
    approach_variance : array, shape (...), or None
    """

    normal: Array
    translation: Array
    rotation: Array
    approach: Array
    case: NDArray[Any]
    fronto_parallel: NDArray[np.bool_]
    visible: NDArray[np.bool_]
    of: Of
    covariance: Array | None = None
    approach_variance: Array | None = None

    @property
    def reason(self) -> NDArray[Any]:
        """What is determined in this case, as text, shape (...)."""
        return np.vectorize(REASONS.__getitem__, otypes=[object])(self.case)[()]

    @property
    def speed(self) -> Array:
        """|V|/d, 1 per frame interval."""
        return np.linalg.norm(self.translation, axis=-1)

    @property
    def slant(self) -> Array:
        """Angle between normal and optical axis, rad; NaN where undetermined."""
        return np.asarray(
            np.arctan2(np.hypot(self.normal[..., 0], self.normal[..., 1]), self.normal[..., 2])
        )[()]

    @property
    def tilt(self) -> Array:
        """Direction in the image in which the depth grows fastest, rad; NaN where undetermined."""
        angle = np.arctan2(-self.normal[..., 1], -self.normal[..., 0])
        return np.where(self.fronto_parallel, np.nan, angle)[()]

    @property
    def time_to_contact(self) -> Array:
        """Frame intervals until the plane passes through the camera's centre; the same in both solutions.

        Negative if it recedes, infinite if it does not come nearer or that is undetermined.
        """
        safe = np.where(self.approach == 0, 1.0, self.approach)
        return np.where(self.approach == 0, np.inf, 1 / safe)[()]

    @property
    def standard_errors(self) -> PlanarErrors:
        """Standard errors of everything, from the covariance of the coefficients.

        Raises
        ------
        InputError
            If the coefficients had no covariance.
        """
        if self.covariance is None or self.approach_variance is None:
            raise InputError("covariance=None: the eight coefficients had none; give it to planar_structure")
        lost = np.isinf(np.diagonal(self.covariance, axis1=-2, axis2=-1)).any(axis=-1)
        still = self.speed == 0
        finite = np.where(np.isinf(self.covariance), 0.0, self.covariance)
        each = np.sqrt(np.diagonal(self.covariance, axis1=-2, axis2=-1))
        g = self._gradients()
        speed, slant, tilt = np.sqrt(np.einsum("g...i,...ij,g...j->g...", g, finite, g))
        # where there is no direction to differentiate along, all are alike: the root mean square
        speed = np.where(still, np.sqrt(np.einsum("...ii->...", finite[..., 3:6, 3:6]) / 3), speed)
        facing = np.sqrt(np.einsum("...ii->...", finite[..., :2, :2]) / 2)
        slant = np.where(self.fronto_parallel, facing, slant)
        away = np.isinf(self.time_to_contact)
        contact = np.where(away, 1.0, self.time_to_contact) ** 2 * np.sqrt(self.approach_variance)
        return PlanarErrors(
            each[..., :3],
            each[..., 3:6],
            each[..., 6:],
            speed[()],
            np.where(lost, np.inf, slant)[()],
            np.where(lost | self.fronto_parallel, np.inf, tilt)[()],
            np.where(lost | away, np.inf, contact)[()],
        )

    def _gradients(self) -> Array:
        """Derivatives of speed, slant and tilt by the nine numbers, shape (3, ..., 9)."""
        n, V = self.normal, self.translation
        steep = np.hypot(n[..., 0], n[..., 1])
        g = np.zeros((3, *n.shape[:-1], 9))
        g[0, ..., 3:6] = _over(V, self.speed[..., None])
        g[1, ..., :2] = _over(n[..., 2:] * n[..., :2], steep[..., None])
        g[1, ..., 2] = -steep
        g[2, ..., 0], g[2, ..., 1] = _over(-n[..., 1], steep**2), _over(n[..., 0], steep**2)
        return np.where(np.expand_dims(self.case == "pure rotation", -1), 0.0, g)

    def plane(self, distance: float) -> Plane:
        """The plane, for a known distance.

        Parameters
        ----------
        distance : float
            Perpendicular distance from the camera, in units of length, above 0.

        Raises
        ------
        InputError
            If the solution holds several points, its normal is undetermined, or the distance is not above 0.
        """
        self._require_one()
        remedy = "this solution has no normal: " + str(self.reason)
        require(bool(np.isfinite(self.normal).all()), "case", str(self.case), remedy)
        return Plane(tuple(self.normal.tolist()), distance)

    def motion(self, distance: float) -> RigidMotion:
        """The motion, for a known distance.

        Parameters
        ----------
        distance : float
            Perpendicular distance from the camera, in units of length, above 0.

        Raises
        ------
        InputError
            If the solution holds several points, is unknown, or the distance is not above 0.
        """
        self._require_one()
        require(str(self.case) != "unknown", "case", str(self.case), str(self.reason))
        distance = number("distance", distance, above=0, unit="units of length")
        translation = tuple((distance * self.translation).tolist())
        return RigidMotion(translation, tuple(self.rotation.tolist()), self.of)

    def _require_one(self) -> None:
        if self.normal.ndim > 1:
            raise InputError(
                f"normal of shape {self.normal.shape}: this solution holds several points; take one of them"
            )


def _over(numerator: Array, denominator: Array) -> Array:
    """Quotient, 0 where the denominator is 0."""
    return np.divide(numerator, denominator, out=np.zeros_like(numerator), where=denominator != 0)
