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
from sixflow.frames.formats import Format, find_format, require_format


@dataclasses.dataclass(frozen=True)
class FoundFiles:
    """Files of one format, where they came from, and what was passed over."""

    paths: tuple[Path, ...]
    format: Format
    origin: str
    notes: tuple[str, ...] = ()


def find_files(source: Path | Sequence[Path]) -> FoundFiles:
    """Return the files of frames that `source` stands for.

    Raises
    ------
    FrameFileError
        If nothing is there, nothing readable is there, or files of different formats are mixed.
    """
    if not isinstance(source, Path):
        if not source:
            raise FrameFileError("an empty list of files: give at least one")
        return _of_one_format([_existing(path.expanduser()) for path in source], f"{len(source)} files")
    path = source.expanduser()
    if path.is_dir():
        return _in_folder(path)
    if not _exists(path) and glob.has_magic(str(path)):
        return _matching(path)
    return _of_one_format([_existing(path)], str(path))


def natural_key(path: Path) -> tuple[tuple[tuple[int, int, str], ...], str]:
    """Return a sort key that puts img2 before img10, without regard to case.

    Examples
    --------
    >>> [p.name for p in sorted([Path("img10.png"), Path("img2.png"), Path("Img1.png")], key=natural_key)]
    ['Img1.png', 'img2.png', 'img10.png']
    """
    parts = re.split(r"(\d+)", str(path).lower(), flags=re.ASCII)
    return tuple((0, int(part), "") if part.isdecimal() else (1, 0, part) for part in parts), str(path)


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except OSError as error:
        raise _unreadable(path, error) from error


def _existing(path: Path) -> Path:
    """Return the path of a readable file, or say what is there instead."""
    if path.is_dir():
        raise FrameFileError(
            f"{path}: a folder in a list of files; give a folder by itself, or the files in it"
        )
    if not _exists(path):
        raise FrameFileError(f"{path}: no such file{_suggestion(path)}")
    require_readable(path)
    return path


def require_readable(path: Path) -> None:
    """Raise `FrameFileError` if a file cannot be opened or is empty."""
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
    paths = sorted((entry for entry in entries if entry.is_file() and find_format(entry)), key=natural_key)
    if not paths:
        raise FrameFileError(f"{folder}: a folder without frames; it holds {_content(entries)}")
    passed_over = sum(entry.is_file() for entry in entries) - len(paths)
    notes = (f"other files in the folder passed over: {passed_over}",) if passed_over else ()
    return _of_one_format(paths, str(folder), notes)


def _content(entries: Sequence[Path]) -> str:
    if not entries:
        return "nothing; check the path"
    folders = sorted((entry for entry in entries if entry.is_dir()), key=natural_key)
    if folders:
        names = ", ".join(repr(entry.name) for entry in folders[:3])
        return f"the folders {names}{' …' if len(folders) > 3 else ''}; give one of them"
    suffixes = ", ".join(sorted({entry.suffix or "no suffix" for entry in entries})[:5])
    return f"only files of other kinds ({suffixes}); convert them to TIFF or PNG"


def _matching(pattern: Path) -> FoundFiles:
    found = [Path(name) for name in glob.glob(str(pattern), recursive=True)]
    files = [path for path in found if path.is_file() and not path.name.startswith(".")]
    paths = sorted((path for path in files if find_format(path)), key=natural_key)
    if not paths:
        what = "what it matches are no files of frames" if found else "no file matches"
        raise FrameFileError(
            f"{pattern}: {what}; check the pattern, and put it in quotes on the command line"
        )
    notes = (f"other matches passed over: {len(files) - len(paths)}",) if len(files) > len(paths) else ()
    return _of_one_format(paths, str(pattern), notes)


def _of_one_format(paths: Sequence[Path], origin: str, notes: tuple[str, ...] = ()) -> FoundFiles:
    formats = {path: require_format(path) for path in paths}
    kinds = list(dict.fromkeys(formats.values()))
    if len(kinds) > 1:
        counts = " and ".join(f"{sum(kind == one for one in formats.values())} {kind.name}" for kind in kinds)
        example = str(paths[0].parent / f"*{paths[0].suffix}")
        raise FrameFileError(
            f"{origin}: files of different kinds, {counts}; choose one kind by a pattern such as {example!r}"
        )
    if kinds[0].is_video and len(paths) > 1:
        raise FrameFileError(
            f"{origin}: {len(paths)} videos, the first two {paths[0].name!r} and {paths[1].name!r}; "
            "give one video at a time"
        )
    return FoundFiles(tuple(paths), kinds[0], origin, notes)
