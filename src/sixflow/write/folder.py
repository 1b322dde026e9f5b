"""Folders of output files that belong together: all of them appear, or none."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from sixflow.errors import FieldFileError
from sixflow.write.target import disk_errors


@contextlib.contextmanager
def staged_files(folder: Path, names: Sequence[str], overwrite: bool) -> Iterator[Path]:
    """Give a place to write files to; all of them appear in the folder in the end, and on an error none does.

    Parameters
    ----------
    folder : Path
        It is made if need be.
    names : sequence of str
        Of the files.
    overwrite : bool
        Whether files of these names are replaced.

    Raises
    ------
    FieldFileError
        If a file is in the way, or the folder cannot be made or written to.
    """
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
