"""Rotations of space: vector ↔ matrix, and the matrix that carries velocities to displacements.

A rotation by the angle θ about the unit axis e, right-handed, has the rotation vector ω = θ e and the matrix

    R = exp [ω]× = I + sin θ/θ [ω]× + (1 − cos θ)/θ² [ω]×²                                   (Rodrigues)
    V = ∫₀¹ exp(s [ω]×) ds = I + (1 − cos θ)/θ² [ω]× + (θ − sin θ)/θ³ [ω]×²

With X right, Y down, Z forward, a rotation about Z by a positive angle takes X towards Y: clockwise on the
screen.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from sixflow.scenes.arguments import Array

_SMALL = 0.1  # rad: below it, the series to θ⁶ is exact to rounding


def skew(vector: Array) -> Array:
    """[ω]×, shape (..., 3, 3), of vectors (..., 3): [ω]× X = ω × X."""
    x, y, z = (vector[..., k] for k in range(3))
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*x.shape, 3, 3)


def unskew(matrix: Array) -> Array:
    """The vector ω, shape (..., 3), of the antisymmetric part [ω]× of matrices (..., 3, 3)."""
    return np.stack(
        [
            matrix[..., 2, 1] - matrix[..., 1, 2],
            matrix[..., 0, 2] - matrix[..., 2, 0],
            matrix[..., 1, 0] - matrix[..., 0, 1],
        ],
        axis=-1,
    ) / 2  # fmt: skip


def rotation_matrix(vector: Array) -> Array:
    """R = exp [ω]×, shape (3, 3), of a rotation vector, rad."""
    return np.asarray(Rotation.from_rotvec(vector).as_matrix())


def drift_matrix(vector: Array) -> Array:
    """V, shape (3, 3): a steady motion of velocity T + ω × X displaces the origin by V T in unit time."""
    second, third = _factors(vector)
    S = skew(vector)
    return np.eye(3) + second * S + third * S @ S


def rotation_vector(matrix: Array) -> Array:
    """ω with exp [ω]× = R, of an angle from 0 to π; at π either axis fits."""
    return np.asarray(Rotation.from_matrix(matrix).as_rotvec())


def _factors(vector: Array) -> tuple[float, float]:
    """The factors (1 − cos θ)/θ² and (θ − sin θ)/θ³ of V."""
    angle = float(np.linalg.norm(vector))
    square = angle * angle
    third = (
        (1 - square / 20 * (1 - square / 42 * (1 - square / 72))) / 6
        if angle < _SMALL
        else (angle - float(np.sin(angle))) / (square * angle)
    )
    return float(np.sinc(angle / 2 / np.pi)) ** 2 / 2, third
