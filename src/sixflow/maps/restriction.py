"""Restriction: the window's fit confined to a group of fewer parameters than the affine.

The map of a window has θ = (u, σu_x, σu_y, v, σv_x, σv_y). A subgroup of the affine group allows near a map θ₀ of its
own the maps θ₀ + B δ:

| group | δ | displacement gradient |
|---|---|---|
| translation | u, v | 0 |
| euclidean | u, v, angle φ | R(φ) − 1, with the direction dR/dφ at the φ of the last pass |
| similarity | u, v, divergence, curl | ½ (divergence 1 + curl J), J a quarter turn |

From the normal equations H θ = b follow those of δ, (Bᵀ H B) δ = Bᵀ (b − H θ₀), and from the noise V of b

    C = P V Pᵀ,   P = B (Bᵀ H̃ B)⁻¹ Bᵀ.

Numbers that the group does not have are those of the group's maps, by assumption: 0, with a covariance of 0. (For the
Euclidean group the divergence is 2 cos φ − 2.)

Confined maps do not fit together to a dense field: between two points that move differently there is a gradient,
whatever the group. What is warped with has the gradient of the displacements of neighbouring points
(`with_shared_gradients`).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Real = NDArray[np.float64]

ABSENT = {"translation": (2, 3, 4, 5), "euclidean": (4, 5), "similarity": (4, 5)}
"""Which of the six numbers a group does not have."""

_DISPLACEMENT = np.zeros((2, 6))
_DISPLACEMENT[0, 0] = _DISPLACEMENT[1, 3] = 1
_SIMILAR = np.zeros((2, 6))
_SIMILAR[0, [1, 5]] = 0.5  # divergence
_SIMILAR[1, [2, 4]] = -0.5, 0.5  # curl
_WORST_CONDITION = 1e8  # of a normal matrix with unit diagonal


def unknowns(maps: NDArray[Any], sigma: float) -> Real:
    """θ of maps (6, rows, columns); shape (rows, columns, 6)."""
    theta = np.moveaxis(maps[[0, 2, 3, 1, 4, 5]], 0, -1).astype(np.float64)
    theta[..., [1, 2, 4, 5]] *= sigma
    return theta


def maps_of(theta: NDArray[Any], sigma: float) -> Real:
    """Maps (6, rows, columns) of θ, shape (rows, columns, 6)."""
    maps = np.ascontiguousarray(np.moveaxis(theta[..., [0, 3, 1, 2, 4, 5]], -1, 0))
    maps[2:] /= sigma
    return maps


def allowed(group: str, maps: NDArray[Any], sigma: float) -> tuple[Real, Real]:
    """The maps of a group near what is known.

    Parameters
    ----------
    group : {"translation", "euclidean", "similarity"}
    maps : array, shape (6, rows, columns)
        u, v, u_x, u_y, v_x, v_y; they tell the Euclidean group's angle.
    sigma : float
        Of the window, px.

    Returns
    -------
    base : array, shape (rows, columns, 6)
        θ₀.
    basis : array, shape (rows, columns, 6, k)
        B.
    """
    shape = maps.shape[1:]
    base = np.zeros((*shape, 6))
    if group == "euclidean":
        angle = np.arctan2(maps[4] - maps[3], 2 + maps[2] + maps[5])
        cosine, sine = np.cos(angle), np.sin(angle)
        turn = np.zeros((*shape, 6))
        for at, value, slope in (
            (1, cosine - 1, -sine),
            (2, -sine, -cosine),
            (4, sine, cosine),
            (5, cosine - 1, -sine),
        ):
            base[..., at], turn[..., at] = sigma * value, sigma * slope
        columns = [*np.broadcast_to(_DISPLACEMENT[:, None, None, :], (2, *shape, 6)), turn]
        return base, np.stack(columns, axis=-1)
    rows = _DISPLACEMENT if group == "translation" else np.concatenate([_DISPLACEMENT, sigma * _SIMILAR])
    return base, np.broadcast_to(rows.T, (*shape, 6, len(rows)))


def confined(normal: NDArray[Any], right: NDArray[Any], base: Real, basis: Real) -> Real:
    """θ₀ + B δ; NaN where the equations are singular. Shapes (…, 6, 6), (…, 6), (…, 6), (…, 6, k)."""
    left = np.swapaxes(basis, -1, -2)
    rest = right - (normal @ base[..., None])[..., 0]
    step = inverse(left @ normal @ basis) @ (left @ rest[..., None])
    result: Real = base + (basis @ step)[..., 0]
    return result


def projection(normal: NDArray[Any], basis: Real) -> Real:
    """P = B (Bᵀ H̃ B)⁻¹ Bᵀ, shape (…, 6, 6)."""
    left = np.swapaxes(basis, -1, -2)
    result: Real = basis @ inverse(left @ normal @ basis) @ left
    return result


def with_shared_gradients(maps: NDArray[Any], step: int) -> NDArray[Any]:
    """Maps whose gradients are those of the displacements from point to point; their own, where a neighbour
    failed or there is none. Shape (6, rows, columns).
    """
    out = maps.copy()
    for component in range(2):
        for axis, place in ((1, 2 + 2 * component), (0, 3 + 2 * component)):
            if maps.shape[1 + axis] > 1:
                slope = np.gradient(maps[component], step, axis=axis)
                out[place] = np.where(np.isfinite(slope), slope, maps[place])
    return out


def inverse(normal: NDArray[Any]) -> Real:
    """Inverses of symmetric matrices, shape (…, k, k); NaN where one is not safely positive definite."""
    unit_matrix = np.eye(normal.shape[-1])
    diagonal = np.diagonal(normal, axis1=-2, axis2=-1)
    good = (diagonal > 0).all(axis=-1) & np.isfinite(normal).all(axis=(-2, -1))
    size = np.sqrt(np.where(good[..., None], diagonal, 1))
    scale = size[..., :, None] * size[..., None, :]
    unit = np.where(good[..., None, None], normal / scale, unit_matrix)
    found = np.linalg.inv(unit + 1e-12 * unit_matrix)
    condition = np.abs(found).sum(axis=-1).max(axis=-1) * np.abs(unit).sum(axis=-1).max(axis=-1)
    good &= (np.diagonal(found, axis1=-2, axis2=-1) > 0).all(axis=-1) & (condition < _WORST_CONDITION)
    result: Real = np.where(good[..., None, None], found / scale, np.nan)
    return result
