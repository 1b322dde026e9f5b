"""Kanatani's invariants, and the law by which they turn with the axes of the image (Eagleson, §2 and eq. (2)).

In axes that are turned by θ from x towards y (clockwise on the screen) a quantity of weight n becomes

    z' = e^{−inθ} z

and if the image is turned by θ instead, z' = e^{+inθ} z. So T and R, of weight 0, are absolute invariants, and so are
the sizes |U₀|, |S|, |K| and differences of directions, such as arg S − 2 arg U₀. With the y axis turned up, every
quantity becomes its conjugate, and R changes sign.

As a matrix on the numbers (u, v, T, R, Re S, Im S, E, F) the law is block-diagonal: rotations by −θ, 0, 0, −2θ, −θ.
It is orthogonal, and carries a covariance C to J C Jᵀ exactly.
"""

from __future__ import annotations

import types
from collections.abc import Mapping
from typing import NamedTuple, overload

import numpy as np
from numpy.typing import ArrayLike

from sixflow.array_checks import Array, as_floats, require_broadcast, silent
from sixflow.errors import InputError
from sixflow.groups.generators import NAMES as NAMES
from sixflow.groups.generators import NUMBER_PER_COEFFICIENT
from sixflow.groups.planar_flow import COEFFICIENTS_FROM_EIGHT, EIGHT

WEIGHTS: Mapping[str, int] = types.MappingProxyType({"U0": 1, "T": 0, "R": 0, "S": 2, "K": 1})
"""Weight n of each quantity: it turns by n times the angle of the axes."""

PLACES: Mapping[str, int] = types.MappingProxyType({"U0": 0, "T": 2, "R": 3, "S": 4, "K": 6})
"""Where the (real part of the) quantity stands among the numbers."""


class Invariants(NamedTuple):
    """Kanatani's invariants of a motion.

    Attributes
    ----------
    U0 : complex array, shape (...)
        u + iv, px: translation.
    T, R : array, shape (...)
        Divergence and curl.
    S : complex array, shape (...)
        stretch + i shear: size and, by half its argument, axis of the deformation.
    K : complex array, shape (...), or None
        E + iF, px⁻¹: fanning. None if the numbers are only six.
    """

    U0: Array
    T: Array
    R: Array
    S: Array
    K: Array | None


def kanatani(numbers: ArrayLike) -> Invariants:
    """Kanatani's invariants U₀, T, R, S, K (Eagleson, §2).

    Parameters
    ----------
    numbers : array, shape (..., 6) or (..., 8)
        The six (u, v, divergence, curl, stretch, shear), or the six and (E, F).

    Raises
    ------
    InputError
        If the shape or dtype is wrong.

    Examples
    --------
    >>> found = kanatani([3.0, 4.0, 0.02, -0.01, 0.03, 0.04])
    >>> found.U0, found.S
    (np.complex128(3+4j), np.complex128(0.03+0.04j))
    """
    n = as_numbers(numbers)
    return Invariants(
        U0=_complex(n, 0),
        T=n[..., 2][()],
        R=n[..., 3][()],
        S=_complex(n, 4),
        K=_complex(n, 6) if n.shape[-1] == 8 else None,
    )


@overload
def numbers_from_eight(eight: ArrayLike) -> Array: ...
@overload
def numbers_from_eight(eight: ArrayLike, covariance: None) -> Array: ...
@overload
def numbers_from_eight(eight: ArrayLike, covariance: ArrayLike) -> tuple[Array, Array]: ...


@silent
def numbers_from_eight(eight: ArrayLike, covariance: ArrayLike | None = None) -> Array | tuple[Array, Array]:
    """The six and (E, F) of a planar flow given by Kanatani's eight coefficients (Eagleson, eq. (2)).

    Parameters
    ----------
    eight : array, shape (..., 8)
        (u₀, v₀, A, B, C, D, E, F).
    covariance : array, shape (..., 8, 8), optional
        Of the eight.

    Returns
    -------
    float64 array, shape (..., 8), or that and the covariance, shape (..., 8, 8), if one was given

    Raises
    ------
    InputError
        If a shape or dtype is wrong.

    Examples
    --------
    >>> numbers_from_eight([1.0, 0.0, 0.25, -0.5, 0.5, 0.25, 0.0, 0.125]).tolist()
    [1.0, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0, 0.125]
    """
    array = as_floats("eight", eight, ()).astype(np.float64)
    if array.shape[-1:] != (8,):
        raise InputError(
            f"eight of shape {array.shape}: the last dimension must be 8, for {', '.join(EIGHT)}"
        )
    return _linear(_NUMBERS_FROM_EIGHT, array, covariance)


def turning_matrix(angle: ArrayLike, count: int = 6) -> Array:
    """Matrix J that takes the numbers to those in turned axes.

    Parameters
    ----------
    angle : array, shape (...)
        By which the axes are turned, rad, from x towards y.
    count : {6, 8}
        For the six, or for the six and (E, F).

    Returns
    -------
    float64 array, shape (..., count, count)
        Orthogonal.

    Raises
    ------
    InputError
        If the angle holds no real numbers, or the count is another.

    Examples
    --------
    >>> import numpy as np
    >>> (turning_matrix(np.pi / 4) @ [1, 0, 0, 0, 0, 1]).round(4)
    array([ 0.7071, -0.7071,  0.    ,  0.    ,  1.    ,  0.    ])
    """
    if count not in (6, 8):
        raise InputError(f"count={count!r}: must be 6, or 8 with E and F")
    theta = as_floats("angle", angle, ()).astype(np.float64)
    J = np.zeros((*theta.shape, count, count))
    J[...] = np.eye(count)
    for name in ("U0", "S", "K")[: count // 2 - 1]:
        k, n = PLACES[name], WEIGHTS[name]
        J[..., k, k] = J[..., k + 1, k + 1] = np.cos(n * theta)
        J[..., k, k + 1] = np.sin(n * theta)
        J[..., k + 1, k] = -J[..., k, k + 1]
    return J


@overload
def turn_axes(numbers: ArrayLike, angle: ArrayLike) -> Array: ...
@overload
def turn_axes(numbers: ArrayLike, angle: ArrayLike, covariance: None) -> Array: ...
@overload
def turn_axes(numbers: ArrayLike, angle: ArrayLike, covariance: ArrayLike) -> tuple[Array, Array]: ...


@silent
def turn_axes(
    numbers: ArrayLike, angle: ArrayLike, covariance: ArrayLike | None = None
) -> Array | tuple[Array, Array]:
    """The numbers of the same motion in axes that are turned about the point: z' = e^{−inθ} z (Eagleson, §2).

    Parameters
    ----------
    numbers : array, shape (..., 6) or (..., 8)
        The six, or the six and (E, F).
    angle : array, shape (...)
        By which the axes are turned, rad, from x towards y. Minus the angle by which an image is turned.
    covariance : array, shape (..., 6, 6) or (..., 8, 8), optional
        Of the numbers. Leading dimensions are broadcast.

    Returns
    -------
    float64 array, of the shape of the numbers, or that and the covariance if one was given

    Raises
    ------
    InputError
        If a shape or dtype is wrong.

    Examples
    --------
    A motion to the right is one upwards in axes whose x points down; the shear axis follows too.

    >>> import numpy as np
    >>> turn_axes([1.0, 0, 0.02, 0.01, 0.03, 0], np.pi / 2).round(12) + 0.0
    array([ 0.  , -1.  ,  0.02,  0.01, -0.03,  0.  ])
    """
    n = as_numbers(numbers)
    J = turning_matrix(angle, n.shape[-1])
    require_broadcast(numbers=n.shape[:-1], angle=J.shape[:-2])
    return _linear(J, n, covariance)


def as_numbers(value: ArrayLike) -> Array:
    """Return `value` as float64 numbers, shape (..., 6) or (..., 8); InputError if it cannot be."""
    array = as_floats("numbers", value, ()).astype(np.float64)
    if array.shape[-1:] not in ((6,), (8,)):
        raise InputError(
            f"numbers of shape {array.shape}: the last dimension must be 6, for {', '.join(NAMES[:6])}, or 8 with E, F"
        )
    return array


def as_covariance(value: ArrayLike, count: int) -> Array:
    """Return `value` as float64 covariance, shape (..., count, count); InputError if it cannot be."""
    array = as_floats("covariance", value, ()).astype(np.float64)
    if array.shape[-2:] != (count, count):
        raise InputError(
            f"covariance of shape {array.shape}: the last dimensions must be ({count}, {count}), of the {count} numbers"
        )
    return array


_NUMBERS_FROM_EIGHT = NUMBER_PER_COEFFICIENT[:, None] * COEFFICIENTS_FROM_EIGHT


def _linear(J: Array, values: Array, covariance: ArrayLike | None) -> Array | tuple[Array, Array]:
    turned = np.einsum("...kl,...l->...k", J, values) + 0.0
    if covariance is None:
        return turned
    C = as_covariance(covariance, values.shape[-1])
    require_broadcast(values=turned.shape[:-1], covariance=C.shape[:-2])
    spread = np.einsum("...ij,...jk,...lk->...il", J, C, J)
    return turned, (spread + spread.swapaxes(-1, -2)) / 2


def _complex(numbers: Array, place: int) -> Array:
    return np.asarray(numbers[..., place] + 1j * numbers[..., place + 1])[()]
