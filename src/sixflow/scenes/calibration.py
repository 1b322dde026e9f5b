"""Calibration: the eight and the six as functions of the nine parameters of structure and motion.

The nine are the motion (V_X, V_Y, V_Z, Ω_X, Ω_Y, Ω_Z) and the plane Z = pX + qY + r. With the scene's velocities
T = s (V − Ω × P), ω = s Ω (s = 1 for an object, −1 for a camera; `motion`) and n = (−p, −q, 1)/r the flow is
linear in L = [ω]× + T nᵀ (`flow`), so that its derivatives are

    ∂L/∂V_k = s e_k nᵀ          ∂L/∂Ω_k = s ([e_k]× + (P × e_k) nᵀ)
    ∂L/∂p = −T e_Xᵀ/r           ∂L/∂q = −T e_Yᵀ/r           ∂L/∂r = −T nᵀ/r

and the six at an image point are linear in the eight (`eight.six_matrix`). The units are those of the six, per
length and frame interval (V), per rad and frame interval (Ω), per 1 (p, q) and per length (r).

The scale cannot be seen: V and r multiplied by one factor give the same flow, Σ V_k ∂/∂V_k + r ∂/∂r = 0 (with P
scaled along). So at most eight of the nine follow from the eight coefficients, and six from the six.
"""

from __future__ import annotations

import dataclasses
import os
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sixflow.array_checks import finite_floats
from sixflow.checks import number, numbers, require
from sixflow.convention import SIX
from sixflow.errors import InputError
from sixflow.scenes.arguments import Array, Of, Triple, pair, require_kind, require_of, triple
from sixflow.scenes.camera import Camera
from sixflow.scenes.eight import EIGHT, six_matrix
from sixflow.scenes.flow import coefficients_from_matrix, velocity_matrix
from sixflow.scenes.motion import RigidMotion
from sixflow.scenes.plane import Plane
from sixflow.scenes.rotation import skew

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NINE = ("V_X", "V_Y", "V_Z", "Omega_X", "Omega_Y", "Omega_Z", "p", "q", "r")
"""Names of the nine parameters of structure and motion, in the order used everywhere."""

_SYMBOLS = ("V_X", "V_Y", "V_Z", r"\Omega_X", r"\Omega_Y", r"\Omega_Z", "p", "q", "r")
_AXES = np.eye(3)


def eight_from_nine(
    nine: ArrayLike, focal: float, *, of: Of = "camera", point: ArrayLike = (0.0, 0.0, 0.0)
) -> Array:
    """The eight coefficients of many scenes at once.

    Parameters
    ----------
    nine : array, shape (..., 9)
        V_X, V_Y, V_Z (length per frame interval), Omega_X, Omega_Y, Omega_Z (rad per frame interval), p, q, r
        (1, 1, length), r above 0.
    focal : float
        px, above 0.
    of : "camera" or "object"
        Whose motion it is.
    point : (float, float, float)
        The point of the moving body whose velocity V is, in units of length.

    Returns
    -------
    float64 array, shape (..., 8)
        About the principal point, in the order of `EIGHT`.

    Raises
    ------
    InputError
        If an argument cannot be used, or an r is not above 0.

    Examples
    --------
    A camera 2 m before a wall approaches by 0.1 m per frame: a divergence A + D of 0.1.

    >>> eight_from_nine([0, 0, 0.1, 0, 0, 0, 0, 0, 2.0], focal=800)[[2, 5]]
    array([0.05, 0.05])
    """
    nine, focal, sign, P = _checked(nine, focal, of, point)
    T, omega, n = _scene(nine, sign, P)
    return coefficients_from_matrix(velocity_matrix(n, T, omega), focal)


def eight_jacobian(
    nine: ArrayLike, focal: float, *, of: Of = "camera", point: ArrayLike = (0.0, 0.0, 0.0)
) -> Array:
    """Derivative of the eight coefficients with respect to the nine parameters.

    Parameters
    ----------
    nine, focal, of, point
        As in `eight_from_nine`.

    Returns
    -------
    float64 array, shape (..., 8, 9)

    Raises
    ------
    InputError
        If an argument cannot be used, or an r is not above 0.

    Examples
    --------
    >>> J = eight_jacobian([0, 0, 0.1, 0, 0, 0, 0, 0, 2.0], focal=800)
    >>> J[2].round(3) + 0.0                  # A: by V_Z and by r
    array([ 0.   ,  0.   ,  0.5  ,  0.   ,  0.   ,  0.   ,  0.   ,  0.   , -0.025])
    """
    nine, focal, sign, P = _checked(nine, focal, of, point)
    T, _, n = _scene(nine, sign, P)
    by_translation = _AXES[:, :, None] * n[..., None, None, :]
    lever = np.cross(P, _AXES)  # rows P × e_k
    by_rotation = skew(_AXES) + lever[:, :, None] * n[..., None, None, :]
    r = nine[..., 8]
    by_n = np.stack(np.broadcast_arrays(-_AXES[0], -_AXES[1], -n), axis=-2) / r[..., None, None]
    by_plane = T[..., None, :, None] * by_n[..., :, None, :]
    dL = np.concatenate([sign * by_translation, sign * by_rotation, by_plane], axis=-3)
    return np.swapaxes(coefficients_from_matrix(dL, focal), -1, -2)


@dataclasses.dataclass(frozen=True, eq=False)
class Calibration:
    """The six and the eight of a scene, and how they change with each of the nine parameters.

    Attributes
    ----------
    camera : Camera
    plane : Plane
    motion : RigidMotion
    at : (float, float)
        The image point of the six, px.
    nine : array, shape (9,)
        The parameters, in the order of `NINE`.
    eight : array, shape (8,)
        u0 … F about the principal point.
    eight_jacobian : array, shape (8, 9)
    six : array, shape (6,)
        At the image point.
    six_jacobian : array, shape (6, 9)
    """

    camera: Camera
    plane: Plane
    motion: RigidMotion
    at: tuple[float, float]
    nine: Array
    eight: Array
    eight_jacobian: Array
    six: Array
    six_jacobian: Array

    def table(self, numbers: Literal["six", "eight"] = "six", *, length: str = "m") -> str:
        """The Jacobian as text: a row for each of the six or eight, a column for each of the nine.

        Parameters
        ----------
        numbers : "six" or "eight"
        length : str
            Name of the unit of length of the scene.

        Raises
        ------
        InputError
            If `numbers` is neither.
        """
        require(numbers in ("six", "eight"), "numbers", numbers, "must be 'six' or 'eight'")
        names = SIX if numbers == "six" else EIGHT
        values, J = (self.six, self.six_jacobian) if numbers == "six" else (self.eight, self.eight_jacobian)
        units = (f"{length}/frame",) * 3 + ("rad/frame",) * 3 + ("1", "1", length)
        lines = [("", "value", *NINE), ("", "", *(f"per {unit}" for unit in units))]
        lines.append(("at", "", *_written(self.nine, float(np.abs(self.nine).max()))))
        columns = [_written(column, float(np.abs(column).max())) for column in (values, *J.T)]
        lines += zip(names, *columns, strict=True)
        rows = ("".join(f"{text:>14}" for text in line).rstrip() for line in lines)
        return "\n".join(rows)

    def picture(
        self, shape: tuple[int, int], path: str | os.PathLike[str] | None = None, *, length: str = "m"
    ) -> Figure:
        """Nine panels: how the flow over a frame changes with each of the nine.

        The arrows are the derivative of (u, v) by one parameter, to a scale of their own: the number above a panel is
        that of the longest arrow. The cross is the point of the six. Regions that do not show the plane are grey.

        Parameters
        ----------
        shape : (int, int)
            Rows and columns of the frame.
        path : path, optional
            Where to save the picture: .png, .pdf or .svg.
        length : str
            Name of the unit of length of the scene.

        Returns
        -------
        Figure
            Of matplotlib.

        Raises
        ------
        InputError
            If the shape or the kind of file cannot be used.
        FieldFileError
            If the picture cannot be saved.
        """
        from sixflow.drawing.flows import arrow_grid, draw_flows

        rows, columns = numbers("shape", shape, 2, "rows and columns of the frame")
        require(min(rows, columns) >= 2, "shape", shape, "must be rows and columns of at least 2")
        x, y = arrow_grid((rows, columns))
        from_centre = x - self.camera.centre[0], y - self.camera.centre[1]
        flows = six_matrix(*from_centre)[..., :2, :] @ self.eight_jacobian
        flows = np.where(self.plane.sees(self.camera, x, y)[..., None, None], flows, np.nan)
        units = (f"{length}/frame",) * 3 + ("rad/frame",) * 3 + ("1", "1", length)
        titles = [
            f"$\\partial(u, v)/\\partial {symbol}$: {{}} px/frame per {unit}"
            for symbol, unit in zip(_SYMBOLS, units, strict=True)
        ]

        def sees(x: Array, y: Array) -> NDArray[np.bool_]:
            return self.plane.sees(self.camera, x, y)

        return draw_flows((rows, columns), flows, titles, centre=self.at, sees=sees, path=path)

    def __str__(self) -> str:
        return self.table()


def calibrate(
    camera: Camera, plane: Plane, motion: RigidMotion, at: tuple[float, float] | None = None
) -> Calibration:
    """Calibrate the six numbers at an image point against the scene's nine parameters.

    Parameters
    ----------
    camera : Camera
    plane : Plane
        One that meets the optical axis in front of the camera.
    motion : RigidMotion
        Its `translation`, `rotation`, `of` and `point` are kept: the derivatives are by those very numbers.
    at : (float, float), optional
        Image point (x, y), px; the principal point by default.

    Raises
    ------
    InputError
        If the plane does not meet the optical axis or is not seen at the point, or another argument cannot be
        used.

    Examples
    --------
    >>> camera = Camera(focal=800, centre=(320, 240))
    >>> plane = Plane.from_slant(distance=2.0, slant=0.5)
    >>> found = calibrate(camera, plane, RigidMotion(translation=(0.02, 0, 0.1)))
    >>> [float(part) for part in found.six_jacobian[0]]              # u: by V_X, by Omega_Y, by r
    [-400.0, 0.0, 0.0, 0.0, -800.0, 0.0, 0.0, 0.0, 4.0]
    >>> for line in found.table(length="m").splitlines()[:4]:
    ...     print(line[:70])
                           value           V_X           V_Y           V_Z
                                   per m/frame   per m/frame   per m/frame
                at                        0.02             0           0.1
                 u            -8          -400             0             0
    """
    require_kind("camera", camera, Camera, "Camera(focal=800)")
    require_kind("plane", plane, Plane, "Plane.from_slant(distance=2, slant=0.5)")
    require_kind("motion", motion, RigidMotion, "RigidMotion(translation=(0, 0, 0.1))")
    at = camera.centre if at is None else pair("at", at, "the image point (x, y) in px")
    nine = np.array([*motion.translation, *motion.rotation, *plane.slopes])
    plane.require_depth(camera, np.array(at[0]), np.array(at[1]))
    M = six_matrix(at[0] - camera.centre[0], at[1] - camera.centre[1])
    eight = eight_from_nine(nine, camera.focal, of=motion.of, point=motion.point)
    J = eight_jacobian(nine, camera.focal, of=motion.of, point=motion.point)
    return Calibration(camera, plane, motion, at, nine, eight, J, M @ eight, M @ J)


def _written(numbers: Array, largest: float) -> tuple[str, ...]:
    """Numbers to four digits; those that differ from 0 by rounding as 0."""
    return tuple(f"{0.0 if abs(one) < 1e-13 * largest else one:.4g}" for one in numbers.tolist())


def _checked(nine: ArrayLike, focal: float, of: Of, point: ArrayLike) -> tuple[Array, float, float, Array]:
    nine = finite_floats("nine", nine, (9,))
    r = nine[..., 8]
    if not (r > 0).all():
        raise InputError(
            f"nine: r={float(r[~(r > 0)][0])!r} must be above 0; at 0 the plane passes through the camera, below 0 it "
            "meets the axis behind it"
        )
    require_of(of)
    P: Triple = triple("point", point, "(X, Y, Z) in units of length")
    sign = 1.0 if of == "object" else -1.0
    return nine, number("focal", focal, above=0, unit="px"), sign, np.array(P)


def _scene(nine: Array, sign: float, P: Array) -> tuple[Array, Array, Array]:
    """T, ω and n, each of shape (..., 3)."""
    V, Omega, p, q, r = nine[..., :3], nine[..., 3:6], nine[..., 6], nine[..., 7], nine[..., 8]
    n = np.stack([-p, -q, np.ones_like(p)], axis=-1) / r[..., None]
    return sign * (V - np.cross(Omega, P)), sign * Omega, n
