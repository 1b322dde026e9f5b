"""The six numbers of the motion at a point, and the other ways to write the same motion.

A neighbourhood of the point c moves as x' = x + d + G (x − c), with x to the right (column) and y down (row):

| symbol | name | shape | unit |
|---|---|---|---|
| d = (u, v) | displacement | (..., 2) | px |
| G = [[u_x, u_y], [v_x, v_y]] | (displacement) gradient | (..., 2, 2) | 1 |
| (u, v, u_x + v_y, v_x − u_y, u_x − v_y, u_y + v_x) | the six | (..., 6) | px, px, 1, 1, 1, 1 |
| [[I + G, d − G c], [0, 1]] | affine, in homogeneous coordinates (x, y, 1) | (..., 3, 3) | 1 and px |

so that G = ½ [[divergence + stretch, shear − curl], [shear + curl, divergence − stretch]]. `shear` is the
engineering shear u_y + v_x, twice the off-diagonal component of the tensor.

The infinitesimal motions form the Lie algebra of the affine group, which the operators of Eagleson, eq. (3),
span:

    L_x = ∂/∂x    L_s = x ∂/∂x + y ∂/∂y     L_b = x ∂/∂x − y ∂/∂y
    L_y = ∂/∂y    L_r = −y ∂/∂x + x ∂/∂y    L_B = y ∂/∂x + x ∂/∂y

(As corrected here: they span the algebra, whose exponential is the group; the print calls them the group.)
A velocity field Σ τ_k L_k has the six numbers (τ_x, τ_y, 2τ_s, 2τ_r, 2τ_b, 2τ_B). `GENERATORS` holds the
matrices X_k; their commutators have the opposite sign of the operators' (as (Ax)·∇ and (Bx)·∇ always do).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sixflow.array_checks import Array, as_floats, require_broadcast, silent
from sixflow.errors import InputError

SIX = ("u", "v", "divergence", "curl", "stretch", "shear")
"""Names of the six numbers, in the order used everywhere."""

GENERATOR_NAMES = ("L_x", "L_y", "L_s", "L_r", "L_b", "L_B")
"""Names of the generators, in the order of the six numbers that they make."""


def _constant(rows: Any) -> Array:
    array = np.array(rows, dtype=np.float64)
    array.flags.writeable = False
    return array


ORIGIN = _constant([0, 0]).astype(np.float32)
"""The point (0, 0), in single precision so that it does not widen what it is combined with."""

GENERATORS = _constant(
    [
        [[0, 0, 1], [0, 0, 0], [0, 0, 0]],
        [[0, 0, 0], [0, 0, 1], [0, 0, 0]],
        [[1, 0, 0], [0, 1, 0], [0, 0, 0]],
        [[0, -1, 0], [1, 0, 0], [0, 0, 0]],
        [[1, 0, 0], [0, -1, 0], [0, 0, 0]],
        [[0, 1, 0], [1, 0, 0], [0, 0, 0]],
    ]
)
"""Matrices of the generators, shape (6, 3, 3): L = (X (x, y, 1))·∇ (Eagleson, eq. (3)). Read-only."""

SIX_FROM_GRADIENT = _constant(
    [
        [1, 0, 0, 0, 0, 0],
        [0, 1, 0, 0, 0, 0],
        [0, 0, 1, 0, 0, 1],
        [0, 0, 0, -1, 1, 0],
        [0, 0, 1, 0, 0, -1],
        [0, 0, 0, 1, 1, 0],
    ]
)
"""Matrix, shape (6, 6), that takes (u, v, u_x, u_y, v_x, v_y) to the six. Read-only."""

GRADIENT_FROM_SIX = _constant(
    [
        [1, 0, 0, 0, 0, 0],
        [0, 1, 0, 0, 0, 0],
        [0, 0, 0.5, 0, 0.5, 0],
        [0, 0, 0, -0.5, 0, 0.5],
        [0, 0, 0, 0.5, 0, 0.5],
        [0, 0, 0.5, 0, -0.5, 0],
    ]
)
"""Matrix, shape (6, 6), that takes the six to (u, v, u_x, u_y, v_x, v_y). Read-only."""


def displacement(six: ArrayLike) -> Array:
    """Displacement (u, v) of the six.

    Parameters
    ----------
    six : array, shape (..., 6)

    Returns
    -------
    array, shape (..., 2)
        px, x to the right and y down.

    Examples
    --------
    >>> displacement([3.0, -1.0, 0.02, 0.0, 0.0, 0.01])
    array([ 3., -1.])
    """
    return as_floats("six", six, (6,))[..., :2].copy()


@silent
def gradient(six: ArrayLike) -> Array:
    """Displacement gradient G of the six (the convention).

    G = [[u_x, u_y], [v_x, v_y]] = ½ [[divergence + stretch, shear − curl], [shear + curl, divergence −
    stretch]]

    Parameters
    ----------
    six : array, shape (..., 6)

    Returns
    -------
    array, shape (..., 2, 2)
        Dimensionless: px of displacement per px.

    Examples
    --------
    >>> gradient([3.0, -1.0, 0.02, 0.0, 0.0, 0.01])
    array([[0.01 , 0.005],
           [0.005, 0.01 ]])
    """
    six = as_floats("six", six, (6,))
    divergence, curl, stretch, shear = (six[..., k] for k in range(2, 6))
    G = np.stack([divergence + stretch, shear - curl, shear + curl, divergence - stretch], axis=-1)
    return (G / 2).reshape(*six.shape[:-1], 2, 2)


@silent
def six_from_gradient(displacement: ArrayLike, gradient: ArrayLike) -> Array:
    """The six numbers of a displacement and a displacement gradient (the convention).

    Parameters
    ----------
    displacement : array, shape (..., 2)
        (u, v), px.
    gradient : array, shape (..., 2, 2)
        [[u_x, u_y], [v_x, v_y]], dimensionless. The deformation gradient is this plus the identity.

    Returns
    -------
    array, shape (..., 6)
        Leading dimensions are broadcast.

    Examples
    --------
    >>> six_from_gradient([0, 0], [[0.0, -0.25], [0.25, 0.0]])
    array([0. , 0. , 0. , 0.5, 0. , 0. ])
    """
    d = as_floats("displacement", displacement, (2,))
    G = as_floats("gradient", gradient, (2, 2))
    require_broadcast(displacement=d.shape[:-1], gradient=G.shape[:-2])
    u_x, u_y, v_x, v_y = G[..., 0, 0], G[..., 0, 1], G[..., 1, 0], G[..., 1, 1]
    parts = (d[..., 0], d[..., 1], u_x + v_y, v_x - u_y, u_x - v_y, u_y + v_x)
    return np.stack(np.broadcast_arrays(*parts), axis=-1)


@silent
def recentre(six: ArrayLike, offset: ArrayLike) -> Array:
    """The six numbers of the same affine map, about a point `offset` away: d becomes d + G offset.

    Parameters
    ----------
    six : array, shape (..., 6)
    offset : array, shape (..., 2)
        From the old point to the new one, px. Leading dimensions are broadcast.

    Returns
    -------
    array, shape (..., 6)

    Examples
    --------
    >>> recentre([1.0, 0.0, 0.0, 0.5, 0.0, 0.0], [0.0, 4.0])
    array([0. , 0. , 0. , 0.5, 0. , 0. ])
    """
    six, offset = as_floats("six", six, (6,)), as_floats("offset", offset, (2,))
    require_broadcast(six=six.shape[:-1], offset=offset.shape[:-1])
    G = gradient(six)
    return six_from_gradient(six[..., :2] + times(G, offset), G)


@silent
def transform_points(six: ArrayLike, points: ArrayLike, centre: ArrayLike = ORIGIN) -> Array:
    """Where points go: x' = x + d + G (x − centre).

    Parameters
    ----------
    six : array, shape (..., 6)
    points : array, shape (..., 2)
        (x, y), px. Leading dimensions are broadcast.
    centre : array, shape (..., 2)
        The point that the six belong to, px.

    Returns
    -------
    array, shape (..., 2)
        px.

    Examples
    --------
    >>> transform_points([1.0, 0.0, 0.02, 0.0, 0.0, 0.0], [[0.0, 0.0], [100.0, 0.0]])
    array([[  1.,   0.],
           [102.,   0.]])
    """
    six, points = as_floats("six", six, (6,)), as_floats("points", points, (2,))
    centre = as_floats("centre", centre, (2,))
    require_broadcast(six=six.shape[:-1], points=points.shape[:-1], centre=centre.shape[:-1])
    return points + six[..., :2] + times(gradient(six), points - centre)


@silent
def affine_from_six(six: ArrayLike, centre: ArrayLike = ORIGIN) -> Array:
    """Affine map in homogeneous coordinates: [[I + G, d − G centre], [0, 1]].

    Parameters
    ----------
    six : array, shape (..., 6)
    centre : array, shape (..., 2)
        The point that the six belong to, px; the origin gives coordinates relative to that point.

    Returns
    -------
    array, shape (..., 3, 3)
        Acts on columns (x, y, 1).

    Examples
    --------
    >>> affine_from_six([3.0, 0.0, 0.0, 0.5, 0.0, 0.0], centre=[10.0, 0.0])
    array([[ 1.  , -0.25,  3.  ],
           [ 0.25,  1.  , -2.5 ],
           [ 0.  ,  0.  ,  1.  ]])
    """
    six, centre = as_floats("six", six, (6,)), as_floats("centre", centre, (2,))
    affine = algebra_from_six(recentre(six, -centre))
    affine[..., range(3), range(3)] += 1
    return affine


@silent
def six_from_affine(affine: ArrayLike, centre: ArrayLike = ORIGIN) -> Array:
    """The six numbers about `centre` of an affine map in homogeneous coordinates.

    Parameters
    ----------
    affine : array, shape (..., 3, 3)
        Acts on columns (x, y, 1); its last row is (0, 0, 1).
    centre : array, shape (..., 2)
        The point that the six shall belong to, px.

    Returns
    -------
    array, shape (..., 6)

    Raises
    ------
    InputError
        If a last row is not (0, 0, 1): a projective map has no six numbers.

    Examples
    --------
    >>> six_from_affine([[1.0, -0.25, 3.0], [0.25, 1.0, -2.5], [0, 0, 1]], centre=[10.0, 0.0])
    array([3. , 0. , 0. , 0.5, 0. , 0. ])
    """
    affine, centre = as_floats("affine", affine, (3, 3)), as_floats("centre", centre, (2,))
    _require_last_row("affine", affine, (0, 0, 1))
    identity = np.eye(2, dtype=affine.dtype)
    return recentre(six_from_gradient(affine[..., :2, 2], affine[..., :2, :2] - identity), centre)


def algebra_from_six(rates: ArrayLike) -> Array:
    """Matrix Σ τ_k X_k of a velocity field with the given six numbers: [[G, d], [0, 0]] (Eagleson, eq. (3)).

    Parameters
    ----------
    rates : array, shape (..., 6)
        The six numbers of the velocity field, per frame: px, px, 1, 1, 1, 1.

    Returns
    -------
    array, shape (..., 3, 3)
        An element of the Lie algebra, whose exponential (`sixflow.convention.exp`) is an affine map.

    Examples
    --------
    >>> import numpy as np
    >>> np.array_equal(algebra_from_six([0, 0, 0, 2, 0, 0]), GENERATORS[3])
    True
    """
    rates = as_floats("rates", rates, (6,))
    algebra = np.zeros((*rates.shape[:-1], 3, 3), dtype=rates.dtype)
    algebra[..., :2, :2] = gradient(rates)
    algebra[..., :2, 2] = rates[..., :2]
    return algebra


@silent
def six_from_algebra(algebra: ArrayLike) -> Array:
    """The six numbers of the velocity field whose matrix is given: the inverse of `algebra_from_six`.

    Parameters
    ----------
    algebra : array, shape (..., 3, 3)
        Its last row is (0, 0, 0).

    Returns
    -------
    array, shape (..., 6)

    Raises
    ------
    InputError
        If a last row is not (0, 0, 0).

    Examples
    --------
    >>> six_from_algebra(GENERATORS[5])
    array([0., 0., 0., 0., 0., 2.])
    """
    algebra = as_floats("algebra", algebra, (3, 3))
    _require_last_row("algebra", algebra, (0, 0, 0))
    return six_from_gradient(algebra[..., :2, 2], algebra[..., :2, :2])


def times(matrices: Array, vectors: Array) -> Array:
    """Product of 2×2 matrices and vectors, leading dimensions broadcast."""
    return np.stack(
        [matrices[..., k, 0] * vectors[..., 0] + matrices[..., k, 1] * vectors[..., 1] for k in range(2)],
        axis=-1,
    )


def _require_last_row(name: str, matrices: Array, row: tuple[int, ...]) -> None:
    seen = matrices[..., 2, :]
    bad = np.abs(seen - np.array(row, dtype=seen.dtype)) > 8 * np.finfo(seen.dtype).eps
    if bad.any():
        first = tuple(int(k) for k in np.argwhere(bad.any(axis=-1))[0])
        raise InputError(
            f"{name} at index {first} has the last row {seen[first].tolist()}: must be {list(row)}"
        )
