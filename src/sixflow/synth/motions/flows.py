"""Motions of fluids: cellular vortices, the Lamb–Oseen vortex, a boundary layer."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sixflow.checks import number, numbers
from sixflow.synth.arguments import Array, length, points
from sixflow.synth.motions.base import Motion


@dataclasses.dataclass(frozen=True)
class CellularVortices(Motion):
    """Chequerboard of counter-rotating vortices (Taylor–Green), as a displacement.

    u = amplitude sin(kx) cos(ky), v = −amplitude cos(kx) sin(ky), k = 2π/period: free of divergence, with a
    largest curl of 2 amplitude k. In time every point moves straight and steadily.

    Parameters
    ----------
    amplitude : float
        Largest displacement, px. The motion folds from amplitude = period/2π on.
    period : float
        px, at least 0.1; a vortex is half a period wide.
    centre : (float, float)
        A corner between four vortices, where the motion vanishes and stretches, px.

    Raises
    ------
    InputError
        If a value is outside its range.

    Examples
    --------
    >>> motion = CellularVortices(amplitude=2.0, period=40.0)
    >>> motion.six(10.0, 10.0).round(6).tolist()
    [0.0, -0.0, 0.0, 0.628319, 0.0, 0.0]
    """

    amplitude: float
    period: float
    centre: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "amplitude", number("amplitude", self.amplitude, unit="px"))
        object.__setattr__(self, "period", length("period", self.period))
        object.__setattr__(self, "centre", numbers("centre", self.centre, 2, "(x, y) in px"))

    def _displacement(self, x: Array, y: Array) -> tuple[Any, Any]:
        k = 2 * math.pi / self.period
        X, Y = k * (x - self.centre[0]), k * (y - self.centre[1])
        return self.amplitude * np.sin(X) * np.cos(Y), -self.amplitude * np.cos(X) * np.sin(Y)

    def _gradient(self, x: Array, y: Array) -> tuple[Any, Any, Any, Any]:
        k = 2 * math.pi / self.period
        X, Y = k * (x - self.centre[0]), k * (y - self.centre[1])
        even = self.amplitude * k * np.cos(X) * np.cos(Y)
        odd = self.amplitude * k * np.sin(X) * np.sin(Y)
        return even, -odd, odd, -even


@dataclasses.dataclass(frozen=True)
class LambOseen(Motion):
    """Lamb–Oseen vortex, as the exact map of its steady flow: every circle turns by its own angle.

    θ(r) = angle (1 − exp(−q))/q with q = r²/core²; `angle` = Γ/(2π core²) for the circulation Γ per frame
    interval. The map keeps areas and is a one-parameter group: `at(s)` turns by s θ(r).

    Parameters
    ----------
    angle : float
        Angle by which the centre turns, rad; positive from x to y, clockwise on the screen.
    core : float
        Core radius, px, at least 0.1. The largest displacement is about 0.64 angle core, near 1.12 core.
    centre : (float, float)
        px.

    Raises
    ------
    InputError
        If a value is outside its range.

    Examples
    --------
    >>> motion = LambOseen(angle=0.2, core=20.0, centre=(64.0, 64.0))
    >>> motion.six(74.0, 64.0).round(4).tolist()
    [-0.1562, 1.7604, -0.0238, 0.3103, 0.0075, -0.0417]
    """

    angle: float
    core: float
    centre: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "angle", number("angle", self.angle, unit="radians"))
        object.__setattr__(self, "core", length("core", self.core))
        object.__setattr__(self, "centre", numbers("centre", self.centre, 2, "(x, y) in px"))

    def _displacement(self, x: Array, y: Array) -> tuple[Any, Any]:
        dx, dy = x - self.centre[0], y - self.centre[1]
        turn = self.angle * _mean_decay((dx**2 + dy**2) / self.core**2)
        # cos θ − 1 without cancellation
        less, sin = -2 * np.sin(turn / 2) ** 2, np.sin(turn)
        return less * dx - sin * dy, sin * dx + less * dy

    def _gradient(self, x: Array, y: Array) -> tuple[Any, Any, Any, Any]:
        dx, dy = x - self.centre[0], y - self.centre[1]
        q = (dx**2 + dy**2) / self.core**2
        turn = self.angle * _mean_decay(q)
        slope = 2 * self.angle * _mean_decay_slope(q) / self.core**2  # ∇θ = slope (dx, dy)
        less, sin, cos = -2 * np.sin(turn / 2) ** 2, np.sin(turn), np.cos(turn)
        across_x, across_y = -sin * dx - cos * dy, cos * dx - sin * dy  # derivative of the turned point by θ
        return (
            less + slope * across_x * dx,
            -sin + slope * across_x * dy,
            sin + slope * across_y * dx,
            less + slope * across_y * dy,
        )

    def _inverse(self, x: Array, y: Array) -> tuple[Array, Array]:
        return self.at(-1.0).forward(x, y)

    def at(self, s: float) -> LambOseen:
        """The flow's map from time 0 to time s: the angle s θ(r)."""
        return dataclasses.replace(self, angle=number("s", s) * self.angle)


def _mean_decay(q: Array) -> Any:
    """(1 − exp(−q))/q, 1 at 0."""
    safe = np.where(q > 0, q, 1.0)
    return np.where(q > 0, -np.expm1(-safe) / safe, 1.0)


def _mean_decay_slope(q: Array) -> Any:
    """Derivative of (1 − exp(−q))/q, −1/2 at 0."""
    small = q < 3e-2
    safe = np.where(small, 1.0, q)
    exact = (np.exp(-safe) * (safe + 1) - 1) / safe**2
    series = -1 / 2 + q * (1 / 3 - q * (1 / 8 - q * (1 / 30 - q * (1 / 144 - q / 840))))
    return np.where(small, series, exact)


@dataclasses.dataclass(frozen=True)
class BoundaryLayer(Motion):
    """Layer of fluid dragged along a wall (Stokes' first problem): u = speed · erf(distance / thickness).

    The wall is the row `wall`; the fluid lies above it on the screen, at smaller y, and is at rest at the
    wall; `wall` and everything below do not move. Displacement and map of the steady flow agree, since u
    depends on y alone.

    Parameters
    ----------
    speed : float
        Displacement far from the wall, px, to the right.
    thickness : float
        Length scale of the layer, px, at least 0.1; at 1.82 thicknesses the flow has 99 % of its speed.
    wall : float
        Row of the wall, px.

    Raises
    ------
    InputError
        If a value is outside its range.

    Notes
    -----
    At the wall u_y jumps from its largest value, −2 speed/(√π thickness), to 0; there the gradient is the
    fluid's.

    Examples
    --------
    >>> motion = BoundaryLayer(speed=4.0, thickness=10.0, wall=60.0)
    >>> motion.six(0.0, 50.0).round(4).tolist()
    [3.3708, 0.0, 0.0, 0.166, 0.0, -0.166]
    """

    speed: float
    thickness: float
    wall: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "speed", number("speed", self.speed, unit="px"))
        object.__setattr__(self, "thickness", length("thickness", self.thickness))
        object.__setattr__(self, "wall", number("wall", self.wall, unit="px"))

    def mask(self, x: ArrayLike, y: ArrayLike) -> NDArray[np.bool_]:
        """True where there is fluid: at and above the wall."""
        x, y = points(x, y)
        return y <= self.wall

    def _displacement(self, x: Array, y: Array) -> tuple[Any, Any]:
        from scipy.special import erf

        return self.speed * erf(np.maximum(self.wall - y, 0.0) / self.thickness), 0.0

    def _gradient(self, x: Array, y: Array) -> tuple[Any, Any, Any, Any]:
        eta = np.maximum(self.wall - y, 0.0) / self.thickness
        slope = 2 * self.speed / (math.sqrt(math.pi) * self.thickness) * np.exp(-(eta**2))
        return 0.0, np.where(y <= self.wall, -slope, 0.0), 0.0, 0.0

    def _inverse(self, x: Array, y: Array) -> tuple[Array, Array]:
        return x - self._displacement(x, y)[0], y

    def at(self, s: float) -> BoundaryLayer:
        """The flow's map from time 0 to time s: s times the displacement."""
        return dataclasses.replace(self, speed=number("s", s) * self.speed)
