"""Saving: a figure becomes a file whole or not at all."""

from __future__ import annotations

import os
from pathlib import Path

from matplotlib.figure import Figure

from sixflow.errors import FieldFileError, InputError
from sixflow.staging import staged

DPI = 300


def save_figure(figure: Figure, path: str | os.PathLike[str]) -> None:
    """Save a figure at 300 dpi, in place of an earlier file.

    Parameters
    ----------
    figure : Figure
    path : str or path
        Its suffix chooses the format: .png, .pdf, .svg, or another one that matplotlib can write.

    Raises
    ------
    InputError
        If there is no such format.
    FieldFileError
        If the file cannot be written.
    """
    path = Path(path).expanduser()
    try:
        with staged(path) as partial:
            figure.savefig(partial, dpi=DPI, format=path.suffix.lstrip(".").lower())
    except ValueError as error:
        raise InputError(f"path={str(path)!r}: {error}; end it in .png, .pdf or .svg") from error
    except OSError as error:
        raise FieldFileError(
            f"the figure cannot be saved as {str(path)!r}: {error.strerror or error}"
        ) from error
