"""Figures as files: checked before anything is computed, and written whole or not at all."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

from sixflow.errors import FieldFileError, InputError

SUFFIXES = (".png", ".pdf", ".svg")


def check_figure(path: Path, overwrite: bool) -> Path:
    """Tell beforehand whether a figure can be saved, and return its path with ``~`` expanded.

    Raises
    ------
    InputError
        If the suffix is none of `SUFFIXES`.
    FieldFileError
        If the folder is missing or cannot be written to, or the file exists and may not be replaced.
    """
    path = path.expanduser()
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"{path}: a figure ends in {', '.join(SUFFIXES[:-1])} or {SUFFIXES[-1]}")
    if not path.parent.is_dir():
        raise FieldFileError(
            f"{path}: the folder {str(path.parent)!r} does not exist; create it, or choose another"
        )
    if not os.access(path.parent, os.W_OK):
        raise FieldFileError(f"{path}: the folder {str(path.parent)!r} cannot be written to; choose another")
    if path.is_dir():
        raise FieldFileError(f"{path}: is a folder; choose another name")
    if path.exists() and not overwrite:
        raise FieldFileError(f"{path}: exists already; replace it with --overwrite, or choose another name")
    return path


@contextlib.contextmanager
def staged_figure(path: Path) -> Iterator[Path]:
    """Give a place to save a figure; it is renamed to `path` when it is complete."""
    partial = path.with_name(f".{path.stem}.partial-{os.getpid()}{path.suffix}")
    try:
        yield partial
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)
