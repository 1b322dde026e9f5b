"""Arguments that scenes share: vectors, whose motion is meant, and image points that are refused."""

from __future__ import annotations

from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from sixflow.checks import numbers, require
from sixflow.errors import InputError

Array: TypeAlias = NDArray[np.float64]
Triple: TypeAlias = tuple[float, float, float]
Of: TypeAlias = Literal["camera", "object"]


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


def refuse_points(what: str, bad: NDArray[np.bool_], x: Array, y: Array, remedy: str) -> None:
    """Raise an InputError that counts the bad image points and names the first, if there are any."""
    if bad.any():
        k = tuple(np.argwhere(bad)[0]) if bad.ndim else ()
        raise InputError(
            f"{what} at {int(bad.sum())} of {bad.size} image points, such as ({x[k]:.6g}, {y[k]:.6g}); {remedy}"
        )
