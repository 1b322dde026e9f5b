"""Selection: which of the frames of a recording are meant.

Files may hold several channels, slices and positions; a recording may be longer than the part that is wanted. One
`Selection` says it for all kinds of file, in `open_frames` and on the command line.
"""

from __future__ import annotations

import dataclasses

from sixflow.checks import is_whole, require
from sixflow.errors import InputError


@dataclasses.dataclass(frozen=True)
class Selection:
    """Which frames are meant; None: all there are, or the only one.

    Attributes
    ----------
    channel, z, position : int, str or None
        Channel, slice, and position (scene, series, dataset) of files that hold several: the number, from 0, or
        the name that the file gives it.
    first, last : int or None
        Numbers of the first and the last frame, from 0, both included.
    every : int
        Take every so many frames.

    Raises
    ------
    InputError
        If a number is negative or no whole number, `every` is less than 1, or `last` is before `first`.

    Examples
    --------
    >>> list(range(20)[Selection(first=2, last=10, every=4).frames])
    [2, 6, 10]
    """

    channel: int | str | None = None
    z: int | str | None = None
    position: int | str | None = None
    first: int | None = None
    last: int | None = None
    every: int = 1

    def __post_init__(self) -> None:
        for name, least in (
            ("channel", 0),
            ("z", 0),
            ("position", 0),
            ("first", 0),
            ("last", 0),
            ("every", 1),
        ):
            value = getattr(self, name)
            named = name in ("channel", "z", "position") and isinstance(value, str)
            if (value is None and name != "every") or named:
                continue
            require(is_whole(value, least), name, value, f"must be a whole number, at least {least}")
        if self.first is not None and self.last is not None and self.last < self.first:
            raise InputError(f"last={self.last}: comes before first={self.first}; exchange them")

    @property
    def frames(self) -> slice:
        """The frames along time, as a slice of their numbers."""
        return slice(self.first, None if self.last is None else self.last + 1, self.every)
