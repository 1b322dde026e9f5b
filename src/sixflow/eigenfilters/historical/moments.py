"""Normal equations of the generators under a Gaussian window, at all points of a grid.

With p = (X, Y, 1), X = (x − x_p)/σ, Y = (y − y_p)/σ, a generator is the vector field a_k = X_k p, X_k the upper two
rows of its matrix in `sixflow.convention.GENERATORS`. From g g^T and g r at every pixel follow

    A_kl = Σ w (a_k·g)(a_l·g) = X_k X_l : Σ w g g^T ⊗ p p^T        b_k = Σ w (a_k·g) r = X_k : Σ w g r ⊗ p

which are separable sums: a matrix product over the rows, one over the columns.

| symbol | name |
|---|---|
| w | weight exp(−(X² + Y²)/2)/(2πσ²), cut at 3.5 σ |
| g g^T | `outer`: planes xx, xy, yy |
| g r | `right`: planes x, y |
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.convention import GENERATORS
from sixflow.engine.window import CUT
from sixflow.maps.grid import Grid

Array = NDArray[Any]

_POWERS = ((1, 0), (0, 1), (0, 0))  # of X and Y in p
_FIELDS = GENERATORS[:, :2]


class WindowSums:
    """Sums of planes over the windows of a grid.

    Parameters
    ----------
    shape : (int, int)
        Rows and columns of the planes.
    grid : Grid
        Where the windows stand.
    sigma : float
        Standard deviation of the weight, px.
    """

    def __init__(self, shape: tuple[int, int], grid: Grid, sigma: float) -> None:
        self._over_rows = _tables(grid.y, shape[0], sigma)
        self._over_columns = _tables(grid.x, shape[1], sigma)

    def total(self, plane: Array, power_x: int = 0, power_y: int = 0) -> Array:
        """Σ w X^i Y^j plane, shape (rows, columns) of the grid; of a plane of ones 1, less at the border."""
        return np.asarray(self._over_rows[power_y] @ plane @ self._over_columns[power_x].T)

    def normal_equations(
        self, outer: tuple[Array, Array, Array], right: tuple[Array, Array]
    ) -> tuple[Array, Array]:
        """A and b of this module, shapes (rows, columns, 6, 6) and (rows, columns, 6), lengths in units of σ."""
        xx, xy, yy = (self._second(plane) for plane in outer)
        products = np.stack([np.stack([xx, xy]), np.stack([xy, yy])])  # c, d, m, n, row, column
        A = np.einsum("kcm,ldn,cdmnyx->yxkl", _FIELDS, _FIELDS, products, optimize=True)
        firsts = np.stack([[self.total(plane, *power) for power in _POWERS] for plane in right])
        return A, np.einsum("kcm,cmyx->yxk", _FIELDS, firsts)

    def _second(self, plane: Array) -> Array:
        return np.array([[self.total(plane, i + k, j + n) for k, n in _POWERS] for i, j in _POWERS])


def in_pixels(coefficients: Array, sigma: float) -> Array:
    """Coefficients of the generators per px, from those per σ."""
    return coefficients / np.array([1.0, 1.0, sigma, sigma, sigma, sigma])


def _tables(points: NDArray[np.int64], size: int, sigma: float) -> Array:
    """Weights w X^k, k = 0, 1, 2, of every point of the grid at every pixel of an axis; shape (3, points, size)."""
    X = (np.arange(size) - points[:, None]) / sigma
    weight = np.where(np.abs(X) <= CUT, np.exp(-X * X / 2), 0.0) / (math.sqrt(2 * math.pi) * sigma)
    return np.stack([weight * X**k for k in range(3)])
