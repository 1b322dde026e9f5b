"""Targets: where a field is written, checked before it is measured, and what may be replaced."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

from sixflow.errors import FieldFileError
from sixflow.staging import disk_errors, staged

SUFFIXES = (".nc", ".zarr", ".csv")
"""Suffixes of the formats that a field can be written in."""


def check_output(path: str | os.PathLike[str], overwrite: bool = False) -> Path:
    """Tell before a measurement whether its result can be written.

    Parameters
    ----------
    path : path
        The output; its suffix, one of ``.nc``, ``.zarr``, ``.csv``, chooses the format.
    overwrite : bool
        Whether an existing output may be replaced.

    Returns
    -------
    Path
        The path, with ``~`` expanded.

    Raises
    ------
    FieldFileError
        If the suffix is unknown, the folder is missing or cannot be written to, or something is already
        there that may not be replaced.

    Examples
    --------
    >>> check_output("field.xlsx")
    Traceback (most recent call last):
    sixflow.errors.FieldFileError: field.xlsx: the suffix '.xlsx' is unknown; choose one of .nc, .zarr, .csv
    """
    path = Path(path).expanduser()
    if path.suffix.lower() not in SUFFIXES:
        seen = f"the suffix {path.suffix!r} is unknown" if path.suffix else "a suffix is missing"
        raise FieldFileError(f"{path}: {seen}; choose one of {', '.join(SUFFIXES)}")
    _check_folder(path)
    check_replaceable(path, overwrite)
    return path


def _check_folder(path: Path) -> None:
    folder = path.parent
    if not folder.is_dir():
        state = "is a file" if folder.exists() else "does not exist"
        raise FieldFileError(f"{path}: the folder {str(folder)!r} {state}; create it, or choose another")
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise FieldFileError(
            f"{path}: the folder {str(folder)!r} cannot be written to ({error.strerror}); choose another"
        ) from error


def check_replaceable(path: Path, overwrite: bool) -> None:
    """Refuse to replace what is there, if anything is, unless it may be replaced and is of the same kind."""
    if not os.path.lexists(path):
        return
    if not overwrite:
        raise FieldFileError(
            f"{path}: exists already; replace it with overwrite=True (--overwrite), or choose another name"
        )
    if path.is_dir() and path.suffix.lower() != ".zarr":
        raise FieldFileError(
            f"{path}: is a folder, which a {path.suffix} file cannot replace; remove it first"
        )
    if path.is_dir() and not is_zarr(path) and any(path.iterdir()):
        raise FieldFileError(f"{path}: is a folder but no Zarr store, so it is not replaced; remove it first")


def is_zarr(path: Path) -> bool:
    """Tell whether a folder is a Zarr v3 store."""
    return (path / "zarr.json").is_file()


@contextlib.contextmanager
def staged_output(path: Path, overwrite: bool) -> Iterator[Path]:
    """Give a place to write to; what is there in the end becomes `path`, and on an error nothing does.

    Raises FieldFileError if `path` cannot be used (`check_output`), or writing fails.
    """
    path = check_output(path, overwrite)
    with disk_errors(path), staged(path) as partial:
        yield partial
        check_replaceable(path, overwrite)
