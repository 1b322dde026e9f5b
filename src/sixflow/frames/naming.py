"""Naming: what the names of files say of a recording: their order, their numbers, gaps in these, and files that do not
belong.

A name is text with numbers in it. A number is

- *signed* where a sign can be meant: some names have ``-`` before it and others with the same text do not
  (``z-10 … z5``), some have ``+``, or the ``-`` follows another separator (``z_-10``, ``z=-10``). Where all names have
  it, as in ``run-1, run-10``, it separates.
- *decimal* where a point stands between its digits (``t0.25, t0.5``), unless it counts: a last digit 0 that shorter
  fractions lack (``1.9, 1.10``), or a further point (``2026.01.15``).
"""

from __future__ import annotations

import dataclasses
import itertools
import re
from collections import Counter
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path
from typing import TypeAlias

Number: TypeAlias = int | Fraction
Key: TypeAlias = tuple[tuple[int, Number, str], ...]

_NUMBER = re.compile(r"(?:(?<![\d+-])[+-])?\d+(?:(?<![\d.]\d)\.\d+)?", re.ASCII)
_DIGITS = re.compile(r"([+-]?)(\d+)(?:\.(\d+))?", re.ASCII)
_SHOWN = 3


@dataclasses.dataclass(frozen=True)
class Naming:
    """Files in order, and what their names say.

    Attributes
    ----------
    paths : tuple of Path
    notes : tuple of str
        On gaps in the numbers, on runs that follow each other, and on files that do not belong.
    gaps : tuple of int
        Places of files before which others may be missing: where the numbers leap, a run begins, or a file does not
        belong to those beside it.
    """

    paths: tuple[Path, ...]
    notes: tuple[str, ...] = ()
    gaps: tuple[int, ...] = ()


def natural_order(paths: Sequence[Path]) -> list[Path]:
    """Return paths as their numbers say: img2 before img10, z-10 before z5, t0.25 before t0.5; without regard to case.

    Examples
    --------
    >>> [path.name for path in natural_order([Path("img10.png"), Path("img2.png"), Path("Img1.png")])]
    ['Img1.png', 'img2.png', 'img10.png']
    >>> [path.name for path in natural_order([Path("z5.tif"), Path("z-10.tif"), Path("z-9.tif")])]
    ['z-10.tif', 'z-9.tif', 'z5.tif']
    >>> [path.name for path in natural_order([Path("run-10.tif"), Path("run-2.tif")])]
    ['run-2.tif', 'run-10.tif']
    """
    keys = _keys(paths)
    return [paths[k] for k in sorted(range(len(paths)), key=lambda k: (keys[k], str(paths[k])))]


def read_names(paths: Sequence[Path], *, given_order: bool = False) -> Naming:
    """Return files in their order, with notes.

    Parameters
    ----------
    paths : sequence of Path
    given_order : bool
        Keep the order in which they stand; that it is not the natural one is then noted.

    Examples
    --------
    >>> read_names([Path(f"img{k}.png") for k in (0, 1, 2, 5)]).notes
    ('the numbers of the files have a gap: img2.png is followed by img5.png',)
    """
    natural = natural_order(paths)
    ordered = list(paths) if given_order else natural
    if len(ordered) < 3:
        return Naming(tuple(ordered))
    if ordered != natural and ordered != natural[::-1]:
        first = next(k for k, (a, b) in enumerate(zip(ordered, natural, strict=True)) if a != b)
        exchanged = f"{ordered[first].name} comes before {natural[first].name}"
        return Naming(
            tuple(ordered),
            (f"the files are taken in the order given, not in that of their numbers: {exchanged}",),
        )
    keys = _keys(ordered)
    templates = [tuple(part[2] for part in key) for key in keys]
    common, most = Counter(templates).most_common(1)[0]
    odd = [k for k, template in enumerate(templates) if template != common]
    members = [k for k, template in enumerate(templates) if template == common]
    leaps, leap_notes = _leaps([ordered[k] for k in members], [keys[k] for k in members])
    gaps = {members[k] for k in leaps}
    odd_notes = _odd_notes(ordered, odd, most)
    if odd_notes:
        gaps |= {place for k in odd for place in (k, k + 1) if 0 < place < len(ordered)}
    return Naming(tuple(ordered), (*odd_notes, *leap_notes), tuple(sorted(gaps)))


def _odd_notes(paths: Sequence[Path], odd: Sequence[int], most: int) -> tuple[str, ...]:
    """Name files whose names do not follow the pattern of the many others."""
    if not odd or most < 3 or len(odd) > most / 3:
        return ()
    last = len(paths) - 1
    words = [
        f"{paths[k].name} (frame {k}{', the last' if k == last else ', the first' if k == 0 else ''})"
        for k in odd[:_SHOWN]
    ]
    example = next(paths[k].name for k in range(len(paths)) if k not in odd)
    more = f" and {len(odd) - _SHOWN} more" if len(odd) > _SHOWN else ""
    verb = "does" if len(odd) == 1 else "do"
    return (
        f"{', '.join(words)}{more} {verb} not follow the names of the others, such as {example}: if it is no frame of "
        "the recording, leave it out",
    )


def _leaps(paths: Sequence[Path], keys: Sequence[Key]) -> tuple[Sequence[int], tuple[str, ...]]:
    """Places before which numbers are missing or a further run begins, in names of one pattern, and notes on them."""
    columns = list(zip(*([part[1] for part in key] for key in keys), strict=True))
    varying = [column for column in columns if len(set(column)) > 1]
    if len(paths) < 3 or not varying:
        return (), ()
    fast = varying[-1]
    starts = [k for k in range(1, len(paths)) if any(column[k] != column[k - 1] for column in varying[:-1])]
    if starts:
        return _runs(paths, fast, starts)
    steps = [abs(b - a) for a, b in itertools.pairwise(fast)]
    stride = min(steps)
    if stride == 0 or any(step % stride for step in steps) or steps.count(stride) < len(steps) / 2:
        return (), ()  # numbers that do not count frames, such as times
    gaps = [k for k, step in enumerate(steps, 1) if step != stride]
    if not gaps:
        return (), ()
    shown = "; ".join(f"{paths[k - 1].name} is followed by {paths[k].name}" for k in gaps[:_SHOWN])
    more = f"; and {len(gaps) - _SHOWN} more" if len(gaps) > _SHOWN else ""
    word = "a gap" if len(gaps) == 1 else f"{len(gaps)} gaps"
    return gaps, (f"the numbers of the files have {word}: {shown}{more}",)


def _runs(
    paths: Sequence[Path], fast: Sequence[Number], starts: Sequence[int]
) -> tuple[Sequence[int], tuple[str, ...]]:
    """Tell recordings that follow each other from names such as dates, whose numbers all change."""
    begins = [0, *starts, len(paths)]
    lengths = [b - a for a, b in itertools.pairwise(begins)]
    if min(lengths) < 3 or any(fast[start] != fast[0] for start in starts):
        return (), ()
    names = ", ".join(paths[start].name for start in starts[:_SHOWN])
    more = " …" if len(starts) > _SHOWN else ""
    note = (
        f"two numbers of the names vary: {len(lengths)} runs follow each other, new ones begin with {names}{more}; if "
        "they are several recordings, positions or channels, give one by a pattern"
    )
    return starts, (note,)


def _keys(paths: Sequence[Path]) -> list[Key]:
    """Return a sort key for each path: text and numbers in turn."""
    split = [_split(path) for path in paths]
    families: dict[tuple[str, ...], list[int]] = {}
    for k, (texts, _) in enumerate(split):
        families.setdefault(texts, []).append(k)
    keys: list[Key] = [()] * len(paths)
    for texts, members in families.items():
        columns = [_values(texts[i], [split[k][1][i] for k in members]) for i in range(len(texts) - 1)]
        for place, k in enumerate(members):
            key: list[tuple[int, Number, str]] = []
            for i, text in enumerate(texts[:-1]):
                joined, value = columns[i][place]
                key += [(1, 0, text + joined), (0, value, "")]
            keys[k] = (*key, (1, 0, texts[-1]))
    return keys


def _split(path: Path) -> tuple[tuple[str, ...], list[str]]:
    """Return the text around the numbers of a path, and the numbers as they are written."""
    stem = str(path.with_suffix("")).lower() if path.suffix else str(path).lower()
    numbers = _NUMBER.findall(stem)
    texts = _NUMBER.split(stem)
    return (*texts[:-1], texts[-1] + path.suffix.lower()), numbers


def _values(before: str, written: Sequence[str]) -> list[tuple[str, Number]]:
    """Return what belongs to the text before a number, and its value, for each of several names."""
    parts = [_DIGITS.fullmatch(text) for text in written]
    signs = {part[1] for part in parts if part}
    signed = "+" in signs or signs == {"", "-"} or (signs == {"-"} and before[-1:] in tuple("_=( ["))
    fractions = [part[3] for part in parts if part and part[3]]
    shortest = min(map(len, fractions), default=0)
    counts = any(len(digits) > shortest and digits.endswith("0") for digits in fractions)
    values: list[tuple[str, Number]] = []
    for part in parts:
        assert part is not None
        whole, digits = int(part[2]), part[3]
        value: Number = whole
        if digits:
            # a counter after the point: ordered by the two numbers, which a fraction of so many digits does
            value = Fraction(int(digits), 10**30) + whole if counts else Fraction(f"{whole}.{digits}")
        if part[1] == "-" and signed:
            value = -value
        values.append(("" if signed else part[1], value))
    return values
