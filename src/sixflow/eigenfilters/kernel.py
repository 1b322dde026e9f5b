"""What every kernel is: an eigenfunction of two commuting generators, localised, sampled, and its derivatives.

For a pair (L₁, L₂) with canonical coordinates (η, ξ) the kernel is (Eagleson, §4.3.2)

    w(x, y) = gain · A(x, y) [s(x, y) exp(−i(uη + vξ) + iφ) − dc],   A = |∂(η, ξ)/∂(x, y)| · window

| symbol | name |
|---|---|
| (L₁, L₂) | `generators` |
| (u, v) | `orders` |
| A | envelope: Jacobian (optional) times window |
| s | signs of the sectors that the singular axes of the pair cut the plane into |
| φ | `phase`, 0 except for the equal-DC pair |
| dc | a constant, such that the samples of w sum to 0 |
| gain | a constant, such that Σ|w|² = 1: white noise of variance σ² gives a response of variance σ² |

The response at p is the correlation g = Σ_o I(p + o) w(o) over the pixels o of a square patch, rows (y) first.
Where the pattern moves along L₁ by τ (`I1(exp(τL₁) x) = I0(x)`), η grows by τ and g is multiplied by the
eigenvalue λ = exp(−iuτ); the window and the DC term make this a law to first order in (τ / width of the window).

(As corrected here: the print has neither window nor DC term; without them the log-polar and hyperbolic kernels are
singular, and respond to a constant.)

The derivative kernel of a generator L_k = a_k·∇ is

    h_k = ∇·(a_k w) = a_k·∇w + w ∇·a_k,   so that   ∂g/∂τ_k = ⟨I, h_k⟩ = −⟨a_k·∇I, w⟩

while the pattern moves along L_k by τ_k: the derivative falls on the smooth kernel, never on the noisy image. It is
analytic. With ψ = log of an exponential term, ∇w = w∇ψ; the gradients follow from the fields of the pair alone,

    ∇η = (b_y, −b_x)/D,   ∇ξ = (−a_y, a_x)/D,   D = a_x b_y − a_y b_x = ± 1/|J|,
    ∇log|J| = −(∇·a) ∇η − (∇·b) ∇ξ,

a and b being the fields of L₁ and L₂.
"""

from __future__ import annotations

import abc
import functools
import math
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sixflow.eigenfilters.coordinates import canonical
from sixflow.eigenfilters.generators import Generator, GeneratorLike, as_generator
from sixflow.errors import InputError

Complex: TypeAlias = NDArray[np.complex128]
Real: TypeAlias = NDArray[np.float64]

LARGEST_RADIUS = 512


class Geometry(NamedTuple):
    """Canonical coordinates of a pair at points, all shape (n,).

    Attributes
    ----------
    eta, xi : arrays
        Canonical coordinates.
    grad_eta, grad_xi : arrays, shape (2, n)
        Their gradients, 1/px.
    log_jacobian : array
        log |∂(η, ξ)/∂(x, y)|.
    grad_log_jacobian : array, shape (2, n)
        Its gradient, 1/px.
    """

    eta: Real
    xi: Real
    grad_eta: Real
    grad_xi: Real
    log_jacobian: Real
    grad_log_jacobian: Real


class Window(NamedTuple):
    """Logarithm of a window, (n,), and its gradient, (2, n); windows are multiplied by `times`."""

    log: Real
    gradient: Real

    def times(self, other: Window) -> Window:
        """Product of two windows."""
        return Window(self.log + other.log, self.gradient + other.gradient)


class Terms(NamedTuple):
    """What a kernel and its gradient are made of: w = gain · envelope · (carrier − dc).

    Attributes
    ----------
    envelope : array, shape (n,)
        A.
    carrier : array, shape (n,)
        s exp(−i(uη + vξ) + iφ).
    slope, turn : arrays, shape (2, n)
        Gradients of the logarithms of the two, 1/px.
    """

    envelope: Real
    carrier: Complex
    slope: Real
    turn: Complex


@dataclass(frozen=True)
class Kernel(abc.ABC):
    """A recipe of a complex kernel: equal recipes are equal, and give the same samples.

    A family subclasses it and defines `generators`, `orders`, `label` and `_window`.
    """

    @property
    @abc.abstractmethod
    def generators(self) -> tuple[str, str]:
        """Symbols of the commuting pair (L₁, L₂) that the kernel is an eigenfunction of."""

    @property
    @abc.abstractmethod
    def orders(self) -> tuple[float, float]:
        """The orders (u, v): the phase changes by −u and −v per unit of τ of the two generators."""

    @property
    @abc.abstractmethod
    def label(self) -> str:
        """One short line for tables and pictures."""

    @property
    def dc_free(self) -> bool:
        """Whether the kernel has no response to a constant."""
        return True

    @property
    def phase(self) -> float:
        """Constant phase φ, rad."""
        return 0.0

    @property
    def with_jacobian(self) -> bool:
        """Whether the envelope has the Jacobian of the canonical coordinates."""
        return True

    @abc.abstractmethod
    def _window(self, x: Real, y: Real, geometry: Geometry) -> Window:
        """Logarithm of the window and its gradient, away from singular points."""

    def _signs(self, x: Real, y: Real) -> Real:
        """Sign s of the sector of each point."""
        return np.ones_like(x)

    def sample(self, radius: int) -> Complex:
        """The kernel on a square patch of whole pixels.

        Parameters
        ----------
        radius : int
            Of the patch, px, 1 to 512: offsets −radius … radius in both directions.

        Returns
        -------
        complex128 array, shape (2 radius + 1, 2 radius + 1)
            w at [y, x]; real and imaginary part are the even and odd operator of the paper's pair. Σ|w|² = 1,
            and Σ w = 0 to rounding (except for the equal-DC pair).

        Raises
        ------
        InputError
            If the radius is no such number, or the kernel vanishes on all pixels of the patch.
        """
        radius = require_radius(radius)
        gain, dc = _constants(self, radius)
        envelope, carrier, _, _ = _on_patch(self, radius)
        return (gain * envelope * (carrier - dc)).reshape(2 * radius + 1, -1)

    def derivative(self, generator: GeneratorLike, radius: int) -> Complex:
        """The derivative kernel h = ∇·(a w) of one of the six generators on a square patch.

        ∂⟨I, w⟩/∂τ = ⟨I, h⟩ while the pattern moves along the generator by τ: for u and v, τ is that
        displacement; for divergence, curl, stretch and shear it is half of that number.

        Parameters
        ----------
        generator : Generator or str
            By symbol (L_x, L_y, L_s, L_r, L_b, L_B) or name (u, v, divergence, curl, stretch, shear).
        radius : int
            Of the patch, px, as in `sample`.

        Returns
        -------
        complex128 array, shape (2 radius + 1, 2 radius + 1)
            h at [y, x]. ∇·(a w) has no response to a constant; the small one that is left by cutting the
            window at the edge of the patch is taken out, except for the equal-DC pair.

        Raises
        ------
        InputError
            If there is no such generator, or the radius cannot be used.
        """
        radius, L = require_radius(radius), as_generator(generator)
        gain, dc = _constants(self, radius)
        envelope, carrier, slope, turn = _on_patch(self, radius)
        a_x, a_y = L.field(*patch(radius))
        w = gain * envelope * (carrier - dc)
        h = w * (L.divergence + a_x * slope[0] + a_y * slope[1])
        h += gain * envelope * carrier * (a_x * turn[0] + a_y * turn[1])
        if self.dc_free:
            h -= envelope * (h.sum() / envelope.sum())
        return h.reshape(2 * radius + 1, -1)

    def evaluate(self, x: ArrayLike, y: ArrayLike, radius: int) -> Complex:
        """The kernel at any real coordinates, with the gain and DC term of a patch.

        Parameters
        ----------
        x, y : arrays
            Coordinates relative to the centre, px; any shapes that broadcast.
        radius : int
            Of the patch whose constants are used, px; `evaluate` equals `sample` at its pixels.

        Returns
        -------
        complex128 array
            In the broadcast shape; 0 at singular points.

        Raises
        ------
        InputError
            If the radius cannot be used.
        """
        gain, dc = _constants(self, require_radius(radius))
        first, second = np.broadcast_arrays(np.asarray(x, np.float64), np.asarray(y, np.float64))
        envelope, carrier, _, _ = self._terms(first.ravel(), second.ravel())
        return (gain * envelope * (carrier - dc)).reshape(first.shape)

    def _terms(self, x: Real, y: Real) -> Terms:
        """What the kernel and its gradient are made of, at points."""
        with np.errstate(all="ignore"):
            geometry, regular = geometry_of(self.generators, x, y)
            window = self._window(*safe(x, y, regular), geometry)
            log_envelope, slope = window.log.copy(), window.gradient.copy()
            if self.with_jacobian:
                log_envelope += geometry.log_jacobian
                slope += geometry.grad_log_jacobian
            envelope = np.where(regular, np.exp(log_envelope), 0.0)
        u, v = self.orders
        carrier = self._signs(x, y) * np.exp(1j * (self.phase - u * geometry.eta - v * geometry.xi))
        turn = -1j * (u * geometry.grad_eta + v * geometry.grad_xi)
        as_complex = functools.partial(np.asarray, dtype=np.complex128)
        return Terms(np.asarray(envelope, np.float64), as_complex(carrier), slope, as_complex(turn))


@functools.lru_cache(maxsize=8)
def _on_patch(kernel: Kernel, radius: int) -> Terms:
    return kernel._terms(*patch(radius))


@functools.lru_cache(maxsize=1024)
def _constants(kernel: Kernel, radius: int) -> tuple[float, complex]:
    """Gain and DC term of a kernel on a patch."""
    envelope, carrier, _, _ = _on_patch(kernel, radius)
    largest = float(envelope.max())
    if not (math.isfinite(largest) and largest > 0):
        raise InputError(f"radius={radius}: {kernel} vanishes on the whole patch; make its window wider")
    dc = complex((envelope * carrier).sum() / envelope.sum()) if kernel.dc_free else 0j
    power = math.sqrt(float((np.abs(envelope / largest * (carrier - dc)) ** 2).sum()))
    if not power > 1e-6:
        raise InputError(f"radius={radius}: {kernel} is constant on the patch; raise its order or its width")
    return 1 / (power * largest), dc


def geometry_of(pair: tuple[str, str], x: Real, y: Real) -> tuple[Geometry, NDArray[np.bool_]]:
    """Canonical coordinates of a pair, and where they are regular; elsewhere they are those of another point."""
    first, second = as_generator(pair[0]), as_generator(pair[1])
    regular = np.abs(_determinant(first, second, x, y)) > 1e-12
    x, y = safe(x, y, regular)
    coordinates = canonical(*pair)
    (a_x, a_y), (b_x, b_y) = first.field(x, y), second.field(x, y)
    D = a_x * b_y - a_y * b_x
    grad_eta, grad_xi = np.stack([b_y / D, -b_x / D]), np.stack([-a_y / D, a_x / D])
    return Geometry(
        coordinates.eta(x, y),
        coordinates.xi(x, y),
        grad_eta,
        grad_xi,
        -np.log(np.abs(D)),
        -first.divergence * grad_eta - second.divergence * grad_xi,
    ), regular


def safe(x: Real, y: Real, regular: NDArray[np.bool_]) -> tuple[Real, Real]:
    """The points, with a point where every pair is regular in place of singular ones."""
    return np.where(regular, x, 2.0), np.where(regular, y, 1.0)


def _determinant(first: Generator, second: Generator, x: Real, y: Real) -> Real:
    (a_x, a_y), (b_x, b_y) = first.field(x, y), second.field(x, y)
    return np.asarray(a_x * b_y - a_y * b_x, np.float64)


def patch(radius: int) -> tuple[Real, Real]:
    """Offsets x and y of the pixels of a square patch, row by row, shape ((2 radius + 1)²,)."""
    offsets = np.arange(-radius, radius + 1, dtype=np.float64)
    y, x = np.meshgrid(offsets, offsets, indexing="ij")
    return x.ravel(), y.ravel()


def require_radius(radius: Any) -> int:
    """Return a radius of a patch as an int.

    Raises
    ------
    InputError
        If it is no whole number from 1 to 512.
    """
    whole = isinstance(radius, int | np.integer) and not isinstance(radius, bool)
    if not (whole and 1 <= radius <= LARGEST_RADIUS):
        raise InputError(f"radius={radius!r}: must be a whole number of px from 1 to {LARGEST_RADIUS}")
    return int(radius)
