"""Values that a user gives: whether they are of a kind, and how they are shown in a message."""

from __future__ import annotations

import math
from typing import Any

from sixflow.errors import InputError

A_SCALE = "a positive number from 1e-30 to 1e30"
"""What `is_scale` allows, in words."""


def plain(value: Any) -> Any:
    """Return a number or truth value of NumPy as Python's own; anything else as it is."""
    is_scalar = type(value).__module__ == "numpy" and hasattr(value, "item") and not hasattr(value, "__len__")
    return value.item() if is_scalar else value


def shown(value: object) -> str:
    """Return a value for a message, cut if it is long."""
    try:
        text = repr(value)
    except Exception:  # whole numbers of thousands of digits refuse, and objects may do anything
        text = f"a {type(value).__name__}"
    return text if len(text) <= 80 else f"{text[:60]}… ({type(value).__name__})"


def is_number(value: object) -> bool:
    """Tell finite numbers, other than truth values."""
    return isinstance(value, int | float) and not isinstance(value, bool) and -math.inf < value < math.inf


def is_scale(value: object) -> bool:
    """Tell numbers that may be the length of a pixel or an interval: their products and quotients are finite."""
    return is_number(value) and 1e-30 <= value <= 1e30  # type: ignore[operator]


def is_whole(value: object, low: int, high: int) -> bool:
    """Tell whole numbers of a range, its ends included."""
    return isinstance(value, int) and not isinstance(value, bool) and low <= value <= high


def is_choice(value: object, choices: tuple[str, ...]) -> bool:
    """Tell one of several words."""
    return isinstance(value, str) and value in choices


def require(condition: bool, name: str, value: object, remedy: str) -> None:
    """Refuse a value, by an `InputError` that names it and the remedy, unless a condition holds."""
    if not condition:
        raise InputError(f"{name}={shown(value)}: {remedy}")


def require_choice(name: str, value: object, choices: tuple[str, ...]) -> None:
    """Refuse a value that is none of several words."""
    require(is_choice(value, choices), name, value, f"must be one of {', '.join(map(repr, choices))}")
