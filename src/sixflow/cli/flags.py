"""Flags that several commands share, and how numbers are read."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, TypeAlias, get_args

from cyclopts import Parameter, Token


def number_reader(hint: Any) -> Callable[[Any, Sequence[Token]], int | float | str | None]:
    """Return what reads a number as it is written: 41 as a whole number, also where fractions are allowed; or a
    word that the hint names.

    Settings from flags are then stored as those from a file or from Python are, and a fraction where a whole
    number is wanted is refused, not rounded.

    Parameters
    ----------
    hint : type
        int or float, or one of them or None or a literal.

    Returns
    -------
    callable
        A converter of cyclopts. It raises ValueError if the word is no such number.
    """
    allowed = get_args(hint) or (hint,)
    words = [word for one in allowed for word in get_args(one)]

    def read(_: Any, tokens: Sequence[Token]) -> int | float | str | None:
        text = tokens[0].value
        if text.lower() in words:
            return text.lower()
        if NoneType in allowed and text.lower() == "none":
            return None
        with contextlib.suppress(ValueError):
            return int(text)
        if float not in allowed:
            raise ValueError(f"{text!r} is no whole number.")
        with contextlib.suppress(ValueError):
            return float(text)
        raise ValueError(f"{text!r} is no number.")

    return read


def read_update(_: Any, tokens: Sequence[Token]) -> int | str | None:
    """Read how often a reference frame is renewed: a whole number, 'lost' or 'none'; a converter of cyclopts."""
    text = tokens[0].value
    if text.lower() in ("lost", "none"):
        return None if text.lower() == "none" else "lost"
    with contextlib.suppress(ValueError):
        return int(text)
    raise ValueError(f"{text!r} is neither a whole number nor 'lost'.")


Whole: TypeAlias = Annotated[int, Parameter(converter=number_reader(int))]
"""A whole number."""

Output: TypeAlias = Annotated[Path, Parameter(name=("--output", "-o"))]
"""Where the result goes."""

Switch: TypeAlias = Annotated[bool, Parameter(negative="", show_default=False)]
"""Off unless given; it has no opposite."""
