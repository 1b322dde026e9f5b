"""Component velocities from local phase, and an affine fit of them (Fleet & Jepson 1990).

The response of a quadrature pair of Gabor filters to an image is R(x) = ρ(x) exp(iφ(x)). Contours of constant phase
move with the image:

    ∇φ·u + φ_t = 0        component velocity  v_n = −φ_t/|∇φ|  along  n = ∇φ/|∇φ|

| symbol | name |
|---|---|
| k, σ_g | wave vector and radius of the Gabor filter exp(−r²/(2σ_g²)) exp(i k·x), less its answer to a constant |
| β | `bandwidth`, octaves: σ_g = (2^β + 1)/(2^β − 1)/|k| |
| φ_t | arg(R1 R0*) |
| ∇φ | mean over both frames of k + Im(M* ∇M)/|M|², M = R exp(−i k·x), 5-point central differences |

*Stability test.* Near the zeros of R, phase turns rapidly in space and means nothing. There the instantaneous
frequency leaves the filter's band and the amplitude varies fast. A component is dropped if in either frame

    σ_g |∇φ − k| > `frequency_deviation`  or  σ_g |∇ρ|/ρ > `amplitude_deviation`  or  ρ ≤ `least_amplitude` max ρ

with 1.25, 1.25 and 5 % by default. (Fleet and Jepson filter in space and time, over many frames, and take
φ_t as a derivative; here are two frames, as for all methods of this package, and φ_t is the difference.)

*Affine fit.* Where the components of several orientations gather in a window, minimise Σ w (n·(d + L (x − x_p))
− v_n)², w Gaussian. As ∇φ is the mean of both frames, d and L belong to the steady velocity between them, the
Lie-algebra element, up to third order; the six are those of the finite map exp(Σ τ_k L_k)
(`sixflow.convention.six_from_coefficients`), to first order divergence = 2τ_s, curl = 2τ_r, stretch = 2τ_b,
shear = 2τ_B.

What it can claim: phase of a translating pattern moves exactly, hence translations are found up to the wrap of
phase, |u| < half the local wavelength (a quarter of `wavelength` is safe); the remaining error is that of phase
which is not straight within its own displacement, of order |u|³. Under a deformation the filter does not turn
and grow with the image: each response is a mean of the motion within its radius, off by about |G| σ_g/√2, with
zero mean on a random texture.

References
----------
D. J. Fleet and A. D. Jepson, "Computation of component image velocity from local phase information", International
Journal of Computer Vision 5, 77–104 (1990). D. J. Fleet and A. D. Jepson, "Stability of phase information", IEEE
Transactions on Pattern Analysis and Machine Intelligence 15, 1253–1268 (1993).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from sixflow.checks import number, require, whole
from sixflow.convention import six_from_coefficients
from sixflow.eigenfilters.historical._frames import Problem, away_from_gaps
from sixflow.eigenfilters.historical.moments import WindowSums, in_pixels
from sixflow.eigenfilters.historical.result import HistoricalField

Array = NDArray[Any]

_REACH = 3.0  # of the Gabor filter, in σ_g: exp(−4.5) = 0.011
_DERIVATIVE = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12  # exact up to the fourth power of x
_COMPONENTS = 1.0  # stable components per pixel that a window needs, on average


class LocalPhase(NamedTuple):
    """The response of one filter to one frame: R, ∇φ, and where it passes the stability test."""

    response: Array
    phase_x: Array
    phase_y: Array
    stable: Array


def fleet_jepson(
    frame0: ArrayLike,
    frame1: ArrayLike,
    *,
    grid_step: int = 8,
    window: float = 31.0,
    wavelength: float = 8.0,
    orientations: int = 6,
    bandwidth: float = 0.8,
    frequency_deviation: float = 1.25,
    amplitude_deviation: float = 1.25,
    least_amplitude: float = 0.05,
    condition: float = 10.0,
) -> HistoricalField:
    """Measure the six by an affine fit of component velocities from local phase.

    The formulas are those of the module (Fleet & Jepson 1990).

    Parameters
    ----------
    frame0, frame1 : array, shape (height, width)
        Reference and moved frame, real grey values; NaN and ±Inf mark pixels without a value.
    grid_step : int
        Distance of the grid points, px, 1 to the smaller side of the frames.
    window : float
        Side of the square subset of the same noise, over which the fit is made, px, 5 to the smaller side of
        the frames.
    wavelength : float
        Wavelength of the filters, px, 2.5 to half the smaller side of the frames. Displacements should stay below
        a quarter of it.
    orientations : int
        Number of filters, evenly spread over half a turn, 2 to 64; three or more make the fit well conditioned.
    bandwidth : float
        Octaves, 0.2 to 2.
    frequency_deviation, amplitude_deviation : float
        Limits of the stability test, in units of 1/σ_g, above 0. Smaller is stricter.
    least_amplitude : float
        Least amplitude relative to the filter's greatest in the frame, 0 up to 1.
    condition : float
        Largest condition number of the fit (of its design matrix, lengths in units of the window's σ), at least 1.

    Returns
    -------
    HistoricalField
        Not valid where the window holds less than one stable component per pixel on average, or they are too
        much alike for the fit.

    Raises
    ------
    InputError
        If a frame is not two-dimensional and real, the shapes differ, or an argument is outside its range.

    Examples
    --------
    >>> from sixflow.synth import Affine, Speckle, pair
    >>> made = pair(Speckle(sigma=2.0), Affine.rotation(0.01, centre=(48.0, 48.0)), (96, 96))
    >>> field = fleet_jepson(made.frame0, made.frame1)
    >>> bool(abs(field.six[6, 6, 3] - 0.02) < 0.004)
    True
    """
    problem = Problem.of(frame0, frame1, grid_step, window)
    longest = min(problem.frame0.shape) / 2
    number("wavelength", wavelength, least=2.5, most=max(longest, 2.5), unit="px")
    whole("orientations", orientations, 2, 64)
    number("bandwidth", bandwidth, least=0.2, most=2, unit="octaves")
    frequency_deviation = number("frequency_deviation", frequency_deviation, above=0)
    amplitude_deviation = number("amplitude_deviation", amplitude_deviation, above=0)
    number("least_amplitude", least_amplitude, least=0)
    require(least_amplitude < 1, "least_amplitude", least_amplitude, "must be below 1; 0.05 is customary")
    number("condition", condition, least=1)

    size = 2 * math.pi / wavelength
    radius = (2**bandwidth + 1) / (2**bandwidth - 1) / size
    limits = (frequency_deviation, amplitude_deviation, least_amplitude)
    reach = math.ceil(_REACH * radius) + 2
    inside = [away_from_gaps(valid, reach) for valid in (problem.valid0, problem.valid1)]

    planes = np.zeros((6, *problem.frame0.shape))  # n_x², n_x n_y, n_y², n_x v_n, n_y v_n, components
    for turn in range(orientations):
        angle = math.pi * turn / orientations
        k = (size * math.cos(angle), size * math.sin(angle))
        first = _local_phase(problem.frame0, inside[0], k, radius, limits)
        second = _local_phase(problem.frame1, inside[1], k, radius, limits)
        planes += _components(first, second)

    sums = WindowSums(problem.frame0.shape, problem.grid, problem.sigma)
    A, b = sums.normal_equations((planes[0], planes[1], planes[2]), (planes[3], planes[4]))
    spread = np.linalg.eigvalsh(A)
    valid = (sums.total(planes[5]) >= _COMPONENTS) & (spread[..., 0] * condition**2 >= spread[..., -1])
    A = np.where(valid[..., None, None], A, np.eye(6))
    tau = in_pixels(np.linalg.solve(A, b[..., None])[..., 0], problem.sigma)
    six = six_from_coefficients(np.where(valid[..., None], tau, np.nan))
    return HistoricalField(six, problem.grid.x, problem.grid.y, valid, "Fleet & Jepson")


def _local_phase(
    image: Array, inside: Array, k: tuple[float, float], radius: float, limits: tuple[float, float, float]
) -> LocalPhase:
    """Filter one frame and test the stability of its phase."""
    frequency_deviation, amplitude_deviation, least_amplitude = limits
    response = _gabor(image, k, radius)
    rows, columns = (np.arange(n) for n in image.shape)
    carrier = np.exp(-1j * (k[0] * columns + k[1] * rows[:, None]))
    M = response * carrier
    amplitude = np.abs(M)
    floor = least_amplitude * amplitude[inside].max(initial=0.0)
    stable = inside & (amplitude > floor)
    over = np.where(stable, M, 1.0)
    log_x = ndimage.correlate1d(M, _DERIVATIVE, axis=1) / over  # (log M)_x = ρ_x/ρ + i(φ_x − k_x)
    log_y = ndimage.correlate1d(M, _DERIVATIVE, axis=0) / over
    stable &= radius * np.hypot(log_x.imag, log_y.imag) <= frequency_deviation
    stable &= radius * np.hypot(log_x.real, log_y.real) <= amplitude_deviation
    return LocalPhase(response, k[0] + log_x.imag, k[1] + log_y.imag, stable)


def _gabor(image: Array, k: tuple[float, float], radius: float) -> Array:
    """R(x) = Σ_s I(x − s) G(s) (exp(i k·s) − c), c such that a constant is answered by 0."""
    reach = math.ceil(_REACH * radius)
    s = np.arange(-reach, reach + 1)
    gauss = np.exp(-(s**2) / (2 * radius**2))
    gauss /= gauss.sum()
    wave_x, wave_y = (gauss * np.exp(1j * part * s) for part in k)
    waved = _separable(image.astype(np.complex128), wave_x, wave_y)
    smooth = _separable(image, gauss, gauss)
    return waved - wave_x.sum() * wave_y.sum() * smooth


def _separable(image: Array, over_columns: Array, over_rows: Array) -> Array:
    first = ndimage.convolve1d(image, over_columns, axis=1, mode="constant")
    return np.asarray(ndimage.convolve1d(first, over_rows, axis=0, mode="constant"))


def _components(first: LocalPhase, second: LocalPhase) -> Array:
    """Planes n_x², n_x n_y, n_y², n_x v_n, n_y v_n and 1 of the stable component velocities, 0 elsewhere."""
    phase_t = np.angle(second.response * first.response.conj())
    phase_x, phase_y = (first.phase_x + second.phase_x) / 2, (first.phase_y + second.phase_y) / 2
    steepness = np.hypot(phase_x, phase_y)
    stable = first.stable & second.stable & (steepness > 0)
    steepness = np.where(stable, steepness, 1.0)
    n_x, n_y, v_n = phase_x / steepness, phase_y / steepness, -phase_t / steepness
    planes = np.stack([n_x * n_x, n_x * n_y, n_y * n_y, n_x * v_n, n_y * v_n, np.ones_like(v_n)])
    return np.where(stable, planes, 0.0)
