"""The files of the gallery: one per figure and one page, written whole or not at all."""

from __future__ import annotations

import io
import os
from pathlib import Path
from typing import Literal, TypeAlias, get_args

from matplotlib.figure import Figure

from sixflow.errors import InputError
from sixflow.gallery.catalogue import CATALOGUE
from sixflow.gallery.page import make_page
from sixflow.staging import staged_files

PictureFormat: TypeAlias = Literal["png", "svg", "pdf"]

PAGE = "operators.html"
"""Name of the page."""
DPI, PAGE_DPI = 300, 200
"""Of the files, and of the figures inside the page."""


def write_gallery(
    folder: str | os.PathLike[str], *, format: PictureFormat = "png", overwrite: bool = False
) -> dict[Path, str]:
    """Draw all figures of the catalogue into a folder, and a page that holds them all.

    Parameters
    ----------
    folder : path
        Where the files go; it is made if need be.
    format : {"png", "svg", "pdf"}
        Of the files of the figures, PNG at 300 dpi; the page always holds PNG, at 200 dpi.
    overwrite : bool
        Whether files of these names are replaced.

    Returns
    -------
    dict of Path to str
        What was written, with its title; the page last.

    Raises
    ------
    InputError
        If there is no such format.
    FieldFileError
        If a file is in the way, or the folder cannot be made or written to.
    """
    if format not in get_args(PictureFormat):
        raise InputError(f"format={format!r}: must be one of {', '.join(get_args(PictureFormat))}")
    folder = Path(folder).expanduser()
    titles = {f"{entry.name}.{format}": f"{entry.label}: {entry.title}" for entry in CATALOGUE}
    titles[PAGE] = "all of them on one page, with captions"
    with staged_files(folder, tuple(titles), overwrite) as place:
        pictures = []
        for entry in CATALOGUE:
            figure = entry.draw()
            figure.savefig(place / f"{entry.name}.{format}", dpi=DPI)
            figure.set_layout_engine("none")  # it is settled, and takes half of the time
            pictures.append((entry, _png(figure)))
        (place / PAGE).write_text(make_page(pictures), encoding="utf-8")
    return {folder / name: title for name, title in titles.items()}


def _png(figure: Figure) -> bytes:
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=PAGE_DPI)
    return stream.getvalue()
