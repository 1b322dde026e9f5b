"""NetCDF-4 files, by h5netcdf, that MATLAB, ParaView and all that is built on the netCDF library can read.

Where a chunk was never written, the library gives its fill value: NaN, or flags that fail. That of whole numbers is no
attribute `_FillValue`, which would have readers turn them into floating-point numbers. Every chunk has a checksum
(Fletcher32).

Names (`param`) are arrays of characters and attributes are text of fixed length, which is what those programs
expect; variable-length strings of HDF5 would stop ParaView from opening the file.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from xarray.backends import BackendArray, H5NetCDFStore
from xarray.core import indexing

from sixflow.write.guarded import quiet
from sixflow.write.layout import chunk_shape, fill_value
from sixflow.write.seal import check_seal, seal

_CHUNK_BYTES = 2**20
"""Bytes per chunk: what the HDF5 library keeps in memory at a time."""


def write(path: Path, parts: Iterator[xr.Dataset]) -> None:
    """Write the parts of a field, which follow each other in time, to a new file."""
    first = next(parts)
    first = _with_bytes(first.assign_attrs(_plain(first.attrs)))
    first.to_netcdf(
        path,
        mode="w",
        format="NETCDF4",
        engine="h5netcdf",
        encoding={str(name): _encoding(str(name), variable) for name, variable in first.variables.items()},
        unlimited_dims=["time"] if "time" in first.dims else [],
    )
    _extend(path, parts, first.sizes.get("time", 0))
    _fix_attributes(path)
    seal(path)


def _plain(attrs: dict[str, Any]) -> dict[str, Any]:
    """Return attributes without truth values, which netCDF has no type for."""
    return {
        name: np.int8(value) if isinstance(value, bool | np.bool_) else value for name, value in attrs.items()
    }


def _with_bytes(field: xr.Dataset) -> xr.Dataset:
    """Return text along time as bytes of one width, which further parts fit into: four for a character at most."""
    texts = [
        name for name, value in field.variables.items() if value.dtype.kind == "U" and "time" in value.dims
    ]
    return field.assign_coords({name: _bytes(field[name].variable) for name in texts})


def _bytes(text: xr.Variable) -> xr.Variable:
    width = 4 * max(1, text.dtype.itemsize // np.dtype("U1").itemsize)
    encoded = np.char.encode(text.values, "utf-8").astype(f"S{width}")
    return xr.Variable(text.dims, encoded, text.attrs | {"_Encoding": "utf-8"})


def _encoding(name: str, variable: xr.Variable) -> dict[str, Any]:
    if variable.dtype.kind in "UTS":
        return {"dtype": "S1"}
    encoding: dict[str, Any] = {}
    if variable.dtype.kind in "iuf" and variable.ndim:
        encoding |= {"_FillValue": fill_value(name, variable), "fletcher32": True}
        encoding["chunksizes"] = tuple(max(1, size) for size in variable.shape)
    if variable.ndim > 1 and variable.dtype.kind in "iuf":
        chunks = chunk_shape(variable, _pairs(variable), _CHUNK_BYTES)
        encoding |= {"zlib": True, "complevel": 1, "shuffle": True, "chunksizes": chunks}
    elif "time" in variable.dims and variable.dtype.kind in "iuf":
        encoding["chunksizes"] = (1024,)
    return encoding


def _pairs(variable: xr.Variable) -> int:
    return max(1, variable.sizes.get("time", 1))


def _extend(path: Path, parts: Iterator[xr.Dataset], count: int) -> None:
    import h5netcdf

    with h5netcdf.File(path, "r+") as file:
        for part in parts:
            end = count + part.sizes["time"]
            part = _with_bytes(part)
            file.resize_dimension("time", end)
            for name, variable in part.variables.items():
                if "time" in variable.dims:
                    file[name][count:end] = (
                        variable.values if variable.dtype.kind != "S" else _characters(variable)
                    )
            count = end


def _characters(text: xr.Variable) -> NDArray[np.bytes_]:
    return text.values[..., None].view("S1")


def _fix_attributes(path: Path) -> None:
    """Turn attributes of variable-length text into text of fixed length, as the netCDF library writes it; leave the
    fill value of coordinates and whole numbers to HDF5.
    """
    import h5py

    with h5py.File(path, "r+") as file:
        for item in (file, *file.values()):
            for name in list(item.attrs):
                value = item.attrs[name]
                if isinstance(value, str) and value:
                    text = value.encode()
                    item.attrs.create(name, text, dtype=h5py.string_dtype("utf-8", len(text)))
        for item in file.values():
            if "_FillValue" in item.attrs and (item.dtype.kind != "f" or item.ndim == 1):
                del item.attrs["_FillValue"]


def read(path: Path) -> xr.Dataset:
    """Return the field in a file, to be loaded when it is used."""
    check_seal(path)
    with quiet():
        store = _Store.open(str(path))
        if store.is_even():
            return xr.open_dataset(store, cache=False)
        store.close()
        return xr.open_dataset(path, engine="h5netcdf", cache=False)


class _Store(H5NetCDFStore):
    """A file whose variables all have the length of their dimensions, which is then not asked for again and again.

    h5netcdf looks at every variable along time whenever it is asked for the shape of one, since one may be shorter,
    and be filled up; this took most of the time of opening a small field.
    """

    def is_even(self) -> bool:
        """Tell whether each dimension has one length in all variables."""
        lengths: dict[str, set[int]] = {}
        for variable in self.ds.variables.values():
            for dim, length in zip(variable.dimensions, variable._h5ds.shape, strict=True):
                lengths.setdefault(dim, set()).add(length)
        return all(len(some) == 1 for some in lengths.values())

    def open_store_variable(self, name: str, var: Any) -> xr.Variable:
        """Return one variable, to be read when it is used."""
        if var.dtype == str or var.dtype.kind not in "iufS":
            return super().open_store_variable(name, var)
        array: Any = indexing.LazilyIndexedArray(_StoredArray(self, name, var))
        attrs = {key: _text(value) for key, value in var.attrs.items()}
        return xr.Variable(var.dimensions, array, attrs, {"dtype": var.dtype})


def _text(value: Any) -> Any:
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else value


class _StoredArray(BackendArray):
    """The values of a variable in an open file."""

    def __init__(self, store: _Store, name: str, var: Any) -> None:
        self._store, self._name, self.shape, self.dtype = store, name, var._h5ds.shape, var.dtype

    def __getitem__(self, key: indexing.ExplicitIndexer) -> Any:
        support = indexing.IndexingSupport.OUTER_1VECTOR
        return indexing.explicit_indexing_adapter(key, self.shape, support, self._read)

    def _read(self, key: tuple[Any, ...]) -> NDArray[Any]:
        with self._store.lock:
            return self._store.ds.variables[self._name]._h5ds[key]
