"""Guarded: values that are read when they are used, with every failure reported as damage of the file."""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from xarray.backends import BackendArray
from xarray.core import indexing

from sixflow.errors import FieldFileError, SixflowError


@contextlib.contextmanager
def damage_reported(path: Path, name: str = "") -> Iterator[None]:
    """Turn whatever the libraries of a file format raise into a `FieldFileError` that names the file.

    Parameters
    ----------
    path : Path
    name : str
        Of the variable that is read; empty while the file is opened.
    """
    try:
        yield
    except SixflowError:
        raise
    except Exception as error:
        said = (str(error) or type(error).__name__)[:300]
        if name:
            text = f"{name} cannot be read ({said}); the file is damaged, or was changed or closed meanwhile"
        else:
            text = f"cannot be read as a field ({said}); it is damaged or was not written by sixflow"
        raise FieldFileError(f"{path}: {text}") from error


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Silence what the libraries say of themselves: of extensions of the Zarr v3 core, of decodings to come."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


class GuardedArray(BackendArray):
    """A variable of a file, not yet read.

    Parameters
    ----------
    path : Path
        Of the file.
    name : str
        Of the variable.
    variable : xarray.Variable
        Whose values are read when they are used.
    """

    __slots__ = ("dtype", "name", "path", "shape", "variable")

    def __init__(self, path: Path, name: str, variable: xr.Variable) -> None:
        self.path, self.name, self.variable = path, name, variable
        self.shape, self.dtype = variable.shape, variable.dtype

    def __getitem__(self, key: indexing.ExplicitIndexer) -> Any:
        return indexing.explicit_indexing_adapter(key, self.shape, indexing.IndexingSupport.OUTER, self._read)

    def _read(self, key: tuple[Any, ...]) -> NDArray[Any]:
        with damage_reported(self.path, self.name), quiet():
            values = np.asarray(self.variable[key].values)
            if values.dtype.kind != self.dtype.kind:
                raise TypeError(f"values of type {values.dtype}, announced as {self.dtype}")
            return values


def guarded(field: xr.Dataset, path: Path) -> xr.Dataset:
    """Return a dataset from a file with all its values guarded that have not been read yet."""
    variables = {
        name: (variable.dims, _lazy(GuardedArray(path, str(name), variable)), variable.attrs)
        for name, variable in field.variables.items()
        if not variable._in_memory
    }
    return field.assign_coords({n: v for n, v in variables.items() if n in field.coords}).assign(
        {n: v for n, v in variables.items() if n in field.data_vars}
    )


def _lazy(array: GuardedArray) -> Any:
    """An array that is read when it is used, once, and that can be written into without touching the file."""
    lazy: Any = indexing.LazilyIndexedArray(array)
    return indexing.MemoryCachedArray(indexing.CopyOnWriteArray(lazy))
