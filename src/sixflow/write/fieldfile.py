"""Field files: one way in and one way out, whatever the format."""

from __future__ import annotations

import importlib
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeAlias, cast

import numpy as np
import xarray as xr

from sixflow.errors import FieldFileError
from sixflow.write.layout import batches, checked_field, in_order
from sixflow.write.target import SUFFIXES, check_output, is_zarr, staged

Writer: TypeAlias = Callable[[Path, Iterator[xr.Dataset]], None]

_MODULES = {".nc": "netcdf", ".zarr": "zarrstore", ".csv": "table"}

_PAIRS = 64
"""Pairs of frames that are held in memory at a time when a field is copied from a file."""


def write_field(field: xr.Dataset, path: str | os.PathLike[str], overwrite: bool = False) -> Path:
    """Write a field to a file, whole or not at all.

    Parameters
    ----------
    field : xarray.Dataset
        The result of a measurement, or a part of it.
    path : path
        Where to; the suffix chooses the format: ``.nc`` netCDF-4, ``.zarr`` a Zarr v3 folder, ``.csv`` a
        table with one row per point and time, which has no covariances and cannot be read back.
    overwrite : bool
        Whether an existing output is replaced. It stays intact until the new one is complete.

    Returns
    -------
    Path
        The file or folder written.

    Raises
    ------
    FieldFileError
        If the output exists and `overwrite` is False, the suffix is unknown, the folder is missing, or the
        disk refuses.
    InputError
        If `field` is no field.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> field = xr.Dataset({"u": (("y", "x"), np.zeros((2, 3)))})
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_field(field, folder + "/field.nc").name
    'field.nc'
    """
    field = checked_field(field)
    target = check_output(path, overwrite)
    save(batches(field, _PAIRS), target, overwrite)
    return target


def save(parts: Iterator[xr.Dataset], target: Path, overwrite: bool) -> None:
    """Write the parts of a field, which follow each other in time, in the format that `target` names."""
    suffix = target.suffix.lower()
    module = importlib.import_module(f"sixflow.write.{_MODULES[suffix]}")
    with staged(target, overwrite) as partial:
        try:
            cast(Writer, module.write)(partial, parts)
        except (TypeError, ValueError) as error:
            raise FieldFileError(
                f"{target}: the field holds something that a {suffix} file cannot: {error}; convert it"
            ) from error


def open_field(path: str | os.PathLike[str]) -> xr.Dataset:
    """Read a field back from a ``.nc`` or ``.zarr`` file.

    The values are loaded when they are used, so that a recording larger than the memory can be opened. Use
    the result in a ``with`` statement, or call its ``close``, to release the file.

    Parameters
    ----------
    path : path
        A file written by `write_field` or `RecordingWriter`.

    Returns
    -------
    xarray.Dataset
        Equal to what was written.

    Raises
    ------
    FieldFileError
        If the file is missing, damaged, or no field.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> field = xr.Dataset({"u": (("y", "x"), np.zeros((2, 3)))})
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with open_field(write_field(field, folder + "/field.nc")) as back:
    ...         field.equals(back)
    True
    """
    path = Path(path).expanduser()
    _check_input(path)
    try:
        if path.is_dir():
            from sixflow.write import zarrstore

            field = zarrstore.read(path)
        else:
            field = xr.open_dataset(path, engine="h5netcdf")
    except (OSError, ValueError, KeyError, RuntimeError) as error:
        raise FieldFileError(
            f"{path}: cannot be read as a field ({error}); it is damaged or was not written by sixflow"
        ) from error
    if not any({"y", "x"} <= set(variable.dims) for variable in field.data_vars.values()):
        field.close()
        raise FieldFileError(f"{path}: holds no field: no variable has the dimensions y and x")
    plain = in_order(field).drop_encoding()
    texts = [name for name, value in plain.coords.items() if value.dtype.kind == "O"]
    plain = plain.assign_coords({name: plain[name].astype(np.str_) for name in texts})
    plain.set_close(field.close)
    return plain


def _check_input(path: Path) -> None:
    if not path.exists():
        partial = path.with_name(path.name + ".partial")
        hint = (
            f"; {partial} holds an unfinished recording, continue it with --resume"
            if partial.exists()
            else ""
        )
        raise FieldFileError(f"{path}: no such file{hint or '; check the path'}")
    if path.suffix.lower() == ".csv":
        raise FieldFileError(
            f"{path}: a table has no covariances and is not read back; write the field as .nc or .zarr too"
        )
    if path.is_dir() and not is_zarr(path):
        raise FieldFileError(f"{path}: a folder, but no Zarr store; give a {' or '.join(SUFFIXES[:2])} file")
