"""Checks of arguments that patterns, motions, sensors and renderers share."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sixflow.errors import InputError

Array: TypeAlias = NDArray[np.float64]

FARTHEST = 1e9
"""Largest coordinate, px, that patterns and motions accept; float64 still resolves 1e-7 px there."""

SHORTEST = 0.1
"""Smallest length, px, of a blob, a wave or a motion: far below what pixels resolve."""


def require(condition: bool, name: str, value: object, remedy: str) -> None:
    """Raise an InputError `name=value: remedy` unless the condition holds."""
    if not condition:
        raise InputError(f"{name}={value!r}: {remedy}")


def number(
    name: str,
    value: object,
    *,
    above: float | None = None,
    least: float | None = None,
    most: float | None = None,
    unit: str = "",
) -> float:
    """Return a finite real number within its range as a float.

    Raises
    ------
    InputError
        If the value is no real number, not finite, or outside its range.
    """
    wanted = "must be a finite number" + (f" of {unit}" if unit else "")
    wanted += f" above {above:g}" if above is not None else ""
    wanted += f" of at least {least:g}" if least is not None else ""
    wanted += f" and at most {most:g}" if most is not None else ""
    real = isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
    require(real, name, value, wanted)
    result = float(value)  # type: ignore[arg-type]
    inside = (
        math.isfinite(result)
        and (above is None or result > above)
        and (least is None or result >= least)
        and (most is None or result <= most)
    )
    require(inside, name, value, wanted)
    return result


def length(name: str, value: object) -> float:
    """Return a length in px, `SHORTEST` to `FARTHEST`, as a float.

    Raises
    ------
    InputError
        If the value is no such length.
    """
    return number(name, value, least=SHORTEST, most=FARTHEST, unit="px")


def whole(name: str, value: object, least: int, most: int | None = None) -> int:
    """Return a whole number within its range as an int.

    Raises
    ------
    InputError
        If the value is no whole number or outside its range.
    """
    wanted = f"must be a whole number of at least {least}" + (
        f" and at most {most}" if most is not None else ""
    )
    good = isinstance(value, int | np.integer) and not isinstance(value, bool)
    require(good, name, value, wanted)
    result = int(value)  # type: ignore[call-overload]
    require(result >= least and (most is None or result <= most), name, value, wanted)
    return int(result)


def numbers(name: str, value: Any, count: int, meaning: str) -> tuple[float, ...]:
    """Return `count` finite numbers as a tuple of floats.

    Raises
    ------
    InputError
        If the value is not a series of so many finite numbers.
    """
    wanted = f"must be {count} finite numbers, {meaning}"
    require(isinstance(value, Iterable) and not isinstance(value, str), name, value, wanted)
    items = tuple(value)
    require(len(items) == count, name, value, wanted)
    return tuple(number(f"{name}[{k}]", item) for k, item in enumerate(items))


def frame_shape(shape: Any) -> tuple[int, int]:
    """Return a frame's shape (rows, columns) as two ints.

    Raises
    ------
    InputError
        If it is not two whole numbers from 1 to 65536.
    """
    pair = isinstance(shape, Iterable) and not isinstance(shape, str)
    sizes = tuple(shape) if pair else ()
    require(len(sizes) == 2, "shape", shape, "must be two whole numbers (rows, columns), such as (512, 512)")
    return whole("shape[0]", sizes[0], 1, 65536), whole("shape[1]", sizes[1], 1, 65536)


def points(x: ArrayLike, y: ArrayLike) -> tuple[Array, Array]:
    """Return coordinates as two float64 arrays of one shape.

    Raises
    ------
    InputError
        If they are not real numbers, not of shapes that broadcast, not finite, or beyond `FARTHEST`.
    """
    arrays = []
    for name, value in (("x", x), ("y", y)):
        try:
            array = np.asarray(value)
        except ValueError as error:
            raise InputError(
                f"{name}: must be an array of coordinates in px, one number per point"
            ) from error
        if array.dtype.kind not in "iuf":
            raise InputError(f"{name}: has dtype {array.dtype}; give real coordinates in px")
        array = array.astype(np.float64)
        bad = ~(np.abs(array) <= FARTHEST)
        if bad.any():
            raise InputError(
                f"{name}: {int(bad.sum())} of {bad.size} coordinates are not finite or beyond "
                f"{FARTHEST:g} px, such as {array[bad][0]}; leave those points out"
            )
        arrays.append(array)
    try:
        first, second = np.broadcast_arrays(*arrays)
    except ValueError as error:
        raise InputError(
            f"x and y: shapes {arrays[0].shape} and {arrays[1].shape} do not broadcast; give one y for each x"
        ) from error
    return first, second
