"""What every exact motion can do: displace, differentiate, run in time, be inverted.

A motion maps a point x of the reference frame to x + u(x) in the moved frame; G = [[u_x, u_y], [v_x, v_y]] is
its displacement gradient, F = I + G. x points right, y down, both in px. Nothing here is interpolated.
"""

from __future__ import annotations

import abc
import dataclasses
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sixflow.checks import number, require
from sixflow.errors import InputError
from sixflow.synth.arguments import Array, points

_GOAL = 1e-11  # px: Newton's method stops here
_ACCEPT = 1e-9  # px: what is promised
_ITERATIONS = 200


class Motion(abc.ABC):
    """A motion of the plane, exact everywhere.

    A motion of your own subclasses this and defines `_displacement(x, y)`, which returns (u, v), and
    `_gradient(x, y)`, which returns (u_x, u_y, v_x, v_y); both receive float64 arrays of one shape. Define
    `at` too where the course in time is known better than s·u(x).
    """

    @abc.abstractmethod
    def _displacement(self, x: Array, y: Array) -> tuple[Any, Any]:
        """Displacement (u, v) at checked points, px."""

    @abc.abstractmethod
    def _gradient(self, x: Array, y: Array) -> tuple[Any, Any, Any, Any]:
        """Derivatives (u_x, u_y, v_x, v_y) at checked points."""

    def displacement(self, x: ArrayLike, y: ArrayLike) -> tuple[Array, Array]:
        """Displacement of points of the reference frame.

        Parameters
        ----------
        x, y : array
            Coordinates in the reference frame, px; any shapes that broadcast.

        Returns
        -------
        u, v : float64 arrays
            Displacement, px, in the broadcast shape.

        Raises
        ------
        InputError
            If the coordinates are not real, not finite, or of shapes that do not broadcast.
        """
        x, y = points(x, y)
        u, v = self._displacement(x, y)
        return _filled(u, x), _filled(v, x)

    def gradient(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Displacement gradient G at points of the reference frame.

        Parameters
        ----------
        x, y : array
            Coordinates in the reference frame, px.

        Returns
        -------
        float64 array, shape (..., 2, 2)
            [[u_x, u_y], [v_x, v_y]].

        Raises
        ------
        InputError
            If the coordinates cannot be used.
        """
        x, y = points(x, y)
        parts = [_filled(part, x) for part in self._gradient(x, y)]
        return np.stack(parts, axis=-1).reshape(*x.shape, 2, 2)

    def six(self, x: ArrayLike, y: ArrayLike) -> Array:
        """The six numbers (u, v, divergence, curl, stretch, shear) at points of the reference frame.

        Parameters
        ----------
        x, y : array
            Coordinates in the reference frame, px.

        Returns
        -------
        float64 array, shape (..., 6)
            u and v in px; divergence u_x+v_y, curl v_x−u_y, stretch u_x−v_y and shear u_y+v_x without unit.

        Raises
        ------
        InputError
            If the coordinates cannot be used.
        """
        u, v = self.displacement(x, y)
        G = self.gradient(x, y)
        u_x, u_y, v_x, v_y = G[..., 0, 0], G[..., 0, 1], G[..., 1, 0], G[..., 1, 1]
        return np.stack([u, v, u_x + v_y, v_x - u_y, u_x - v_y, u_y + v_x], axis=-1)

    def forward(self, x: ArrayLike, y: ArrayLike) -> tuple[Array, Array]:
        """Where points of the reference frame are in the moved frame: x + u(x), y + v(x).

        Raises
        ------
        InputError
            If the coordinates cannot be used.
        """
        x, y = points(x, y)
        u, v = self._displacement(x, y)
        return x + u, y + v

    def at(self, s: float) -> Motion:
        """The motion from time 0 to time s; `at(1)` is the motion itself.

        Where the motion is a one-parameter group (a steady flow, an affine map) this is the group element, so
        that `at(s)` after `at(t)` is `at(s + t)`. Otherwise every point moves straight and steadily: s·u(x).

        Parameters
        ----------
        s : float
            Time in units of the frame interval; negative runs backwards.

        Raises
        ------
        InputError
            If s is no finite number.
        """
        s = number("s", s)
        return self if s == 1 else ScaledMotion(self, s)

    def inverse(self, x: ArrayLike, y: ArrayLike) -> tuple[Array, Array]:
        """Where points of the moved frame were in the reference frame: X with X + u(X) = x, to 1e-9 px.

        Newton's method with the exact gradient, each point with its own damping.

        Parameters
        ----------
        x, y : array
            Coordinates in the moved frame, px.

        Returns
        -------
        X, Y : float64 arrays
            Coordinates in the reference frame, px.

        Raises
        ------
        InputError
            If the coordinates cannot be used, or the motion folds the plane (det(I + G) ≤ 0) at one of the
            points or their origins, so that a point of the moved frame would have more than one origin.
        """
        x, y = points(x, y)
        X, Y = self._inverse(x.ravel(), y.ravel())
        return X.reshape(x.shape), Y.reshape(x.shape)

    def _inverse(self, x: Array, y: Array) -> tuple[Array, Array]:
        self._require_unfolded(x, y)
        u, v = self._displacement(x, y)
        X, Y = x - u, y - v
        error = np.full(x.shape, np.inf)
        found_x, found_y = X.copy(), Y.copy()
        step_x, step_y = np.zeros_like(x), np.zeros_like(x)
        damping = np.ones_like(x)
        goal = np.maximum(_GOAL, 8 * np.finfo(np.float64).eps * np.maximum(np.abs(x), np.abs(y)))
        todo = np.arange(x.size)
        for _ in range(_ITERATIONS):
            trial_x, trial_y = X[todo], Y[todo]
            u, v = self._displacement(trial_x, trial_y)
            res_x, res_y = trial_x + u - x[todo], trial_y + v - y[todo]
            trial_error = np.hypot(res_x, res_y)
            better = trial_error < error[todo]
            kept = todo[better]
            found_x[kept], found_y[kept], error[kept] = trial_x[better], trial_y[better], trial_error[better]
            a, b, c, d = (_filled(g, trial_x)[better] for g in self._gradient(trial_x, trial_y))
            a, d = a + 1, d + 1
            det = a * d - b * c
            det = np.where(np.abs(det) < 1e-6, 1e-6, det)
            step_x[kept] = -(d * res_x[better] - b * res_y[better]) / det
            step_y[kept] = -(a * res_y[better] - c * res_x[better]) / det
            damping[todo] = np.where(better, np.minimum(1.0, 2 * damping[todo]), damping[todo] / 2)
            todo = todo[(error[todo] > goal[todo]) & (damping[todo] > 1e-9)]
            if not todo.size:
                break
            X[todo] = found_x[todo] + damping[todo] * step_x[todo]
            Y[todo] = found_y[todo] + damping[todo] * step_y[todo]
        lost = ~(error <= np.maximum(_ACCEPT, goal))
        if lost.any():
            k = int(np.argmax(lost))
            raise InputError(
                f"motion={self!r}: no origin found for {int(lost.sum())} points of the moved frame, such as "
                f"({x[k]:.6g}, {y[k]:.6g}); the motion folds or tears there: make it weaker or smoother"
            )
        self._require_unfolded(found_x, found_y)
        return found_x, found_y

    def _require_unfolded(self, x: Array, y: Array) -> None:
        u_x, u_y, v_x, v_y = self._gradient(x, y)
        det = _filled((1 + u_x) * (1 + v_y) - u_y * v_x, x)
        if det.size and not det.min() > 0:
            k = int(np.argmin(det))
            raise InputError(
                f"motion={self!r}: folds the plane: det(I + G) = {det[k]:.3g} at ({x[k]:.6g}, {y[k]:.6g}); "
                "make the motion or its gradients smaller until the determinant is positive everywhere"
            )


@dataclasses.dataclass(frozen=True)
class ScaledMotion(Motion):
    """A motion whose displacement is s times another's: every point moves straight and steadily.

    Parameters
    ----------
    motion : Motion
        The motion at time 1.
    s : float
        Time in units of the frame interval.

    Raises
    ------
    InputError
        If `motion` is no Motion or s no finite number.

    Examples
    --------
    >>> from sixflow.synth import CellularVortices
    >>> half = CellularVortices(amplitude=2.0, period=40.0).at(0.5)
    >>> [round(float(part), 6) for part in half.displacement(10.0, 0.0)]
    [1.0, -0.0]
    """

    motion: Motion
    s: float

    def __post_init__(self) -> None:
        require_motion("motion", self.motion)
        object.__setattr__(self, "s", number("s", self.s))

    def _displacement(self, x: Array, y: Array) -> tuple[Any, Any]:
        u, v = self.motion._displacement(x, y)
        return self.s * u, self.s * v

    def _gradient(self, x: Array, y: Array) -> tuple[Any, Any, Any, Any]:
        u_x, u_y, v_x, v_y = self.motion._gradient(x, y)
        return self.s * u_x, self.s * u_y, self.s * v_x, self.s * v_y

    def at(self, s: float) -> Motion:
        """The motion from time 0 to time s: the same straight course, so the times multiply."""
        return self.motion.at(self.s * number("s", s))


def require_motion(name: str, motion: object) -> None:
    """Raise an InputError unless the argument is a motion."""
    remedy = "must be a motion of sixflow.synth, such as Affine.translation(0.3, 0)"
    require(isinstance(motion, Motion), name, motion, remedy)


def _filled(values: Any, like: Array) -> Array:
    """Give a constant the shape of the points."""
    return np.broadcast_to(np.asarray(values, dtype=np.float64), like.shape).copy()
