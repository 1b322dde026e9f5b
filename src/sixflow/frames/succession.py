"""Succession: what the names of the files of a recording say of how its frames follow each other: leaps, and twos.

Names come as `FrameSource.names` gives them: "A0001.tif", or "stack.tif[3]" for frame 3 of a file that holds several.
"""

from __future__ import annotations

import collections
import dataclasses
import itertools
import re
from collections.abc import Sequence

MARKERS = (("a", "b"), ("A", "B"), ("0", "1"), ("1", "2"))
"""Endings of the two frames of a pair."""

_FRAME = re.compile(r"(.*)\[(\d+)\]")
_NO_FILE = re.compile(r"frame \d+")
_LETTER = re.compile(r"(.*?)([abAB])")
_DIGIT = re.compile(r"(.*[-_. ])([012])")


def files_of(names: Sequence[str]) -> tuple[str, ...]:
    """Name of the file of each frame; empty where frames do not come from several files.

    Examples
    --------
    >>> files_of(("a.tif[0]", "a.tif[1]", "b.tif[0]"))
    ('a.tif', 'a.tif', 'b.tif')
    >>> files_of(("frame 0", "frame 1"))
    ()
    """
    if not names or _NO_FILE.fullmatch(names[0]):
        return ()
    files = tuple(found[1] if (found := _FRAME.fullmatch(name)) else name for name in names)
    return files if len(set(files)) > 1 else ()


def breaks(names: Sequence[str], numbers: Sequence[int], *, new_files: bool = False) -> tuple[int, ...]:
    """Places of frames before which others are missing: the numbers in the names leap there.

    Parameters
    ----------
    names : sequence of str
        Of the frames.
    numbers : sequence of int
        Of the frames in the whole recording.
    new_files : bool
        Count the first frame of each further file that holds several, too: nothing tells when it was taken.

    Examples
    --------
    >>> breaks(("img1.png", "img2.png", "img5.png", "img6.png"), range(4))
    (2,)
    """
    files = files_of(names)
    if not files:
        return ()
    if any(_FRAME.fullmatch(name) for name in names):
        places = range(1, len(files))
        return tuple(k for k in places if files[k] != files[k - 1]) if new_files else ()
    counted = _counted(files)
    if counted is None:
        return ()
    steps = [
        (after - before) / (numbers[k + 1] - numbers[k])
        for k, (before, after) in enumerate(itertools.pairwise(counted))
    ]
    usual = min(steps)
    return tuple(k + 1 for k, step in enumerate(steps) if step > usual) if usual > 0 else ()


def _counted(files: Sequence[str]) -> list[int] | None:
    """The one number that differs from name to name; None where that is not all that differs."""
    parts = [re.split(r"(\d+)", name, flags=re.ASCII) for name in files]
    if len({len(one) for one in parts}) != 1:
        return None
    first = parts[0]
    differing = [
        k
        for k in range(len(first))
        if any(_number_or_text(one[k]) != _number_or_text(first[k]) for one in parts)
    ]
    if len(differing) != 1 or differing[0] % 2 == 0:
        return None
    return [int(one[differing[0]]) for one in parts]


def _number_or_text(part: str) -> int | str:
    """A run of digits as a number."""
    return int(part) if part.isdecimal() and part.isascii() else part


@dataclasses.dataclass(frozen=True)
class Doubles:
    """Files that come in twos, such as 001_a and 001_b, by their names.

    Attributes
    ----------
    stems : tuple of str
        What the names of the two have in common, for each frame.
    second : tuple of bool
        Whether a frame is the second of its two.
    """

    stems: tuple[str, ...]
    second: tuple[bool, ...]

    @classmethod
    def among(cls, names: Sequence[str]) -> Doubles | None:
        """Return them, or None where the names say nothing of the kind.

        Examples
        --------
        >>> Doubles.among(["001_a.tif", "001_b.tif", "002_a.tif", "002_b.tif"]).stems
        ('001_', '001_', '002_', '002_')
        >>> Doubles.among(["img_1.tif", "img_2.tif", "img_3.tif"])
        """
        files = files_of(names)
        if len(files) < 3:
            return None
        bare = [name.rpartition(".")[0] or name for name in files]
        for pattern in (_LETTER, _DIGIT):
            found = [one for name in bare if (one := pattern.fullmatch(name))]
            if len(found) < len(bare):
                continue
            stems, ends = tuple(one[1] for one in found), [one[2] for one in found]
            marks = next((pair for pair in MARKERS if set(ends) == set(pair)), None)
            partners = sum(count == 2 for count in collections.Counter(stems).values())
            if (
                marks is not None
                and 4 * partners >= len(files)
                and len({*zip(stems, ends, strict=True)}) == len(files)
            ):
                return cls(stems, tuple(end == marks[1] for end in ends))
        return None

    def unmatched(self) -> int | None:
        """Place of the first frame where frames 0 and 1, 2 and 3 … are not such twos; None if all are."""
        for k in range(0, len(self.stems) - 1, 2):
            if self.second[k] or not self.second[k + 1] or self.stems[k] != self.stems[k + 1]:
                return k
        return None
