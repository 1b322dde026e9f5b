"""The files of the gallery: one per figure and one page, written whole or not at all."""

from __future__ import annotations

import contextlib
import io
import os
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Literal, TypeAlias, get_args

from matplotlib.figure import Figure

from sixflow.errors import FieldFileError, InputError
from sixflow.gallery.catalogue import CATALOGUE
from sixflow.gallery.page import make_page
from sixflow.write.target import disk_errors

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
    with _staged(folder, tuple(titles), overwrite) as place:
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


@contextlib.contextmanager
def _staged(folder: Path, names: Sequence[str], overwrite: bool) -> Iterator[Path]:
    """Give a place to write files to; all of them appear in the folder in the end, and on an error none does."""
    with disk_errors(folder):
        made = _make(folder)
        try:
            _require_free(folder, names, overwrite)
            with tempfile.TemporaryDirectory(dir=folder, prefix=".partial-") as partial:
                yield Path(partial)
                for name in names:
                    os.replace(Path(partial) / name, folder / name)
        except BaseException:
            for empty in made:
                with contextlib.suppress(OSError):
                    empty.rmdir()
            raise


def _make(folder: Path) -> list[Path]:
    """Make a folder, and return those that were missing, the innermost first."""
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FieldFileError(f"{folder}: cannot be made ({error.strerror}); choose another folder") from error
    return missing


def _require_free(folder: Path, names: Sequence[str], overwrite: bool) -> None:
    if not os.access(folder, os.W_OK):
        raise FieldFileError(f"{folder}: cannot be written to; choose another folder")
    present = [name for name in names if os.path.lexists(folder / name)]
    if present and not overwrite:
        more = f" and {len(present) - 1} more" if len(present) > 1 else ""
        raise FieldFileError(
            f"{folder}: holds {present[0]}{more} already; replace them with overwrite=True (--overwrite), "
            "or choose another folder"
        )
    for name in present:
        if (folder / name).is_dir():
            raise FieldFileError(
                f"{folder / name}: is a folder, which a file cannot replace; remove it first"
            )
