"""Staging: outputs that appear whole or not at all.

Everything is written beside its place, under a name that starts with a dot, and renamed when it is complete.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from sixflow.errors import FieldFileError


@contextlib.contextmanager
def staged(path: Path) -> Iterator[Path]:
    """Give a place to write a file or folder to; on success it replaces `path`, on an error nothing does."""
    partial = path.with_name(f".{path.stem}.partial-{os.getpid()}{path.suffix}")
    remove(partial)
    try:
        yield partial
        publish(partial, path)
    finally:
        remove(partial)


@contextlib.contextmanager
def disk_errors(path: Path) -> Iterator[None]:
    """Turn the errors of the operating system into `FieldFileError`."""
    try:
        yield
    except FieldFileError:
        raise
    except OSError as error:
        raise FieldFileError(
            f"{path}: cannot be written ({error.strerror or error}); check the room on the disk"
        ) from error


def publish(partial: Path, path: Path) -> None:
    """Rename a complete output to its final name, in place of an earlier one."""
    if partial.is_file():
        with partial.open("rb+") as file:
            os.fsync(file.fileno())
        os.replace(partial, path)
        return
    earlier = path.with_name(f".{path.name}.replaced-{os.getpid()}")
    if os.path.lexists(path):
        os.rename(path, earlier)  # a folder cannot be renamed over another one
    try:
        os.rename(partial, path)
    except OSError:
        if os.path.lexists(earlier):
            os.rename(earlier, path)
        raise
    remove(earlier)


def remove(path: Path) -> None:
    """Remove a file or a folder with all that is in it, if it exists."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


@contextlib.contextmanager
def staged_files(folder: Path, names: Sequence[str], overwrite: bool) -> Iterator[Path]:
    """Give a place to write files to; all of them appear in the folder in the end, and on an error none does.

    Raises FieldFileError if a file is in the way, or the folder cannot be made or written to.

    Parameters
    ----------
    folder : Path
        It is made if need be.
    names : sequence of str
        Of the files.
    overwrite : bool
        Whether files of these names are replaced.
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
