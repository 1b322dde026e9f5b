"""Units: lengths and times as programs and file formats name them.

ImageJ lets users type any unit; OME has a list of names with SI prefixes; xarray and NGFF write words. A unit that is
no length in the object (a pixel, a reference frame) is none.
"""

from __future__ import annotations

import math
import re

MICRO = "µ"
"""The micro sign, U+00B5, by which all spellings of it are written here."""

_PREFIXES = {
    "Y": 24,
    "Z": 21,
    "E": 18,
    "P": 15,
    "T": 12,
    "G": 9,
    "M": 6,
    "k": 3,
    "h": 2,
    "da": 1,
    "": 0,
    "d": -1,
    "c": -2,
    "m": -3,
    MICRO: -6,
    "u": -6,
    "n": -9,
    "p": -12,
    "f": -15,
    "a": -18,
    "z": -21,
    "y": -24,
}

_WORDS = {
    "yotta": 24, "zetta": 21, "exa": 18, "peta": 15, "tera": 12, "giga": 9, "mega": 6, "kilo": 3, "hecto": 2, "deca": 1,
    "": 0, "deci": -1, "centi": -2, "milli": -3, "micro": -6, "nano": -9, "pico": -12, "femto": -15, "atto": -18,
    "zepto": -21, "yocto": -24,
}  # fmt: skip

_TIMES = {
    "sec": 1.0, "secs": 1.0, "msec": 1e-3, "msecs": 1e-3, "usec": 1e-6, f"{MICRO}sec": 1e-6, "nsec": 1e-9,
    "min": 60.0, "mins": 60.0, "minute": 60.0, "minutes": 60.0, "h": 3600.0, "hr": 3600.0, "hrs": 3600.0,
    "hour": 3600.0, "hours": 3600.0, "d": 86400.0, "day": 86400.0, "days": 86400.0,
}  # fmt: skip

_LENGTHS = {
    "micron": (f"{MICRO}m", 1e-6), "microns": (f"{MICRO}m", 1e-6), "å": ("Å", 1e-10), "angstrom": ("Å", 1e-10),
    "in": ("inch", 0.0254), "inch": ("inch", 0.0254), "inches": ("inch", 0.0254), "thou": ("thou", 2.54e-5),
    "li": ("li", 0.0254 / 12), "line": ("li", 0.0254 / 12), "ft": ("ft", 0.3048), "foot": ("ft", 0.3048),
    "feet": ("ft", 0.3048), "yd": ("yd", 0.9144), "yard": ("yd", 0.9144), "mi": ("mi", 1609.344),
    "mile": ("mi", 1609.344), "pt": ("pt", 0.0254 / 72), "ua": ("ua", 149597870700.0),
    "ly": ("ly", 9.4607304725808e15), "pc": ("pc", 3.0856775814913673e16),
}  # fmt: skip

_NO_LENGTH = {
    "",
    "pixel",
    "pixels",
    "px",
    "reference frame",
    "referenceframe",
    "none",
    "null",
    "unknown",
    "1",
}


def unescaped(text: str) -> str:
    r"""Return a text whose characters are written as \uXXXX, as ImageJ does, in plain letters.

    Examples
    --------
    >>> unescaped("\\u00B5m")
    'µm'
    """
    return re.sub(r"\\u([0-9a-fA-F]{4})", lambda found: chr(int(found[1], 16)), text)


def seconds_in(unit: str | None) -> float | None:
    """Return the seconds in a unit of time, or None where it is none.

    Examples
    --------
    >>> seconds_in("ms"), seconds_in("min"), seconds_in("milliseconds"), seconds_in("frame")
    (0.001, 60.0, 0.001, None)
    """
    text = _plain(unit)
    found = _scaled(text, "s", "second")
    return _TIMES.get(text.lower()) if found is None else found


def length(unit: str | None) -> tuple[str, float] | None:
    """Return the name of a unit of length as it is written here, and the metres in it (NaN where it is a word of a
    user's own); None where it is no length.

    Examples
    --------
    >>> length("micron"), length("mm"), length("pixel")
    (('µm', 1e-06), ('mm', 0.001), None)
    """
    text = _plain(unit)
    if text.lower() in _NO_LENGTH:
        return None
    metres = _scaled(text, "m", "meter", "metre")
    if metres is not None:
        return _short(text), metres
    return _LENGTHS.get(text.lower(), (text, math.nan))


def _plain(unit: str | None) -> str:
    return unescaped(str(unit or "")).strip().replace("\u03bc", MICRO)


def _scaled(text: str, symbol: str, *names: str) -> float | None:
    """What a unit with an SI prefix holds of the unit itself."""
    if text.endswith(symbol) and text[: -len(symbol)] in _PREFIXES:
        return _power(_PREFIXES[text[: -len(symbol)]])
    lowered = text.lower().removesuffix("s")
    for name in names:
        if lowered.endswith(name) and lowered.removesuffix(name) in _WORDS:
            return _power(_WORDS[lowered.removesuffix(name)])
    return None


def _power(exponent: int) -> float:
    return float(f"1e{exponent}")


def _short(text: str) -> str:
    """Write a length with an SI prefix by its symbol."""
    if text.endswith("m") and text[:-1] in _PREFIXES:
        return f"{MICRO}m" if text == "um" else text
    lowered = text.lower().removesuffix("s")
    word = lowered.removesuffix("meter").removesuffix("metre")
    exponent = _WORDS[word]
    return next(prefix for prefix, power in _PREFIXES.items() if power == exponent) + "m"
