"""Rotations of space: vector ↔ matrix, and the matrix that carries velocities to displacements.

A rotation by the angle θ about the unit axis e, right-handed, has the rotation vector ω = θ e and the matrix

    R = exp [ω]× = I + sin θ/θ [ω]× + (1 − cos θ)/θ² [ω]×²                                   (Rodrigues)
    V = ∫₀¹ exp(s [ω]×) ds = I + (1 − cos θ)/θ² [ω]× + (θ − sin θ)/θ³ [ω]×²

With X right, Y down, Z forward, a rotation about Z by a positive angle takes X towards Y: clockwise on the
screen.
"""

from __future__ import annotations

import numpy as np

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
    first, second, _ = _factors(vector)
    S = skew(vector)
    return np.eye(3) + first * S + second * S @ S


def drift_matrix(vector: Array) -> Array:
    """V, shape (3, 3): a steady motion of velocity T + ω × X displaces the origin by V T in unit time."""
    _, second, third = _factors(vector)
    S = skew(vector)
    return np.eye(3) + second * S + third * S @ S


def rotation_vector(matrix: Array) -> Array:
    """ω with exp [ω]× = R, of an angle from 0 to π, by way of the quaternion; at π either axis fits."""
    R = matrix
    squares = np.array(
        [
            1 + R[0, 0] + R[1, 1] + R[2, 2],
            1 + R[0, 0] - R[1, 1] - R[2, 2],
            1 - R[0, 0] + R[1, 1] - R[2, 2],
            1 - R[0, 0] - R[1, 1] + R[2, 2],
        ]
    )  # four times the squares of the quaternion's parts
    odd = 2 * unskew(R)
    cross = np.array(
        [
            [squares[0], *odd],
            [odd[0], squares[1], R[0, 1] + R[1, 0], R[0, 2] + R[2, 0]],
            [odd[1], R[0, 1] + R[1, 0], squares[2], R[1, 2] + R[2, 1]],
            [odd[2], R[0, 2] + R[2, 0], R[1, 2] + R[2, 1], squares[3]],
        ]
    )
    largest = int(np.argmax(squares))
    quaternion = cross[largest] / (2 * np.sqrt(squares[largest]))
    quaternion = quaternion if quaternion[0] >= 0 else -quaternion
    sine = float(np.linalg.norm(quaternion[1:]))
    if sine == 0:
        return np.zeros(3)
    return np.asarray(2 * np.arctan2(sine, quaternion[0]) / sine * quaternion[1:])


def _factors(vector: Array) -> tuple[float, float, float]:
    """The factors sin θ/θ, (1 − cos θ)/θ², (θ − sin θ)/θ³."""
    angle = float(np.linalg.norm(vector))
    square = angle * angle
    third = (
        (1 - square / 20 * (1 - square / 42 * (1 - square / 72))) / 6
        if angle < _SMALL
        else (angle - float(np.sin(angle))) / (square * angle)
    )
    return float(np.sinc(angle / np.pi)), float(np.sinc(angle / 2 / np.pi)) ** 2 / 2, third
