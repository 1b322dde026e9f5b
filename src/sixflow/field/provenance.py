"""Provenance: attributes of a recording, from those of the fields of its pairs.

| attribute | of a recording |
|---|---|
| input_digest | digest of the pairs' digests, in their order |
| notes | each note once |
| memory_bytes | the most of any pair |
| any other | the value of all pairs; left out where they differ |

A number that is NaN is ignored, as of a pair without a valid point. So `effective_window` and
`attenuation_period_10` stand where they hold for all pairs; elsewhere the variable `resolution` tells them apart.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np

from sixflow.field.interval import common

Said: TypeAlias = Mapping[str, Any]
"""Attributes as plain numbers, text, and lists of them."""

_LATER = (
    "settings",
    "Conventions",
    "title",
    "frame_shape",
)  # the same for all pairs, as whoever joins them makes sure


def said_of_pairs(attrs: Mapping[Any, Any]) -> dict[str, Any]:
    """Return the attributes that may differ from pair to pair, in a form that JSON can hold."""
    return {str(name): _plain(value) for name, value in attrs.items() if name not in _LATER}


def joined_attrs(said: Sequence[Said]) -> dict[str, Any]:
    r"""Return the attributes of a recording from those of its fields, in their order.

    The digest of several fields is the beginning of the SHA-256 of their digests. What the fields do not agree on is
    left out: take away every key of `said` that the result lacks.

    Examples
    --------
    >>> joined_attrs([{"notes": "dark", "gain": 1}, {"notes": "dark\nblurred", "gain": 2}])
    {'notes': 'dark\nblurred'}
    """
    joined = {}
    for name in dict.fromkeys(name for one in said for name in one):
        values = [one[name] for one in said if name in one]
        if name in _RULES:
            joined[name] = _RULES[name](values)
        elif len(values) == len(said) and _agree(values):
            joined[name] = next((value for value in values if value == value), values[0])
    return joined


def join_attrs(attrs: Mapping[Any, Any], said: Sequence[Said]) -> dict[Any, Any]:
    """Return the attributes of one of the fields of a recording with those of the recording in their place."""
    kept = {name: value for name, value in attrs.items() if name in _LATER}
    return kept | joined_attrs(said)


def _digest(digests: list[Any]) -> str:
    if len(digests) == 1:
        return str(digests[0])
    return hashlib.sha256("".join(map(str, digests)).encode()).hexdigest()[:16]


def _notes(notes: list[Any]) -> str:
    return "\n".join(dict.fromkeys(note for one in notes for note in str(one).splitlines()))


def _most(numbers: list[Any]) -> Any:
    return max((number for number in numbers if isinstance(number, int | float)), default=numbers[0])


_RULES = {"input_digest": _digest, "notes": _notes, "memory_bytes": _most, "interval": common}


def _agree(values: list[Any]) -> bool:
    """Whether all say the same that say anything."""
    telling = [value for value in values if value == value]
    return all(value == telling[0] for value in telling)


def _plain(value: Any) -> Any:
    """Numbers and arrays of NumPy as Python's own."""
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value
