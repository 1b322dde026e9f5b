"""Pool: the normal equations of an array of operators, gathered under a window about every grid point.

Operators stand at positions q on a lattice, all smaller than the window. About its own position each finds normal
equations (N_q, b_q) for the affine map in A_q = (1, X, Y), X = (x − q)/ℓ. Seen from the point p, with d = (q − p)/ℓ,

    (1, X_p, Y_p) = (1, X_q, Y_q) M(d),   M(d) = 1 + d_x E₁ + d_y E₂,
    N_p = Σ_q w(q − p) M(d)ᵀ N_q M(d),    b_p = Σ_q w(q − p) M(d)ᵀ b_q.

w is a Gaussian, cut at 3.5 σ_w along each axis, and M is linear, so that each sum is one of Σ_q w d_x^a d_y^b N_q: two
small matrix products, one per axis. The responses of neighbouring operators have noise in common. Their covariance
needs the sums over pairs Σ_q w(q − p) w(q + δ − p) M(d)ᵀ V_qδ M(d) with M(d + δ) = M(δ) M(d), which are of the same
kind.

| symbol | name |
|---|---|
| q, p | `lattice`, `grid` |
| w, of standard deviation σ_w | `width` |
| ℓ | `length` |
| M(d) | `shifted` |
| V | `values` |
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.eigenfilters.geometry import Real
from sixflow.engine.array import pool_strip
from sixflow.engine.threads import over_strips
from sixflow.engine.window import CUT
from sixflow.maps.grid import Grid

_E = np.zeros((3, 6, 6))
_E[0] = np.eye(6)
for _block in (0, 3):  # unknowns are (u, ℓu_x, ℓu_y, v, ℓv_x, ℓv_y)
    _E[1, _block, _block + 1] = 1
    _E[2, _block, _block + 2] = 1


def shifted(dx: float, dy: float) -> Real:
    """M(d): the six columns of a design about a point, from those about the position that lies d = (dx, dy), in units
    of ℓ, from the point; shape (6, 6).
    """
    result: Real = _E[0] + dx * _E[1] + dy * _E[2]
    return result


@dataclasses.dataclass(frozen=True)
class Pool:
    """Sums over the positions of a lattice about the points of a grid.

    Parameters
    ----------
    lattice : Grid
        Where the operators stand.
    grid : Grid
        Where the sums are wanted.
    width : float
        σ_w, px.
    length : float
        ℓ, px.
    """

    lattice: Grid
    grid: Grid
    width: float
    length: float

    def vectors(self, values: NDArray[Any]) -> Real:
        """Σ_q w M(d)ᵀ b_q; values and result of shape (rows, columns, 6)."""
        flat = values.reshape(self.lattice.rows, -1)
        plain_x, slope_x = (self._dense(self.grid.x, self.lattice.x, power) for power in (0, 1))
        plain_y, slope_y = (self._dense(self.grid.y, self.lattice.y, power) for power in (0, 1))
        level, tilted = ((along @ flat).reshape(self.grid.rows, -1, 6) for along in (plain_y, slope_y))
        out: Real = plain_x @ level
        out[..., [1, 4]] += slope_x @ level[..., [0, 3]]
        out[..., [2, 5]] += plain_x @ tilted[..., [0, 3]]
        return out

    def scalars(self, values: NDArray[Any]) -> Real:
        """Σ_q w values; from shape (rows, columns) on the lattice to that of the grid."""
        along_x = self._dense(self.grid.x, self.lattice.x, 0)
        result: Real = self._dense(self.grid.y, self.lattice.y, 0) @ values @ along_x.T
        return result

    def matrices(self, values: NDArray[Any]) -> Real:
        """Σ_q w(q − p) M(d)ᵀ V_q M(d); values and result of shape (rows, columns, 6, 6)."""
        return self._matrices(values, None)

    def pairs(self, values: NDArray[Any], delta: tuple[int, int]) -> Real:
        """Σ_q w(q − p) w(q + δ − p) M(d)ᵀ V_q M(d).

        Parameters
        ----------
        values : array, shape (rows, columns, 6, 6)
            V_q on the lattice.
        delta : (int, int)
            δ_x, δ_y in spacings of the lattice.
        """
        return self._matrices(values, delta)

    def _matrices(self, values: NDArray[Any], delta: tuple[int, int] | None) -> Real:
        flat = np.ascontiguousarray(values.reshape(*self.lattice.shape, 36))
        along_x, first_x = self._taps(self.grid.x, self.lattice.x, None if delta is None else delta[0])
        along_y, first_y = self._taps(self.grid.y, self.lattice.y, None if delta is None else delta[1])
        out = np.empty((*self.grid.shape, 6, 6))
        over_strips(
            lambda a, b: pool_strip(flat, along_x, first_x, along_y, first_y, a, b, out), self.grid.rows, 8
        )
        return out

    def _dense(self, points: NDArray[Any], positions: NDArray[Any], power: int) -> Real:
        """W d^power as a matrix from positions to points."""
        distance = positions[None, :] - points[:, None].astype(np.float64)
        result: Real = self._weight(distance, None) * (distance / self.length) ** power
        return result

    def _taps(
        self, points: NDArray[Any], positions: NDArray[Any], delta: int | None
    ) -> tuple[Real, NDArray[np.int64]]:
        """Weights times d⁰, d¹, d² of the positions within reach of every point, and the first of them."""
        spacing, reach = self.lattice.step, CUT * self.width
        count = min(math.floor(2 * reach / spacing) + 1, len(positions))
        first = np.ceil((points - reach - positions[0]) / spacing).astype(np.int64)
        first = np.clip(first, 0, len(positions) - count)
        distance = positions[first[:, None] + np.arange(count)] - points[:, None].astype(np.float64)
        weight = self._weight(distance, delta)
        return np.stack([weight * (distance / self.length) ** power for power in range(3)]), first

    def _weight(self, distance: Real, delta: int | None) -> Real:
        """w, or w(q − p) w(q + δ − p), normalised to ∫w = 1 along the axis."""
        gaussian = np.exp(-((distance / self.width) ** 2) / 2) / (self.width * math.sqrt(2 * math.pi))
        weight: Real = np.where(np.abs(distance) <= CUT * self.width, gaussian, 0)
        if delta is not None:
            weight = weight * self._weight(distance + delta * self.lattice.step, None)
        return weight
