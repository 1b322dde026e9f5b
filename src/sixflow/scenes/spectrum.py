"""Eigenvalues and eigenvectors of the symmetric part of a plane's velocity matrix, and which of them coincide.

With S = ½ (L + Lᵀ) = Σ λ_i e_i e_iᵀ, λ₁ ≥ λ₂ ≥ λ₃, and W = (e_iᵀ ∂S e_j) for the derivative by a coefficient,

    ∂λ_i = W_ii,    ∂e_i = Σ_{j≠i} e_j W_ji/(λ_i − λ_j).

Eigenvalues never coincide exactly when there is noise. A set of combinations z of the coefficients that vanishes
where they do coincide is tested with its own covariance,

    zᵀ (∂z C ∂zᵀ + δ² I)⁻¹ z  ≤  quantile of χ² at 1 − level,

δ being the rounding error of an eigenvalue: with C = 0 the test is for equality to rounding.

| coincidence | z |
|---|---|
| λ₁ = λ₂ = λ₃ | the 5 components of S less its trace |
| λ_i = λ_j | (λ_i − λ_j, 2 e_iᵀ S e_j) = (gap, 0) |
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sixflow.scenes.arguments import Array

_ROUNDING = 64 * float(np.finfo(np.float64).eps)  # of an eigenvalue, relative to the size of L

_DEVIATORS = np.array(
    [
        [[1, 0, 0], [0, -1, 0], [0, 0, 0]],
        [[1, 0, 0], [0, 1, 0], [0, 0, -2]],
        [[0, 1, 0], [1, 0, 0], [0, 0, 0]],
        [[0, 0, 1], [0, 0, 0], [1, 0, 0]],
        [[0, 0, 0], [0, 0, 1], [0, 1, 0]],
    ]
)
_DEVIATORS = _DEVIATORS / np.sqrt((_DEVIATORS**2).sum(axis=(1, 2), keepdims=True))


class Spectrum(NamedTuple):
    """The spectrum of S with its derivatives by the k coefficients; leading dimensions (...).

    Attributes
    ----------
    L : array, shape (..., 3, 3)
    slope : array, shape (3, 3, k)
        Derivative of L, the same everywhere.
    covariance : array, shape (..., k, k)
        0 where there is none.
    values : array, shape (..., 3)
        λ₁ ≥ λ₂ ≥ λ₃.
    vectors : array, shape (..., 3, 3)
        e₁, e₂, e₃ in the last dimension.
    W : array, shape (..., 3, 3, k)
        e_iᵀ ∂S e_j.
    rounding : array, shape (...)
        δ.
    """

    L: Array
    slope: Array
    covariance: Array
    values: Array
    vectors: Array
    W: Array
    rounding: Array

    @property
    def d_values(self) -> Array:
        """∂λ_i, shape (..., 3, k)."""
        return np.moveaxis(np.diagonal(self.W, axis1=-3, axis2=-2), -1, -2)

    def d_vector(self, i: int) -> Array:
        """∂e_i, shape (..., 3, k); along eigenvectors whose eigenvalue coincides with λ_i, 0."""
        gaps = self.values[..., i, None] - self.values
        apart = np.abs(gaps) > self.rounding[..., None]
        rate = np.where(apart, 1 / np.where(apart, gaps, 1.0), 0.0)
        return np.asarray(np.einsum("...cj,...j,...jk->...ck", self.vectors, rate, self.W[..., :, i, :]))

    def spread(self, derivative: Array) -> Array:
        """Covariance (..., m, m) of numbers of this derivative (..., m, k)."""
        return np.asarray(derivative @ self.covariance @ np.swapaxes(derivative, -1, -2))

    def gap(self, i: int, j: int) -> tuple[Array, Array]:
        """Z = (λ_i − λ_j, 0), shape (..., 2), with its covariance (..., 2, 2)."""
        z = np.stack([self.values[..., i] - self.values[..., j], np.zeros_like(self.rounding)], axis=-1)
        dz = np.stack([self.W[..., i, i, :] - self.W[..., j, j, :], 2 * self.W[..., i, j, :]], axis=-2)
        return z, self.spread(dz)

    def deviator(self) -> tuple[Array, Array]:
        """The components z of S less its trace, shape (..., 5), with their covariance (..., 5, 5)."""
        z = np.einsum("zij,...ij->...z", _DEVIATORS, self.L)
        dz = np.einsum("zij,ijk->zk", _DEVIATORS, self.slope)
        return np.asarray(z), self.spread(dz)


def spectrum_of(L: Array, dL: Array, covariance: Array | None) -> Spectrum:
    """Spectrum of the symmetric part of velocity matrices (..., 3, 3), of derivative (3, 3, k)."""
    covariance = np.zeros((dL.shape[-1],) * 2) if covariance is None else covariance
    values, vectors = np.linalg.eigh((L + np.swapaxes(L, -1, -2)) / 2)
    values, vectors = values[..., ::-1], vectors[..., ::-1]
    dS = (dL + np.swapaxes(dL, 0, 1)) / 2
    W = np.einsum("...ai,abk,...bj->...ijk", vectors, dS, vectors, optimize=True)
    rounding = _ROUNDING * np.linalg.norm(L, axis=(-2, -1))
    return Spectrum(L, dL, covariance, values, vectors, W, rounding)


def vanishes(z: Array, covariance: Array, rounding: Array, level: float) -> NDArray[np.bool_]:
    """Whether numbers z (..., m) of this covariance are not distinguishable from 0 at the level."""
    from scipy.special import chdtri

    variances, axes = np.linalg.eigh(covariance)
    variances = np.maximum(variances, 0.0) + rounding[..., None] ** 2
    along = np.einsum("...ji,...j->...i", axes, z)
    safe = np.where(variances > 0, variances, 1.0)  # without motion z is 0
    square = (along**2 / safe).sum(axis=-1)
    return np.asarray(square <= chdtri(z.shape[-1], level))
