"""Canonical coordinates of two commuting generators (Eagleson, §§4.3 and 4.4).

In coordinates (η, ξ) with

    L₁η = 1,  L₁ξ = 0,  L₂η = 0,  L₂ξ = 1

the deformation exp(τ₁L₁ + τ₂L₂) is the translation (τ₁, τ₂), and J dx dy = dη dξ, with the Jacobian
J = |∂(η, ξ)/∂(x, y)|, does not change under it. Hence the eigenfunctions J exp(−i(uη + vξ)).

    L₁, L₂     η                      ξ               J             singular       sectors
    L_x, L_y   x                      y               1             nowhere        1
    L_s, L_r   log r                  atan2(y, x)     1/r²          r = 0          1
    L_b, L_s   ½ log|x/y|             ½ log|xy|       1/(2|xy|)     x = 0, y = 0   4
    L_B, L_s   ½ log|(x+y)/(x−y)|     ½ log|x²−y²|    1/|x²−y²|     y = ±x         4

(As corrected here: atan2 for the print's tan⁻¹(y/x), which is cut at x = 0. The print pairs L_b with L_B in
§4.4, for which no such coordinates exist, since [L_b, L_B] = 2 L_r; each of them commutes with L_s. Its
η_b = −½ log(y/x) and ξ_B = tanh⁻¹(y/x) hold in a part of the plane only; the absolute values extend them.)

The singular lines are invariant lines of the flows, which never cross them. They bound the *sectors*, in each of
which (η, ξ) ↔ (x, y) is one to one, numbered from x towards y by the direction of their axis:

    pair       0           1           2           3           signs of
    L_b, L_s   45°: + +    135°: − +   225°: − −   315°: + −   x, y
    L_B, L_s   0°: + +     90°: + −    180°: − −   270°: − +   x + y, x − y
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from sixflow.array_checks import Array, as_floats, require_broadcast, silent
from sixflow.convention.six import GENERATOR_NAMES
from sixflow.eigenfilters.generators import (
    L_B,
    Generator,
    GeneratorLike,
    L_b,
    L_r,
    L_s,
    L_x,
    L_y,
    as_generator,
    bracket,
    positions,
)
from sixflow.errors import InputError


@dataclass(frozen=True)
class CanonicalCoordinates(ABC):
    """Canonical coordinates (η, ξ) of two commuting generators; made by `canonical`.

    Positions x, y are relative to the centre of the operator, px, y down, and broadcast together. On the
    singular lines η, ξ and J are infinite or NaN, without warnings. float32 is kept.

    Attributes
    ----------
    first, second : Generator
        L₁, which translates η, and L₂, which translates ξ.
    eta_name, xi_name : str
        The coordinates as formulas.
    units : str
        Of both: "px" or "1".
    sectors : int
        How many sectors there are.
    xi_period : float
        2π if ξ is an angle, else infinite.
    """

    first: Generator
    second: Generator

    eta_name: ClassVar[str]
    xi_name: ClassVar[str]
    units: ClassVar[str] = "1"
    sectors: ClassVar[int] = 1
    xi_period: ClassVar[float] = math.inf

    @silent
    def eta(self, x: ArrayLike, y: ArrayLike) -> Array:
        """η with L₁η = 1 and L₂η = 0, of the broadcast shape of x and y, in `units`."""
        return self._coordinates(*positions(x, y))[0][()]

    @silent
    def xi(self, x: ArrayLike, y: ArrayLike) -> Array:
        """ξ with L₁ξ = 0 and L₂ξ = 1, of the broadcast shape of x and y, in `units`."""
        return self._coordinates(*positions(x, y))[1][()]

    @silent
    def jacobian(self, x: ArrayLike, y: ArrayLike) -> Array:
        """J = |∂(η, ξ)/∂(x, y)| ≥ 0 of the broadcast shape: 1, or px⁻²; infinite on the singular lines."""
        return self._jacobian(*positions(x, y))[()]

    def sector(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Number of the sector, int64 of the broadcast shape; −1 on the singular lines and for NaN."""
        return self._sector(*positions(x, y)).astype(np.int64)[()]

    def singular_distance(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Distance, px, to the nearest point where the coordinates are singular; for tapering kernels."""
        return self._singular_distance(*positions(x, y))[()]

    @silent
    def inverse(self, eta: ArrayLike, xi: ArrayLike, sector: ArrayLike = 0) -> tuple[Array, Array]:
        """The point (x, y) of the coordinates (η, ξ) in a sector.

        Parameters
        ----------
        eta, xi : arrays
            In `units`.
        sector : array of int
            0 … `sectors` − 1. All three broadcast together.

        Returns
        -------
        x, y : arrays of the broadcast shape
            px, relative to the centre.

        Raises
        ------
        InputError
            If eta or xi are not real numbers, if there is no such sector, or the shapes do not broadcast.
        """
        eta, xi, number = as_floats("eta", eta, ()), as_floats("xi", xi, ()), np.asarray(sector)
        require_broadcast(eta=eta.shape, xi=xi.shape, sector=number.shape)
        if number.dtype.kind not in "iu" or ((number < 0) | (number >= self.sectors)).any():
            raise InputError(f"sector={sector!r}: must be whole, 0 … {self.sectors - 1}")
        x, y = self._inverse(*np.broadcast_arrays(eta, xi, number))
        return x[()], y[()]

    @abstractmethod
    def _coordinates(self, x: Array, y: Array) -> tuple[Array, Array]: ...

    @abstractmethod
    def _inverse(self, eta: Array, xi: Array, sector: Array) -> tuple[Array, Array]: ...

    @abstractmethod
    def _jacobian(self, x: Array, y: Array) -> Array: ...

    @abstractmethod
    def _singular_distance(self, x: Array, y: Array) -> Array: ...

    def _sector(self, x: Array, y: Array) -> Array:
        return np.where(self._singular_distance(x, y) > 0, 0, -1)


@dataclass(frozen=True)
class Cartesian(CanonicalCoordinates):
    """(x, y) of the pair (L_x, L_y): eigenfunctions are plane waves (Eagleson, §4.2)."""

    eta_name: ClassVar[str] = "x"
    xi_name: ClassVar[str] = "y"
    units: ClassVar[str] = "px"

    def _coordinates(self, x: Array, y: Array) -> tuple[Array, Array]:
        return x.copy(), y.copy()

    def _inverse(self, eta: Array, xi: Array, sector: Array) -> tuple[Array, Array]:
        return eta.copy(), xi.copy()

    def _jacobian(self, x: Array, y: Array) -> Array:
        return np.ones(x.shape, dtype=np.result_type(x, y))

    def _singular_distance(self, x: Array, y: Array) -> Array:
        return np.where(np.isnan(x) | np.isnan(y), x + y, np.inf).astype(np.result_type(x, y))


@dataclass(frozen=True)
class LogPolar(CanonicalCoordinates):
    """(log r, atan2(y, x)) of the pair (L_s, L_r) (Eagleson, §4.3; as corrected here: atan2)."""

    eta_name: ClassVar[str] = "log r"
    xi_name: ClassVar[str] = "atan2(y, x)"
    xi_period: ClassVar[float] = 2 * math.pi

    def _coordinates(self, x: Array, y: Array) -> tuple[Array, Array]:
        return np.log(np.hypot(x, y)), np.arctan2(y, x)

    def _inverse(self, eta: Array, xi: Array, sector: Array) -> tuple[Array, Array]:
        return np.exp(eta) * np.cos(xi), np.exp(eta) * np.sin(xi)

    def _jacobian(self, x: Array, y: Array) -> Array:
        return 1 / (x * x + y * y)

    def _singular_distance(self, x: Array, y: Array) -> Array:
        return np.hypot(x, y)


@dataclass(frozen=True)
class Hyperbolic(CanonicalCoordinates):
    """(½ log|p/q|, ½ log|pq|) of a shear and the divergence (Eagleson, §4.4; as corrected here).

    p = x, q = y for L_b, and p = x + y, q = x − y for L_B.
    """

    sectors: ClassVar[int] = 4
    factor: ClassVar[float]  # |∂(p, q)/∂(x, y)|
    signs: ClassVar[tuple[tuple[int, int], ...]]  # of (p, q), in the order of the sectors

    def _coordinates(self, x: Array, y: Array) -> tuple[Array, Array]:
        p, q = self._factors(x, y)
        log_p, log_q = np.log(np.abs(p)), np.log(np.abs(q))
        return (log_p - log_q) / 2, (log_p + log_q) / 2

    def _inverse(self, eta: Array, xi: Array, sector: Array) -> tuple[Array, Array]:
        sign_p, sign_q = np.moveaxis(np.array(self.signs, dtype=np.result_type(eta, xi))[sector], -1, 0)
        return self._point(sign_p * np.exp(xi + eta), sign_q * np.exp(xi - eta))

    def _jacobian(self, x: Array, y: Array) -> Array:
        p, q = self._factors(x, y)
        return self.factor / (2 * np.abs(p * q))

    def _singular_distance(self, x: Array, y: Array) -> Array:
        p, q = self._factors(x, y)
        return np.minimum(np.abs(p), np.abs(q)) / math.sqrt(self.factor)

    def _sector(self, x: Array, y: Array) -> Array:
        p, q = self._factors(x, y)
        sector = np.full(p.shape, -1)
        for number, (sign_p, sign_q) in enumerate(self.signs):
            sector[(sign_p * p > 0) & (sign_q * q > 0)] = number
        return sector

    @abstractmethod
    def _factors(self, x: Array, y: Array) -> tuple[Array, Array]: ...

    @abstractmethod
    def _point(self, p: Array, q: Array) -> tuple[Array, Array]: ...


@dataclass(frozen=True)
class Stretch(Hyperbolic):
    """(½ log|x/y|, ½ log|xy|) of the pair (L_b, L_s)."""

    eta_name: ClassVar[str] = "½ log|x/y|"
    xi_name: ClassVar[str] = "½ log|xy|"
    factor: ClassVar[float] = 1.0
    signs: ClassVar[tuple[tuple[int, int], ...]] = ((1, 1), (-1, 1), (-1, -1), (1, -1))

    def _factors(self, x: Array, y: Array) -> tuple[Array, Array]:
        return x, y

    def _point(self, p: Array, q: Array) -> tuple[Array, Array]:
        return p, q


@dataclass(frozen=True)
class Shear(Hyperbolic):
    """(½ log|(x+y)/(x−y)|, ½ log|x²−y²|) of the pair (L_B, L_s): the former turned by −45°."""

    eta_name: ClassVar[str] = "½ log|(x+y)/(x−y)|"
    xi_name: ClassVar[str] = "½ log|x²−y²|"
    factor: ClassVar[float] = 2.0
    signs: ClassVar[tuple[tuple[int, int], ...]] = ((1, 1), (1, -1), (-1, -1), (-1, 1))

    def _factors(self, x: Array, y: Array) -> tuple[Array, Array]:
        return x + y, x - y

    def _point(self, p: Array, q: Array) -> tuple[Array, Array]:
        return (p + q) / 2, (p - q) / 2


_PAIRS: dict[tuple[Generator, Generator], Callable[[Generator, Generator], CanonicalCoordinates]] = {
    (L_x, L_y): Cartesian,
    (L_s, L_r): LogPolar,
    (L_b, L_s): Stretch,
    (L_B, L_s): Shear,
}


def canonical(first: GeneratorLike, second: GeneratorLike) -> CanonicalCoordinates:
    """Canonical coordinates of a commuting pair of generators (Eagleson, §4.3.2).

    Parameters
    ----------
    first, second : Generator or str
        (L_x, L_y), (L_s, L_r), (L_b, L_s) or (L_B, L_s), as objects, symbols ("L_s") or names ("divergence").

    Raises
    ------
    InputError
        If one of them is none of the six generators, if they do not commute, are one and the same, or stand in
        the reverse order.

    Examples
    --------
    A zoom by 1.5 is the translation of log r by log 1.5:

    >>> import numpy as np
    >>> log_polar = canonical("divergence", "curl")
    >>> (log_polar.eta(4.5, 6.0) - log_polar.eta(3.0, 4.0)).round(12) == np.log(1.5).round(12)
    np.True_
    >>> log_polar.jacobian(3.0, 4.0)
    np.float64(0.04)
    """
    L1, L2 = as_generator(first, "first"), as_generator(second, "second")
    known = " or ".join(f"({a.symbol}, {b.symbol})" for a, b in _PAIRS)
    if (L1, L2) in _PAIRS:
        return _PAIRS[L1, L2](L1, L2)
    asked = f"first={L1.symbol} ({L1.name}), second={L2.symbol} ({L2.name})"
    if L1 == L2:
        raise InputError(f"{asked}: one generator makes one coordinate; give two, {known}")
    if (L2, L1) in _PAIRS:
        raise InputError(
            f"{asked}: in reverse order; use canonical({L2.name!r}, {L1.name!r}), whose ξ belongs to {L1.symbol}"
        )
    raise InputError(
        f"{asked}: do not commute, [{L1.symbol}, {L2.symbol}] = {_operator(bracket(L1, L2))}, and have no common "
        f"canonical coordinates; give {known}"
    )


def _operator(coefficients: Array) -> str:
    """'2 L_r' or '−L_x' from the coefficients of the six generators."""
    terms = []
    for c, symbol in zip(coefficients.tolist(), GENERATOR_NAMES, strict=True):
        if c:
            size = "" if abs(c) == 1 else f"{abs(c):g} "
            terms.append(f"{'−' if c < 0 else ''}{size}{symbol}")
    return " + ".join(terms)
