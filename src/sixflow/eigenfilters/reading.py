"""What operators read one by one: phase shifts, and the parameters that follow from each, or from all of them.

The formulas are those of `sixflow.eigenfilters.literal`, which makes it.
"""

from __future__ import annotations

import dataclasses
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sixflow.convention.six import GENERATOR_NAMES
from sixflow.eigenfilters.bank import FilterBank
from sixflow.eigenfilters.combination import Combination, combine_phases
from sixflow.eigenfilters.geometry import Real
from sixflow.eigenfilters.kernel import Complex
from sixflow.errors import InputError

_NO_ORDER = 1e-9  # of the kernel's largest order: cos 90° is not 0 to rounding


@dataclasses.dataclass(frozen=True, eq=False)
class LiteralEstimate:
    """What each operator of a bank reads at each point; made by `LiteralOperator`.

    Attributes
    ----------
    bank : FilterBank
        The K operators.
    noise : float
        Standard deviation σ of the grey noise of one frame.
    phase : array, shape (points, K)
        Phase shift Δφ, rad, in (−π, π]; of a sequence, per frame interval.
    amplitude : array, shape (points, K)
        |g|, grey values: root of the product of both frames'.
    amplitude_ratio : array, shape (points, K)
        |g1/g0|; of a sequence, per frame interval.
    frequency : array, shape (points, K, 6)
        Instantaneous frequency ν = −Im(h/g) along the generators of each kernel's pair, mean of both frames; NaN
        along the others. 1/px for L_x and L_y.
    stable : bool array, shape (points, K)
        Whether the operator passes the stability test.
    sensitivity : complex array, shape (2, points, K)
        q: noise n of the responses, of the covariance σ²WWᴴ in each of two independent frames, turns the phase by
        Im(q₀n₀ + q₁n₁).
    """

    bank: FilterBank
    noise: float
    phase: Real
    amplitude: Real
    amplitude_ratio: Real
    frequency: Real
    stable: NDArray[np.bool_]
    sensitivity: Complex

    @property
    def orders(self) -> Real:
        """Orders along L_x, L_y, L_s, L_r, L_b, L_B, shape (K, 6); 0 along generators of other pairs."""
        return orders_of(self.bank)

    @property
    def tau(self) -> Real:
        """τ = −Δφ/u along each generator as if there were no other motion, shape (points, K, 6).

        NaN where the order is 0. px for L_x and L_y; per frame interval of a sequence.
        """
        return self._over(self.orders)

    @property
    def tau_by_frequency(self) -> Real:
        """τ = −Δφ/ν, phase over instantaneous frequency, otherwise as `tau`."""
        return self._over(self.frequency)

    @property
    def standard_error(self) -> Real:
        """Standard error of `tau` by the noise, shape (points, K, 6): σ/(|g| |u|) where both parts are alike."""
        K = len(self.bank)
        C = self.bank.real_noise_covariance
        rr, ri, ii = np.diagonal(C)[:K], np.diagonal(C[:K, K:]), np.diagonal(C)[K:]
        q = self.sensitivity
        variance = (q.imag**2 * rr + 2 * q.imag * q.real * ri + q.real**2 * ii).sum(axis=0)
        return np.abs(_ratio(self.noise * np.sqrt(variance)[..., None], self.orders, self.orders != 0))

    def combine(self, by: Literal["order", "frequency"] = "order") -> Combination:
        """The parameters of all generators in the bank from its stable operators.

        Weighted least squares with the weights |g|²; for operators of one order each, the mean of τ with the weights
        |g|²u². The phase shifts of operators with two orders are separated that way. See
        `sixflow.eigenfilters.combination`.

        Parameters
        ----------
        by : {"order", "frequency"}
            Divide phase by the orders (literally), or by the instantaneous frequencies.

        Raises
        ------
        InputError
            If `by` is neither.

        Notes
        -----
        Every operator is taken to see the generators of its own pair only. What the others do to its phase is an
        error: `JointOperator` solves for it.
        """
        if by not in ("order", "frequency"):
            raise InputError(f"by={by!r}: must be 'order' or 'frequency'")
        rates = self.orders if by == "order" else self.frequency
        rates = np.where(self.orders != 0, np.broadcast_to(rates, self.frequency.shape), 0.0)
        weight = np.where(self.stable, self.amplitude**2, 0.0)
        covariance = self.noise**2 * self.bank.real_noise_covariance
        return combine_phases(rates, self.phase, weight, self.sensitivity, covariance)

    def _over(self, rates: Real) -> Real:
        return -_ratio(self.phase[..., None], rates, self.orders != 0)


def orders_of(bank: FilterBank) -> Real:
    """Orders along L_x, L_y, L_s, L_r, L_b, L_B, shape (K, 6); 0 along generators of other pairs."""
    table = np.zeros((len(bank), len(GENERATOR_NAMES)))
    for row, kernel in zip(table, bank.kernels, strict=True):
        for name, order in zip(kernel.generators, kernel.orders, strict=True):
            if abs(order) > _NO_ORDER * max(map(abs, kernel.orders)):
                row[GENERATOR_NAMES.index(name)] = order
    return table


def _ratio(above: Real, below: Real, where: NDArray[np.bool_]) -> Real:
    """above/below, NaN where not wanted or the denominator is 0."""
    shape = np.broadcast_shapes(above.shape, below.shape)
    return np.divide(above, below, out=np.full(shape, np.nan), where=where & (below != 0))
