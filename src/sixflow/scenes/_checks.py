"""What scenes ask of their numbers, and how they refuse them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sixflow.convention._checks import as_floats
from sixflow.errors import InputError

Array: TypeAlias = NDArray[np.float64]
Triple: TypeAlias = tuple[float, float, float]
Of: TypeAlias = Literal["camera", "object"]


def require(condition: bool, name: str, value: object, remedy: str) -> None:
    """Raise an InputError `name=value: remedy` unless the condition holds."""
    if not condition:
        raise InputError(f"{name}={value!r}: {remedy}")


def number(name: str, value: object, *, above: float | None = None, unit: str = "") -> float:
    """Return a finite real number, above a bound where there is one, as a float.

    Raises
    ------
    InputError
        If the value is no real number, not finite, or not above the bound.
    """
    wanted = "must be a finite number" + (f" of {unit}" if unit else "")
    wanted += f" above {above:g}" if above is not None else ""
    real = isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
    require(real, name, value, wanted)
    result = float(value)  # type: ignore[arg-type]
    require(math.isfinite(result) and (above is None or result > above), name, value, wanted)
    return result


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


def triple(name: str, value: Any, meaning: str) -> Triple:
    """Return three finite numbers as a tuple of floats; InputError if it is not three."""
    x, y, z = numbers(name, value, 3, meaning)
    return x, y, z


def pair(name: str, value: Any, meaning: str) -> tuple[float, float]:
    """Return two finite numbers as a tuple of floats; InputError if it is not two."""
    x, y = numbers(name, value, 2, meaning)
    return x, y


def require_of(of: object) -> None:
    """Raise an InputError unless `of` says whose motion is meant."""
    require(
        of in ("camera", "object"), "of", of, "must be 'camera' or 'object': whose motion the numbers are"
    )


def require_kind(name: str, value: object, kind: type, example: str) -> None:
    """Raise an InputError unless the value is of the kind."""
    article = "an" if kind.__name__[0] in "AEIOU" else "a"
    remedy = f"must be {article} {kind.__name__} of sixflow.scenes, such as {example}"
    require(isinstance(value, kind), name, value, remedy)


def finite_floats(name: str, value: ArrayLike, trailing: tuple[int, ...] = ()) -> Array:
    """Return real, finite numbers as float64 whose last dimensions are `trailing`.

    Raises
    ------
    InputError
        If they are not real, of another shape, or not finite.
    """
    array = as_floats(name, value, trailing).astype(np.float64)
    bad = ~np.isfinite(array)
    if bad.any():
        raise InputError(
            f"{name}: {int(bad.sum())} of {bad.size} numbers are not finite, such as {array[bad][0]}; leave them out"
        )
    return array


def broadcast(**arrays: Array) -> list[Array]:
    """Return the arrays, given by argument name, in their broadcast shape; InputError if there is none."""
    try:
        return list(np.broadcast_arrays(*arrays.values()))
    except ValueError as error:
        seen = ", ".join(f"{name} {array.shape}" for name, array in arrays.items())
        raise InputError(f"shapes {seen}: must be equal, or broadcast to one shape") from error


def image_points(x: ArrayLike, y: ArrayLike) -> tuple[Array, Array]:
    """Return finite image coordinates, px, as two float64 arrays of one shape; InputError if they are not."""
    x, y = broadcast(x=finite_floats("x", x), y=finite_floats("y", y))
    return x, y


def refuse_points(what: str, bad: NDArray[np.bool_], x: Array, y: Array, remedy: str) -> None:
    """Raise an InputError that counts the bad image points and names the first, if there are any."""
    if bad.any():
        k = tuple(np.argwhere(bad)[0]) if bad.ndim else ()
        raise InputError(
            f"{what} at {int(bad.sum())} of {bad.size} image points, such as ({x[k]:.6g}, {y[k]:.6g}); {remedy}"
        )
