"""Planes before a camera, in four parameterisations.

In the camera's axes (X right, Y down, Z forward) a plane that does not pass through the camera's centre is

    n̂·X = d,    or  n·X = 1 with n = n̂/d,    or  Z = pX + qY + r,

and the depth at the image point of direction m = (x̃/f, ỹ/f, 1) is Z = 1/(n·m): the inverse depth 1/Z is linear
in the image coordinates.

| symbol | name | unit |
|---|---|---|
| n̂ | `normal`, unit vector from the camera towards the plane | 1 |
| d | `distance` from the camera's centre, along the normal | length |
| n = n̂/d | `scaled_normal` | 1/length |
| p, q, r | `slopes`, with r the depth on the optical axis | 1, 1, length |
| σ | slant: angle between normal and optical axis, tan σ = √(p² + q²) | rad |
| τ | tilt: direction in the image in which the depth grows fastest, from x towards y, tan τ = q/p | rad |
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sixflow.array_checks import image_points
from sixflow.checks import number, require
from sixflow.errors import InputError
from sixflow.scenes.arguments import Array, Triple, require_kind, triple
from sixflow.scenes.camera import Camera
from sixflow.scenes.displacement import RigidDisplacement
from sixflow.scenes.motion import RigidMotion, as_displacement
from sixflow.scenes.surface import Surface

GRAZING = 1e-9
"""Smallest cosine between a plane's normal and a line of sight (2e-7 rad from grazing) at which it is seen."""


@dataclasses.dataclass(frozen=True)
class Plane(Surface):
    """The plane n̂·X = d.

    Parameters
    ----------
    normal : (float, float, float)
        Direction from the camera's centre to the foot of the perpendicular on the plane, in the camera's
        axes; of any length above 0.
    distance : float
        Perpendicular distance d, in units of length, above 0: a plane through the camera's centre is seen
        edge-on and shows nothing.

    Raises
    ------
    InputError
        If the normal is 0, the distance is not above 0, or the whole plane is behind the camera.

    See Also
    --------
    Plane.from_slant, Plane.from_slopes, Plane.ground

    Examples
    --------
    >>> wall = Plane(normal=(0, 0, 1), distance=2.0)
    >>> wall.depth(Camera(focal=800), 100.0, 0.0)
    array(2.)
    >>> wall.slopes
    (0.0, 0.0, 2.0)
    """

    normal: Triple
    distance: float

    def __post_init__(self) -> None:
        normal = triple("normal", self.normal, "the direction from the camera to the plane")
        size = math.hypot(*normal)
        require(size > 0, "normal", self.normal, "must not be 0")
        x, y, z = (part / size for part in normal)
        behind = z <= 0 and math.hypot(x, y) < GRAZING
        require(not behind, "normal", self.normal, "points backwards: the whole plane is behind the camera")
        object.__setattr__(self, "normal", (x, y, z))
        distance = number("distance", self.distance, above=0, unit="units of length")
        object.__setattr__(self, "distance", distance)

    @classmethod
    def from_slant(cls, distance: float, slant: float, tilt: float = 0.0) -> Plane:
        """Plane of a slant and tilt, at a depth on the optical axis.

        Parameters
        ----------
        distance : float
            Depth r on the optical axis, in units of length, above 0. (The perpendicular distance is r cos σ.)
        slant : float
            Angle between the plane's normal and the optical axis, rad, from 0 (fronto-parallel) to below π/2.
        tilt : float
            Direction in the image in which the depth grows fastest, rad, from x towards y. At slant 0 it has
            no meaning.

        Raises
        ------
        InputError
            If a value is outside its range.

        Examples
        --------
        A floor that recedes upwards in the image:

        >>> import math
        >>> floor = Plane.from_slant(distance=2.0, slant=math.radians(45), tilt=math.radians(-90))
        >>> [round(part, 6) for part in floor.slopes]
        [0.0, -1.0, 2.0]
        """
        distance = number("distance", distance, above=0, unit="units of length")
        slant, tilt = number("slant", slant, unit="radians"), number("tilt", tilt, unit="radians")
        good = 0 <= slant < math.pi / 2 - GRAZING
        require(good, "slant", slant, "must be from 0 to below π/2 rad; at π/2 the plane is seen edge-on")
        n = (-math.sin(slant) * math.cos(tilt), -math.sin(slant) * math.sin(tilt), math.cos(slant))
        return cls(n, distance * math.cos(slant))

    @classmethod
    def from_slopes(cls, p: float, q: float, r: float) -> Plane:
        """Plane Z = pX + qY + r.

        Parameters
        ----------
        p, q : float
            ∂Z/∂X and ∂Z/∂Y, without unit.
        r : float
            Depth on the optical axis, in units of length, above 0.

        Raises
        ------
        InputError
            If a value is not finite, or r is not above 0: the plane passes through the camera's centre, or
            meets the optical axis behind it.
        """
        p, q = number("p", p), number("q", q)
        r = number("r", r, unit="units of length")
        remedy = (
            "must be above 0; at 0 the plane passes through the camera, below 0 it meets the axis behind it"
        )
        require(r > 0, "r", r, remedy)
        return cls((-p, -q, 1.0), r / math.hypot(p, q, 1.0))

    @classmethod
    def ground(cls, height: float, pitch: float = 0.0, roll: float = 0.0) -> Plane:
        """Level ground below a camera.

        Parameters
        ----------
        height : float
            Height of the camera above the ground, in units of length, above 0.
        pitch : float
            Angle by which the camera looks down, rad: 0 to the horizon, π/2 straight down.
        roll : float
            Angle by which the camera is then turned about its optical axis, rad, positive clockwise as seen
            from behind it; the picture turns anticlockwise.

        Raises
        ------
        InputError
            If a value is outside its range, or the camera looks straight up.

        Examples
        --------
        >>> import math
        >>> down = Plane.ground(height=30.0, pitch=math.radians(90))
        >>> [round(part, 6) + 0.0 for part in down.normal], down.distance
        ([0.0, 0.0, 1.0], 30.0)
        """
        pitch, roll = number("pitch", pitch, unit="radians"), number("roll", roll, unit="radians")
        across = math.cos(pitch)
        normal = (across * math.sin(roll), across * math.cos(roll), math.sin(pitch))
        return cls(normal, number("height", height, above=0, unit="units of length"))

    @property
    def scaled_normal(self) -> Array:
        """The normal divided by the distance, n = n̂/d, shape (3,), 1/length: n·X = 1 on the plane."""
        return np.array(self.normal) / self.distance

    @property
    def slopes(self) -> Triple:
        """(p, q, r) of Z = pX + qY + r; without unit, and length.

        Raises
        ------
        InputError
            If the plane does not meet the optical axis in front of the camera.
        """
        x, y, z = self.normal
        remedy = "does not meet the optical axis in front of the camera, so that it has no p, q, r"
        require(z > GRAZING, "normal", self.normal, remedy)
        return 0.0 - x / z, 0.0 - y / z, self.distance / z

    @property
    def slant(self) -> float:
        """Angle between normal and optical axis, rad, from 0."""
        return math.atan2(math.hypot(*self.normal[:2]), self.normal[2])

    @property
    def tilt(self) -> float:
        """Direction in the image in which the depth grows fastest, rad; NaN for a fronto-parallel plane."""
        x, y = self.normal[:2]
        return math.atan2(-y, -x) if x or y else math.nan

    def sees(self, camera: Camera, x: ArrayLike, y: ArrayLike) -> NDArray[np.bool_]:
        """Whether image points show the plane: those beyond its horizon do not.

        Parameters
        ----------
        camera : Camera
        x, y : arrays
            Image points, px; shapes that broadcast.

        Raises
        ------
        InputError
            If an argument cannot be used.

        Examples
        --------
        >>> Plane.ground(height=1.5).sees(Camera(focal=800, centre=(320, 240)), 320, [200, 240, 280])
        array([False, False,  True])
        """
        require_kind("camera", camera, Camera, "Camera(focal=800)")
        m = camera.direction(x, y)
        return np.asarray(m @ np.array(self.normal) > GRAZING * np.linalg.norm(m, axis=-1))

    def moved(self, motion: RigidMotion | RigidDisplacement) -> Plane:
        """The plane after the motion of one frame interval: n' = R n/(1 + n·Rᵀt).

        Raises
        ------
        InputError
            If the plane then passes through the camera's centre or has passed it, or is behind the camera.

        Examples
        --------
        >>> wall = Plane(normal=(0, 0, 1), distance=2.0)
        >>> wall.moved(RigidMotion(translation=(0, 0, 0.5))).distance
        1.5
        """
        step = as_displacement(motion)
        R, t = np.array(step.rotation), np.array(step.translation)
        normal = R @ np.array(self.normal)
        distance = self.distance + float(normal @ t)
        if not distance > 0:
            raise InputError(
                f"motion={motion!r}: takes the plane to the distance {distance:.6g}, through the camera's centre; "
                "stop before"
            )
        return Plane(tuple(normal.tolist()), distance)

    def _depth(self, camera: Camera, x: Array, y: Array) -> tuple[Array, Array, Array]:
        n = self.scaled_normal
        x, y = image_points(x, y)
        inverse = camera.direction(x, y) @ n
        seen = self.sees(camera, x, y)
        Z = np.divide(1.0, inverse, out=np.full_like(inverse, np.nan), where=seen)
        return Z, -(Z**2) * n[0] / camera.focal, -(Z**2) * n[1] / camera.focal
