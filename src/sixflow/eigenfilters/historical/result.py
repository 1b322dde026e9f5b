"""What every historical operator returns."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from sixflow.convention import SIX

_UNITS = ("px", "px", "1", "1", "1", "1")
_AXES = {
    "x": {"long_name": "column, to the right", "units": "px", "axis": "X"},
    "y": {"long_name": "row, downwards", "units": "px", "axis": "Y"},
    "time": {"long_name": "time of the reference frame", "units": "frame", "axis": "T"},
}


@dataclasses.dataclass(frozen=True, eq=False)
class HistoricalField:
    """The six numbers on a grid, as an older method measures them; without covariance, which none of them states.

    Parameters
    ----------
    six : float64 array, shape (rows, columns, 6)
        u, v in px, divergence, curl, stretch, shear without unit (`sixflow.convention.SIX`); NaN where not valid.
    x : int array, shape (columns,)
        Pixel columns of the grid.
    y : int array, shape (rows,)
        Pixel rows of the grid.
    valid : bool array, shape (rows, columns)
        False where the method declares that it cannot measure.
    method : str
        Name of the method.

    Examples
    --------
    >>> from typing import Any

    import numpy as np
    >>> field = HistoricalField(
    ...     np.zeros((2, 3, 6)), np.arange(3), np.arange(2), np.ones((2, 3), dtype=bool), "none"
    ... )
    >>> dict(field.to_dataset().sizes)
    {'time': 1, 'y': 2, 'x': 3}
    """

    six: NDArray[np.float64] = dataclasses.field(repr=False)
    x: NDArray[np.int64] = dataclasses.field(repr=False)
    y: NDArray[np.int64] = dataclasses.field(repr=False)
    valid: NDArray[np.bool_] = dataclasses.field(repr=False)
    method: str

    def to_dataset(self) -> xr.Dataset:
        """Return the six as variables with dims (time, y, x), time of length 1, as `sixflow.plot` draws them.

        Returns
        -------
        Dataset
            u, v, divergence, curl, stretch, shear and `valid`; attribute `method`.
        """
        grid = ("time", "y", "x")
        variables: dict[str, Any] = {
            name: (grid, self.six[None, ..., k], {"long_name": name, "units": _UNITS[k]})
            for k, name in enumerate(SIX)
        }
        variables["valid"] = (grid, self.valid[None], {"long_name": "the method declares a measurement"})
        coordinates: dict[str, Any] = {"x": self.x, "y": self.y, "time": np.zeros(1)}
        return xr.Dataset(
            variables,
            {name: (name, values, _AXES[name]) for name, values in coordinates.items()},
            {"method": self.method},
        )
