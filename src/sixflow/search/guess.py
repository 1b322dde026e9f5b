"""Guess: a first guess of the motion, of any kind, as affine maps at the grid points.

| guess | what |
|---|---|
| six numbers | (u, v, divergence, curl, stretch, shear) about pixel (0, 0), as in `sixflow.convention` |
| 2 × 3 or 3 × 3 numbers | the matrix of the map (x, y, 1) → (x', y'), as of `convention.affine_from_six` |
| a field | what a measurement returned, on any regular grid of pixels; failed points from their neighbours |
| a function | (x, y) → (u, v), called with arrays of pixels; gradients from differences over one pixel |
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from sixflow.convention import SIX
from sixflow.convention.six import GRADIENT_FROM_SIX
from sixflow.errors import InputError
from sixflow.maps.grid import Grid
from sixflow.maps.neighbours import fill_failed
from sixflow.maps.six import maps_of_six
from sixflow.search.pyramid import finer
from sixflow.settings import Settings
from sixflow.settings.affine_guess import KINDS, as_numbers

Guess: TypeAlias = ArrayLike | xr.Dataset | Callable[[Any, Any], Any]


def maps_of_guess(guess: Guess, grid: Grid) -> NDArray[np.float64]:
    """Affine maps at the grid points, of a first guess.

    Parameters
    ----------
    guess : array_like, shape (6,), (2, 3) or (3, 3), xarray.Dataset or callable
    grid : Grid

    Returns
    -------
    float64 array, shape (6, rows, columns)
        u, v, u_x, u_y, v_x, v_y, without NaN.

    Raises
    ------
    InputError
        If it is none of these, of another shape, not finite, or folds the plane.

    Examples
    --------
    >>> grid = Grid.over((32, 32), 16)
    >>> maps_of_guess([[1, 0, 3], [0, 1, -2]], grid)[:2, 0, 0]
    array([ 3., -2.])
    >>> maps_of_guess(lambda x, y: (0.1 * x, 0 * y), grid)[2, 0, 0].round(6)
    np.float64(0.1)
    """
    if isinstance(guess, xr.Dataset):
        return _of_field(guess, grid)
    if callable(guess):
        return _of_function(guess, grid)
    return grid.plane(_of_numbers(guess))


def _of_numbers(guess: ArrayLike) -> NDArray[np.float64]:
    values = np.array(as_numbers(guess))
    if values.shape == (6,):
        plane: NDArray[np.float64] = GRADIENT_FROM_SIX @ values
        return plane
    return np.concatenate([values[:, 2], (values[:, :2] - np.eye(2)).ravel()])


def _of_function(function: Callable[[Any, Any], Any], grid: Grid) -> NDArray[np.float64]:
    x, y = (places.astype(np.float64) for places in np.meshgrid(grid.x, grid.y))

    def displacement(dx: float, dy: float) -> NDArray[np.float64]:
        try:
            u, v = function(x + dx, y + dy)
            result = np.stack(
                [np.broadcast_to(np.asarray(part, dtype=np.float64), x.shape) for part in (u, v)]
            )
        except (TypeError, ValueError) as error:
            raise InputError(
                f"search={function!r}: must return (u, v) of the shape of x and y, {x.shape}; it failed with: {error}"
            ) from error
        if not np.isfinite(result).all():
            raise InputError(f"search={function!r}: returns values that are not finite at pixels of the grid")
        return result

    along, across = (
        displacement(0.5, 0) - displacement(-0.5, 0),
        displacement(0, 0.5) - displacement(0, -0.5),
    )
    value = displacement(0, 0)
    return np.stack([*value, along[0], across[0], along[1], across[1]])


def _of_field(field: xr.Dataset, grid: Grid) -> NDArray[np.float64]:
    missing = [name for name in (*SIX, "x", "y") if name not in field.variables]
    if missing:
        raise InputError(
            f"search: the field has no {', '.join(missing)}; give one that a measurement returned"
        )
    if field.sizes.get("time", 1) != 1:
        raise InputError(
            f"search: the field has {field.sizes['time']} times; choose one, such as field.isel(time=0)"
        )
    if field["u"].attrs.get("units", "px") != "px" or field["y"].attrs.get("units", "px") != "px":
        raise InputError("search: the field is in physical units; give it as it was measured, in px")
    if "time" in field.dims:
        field = field.isel(time=0)
    source = _grid_of(field)
    six = np.stack([field[name].transpose("y", "x").values.astype(np.float64) for name in SIX])
    if not np.isfinite(six).all(axis=0).any():
        raise InputError("search: the field has no point with a value; give another guess")
    maps = fill_failed(maps_of_six(np.moveaxis(six, 0, -1)), source.step)
    return maps if source == grid else finer(maps, source, grid, 1.0)


def _grid_of(field: xr.Dataset) -> Grid:
    """The grid of a field."""
    places = [np.asarray(field[name].values, dtype=np.float64) for name in ("x", "y")]
    steps = np.concatenate([np.diff(line) for line in places]) if max(map(len, places)) > 1 else np.ones(1)
    whole = all((line == np.round(line)).all() for line in places)
    if not whole or not steps[0] > 0 or (steps != steps[0]).any():
        raise InputError(
            "search: the field's x and y must be whole pixels, equally spaced and rising, as measured; "
            "give a field that was not interpolated or turned"
        )
    return Grid(int(places[0][0]), int(places[1][0]), int(steps[0]), len(places[0]), len(places[1]))


def without_guess(settings: Settings, options: Mapping[str, Any]) -> tuple[Settings, Guess | None]:
    """Settings with some changed, and the first guess where `search` is one.

    Settings hold a guess in numbers as it is, and say `search="guess"` of a field or a function.

    Raises
    ------
    InputError
        If an option is no setting or out of range, or if a guess is announced and not given.
    """
    guess = options.get("search", settings.search)
    if isinstance(guess, xr.Dataset) or callable(guess):
        return settings.replace(**{**options, "search": "guess"}), guess
    changed = settings.replace(**options)
    if changed.search == "guess":
        raise InputError(
            f"search='guess': give the first guess itself, measure(..., search=guess): {KINDS}. A field that was "
            "measured with a field or a function holds it: search=field.sixflow.guess"
        )
    return changed, None if isinstance(changed.search, str) else changed.search


def is_stored_in_settings(guess: Guess | None) -> bool:
    """Whether a first guess is in numbers, or there is none."""
    return not (isinstance(guess, xr.Dataset) or callable(guess))
