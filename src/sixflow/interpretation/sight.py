"""The six at a point as a camera sees them that looks straight at it: the frame in which they are interpreted.

Off the optical axis, rotation and foreshortening of the flat image leak into divergence and shear. In a camera turned
by Q so that its axis is the line of sight m̂ of the point, Q m̂ = e_Z, the flow is that of L' = Q L Qᵀ (`scenes.flow`),
and the six of L' at its principal point follow from the six at the point in the camera as it is: a linear change, the
identity on the axis. In that frame, with the scene's velocities T and ω there,

    u/f = a_x + ω_Y    v/f = a_y − ω_X    a = (T_X, T_Y)/R             motion across the line of sight
    ρ = −T_Z/R                                                       motion along it: 1/time to contact
    divergence = 2ρ + a·h
    curl       = 2ω_Z − (a_x h_y − a_y h_x)
    stretch    = a_x h_x − a_y h_y,    shear = a_x h_y + a_y h_x

(Longuet-Higgins and Prazdny; Koenderink and van Doorn). With complex numbers a = a_x + i a_y and so on,

    divergence = 2ρ + Re(a h̄),    curl = 2ω_Z + Im(a h̄),    S = stretch + i shear = a h.

T is the scene's velocity at the camera's centre. An object that turns about an axis of its own has one too: it counts
as moving across the line of sight, although the point that is looked at stands still.

| symbol | name |
|---|---|
| R | distance of the surface along the line of sight |
| h | gradient of log(1/Z): the surface's slope, n ∝ (h_x, h_y, 1); 0 where it faces the line of sight |
| S | deformation; its size |a h| is the most that a slant adds to divergence and curl |
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.convention import SIX_FROM_GRADIENT
from sixflow.errors import InputError
from sixflow.interpretation.region import RegionFit, require_fit
from sixflow.scenes import Camera, recentring_matrix
from sixflow.scenes.arguments import Of, pair, require_kind, require_of, triple
from sixflow.scenes.flow import coefficients_from_matrix, matrix_from_coefficients
from sixflow.scenes.rotation import rotation_matrix

Array = NDArray[Any]


@dataclasses.dataclass(frozen=True, eq=False)
class Sight:
    """The six at a point in the frame of its line of sight.

    Attributes
    ----------
    point : (float, float)
        px.
    turn : array, shape (3, 3)
        Q, takes the camera's axes to those of the line of sight.
    across : array, shape (2,)
        u/f and v/f, rad per frame interval.
    divergence, curl : float
    shearing : complex
        S.
    covariance : array, shape (6, 6)
        Of (u/f, v/f, divergence, curl, stretch, shear).
    """

    point: tuple[float, float]
    turn: Array
    across: Array
    divergence: float
    curl: float
    shearing: complex
    covariance: Array

    def error(self, gradient: Array) -> float:
        """Standard error of a number of this gradient by the six."""
        return float(np.sqrt(max(float(gradient @ self.covariance @ gradient), 0.0)))


def look_at(fit: RegionFit, camera: Camera, point: tuple[float, float] | None) -> Sight:
    """Return the six rates of a region's flow at a point, in the frame of its line of sight.

    Raises InputError if an argument cannot be used.

    Parameters
    ----------
    fit : RegionFit
    camera : Camera
    point : (x, y) or None
        px; None for the middle of the region's points.
    """
    require_fit(fit)
    require_kind("camera", camera, Camera, "Camera(focal=800)")
    x, y = fit.centre if point is None else pair("point", point, "the image point (x, y) in px")
    turn = turn_to(camera.direction(x, y))
    M = _six_in_turned_camera(camera, turn, x, y) @ recentring_matrix(x - fit.centre[0], y - fit.centre[1])
    six = M @ fit.eight.coefficients
    assert fit.eight.covariance is not None
    return Sight(
        (x, y),
        turn,
        six[:2],
        float(six[2]),
        float(six[3]),
        complex(six[4], six[5]),
        np.asarray(M @ fit.eight.covariance @ M.T),
    )


def turn_to(direction: Array) -> Array:
    """The rotation Q, without roll, that takes a direction in front of the camera to e_Z."""
    x, y, z = direction / np.linalg.norm(direction)
    sine = float(np.hypot(x, y))
    if sine == 0:
        return np.eye(3)
    return rotation_matrix(np.arctan2(sine, z) / sine * np.array([y, -x, 0.0]))  # about m̂ × e_Z


def _six_in_turned_camera(camera: Camera, turn: Array, x: float, y: float) -> Array:
    """Matrix from the eight about a point to (u/f, v/f, divergence, curl, stretch, shear), shape (6, 8)."""
    to_axis = recentring_matrix(camera.centre[0] - x, camera.centre[1] - y)
    L = matrix_from_coefficients(to_axis.T, camera.focal)  # of each of the eight in turn
    turned = coefficients_from_matrix(turn @ L @ turn.T, 1.0)
    return np.asarray(SIX_FROM_GRADIENT @ turned[:, :6].T)


def scene_direction(heading: Any, of: Of) -> Array:
    """Unit vector of the scene's translation T, from the heading of the camera or the object.

    Raises InputError if it is not three finite numbers, or 0.
    """
    require_of(of)
    vector = np.array(triple("heading", heading, "the direction (X, Y, Z) of the motion"))
    size = float(np.linalg.norm(vector))
    if size == 0:
        raise InputError(f"heading={heading!r}: must not be 0; (0, 0, 1) is forwards along the optical axis")
    return (vector if of == "object" else -vector) / size


def scene_rotation(rotation: Any, of: Of, fit: RegionFit) -> Array:
    """The scene's rotation ω, rad per frame interval, from that of the camera or the object in the fit's unit of time.

    Raises InputError if it is not three finite numbers.
    """
    require_of(of)
    vector = np.array(
        triple("rotation", rotation, "(X, Y, Z) in rad per frame interval, or rad/s if that is known")
    )
    return (vector if of == "object" else -vector) * fit.clock.span
