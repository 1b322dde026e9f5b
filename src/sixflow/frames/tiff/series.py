"""Series: a stack of pictures in a TIFF, and where each of them lies."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

from sixflow.frames.axes import Axis
from sixflow.frames.tiff.chain import Chain
from sixflow.frames.tiff.ome import Index
from sixflow.frames.tiff.page import Pages, Plane, is_contiguous

Size: TypeAlias = tuple[float, str] | None
"""A length and its unit."""

Place: TypeAlias = Callable[[int], Plane | None]
"""Where the k-th picture of a stack lies; None where it is missing."""

LEFT_OUT = 1 | 4
"""Bits of pages that are reduced pictures or transparency masks."""


@dataclasses.dataclass
class Series:
    """A stack of pictures in a file.

    Attributes
    ----------
    number, name : int, str
        Of the series in the file.
    size : (int, int)
        Rows and columns, px.
    axes : list of Axis
        Beside rows, columns and colours.
    plane : callable
        Where the picture of given numbers along the axes lies; None where it is missing.
    stated : bool
        Whether the file says how many pictures there are.
    times : int or None
        Times that the file says there are, of which some may have no picture.
    interval : float or None
        Time between successive frames, s.
    stamps : mapping
        Time of a picture, s, by its numbers of T, C and Z.
    pixel : (size, size)
        Width and height of a pixel; None where they are not stated.
    origin : str
        As of `ome.OmeImage`.
    notes : list of str
    """

    number: int
    name: str
    size: tuple[int, int]
    axes: list[Axis]
    plane: Callable[[Mapping[str, int]], Plane | None]
    stated: bool = False
    times: int | None = None
    interval: float | None = None
    stamps: Mapping[Index, float] = dataclasses.field(default_factory=dict)
    pixel: tuple[Size, Size] = (None, None)
    aspect: float = 1.0
    origin: str = ""
    notes: list[str] = dataclasses.field(default_factory=list)

    def describe(self) -> str:
        """Return number, name and size in words."""
        sizes = " × ".join(f"{axis.code}={len(axis.numbers)}" for axis in self.axes if len(axis.numbers) > 1)
        name = f" {self.name!r}" if self.name else ""
        return f"{self.number}{name}, {sizes or 'one frame'} of {self.size[1]}×{self.size[0]} px"


def places(number: int, pages: Pages, chain: Chain, first: Any) -> Place:
    """Where the pictures of a stack lie: each with a directory of its own, or one after another behind the first."""
    count = len(chain.offsets)
    if number > count and count <= 1 + bool(chain.broken) * count and is_contiguous(first):
        begin, size = int(first.dataoffsets[0]), math.prod(first.shape) * first.dtype.itemsize
        total = pages.size
        return lambda k: Plane(0, begin + k * size) if begin + (k + 1) * size <= total else None
    return lambda k: Plane(k) if k < count else None


def in_order(
    axes: list[Axis], at: Place, sampled: bool = False
) -> Callable[[Mapping[str, int]], Plane | None]:
    """Return where a picture of given numbers lies, of pictures that are stored with the last axis fastest."""

    def plane(index: Mapping[str, int]) -> Plane | None:
        k = 0
        for axis in axes:
            k = k * len(axis.numbers) + index.get(axis.code, 0)
        found = at(k)
        return (
            dataclasses.replace(found, sample=index.get("C", 0)) if found is not None and sampled else found
        )

    return plane
