"""Affine motions: u(x) = shift + G (x − centre), with the one-parameter group through them.

In homogeneous coordinates the map is a 3×3 matrix M; `at(s)` is M^s = exp(s log M). The logarithm of the 2×2
block A = I + G has a closed form: with A = √det (c I + N), N traceless, N² = (c² − 1) I,

    log A = ½ log(det) I + (q / S) N,    S = sinh q, c = cosh q  (or S = sin q, c = cos q).
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.checks import number, numbers, require
from sixflow.errors import InputError
from sixflow.synth.arguments import Array
from sixflow.synth.motions.base import Motion

Matrix = tuple[tuple[float, float], tuple[float, float]]


@dataclasses.dataclass(frozen=True)
class Affine(Motion):
    """Affine motion u(x) = shift + G (x − centre).

    Parameters
    ----------
    shift : (float, float)
        Displacement (u, v) of the centre, px.
    G : 2×2 numbers
        Displacement gradient [[u_x, u_y], [v_x, v_y]]; det(I + G) must be positive.
    centre : (float, float)
        The point (x, y), px, to which the shift belongs.

    Raises
    ------
    InputError
        If a value is not finite or of the wrong size, or the map folds or flips the plane.

    See Also
    --------
    Affine.from_six, Affine.translation, Affine.rotation, Affine.zoom, Affine.pure_shear, Affine.simple_shear

    Examples
    --------
    >>> motion = Affine(shift=(0.5, 0.0), G=((0.01, 0.0), (0.0, -0.01)), centre=(32.0, 32.0))
    >>> [round(float(part), 6) for part in motion.displacement(42.0, 32.0)]
    [0.6, 0.0]
    >>> motion.six(32.0, 32.0).round(6).tolist()
    [0.5, 0.0, 0.0, 0.0, 0.02, 0.0]
    """

    shift: tuple[float, float] = (0.0, 0.0)
    G: Matrix = ((0.0, 0.0), (0.0, 0.0))
    centre: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "shift", numbers("shift", self.shift, 2, "(u, v) in px"))
        object.__setattr__(self, "centre", numbers("centre", self.centre, 2, "(x, y) in px"))
        try:
            flat = np.asarray(self.G, dtype=np.float64)
        except (TypeError, ValueError):
            flat = np.empty(0)
        good = flat.shape == (2, 2) and bool(np.isfinite(flat).all())
        require(good, "G", self.G, "must be 2×2 finite numbers [[u_x, u_y], [v_x, v_y]]")
        object.__setattr__(self, "G", tuple(tuple(row) for row in flat.tolist()))
        det = (1 + flat[0, 0]) * (1 + flat[1, 1]) - flat[0, 1] * flat[1, 0]
        require(
            det > 0, "G", self.G, f"folds or flips the plane, det(I + G) = {det:.3g}; it must be positive"
        )

    @classmethod
    def from_six(cls, six: Any, centre: tuple[float, float] = (0.0, 0.0)) -> Affine:
        """Motion with given (u, v, divergence, curl, stretch, shear) at its centre.

        G = ½ [[divergence + stretch, shear − curl], [shear + curl, divergence − stretch]].

        Raises
        ------
        InputError
            If they are not six finite numbers, or the map folds the plane.
        """
        meaning = "(u, v, divergence, curl, stretch, shear)"
        u, v, divergence, curl, stretch, shear = numbers("six", six, 6, meaning)
        G = (
            ((divergence + stretch) / 2, (shear - curl) / 2),
            ((shear + curl) / 2, (divergence - stretch) / 2),
        )
        return cls((u, v), G, centre)

    @classmethod
    def translation(cls, u: float, v: float) -> Affine:
        """The same displacement (u, v), px, everywhere."""
        return cls((u, v))

    @classmethod
    def rotation(cls, angle: float, centre: tuple[float, float] = (0.0, 0.0)) -> Affine:
        """Rotation about the centre by an angle, rad; positive from x to y, clockwise on the screen."""
        angle = number("angle", angle, unit="radians")
        cos, sin = math.cos(angle), math.sin(angle)
        return cls(G=((cos - 1, -sin), (sin, cos - 1)), centre=centre)

    @classmethod
    def zoom(cls, factor: float, centre: tuple[float, float] = (0.0, 0.0)) -> Affine:
        """Enlargement about the centre by a factor above 0."""
        factor = number("factor", factor, above=0)
        return cls(G=((factor - 1, 0.0), (0.0, factor - 1)), centre=centre)

    @classmethod
    def pure_shear(
        cls, factor: float, angle: float = 0.0, centre: tuple[float, float] = (0.0, 0.0)
    ) -> Affine:
        """Stretch by a factor along a direction and by 1/factor across it, the area unchanged.

        Parameters
        ----------
        factor : float
            Stretch ratio, above 0.
        angle : float
            Direction of the stretch, rad, from x towards y.
        centre : (float, float)
            The point that stays, px.
        """
        factor = number("factor", factor, above=0)
        return cls(G=_turned(np.diag([factor - 1, 1 / factor - 1]), angle), centre=centre)

    @classmethod
    def simple_shear(
        cls, amount: float, angle: float = 0.0, centre: tuple[float, float] = (0.0, 0.0)
    ) -> Affine:
        """Sliding along a direction by `amount` px per px of distance across it: u = amount · y for angle 0.

        Parameters
        ----------
        amount : float
            Engineering shear, without unit.
        angle : float
            Direction of the sliding, rad, from x towards y.
        centre : (float, float)
            The point that stays, px.
        """
        amount = number("amount", amount)
        return cls(G=_turned(np.array([[0.0, amount], [0.0, 0.0]]), angle), centre=centre)

    def _displacement(self, x: Array, y: Array) -> tuple[Any, Any]:
        (u_x, u_y), (v_x, v_y) = self.G
        dx, dy = x - self.centre[0], y - self.centre[1]
        return self.shift[0] + u_x * dx + u_y * dy, self.shift[1] + v_x * dx + v_y * dy

    def _gradient(self, x: Array, y: Array) -> tuple[Any, Any, Any, Any]:
        (u_x, u_y), (v_x, v_y) = self.G
        return u_x, u_y, v_x, v_y

    def _inverse(self, x: Array, y: Array) -> tuple[Array, Array]:
        (u_x, u_y), (v_x, v_y) = self.G
        u, v = self._displacement(x, y)
        det = (1 + u_x) * (1 + v_y) - u_y * v_x
        return x - ((1 + v_y) * u - u_y * v) / det, y - ((1 + u_x) * v - v_x * u) / det

    def at(self, s: float) -> Affine:
        """The affine motion M^s = exp(s log M) of the same one-parameter group.

        Raises
        ------
        InputError
            If s is no finite number, or I + G has negative eigenvalues other than of a half turn, so that no
            real steady motion leads to it.
        """
        s = number("s", s)
        if s == 1:
            return self
        if not any(any(row) for row in self.G):
            return Affine((s * self.shift[0], s * self.shift[1]), self.G, self.centre)
        L = self._log()
        from scipy.linalg import expm

        # exp(s [[L, w], [0, 0]]) = [[exp(sL), P(s) w], [0, 1]], P(s) the integral of exp(tL) from 0 to s
        integral = expm(np.block([[L, np.eye(2)], [np.zeros((2, 4))]]))[:2, 2:]
        generator = np.zeros((3, 3))
        generator[:2, :2] = L
        generator[:2, 2] = np.linalg.solve(integral, np.array(self.shift))
        with np.errstate(over="ignore", invalid="ignore"):
            M = expm(s * generator)
        return Affine(tuple(M[:2, 2]), M[:2, :2] - np.eye(2), self.centre)

    def _log(self) -> NDArray[np.float64]:
        """Real logarithm of I + G, by the closed form of the module."""
        A = np.eye(2) + np.array(self.G)
        det = A[0, 0] * A[1, 1] - A[0, 1] * A[1, 0]
        A /= math.sqrt(det)
        c = (A[0, 0] + A[1, 1]) / 2
        N = A - c * np.eye(2)
        square = N[0, 0] ** 2 + N[0, 1] * N[1, 0]
        if c < 0 and square >= 0:
            raise InputError(
                f"G={self.G!r}: I + G has negative eigenvalues, so it is reached by no steady motion; "
                "use at(1) only, or a motion that turns by less than half a turn"
            )
        S = math.sqrt(abs(square))
        q = math.asinh(S) if square >= 0 else math.atan2(S, c)
        return math.log(det) / 2 * np.eye(2) + (q / S if S > 0 else 1.0) * N


def _turned(G: NDArray[np.float64], angle: float) -> Matrix:
    """Gradient of the same motion in axes turned by the angle."""
    angle = number("angle", angle, unit="radians")
    R = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    (a, b), (c, d) = (R @ G @ R.T).tolist()
    return (a, b), (c, d)
