"""Field files: one way in and one way out, whatever the format."""

from __future__ import annotations

import importlib
import os
import stat
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeAlias, cast

import numpy as np
import xarray as xr

from sixflow.checks import shown
from sixflow.errors import FieldFileError, InputError
from sixflow.field import accessor as _accessor  # noqa: F401 - registers Dataset.sixflow
from sixflow.field.dataset import SIX
from sixflow.write.guarded import damage_reported, guarded
from sixflow.write.layout import batches, checked_field, in_order, incomplete_coordinates
from sixflow.write.lock import locked
from sixflow.write.target import SUFFIXES, check_output, is_zarr, staged_output

Writer: TypeAlias = Callable[[Path, Iterator[xr.Dataset]], None]

_MODULES = {".nc": "netcdf", ".zarr": "zarrstore", ".csv": "table"}

_KINDS = dict.fromkeys(
    (*SIX, "covariance", "bias", "residual", "noise", "resolution", "flag", "x", "y"), "iuf"
)
"""Kinds of NumPy's types that the variables have."""

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
        If the output exists and `overwrite` is False, the suffix is unknown, the folder is missing, somebody
        else is writing the output, or the disk refuses.
    InputError
        If `field` is no field, or an average of fields, whose flags are none any more (`field.sixflow.mean`).

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
    with locked(target):
        save(batches(field, _PAIRS), target, overwrite)
    return target


def save(parts: Iterator[xr.Dataset], target: Path, overwrite: bool) -> None:
    """Write the parts of a field, which follow each other in time, in the format that `target` names."""
    suffix = target.suffix.lower()
    module = importlib.import_module(f"sixflow.write.{_MODULES[suffix]}")
    with staged_output(target, overwrite) as partial:
        try:
            cast(Writer, module.write)(partial, parts)
        except (TypeError, ValueError) as error:
            raise FieldFileError(
                f"{target}: the field holds something that a {suffix} file cannot: {error}; convert it"
            ) from error


def open_field(path: str | os.PathLike[str]) -> xr.Dataset:
    """Read a field back from a ``.nc`` or ``.zarr`` file.

    The values are loaded when they are used, so that a recording larger than the memory can be opened. Damage that
    is found only then raises a `FieldFileError` too. Points whose part of the file is missing are flagged
    `missing`. Use the result in a ``with`` statement, or call its ``close``, to release the file.

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
    path = _checked_input(path)
    with damage_reported(path):
        if path.is_dir():
            from sixflow.write import zarrstore

            field = zarrstore.read(path)
        else:
            from sixflow.write import netcdf

            field = netcdf.read(path)
        try:
            _check_content(field, path)
            plain = _with_text(in_order(guarded(field, path))).drop_encoding()
        except BaseException:
            field.close()
            raise
    plain.set_close(field.close)
    return plain


def _with_text(field: xr.Dataset) -> xr.Dataset:
    """Return the field with text of fixed width where the file gives objects."""
    texts = [name for name, value in field.coords.items() if value.dtype.kind == "O"]
    return field.assign_coords({name: field[name].astype(np.str_) for name in texts})


def _check_content(field: xr.Dataset, path: Path) -> None:
    if not any({"y", "x"} <= set(variable.dims) for variable in field.data_vars.values()):
        raise FieldFileError(f"{path}: holds no field: no variable has the dimensions y and x")
    for name, kinds in _KINDS.items():
        if name in field.variables and field[name].dtype.kind not in kinds:
            raise FieldFileError(
                f"{path}: {name} holds {field[name].dtype} where sixflow writes numbers; the file is damaged, "
                "or was not written by sixflow"
            )
    for coordinate in field.coords.values():  # which every use compares
        coordinate.load()
    incomplete = incomplete_coordinates(field)
    if incomplete:
        raise FieldFileError(
            f"{path}: a part of {', '.join(incomplete)} is missing, so its points have no place; "
            "the file is damaged: copy it again, or measure again"
        )


def _checked_input(path: str | os.PathLike[str]) -> Path:
    """Return the path of a file or store that is there.

    Raises FieldFileError if it is not, or is nothing to read a field from.
    """
    try:
        path = Path(path).expanduser()
        mode = path.stat().st_mode if path.exists() else None
    except TypeError as error:
        raise InputError(f"path={shown(path)}: must be the path of a field file") from error
    except (
        OSError,
        RuntimeError,
        ValueError,
    ) as error:  # no permission; no such user; no characters of a name
        raise FieldFileError(f"{shown(path)}: cannot be read ({error}); check the path") from error
    if mode is None:
        partial = path.with_name(path.name + ".partial")
        hint = (
            f"; {partial} holds an unfinished recording, continue it with --resume"
            if partial.exists()
            else ""
        )
        raise FieldFileError(f"{path}: no such file{hint or '; check the path'}")
    if not (stat.S_ISDIR(mode) or stat.S_ISREG(mode)):
        raise FieldFileError(f"{path}: neither a file nor a folder; give a {' or '.join(SUFFIXES[:2])} file")
    if path.suffix.lower() == ".csv":
        raise FieldFileError(
            f"{path}: a table has no covariances and is not read back; write the field as .nc or .zarr too"
        )
    if path.is_dir() and not is_zarr(path):
        raise FieldFileError(f"{path}: a folder, but no Zarr store; give a {' or '.join(SUFFIXES[:2])} file")
    return path
