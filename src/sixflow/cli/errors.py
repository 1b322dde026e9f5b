"""Errors in words and as exit codes.

| code | meaning |
|---|---|
| 0 | done |
| 1 | failed: nothing could be measured, or something unforeseen |
| 2 | bad input: flags, frames, mask, settings, or an output that cannot be written |
| 3 | done, but some frames of the recording could not be used: their pairs are flagged `bad_frame` |
| 130 | stopped by Ctrl-C |
"""

from __future__ import annotations

import errno
import sys
import traceback

from cyclopts import CycloptsError

from sixflow.cli.streams import hush
from sixflow.errors import FieldFileError, FrameFileError, InputError, SixflowError

FAILED, BAD_INPUT, BAD_FRAMES, INTERRUPTED = 1, 2, 3, 130


def report(error: BaseException, debug: bool = False) -> int:
    """Write one clear line about an error to stderr, and return the exit code.

    Parameters
    ----------
    error : BaseException
        What ended the command.
    debug : bool
        Write the traceback too.
    """
    if isinstance(error, BrokenPipeError):  # the reader, such as `head`, has seen enough
        hush(sys.stdout)
        return FAILED
    if debug:
        for line in "".join(traceback.format_exception(error)).splitlines():
            _write(line)
    if isinstance(error, KeyboardInterrupt):
        say("interrupted" if _notes(error) else "interrupted; the output was not written")
    else:
        say(f"error: {_message(error)}")
    for note in _notes(error):
        say(note)
    if isinstance(error, KeyboardInterrupt):
        return INTERRUPTED
    is_bad_input = isinstance(error, CycloptsError | InputError | FrameFileError | FieldFileError)
    return BAD_INPUT if is_bad_input else FAILED


def say(text: str) -> None:
    """Write one line to stderr, under the name of the program."""
    _write(f"sixflow: {' '.join(text.split())}")


def _write(line: str) -> None:
    """Write a line to stderr; where that is closed, it is dropped."""
    try:
        print(line, file=sys.stderr, flush=True)
    except OSError:
        hush(sys.stderr)
    except ValueError:
        pass


def _message(error: BaseException) -> str:
    if isinstance(error, SixflowError):
        return str(error)
    if isinstance(error, CycloptsError):
        command = " ".join(("sixflow", *(error.command_chain or ())))
        return f"{error} See {command} --help"
    if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EIO) and error.filename is None:
        return f"the output cannot be written ({error.strerror}); check the room on the disk"
    if isinstance(error, MemoryError):
        return f"not enough memory ({error}); measure with a larger --step, or crop the frames"
    return (
        f"unexpected {type(error).__name__}: {error}; run it again with --debug, and report what that prints"
    )


def _notes(error: BaseException) -> list[str]:
    return getattr(error, "__notes__", [])
