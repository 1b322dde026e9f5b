"""Derivatives (Jacobians) of the convention's functions, and of any other function.

The derivative of an output of shape (..., *k) with respect to an input of shape (..., *m) has the shape
(..., *k, *m). `JACOBIANS` holds the closed forms; `numerical_jacobian` is for everything else.

With F = I + G, N = F⁻¹ and S = Nᵀ N:

    Green–Lagrange   ∂E_ij/∂G_kl = ½ (δ_il F_kj + δ_jl F_ki)
    Almansi          ∂e_ij/∂G_kl = ½ (N_li S_kj + S_ik N_lj)
    inverse          ∂N = −N ∂G N,  ∂d' = −N (∂d + ∂G d')
    logarithm        the inverse matrix of the derivative of the exponential, at the logarithm

The exponential has no branches, so that its numerical derivative is good everywhere (1e-9 and better), and
the logarithm's, taken from it, stays right next to the half turn where the logarithm itself jumps.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from sixflow.array_checks import Array, as_floats, silent
from sixflow.convention import affine, principal, strain
from sixflow.convention import six as six_module
from sixflow.convention._closed_form import determinants, log_factor
from sixflow.convention.six import GRADIENT_FROM_SIX, SIX_FROM_GRADIENT, gradient, six_from_gradient
from sixflow.errors import InputError

_STEP = 2.0**-18  # rounding 1e-11 of the derivative, truncation 1e-22 × the fifth derivative
_FOUR_FROM_G = SIX_FROM_GRADIENT[2:, 2:].reshape(4, 2, 2)
_IDENTITY = np.eye(2)
_Table: TypeAlias = Mapping[Callable[..., Any], Callable[[Array], Array]]


@silent
def numerical_jacobian(function: Callable[[Array], Any], value: ArrayLike, *, dims: int = 1) -> Array:
    """Derivative of a function by central differences of fourth order.

    f' = [8 (f(x + h) − f(x − h)) − (f(x + 2h) − f(x − 2h))] / 12h with h = 2⁻¹⁸ max(1, |x|), in double
    precision: good to about 1e-10 for functions of order 1 that are smooth over 10⁻⁵.

    Parameters
    ----------
    function : callable
        Takes an array of shape (..., *m) and returns one of shape (..., *k), element by element of the
        leading dimensions.
    value : array, shape (..., *m)
        Where the derivative is taken.
    dims : int
        Number of the last dimensions m that belong to one input, 0 or more: 1 for the six, 2 for a gradient.

    Returns
    -------
    array, shape (..., *k, *m)

    Raises
    ------
    InputError
        If `value` has fewer than `dims` dimensions or holds no real numbers.

    Examples
    --------
    >>> import numpy as np
    >>> numerical_jacobian(lambda x: x[..., 0] * x[..., 1], [2.0, 3.0]).round(9)
    array([3., 2.])
    """
    x = as_floats("value", value, ()).astype(np.float64)
    if dims < 0 or x.ndim < dims:
        raise InputError(f"dims={dims!r}: must be from 0 to {x.ndim}, the number of dimensions of value")
    leading, core = x.shape[: x.ndim - dims], x.shape[x.ndim - dims :]
    columns = []
    # a power of two, so that x ± h is exact
    steps = _STEP * np.exp2(np.ceil(np.log2(np.maximum(np.abs(x), 1))))
    for index in np.ndindex(core):
        one = np.zeros(core)
        one[index] = 1
        h = np.asarray(steps[(..., *index)])

        def difference(k: int, h: Array = h, one: Array = one) -> Array:
            move = k * h.reshape(h.shape + (1,) * dims) * one
            return np.asarray(function(x + move)) - np.asarray(function(x - move))

        rise = 8 * difference(1) - difference(2)
        columns.append(rise / (12 * h.reshape(h.shape + (1,) * (rise.ndim - len(leading)))))
    stacked = np.stack(columns, axis=-1)
    return stacked.reshape(stacked.shape[:-1] + core)


def _inverse_six(six: Array) -> Array:
    back = affine.inverse_six(six, invalid="nan")
    N = strain.deformation_gradient(gradient(back))
    rows = np.zeros((*six.shape[:-1], 6, 6))  # of (u, v, u_x, u_y, v_x, v_y)
    rows[..., :2, :2] = -N
    rows[..., :2, 2:] = flat_rows(-np.einsum("...ik,...l->...ikl", N, back[..., :2]), 1)
    rows[..., 2:, 2:] = flat_rows(-np.einsum("...ik,...lj->...ijkl", N, N), 2)
    return sandwich(rows)


def _exp_six(rates: Array) -> Array:
    return numerical_jacobian(affine.exp_six, rates)


def _log_six(six: Array) -> Array:
    forward = _exp_six(affine.log_six(six, invalid="nan"))
    bad = ~np.isfinite(forward).all(axis=(-1, -2), keepdims=True)
    return np.where(bad, np.nan, np.linalg.inv(np.where(bad, np.eye(6), forward)))


def _green_lagrange(G: Array) -> Array:
    half = np.einsum("il,...kj->...ijkl", _IDENTITY, strain.deformation_gradient(G)) / 2
    return half + np.swapaxes(half, -4, -3)


def _almansi(G: Array) -> Array:
    d = np.zeros(2)
    back = affine.inverse_six(six_from_gradient(d, G), invalid="nan")
    N = _where_unfolded(G, strain.deformation_gradient(gradient(back)))
    S = np.matmul(np.swapaxes(N, -1, -2), N)
    half = np.einsum("...li,...kj->...ijkl", N, S) / 2
    return half + np.swapaxes(half, -4, -3)


def _small_strain(G: Array) -> Array:
    half = np.eye(4).reshape(2, 2, 2, 2) / 2
    return _repeat(half + half.swapaxes(0, 1), G.shape[:-2])


def _biot(G: Array) -> Array:
    four = _four(G)
    d_size, d_xx, d_xy = _d_stretch_tensor(four)
    return _where_unfolded(G, _from_four(_d_symmetric(d_size, d_xx, d_xy)))


def _hencky(G: Array) -> Array:
    four = _four(G)
    size, xx, xy = strain.stretch_tensor(four)
    q, det = xx * xx + xy * xy, determinants(four)[1]
    factor = log_factor(size, q, np.log(det) / 2)
    d_size, d_xx, d_xy = _d_stretch_tensor(four)
    d_q = 2 * (xx[..., None] * d_xx + xy[..., None] * d_xy)
    d_half_log_det = (size[..., None] * d_size - d_q / 2) / det[..., None]
    d_factor = _log_factor_slope(size, q, det, factor)[..., None] * d_q - d_size / det[..., None]
    d_log_xx = factor[..., None] * d_xx + xx[..., None] * d_factor
    d_log_xy = factor[..., None] * d_xy + xy[..., None] * d_factor
    return _where_unfolded(G, _from_four(_d_symmetric(d_half_log_det, d_log_xx, d_log_xy)))


def _area_ratio(G: Array) -> Array:
    F = strain.deformation_gradient(G)
    cofactor = np.stack([F[..., 1, 1], -F[..., 1, 0], -F[..., 0, 1], F[..., 0, 0]], axis=-1)
    return cofactor.reshape(G.shape)


def _principal_values(tensor: Array) -> Array:
    d_radius = _max_shear(tensor) / 2
    d_mean = np.broadcast_to(_IDENTITY / 2, tensor.shape)
    return np.stack([d_mean + d_radius, d_mean - d_radius], axis=-3)


def _max_shear(tensor: Array) -> Array:
    _, a, xy = principal.circle(tensor)
    radius = np.hypot(a, xy)  # where it is 0 there is no derivative: NaN
    return _tensor(a / radius, xy / radius)


def _principal_angle(tensor: Array) -> Array:
    _, a, xy = principal.circle(tensor)
    square = a * a + xy * xy
    return _tensor(-xy / square, a / square) / 4


_OF_SIX: _Table = {
    six_module.displacement: lambda six: _repeat(np.eye(2, 6), six.shape[:-1]),
    six_module.gradient: lambda six: _repeat(GRADIENT_FROM_SIX[2:].reshape(2, 2, 6), six.shape[:-1]),
    affine.inverse_six: _inverse_six,
    affine.exp_six: _exp_six,
    affine.log_six: _log_six,
    affine.coefficients_from_six: lambda six: _log_six(six) / affine.SIX_PER_COEFFICIENT[:, None],
    affine.six_from_coefficients: lambda tau: (
        _exp_six(tau * affine.SIX_PER_COEFFICIENT) * affine.SIX_PER_COEFFICIENT
    ),
}
_OF_GRADIENT: _Table = {
    strain.deformation_gradient: lambda G: _repeat(np.eye(4).reshape(2, 2, 2, 2), G.shape[:-2]),
    strain.green_lagrange: _green_lagrange,
    strain.almansi: _almansi,
    strain.hencky: _hencky,
    strain.biot: _biot,
    strain.small_strain: _small_strain,
    strain.rotation_angle: lambda G: _where_unfolded(G, _from_four(_d_angle(_four(G)))),
    strain.small_rotation: lambda G: _repeat(_FOUR_FROM_G[1] / 2, G.shape[:-2]),
    strain.area_ratio: _area_ratio,
}
_OF_TENSOR: _Table = {
    principal.principal_values: _principal_values,
    principal.principal_angle: _principal_angle,
    principal.max_shear: _max_shear,
}

JACOBIANS: _Table = {**_OF_SIX, **_OF_GRADIENT, **_OF_TENSOR}
"""Function → its derivative.

The derivatives are NaN where the function has none: at maps without inverse or logarithm, at folds, and for
the principal quantities where both principal values are equal.
"""

OF_GRADIENT = frozenset(_OF_GRADIENT)
"""The functions that take a displacement gradient."""


def input_dims(function: Callable[..., Any], otherwise: int) -> int:
    """Number of dimensions of one input: 1 for functions of the six, 2 for those of a gradient or tensor."""
    if function in JACOBIANS:
        return 1 if function in _OF_SIX else 2
    return otherwise


def sandwich(rows: Array) -> Array:
    """Derivative between sixes, from that between their (u, v, u_x, u_y, v_x, v_y), shape (..., 6, 6)."""
    return np.matmul(np.matmul(SIX_FROM_GRADIENT, rows), GRADIENT_FROM_SIX)


def _repeat(constant: Array, leading: tuple[int, ...]) -> Array:
    return np.broadcast_to(constant, (*leading, *constant.shape)).copy()


def flat_rows(derivative: Array, out_dims: int) -> Array:
    """Join the output indices (i) or (i, j) of a derivative by G, and its two input indices."""
    leading = derivative.shape[: derivative.ndim - out_dims - 2]
    return derivative.reshape(*leading, 2**out_dims, 4)


def _four(G: Array) -> Array:
    return six_from_gradient(np.zeros(2), G)[..., 2:]


def _from_four(derivative: Array) -> Array:
    """From ∂/∂(divergence, curl, stretch, shear) to ∂/∂G."""
    return np.einsum("...f,fkl->...kl", derivative, _FOUR_FROM_G)


def _where_unfolded(G: Array, derivative: Array) -> Array:
    folded = np.asarray(determinants(_four(G))[1] <= 0)
    folded = folded.reshape(folded.shape + (1,) * (derivative.ndim - folded.ndim))
    return np.where(folded, np.nan, derivative)


def _tensor(a: Array, xy: Array) -> Array:
    """Twice the ∂/∂T of a function whose derivatives by ½ (T_xx − T_yy) and T_xy are a and xy."""
    return np.stack([a, xy, xy, -a], axis=-1).reshape(*np.shape(a), 2, 2)


def _d_angle(four: Array) -> Array:
    real, imaginary = 1 + four[..., 0] / 2, four[..., 1] / 2
    slope = np.stack([-imaginary, real, np.zeros_like(real), np.zeros_like(real)], axis=-1)
    return slope / (2 * (real * real + imaginary * imaginary))[..., None]


def _d_stretch_tensor(four: Array) -> tuple[Array, Array, Array]:
    """Derivatives of `strain.stretch_tensor` by (divergence, curl, stretch, shear), each (..., 4)."""
    real, imaginary = 1 + four[..., 0] / 2, four[..., 1] / 2
    size, xx, xy = strain.stretch_tensor(four)
    cos, sin, zero = real / size, imaginary / size, np.zeros_like(size)
    d_size = np.stack([cos, sin, zero, zero], axis=-1) / 2
    d_angle = _d_angle(four)
    d_xx = np.stack([zero, zero, cos, sin], axis=-1) / 2 + xy[..., None] * d_angle
    d_xy = np.stack([zero, zero, -sin, cos], axis=-1) / 2 - xx[..., None] * d_angle
    return d_size, d_xx, d_xy


def _d_symmetric(half_trace: Array, xx: Array, xy: Array) -> Array:
    rows = np.stack([half_trace + xx, xy, xy, half_trace - xx], axis=-2)
    return rows.reshape(*rows.shape[:-2], 2, 2, 4)


def _log_factor_slope(p: Array, q: Array, det: Array, factor: Array) -> Array:
    """∂/∂q of artanh(√q/p)/√q, q ≥ 0: (p/det − factor)/2q; Σ k (q/p²)ᵏ⁻¹/(2k + 1) / p³ where q is small."""
    ratio = q / (p * p)
    series = np.zeros_like(ratio)
    for k in range(10, 0, -1):
        series = k / (2 * k + 1) + ratio * series
    return np.where(ratio < 0.03, series / p**3, (p / det - factor) / (2 * q))
