"""Checks of single values that a user gives, and how messages show them.

Without NumPy, which the command line does not need to answer `--help`; its numbers are accepted as Python's own.
Arrays are checked in `sixflow.array_checks`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from numbers import Integral, Real
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


def is_number(value: Any) -> bool:
    """Tell finite real numbers, other than truth values."""
    real: Any = value if isinstance(value, Real) and not isinstance(value, bool) else math.nan
    return bool(-math.inf < real < math.inf)


def is_scale(value: Any) -> bool:
    """Tell numbers that may be the length of a pixel or an interval: their products and quotients are finite."""
    return is_number(value) and 1e-30 <= value <= 1e30


def is_whole(value: Any, least: float = -math.inf, most: float = math.inf) -> bool:
    """Tell whole numbers of a range, its ends included, other than truth values."""
    return isinstance(value, Integral) and not isinstance(value, bool) and least <= int(value) <= most


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


def number(
    name: str,
    value: Any,
    *,
    above: float = -math.inf,
    least: float = -math.inf,
    most: float = math.inf,
    unit: str = "",
) -> float:
    """Return a finite real number within its range as a float; InputError if it is none."""
    wanted = "must be a finite number" + (f" of {unit}" if unit else "")
    wanted += f" above {above:g}" if above > -math.inf else ""
    wanted += f" of at least {least:g}" if least > -math.inf else ""
    wanted += f" and at most {most:.4g}" if most < math.inf else ""
    require(is_number(value) and above < value and least <= value <= most, name, value, wanted)
    return float(value)


def whole(name: str, value: Any, least: int, most: int | None = None) -> int:
    """Return a whole number within its range as an int; InputError if it is none."""
    wanted = f"must be a whole number of at least {least}" + (
        f" and at most {most}" if most is not None else ""
    )
    require(is_whole(value, least, math.inf if most is None else most), name, value, wanted)
    return int(value)


def numbers(name: str, value: Any, count: int, meaning: str) -> tuple[float, ...]:
    """Return `count` finite numbers as a tuple of floats; InputError if they are not so many, or not finite."""
    wanted = f"must be {count} finite numbers, {meaning}"
    require(isinstance(value, Iterable) and not isinstance(value, str), name, value, wanted)
    items = tuple(value)
    require(len(items) == count, name, value, wanted)
    return tuple(number(f"{name}[{k}]", item) for k, item in enumerate(items))
