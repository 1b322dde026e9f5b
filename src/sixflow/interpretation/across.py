"""Motion across the line of sight: its direction, and how much of it there is.

What a slant adds to divergence and curl depends on the direction φ in which the surface moves across the line of sight.
It is known from either of

- the *heading*: the direction of the camera's (or object's) translation. With d the unit vector of the scene's
  translation T in the frame of the line of sight, φ = arg(d_x + i d_y), and its size follows from the divergence,
  a = s (d_x + i d_y),  s = |T|/R = −[divergence − Re(S e^(−2iφ))]/(2 d_Z);
- the *rotation*: what it makes of the displacement is taken away, a = (u/f − ω_Y) + i (v/f + ω_X), φ = arg a.

Given both, a is the part of the second along the first.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.interpretation.estimate import distinct
from sixflow.interpretation.sight import Sight

Array = NDArray[Any]

_NEVER = 1e-9  # sine of the angle between heading and line of sight below which nothing moves across it
_SIDEWAYS = 0.01  # cosine of that angle below which the divergence does not tell how fast


@dataclasses.dataclass(frozen=True, eq=False)
class Knowledge:
    """What is known of the motion beforehand, in the frame of a line of sight.

    Attributes
    ----------
    heading : array, shape (3,), or None
        d, unit vector of the scene's translation.
    rotation : array, shape (3,), or None
        ω, rad per frame interval.
    """

    heading: Array | None
    rotation: Array | None

    @property
    def along_sight(self) -> bool:
        """The heading is the line of sight: nothing moves across it."""
        return self.heading is not None and math.hypot(*self.heading[:2]) < _NEVER

    def direction(self, sight: Sight) -> tuple[float, Array, bool]:
        """Angle φ, its derivative by the six, and whether it is determined."""
        if self.heading is not None:
            return math.atan2(self.heading[1], self.heading[0]), np.zeros(6), not self.along_sight
        a, J = self._displacement(sight)
        size = abs(a)
        if size == 0:
            return 0.0, np.zeros(6), False
        along = np.array([a.real, a.imag]) / size
        known = distinct(size, sight.error(along @ J))
        return math.atan2(a.imag, a.real), np.array([-along[1], along[0]]) @ J / size, known

    def motion(self, sight: Sight) -> tuple[complex, Array]:
        """The number a, and the derivative (2, 6) of its parts by the six; NaN where its size is not known."""
        if self.heading is None:
            return self._displacement(sight)
        d = self.heading
        across = complex(d[0], d[1])
        parts = np.array([[d[0]], [d[1]]])
        if self.rotation is not None:
            a, J = self._displacement(sight)
            square = abs(across) ** 2
            s, by_six = (a * across.conjugate()).real / square, d[:2] @ J / square
        elif abs(d[2]) < _SIDEWAYS or across == 0:
            return complex(math.nan, math.nan), np.full((2, 6), math.nan)
        else:
            turn = (across / abs(across)) ** 2
            s = -(sight.divergence - (sight.shearing / turn).real) / (2 * d[2])
            by_six = -np.array([0, 0, 1, 0, -turn.real, -turn.imag]) / (2 * d[2])
        return s * across, parts * by_six

    def _displacement(self, sight: Sight) -> tuple[complex, Array]:
        assert self.rotation is not None
        a = complex(sight.across[0] - self.rotation[1], sight.across[1] + self.rotation[0])
        return a, np.eye(2, 6)

    @property
    def statement(self) -> str:
        """What is taken for known, in words."""
        if self.heading is None:
            return "the rotation is as given"
        if self.rotation is None:
            return "the direction of the translation is as given"
        return "the direction of the translation and the rotation are as given"
