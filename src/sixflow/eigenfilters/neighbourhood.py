"""Neighbourhoods of an image in canonical coordinates (Eagleson, figure 7), and their translations.

Sampled on an even grid of canonical coordinates (η, ξ), a neighbourhood becomes an image M(η, ξ) in which
deformations are translations: with I1(exp(τ₁L₁ + τ₂L₂) x) = I0(x),

    M1(η + τ₁, ξ + τ₂) = M0(η, ξ)

| map | η, moved by | ξ, moved by |
|---|---|---|
| `log_polar_map` | log r, zoom: τ = log of the zoom | atan2(y, x), rotation: τ = its angle, rad |
| `hyperbolic_map` | ½ log of a ratio, stretch or shear: τ | ½ log of a product, zoom: τ |

The spectrum of such a map is the set of all eigenfilter responses of the pair, so that its phase correlation
is all of them at once: τ is where Re Σ λ(u, v) exp(i(uτ₁ + vτ₂)) over the phase factors λ is largest.
The maps must be taken at corresponding points: what remains of translation blurs the peak.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import map_coordinates

from sixflow.eigenfilters.coordinates import CanonicalCoordinates, canonical
from sixflow.eigenfilters.generators import L_B, GeneratorLike, L_b, L_r, L_s, as_generator
from sixflow.engine.spline import PAD, spline_coefficients
from sixflow.errors import InputError
from sixflow.normalise import check_frame

_DEGREE = 5
_MARGIN = 24  # px around the samples: what lies beyond changes the spline by less than 1e-8
_FLOOR = 10.0  # of the mean cross-power: weaker frequencies weigh by their power, being mostly noise
_NEWTON_STEPS = 8
_PASSES = 12
_SETTLED = 1e-4  # samples
_ROUNDING = 1e-12


def log_polar_map(
    image: ArrayLike,
    x: float,
    y: float,
    *,
    r_min: float = 2.0,
    r_max: float = 24.0,
    shape: tuple[int, int] = (64, 128),
) -> xr.DataArray:
    """A neighbourhood on log-polar axes: zoom and rotation become translations (Eagleson, figure 7).

    Parameters
    ----------
    image : array of real numbers, shape (height, width)
        A frame, finite within the neighbourhood.
    x, y : float
        Centre, px.
    r_min, r_max : float
        Radii of the first and the last sample, px; 0 < r_min < r_max. The samples at r stand 2πr/`shape[1]`
        apart along the circle: detail finer than twice that is aliased.
    shape : (int, int)
        Samples along η = log r and ξ = atan2(y, x), at least 4 each.

    Returns
    -------
    DataArray, float64, dims (eta, xi)
        `eta` from log r_min to log r_max, `xi` from −π up to, not including, π (rad, from x towards y). NaN
        outside the frame.

    Raises
    ------
    InputError
        If the image is no frame or not finite there, or a number is out of range.

    Examples
    --------
    >>> import numpy as np
    >>> rows, columns = np.mgrid[:65, :65]
    >>> bowl = (columns - 32.0) ** 2 + (rows - 32.0) ** 2
    >>> log_polar_map(bowl, 32, 32, r_min=4, r_max=16, shape=(5, 8)).isel(xi=0).values.round(3)
    array([ 16.,  32.,  64., 128., 256.])
    """
    _require_range(r_min, r_max, shape)
    eta = np.linspace(math.log(r_min), math.log(r_max), shape[0])
    xi = -np.pi + 2 * np.pi / shape[1] * np.arange(shape[1])
    return _map(image, x, y, canonical(L_s, L_r), eta, xi, 0)


def hyperbolic_map(
    image: ArrayLike,
    x: float,
    y: float,
    *,
    generator: GeneratorLike = "stretch",
    sector: int | None = None,
    r_min: float = 2.0,
    r_max: float = 24.0,
    eta_max: float = 1.0,
    shape: tuple[int, int] = (64, 64),
) -> xr.DataArray:
    """A neighbourhood on hyperbolic axes: a shear and the zoom become translations (Eagleson, §4.4).

    Parameters
    ----------
    image : array of real numbers, shape (height, width)
        A frame, finite within the neighbourhood.
    x, y : float
        Centre, px.
    generator : Generator or str
        L_b ("stretch") or L_B ("shear").
    sector : {0, 1, 2, 3} or None
        One sector of the coordinates, numbered as in `coordinates`; by default all four.
    r_min, r_max : float
        Radii of the first and last sample on the axis of a sector (η = 0), px; 0 < r_min < r_max. Elsewhere the
        radius is larger by √cosh 2η.
    eta_max : float
        η goes from −eta_max to eta_max; 1 leaves out 7.7° next to each singular line.
    shape : (int, int)
        Samples along η and ξ, at least 4 each.

    Returns
    -------
    DataArray, float64, dims (sector, eta, xi), or (eta, xi) if one sector is asked for
        NaN outside the frame.

    Raises
    ------
    InputError
        If the image is no frame or not finite there, the generator is no shear, or a number is out of range.

    Examples
    --------
    >>> import numpy as np
    >>> rows, columns = np.mgrid[:65, :65]
    >>> saddle = (columns - 32.0) * (rows - 32.0)
    >>> corner = hyperbolic_map(saddle, 32, 32, sector=0, r_min=4, r_max=8, eta_max=0.5, shape=(4, 4))
    >>> corner.isel(eta=0).values.round(2)  # xy = exp(2ξ) = r²/2, whatever η
    array([ 8.  , 12.7 , 20.16, 32.  ])
    """
    _require_range(r_min, r_max, shape)
    if not (math.isfinite(eta_max) and eta_max > 0):
        raise InputError(f"eta_max={eta_max!r}: must be finite and positive; 1 is usual")
    first = as_generator(generator)
    if first not in (L_b, L_B):
        raise InputError(f"generator={generator!r}: must be a shear, 'stretch' (L_b) or 'shear' (L_B)")
    coordinates = canonical(first, L_s)
    if sector is not None and sector not in range(coordinates.sectors):
        raise InputError(f"sector={sector!r}: must be 0 … {coordinates.sectors - 1}, or None for all")
    axis = math.pi / 4 if first == L_b else 0.0
    xi_of_unit = float(coordinates.xi(math.cos(axis), math.sin(axis)))
    xi = xi_of_unit + np.linspace(math.log(r_min), math.log(r_max), shape[1])
    eta = np.linspace(-eta_max, eta_max, shape[0])
    sectors = np.arange(coordinates.sectors) if sector is None else np.asarray(sector)
    return _map(image, x, y, coordinates, eta, xi, sectors)


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
    τ settles. Along such an axis a quarter of its length can be told.

    Parameters
    ----------
    map0, map1 : DataArray, dims (eta, xi) or (sector, eta, xi)
        From `log_polar_map` or `hyperbolic_map`, on the same axes, without NaN.

    Returns
    -------
    Correlation

    Raises
    ------
    InputError
        If the maps have different axes, hold NaN or have no contrast.

    Examples
    --------
    Turned by 90°, from x towards y:

    >>> import numpy as np
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


def _map(
    image: ArrayLike,
    x: float,
    y: float,
    coordinates: CanonicalCoordinates,
    eta: NDArray[Any],
    xi: NDArray[Any],
    sectors: Any,
) -> xr.DataArray:
    """The image at the points of an even grid of (η, ξ), in one sector or several."""
    for name, value in (("x", x), ("y", y)):
        if not math.isfinite(value):
            raise InputError(f"{name}={value!r}: the centre must be finite, in px")
    number = np.asarray(sectors)
    dx, dy = coordinates.inverse(eta[:, None], xi, number[..., None, None])
    values = _sample(image, x + dx, y + dy)
    dims: tuple[str, ...] = ("eta", "xi")
    coords = {"eta": eta, "xi": xi}
    if number.ndim:
        dims, coords = ("sector", *dims), {"sector": number, **coords}
    found = xr.DataArray(values, coords, dims, name="intensity")
    found.attrs = {
        "x": float(x),
        "y": float(y),
        "generators": f"{coordinates.first.symbol} {coordinates.second.symbol}",
    }
    found["eta"].attrs = {"long_name": coordinates.eta_name, "units": coordinates.units}
    found["xi"].attrs = {"long_name": coordinates.xi_name, "units": coordinates.units}
    if math.isfinite(coordinates.xi_period):
        found.attrs["xi_period"] = coordinates.xi_period
        found["xi"].attrs["units"] = "rad"
    return found


def _sample(image: ArrayLike, x: NDArray[Any], y: NDArray[Any]) -> NDArray[np.float64]:
    """Quintic-spline interpolation at (x, y); NaN outside the frame."""
    frame = check_frame(image, "image")
    height, width = frame.shape
    inside = (x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1)
    values = np.full(x.shape, np.nan)
    if not inside.any():
        return values
    left, top = (max(0, math.floor(c[inside].min()) - _MARGIN) for c in (x, y))
    right, bottom = (math.ceil(c[inside].max()) + _MARGIN + 1 for c in (x, y))
    part = np.ascontiguousarray(frame[top:bottom, left:right], dtype=np.float64)
    bad = int((~np.isfinite(part)).sum())
    if bad:
        raise InputError(
            f"image has {bad} pixels that are not finite near the neighbourhood: fill them, or move it"
        )
    coefficients = spline_coefficients(part, _DEGREE)
    at = np.stack([y[inside] - top, x[inside] - left]) + PAD
    values[inside] = map_coordinates(coefficients, at, order=_DEGREE, prefilter=False, mode="nearest")
    return values


def _require_range(r_min: float, r_max: float, shape: tuple[int, int]) -> None:
    if not 0 < r_min < r_max < math.inf:
        raise InputError(f"r_min={r_min!r}, r_max={r_max!r}: must be 0 < r_min < r_max, in px")
    if len(shape) != 2 or any(not isinstance(n, int | np.integer) or n < 4 for n in shape):
        raise InputError(f"shape={shape!r}: must be two whole numbers (along eta, along xi), at least 4 each")
