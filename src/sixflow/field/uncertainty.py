"""The uncertainty of the six: noise, and what the window leaves out.

The error of a point is that of the frames' noise, of the covariance C (`covariance`), and that of a motion which is
finer than the point's window resolves. Of the second, the expected square is known for each of the six, b (`bias`), and
neither its sign nor how the six hang together. Both are independent, so that an error has the second moments

    C + diag(b).

Everything that follows from the six is given the errors that follow from this sum. Where b is NaN it was not estimated
(nor is there any in files of version 0.1), and errors are those of the noise alone.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from sixflow.field.dataset import SIX
from sixflow.field.selection import require_variable

Array = NDArray[Any]


def known_bias(field: xr.Dataset) -> xr.DataArray | None:
    """The expected squares of what the windows leave out, 0 where that was not estimated; None if it never was."""
    if "bias" not in field:
        return None
    bias = field["bias"].transpose(..., "param")
    return bias.copy(data=np.nan_to_num(bias.values, nan=0.0, posinf=np.inf))


def total_covariance(field: xr.Dataset, *, noise_only: bool = False) -> xr.DataArray:
    """Second moments of the errors of the six, C + diag(b), dims (..., param, param2).

    Raises InputError if the field has no covariance.

    Parameters
    ----------
    field : Dataset
    noise_only : bool
        C alone.
    """
    covariance = require_variable(field, "covariance").transpose(..., "param", "param2")
    bias = None if noise_only else known_bias(field)
    if bias is None:
        return covariance
    total = covariance.copy(data=covariance.values.copy())
    k = np.arange(len(SIX))
    total.values[..., k, k] += bias.transpose(*covariance.dims[:-1]).values
    return total
