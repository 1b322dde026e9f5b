"""Doubles: files that come in twos, such as 001_a.tif and 001_b.tif, as double-frame cameras write them."""

from __future__ import annotations

import collections
import dataclasses
import re
from collections.abc import Sequence

MARKERS = (("a", "b"), ("A", "B"), ("0", "1"), ("1", "2"))
"""Endings of the two frames of a pair."""

_LETTER = re.compile(r"(.*?)([abAB])")
_DIGIT = re.compile(r"(.*[-_. ])([012])")


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
    def among(cls, files: Sequence[str]) -> Doubles | None:
        """Return them, or None where the names say nothing of the kind.

        Examples
        --------
        >>> Doubles.among(["001_a.tif", "001_b.tif", "002_a.tif", "002_b.tif"]).stems
        ('001_', '001_', '002_', '002_')
        >>> Doubles.among(["img_1.tif", "img_2.tif", "img_3.tif"])
        """
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
