"""Paths: the files that a path, a pattern, a folder or a list of paths stands for, in natural order."""

from __future__ import annotations

import dataclasses
import difflib
import glob
import os
import re
from collections.abc import Sequence
from pathlib import Path

from sixflow.errors import FrameFileError
from sixflow.frames.formats import Format, find_format, is_store, require_format
from sixflow.frames.naming import natural_order, read_names

_DATASET = re.compile(r"(.+\.(?:npz|zarr|h5|hdf5|hdf|he5|nxs|nc))[/\\]?:[/\\]*(.+)", re.IGNORECASE)
"""A file that holds several arrays, and the name of one."""


@dataclasses.dataclass(frozen=True)
class FoundFiles:
    """Files of one format, where they came from, and what was passed over.

    Attributes
    ----------
    paths : tuple of Path
    format : Format
    origin : str
        What was given, in words.
    notes : tuple of str
    datasets : tuple of (str or None)
        The array of each file that was named after ``:/``.
    gaps : tuple of int
        Places of files before which others may be missing, by the numbers in their names.
    """

    paths: tuple[Path, ...]
    format: Format
    origin: str
    notes: tuple[str, ...] = ()
    datasets: tuple[str | None, ...] = ()
    gaps: tuple[int, ...] = ()


def find_files(source: Path | Sequence[Path]) -> FoundFiles:
    """Return the files of frames that `source` stands for.

    Raises FrameFileError if nothing is there, nothing readable is there, or files of different formats are
    mixed.
    """
    if not isinstance(source, Path):
        if not source:
            raise FrameFileError("an empty list of files: give at least one")
        split = [split_dataset(path.expanduser()) for path in source]
        paths = [_existing(path) for path, _ in split]
        found = _of_one_format(paths, f"{len(paths)} files", given_order=True)
        return dataclasses.replace(found, datasets=tuple(dataset for _, dataset in split))
    path, dataset = split_dataset(source.expanduser())
    if path.name.lower().endswith(".companion.ome"):
        return _of_companion(_readable(_existing(path)))
    if _is_plain_folder(path):
        found = _in_folder(path)
    elif not _exists(path) and glob.has_magic(str(path)):
        found = _matching(path)
    else:
        found = _of_one_format([_readable(_existing(path))], str(source))
    return dataclasses.replace(found, datasets=(dataset,) * len(found.paths))


def _of_companion(path: Path) -> FoundFiles:
    """The files of a set whose OME-XML stands in a file of its own."""
    from sixflow.frames.tiff.ome import companion_files

    files = companion_files(path)
    if not files:
        raise FrameFileError(f"{path}: names no files; give the files with the pictures")
    return _of_one_format([_existing(file) for file in files], str(path), given_order=True)


def split_dataset(path: Path) -> tuple[Path, str | None]:
    """Return a file and the array in it that is named after ``:/``.

    Examples
    --------
    >>> file, name = split_dataset(Path("run.h5:/entry/data"))
    >>> file.name, name
    ('run.h5', 'entry/data')
    """
    found = None if path.exists() else _DATASET.fullmatch(str(path))
    return (Path(found[1]), found[2]) if found else (path, None)


def _is_plain_folder(path: Path) -> bool:
    """Tell a folder of files from one that is a store of arrays."""
    return path.is_dir() and not is_store(path)


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except OSError as error:
        raise _unreadable(path, error) from error


def _existing(path: Path) -> Path:
    """Return the path of a readable file, or say what is there instead."""
    if _is_plain_folder(path):
        raise FrameFileError(
            f"{path}: a folder in a list of files; give a folder by itself, or the files in it"
        )
    if not _exists(path):
        raise FrameFileError(f"{path}: no such file{_suggestion(path)}")
    return path


def _readable(path: Path) -> Path:
    require_readable(path)
    return path


def require_readable(path: Path) -> None:
    """Raise `FrameFileError` if a file cannot be opened or is empty."""
    if path.is_dir():
        return
    try:
        with path.open("rb") as file:
            is_empty = not file.read(1)
    except OSError as error:
        raise _unreadable(path, error) from error
    if is_empty:
        raise FrameFileError(f"{path}: the file is empty (0 bytes); copy or export it again")


def _suggestion(path: Path) -> str:
    """Return similar names in the folder of a missing file, as the rest of a sentence."""
    folder = path.parent
    if not folder.is_dir():
        return f": the folder {str(folder)!r} does not exist either; check the path"
    try:
        names = os.listdir(folder)
    except OSError:
        names = []
    similar = difflib.get_close_matches(path.name, names, n=3, cutoff=0.6)
    return f"; did you mean {' or '.join(map(repr, similar))}?" if similar else "; check the path"


def _unreadable(path: Path, error: OSError) -> FrameFileError:
    remedy = "check its permissions" if isinstance(error, PermissionError) else "check the path and the disk"
    return FrameFileError(f"{path}: cannot be opened ({error.strerror or error}); {remedy}")


def _in_folder(folder: Path) -> FoundFiles:
    try:
        entries = [entry for entry in folder.iterdir() if not entry.name.startswith(".")]
    except OSError as error:
        raise _unreadable(folder, error) from error
    paths = _wanted([entry for entry in entries if entry.is_file() and find_format(entry)])
    if not paths:
        raise FrameFileError(f"{folder}: a folder without frames; it holds {_content(entries)}")
    passed_over = sum(entry.is_file() for entry in entries) - len(paths)
    notes = (f"other files in the folder passed over: {passed_over}",) if passed_over else ()
    return _of_one_format(paths, str(folder), notes)


def _content(entries: Sequence[Path]) -> str:
    if not entries:
        return "nothing; check the path"
    folders = natural_order([entry for entry in entries if entry.is_dir()])
    if folders:
        names = ", ".join(repr(entry.name) for entry in folders[:3])
        return f"the folders {names}{' …' if len(folders) > 3 else ''}; give one of them"
    suffixes = ", ".join(sorted({entry.suffix or "no suffix" for entry in entries})[:5])
    return f"only files of other kinds ({suffixes}); convert them to TIFF or PNG"


def _wanted(paths: list[Path]) -> list[Path]:
    """Pictures and videos, where there are any: arrays beside them are masks or results."""
    pictures = [path for path in paths if not require_format(path).is_container]
    return pictures or paths


def _matching(pattern: Path) -> FoundFiles:
    found = [Path(name) for name in glob.glob(str(pattern), recursive=True)]
    files = [path for path in found if (path.is_file() or is_store(path)) and not path.name.startswith(".")]
    paths = _wanted([path for path in files if find_format(path)])
    if not paths:
        what = "what it matches are no files of frames" if found else "no file matches"
        raise FrameFileError(
            f"{pattern}: {what}; check the pattern, and put it in quotes on the command line"
        )
    notes = (f"other matches passed over: {len(files) - len(paths)}",) if len(files) > len(paths) else ()
    return _of_one_format(paths, str(pattern), notes)


def _of_one_format(
    paths: Sequence[Path], origin: str, notes: tuple[str, ...] = (), *, given_order: bool = False
) -> FoundFiles:
    formats = {path: require_format(path) for path in paths}
    kinds = list(dict.fromkeys(formats.values()))
    if len(kinds) > 1:
        counts = " and ".join(f"{sum(kind == one for one in formats.values())} {kind.name}" for kind in kinds)
        example = str(paths[0].parent / f"*{paths[0].suffix}")
        raise FrameFileError(
            f"{origin}: files of different kinds, {counts}; choose one kind by a pattern such as {example!r}"
        )
    naming = read_names(paths, given_order=given_order)
    return FoundFiles(naming.paths, kinds[0], origin, (*notes, *naming.notes), gaps=naming.gaps)
