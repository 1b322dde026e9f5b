"""Notebook: notes that are taken frame by frame, given once for the recording.

A note that holds from the first frame on is given as it is. One that comes later names its frame, the first few times;
notes that differ in numbers only count as one. What has been given once does not change while reading goes on.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

_NAMED = 3
"""Frames that are named with a note that holds for some of them only."""


class Notebook:
    """Notes on the frames of a recording.

    Examples
    --------
    >>> book = Notebook()
    >>> book.take(["colour → luminance"], 0, "p0.png")
    >>> book.take(["colour → luminance", "alpha channel dropped"], 1, "p1.png")
    >>> book.notes
    ('colour → luminance', 'p1.png: alpha channel dropped')
    """

    def __init__(self) -> None:
        self._first: int | None = None
        self._told: dict[str, None] = {}
        self._frames: dict[str, set[int]] = {}
        self._general: set[str] = set()

    def take(self, notes: Iterable[str], number: int, name: str) -> None:
        """Note what holds for a frame; frames may be read again."""
        if self._first is None:
            self._first = number
        for note in notes:
            kind = re.sub(r"\d+", "#", note)
            if kind in self._general:
                continue
            if number <= self._first:
                self._general.add(kind)
                self._told[note] = None
                continue
            frames = self._frames.setdefault(kind, set())
            if number in frames:
                continue
            if len(frames) == _NAMED:
                self._general.add(kind)
                self._told[f"further frames: {note}"] = None
            else:
                frames.add(number)
                self._told[f"{name}: {note}"] = None

    @property
    def notes(self) -> tuple[str, ...]:
        """All notes so far."""
        return tuple(self._told)
