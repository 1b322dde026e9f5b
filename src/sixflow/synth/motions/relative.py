"""The motion between two moved frames: back to the reference frame by the inverse, and on from there."""

from __future__ import annotations

import dataclasses
from typing import Any

from sixflow.synth.arguments import Array
from sixflow.synth.motions.base import Motion, require_motion


@dataclasses.dataclass(frozen=True)
class RelativeMotion(Motion):
    """Motion from the coordinates of one moved frame to those of another; made by `relative`.

    With X the origin of x in the reference frame: u(x) = (X − x) + u_to(X), F = F_to(X) F_from(X)⁻¹.

    Parameters
    ----------
    start, end : Motion
        Motions from the reference frame to the two frames.

    Raises
    ------
    InputError
        If one of them is no Motion.
    """

    start: Motion
    end: Motion

    def __post_init__(self) -> None:
        require_motion("start", self.start)
        require_motion("end", self.end)

    def _displacement(self, x: Array, y: Array) -> tuple[Any, Any]:
        X, Y = self.start.inverse(x, y)
        u, v = self.end._displacement(X, Y)
        return (X - x) + u, (Y - y) + v

    def _gradient(self, x: Array, y: Array) -> tuple[Any, Any, Any, Any]:
        X, Y = self.start.inverse(x, y)
        a, b, c, d = self.start._gradient(X, Y)
        p, q, r, s = self.end._gradient(X, Y)
        det = (1 + a) * (1 + d) - b * c
        # G = (F_end − F_start) F_start⁻¹
        p, q, r, s = p - a, q - b, r - c, s - d
        u_x, u_y = (p * (1 + d) - q * c) / det, (q * (1 + a) - p * b) / det
        v_x, v_y = (r * (1 + d) - s * c) / det, (s * (1 + a) - r * b) / det
        return u_x, u_y, v_x, v_y

    def _inverse(self, x: Array, y: Array) -> tuple[Array, Array]:
        return self.start.forward(*self.end.inverse(x, y))


def relative(start: Motion, end: Motion) -> Motion:
    """The exact motion from the coordinates of one moved frame to those of another.

    Parameters
    ----------
    start, end : Motion
        Motions from the reference frame to the two frames, such as `motion.at(2)` and `motion.at(3)`.

    Returns
    -------
    Motion
        end ∘ start⁻¹ − identity; its gradient by the chain rule.

    Raises
    ------
    InputError
        If an argument is no Motion; later, where points are asked for, if `start` folds the plane there.

    Examples
    --------
    >>> from sixflow.synth import Affine, relative
    >>> step = relative(Affine.zoom(1.1), Affine.zoom(1.21))
    >>> [round(float(part), 9) for part in step.displacement(10.0, 20.0)]
    [1.0, 2.0]
    """
    return RelativeMotion(start, end)
