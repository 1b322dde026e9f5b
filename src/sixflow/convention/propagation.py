"""Propagation of covariance: Cov(f(x)) = J Cov(x) Jᵀ, J the derivative of f at x.

First order in the errors: right while f is nearly straight over one standard deviation. Covariance of the six
has the shape (..., 6, 6), of a tensor (..., 2, 2, 2, 2) with cov[i, j, k, l] = Cov(T_ij, T_kl), of a scalar
(...), its variance.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sixflow.array_checks import Array, as_floats, require_broadcast, silent
from sixflow.convention import affine, strain
from sixflow.convention.derivatives import (
    JACOBIANS,
    OF_GRADIENT,
    flat_rows,
    input_dims,
    numerical_jacobian,
    sandwich,
)
from sixflow.convention.six import gradient
from sixflow.errors import InputError


@silent
def jacobian(function: Callable[..., Any], value: ArrayLike, *, dims: int = 1) -> Array:
    """Derivative of a function: in closed form for those of the convention, numerically for any other.

    Parameters
    ----------
    function : callable
        A function of `sixflow.convention` of one array, or any that acts on the last dimensions of its
        argument.
    value : array, shape (..., *m)
    dims : int
        Number of dimensions m of one input, for functions that are not of the convention: 1 for the six, 2
        for a gradient.

    Returns
    -------
    array, shape (..., *k, *m)
        float64. NaN where there is no derivative.

    Raises
    ------
    InputError
        If `value` does not end in the dimensions that the function takes.

    Examples
    --------
    >>> from sixflow.convention import area_ratio
    >>> jacobian(area_ratio, [[0.5, 0.0], [0.0, 0.0]])
    array([[ 1. , -0. ],
           [-0. ,  1.5]])

    See Also
    --------
    propagate : the covariance itself.
    """
    if function not in JACOBIANS:
        return numerical_jacobian(function, value, dims=dims)
    core = (6,) if input_dims(function, dims) == 1 else (2, 2)
    return JACOBIANS[function](as_floats("value", value, core).astype(np.float64))


def propagate(
    function: Callable[..., Any], value: ArrayLike, covariance: ArrayLike, **options: Any
) -> tuple[Array, Array]:
    """Value and covariance of a function of a measured quantity.

    Parameters
    ----------
    function : callable
        A function of `sixflow.convention` of one array, or any that acts on the last dimensions of its
        argument. A measure of the gradient may be given the six: their gradient is taken first.
    value : array, shape (..., *m)
        The six (..., 6), or the value of an earlier call: a gradient or tensor (..., 2, 2), a scalar (...).
    covariance : array, shape (..., *m, *m)
        Of the same leading dimensions as `value`.
    **options
        Passed on to `function`, such as invalid="nan".

    Returns
    -------
    value : array, shape (..., *k)
    covariance : array, shape (..., *k, *k)
        Symmetric. NaN where the function has no derivative.

    Raises
    ------
    InputError
        If the shapes do not fit, or the function refuses the value.

    Examples
    --------
    The rotation of a point whose curl is 0.5 ± 0.02, and the principal values of its Green–Lagrange tensor:

    >>> import numpy as np
    >>> from sixflow.convention import green_lagrange, principal_values, rotation_angle
    >>> six = np.array([0.3, -0.1, 0.04, 0.5, 0.02, 0.0])
    >>> covariance = np.diag([0.01, 0.01, 0.02, 0.02, 0.02, 0.02]) ** 2
    >>> angle, variance = propagate(rotation_angle, six, covariance)
    >>> print(f"{angle:.4f} ± {np.sqrt(variance):.4f} rad")
    0.2404 ± 0.0095 rad
    >>> tensor, tensor_covariance = propagate(green_lagrange, six, covariance)
    >>> values, values_covariance = propagate(principal_values, tensor, tensor_covariance)
    >>> values.round(4), np.sqrt(np.diag(values_covariance)).round(4)
    (array([0.062, 0.041]), array([0.015 , 0.0147]))
    """
    value, covariance = as_floats("value", value, ()), as_floats("covariance", covariance, ())
    dims = covariance.ndim - value.ndim
    if not 0 <= dims <= value.ndim or covariance.shape != value.shape + value.shape[value.ndim - dims :]:
        raise InputError(
            f"covariance of shape {covariance.shape} for a value of shape {value.shape}: must have the shape "
            "of the value with its last dimensions repeated, such as (..., 6, 6) for (..., 6)"
        )
    if function in OF_GRADIENT and dims == 1 and value.shape[-1] == 6:
        return propagate(function, *propagate(gradient, value, covariance), **options)
    known = input_dims(function, dims)
    if dims != known:
        shapes = "(..., 6) and (..., 6, 6)" if known == 1 else "(..., 2, 2) and (..., 2, 2, 2, 2)"
        raise InputError(
            f"value of shape {value.shape} with a covariance of shape {covariance.shape}: "
            f"{function.__name__} takes {shapes}"
        )
    leading = value.shape[: value.ndim - dims]
    result = np.asarray(function(value, **options))
    if result.shape[: len(leading)] != leading:
        raise InputError(
            f"function returned the shape {result.shape} for a value of shape {value.shape}: it must keep "
            f"the leading dimensions {leading}"
        )
    if function in JACOBIANS:
        J = jacobian(function, value)
    else:
        J = numerical_jacobian(lambda x: function(x, **options), value, dims=dims)
    core = result.shape[len(leading) :]
    spread = _spread(_matrices(J, leading, core), _matrices(covariance, leading, value.shape[len(leading) :]))
    return result[()], spread.astype(covariance.dtype).reshape((*leading, *core, *core))[()]


def propagate_composition(
    second: ArrayLike, second_covariance: ArrayLike, first: ArrayLike, first_covariance: ArrayLike
) -> tuple[Array, Array]:
    """The six of `second` after `first` (`compose_six`) and their covariance, for independent errors.

    Parameters
    ----------
    second, first : array, shape (..., 6)
    second_covariance, first_covariance : array, shape (..., 6, 6)

    Returns
    -------
    six : array, shape (..., 6)
        Leading dimensions are broadcast.
    covariance : array, shape (..., 6, 6)

    Raises
    ------
    InputError
        If a shape or dtype is wrong.

    Examples
    --------
    >>> import numpy as np
    >>> shift, zoom = np.eye(6)[0], np.eye(6)[2]
    >>> six, covariance = propagate_composition(zoom, 0 * np.eye(6), shift, 0.01 * np.eye(6))
    >>> six, np.diag(covariance)[:2]
    (array([1.5, 0. , 1. , 0. , 0. , 0. ]), array([0.0225, 0.0225]))
    """
    second, first = as_floats("second", second, (6,)), as_floats("first", first, (6,))
    second_covariance = as_floats("second_covariance", second_covariance, (6, 6))
    first_covariance = as_floats("first_covariance", first_covariance, (6, 6))
    require_broadcast(
        second=second.shape[:-1],
        second_covariance=second_covariance.shape[:-2],
        first=first.shape[:-1],
        first_covariance=first_covariance.shape[:-2],
    )
    by_second, by_first = composition_jacobians(second, first)
    covariance = _spread(by_second, second_covariance) + _spread(by_first, first_covariance)
    dtype = np.result_type(second_covariance, first_covariance)
    return affine.compose_six(second, first), covariance.astype(dtype)


@silent
def composition_jacobians(second: ArrayLike, first: ArrayLike) -> tuple[Array, Array]:
    """Derivatives of `compose_six` with respect to `second` and to `first`.

    With d = d₂ + F₂ d₁ and F = F₂ F₁: ∂d = ∂d₂ + ∂G₂ d₁ + F₂ ∂d₁ and ∂G = ∂G₂ F₁ + F₂ ∂G₁.

    Parameters
    ----------
    second, first : array, shape (..., 6)

    Returns
    -------
    by_second, by_first : array, shape (..., 6, 6)

    Raises
    ------
    InputError
        If a shape or dtype is wrong.

    Examples
    --------
    >>> by_second, by_first = composition_jacobians([0, 0, 1.0, 0, 0, 0], [0.0] * 6)
    >>> by_first.diagonal()
    array([1.5, 1.5, 1.5, 1.5, 1.5, 1.5])
    """
    second, first = as_floats("second", second, (6,)), as_floats("first", first, (6,))
    F1 = strain.deformation_gradient(gradient(first))
    F2 = strain.deformation_gradient(gradient(second))
    one = np.eye(2)
    by_second = np.zeros((*first.shape[:-1], 6, 6))
    by_second[..., :2, :2] = one
    by_second[..., :2, 2:] = flat_rows(np.einsum("ik,...l->...ikl", one, first[..., :2]), 1)
    by_second[..., 2:, 2:] = flat_rows(np.einsum("ik,...lj->...ijkl", one, F1), 2)
    by_first = np.zeros((*second.shape[:-1], 6, 6))
    by_first[..., :2, :2] = F2
    by_first[..., 2:, 2:] = flat_rows(np.einsum("...ik,lj->...ijkl", F2, one), 2)
    return sandwich(by_second), sandwich(by_first)


def _matrices(array: Array, leading: tuple[int, ...], rows: tuple[int, ...]) -> Array:
    """Join the dimensions after the leading ones to rows and columns of matrices."""
    columns = array.shape[len(leading) + len(rows) :]
    return array.reshape(*leading, int(np.prod(rows)), int(np.prod(columns)))


@silent
def _spread(J: Array, covariance: Array) -> Array:
    spread = np.matmul(np.matmul(J, covariance), np.swapaxes(J, -1, -2))
    return (spread + np.swapaxes(spread, -1, -2)) / 2
