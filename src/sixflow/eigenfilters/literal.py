"""The literal reading of the paper: each operator alone, and its phase shift is the deformation (Eagleson, §4).

While the pattern moves along a generator of its pair by τ, the response of a kernel of order u is multiplied by the
eigenvalue λ = exp(−iuτ) (eq. (5)). Read alone,

    τ = −Δφ/u,   Δφ = arg(g1/g0), from −π (excluded) to π

so that |uτ| < π can be measured. The standard error by grey noise of standard deviation σ in both frames is
about σ/(|g| |u|). In a sequence of frames the temporal derivative takes the place of the second frame: the
phase velocity is −Im(g_t/g)/u, with g and g_t weighted over the frames by `temporal_weights`.

*What the law leaves out.* The window of a kernel does not move with the pattern. The response turns at the
instantaneous frequency of the pattern under the window instead of at u,

    ν = −Im(h/g),   h = ⟨I, ∇·(a w)⟩ = dg/dτ

(`sixflow.eigenfilters.kernel`), and −Δφ/u is wrong by the part ν/u − 1 of τ: by 1/(√2 b u) typically, for a
Gaussian window of standard deviation b in the canonical coordinate. Rotation is the exception: windows of r only turn
into themselves, ν = u, and the reading is exact. "Phase over instantaneous frequency", −Δφ/ν with ν the mean of both
frames, integrates ν by the trapezoid rule: for all generators its error is of the order τ³. It wraps where |ντ| = π.

*Stability* (Fleet & Jepson 1993). Near the zeros of a response its phase turns at any rate, and means nothing. An
operator is stable at a point if in both frames

    |g| ≥ least_amplitude · σ   and   |h/g + iu| ≤ departure · |u|

The second bounds the departure of ν from u together with the change Re(h/g) of the logarithmic amplitude, both in units
of the order; to first order a stable reading of a pure motion is right to that part. (For two orders: the root of
the sum of squares over both, in units of √(u² + v²).)

*Pairs.* An operator with both orders sees −(uτ₁ + vτ₂). `LiteralEstimate.tau` reads it twice, each time as if the
other motion were 0; `LiteralEstimate.combine` separates them by least squares over all operators of the pair.

| symbol | name |
|---|---|
| Δφ, arg(g1/g0) | `phase` |
| abs(g), abs(g1/g0) | `amplitude`, `amplitude_ratio` |
| u, v | `orders` |
| ν | `frequency` |
| σ | `noise` |

References
----------
D. J. Fleet and A. D. Jepson, "Stability of phase information", IEEE Transactions on Pattern Analysis and Machine
Intelligence 15, 1253–1268 (1993).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sixflow.checks import number
from sixflow.convention.six import GENERATOR_NAMES
from sixflow.eigenfilters.bank import FilterBank
from sixflow.eigenfilters.geometry import Real
from sixflow.eigenfilters.kernel import Complex, Kernel
from sixflow.eigenfilters.patches import finite_frame, patch_blocks
from sixflow.eigenfilters.reading import LiteralEstimate, orders_of
from sixflow.eigenfilters.temporal import TemporalKind, temporal_weights
from sixflow.errors import InputError


class _Reading(NamedTuple):
    """The attributes of `LiteralEstimate` that a block of points fills in."""

    phase: Real
    amplitude: Real
    amplitude_ratio: Real
    frequency: Real
    stable: NDArray[np.bool_]
    sensitivity: Complex


class LiteralOperator:
    """One operator, or each operator of a bank alone: phase shift over order.

    Parameters
    ----------
    bank : FilterBank or Kernel
    radius : int, optional
        Of the patch of a single kernel, px; a bank has its own.
    noise : float
        Standard deviation σ of the grey noise of one frame, at least 0. Standard errors are proportional to it.
    least_amplitude : float
        Least |g| of a stable response, in σ, at least 0. At the default of 4, the phase shift has a standard
        error of 0.25 rad.
    departure : float
        Largest |h/g + iu| of a stable response, in units of the order, above 0. The default, 0.35, is that of Fleet and
        Jepson's tests for their filters of 0.8 octave; smaller is stricter.

    Raises
    ------
    InputError
        If the bank is none, a single kernel has no radius, or a number is out of range.

    Examples
    --------
    A turn by 0.1 rad, about the centre of the operator:

    >>> from sixflow import synth
    >>> from sixflow.eigenfilters.kernels import Spiral
    >>> made = synth.pair(synth.Speckle(), synth.Affine.rotation(0.1, centre=(30, 30)), (61, 61))
    >>> curl = LiteralOperator(Spiral(0.0, 4, scale=10.0, bandwidth=0.3), radius=30)
    >>> found = curl.estimate(made.frame0, made.frame1, [30], [30])
    >>> print(f"{found.phase[0, 0]:.3f} rad, τ = {found.tau[0, 0, 3]:.4f} ± {found.standard_error[0, 0, 3]:.4f}")
    -0.400 rad, τ = 0.1000 ± 0.0024
    """

    def __init__(
        self,
        bank: FilterBank | Kernel,
        *,
        radius: int | None = None,
        noise: float = 1.0,
        least_amplitude: float = 4.0,
        departure: float = 0.35,
    ) -> None:
        if isinstance(bank, Kernel):
            if radius is None:
                raise InputError("radius=None: a single kernel needs the radius of its patch, px")
            bank = FilterBank((bank,), radius)
        elif not isinstance(bank, FilterBank):
            raise InputError(f"bank={bank!r}: must be a FilterBank, or one kernel with radius=")
        elif radius not in (None, bank.radius):
            raise InputError(f"radius={radius!r}: the bank has its own, {bank.radius}; leave it out")
        self.bank = bank
        self.noise = number("noise", noise, least=0, unit="grey values")
        self.least_amplitude = number("least_amplitude", least_amplitude, least=0)
        self.departure = number("departure", departure, above=0)
        own = [[GENERATOR_NAMES.index(name) for name in kernel.generators] for kernel in bank.kernels]
        self._own = np.array(own)
        slopes = np.take_along_axis(bank.derivatives, self._own[:, :, None], axis=1)
        self._matrix = np.concatenate([bank.matrix, slopes.reshape(-1, bank.size**2)]).T

    def estimate(self, frame0: ArrayLike, frame1: ArrayLike, x: ArrayLike, y: ArrayLike) -> LiteralEstimate:
        """Read the motion from frame 0 to frame 1 about each point.

        Parameters
        ----------
        frame0, frame1 : arrays of real numbers, shape (height, width)
            Finite; continued by reflection beyond their borders.
        x, y : arrays of whole numbers, shape (points,)
            Centres, px, inside the frame.

        Raises
        ------
        InputError
            If a frame is none, is not finite or smaller than the patch, or a point is no pixel of it.
        """
        frames = finite_frame(frame0, "frame0"), finite_frame(frame1, "frame1")

        def read(patches: list[NDArray[Any]]) -> _Reading:
            (g0, rates0), (g1, rates1) = (self._respond(part) for part in patches)
            ratio = g1 / g0
            phase = np.angle(ratio)
            return _Reading(
                np.where(phase <= -np.pi, np.pi, phase),
                np.sqrt(np.abs(g0) * np.abs(g1)),
                np.abs(ratio),
                -(rates0.imag + rates1.imag) / 2,
                self._passes(g0, rates0, patches[0]) & self._passes(g1, rates1, patches[1]),
                np.stack([-1 / g0, 1 / g1]),
            )

        return self._over_blocks(frames, x, y, read)

    def velocity(
        self,
        frames: Iterable[ArrayLike],
        x: ArrayLike,
        y: ArrayLike,
        kind: TemporalKind = "centred",
    ) -> LiteralEstimate:
        """Read the motion per frame interval from a sequence: phase velocity −Im(g_t/g)/u.

        Parameters
        ----------
        frames : iterable of n arrays, shape (height, width) each, n ≥ 2
            Equally spaced in time, finite.
        x, y : arrays of whole numbers, shape (points,)
            Centres, px, inside the frame.
        kind : {"centred", "causal"}
            Whether the velocity is that in the middle of the frames, or at the last.

        Raises
        ------
        InputError
            If there are less than two frames, they cannot be used, or differ in shape, or a point is no pixel.

        Notes
        -----
        The weights are those of a straight line, which a turning response is not: at a phase velocity of ω rad per
        frame interval |ω| n should stay below about 1. From two frames it is 2 tan(ω/2).
        """
        images = [finite_frame(frame, f"frames[{k}]") for k, frame in enumerate(frames)]
        _, a, b = temporal_weights(len(images), kind)
        for k, image in enumerate(images):
            if image.shape != images[0].shape:
                raise InputError(
                    f"frames[{k}] has shape {image.shape}, frames[0] {images[0].shape}: crop them alike"
                )
        value = sum(weight * image for weight, image in zip(a, images, strict=True))
        change = sum(weight * image for weight, image in zip(b, images, strict=True))
        # noise of the value and of the change: L times two independent noises of one frame
        L = np.linalg.cholesky(np.array([[a @ a, a @ b], [a @ b, b @ b]]))
        least = float(np.sqrt(a @ a))

        def read(patches: list[NDArray[Any]]) -> _Reading:
            (g, rates), (g_t, _) = (self._respond(part) for part in patches)
            turn = g_t / g
            by_value, by_change = -turn / g, 1 / g
            return _Reading(
                turn.imag,
                np.abs(g),
                np.exp(turn.real),
                -rates.imag,
                self._passes(g, rates, patches[0], least),
                np.stack([L[0, 0] * by_value + L[1, 0] * by_change, L[1, 1] * by_change]),
            )

        return self._over_blocks((np.asarray(value), np.asarray(change)), x, y, read)

    def _respond(self, patches: NDArray[Any]) -> tuple[Complex, Complex]:
        """Responses g, shape (points, K), and logarithmic derivatives h/g along their pairs, (points, K, 2)."""
        both = patches @ self._matrix
        g, h = both[:, : len(self.bank)], both[:, len(self.bank) :]
        return g, h.reshape(*g.shape, 2) / g[..., None]

    def _passes(
        self, g: Complex, rates: Complex, patches: NDArray[Any], noise: float = 1.0
    ) -> NDArray[np.bool_]:
        """Stability test of one frame whose noise is `noise` times that of a frame."""
        rounding = 8 * np.finfo(np.float64).eps * self.bank.size * np.linalg.norm(patches, axis=1)
        floor = self.least_amplitude * self.noise * noise + rounding
        orders = np.take_along_axis(orders_of(self.bank), self._own, axis=1)
        away = np.where(orders != 0, np.abs(rates + 1j * orders), 0.0)
        near = np.linalg.norm(away, axis=-1) <= self.departure * np.linalg.norm(orders, axis=-1)
        return np.asarray((np.abs(g) > floor[:, None]) & near)

    def _over_blocks(
        self,
        frames: tuple[Real, Real],
        x: ArrayLike,
        y: ArrayLike,
        read: Callable[[list[NDArray[Any]]], _Reading],
    ) -> LiteralEstimate:
        blocks = patch_blocks(frames, x, y, self.bank.radius)
        shape = np.size(x), len(self.bank)
        phase, amplitude, ratio = (np.empty(shape) for _ in range(3))
        frequency = np.full((*shape, len(GENERATOR_NAMES)), np.nan)
        stable, sensitivity = np.empty(shape, np.bool_), np.empty((2, *shape), np.complex128)
        for chosen, patches in blocks:
            with np.errstate(all="ignore"):  # a response may be 0, or too small for a ratio
                found = read(patches)
            phase[chosen], amplitude[chosen], ratio[chosen] = found[:3]
            np.put_along_axis(frequency[chosen], self._own[None], found.frequency, axis=2)
            stable[chosen], sensitivity[:, chosen] = found.stable, found.sensitivity
        return LiteralEstimate(self.bank, self.noise, phase, amplitude, ratio, frequency, stable, sensitivity)
