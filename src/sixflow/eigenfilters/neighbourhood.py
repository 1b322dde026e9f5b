"""Neighbourhoods of an image in canonical coordinates (Eagleson, figure 7).

Sampled on an even grid of canonical coordinates (η, ξ), a neighbourhood becomes an image M(η, ξ) in which
deformations are translations: with I1(exp(τ₁L₁ + τ₂L₂) x) = I0(x),

    M1(η + τ₁, ξ + τ₂) = M0(η, ξ)

| map | η, moved by | ξ, moved by |
|---|---|---|
| `log_polar_map` | log r, zoom: τ = log of the zoom | atan2(y, x), rotation: τ = its angle, rad |
| `hyperbolic_map` | ½ log of a ratio, stretch or shear: τ | ½ log of a product, zoom: τ |

By how much one map is translated against another tells `sixflow.eigenfilters.correlation`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import map_coordinates

from sixflow.eigenfilters.coordinates import CanonicalCoordinates, canonical
from sixflow.eigenfilters.generators import L_B, GeneratorLike, L_b, L_r, L_s, as_generator
from sixflow.engine.spline import PAD, spline_coefficients
from sixflow.errors import InputError
from sixflow.prepare.image import check_frame

_DEGREE = 5
_MARGIN = 24  # px around the samples: what lies beyond changes the spline by less than 1e-8


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
