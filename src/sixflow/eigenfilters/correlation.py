"""Phase correlation of two maps of a neighbourhood: all eigenfilter responses of a pair of generators at once.

The spectrum of a map M(η, ξ) (`sixflow.eigenfilters.neighbourhood`) is the set of all eigenfilter responses of the
pair. With M1(η + τ₁, ξ + τ₂) = M0(η, ξ) each changes by the phase factor λ(u, v) = exp(−i(uτ₁ + vτ₂)), and the
correlation

    C(τ₁, τ₂) = Re Σ λ(u, v) exp(i(uτ₁ + vτ₂))

is largest at the deformation (τ₁, τ₂). The maps must be taken at corresponding points: what remains of
translation blurs the peak.

| symbol | name |
|---|---|
| C | `surface` |
| τ₁, τ₂ | `tau_eta`, `tau_xi` |
| λ, normalised | `phases` |
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from sixflow.errors import InputError

_FLOOR = 10.0  # of the mean cross-power: weaker frequencies weigh by their power, being mostly noise
_NEWTON_STEPS = 8
_PASSES = 12
_SETTLED = 1e-4  # samples
_ROUNDING = 1e-12


@dataclass(frozen=True)
class Correlation:
    """Phase correlation of two maps; made by `correlation_surface`.

    Attributes
    ----------
    surface : DataArray, dims (eta, xi)
        Over translations τ_η, τ_ξ, 0 in the middle; 1 at the peak of a pair without any change but translation.
    tau_eta, tau_xi : float
        Translation of the second map against the first, in the units of the axes, finer than the samples.
    peak : float
        Value at the peak, 0 … 1.
    """

    surface: xr.DataArray
    tau_eta: float
    tau_xi: float
    peak: float


def correlation_surface(map0: xr.DataArray, map1: xr.DataArray) -> Correlation:
    """Phase correlation of two maps of corresponding neighbourhoods: by how much map 1 is translated.

    The cross-spectrum F̄₀F₁ is divided by its size where that is large; weak frequencies keep a weight in
    proportion to it, since maps are oversampled near the centre and most of the spectrum is noise. Several
    sectors are added up, since the same flow moves all of them. Between samples the peak is found by Newton's
    method on the trigonometric polynomial itself. Axes that are not periodic are tapered (Hann); tapers that
    stand still would pull the peak towards 0, so that they are moved with the maps, by half of τ each, until
    τ settles. Along such an axis a quarter of its length can be measured.

    Parameters
    ----------
    map0, map1 : DataArray, dims (eta, xi) or (sector, eta, xi)
        From `log_polar_map` or `hyperbolic_map`, on the same axes, without NaN.

    Raises
    ------
    InputError
        If the maps have different axes, hold NaN or have no contrast.

    Examples
    --------
    Turned by 90°, from x towards y:

    >>> import numpy as np
    >>> from sixflow.eigenfilters.neighbourhood import log_polar_map
    >>> image = np.random.default_rng(0).normal(size=(65, 65))
    >>> before, after = (log_polar_map(i, 32, 32) for i in (image, np.rot90(image, -1)))
    >>> found = correlation_surface(before, after)
    >>> print(f"{np.degrees(found.tau_xi):.3f}° {abs(found.tau_eta):.3f}")
    90.000° 0.000
    """
    try:
        map0, map1 = xr.align(map0, map1, join="exact")
    except ValueError as error:
        raise InputError(
            "map0 and map1 stand on different axes: make both with the same arguments"
        ) from error
    for name, values in (("map0", map0), ("map1", map1)):
        if values.dims[-2:] != ("eta", "xi") or values.dims != map0.dims:
            raise InputError(
                f"{name} has dimensions {values.dims}: must be (eta, xi) or (sector, eta, xi), both alike"
            )
        bad = int((~np.isfinite(values.values)).sum())
        if bad:
            raise InputError(
                f"{name} has {bad} samples without value: keep the neighbourhood within the frame"
            )
        if np.ptp(values.values) <= _ROUNDING * np.abs(values.values).max():
            raise InputError(f"{name} has no contrast: choose another point or larger radii")
    eta, xi = map0["eta"].values, map0["xi"].values
    tapered = (True, "xi_period" not in map0.attrs)
    shift = np.zeros(2)
    for _ in range(_PASSES):
        phases = _phases(map0.values, map1.values, shift, tapered)
        surface = np.fft.fftshift(np.fft.ifft2(phases).real) * phases.size
        row, column = np.unravel_index(int(surface.argmax()), surface.shape)
        before = shift
        shift, peak = _summit(
            phases, np.array([row - eta.size // 2, column - xi.size // 2], dtype=np.float64)
        )
        if np.abs(shift - before).max() < _SETTLED:
            break
    steps = float(eta[1] - eta[0]), float(xi[1] - xi[0])
    axes = {
        name: (np.arange(n) - n // 2) * step
        for name, n, step in zip(("eta", "xi"), surface.shape, steps, strict=True)
    }
    return Correlation(
        xr.DataArray(surface, axes, ("eta", "xi"), name="correlation"),
        float(shift[0] * steps[0]),
        float(shift[1] * steps[1]),
        peak,
    )


def _phases(
    values0: NDArray[Any], values1: NDArray[Any], shift: NDArray[Any], tapered: tuple[bool, bool]
) -> NDArray[Any]:
    """Phase factors of F̄₀F₁, both maps tapered to the part that they share after a shift (samples)."""
    spectra = []
    for values, sign in ((values0, -1), (values1, 1)):
        along_eta, along_xi = (
            _hann(n, sign * s / 2, n - abs(s)) if fades else np.ones(n)
            for n, s, fades in zip(values.shape[-2:], shift, tapered, strict=True)
        )
        taper = np.outer(along_eta, along_xi)
        mean = (values * taper).sum(axis=(-2, -1), keepdims=True) / taper.sum()
        spectra.append(np.fft.fft2((values - mean) * taper))
    cross = (np.conj(spectra[0]) * spectra[1]).reshape(-1, *values0.shape[-2:]).sum(axis=0)
    size = np.abs(cross)
    phases = cross / (size + _FLOOR * size.mean())
    return phases / np.abs(phases).sum()


def _hann(count: int, offset: float, width: float) -> NDArray[np.float64]:
    """Hann window of a width around the middle of `count` samples plus an offset."""
    from_middle = np.abs(np.arange(count) - (count - 1) / 2 - offset)
    return np.where(from_middle < width / 2, np.cos(np.pi * from_middle / width) ** 2, 0)


def _summit(phases: NDArray[Any], start: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Top of Re Σ P exp(i k·τ) next to a start, in samples, and its height; the start where that diverges."""
    k_eta, k_xi = (2 * np.pi * np.fft.fftfreq(n) for n in phases.shape)

    def moments(tau: NDArray[np.float64]) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
        rows = np.exp(1j * k_eta * tau[0]) * np.stack([np.ones_like(k_eta), k_eta, k_eta**2])
        columns = np.exp(1j * k_xi * tau[1]) * np.stack([np.ones_like(k_xi), k_xi, k_xi**2])
        m = rows @ phases @ columns.T
        slope = -np.array([m[1, 0].imag, m[0, 1].imag])
        return m[0, 0].real, slope, -np.array([[m[2, 0].real, m[1, 1].real], [m[1, 1].real, m[0, 2].real]])

    tau = start.copy()
    for _ in range(_NEWTON_STEPS):
        _, slope, curvature = moments(tau)
        if not (curvature[0, 0] < 0 and np.linalg.det(curvature) > 0):
            break
        tau = tau - np.linalg.solve(curvature, slope)
        if np.abs(tau - start).max() > 1:
            break
    if np.abs(tau - start).max() > 1 or moments(tau)[0] < moments(start)[0]:
        tau = start
    return tau, float(moments(tau)[0])
