"""A pinhole camera: image points ↔ directions in space.

Axes, right-handed, at the camera's centre of projection: X to the right, Y down, Z forward along the optical
axis, so that the image axes x (right) and y (down) are those of X and Y. A scene point (X, Y, Z), Z > 0, is
seen at (Eagleson, §2: xZ = fX, yZ = fY)

    x = c_x + f X/Z,    y = c_y + f Y/Z.

| symbol | name | unit |
|---|---|---|
| f | `focal` | px |
| (c_x, c_y) | `centre`, the principal point | px; the first pixel's centre is (0, 0) |
| m = ((x − c_x)/f, (y − c_y)/f, 1) | `direction` of an image point | 1 |
| K = [[f, 0, c_x], [0, f, c_y], [0, 0, 1]] | `matrix` | px |
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike

from sixflow.array_checks import broadcast, finite_floats, image_points
from sixflow.checks import number, numbers, require
from sixflow.errors import InputError
from sixflow.scenes.arguments import Array, pair

_NEAREST = 1e-12  # smallest Z/|X| that counts as in front of the camera


@dataclasses.dataclass(frozen=True)
class Camera:
    """A pinhole camera with square pixels and without distortion.

    Parameters
    ----------
    focal : float
        Focal length, px, above 0: that in mm divided by the side of a pixel in mm.
    centre : (float, float)
        Principal point (c_x, c_y), px, where the optical axis meets the image. Pixel centres are whole
        numbers: the middle of an image of 640 × 480 is (319.5, 239.5).

    Raises
    ------
    InputError
        If the focal length is not above 0, or a number is not finite.

    Examples
    --------
    >>> camera = Camera(focal=800, centre=(320, 240))
    >>> [float(part) for part in camera.project([0.5, 0.25, 2.0])]
    [520.0, 340.0]
    >>> camera.direction(520, 340).tolist()
    [0.25, 0.125, 1.0]
    """

    focal: float
    centre: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "focal", number("focal", self.focal, above=0, unit="px"))
        object.__setattr__(self, "centre", pair("centre", self.centre, "the principal point (x, y) in px"))

    @classmethod
    def from_field_of_view(cls, angle: float, shape: tuple[int, int]) -> Camera:
        """Camera of a horizontal field of view, with the principal point in the middle of the image.

        f = ½ width / tan(½ angle); the width is counted from edge to edge of the pixels.

        Parameters
        ----------
        angle : float
            Horizontal field of view, rad, above 0 and below π.
        shape : (int, int)
            Rows and columns of the image.

        Raises
        ------
        InputError
            If a value is outside its range.

        Examples
        --------
        >>> import math
        >>> camera = Camera.from_field_of_view(math.radians(60), (480, 640))
        >>> round(camera.focal, 2), camera.centre
        (554.26, (319.5, 239.5))
        """
        angle = number("angle", angle, above=0, unit="radians")
        require(angle < math.pi, "angle", angle, "must be below π rad; a pinhole sees less than a half space")
        rows, columns = numbers("shape", shape, 2, "rows and columns")
        require(rows > 0 and columns > 0, "shape", shape, "must be rows and columns above 0")
        return cls(columns / 2 / math.tan(angle / 2), ((columns - 1) / 2, (rows - 1) / 2))

    @property
    def matrix(self) -> Array:
        """K, shape (3, 3): takes a scene point to homogeneous image coordinates."""
        return np.array([[self.focal, 0, self.centre[0]], [0, self.focal, self.centre[1]], [0, 0, 1.0]])

    @property
    def inverse_matrix(self) -> Array:
        """K⁻¹, shape (3, 3): takes (x, y, 1) to the direction m."""
        f, (x, y) = self.focal, self.centre
        return np.array([[1 / f, 0, -x / f], [0, 1 / f, -y / f], [0, 0, 1.0]])

    def direction(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Direction m of image points: the scene points seen there are Z m.

        Parameters
        ----------
        x, y : arrays
            Image points, px; shapes that broadcast.

        Returns
        -------
        float64 array, shape (..., 3)
            ((x − c_x)/f, (y − c_y)/f, 1).

        Raises
        ------
        InputError
            If the points are not real, not finite, or of shapes that do not broadcast.
        """
        x, y = image_points(x, y)
        return np.stack(
            [(x - self.centre[0]) / self.focal, (y - self.centre[1]) / self.focal, np.ones_like(x)], axis=-1
        )

    def point(self, x: ArrayLike, y: ArrayLike, depth: ArrayLike) -> Array:
        """Scene points that are seen at image points, at given depths.

        Parameters
        ----------
        x, y : arrays
            Image points, px.
        depth : array
            Z, in units of length, finite and above 0. All three broadcast together.

        Returns
        -------
        float64 array, shape (..., 3)
            (X, Y, Z), in the unit of the depth.

        Raises
        ------
        InputError
            If a depth is not finite or not above 0, or the points cannot be used.

        Examples
        --------
        >>> Camera(focal=800, centre=(320, 240)).point(520, 340, 2.0).tolist()
        [0.5, 0.25, 2.0]
        """
        m, depth = self.direction(x, y), require_depth(depth)
        depth = broadcast(points=m[..., 0], depth=depth)[1]
        return m * depth[..., None]

    def project(self, points: ArrayLike) -> tuple[Array, Array]:
        """Image points of scene points.

        Parameters
        ----------
        points : array, shape (..., 3)
            (X, Y, Z), in one unit of length, Z > 0.

        Returns
        -------
        x, y : float64 arrays, shape (...)
            px.

        Raises
        ------
        InputError
            If a point is not finite, or not in front of the camera.
        """
        points = finite_floats("points", points, (3,))
        bad = ~(points[..., 2] > _NEAREST * np.abs(points).max(axis=-1))
        if bad.any():
            raise InputError(
                f"points: {int(bad.sum())} of {bad.size} are not in front of the camera (Z > 0), such as "
                f"{points[bad][0].tolist()}; leave them out"
            )
        return (
            self.centre[0] + self.focal * points[..., 0] / points[..., 2],
            self.centre[1] + self.focal * points[..., 1] / points[..., 2],
        )


def require_depth(depth: ArrayLike) -> Array:
    """Return depths as float64; InputError unless all are finite and above 0."""
    depth = finite_floats("depth", depth)
    bad = ~(depth > 0)
    if bad.any():
        raise InputError(
            f"depth: {int(bad.sum())} of {bad.size} are not above 0, such as {depth[bad][0]}; "
            "only points in front of the camera are seen"
        )
    return depth
