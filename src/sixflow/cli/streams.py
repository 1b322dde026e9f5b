"""Standard streams: the program runs where there are none, as in a service, and ends quietly when a reader has gone."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator
from typing import Any, TextIO

_NAMES = ("stdout", "stderr")


@contextlib.contextmanager
def usable_streams() -> Iterator[None]:
    """Let stdout and stderr take any text, whatever they are; what was replaced is put back in the end.

    A stream that is missing or closed is replaced by one that drops what it gets. A terminal or file that lacks a
    character shows '?' in its place.
    """
    _open_descriptors()
    before = {name: getattr(sys, name) for name in _NAMES}
    with contextlib.ExitStack() as opened:
        for name, stream in before.items():
            if stream is None or getattr(stream, "closed", False):
                setattr(sys, name, opened.enter_context(open(os.devnull, "w", encoding="utf-8")))
            elif hasattr(stream, "reconfigure"):
                with contextlib.suppress(OSError, ValueError):
                    stream.reconfigure(errors="replace")
        try:
            yield
        finally:
            for name, stream in before.items():
                setattr(sys, name, stream)


def _open_descriptors() -> None:
    """Open those of the descriptors 0 to 2 that are closed, to nothing: else a field file could get such a number, and
    with it what a library writes to "stderr".
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest that is free


def flushed(stream: TextIO) -> OSError | None:
    """Hand on what a stream holds back; return the error if it cannot be written, after which it takes anything."""
    try:
        stream.flush()
    except OSError as error:
        hush(stream)
        return error
    except ValueError:  # closed in the meantime
        pass
    return None


def hush(stream: Any) -> None:
    """Let a stream whose reader has gone drop what it still holds, so that the interpreter can end."""
    with contextlib.suppress(AttributeError, OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)
