"""Masked arrays: what is masked there has no value, which is NaN here."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array: TypeAlias = NDArray[Any]


def without_mask(frame: ArrayLike) -> Array:
    """Return an array with NaN where it is masked, as `numpy.ma` means it.

    Parameters
    ----------
    frame : array_like
        Integers become float32, or float64 where they need more digits, if anything is masked; what is not a masked
        array stays as it is.

    Examples
    --------
    >>> without_mask(np.ma.masked_greater(np.array([1, 200], np.uint8), 100)).tolist()
    [1.0, nan]
    """
    if not isinstance(frame, np.ma.MaskedArray):
        return np.asarray(frame)
    values = np.asarray(frame.data)
    hidden = np.ma.getmaskarray(frame)
    if values.dtype.kind not in "biuf" or not hidden.any():
        return values
    if values.dtype == bool:
        values = values.astype(np.uint8) * np.uint8(255)
    shown = values.astype(np.result_type(np.float32, values.dtype))
    shown[hidden] = np.nan
    return shown
