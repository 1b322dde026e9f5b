"""A bank for any window: Gabor, spiral and hyperbolic kernels for the wavelengths of an image.

With the Gaussian of the least-squares window, σ = window/√(4π), the bank has

| family | kernels | where |
|---|---|---|
| Gabor | 4 + 5 + 6 + 5 orientations at 4 frequencies, evenly spaced in their logarithm | σ |
| spiral | 4 radial × up to 5 angular orders, less conjugates | ring of radius 1.5 σ |
| hyperbolic | 2 shears × 2 pairs of orders × 4 patterns of signs | the same ring |

all under the Gaussian σ. On that ring an order u is a wave of u/r rad/px, which ties the orders to the wavelengths.
A kernel and its complex conjugate have the same real responses; only one of them is in the bank.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from sixflow.checks import is_number, require
from sixflow.eigenfilters.bank import FilterBank
from sixflow.eigenfilters.kernel import Kernel
from sixflow.eigenfilters.kernels import Gabor, Hyperbolic, Spiral
from sixflow.engine.window import window_sigma

Family: TypeAlias = Literal["gabor", "spiral", "hyperbolic"]

_ORIENTATIONS = (4, 5, 6, 5)
_RING = 1.5  # radius over σ: beyond the Gaussian's own maximum, where r dr dθ weighs most
_BANDWIDTH, _WIDTH = 0.5, 0.25  # a wider η reaches waves near the singular axes that pixels do not resolve
_REACH = 4.0  # radius of the patch over σ: the Gaussian has fallen to 3e-4
SMALLEST_ARRAY = 10  # px
_ARRAY_SHARE, _ARRAY_LARGEST = 0.5, 11.0  # of the window; px
_ARRAY_REACH = 3.0
_SIGNS = ((1, 1, 1, 1), (1, -1, 1, -1), (1, 1, -1, -1), (1, -1, -1, 1))


def default_bank(
    window: float = 31,
    kernels: Iterable[Family] = ("gabor", "spiral", "hyperbolic"),
    *,
    wavelengths: tuple[float, float] = (7.0, 21.0),
) -> FilterBank:
    """A bank of up to 54 complex kernels for a window.

    Parameters
    ----------
    window : float
        Side of the square subset of the same noise, px, 5 to 400: the Gaussian has σ = window/√(4π).
    kernels : iterable of {"gabor", "spiral", "hyperbolic"}
        The families to take.
    wavelengths : two floats
        Shortest and longest wavelength of the image that carry the motion, px, 2.5 ≤ shortest < longest. The
        default suits speckles and particle images of 3 to 6 px across. In small windows both become
        shorter, so that a wave and the Gaussian can be distinguished.

    Returns
    -------
    FilterBank
        With a patch of radius ⌈4 σ⌉.

    Raises
    ------
    InputError
        If an argument is outside its range.

    Examples
    --------
    >>> bank = default_bank(31)
    >>> len(bank), bank.size
    (54, 71)
    >>> len(default_bank(31, ["gabor"]))
    20
    """
    require(
        is_number(window) and 5 <= window <= 400, "window", window, "must be 5 to 400 px; 31 is a good start"
    )
    families = (
        (kernels,) if isinstance(kernels, str) else tuple(kernels) if isinstance(kernels, Iterable) else ()
    )
    wanted = f"must be one or more of {', '.join(get_args(Family))}"
    require(bool(families) and set(families) <= set(get_args(Family)), "kernels", kernels, wanted)
    shortest, longest = _two_lengths(wavelengths)
    sigma = window_sigma(window)
    low = max(2 * math.pi / longest, min(1.5 / sigma, 1.2))
    high = max(2 * math.pi / shortest, min(2 * low, 2.4))
    made = {"gabor": _gabors, "spiral": _spirals, "hyperbolic": _hyperbolics}
    chosen = [kernel for family in made if family in families for kernel in made[family](sigma, low, high)]
    return FilterBank(tuple(chosen), math.ceil(_REACH * sigma))


def array_bank(window: float) -> FilterBank:
    """The bank of which copies stand all over a frame and are pooled under a window (`pool`).

    It is smaller than the window, half of it and at most 11 px, and sees wavelengths from 3 to 14 px: operators
    that are no larger than the details of the pattern see nearly all that there is in the pixels with
    54 kernels, and the pooling window does the rest.

    Raises InputError if the window is smaller.

    Parameters
    ----------
    window : float
        Of the pooled array, px, at least 10.

    Examples
    --------
    >>> bank = array_bank(31)
    >>> len(bank), bank.size
    (54, 21)
    """
    bank = default_bank(_array_window(window), wavelengths=(3.0, 14.0))
    return FilterBank(bank.kernels, math.ceil(_ARRAY_REACH * window_sigma(_array_window(window))))


def array_spacing(window: float) -> int:
    """Distance between the copies of `array_bank`, px: 1.6 standard deviations of their Gaussian."""
    return max(1, math.ceil(1.6 * window_sigma(_array_window(window))))


def _array_window(window: float) -> float:
    """Window of the bank that an array for a window is made of, px."""
    require(
        is_number(window) and SMALLEST_ARRAY <= window <= 1e6,
        "window",
        window,
        f"an array of operators needs a window of at least {SMALLEST_ARRAY} px; widen it",
    )
    return min(max(_ARRAY_SHARE * window, 5.0), _ARRAY_LARGEST)


def _gabors(sigma: float, low: float, high: float) -> list[Kernel]:
    frequencies = np.geomspace(low, high, len(_ORIENTATIONS))
    return [
        Gabor(float(frequency), math.pi * (k + 0.5 * (row % 2)) / count, sigma=sigma)
        for row, (frequency, count) in enumerate(zip(frequencies, _ORIENTATIONS, strict=True))
        for k in range(count)
    ]


def _spirals(sigma: float, low: float, high: float) -> list[Kernel]:
    ring = _RING * sigma
    radial = (0.75 * low * ring, 0.6 * high * ring)
    angular = sorted({round(part * high * ring) for part in (0.0, 0.17, 0.34, 0.51, 0.76)})
    return [
        Spiral(sign * u, v, scale=_centre(ring), bandwidth=_BANDWIDTH, sigma=sigma)
        for u in radial
        for v in angular
        for sign in ((1, -1) if v else (1,))
    ]


def _hyperbolics(sigma: float, low: float, high: float) -> list[Kernel]:
    ring = _RING * sigma
    u, v = 0.75 * low * ring, low * ring
    shears: tuple[Literal["stretch", "shear"], ...] = ("stretch", "shear")
    return [
        Hyperbolic(
            shear,
            u,
            sign * v,
            scale=_centre(ring),
            bandwidth=_BANDWIDTH,
            width=_WIDTH,
            signs=signs,
            sigma=sigma,
        )
        for shear in shears
        for sign in (1, -1)
        for signs in _SIGNS
    ]


def _centre(ring: float) -> float:
    """Scale of a kernel whose window times the Jacobian's 1/r² is largest on the ring."""
    return ring * math.exp(2 * _BANDWIDTH**2)


def _two_lengths(wavelengths: Any) -> tuple[float, float]:
    wanted = "must be two lengths in px, 2.5 ≤ shortest < longest, such as (7.0, 21.0)"
    values = tuple(wavelengths) if isinstance(wavelengths, Iterable) else ()
    good = len(values) == 2 and all(is_number(value) for value in values)
    require(good and 2.5 <= values[0] < values[1], "wavelengths", wavelengths, wanted)
    return float(values[0]), float(values[1])
