"""Canonical coordinates of a pair of generators with their gradients, on the pixels of a patch.

With the fields a and b of the commuting generators L₁ and L₂, L₁η = 1, L₂η = 0, L₁ξ = 0, L₂ξ = 1 give

    ∇η = (b_y, −b_x)/D,   ∇ξ = (−a_y, a_x)/D,   D = a_x b_y − a_y b_x,   |J| = 1/|D|,

and since the measure J dx dy is invariant, ∇·(aJ) = ∇·(bJ) = 0, so that

    ∇log|J| = −(∇·a) ∇η − (∇·b) ∇ξ.
"""

from __future__ import annotations

from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from sixflow.checks import is_whole, require
from sixflow.eigenfilters.coordinates import canonical
from sixflow.eigenfilters.generators import Generator, as_generator

Real: TypeAlias = NDArray[np.float64]

LARGEST_RADIUS = 512


class Geometry(NamedTuple):
    """Canonical coordinates of a pair at points, all shape (n,).

    Attributes
    ----------
    eta, xi : arrays
        Canonical coordinates.
    grad_eta, grad_xi : arrays, shape (2, n)
        Their gradients, 1/px.
    log_jacobian : array
        log |∂(η, ξ)/∂(x, y)|.
    grad_log_jacobian : array, shape (2, n)
        Its gradient, 1/px.
    """

    eta: Real
    xi: Real
    grad_eta: Real
    grad_xi: Real
    log_jacobian: Real
    grad_log_jacobian: Real


def geometry_of(pair: tuple[str, str], x: Real, y: Real) -> tuple[Geometry, NDArray[np.bool_]]:
    """Canonical coordinates of a pair, and where they are regular; elsewhere they are those of another point."""
    first, second = as_generator(pair[0]), as_generator(pair[1])
    regular = np.abs(_determinant(first, second, x, y)) > 1e-12
    x, y = safe(x, y, regular)
    coordinates = canonical(*pair)
    (a_x, a_y), (b_x, b_y) = first.field(x, y), second.field(x, y)
    D = a_x * b_y - a_y * b_x
    grad_eta, grad_xi = np.stack([b_y / D, -b_x / D]), np.stack([-a_y / D, a_x / D])
    return Geometry(
        coordinates.eta(x, y),
        coordinates.xi(x, y),
        grad_eta,
        grad_xi,
        -np.log(np.abs(D)),
        -first.divergence * grad_eta - second.divergence * grad_xi,
    ), regular


def safe(x: Real, y: Real, regular: NDArray[np.bool_]) -> tuple[Real, Real]:
    """The points, with a point where every pair is regular in place of singular ones."""
    return np.where(regular, x, 2.0), np.where(regular, y, 1.0)


def _determinant(first: Generator, second: Generator, x: Real, y: Real) -> Real:
    (a_x, a_y), (b_x, b_y) = first.field(x, y), second.field(x, y)
    return np.asarray(a_x * b_y - a_y * b_x, np.float64)


def patch(radius: int) -> tuple[Real, Real]:
    """Offsets x and y of the pixels of a square patch, row by row, shape ((2 radius + 1)²,)."""
    offsets = np.arange(-radius, radius + 1, dtype=np.float64)
    y, x = np.meshgrid(offsets, offsets, indexing="ij")
    return x.ravel(), y.ravel()


def require_radius(radius: Any) -> int:
    """Return a radius of a patch as an int; InputError if it is no whole number from 1 to 512."""
    wanted = f"must be a whole number of px from 1 to {LARGEST_RADIUS}"
    require(is_whole(radius, 1, LARGEST_RADIUS), "radius", radius, wanted)
    return int(radius)
