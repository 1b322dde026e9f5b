"""Log: what tifffile says of a file, as a list instead of lines on the terminal."""

from __future__ import annotations

import contextlib
import logging
import threading
from collections.abc import Iterator


class _Recorder(logging.Filter):
    """Keeps the messages of one thread from the log and remembers them."""

    def __init__(self) -> None:
        super().__init__()
        self.messages: list[str] = []
        self._thread = threading.get_ident()

    def filter(self, record: logging.LogRecord) -> bool:
        if record.thread != self._thread:
            return True
        if record.levelno >= logging.WARNING:
            self.messages.append(record.getMessage())
        return False


@contextlib.contextmanager
def captured_log() -> Iterator[list[str]]:
    """Return what tifffile logs meanwhile as a list, instead of letting it reach stderr."""
    logger, recorder = logging.getLogger("tifffile"), _Recorder()
    logger.addFilter(recorder)
    try:
        yield recorder.messages
    finally:
        logger.removeFilter(recorder)
