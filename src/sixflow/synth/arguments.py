"""Arguments that patterns, motions, sensors and renderers share."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sixflow.array_checks import image_points
from sixflow.checks import number, require, whole
from sixflow.errors import InputError

Array: TypeAlias = NDArray[np.float64]

FARTHEST = 1e9
"""Largest coordinate, px, that patterns and motions accept; float64 still resolves 1e-7 px there."""

SHORTEST = 0.1
"""Smallest length, px, of a blob, a wave or a motion: far below what pixels resolve."""


def length(name: str, value: object) -> float:
    """Return a length in px, `SHORTEST` to `FARTHEST`, as a float; InputError if it is none."""
    return number(name, value, least=SHORTEST, most=FARTHEST, unit="px")


def frame_shape(shape: Any) -> tuple[int, int]:
    """Return a frame's shape (rows, columns) as two ints; InputError if it is not two from 1 to 65536."""
    pair = isinstance(shape, Iterable) and not isinstance(shape, str)
    sizes = tuple(shape) if pair else ()
    require(len(sizes) == 2, "shape", shape, "must be two whole numbers (rows, columns), such as (512, 512)")
    return whole("shape[0]", sizes[0], 1, 65536), whole("shape[1]", sizes[1], 1, 65536)


def points(x: ArrayLike, y: ArrayLike) -> tuple[Array, Array]:
    """Return coordinates, px, as two float64 arrays of one shape.

    Raises InputError if they are not real numbers, not of shapes that broadcast, not finite, or beyond
    `FARTHEST`.
    """
    x, y = image_points(x, y)
    for name, array in (("x", x), ("y", y)):
        bad = np.abs(array) > FARTHEST
        if bad.any():
            raise InputError(
                f"{name}: {int(bad.sum())} of {bad.size} coordinates are beyond {FARTHEST:g} px, such as "
                f"{array[bad][0]}; leave those points out"
            )
    return x, y
