"""The closed form of `planar`, differentiated: normal, translation and rotation with their covariance.

From the spectrum λ₁ ≥ λ₂ ≥ λ₃, e₁, e₂, e₃ (`spectrum`), for either side ±:

    ρ = λ₁ − λ₃,  a² = (λ₁ − λ₂)/ρ,  b² = 1 − a²,     ∂a² = [∂λ₁ − ∂λ₂ − a² ∂ρ]/ρ,  ∂a = ∂a²/2a,  ∂b = −∂a²/2b
    T̂ = a e₁ ± b e₃,  n̂ = a e₁ ∓ b e₃,  T̃ = ρ T̂,  ω = ω_L − ½ n̂ × T̃,   ω_L the vector of the antisymmetric part

and every derivative by the product rule. The rate of approach, 1/time to contact, is 2λ₂ − λ₁ − λ₃ in both, and
regular. Where a special case is taken, the others have no first order:

- "along normal": one eigenvalue, of the eigenvector e, stands alone; the other two differ by the gap g, of which
  the errors alone make γ² = E g². n̂ and T̂ lie on either side of e at an angle √(g/ρ), in a direction across it;
  an error γ of g turns them by φ, φ² = γ²/(ρ √(g² + γ²)), in any direction. So n̂, T̃ and ω get beside the errors of e
  and ρ the covariance ½ φ² M (I − e eᵀ) Mᵀ, M = (I; ∓ρ I; ±ρ [e]×). Errors drive equal eigenvalues apart, by g ≈ γ;
  for that the rate of approach gets the variance γ². (In trials standardised errors have a spread of 1.1 where the
  motion is along the normal, less beside it, down to 0.4.)
- "pure rotation": T̃ = 0, ω = ω_L. With η² the mean square of ρ from the errors alone, each component of T̃
  gets the variance η²/3, of ω η²/12 (a translation in any direction; the second is a bound).
"""

from __future__ import annotations

import dataclasses
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from sixflow.scenes.arguments import Array, Of
from sixflow.scenes.planar_solution import PlanarSolution
from sixflow.scenes.plane import GRAZING
from sixflow.scenes.rotation import skew, unskew
from sixflow.scenes.spectrum import Spectrum, vanishes

_Pair: TypeAlias = tuple[Array, Array]
"""A value (...) or (..., 3), and its derivative by the coefficients, (..., k) or (..., 3, k)."""


def both_solutions(
    spectrum: Spectrum, known: NDArray[np.bool_], sight: Array, of: Of, level: float
) -> tuple[PlanarSolution, PlanarSolution]:
    """Both solutions with covariance; the visible one and that of less slant first.

    Parameters
    ----------
    spectrum : Spectrum
        Leading dimensions (...).
    known : bool array, shape (...)
        Elsewhere everything is NaN.
    sight : array, shape (k, 3)
        Unit vectors of the image points that show the plane.
    of : "camera" or "object"
    level : float
        Level of significance.
    """
    case, first, equal = _classify(spectrum, level)
    kind = np.where(known, case, "unknown"), first, equal
    one, other = (_solution(spectrum, kind, side, sight, of, level) for side in (1.0, -1.0))
    with np.errstate(invalid="ignore"):
        less = other.normal[..., 2] > one.normal[..., 2]
    swap = np.where(one.visible == other.visible, less, other.visible)
    return _chosen(swap, other, one), _chosen(swap, one, other)


def _classify(spectrum: Spectrum, level: float) -> tuple[NDArray[Any], NDArray[np.bool_], NDArray[np.bool_]]:
    """The case; whether λ₁ stands more alone than λ₃; whether the other two are equal to rounding."""
    (above, above_spread), (below, below_spread) = spectrum.gap(0, 1), spectrum.gap(1, 2)
    first = np.asarray(above[..., 0] >= below[..., 0])
    gap = np.where(first[..., None], below, above)
    spread = np.where(first[..., None, None], below_spread, above_spread)
    parallel = vanishes(gap, spread, spectrum.rounding, level)
    still = vanishes(*spectrum.deviator(), spectrum.rounding, level)
    case = np.where(still, "pure rotation", np.where(parallel, "along normal", "general"))
    return case, first, vanishes(gap, np.zeros_like(spread), spectrum.rounding, level)


def _solution(
    spectrum: Spectrum,
    kind: tuple[NDArray[Any], NDArray[np.bool_], NDArray[np.bool_]],
    side: float,
    sight: Array,
    of: Of,
    level: float,
) -> PlanarSolution:
    case, first, equal = kind
    speed, a, b = _sizes(spectrum, first, equal)
    one = _times(a, (spectrum.vectors[..., 0], spectrum.d_vector(0)))
    three = _times((side * b[0], side * b[1]), (spectrum.vectors[..., 2], spectrum.d_vector(2)))
    n, dn = one[0] - three[0], one[1] - three[1]
    sign, visible = _towards(n, sight)
    n, dn = sign[..., None] * n, sign[..., None, None] * dn
    T, dT = _times(
        speed, (sign[..., None] * (one[0] + three[0]), sign[..., None, None] * (one[1] + three[1]))
    )
    w = unskew(spectrum.L) - np.cross(n, T) / 2
    dw = _d_turn(spectrum) - (skew(n) @ dT - skew(T) @ dn) / 2
    C = spectrum.spread(np.concatenate([dn, dT, dw], axis=-2))
    C = np.where((case == "along normal")[..., None, None], _along_normal(spectrum, first, n, T), C)
    lever = speed[0] * np.where(a[0] * b[0] > 0, a[0] * b[0], 1.0)  # from an eigenvalue to the normal
    finest = np.divide(spectrum.rounding, lever, out=np.ones_like(lever), where=lever > spectrum.rounding)
    facing = vanishes(n[..., :2], C[..., :2, :2], finest, level)
    approach, approach_variance = _approach(spectrum, case, first)

    still, lost = case == "pure rotation", case == "unknown"
    w = np.where(still[..., None], unskew(spectrum.L), w)
    T = np.where(still[..., None], 0.0, T)
    C = np.where(still[..., None, None], _of_rotation(spectrum), C)
    n = np.where((still | lost)[..., None], np.nan, n)
    T, w = (np.where(lost[..., None], np.nan, vector) for vector in (T, w))
    turn = np.repeat([1.0, 1.0, 1.0] if of == "object" else [1.0, -1.0, -1.0], 3)
    return PlanarSolution(
        normal=n,
        translation=turn[3] * T,
        rotation=turn[3] * w,
        approach=np.where(lost, np.nan, approach),
        case=case,
        fronto_parallel=facing & ~still & ~lost,
        visible=visible & ~still & ~lost,
        of=of,
        covariance=np.where(lost[..., None, None], np.nan, C * np.outer(turn, turn)),
        approach_variance=np.where(lost, np.nan, approach_variance),
    )


def _approach(spectrum: Spectrum, case: NDArray[Any], first: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Share of the distance lost per frame interval, 0 where it is so to rounding, and its variance."""
    weights = np.array([-1.0, 2.0, -1.0])
    approach = spectrum.values @ weights
    nothing = (np.abs(approach) <= spectrum.rounding) | (case == "pure rotation")
    slope = np.einsum("i,...ik->...k", weights, spectrum.d_values)
    variance = spectrum.spread(slope[..., None, :])[..., 0, 0]
    apart = np.where(case == "along normal", _gap(spectrum, first)[1], 0.0)
    return np.where(nothing, 0.0, approach), variance + apart


def _sizes(
    spectrum: Spectrum, first: NDArray[np.bool_], equal: NDArray[np.bool_]
) -> tuple[_Pair, _Pair, _Pair]:
    """ρ, a and b with their derivatives; of a or b that is 0 to rounding, 0."""
    values, d_values = spectrum.values, spectrum.d_values
    speed, d_speed = values[..., 0] - values[..., 2], d_values[..., 0, :] - d_values[..., 2, :]
    safe = np.where(speed > 0, speed, 1.0)
    # each from its own gap: 1 − a² would lose what is left of a small b²
    squares = [np.clip((values[..., k] - values[..., k + 1]) / safe, 0.0, 1.0) for k in (0, 1)]
    squares = [np.where(equal, lone, square) for lone, square in zip((first, ~first), squares, strict=True)]
    slope = d_values[..., 0, :] - d_values[..., 1, :] - squares[0][..., None] * d_speed
    sizes = []
    for square, sign in zip(squares, (1.0, -1.0), strict=True):
        root = np.sqrt(square)
        rate = np.divide(sign, 2 * root * safe, out=np.zeros_like(root), where=root > 0)
        sizes.append((root, rate[..., None] * slope))
    return (speed, d_speed), sizes[0], sizes[1]


def _d_turn(spectrum: Spectrum) -> Array:
    """Derivative (3, k) of the vector of the antisymmetric part of L."""
    return np.asarray(unskew(np.moveaxis(spectrum.slope, -1, 0)).T)


def _times(scalar: _Pair, vector: _Pair) -> _Pair:
    """Product of a scalar and a vector, by the product rule."""
    (s, ds), (v, dv) = scalar, vector
    return s[..., None] * v, s[..., None, None] * dv + v[..., :, None] * ds[..., None, :]


def _towards(normal: Array, sight: Array) -> tuple[Array, NDArray[np.bool_]]:
    """The sign with which the normal points to the plane that is seen, and whether it is seen everywhere."""
    cosines = normal @ sight.T
    sign = np.where(cosines.sum(axis=-1) >= 0, 1.0, -1.0)
    return sign, np.asarray((sign[..., None] * cosines > GRAZING).all(axis=-1))


def _along_normal(spectrum: Spectrum, first: NDArray[np.bool_], n: Array, T: Array) -> Array:
    """Covariance of a motion along the normal: of e and ρ to first order, and ½ φ² M (I − e eᵀ) Mᵀ."""
    choose = first[..., None]
    e = np.where(choose, spectrum.vectors[..., 0], spectrum.vectors[..., 2])
    sign = np.where((e * n).sum(axis=-1) >= 0, 1.0, -1.0)
    e = sign[..., None] * e
    de = np.where(choose[..., None], spectrum.d_vector(0), spectrum.d_vector(2)) * sign[..., None, None]
    speed = (e * T).sum(axis=-1)  # ± ρ
    d_speed = spectrum.d_values[..., 0, :] - spectrum.d_values[..., 2, :]
    d_speed = np.where(speed >= 0, 1.0, -1.0)[..., None] * d_speed
    _, dT = _times((speed, d_speed), (e, de))
    dw = np.broadcast_to(_d_turn(spectrum), dT.shape)
    gap, noise = _gap(spectrum, first)
    scale = np.abs(speed) * np.sqrt(gap**2 + noise)
    square = np.divide(noise, scale, out=np.zeros_like(noise), where=scale > 0)[..., None, None]
    across = np.eye(3) - e[..., :, None] * e[..., None, :]
    along = speed[..., None, None]
    M = np.concatenate([across, -along * across, along * skew(e) @ across], axis=-2)
    beyond = square / 2 * M @ np.swapaxes(M, -1, -2)
    return np.asarray(spectrum.spread(np.concatenate([de, dT, dw], axis=-2)) + beyond)


def _gap(spectrum: Spectrum, first: NDArray[np.bool_]) -> tuple[Array, Array]:
    """The gap g between the two eigenvalues that do not stand alone, and the mean square γ² that errors make."""
    (below, below_spread), (above, above_spread) = spectrum.gap(1, 2), spectrum.gap(0, 1)
    noise = np.where(first, *(np.einsum("...ii->...", C) for C in (below_spread, above_spread)))
    return np.where(first, below[..., 0], above[..., 0]), noise


def _of_rotation(spectrum: Spectrum) -> Array:
    """Covariance of a pure rotation: normal undetermined, translation 0 within the errors."""
    _, deviator = spectrum.deviator()
    square = 2 * np.einsum("...ii->...", deviator)[..., None]
    d_rotation = unskew(np.moveaxis(spectrum.slope, -1, 0)).T
    C = np.zeros((*spectrum.rounding.shape, 9, 9))
    C[..., 6:, 6:] = spectrum.spread(
        np.broadcast_to(d_rotation, (*spectrum.rounding.shape, *d_rotation.shape))
    )
    C[..., range(3), range(3)] = np.inf
    C[..., range(3, 6), range(3, 6)] = square / 3
    C[..., range(6, 9), range(6, 9)] += square / 12
    return C


def _chosen(swap: NDArray[np.bool_], one: PlanarSolution, other: PlanarSolution) -> PlanarSolution:
    """One solution where `swap` holds, the other elsewhere."""

    def pick(name: str) -> Any:
        a, b = np.asarray(getattr(one, name)), np.asarray(getattr(other, name))
        return np.where(swap.reshape(swap.shape + (1,) * (a.ndim - swap.ndim)), a, b)[()]

    names = [field.name for field in dataclasses.fields(PlanarSolution) if field.name != "of"]
    return PlanarSolution(of=one.of, **{name: pick(name) for name in names})
