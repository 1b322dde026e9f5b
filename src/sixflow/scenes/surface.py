"""Surfaces before a camera: the depth, and how it changes over the image.

A surface gives the depth Z(x, y) that the camera sees at an image point, with its derivatives Z_x and Z_y
(length per px). `Plane` and `DepthMap` are surfaces; so is anything that defines `_depth`.
"""

from __future__ import annotations

import abc
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sixflow.array_checks import finite_floats, image_points
from sixflow.checks import number, require
from sixflow.errors import InputError
from sixflow.scenes.arguments import Array, pair, refuse_points, require_kind
from sixflow.scenes.camera import Camera, require_depth


class Surface(abc.ABC):
    """A surface that a camera sees.

    A surface of your own subclasses this and defines `_depth(camera, x, y)`, which returns (Z, Z_x, Z_y) for
    float64 arrays of one shape; Z is NaN where the camera does not see the surface.
    """

    @abc.abstractmethod
    def _depth(self, camera: Camera, x: Array, y: Array) -> tuple[Array, Array, Array]:
        """Depth and its derivatives at checked image points."""

    def depth(self, camera: Camera, x: ArrayLike, y: ArrayLike) -> Array:
        """Depth Z at image points.

        Parameters
        ----------
        camera : Camera
        x, y : arrays
            Image points, px; shapes that broadcast.

        Returns
        -------
        float64 array of the broadcast shape
            Units of length; NaN where the camera does not see the surface.

        Raises
        ------
        InputError
            If an argument cannot be used.
        """
        require_kind("camera", camera, Camera, "Camera(focal=800)")
        return self._depth(camera, *image_points(x, y))[0]

    def require_depth(self, camera: Camera, x: Array, y: Array) -> tuple[Array, Array, Array]:
        """Depth and its derivatives at image points, all of which see the surface.

        Raises
        ------
        InputError
            If one of them does not.
        """
        Z, Z_x, Z_y = self._depth(camera, x, y)
        refuse_points(
            f"surface={self!r}: not seen by the camera", ~(np.isfinite(Z) & (Z > 0)), x, y,
            "it is at infinity, behind the camera or beyond its border there; leave those points out",
        )  # fmt: skip
        return Z, Z_x, Z_y


class DepthMap(Surface):
    """A smooth surface through a table of depths: the tensor-product cubic spline through them.

    The spline is the surface: it is twice continuously differentiable, and depth and slope are exact. Beyond
    the table nothing is seen, so let it reach some px farther than the frame.

    Parameters
    ----------
    depth : array, shape (rows, columns)
        Z in units of length, finite and above 0; at least 4 × 4.
    origin : (float, float)
        Image point (x, y) of the first depth, px.
    step : float
        Distance of the depths in the image, px, above 0.

    Raises
    ------
    InputError
        If the table is too small, a depth is not above 0, or another value cannot be used.

    Examples
    --------
    >>> y, x = np.mgrid[-20:120:4, -20:120:4]
    >>> relief = DepthMap(2 + 0.05 * np.sin(x / 20), origin=(-20, -20), step=4)
    >>> camera = Camera(focal=800, centre=(50, 50))
    >>> relief.depth(camera, [50.0, 500.0], 50.0).round(4)
    array([2.0299,    nan])
    """

    def __init__(self, depth: ArrayLike, origin: tuple[float, float] = (0.0, 0.0), step: float = 1.0) -> None:
        table = require_depth(finite_floats("depth", depth))
        if table.ndim != 2 or min(table.shape) < 4:
            raise InputError(f"depth of shape {table.shape}: must be a table of at least 4 × 4 depths")
        self.table = table
        self.origin = pair("origin", origin, "(x, y) of the first depth in px")
        self.step = number("step", step, above=0, unit="px")
        from scipy.interpolate import RectBivariateSpline

        rows, columns = (np.arange(n) * self.step for n in table.shape)
        self._spline: Any = RectBivariateSpline(rows, columns, table)
        self._last = float(columns[-1]), float(rows[-1])

    def __repr__(self) -> str:
        shape = f"{self.table.shape[0]}×{self.table.shape[1]}"
        return f"DepthMap({shape} depths, origin={self.origin}, step={self.step})"

    def _depth(self, camera: Camera, x: Array, y: Array) -> tuple[Array, Array, Array]:
        x, y = x - self.origin[0], y - self.origin[1]
        inside = (x >= 0) & (y >= 0) & (x <= self._last[0]) & (y <= self._last[1])
        parts = (self._spline(y, x, dx=of_y, dy=of_x, grid=False) for of_y, of_x in ((0, 0), (0, 1), (1, 0)))
        Z, Z_x, Z_y = (np.where(inside, part, np.nan) for part in parts)
        return Z, Z_x, Z_y


def require_surface(surface: object) -> Surface:
    """Return the surface; InputError if it is none."""
    remedy = "must be a surface of sixflow.scenes, such as Plane.from_slant(distance=2, slant=0.5)"
    require(isinstance(surface, Surface), "surface", surface, remedy)
    return surface  # type: ignore[return-value]
