"""Spectrum: turn, zoom and shear of two frames whose shift is not known, from their amplitude spectra.

Under x' = A x + t the amplitude spectrum changes as S₁(k) = S₀(Aᵀk), whatever the shift t. Two steps find A.

*Moments.* The second moments of the power spectrum, M = Σ k kᵀ S² / Σ S², change as M₀ = Aᵀ M₁ A, hence

    A = M₁^(−½) R M₀^(½),    R a rotation.

White noise adds a constant to S², which is read off the corners of the spectrum and subtracted. A homogeneous texture
has the same moments wherever it is seen; of N details they are known to about 1/√N.

*Turn.* On κ = M^(−½) k the spectra differ by R alone, and on axes (log |κ|, atan2 κ) this is a shift: the pair
(L_s, L_r) of Eagleson's §4.3, applied to spectra. The correlation along these axes, each ring less its mean and of unit
power, has its summits at the turns; the lag in log |κ| corrects the zoom. Spectra are symmetric under k → −k: every
summit is two turns, half a turn apart. Amplitude spectra of a random texture agree only as far as the same content is
seen, so the inner half of each frame is also compared with the whole of the other.

| symbol | name |
|---|---|
| A | linear, 2 × 2 |
| M | `moments` |
| S(k) | `amplitude`, half of the plane: columns k_x ≥ 0 |
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Real = NDArray[np.float64]

RINGS, ANGLES, LAGS = 48, 720, 8
_INNER, _OUTER = 0.35, 2.6  # |κ|; its root mean square is √2
_PARTS = ((1.0, 1.0), (0.5, 1.0), (1.0, 0.5))
_SUMMITS = 4
_APART = math.radians(3)
_LEAST_SIDE = 32
_LEAST_RATIO = 0.01  # of the moments along the axes of the texture


class Linear(NamedTuple):
    """A candidate for A, and how far its summit rises above the correlation, in standard deviations."""

    linear: Real
    height: float


class Spectrum(NamedTuple):
    """Amplitude spectrum of a part of a frame under a Hann window, and the second moments of its power."""

    amplitude: NDArray[Any]
    side: tuple[int, int]
    moments: Real


def linear_candidates(image0: NDArray[Any], image1: NDArray[Any]) -> list[Linear]:
    """Find turns, zooms and shears that two frames may differ by, whatever the shift.

    Parameters
    ----------
    image0, image1 : arrays, shape (height, width)
        Without a mean, 0 where masked; they may differ in shape.

    Returns
    -------
    list of Linear
        The highest first, each followed by the one half a turn further; none if a spectrum has no texture.

    Examples
    --------
    >>> from sixflow import synth
    >>> motion = synth.Affine.rotation(2.0, centre=(63.5, 63.5))
    >>> made = synth.pair(synth.Texture(), motion, (128, 128))
    >>> found = linear_candidates(made.frame0 - 128, made.frame1 - 128)
    >>> bool(min(abs(one.linear - motion.G - np.eye(2)).max() for one in found[:2]) < 0.1)
    True
    """
    whole = [spectrum_of(image) for image in (image0, image1)]
    roots = [_root(spectrum.moments) for spectrum in whole]
    if any(root is None for root in roots):
        return []
    root0, root1 = roots
    assert root0 is not None
    assert root1 is not None
    found: list[tuple[float, float, float]] = []
    for share0, share1 in _PARTS:
        parts = [
            spectrum if share == 1 else spectrum_of(_inner(image, share))
            for spectrum, image, share in zip(whole, (image0, image1), (share0, share1), strict=True)
        ]
        rings = [_rings(part, root) for part, root in zip(parts, (root0, root1), strict=True)]
        found += _summits(_correlated(*rings))
    kept: list[Linear] = []
    angles: list[float] = []
    for height, angle, scale in sorted(found, reverse=True):
        if any(abs(math.remainder(angle - other, math.pi)) < _APART for other in angles):
            continue
        angles.append(angle)
        for turn in (angle, angle + math.pi):
            cosine, sine = math.cos(turn), math.sin(turn)
            R = scale * np.array([[cosine, -sine], [sine, cosine]])
            A = np.asarray(np.linalg.solve(root1, R @ root0), dtype=np.float64)
            kept.append(Linear(A, height))
    return kept


def spectrum_of(image: NDArray[Any]) -> Spectrum:
    """Amplitude spectrum under a Hann window, and its moments less the noise's."""
    from scipy.fft import rfft2

    height, width = image.shape
    window = np.outer(*(np.hanning(size + 2)[1:-1] for size in image.shape)).astype(image.dtype)
    amplitude = np.abs(rfft2((image - image.mean()) * window))
    k_x, k_y = np.meshgrid(2 * np.pi * np.fft.rfftfreq(width), 2 * np.pi * np.fft.fftfreq(height))
    square = k_x**2 + k_y**2
    power = amplitude.astype(np.float64) ** 2
    corner = square > np.pi**2
    power -= (
        np.median(power[corner]) / math.log(2) if corner.any() else 0
    )  # an exponential's mean by its median
    power[corner] = 0
    power[:, 1:] *= 2  # the other half of the plane
    total = power.sum()
    diagonal = (k_x * k_x * power).sum(), (k_y * k_y * power).sum()
    mixed = (k_x * k_y * power).sum()
    moments = np.array([[diagonal[0], mixed], [mixed, diagonal[1]]])
    return Spectrum(amplitude, (height, width), moments / total if total > 0 else np.zeros((2, 2)))


def _inner(image: NDArray[Any], share: float) -> NDArray[Any]:
    """The middle of an image."""
    size = [max(min(_LEAST_SIDE, full), round(share * full)) for full in image.shape]
    first = [(full - part) // 2 for full, part in zip(image.shape, size, strict=True)]
    return image[first[0] : first[0] + size[0], first[1] : first[1] + size[1]]


def _root(moments: Real) -> Real | None:
    """M^½; None of a texture that leads in one direction only."""
    values, vectors = np.linalg.eigh(moments)
    if not values[0] > max(1e-6, _LEAST_RATIO * values[1]):
        return None
    result: Real = vectors * np.sqrt(values) @ vectors.T
    return result


def _rings(spectrum: Spectrum, root: Real) -> Real:
    """Amplitude at rings of κ, each less its mean and of unit power; shape (RINGS, ANGLES), half a turn."""
    from scipy.ndimage import map_coordinates

    radius = np.geomspace(_INNER, _OUTER, RINGS)[:, None]
    angle = np.pi / ANGLES * np.arange(ANGLES)
    k_x, k_y = np.einsum("ij,jra->ira", root, np.stack([radius * np.cos(angle), radius * np.sin(angle)]))
    flip = np.where(k_x < 0, -1, 1)
    height, width = spectrum.side
    place = [flip * k_y * height / (2 * np.pi) % height, flip * k_x * width / (2 * np.pi)]
    rings = map_coordinates(spectrum.amplitude, place, order=1, mode="grid-wrap", output=np.float64)
    seen = np.maximum(np.abs(k_x), np.abs(k_y)) < 0.95 * np.pi
    rings *= seen
    rings -= seen * (rings.sum(axis=1) / np.maximum(seen.sum(axis=1), 1))[:, None]
    power = (rings**2).mean(axis=1, keepdims=True)
    whitened: Real = rings / np.sqrt(np.where(power > 0, power, 1))
    return whitened


def _correlated(rings0: Real, rings1: Real) -> Real:
    """Correlation at lags −LAGS … LAGS of log |κ| (rows) and all angles."""
    spectra = [np.fft.rfft(rings, axis=1) for rings in (rings0, rings1)]
    rows = []
    for lag in range(-LAGS, LAGS + 1):
        first = spectra[0][max(0, -lag) : RINGS - max(0, lag)]
        second = spectra[1][max(0, lag) : RINGS - max(0, -lag)]
        rows.append(np.fft.irfft((first.conj() * second).sum(axis=0), ANGLES) / math.sqrt(len(first)))
    return np.array(rows)


def _summits(surface: Real) -> list[tuple[float, float, float]]:
    """(height, angle of R, factor on A) at the highest summits."""
    step = math.log(_OUTER / _INNER) / (RINGS - 1)
    spread = surface.std()
    if not spread > 0:
        return []
    left = (surface - surface.mean()) / spread
    out = []
    near = round(_APART / np.pi * ANGLES)
    for _ in range(_SUMMITS):
        row, column = np.unravel_index(int(left.argmax()), left.shape)
        height = float(left[row, column])
        # a texture that has grown has shrunk in κ: S₁ at κ is S₀ at κ · factor
        out.append((height, np.pi / ANGLES * float(column), math.exp(-(float(row) - LAGS) * step)))
        left[:, np.arange(column - near, column + near + 1) % ANGLES] = -np.inf
    return out
