"""Checks of arrays that users give: type, shape, finite values, shapes that broadcast."""

from __future__ import annotations

from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sixflow.errors import InputError

Array: TypeAlias = NDArray[Any]
Invalid: TypeAlias = Literal["raise", "nan"]

silent = np.errstate(all="ignore")
"""Decorator: NaN, inf and overflow pass through without warnings."""

_MEANING = {
    (6,): "the six numbers u, v, divergence, curl, stretch, shear",
    (2,): "a pair (x, y)",
    (2, 2): "a 2×2 matrix [[xx, xy], [yx, yy]]",
    (3, 3): "a 3×3 matrix of homogeneous coordinates",
    (6, 6): "the covariance of the six numbers",
}


def as_floats(name: str, value: ArrayLike, trailing: tuple[int, ...]) -> Array:
    """Return `value` as real floating-point numbers whose last dimensions are `trailing`.

    float32 is kept, everything else becomes float64. Masked elements become NaN: masked is never a number.

    Raises InputError if `value` is no array of real numbers (complex, bool, object, text), or its last
    dimensions differ.
    """
    try:
        array = value if isinstance(value, np.ma.MaskedArray) else np.asarray(value)
    except ValueError as error:
        raise InputError(f"{name} cannot be made an array: {error}; give rows of equal length") from error
    if array.dtype.kind not in "fiu":
        raise InputError(f"{name} of dtype {array.dtype}: must hold real numbers; convert it to float64")
    if array.dtype != np.float32:
        array = array.astype(np.float64)
    if isinstance(array, np.ma.MaskedArray):
        array = array.filled(np.nan)
    if array.shape[max(array.ndim - len(trailing), 0) :] != trailing:
        shape = ", ".join(map(str, trailing)) + ("," if len(trailing) == 1 else "")
        meaning = f" ({_MEANING[trailing]})" if trailing in _MEANING else ""
        raise InputError(f"{name} of shape {array.shape}: the last dimensions must be ({shape}){meaning}")
    return np.asarray(array)


def require_broadcast(**leading: tuple[int, ...]) -> None:
    """Raise InputError if the leading shapes, given by argument name, do not broadcast together."""
    try:
        np.broadcast_shapes(*leading.values())
    except ValueError as error:
        seen = ", ".join(f"{name} {shape}" for name, shape in leading.items())
        raise InputError(f"leading shapes {seen}: must be equal, or broadcast to one shape") from error


def require_invalid(invalid: str) -> None:
    """Raise InputError if `invalid` is not one of the two choices."""
    if invalid not in ("raise", "nan"):
        raise InputError(f"invalid={invalid!r}: must be 'raise' or 'nan'")


def refuse(name: str, bad: Array, reason: str, invalid: str) -> None:
    """Raise InputError with the number and first index of the `bad` elements, unless `invalid` is 'nan'."""
    if invalid == "nan" or not bad.any():
        return
    if bad.ndim:
        first = tuple(int(k) for k in np.argwhere(bad)[0])
        reason = f"{int(bad.sum())} of {bad.size} elements {reason}, the first at index {first}"
    raise InputError(f"{name}: {reason}; leave such elements out, or ask for NaN with invalid='nan'")


def finite_floats(name: str, value: ArrayLike, trailing: tuple[int, ...] = ()) -> NDArray[np.float64]:
    """Return real, finite numbers as float64 whose last dimensions are `trailing`.

    Raises InputError if they are not real, of another shape, or not finite.
    """
    array = as_floats(name, value, trailing).astype(np.float64)
    bad = ~np.isfinite(array)
    if bad.any():
        raise InputError(
            f"{name}: {int(bad.sum())} of {bad.size} numbers are not finite, such as {array[bad][0]}; leave them out"
        )
    return array


def broadcast(**arrays: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Return the arrays, given by argument name, in their broadcast shape; InputError if there is none."""
    require_broadcast(**{name: array.shape for name, array in arrays.items()})
    return list(np.broadcast_arrays(*arrays.values()))


def image_points(x: ArrayLike, y: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return finite image coordinates, px, as two float64 arrays of one shape; InputError if they are not."""
    x, y = broadcast(x=finite_floats("x", x), y=finite_floats("y", y))
    return x, y
