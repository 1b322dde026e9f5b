"""Round trip: a point carried forward by the measured motion and back by the motion measured backward returns.

With U from frame 0 to frame 1 and V from frame 1 to frame 0, V blended between its grid points, both expressed where
share s of the way leads to (`placing`),

    e = U(p) + V(p + (1 − 2s) U(p))

vanishes where both follow the same thing. Both see the same noise, with opposite signs, so that e is far less than
their standard errors: a point fails where, in u or in v, |e| > 0.1 px + z √(s_U² + s_V²), z the `normal_limit` of two
questions. A point for which the backward field knows nothing is not judged.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.chance import normal_limit
from sixflow.maps.grid import Grid
from sixflow.maps.placing import surface_of

FLOOR = 0.1  # px
ERRORS = normal_limit(2)


def closure(
    maps: NDArray[Any], backward: NDArray[Any], grid: Grid, share: float = 0.0
) -> NDArray[np.float64]:
    """E at every grid point, px; shape (2, rows, columns), NaN where it is not known.

    Parameters
    ----------
    maps, backward : array, shape (6, rows, columns)
        u, v, u_x, u_y, v_x, v_y of the motion there and back; NaN at failed points.
    grid : Grid
        Of both.
    share : float
        s: 0 for motions expressed where they begin, ½ in the middle of their way.
    """
    surface = surface_of(backward, grid)
    way = 1 - 2 * share
    x, y = grid.x + way * maps[0], grid.y[:, None] + way * maps[1]
    known = np.isfinite(x) & np.isfinite(y)
    error = np.full((2, *grid.shape), np.nan)
    error[:, known] = maps[:2, known] + surface.at(x[known], y[known])
    return error


def no_return(
    maps: NDArray[Any],
    backward: NDArray[Any],
    covariance: NDArray[Any],
    covariance_back: NDArray[Any],
    grid: Grid,
    share: float = 0.0,
) -> NDArray[np.bool_]:
    """Points that do not return.

    Parameters
    ----------
    maps, backward, grid, share
        As for `closure`.
    covariance, covariance_back : array, shape (rows, columns, 6, 6)
        Of both; the latter is taken at the grid point nearest to where the point went.

    Returns
    -------
    bool array, shape (rows, columns)
    """
    error, way = closure(maps, backward, grid, share), (1 - 2 * share) / grid.step
    column = np.nan_to_num((way * maps[0] + np.arange(grid.columns)).round())
    row = np.nan_to_num((way * maps[1] + np.arange(grid.rows)[:, None]).round())
    there = (
        np.clip(row, 0, grid.rows - 1).astype(int),
        np.clip(column, 0, grid.columns - 1).astype(int),
    )
    back = covariance_back[there]
    variance = np.stack([covariance[..., k, k] + np.nan_to_num(back[..., k, k]) for k in (0, 1)])
    with np.errstate(invalid="ignore"):
        return np.asarray((np.abs(error) > FLOOR + ERRORS * np.sqrt(variance)).any(axis=0))
