"""Group correlation: all motions of a commuting pair tried at once, without an assumption that they are small.

In canonical coordinates the motion exp(τ₁L₁ + τ₂L₂) of frame 1 about a point is the translation (τ₁, τ₂) of its map M₁
against M₀ (`coordinates`). The spectrum of a map is the set of all eigenfilter responses of the pair,

    g(u, v) = ∫ M exp(−i(uη + vξ)) dη dξ = ⟨I, J exp(−i(uη + vξ))⟩,

each multiplied by λ = exp(−i(uτ₁ + vτ₂)) while the pattern moves. Low orders alone cannot take τ for τ + 2π/u, high
ones tell it finely; along the group they add up to the correlation

    C(τ) = Re Σ ḡ₀(u, v) g₁(u, v) exp(i(uτ₁ + vτ₂)),

which is largest where all of them agree. Here g₀ is that of the window: W M₀ with W = w/J, w the Gaussian about the
point, so that every pixel counts as in the image. Less the means under W and over the root of both variances, C is the
zero-normalised correlation of frame 0 with frame 1 warped by exp(τ₁L₁ + τ₂L₂), for all τ by a few Fourier transforms.

| pair | samples | τ up to |
|---|---|---|
| (L_x, L_y) | 1 px, to 5σ/2 | ± the window |
| (L_s, L_r) | 1/(2σ), r from σ/5 to 5σ/2 | zoom ½ … 2; all angles |
| (L_b, L_s), (L_B, L_s) | 1/(2σ), the same r, four sectors, |η| ≤ 1 | shear e^±½; zoom ½ … 2 |

| symbol | name |
|---|---|
| M₀, M₁ | `still`, `moved` |
| W | `weight` |
| C | `surface` |
"""

from __future__ import annotations

import functools
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft2, next_fast_len, rfft2
from scipy.ndimage import maximum_filter

from large_motion.warped import Neighbourhoods
from sixflow.convention import six_from_coefficients
from sixflow.eigenfilters.coordinates import CanonicalCoordinates, canonical
from sixflow.eigenfilters.geometry import Real
from sixflow.engine.window import window_sigma

PAIRS = (("L_x", "L_y"), ("L_s", "L_r"), ("L_b", "L_s"), ("L_B", "L_s"))
"""The commuting pairs, among whose motions a large one is looked for."""

_OUTER, _INNER = 2.5, 0.2  # radii of the maps, σ
_ETA_MOST = 1.0  # of hyperbolic maps: leaves out 7.7° next to each singular line
_ZOOM_REACH, _SHEAR_REACH = math.log(2), 0.5
_MOST_SAMPLES = 64  # of a window, along x and y
_SUMMIT = 5  # samples: a summit is the highest of so many on each side together
_DEGREE = 3  # of the splines: maps only find where to look closer
_ROUNDING = 1e-9


class _Axis(NamedTuple):
    """Even samples along a canonical coordinate, and by how many of them the motion may be."""

    middle: float
    step: float
    size: int
    lags: int

    def samples(self, lags: int) -> Real:
        """The coordinate of the samples, with `lags` more at both ends."""
        from_middle = np.arange(-lags, self.size + lags, dtype=np.float64) - (self.size - 1) / 2
        return self.middle + self.step * from_middle


class GroupCorrelation:
    """A commuting pair on the samples that suit a window.

    Parameters
    ----------
    pair : (str, str)
        One of `PAIRS`.
    window : float
        px.

    Attributes
    ----------
    coordinates : CanonicalCoordinates
    offsets : tuple of two arrays, shape (sectors, η, ξ)
        x and y of the samples of M₀ from the point, px.
    weight : array of the same shape
        W, normalised.
    tau : tuple of two arrays
        τ₁ and τ₂ of the rows and columns of a surface.

    Examples
    --------
    A turn by 0.5 rad has the curl 2 sin 0.5 = 0.96; samples are 0.05 rad apart:

    >>> from sixflow import synth
    >>> from large_motion.warped import Spline
    >>> made = synth.pair(synth.Speckle(), synth.Affine.rotation(0.5, centre=(48, 48)), (97, 97))
    >>> at = np.array([48.0])
    >>> near = Neighbourhoods(Spline(made.frame0), Spline(made.frame1), at, at, window_sigma(31))
    >>> turns = GroupCorrelation(("L_s", "L_r"), window=31)
    >>> highest = turns.summits(turns.surface(near, np.zeros((1, 6))), 1)[0, 0]
    >>> f"curl {highest[3]:.2f}"
    'curl 1.00'
    """

    def __init__(self, pair: tuple[str, str], window: float) -> None:
        sigma = window_sigma(window)
        self.coordinates = canonical(*pair)
        self.periodic = math.isfinite(self.coordinates.xi_period)
        axes = _axes(self.coordinates, window)
        sector = np.arange(self.coordinates.sectors)[:, None, None]
        self.offsets, self._moved_at = (
            self.coordinates.inverse(eta[:, None], xi, sector)
            for eta, xi in (
                [axis.samples(0) for axis in axes],
                [axis.samples(axis.lags) for axis in axes],
            )
        )
        x, y = self.offsets
        weight = np.exp(-(x * x + y * y) / (2 * sigma**2)) / self.coordinates.jacobian(x, y)
        self.weight = weight / weight.sum()
        rows, columns = self._moved_at[0].shape[-2:]
        self._shape = (
            next_fast_len(rows, real=True),
            columns if self.periodic else next_fast_len(columns, real=True),
        )
        self._weight_spectrum = np.conj(rfft2(self.weight, self._shape))
        tau_1, tau_2 = (axis.step * np.arange(-axis.lags, axis.lags + 1) for axis in axes)
        if self.periodic:
            tau_2 = (axes[1].step * np.arange(columns) + math.pi) % (2 * math.pi) - math.pi
        self.tau = tau_1, tau_2

    @staticmethod
    @functools.lru_cache(maxsize=32)
    def of(pair: tuple[str, str], window: float) -> GroupCorrelation:
        """The correlation of a pair for a window, made once."""
        return GroupCorrelation(pair, window)

    def surface(self, near: Neighbourhoods, six: Real) -> Real:
        """Zero-normalised correlation C over τ about each point, of what comes before a motion that is known.

        Parameters
        ----------
        near : Neighbourhoods
            Beyond its border a frame goes on with its last pixels.
        six : array, shape (points, 6)
            Maps by which frame 1 is warped first.

        Returns
        -------
        array, shape (points, τ₁, τ₂)
            −1 … 1; 0 where there is no contrast.
        """
        still, moved = (
            frame.at(near.x, near.y, maps, (dx.ravel(), dy.ravel()), _DEGREE)[0].reshape(-1, *dx.shape)
            for frame, maps, (dx, dy) in (
                (near.frame0, np.zeros_like(six), self.offsets),
                (near.frame1, six, self._moved_at),
            )
        )
        still = still - (self.weight * still).sum(axis=(1, 2, 3), keepdims=True)
        moved = moved - moved.mean(axis=(1, 2, 3), keepdims=True)
        variance = (self.weight * still**2).sum(axis=(1, 2, 3))[:, None, None]
        spectrum = rfft2(moved, self._shape)
        common = self._back(np.conj(rfft2(self.weight * still, self._shape)) * spectrum)
        mean = self._back(self._weight_spectrum * spectrum)
        power = self._back(self._weight_spectrum * rfft2(moved**2, self._shape)) - mean**2
        floor = _ROUNDING * np.maximum(power.max(axis=(1, 2), keepdims=True), 0)
        size = variance * np.maximum(power, floor)
        return np.where(size > 0, common / np.sqrt(np.where(size > 0, size, 1)), 0)

    def _back(self, spectrum: NDArray[Any]) -> Real:
        """Sums over samples and sectors at the lags, from their spectrum."""
        whole: Real = irfft2(spectrum.sum(axis=1), self._shape)
        return whole[:, : self.tau[0].size, : self.tau[1].size]

    def summits(self, surface: Real, count: int) -> Real:
        """Motions at the highest summits of surfaces.

        Parameters
        ----------
        surface : array, shape (points, τ₁, τ₂)
        count : int
            How many of each; where there are fewer, the highest stands again.

        Returns
        -------
        array, shape (points, count, 6)
            The six, highest summit first.
        """
        modes = ("nearest", "nearest", "wrap" if self.periodic else "nearest")
        highest = maximum_filter(surface, (1, _SUMMIT, _SUMMIT), mode=modes)
        height = np.where(surface == highest, surface, -np.inf).reshape(len(surface), -1)
        order = np.argsort(-height, axis=1, kind="stable")[:, :count]
        real = np.isfinite(np.take_along_axis(height, order, axis=1))
        row, column = np.unravel_index(np.where(real, order, order[:, :1]), surface.shape[1:])
        coefficients = np.zeros((*order.shape, 6))
        coefficients[..., self.coordinates.first.index] = self.tau[0][row]
        coefficients[..., self.coordinates.second.index] = self.tau[1][column]
        return six_from_coefficients(coefficients)


def _axes(coordinates: CanonicalCoordinates, window: float) -> tuple[_Axis, _Axis]:
    """Axes of η and ξ that suit a window."""
    sigma = window_sigma(window)
    if coordinates.units == "px":
        step = max(1.0, window / _MOST_SAMPLES)
        both = _axis(0.0, _OUTER * sigma, step, window)
        return both, both
    step = 1 / (2 * sigma)
    middle, half = math.log(_OUTER * _INNER) / 2 + math.log(sigma), math.log(_OUTER / _INNER) / 2
    if math.isfinite(coordinates.xi_period):
        count = next_fast_len(math.ceil(coordinates.xi_period / step), real=True)
        return _axis(middle, half, step, _ZOOM_REACH), _Axis(0.0, coordinates.xi_period / count, count, 0)
    axis = math.pi / 4 if coordinates.first.name == "stretch" else 0.0  # direction of η = 0
    unit = float(coordinates.xi(math.cos(axis), math.sin(axis)))
    return _axis(0.0, _ETA_MOST, step, _SHEAR_REACH), _axis(unit + middle, half, step, _ZOOM_REACH)


def _axis(middle: float, half: float, step: float, reach: float) -> _Axis:
    return _Axis(
        middle, step, 2 * math.floor(half / step + _ROUNDING) + 1, math.floor(reach / step + _ROUNDING)
    )
