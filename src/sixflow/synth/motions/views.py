"""Motions as a pinhole camera sees them: a plane, a curved surface, and any homography.

The pattern is what frame 0 shows: paint on the surface, as the camera sees it at the start. A point x of frame 0 is
a scene point X = Z(x) m(x), which goes to R X + t and is projected there (`sixflow.scenes`). For a plane this is a
homography with an exact inverse; for a surface the inverse is found by Newton's method to 1e-9 px.

In time the velocities of the motion stay constant in the camera's axes: `at(s)` is the motion after s frame
intervals, exactly. It is no one-parameter group of the image, since the surface comes nearer on the way.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from sixflow.checks import number, require
from sixflow.scenes.camera import Camera
from sixflow.scenes.flow import surface_displacement
from sixflow.scenes.homography import (
    homography_log,
    homography_six,
    plane_homography,
    require_homography,
)
from sixflow.scenes.motion import RigidMotion, as_motion
from sixflow.scenes.plane import Plane
from sixflow.scenes.surface import Surface, require_surface
from sixflow.synth.arguments import Array
from sixflow.synth.motions.base import Motion

Rows = tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]


@dataclasses.dataclass(frozen=True)
class Homography(Motion):
    """Projective motion: (x', y', 1) ~ H (x, y, 1).

    Parameters
    ----------
    matrix : 3×3 numbers
        H in homogeneous coordinates (x, y, 1), px, of any positive scale, det H > 0.

    Raises
    ------
    InputError
        If H is singular or mirrors. Where points are asked for: if they go to infinity.

    See Also
    --------
    PlaneInView : the homography of a plane in rigid motion.

    Examples
    --------
    >>> motion = Homography(((1, 0, 2), (0, 1, 0), (0.001, 0, 1)))
    >>> motion.six(0.0, 0.0).round(6).tolist()
    [2.0, 0.0, -0.002, 0.0, -0.002, 0.0]
    """

    matrix: Rows

    def __post_init__(self) -> None:
        H = require_homography(self.matrix)
        object.__setattr__(self, "matrix", tuple(tuple(row) for row in H.tolist()))

    def _displacement(self, x: Array, y: Array) -> tuple[Any, Any]:
        return _displacement_of(np.array(self.matrix), x, y)

    def _gradient(self, x: Array, y: Array) -> tuple[Any, Any, Any, Any]:
        return _gradient_of(np.array(self.matrix), x, y)

    def _inverse(self, x: Array, y: Array) -> tuple[Array, Array]:
        u, v = _displacement_of(_inverse_of(np.array(self.matrix)), x, y)
        return x + u, y + v

    def at(self, s: float) -> Homography:
        """The homography exp(s log H) of the same one-parameter group.

        Raises
        ------
        InputError
            If s is no finite number, or H has no real logarithm.
        """
        s = number("s", s)
        if s == 1:
            return self
        from scipy.linalg import expm

        return Homography(expm(s * homography_log(self.matrix)))


@dataclasses.dataclass(frozen=True)
class PlaneInView(Motion):
    """A plane and a camera in rigid motion, as the camera sees it: an exact homography.

    Parameters
    ----------
    camera : sixflow.scenes.Camera
    plane : sixflow.scenes.Plane
        As it is in frame 0.
    motion : sixflow.scenes.RigidMotion or RigidDisplacement
        Of one frame interval; a displacement stands for the steady motion (a screw) that makes it.

    Raises
    ------
    InputError
        If an argument is of another kind, or the plane passes through the camera. Where points are asked for: if
        they do not show the plane, or show it no more after the motion.

    Examples
    --------
    A camera 2 m before a slanted wall approaches by 4 cm per frame:

    >>> from sixflow.scenes import Camera, Plane, RigidMotion
    >>> view = PlaneInView(
    ...     Camera(focal=800, centre=(64, 64)), Plane.from_slant(2.0, slant=0.5), RigidMotion((0, 0, 0.04))
    ... )
    >>> view.six(64.0, 64.0)[2:4].round(6).tolist()
    [0.040816, 0.0]
    """

    camera: Camera
    plane: Plane
    motion: RigidMotion

    def __post_init__(self) -> None:
        object.__setattr__(self, "motion", as_motion(self.motion))
        plane_homography(self.camera, self.plane, self.motion)

    @property
    def homography(self) -> Array:
        """H, shape (3, 3), px; its third row gives the ratio of depths."""
        return plane_homography(self.camera, self.plane, self.motion)

    def _displacement(self, x: Array, y: Array) -> tuple[Any, Any]:
        self._require_seen(x, y)
        return _displacement_of(self.homography, x, y)

    def _gradient(self, x: Array, y: Array) -> tuple[Any, Any, Any, Any]:
        self._require_seen(x, y)
        return _gradient_of(self.homography, x, y)

    def _inverse(self, x: Array, y: Array) -> tuple[Array, Array]:
        u, v = _displacement_of(_inverse_of(self.homography), x, y)
        self._require_seen(x + u, y + v)
        return x + u, y + v

    def _require_seen(self, x: Array, y: Array) -> None:
        self.plane.require_depth(self.camera, x, y)

    def at(self, s: float) -> PlaneInView:
        """The motion from time 0 to time s, with the same velocities of the camera or object.

        Raises
        ------
        InputError
            If s is no finite number, or the plane passes through the camera by then.
        """
        return PlaneInView(self.camera, self.plane, self.motion.scaled(number("s", s)))


@dataclasses.dataclass(frozen=True)
class SurfaceInView(Motion):
    """A curved surface and a camera in rigid motion, as the camera sees it.

    Parameters
    ----------
    camera : sixflow.scenes.Camera
    surface : sixflow.scenes.Surface
        As it is in frame 0: a DepthMap, or a surface of your own.
    motion : sixflow.scenes.RigidMotion or RigidDisplacement
        Of one frame interval; a displacement stands for the steady motion (a screw) that makes it.

    Raises
    ------
    InputError
        If an argument is of another kind. Where points are asked for: if they do not show the surface (let a
        depth map reach beyond the frame by more than the motion), go behind the camera, or the surface hides
        a part of itself after the motion.

    Examples
    --------
    >>> import numpy as np
    >>> from sixflow.scenes import Camera, DepthMap, RigidMotion
    >>> y, x = np.mgrid[-16:81:4, -16:81:4]
    >>> bump = DepthMap(2 - 0.1 * np.exp(-((x - 32) ** 2 + (y - 32) ** 2) / 400), origin=(-16, -16), step=4)
    >>> view = SurfaceInView(Camera(focal=400, centre=(32, 32)), bump, RigidMotion((0.01, 0, 0)))
    >>> view.six([32.0, 0.0], 32.0)[:, 0].round(4).tolist()     # the bump is nearer and faster
    [-2.1053, -2.0078]
    """

    camera: Camera
    surface: Surface
    motion: RigidMotion

    def __post_init__(self) -> None:
        require(isinstance(self.camera, Camera), "camera", self.camera, "must be a sixflow.scenes.Camera")
        require_surface(self.surface)
        object.__setattr__(self, "motion", as_motion(self.motion))

    def _displacement(self, x: Array, y: Array) -> tuple[Any, Any]:
        six = self._six(x, y)
        return six[..., 0], six[..., 1]

    def _gradient(self, x: Array, y: Array) -> tuple[Any, Any, Any, Any]:
        return _rows(self._six(x, y))

    def _six(self, x: Array, y: Array) -> Array:
        return surface_displacement(self.camera, self.surface, self.motion, x, y)

    def at(self, s: float) -> SurfaceInView:
        """The motion from time 0 to time s, with the same velocities of the camera or object.

        Raises
        ------
        InputError
            If s is no finite number.
        """
        return SurfaceInView(self.camera, self.surface, self.motion.scaled(number("s", s)))


def _inverse_of(H: Array) -> Array:
    return np.asarray(np.linalg.inv(H), dtype=np.float64)


def _displacement_of(H: Array, x: Array, y: Array) -> tuple[Array, Array]:
    six = homography_six(H, x, y)
    return six[..., 0], six[..., 1]


def _gradient_of(H: Array, x: Array, y: Array) -> tuple[Array, Array, Array, Array]:
    return _rows(homography_six(H, x, y))


def _rows(six: Array) -> tuple[Array, Array, Array, Array]:
    """u_x, u_y, v_x, v_y of the six."""
    _, _, divergence, curl, stretch, shear = np.moveaxis(six, -1, 0)
    return (divergence + stretch) / 2, (shear - curl) / 2, (shear + curl) / 2, (divergence - stretch) / 2
