"""Zarr v3 stores, which grow along time by whole chunks.

A store under construction has no consolidated metadata; `seal` adds it, so that readers find everything in
one file. Where a chunk is missing, readers see its fill value: NaN, or flags that fail. Every chunk has a checksum.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
import zarr
from zarr.codecs import ZstdCodec

from sixflow.write.guarded import quiet
from sixflow.write.layout import chunk_shape, fill_value

_CHUNK_BYTES = 2**24


def write(path: Path, parts: Iterator[xr.Dataset]) -> None:
    """Write the parts of a field, which follow each other in time, to a new store."""
    first = next(parts)
    count = first.sizes.get("time", 1)
    create(path, first, time_chunk=count)
    for part in parts:
        extend(path, part, count)
        count += part.sizes["time"]
    seal(path)


def create(path: Path, field: xr.Dataset, time_chunk: int) -> None:
    """Write a new store with the first pairs; chunks hold at most `time_chunk` pairs."""
    texts = {name: value.astype(object) for name, value in field.variables.items() if value.dtype.kind == "U"}
    encoding = {
        str(name): _encoding(str(name), variable, time_chunk) for name, variable in field.variables.items()
    }
    with quiet():
        field.assign(texts).to_zarr(path, mode="w", zarr_format=3, consolidated=False, encoding=encoding)


def _encoding(name: str, variable: xr.Variable, time_chunk: int) -> dict[str, Any]:
    encoding: dict[str, Any] = {"compressors": (ZstdCodec(checksum=True),)}
    if variable.dtype.kind not in "iufb" or variable.ndim == 0:
        return encoding
    chunks = chunk_shape(variable, time_chunk if variable.ndim > 1 else 1024, _CHUNK_BYTES)
    encoding |= {"chunks": chunks, "fill_value": fill_value(name, variable)}
    return encoding | ({"_FillValue": None} if variable.dtype.kind == "f" else {})


def extend(path: Path, field: xr.Dataset, count: int) -> None:
    """Write further pairs after the first `count`; what may lie beyond those is replaced."""
    group = zarr.open_group(path, mode="r+")
    for name, variable in field.variables.items():
        if "time" in variable.dims:
            array = group[str(name)]
            assert isinstance(array, zarr.Array)
            array.resize((count + variable.sizes["time"], *array.shape[1:]))
            array[count:] = np.asarray(variable.values)


def cut(path: Path, count: int) -> None:
    """Keep the first `count` pairs only."""
    group = zarr.open_group(path, mode="r+")
    for name in group.array_keys():
        array = group[name]
        assert isinstance(array, zarr.Array)
        names = getattr(array.metadata, "dimension_names", None) or ("",)
        if names[0] == "time" and array.shape[0] > count:
            array.resize((count, *array.shape[1:]))


def describe(path: Path, attrs: Mapping[str, Any], without: Iterable[str] = ()) -> None:
    """Change or add attributes of the whole field, and take some away."""
    group = zarr.open_group(path, mode="r+")
    kept = {name: value for name, value in group.attrs.items() if name not in set(without)}
    group.attrs.put(kept | dict(attrs))


def seal(path: Path) -> None:
    """Gather the metadata of all arrays in one file."""
    with quiet():
        zarr.consolidate_metadata(path)


def require_described(path: Path) -> None:
    """Raise ValueError if an array of an unfinished store has lost the file that describes it."""
    lost = sorted(one.name for one in path.iterdir() if one.is_dir() and not (one / "zarr.json").is_file())
    if lost:
        raise ValueError(f"what describes {', '.join(lost)} is missing")


def read(path: Path) -> xr.Dataset:
    """Return the field in a store, to be loaded when it is used."""
    with quiet():
        sealed = zarr.open_group(path, mode="r").metadata.consolidated_metadata is not None
        field = xr.open_zarr(path, chunks=None, consolidated=sealed)
    close = field.close
    field = field.assign(
        {name: _unicode(value) for name, value in field.variables.items() if value.dtype.kind in "TO"}
    )
    field.set_close(close)
    for variable in field.variables.values():
        if "flag_masks" in variable.attrs:  # JSON knows lists, not arrays
            variable.attrs["flag_masks"] = np.asarray(variable.attrs["flag_masks"], dtype=variable.dtype)
    return field


def _unicode(variable: xr.Variable) -> xr.Variable:
    """Return text of variable length as NumPy's ordinary type."""
    text = np.array([str(value) for value in variable.values.ravel()]).reshape(variable.shape)
    return xr.Variable(variable.dims, text, variable.attrs)
