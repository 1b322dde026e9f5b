"""Motions of solids: the star of the DIC Challenge and a plate with a hole."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sixflow.checks import number, numbers, require
from sixflow.synth.arguments import Array, length, points
from sixflow.synth.motions.base import Motion


@dataclasses.dataclass(frozen=True)
class Star(Motion):
    """Star of the DIC Challenge 2.0: vertical displacement waves whose period grows from left to right.

    v = amplitude cos(2π (y − row)/p(x)), u = 0; the period p runs linearly from `periods[0]` at x =
    `columns[0]` to `periods[1]` at `columns[1]`, and is constant outside. Along the row v = amplitude: what
    is measured there, relative to the amplitude, is the attenuation at each period (Reu et al., Exp. Mech.
    62, 2022).

    Parameters
    ----------
    amplitude : float
        px. The motion folds from amplitude = smallest period/2π on.
    periods : (float, float)
        Period at the two columns, px, at least 0.1.
    columns : (float, float)
        The two columns, px, different.
    row : float
        Row of symmetry, px.

    Raises
    ------
    InputError
        If a value is outside its range.

    Examples
    --------
    >>> motion = Star(amplitude=0.5, periods=(10.0, 300.0), columns=(0.0, 1000.0), row=250.0)
    >>> [round(float(part), 6) for part in motion.displacement(500.0, 250.0)]
    [0.0, 0.5]
    >>> float(motion.period(500.0))
    155.0
    """

    amplitude: float
    periods: tuple[float, float]
    columns: tuple[float, float]
    row: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "amplitude", number("amplitude", self.amplitude, unit="px"))
        object.__setattr__(self, "periods", numbers("periods", self.periods, 2, "in px"))
        object.__setattr__(self, "columns", numbers("columns", self.columns, 2, "in px"))
        object.__setattr__(self, "row", number("row", self.row, unit="px"))
        for k, period in enumerate(self.periods):
            length(f"periods[{k}]", period)
        different = self.columns[0] != self.columns[1]
        require(different, "columns", self.columns, "must be two different columns, px")

    def period(self, x: ArrayLike) -> Array:
        """Period of the waves at columns x, px.

        Raises
        ------
        InputError
            If the coordinates cannot be used.
        """
        return self._period(points(x, 0.0)[0])[0]

    def _period(self, x: Array) -> tuple[Array, Array]:
        """Period at columns x and its derivative."""
        rate = (self.periods[1] - self.periods[0]) / (self.columns[1] - self.columns[0])
        low, high = min(self.columns), max(self.columns)
        period = self.periods[0] + rate * (np.clip(x, low, high) - self.columns[0])
        return period, np.where((x >= low) & (x <= high), rate, 0.0)

    def _displacement(self, x: Array, y: Array) -> tuple[Any, Any]:
        return 0.0, self.amplitude * np.cos(2 * math.pi * (y - self.row) / self._period(x)[0])

    def _gradient(self, x: Array, y: Array) -> tuple[Any, Any, Any, Any]:
        period, rate = self._period(x)
        phase = 2 * math.pi * (y - self.row) / period
        slope = self.amplitude * np.sin(phase)
        return 0.0, 0.0, slope * phase / period * rate, -slope * 2 * math.pi / period


@dataclasses.dataclass(frozen=True)
class PlateWithHole(Motion):
    """Wide elastic plate with a circular hole, pulled from far away (Kirsch 1898).

    In plane stress, with z = x + iy from the centre and the pull along x (Muskhelishvili's potentials),

        φ = (S/4)(z + 2a²/z),  ψ = −(S/2)(z + a²/z − a⁴/z³),
        2μ (u + iv) = κ φ − z conj(φ') − conj(ψ),  κ = (3 − ν)/(1 + ν),  S/2μ = (1 + ν) strain.

    Inside the hole, where there is no material, the displacement continues as (r/a) U(a, θ): the linear map
    (1 + ν) strain [(κ+1)/4 z + (κ+1)/2 conj z].

    Parameters
    ----------
    strain : float
        Far strain along the pull, S/E, without unit. At the edge of the hole it is up to three times as
        large.
    radius : float
        Radius a of the hole in the reference frame, px, at least 0.1.
    poisson : float
        Poisson's ratio ν, from −1 (excluded) to 0.5.
    centre : (float, float)
        Centre of the hole, px.
    angle : float
        Direction of the pull, rad, from x towards y.

    Raises
    ------
    InputError
        If a value is outside its range.

    Examples
    --------
    >>> motion = PlateWithHole(strain=0.002, radius=40.0, centre=(128.0, 128.0))
    >>> motion.gradient(128.0, 168.0).round(6)[0, 0].item()  # three times the far strain
    0.006
    >>> motion.mask([128.0, 200.0], 128.0).tolist()
    [False, True]
    """

    strain: float
    radius: float
    poisson: float = 0.3
    centre: tuple[float, float] = (0.0, 0.0)
    angle: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "strain", number("strain", self.strain))
        object.__setattr__(self, "radius", length("radius", self.radius))
        object.__setattr__(self, "poisson", number("poisson", self.poisson, above=-1, most=0.5))
        object.__setattr__(self, "centre", numbers("centre", self.centre, 2, "(x, y) in px"))
        object.__setattr__(self, "angle", number("angle", self.angle, unit="radians"))

    def mask(self, x: ArrayLike, y: ArrayLike) -> NDArray[np.bool_]:
        """True where there is material in the reference frame: at and beyond the edge of the hole.

        Raises
        ------
        InputError
            If the coordinates cannot be used.
        """
        x, y = points(x, y)
        return np.hypot(x - self.centre[0], y - self.centre[1]) >= self.radius

    def at(self, s: float) -> PlateWithHole:
        """The plate at s times the pull: linear elasticity makes the displacement s times as large."""
        return dataclasses.replace(self, strain=number("s", s) * self.strain)

    def _displacement(self, x: Array, y: Array) -> tuple[Any, Any]:
        z, outside, turn = self._local(x, y)
        q = self.radius / z
        phi = (z + 2 * self.radius * q) / 4
        phi1 = (1 - 2 * q**2) / 4
        psi = -(z + self.radius * q - self.radius * q**3) / 2
        w = self._kappa * phi - z * np.conj(phi1) - np.conj(psi)
        inner = self._local_inner(x, y)
        w = turn * (1 + self.poisson) * self.strain * np.where(outside, w, inner)
        return w.real, w.imag

    def _gradient(self, x: Array, y: Array) -> tuple[Any, Any, Any, Any]:
        z, outside, turn = self._local(x, y)
        q = self.radius / z
        phi1 = (1 - 2 * q**2) / 4
        phi2 = q**3 / self.radius
        psi1 = -(1 - q**2 + 3 * q**4) / 2
        edge = (self._kappa + 1) / 4
        # derivatives of w = u + iv by z and by conj z, which a turn of the axes multiplies by 1 and by turn²
        by_z = np.where(outside, self._kappa * phi1 - np.conj(phi1), edge)
        by_conj = np.where(outside, -z * np.conj(phi2) - np.conj(psi1), 2 * edge) * turn**2
        size = (1 + self.poisson) * self.strain
        along_x, along_y = size * (by_z + by_conj), size * 1j * (by_z - by_conj)
        return along_x.real, along_y.real, along_x.imag, along_y.imag

    @property
    def _kappa(self) -> float:
        return (3 - self.poisson) / (1 + self.poisson)

    def _local(self, x: Array, y: Array) -> tuple[Any, Any, complex]:
        """Position in axes along the pull (moved to the edge inside the hole), whether outside, the turn."""
        turn = complex(math.cos(self.angle), math.sin(self.angle))
        z = ((x - self.centre[0]) + 1j * (y - self.centre[1])) / turn
        outside = np.abs(z) >= self.radius
        return np.where(outside, z, self.radius), outside, turn

    def _local_inner(self, x: Array, y: Array) -> Any:
        """The continuation inside the hole, in axes along the pull."""
        turn = complex(math.cos(self.angle), math.sin(self.angle))
        z = ((x - self.centre[0]) + 1j * (y - self.centre[1])) / turn
        return (self._kappa + 1) / 4 * (z + 2 * np.conj(z))
