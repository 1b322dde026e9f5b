"""Figures as files: checked before anything is computed."""

from __future__ import annotations

import os
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
