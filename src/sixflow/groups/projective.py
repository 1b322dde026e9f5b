"""Projective maps (homographies), SL(3), in closed form.

A matrix M and its multiples are one map, (x, y) → ((Mp)₁, (Mp)₂)/(Mp)₃ with p = (x, y, 1). Results have det M = 1,
which every map has exactly once; arguments may have any factor. The algebra sl(3) has trace 0. The group is connected:
reflections belong to it.

*Exponential and logarithm.* A real 3×3 matrix has a real left eigenvector wᵀ: every homography keeps a line,
w·(x, y, 1) = 0, and so does every motion of the plane. In coordinates that have this line at infinity the map is
affine, and there `sixflow.convention` has the closed forms. With an orthogonal, symmetric H, H e₃ = ±w/|w|
(Householder's reflection),

    H X H = [[G, d], [0, 0]] + μ I        exp X = e^μ H exp([[G, d], [0, 0]]) H
    H M H = λ [[F, d], [0, 1]]            log M = H log([[F, d], [0, 1]]) H,   less a third of the trace

where μ and λ are the largest real eigenvalue (of an affine map, that of the line at infinity); λ > 0 exists because
det M = 1. Nothing is divided by differences of eigenvalues, so that equal ones do no harm. M enters as M − I, so that
small motions keep their digits.

*Units.* The eigenvector is found after a change of the unit of length that makes the entries X₁₃, X₂₃ (px) and X₃₁, X₃₂
(px⁻¹) of equal size: a rotation of the matrix as a whole mixes them.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike

from sixflow import convention
from sixflow.array_checks import Array, Invalid, silent
from sixflow.groups.affine import ROUNDING, log_six, no_logarithm
from sixflow.groups.generators import TRACELESS, eight_coefficients
from sixflow.groups.group import Group

_EPS = np.finfo(np.float64).eps
_IDENTITY = Group.identity


class ProjectiveGroup(Group):
    """The group of homographies.

    Examples
    --------
    >>> PROJECTIVE.dimension, PROJECTIVE.names[6:]
    (8, ('fanning_x', 'fanning_y'))
    """

    def __init__(self) -> None:
        super().__init__("projective", tuple(range(8)), TRACELESS)

    @silent
    def exp(self, coefficients: ArrayLike) -> Array:  # noqa: D102
        X, unit = _balanced(self.algebra(coefficients))
        X, finite = _filled(X, 0 * _IDENTITY)
        H = _to_infinity(X)
        local = _conjugated(H, X)
        mu = local[..., 2, 2]
        rates = convention.six_from_gradient(local[..., :2, 2], _less(local, mu))
        affine = convention.affine_from_six(convention.exp_six(rates))
        M = np.exp(mu)[..., None, None] * _conjugated(H, affine) * unit
        return np.where(finite, M, np.nan)

    @silent
    def log(self, matrix: ArrayLike, *, invalid: Invalid = "raise") -> Array:  # noqa: D102
        M, unit = _balanced(self.elements("matrix", matrix, invalid))
        M, finite = _filled(M, _IDENTITY)
        M = M / _power_of_two(_root_of_determinant(M))[..., None, None]
        H = _to_infinity(M - _IDENTITY, above=-1)
        local = _conjugated(H, M - _IDENTITY)
        mu = local[..., 2, 2]
        F = convention.six_from_gradient(local[..., :2, 2], _less(local, mu)) / (1 + mu)[..., None]
        rounding = ROUNDING * np.abs(M).max(axis=(-1, -2)) / np.abs(1 + mu)
        X = _conjugated(H, convention.algebra_from_six(log_six(F, rounding))) * unit
        without = ~np.isfinite(X).all(axis=(-1, -2)) & finite[..., 0, 0]
        if without.any() and invalid == "raise":
            first = tuple(int(k) for k in np.argwhere(without)[0])
            values = np.linalg.eigvals(M[first] / _root_of_determinant(M[first]))
            raise no_logarithm(first, values, "it, divided by the cube root of its determinant,")
        return np.where(finite[..., 0] & ~without[..., None], eight_coefficients(X), np.nan) + 0.0

    def _inverse(self, matrix: Array) -> Array:
        M, unit = _balanced(matrix)
        M, finite = _filled(M, _IDENTITY)
        return np.where(finite, np.linalg.inv(M) * unit, np.nan)

    def _normalised(self, matrix: Array) -> Array:
        M, unit = _balanced(matrix)
        return M / _root_of_determinant(M)[..., None, None] * unit

    def _defects(self, matrix: Array, tolerance: float) -> Iterator[tuple[Array, str]]:
        M, _ = _balanced(matrix)
        M, finite = _filled(M, _IDENTITY)
        sizes = np.linalg.svd(M, compute_uv=False)
        singular = ~finite[..., 0, 0] | (sizes[..., 2] <= 4 * _EPS * sizes[..., 0])
        yield singular, "whose matrices are not singular"


PROJECTIVE = ProjectiveGroup()


def _balanced(X: Array) -> tuple[Array, Array]:
    """Return X in another unit of length, and what its entries must be multiplied by to undo it: powers of two."""
    px, per_px = np.abs(X[..., :2, 2]).max(axis=-1), np.abs(X[..., 2, :2]).max(axis=-1)
    ratio = np.where((px > 0) & (per_px > 0), px / per_px, 1)
    length = _power_of_two(np.sqrt(ratio))
    unit = np.ones(X.shape)
    unit[..., :2, 2], unit[..., 2, :2] = length[..., None], 1 / length[..., None]
    return X / unit, unit


def _power_of_two(value: Array) -> Array:
    """Nearest power of two to a value other than 0, of the same sign."""
    return np.sign(value) * np.exp2(np.round(np.log2(np.abs(value))))


def _root_of_determinant(M: Array) -> Array:
    """Return cbrt(det M); NaN for NaN."""
    size = _power_of_two(np.abs(M).max(axis=(-1, -2)))
    return size * np.cbrt(np.linalg.det(M / size[..., None, None]))


def _filled(X: Array, filling: Array) -> tuple[Array, Array]:
    """Return X with another matrix in place of those that are not finite, and where it is finite, (..., 1, 1)."""
    finite = np.asarray(np.isfinite(X).all(axis=(-1, -2), keepdims=True))
    return np.where(finite, X, filling), finite


def _to_infinity(X: Array, above: float = -np.inf) -> Array:
    """Householder's reflection H, H e₃ = w: the left eigenvector of the largest real eigenvalue.

    Or e₃ where that is one too, and its eigenvalue above the given value: affine maps stay as they are.
    """
    values, vectors = np.linalg.eig(np.swapaxes(X, -1, -2))
    largest = np.where(values.imag == 0, values.real, -np.inf).argmax(axis=-1)
    w = np.take_along_axis(vectors.real, largest[..., None, None], axis=-1)[..., 0]
    affine = (X[..., 2, :2] == 0).all(axis=-1) & (X[..., 2, 2] > above)
    w = np.where(affine[..., None], _IDENTITY[2], w)
    w = w * np.where(w[..., 2:] > 0, -1, 1) / np.linalg.norm(w, axis=-1, keepdims=True)
    u = w - _IDENTITY[2]  # w₃ ≤ 0: no cancellation
    return _IDENTITY - 2 * u[..., :, None] * u[..., None, :] / (u * u).sum(axis=-1)[..., None, None]


def _conjugated(H: Array, X: Array) -> Array:
    return np.matmul(np.matmul(H, X), H)


def _less(local: Array, mu: Array) -> Array:
    """Return the upper left block less μ I."""
    return local[..., :2, :2] - mu[..., None, None] * _IDENTITY[:2, :2]
