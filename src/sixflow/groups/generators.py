"""The eight generators of the plane's projective motions, from which every group of the package takes its own.

A steady motion of the plane is a velocity field a(x, y), an operator on images L = a·∇, and a 3×3 matrix X, all three
the same thing:

    a = ((X p)₁, (X p)₂) − (X p)₃ (x, y),   p = (x, y, 1)

so that X and X + λI are one motion. Eight generators span the projective ones: the six of Eagleson, eq. (3), and the
two fields of second order in Kanatani's planar flow, Eagleson's eq. (2).

| symbol | name | a = (a_x, a_y) | X |
|---|---|---|---|
| L_x | u | (1, 0) | e₁₃ |
| L_y | v | (0, 1) | e₂₃ |
| L_s | divergence | (x, y) | diag(1, 1, 0); with trace 0, diag(1, 1, −2)/3 |
| L_r | curl | (−y, x) | e₂₁ − e₁₂ |
| L_b | stretch | (x, −y) | diag(1, −1, 0) |
| L_B | shear | (y, x) | e₁₂ + e₂₁ |
| L_E | fanning_x | (x², xy) | −e₃₁ |
| L_F | fanning_y | (xy, y²) | −e₃₂ |

e_ij is the matrix whose only entry, 1, stands in row i and column j; x, y are px, y down. A motion Σ τ_k L_k has the
*coefficients* τ. The number that a generator is named after is τ for u, v and the two fannings, 2τ for the other four.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from sixflow.array_checks import Array
from sixflow.convention import GENERATOR_NAMES, GENERATORS, SIX
from sixflow.convention.affine import SIX_PER_COEFFICIENT

NAMES = (*SIX, "fanning_x", "fanning_y")
"""Names of the eight numbers: the six, and Kanatani's E and F."""

SYMBOLS = (*GENERATOR_NAMES, "L_E", "L_F")
"""Symbols of the eight generators, in the order of `NAMES`."""


def constant(value: Any) -> Array:
    """Return a read-only float64 array."""
    array = np.array(value, dtype=np.float64)
    array.flags.writeable = False
    return array


NUMBER_PER_COEFFICIENT = constant([*SIX_PER_COEFFICIENT, 1, 1])
"""The numbers of `NAMES` are (1, 1, 2, 2, 2, 2, 1, 1) times the coefficients. Read-only."""

_FANNING = [[[0, 0, 0], [0, 0, 0], [-1, 0, 0]], [[0, 0, 0], [0, 0, 0], [0, -1, 0]]]

TRACELESS = constant([*(X - np.trace(X) / 3 * np.eye(3) for X in GENERATORS), *_FANNING])
"""Matrices of the eight generators in sl(3), shape (8, 3, 3). Read-only."""

_DUAL = constant(
    [
        [[0, 0, 1], [0, 0, 0], [0, 0, 0]],
        [[0, 0, 0], [0, 0, 1], [0, 0, 0]],
        [[0.5, 0, 0], [0, 0.5, 0], [0, 0, -1]],
        [[0, -0.5, 0], [0.5, 0, 0], [0, 0, 0]],
        [[0.5, 0, 0], [0, -0.5, 0], [0, 0, 0]],
        [[0, 0.5, 0], [0.5, 0, 0], [0, 0, 0]],
        *_FANNING,
    ]
)


def eight_coefficients(matrices: Array) -> Array:
    """Coefficients of matrices X in all eight generators, shape (..., 8); a multiple of I has none."""
    return np.einsum("kij,...ij->...k", _DUAL, matrices)
