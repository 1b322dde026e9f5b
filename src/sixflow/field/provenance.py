"""Provenance: what the attributes of the fields of single pairs say of the recording that they make up."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from typing import Any

from sixflow.field.interval import common


def said_of_pairs(attrs: Mapping[str, Any]) -> dict[str, str]:
    """Return the attributes that differ from pair to pair: the digest of the frames, notes, and the interval."""
    return {name: str(attrs[name]) for name in ("input_digest", "notes", "interval") if name in attrs}


def joined_attrs(said: Sequence[Mapping[str, str]]) -> dict[str, str]:
    r"""Return the attributes of a recording from those of its fields, in their order.

    The digest of several fields is the beginning of the SHA-256 of their digests; each note is kept once; the interval
    is told if it is the same for all.

    Examples
    --------
    >>> joined_attrs([{"notes": "dark"}, {"notes": "dark\nblurred"}])
    {'notes': 'dark\nblurred'}
    """
    joined = {}
    digests = [one["input_digest"] for one in said if "input_digest" in one]
    if digests:
        together = hashlib.sha256("".join(digests).encode()).hexdigest()[:16]
        joined["input_digest"] = together if len(digests) > 1 else digests[0]
    if any("notes" in one for one in said):
        joined["notes"] = "\n".join(
            dict.fromkeys(note for one in said for note in one.get("notes", "").splitlines())
        )
    intervals = [one["interval"] for one in said if "interval" in one]
    if intervals:
        joined["interval"] = common(intervals)
    return joined
