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
eigenvalue λ = exp(−iuτ). The window gives the kernel a bandwidth about (u, v): λ is that of its own wave, and of other
patterns on average; for each of them the derivative kernels below are exact to first order in τ.

(As corrected here: the print has neither window nor DC term; without them the log-polar and hyperbolic kernels are
singular, and respond to a constant.)

The derivative kernel of a generator L_k = a_k·∇ is

    h_k = ∇·(a_k w) = a_k·∇w + w ∇·a_k,   so that   ∂g/∂τ_k = ⟨I, h_k⟩ = −⟨a_k·∇I, w⟩

while the pattern moves along L_k by τ_k: the derivative falls on the smooth kernel, never on the noisy image. It is
analytic: with ψ the logarithm of an exponential term, ∇w = w∇ψ (`geometry`, `window`).
"""

from __future__ import annotations

import abc
import functools
import math
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sixflow.eigenfilters.generators import GeneratorLike, as_generator
from sixflow.eigenfilters.geometry import Geometry, Real, geometry_of, patch, require_radius, safe
from sixflow.eigenfilters.window import Window
from sixflow.errors import InputError

Complex: TypeAlias = NDArray[np.complex128]


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
            h at [y, x]. ∇·(a w) has no response to a constant; the small one that cutting at the edge of the
            patch, and sampling, leave is taken out along the envelope, except for the equal-DC pair.

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
