"""Placing: maps of a motion about points of frame 0, expressed at points of the middle or of frame 1.

A point at X in frame 0 is at X + U₀(X) in frame 1. It is seen at the place x that share s of its way leads to:

    x = X + s U₀(X),   U_s(x) = U₀(X),   G_s(x) = G₀(X) (I + s G₀(X))⁻¹

| s | `reference` | relation between the frames |
|---|---|---|
| 0 | first | I₁(x + U) = I₀(x) |
| ½ | middle | I₁(x + U/2) = I₀(x − U/2) |
| 1 | second | I₁(x) = I₀(x − U) |

and backwards G₀ = G_s (I − s G_s)⁻¹. X is found by Newton steps on the dense field of the maps; an affine field
needs one.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.convention.reference import SHARE
from sixflow.engine.hermite import HermiteSurface
from sixflow.maps.grid import Grid

_STEPS = 12
_CLOSE = 1e-6  # px


def surface_of(maps: NDArray[Any], grid: Grid) -> HermiteSurface:
    """The displacement (u, v) between the points of a grid, px, from maps (6, rows, columns) there."""
    u_v, along_x, along_y = (maps[rows].astype(np.float64) for rows in ([0, 1], [2, 4], [3, 5]))
    return HermiteSurface(
        grid.x.astype(float), grid.y.astype(float), values=u_v, slopes_x=along_x, slopes_y=along_y
    )


def placed(maps: NDArray[Any], grid: Grid, share: float) -> NDArray[np.float64]:
    """Express maps about frame 0's points at the grid points of the frame that `share` of the way leads to.

    Parameters
    ----------
    maps : array, shape (6, rows, columns)
        u, v, u_x, u_y, v_x, v_y at the grid points of frame 0, without NaN.
    grid : Grid
    share : float
        Of the displacement, −1 to 1. Negative: maps about points of frame 1 (or of the middle), expressed at points of
        frame 0.

    Returns
    -------
    float64 array, shape (6, rows, columns)
        The maps as they are where the field folds.

    Examples
    --------
    >>> grid = Grid.over((64, 64), 16)
    >>> zoom = grid.plane(np.array([0, 0, 0.5, 0, 0, 0.5]))
    >>> bool(np.allclose(placed(zoom, grid, 1.0), grid.plane(np.array([0, 0, 1 / 3, 0, 0, 1 / 3]))))
    True
    """
    x, y = (place.ravel().astype(np.float64) for place in np.meshgrid(grid.x, grid.y))
    surface = surface_of(maps, grid)
    X, Y = x.copy(), y.copy()
    for _ in range(_STEPS):
        d, F = _there(surface, X, Y, share)
        step = _solved(F, np.stack([x - X - share * d[0], y - Y - share * d[1]]))
        X, Y = X + step[0], Y + step[1]
        if np.abs(step).max(initial=0.0) < _CLOSE:
            break
    d, F = _there(surface, X, Y, share)
    along, across = surface.at(X, Y, along_x=True), surface.at(X, Y, along_y=True)
    G = np.stack([_solved(np.swapaxes(F, 0, 1), np.stack([along[k], across[k]])) for k in range(2)])
    result = np.concatenate([d, G.reshape(4, -1)]).reshape(maps.shape)
    determinant = F[0, 0] * F[1, 1] - F[0, 1] * F[1, 0]
    good = np.isfinite(result).all(axis=0) & (determinant > 0).reshape(grid.shape)
    return np.where(good, result, maps)


def leaves(
    maps: NDArray[Any], grid: Grid, shape: tuple[int, int], reference: str, margin: float = 0.0
) -> NDArray[np.bool_]:
    """Points whose place in frame 0 or in frame 1 lies outside the frame, or closer than `margin` to its border;
    (rows, columns), False where NaN.
    """
    height, width = shape
    outside = np.zeros(grid.shape, np.bool_)
    for way in (1 - SHARE[reference], -SHARE[reference]):
        x, y = grid.x + way * maps[0], grid.y[:, None] + way * maps[1]
        inside = (x >= margin) & (x <= width - 1 - margin) & (y >= margin) & (y <= height - 1 - margin)
        outside |= ~inside
    return outside & np.isfinite(maps[:2]).all(axis=0)


def masked_points(
    maps: NDArray[Any], grid: Grid, valid: NDArray[np.uint8], reference: str
) -> NDArray[np.bool_]:
    """Points whose place in frame 0 lies on a pixel that does not count; their own place where the map is NaN."""
    if not valid.size:
        return np.zeros(grid.shape, np.bool_)
    share = SHARE[reference]
    places = []
    for own, d, size in ((grid.x, maps[0], valid.shape[1]), (grid.y[:, None], maps[1], valid.shape[0])):
        there = np.rint(np.clip(own - share * np.nan_to_num(d), 0, size - 1))
        places.append(np.broadcast_to(there, grid.shape).astype(np.intp))
    return valid[places[1], places[0]] == 0


def _there(
    surface: HermiteSurface, X: NDArray[Any], Y: NDArray[Any], share: float
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Displacement (2, n) and I + share·G (2, 2, n) at places."""
    F = share * np.stack([surface.at(X, Y, along_x=True), surface.at(X, Y, along_y=True)], axis=1)
    F[0, 0] += 1
    F[1, 1] += 1
    return surface.at(X, Y), F


def _solved(F: NDArray[Any], right: NDArray[Any]) -> NDArray[Any]:
    """F⁻¹ right for 2×2 matrices (2, 2, n) and vectors (2, n); 0 where F is singular."""
    determinant = F[0, 0] * F[1, 1] - F[0, 1] * F[1, 0]
    safe = np.abs(determinant) > 1e-3
    scale = np.where(safe, 1 / np.where(safe, determinant, 1), 0)
    return scale * np.stack(
        [F[1, 1] * right[0] - F[0, 1] * right[1], F[0, 0] * right[1] - F[1, 0] * right[0]]
    )
