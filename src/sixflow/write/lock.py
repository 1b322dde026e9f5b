"""Locks: one writer for one output.

A lock is a small file ``.<name>.lock`` beside the output, which the operating system locks for the process that has
it open, and unlocks when that ends, however it ends: a killed process leaves no lock. The file says who writes. It is
removed in the end.
"""

from __future__ import annotations

import contextlib
import os
import socket
from collections.abc import Iterator
from pathlib import Path

from sixflow.errors import FieldFileError

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]
    import msvcrt


@contextlib.contextmanager
def locked(path: Path) -> Iterator[None]:
    """Keep other writers, in this process and in others, from an output.

    Where the file system knows no locks, nothing is kept from anyone.

    Raises FieldFileError if another writer has it.

    Parameters
    ----------
    path : Path
        The output, which need not exist; its folder does.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder, locked(Path(folder) / "f.nc"), locked(Path(folder) / "f.nc"):
    ...     pass
    Traceback (most recent call last):
    sixflow.errors.FieldFileError: ...f.nc: is being written by process ... on ...; wait for it, or choose another name
    """
    place = path.with_name(f".{path.name}.lock")
    try:
        descriptor = _acquired(place, path)
    except OSError as error:
        if isinstance(error, FieldFileError):
            raise
        raise FieldFileError(
            f"{path}: cannot be locked ({error.strerror or error}); choose another folder"
        ) from error
    try:
        yield
    finally:
        _release(descriptor, place)


def _acquired(place: Path, path: Path) -> int:
    while True:
        descriptor = os.open(place, os.O_RDWR | os.O_CREAT, 0o666)
        if not _try_lock(descriptor):
            with os.fdopen(descriptor, encoding="utf-8", errors="replace") as file:
                holder = file.read(200).strip() or "another process"
            raise FieldFileError(f"{path}: is being written by {holder}; wait for it, or choose another name")
        if _is_at(descriptor, place):
            with contextlib.suppress(OSError):  # a full disk keeps nobody out
                os.ftruncate(descriptor, 0)
                os.write(descriptor, f"process {os.getpid()} on {socket.gethostname()}".encode())
            return descriptor
        os.close(descriptor)  # its last owner has removed it in the meantime


def _try_lock(descriptor: int) -> bool:
    try:
        if fcntl is not None:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        else:
            os.lseek(descriptor, 1 << 30, os.SEEK_SET)  # beyond what others read
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
            os.lseek(descriptor, 0, os.SEEK_SET)
    except (BlockingIOError, PermissionError):
        return False
    except OSError:  # there are no locks here
        return True
    return True


def _is_at(descriptor: int, place: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(descriptor), os.stat(place))
    except FileNotFoundError:
        return False


def _release(descriptor: int, place: Path) -> None:
    """Remove the file while it is locked, where open files can be removed, so that nobody's else is removed."""
    with contextlib.suppress(OSError):
        if fcntl is not None:
            place.unlink()
    os.close(descriptor)
    if fcntl is None:
        with contextlib.suppress(OSError):
            place.unlink()
