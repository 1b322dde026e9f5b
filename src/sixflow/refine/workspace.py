"""Workspace: arrays that passes write into, kept from pass to pass and from pair to pair."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray


class Workspace:
    """Arrays that passes write into, kept from pass to pass and from pair to pair."""

    def __init__(self) -> None:
        self._arrays: dict[str, NDArray[Any]] = {}

    def array(self, name: str, shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
        """Return an uninitialised array, the same one as the last time if it fits."""
        size = math.prod(shape)
        stored = self._arrays.get(name)
        if stored is None or stored.size < size or stored.dtype != dtype:
            stored = self._arrays[name] = np.empty(size, dtype)
        return stored[:size].reshape(shape)

    @property
    def nbytes(self) -> int:
        """Bytes held."""
        return sum(a.nbytes for a in self._arrays.values())
