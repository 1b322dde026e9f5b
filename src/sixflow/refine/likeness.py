"""Likeness: how alike two windows are, and of how many independent cells of texture that is said.

ρ is the zero-normalised correlation of the windows, which a change of gain or offset leaves as it is. Windows that have
nothing in common are correlated by chance with a variance 1/N,

    N = A / ∫c₀c₁ dd,    A = b² (Σ_n w_n p_n)² / Σ_n w_n² p_n²,

c₀ and c₁ the correlation functions of the textures of both frames, A the area that the texture of a window fills: p_n
is the power of the gradients at the nodes of the moments, b px apart, w_n the window there. An even texture fills
(∫w)²/∫w² = 4πσ², the area of a Gaussian window; a few bright dots fill little.

If c fell as exp(−½ dᵀK d), as near d = 0, ∫c² were

    a = π/√det K,    K = ⟨g gᵀ⟩/var(m),

m the mean of the two frames, whose gradients g the window sums hold: that follows the texture from window to window.
Noise and fine detail make K large, and a small, while coarse parts of the texture go on. So a is multiplied by what
∫c₀c₁/a is in the whole frames, from spectra P of tiles, c₀ and c₁ their transforms: ∫c₀c₁ = Σ P₀P₁/(ΣP₀ ΣP₁).

*Evidence.* Windows that have nothing in common are correlated all the same, the more so as six numbers and the light
are chosen to make them so. With N such cells and p = 7, ρ² has a beta
distribution then, and

    ε = −ln P(ρ² by chance),    P = I_{1−ρ²}(b, p/2) ≈ ρ^{p−2} (1 − ρ²)^b / (b B(b, p/2)),    b = (N − 1 − p)/2

is the evidence that the window matches, nats: about ½(N − p) ln 1/(1 − ρ²). Where outlying pixels are down-weighted,
the pixels that are kept are alike because the others are left out. Of patterns without anything in common κ₀ of the
texture would be kept (`engine.weigh.by_chance`); if κ is,

    ε = κ [N ln κ + ε] + (1 − κ) N ln[(1 − κ)/(1 − κ₀)].

| symbol | name |
|---|---|
| ρ | `correlation` |
| N | `cells` |
| ∫c₀c₁/a | `coarseness` |
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.moments import plane_at
from sixflow.engine.rows import DERIVATIVE
from sixflow.engine.sweep import NORMAL_RANKS
from sixflow.engine.weigh import by_chance
from sixflow.maps.grid import Grid
from sixflow.prepare.frame import Frame
from sixflow.refine.moments import Moments
from sixflow.refine.solution import WindowStatistics
from sixflow.refine.windows import WindowSums, sums_of

TILES = 3
"""Tiles along each side of a frame."""

PARAMETERS = 7
"""Six numbers and the light."""

Array = NDArray[np.float64]


def likeness(sums: WindowSums) -> tuple[Array, Array]:
    """Correlation of the windows of every grid point, and 1/a, cells of texture per px²; NaN without contrast."""
    weight, _, _, *totals = np.moveaxis(sums.statistics.astype(np.float64), -1, 0)
    xx, xy, yy = (np.asarray(sums.normal[..., k], np.float64) for k in (0, 6, 12))
    with np.errstate(invalid="ignore", divide="ignore"):
        mean0, power0, mean1, power1, product = (total / weight for total in totals)
        variance0, variance1 = power0 - mean0**2, power1 - mean1**2
        common = product - mean0 * mean1
        correlation = common / np.sqrt(np.maximum(variance0, 0) * np.maximum(variance1, 0))
        variance = (variance0 + variance1 + 2 * common) / 4
        density = np.sqrt(np.maximum(xx * yy - xy**2, 0)) / (math.pi * weight * variance)
    return correlation, density


def evidence(correlation: NDArray[Any], cells: NDArray[Any]) -> Array:
    """ε of windows with a correlation and so many independent cells, nats; 0 where there is none.

    Examples
    --------
    >>> evidence(np.array([0.0, 0.5, 0.9]), np.array([100.0, 100.0, 8.0])).round(1)
    array([0. , 8.2, 0. ])
    """
    a, b = PARAMETERS / 2, (np.asarray(cells, np.float64) - 1 - PARAMETERS) / 2
    with np.errstate(invalid="ignore", divide="ignore"):
        square = np.minimum(correlation, 1 - 1e-7) ** 2
        known = (b > 0) & (correlation > 0) & (square > (a - 1) / (a + b - 1))
        rising = b * np.log1p(-square) + (a - 1) * np.log(square)
        chance = rising - np.log(b) + a * np.log(b + (a - 1) / 2) - math.lgamma(a)
    return np.where(known, np.maximum(-chance, 0.0), 0.0)


def evidence_of(statistics: WindowStatistics) -> Array:
    """ε of the windows of a pass, nats; shape (rows, columns)."""
    correlation, cells = statistics.correlation, statistics.cells
    assert correlation is not None
    assert cells is not None
    alone = evidence(correlation, cells)
    if statistics.matched is None:
        return alone
    kept, chance = np.clip(statistics.matched, 0.0, 1.0), by_chance(statistics.residual)
    with np.errstate(invalid="ignore", divide="ignore"):
        lost = np.where(kept < 1, (1 - kept) * np.log((1 - kept) / (1 - np.minimum(chance, 1 - 1e-7))), 0.0)
        total = kept * (cells * np.log(kept) + alone) + cells * lost
    return np.where((kept > chance) & (total > 0), total, 0.0)


def textured_area(moments: Moments, sums: WindowSums, grid: Grid, sigma: float) -> Array:
    """A of the window of every grid point, px²; NaN without texture."""
    lattice, first = moments.lattice, plane_at(NORMAL_RANKS, 2, 0, 0)
    power = moments.normal[:, first : first + 1] + moments.normal[:, first + 2 : first + 3]
    largest = float(power.max(initial=0)) or 1.0
    squares = sums_of((power / largest) ** 2, (0, 0, 1), lattice, grid, sigma, power=2)[..., 0]
    total = (sums.normal[..., 0] + sums.normal[..., 12]).astype(np.float64) / largest
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.minimum(lattice.spacing**2 * total**2 / squares, 4 * math.pi * sigma**2))


def coarseness(still: Frame, moved: Frame, sigma: float) -> float:
    """∫c₀c₁/a of two frames, at least 1, at the scale of a window.

    Examples
    --------
    >>> from sixflow.prepare.frame import NO_MASK
    >>> noise = [Frame(image, NO_MASK) for image in np.random.default_rng(0).normal(size=(2, 128, 128))]
    >>> coarseness(*noise, 8.7) < 1.2
    True
    """
    # nobody knows what the mask of frame 0 leaves of frame 1
    frames = (still, still) if still.valid.size else (still, moved)
    power = [spectrum_of(frame, sigma) for frame in frames]
    side = len(power[0])
    totals = [float(part.sum()) for part in power]
    if not all(totals):
        return 1.0
    both = sum(part / total for part, total in zip(power, totals, strict=True)) / 2
    omega = 2 * np.pi * np.fft.fftfreq(side)
    response = 2 * np.sin(np.outer(omega, np.arange(1, len(DERIVATIVE) + 1))) @ np.asarray(DERIVATIVE)
    y, x = response[:, None], response
    xx, xy, yy = (float((both * product).sum()) for product in (x * x, x * y, y * y))
    overlap = correlation_area(*power)
    return max(1.0, overlap * math.sqrt(max(xx * yy - xy**2, 0.0)) / math.pi)


def correlation_area(first: Array, second: Array) -> float:
    """∫c₀c₁ of two textures from the spectra of their tiles, px²."""
    return float(first.size * (first * second).sum() / (first.sum() * second.sum()))


def spectrum_of(frame: Frame, sigma: float) -> Array:
    """Mean power spectrum of tiles of a frame of some windows' size, variance per pixel; shape (side, side)."""
    side = min(2 ** math.ceil(math.log2(max(4 * sigma, 8))), *frame.image.shape)
    return frame.spectrum(side, _spectrum)


def _spectrum(image: NDArray[Any], valid: NDArray[Any], side: int) -> Array:
    from scipy.fft import fft2

    line = np.hanning(side + 1)[:-1].astype(image.dtype)
    taper = np.outer(line, line)
    rows, columns = (np.unique(np.linspace(0, size - side, TILES).astype(int)) for size in image.shape)
    tiles = np.stack([image[y : y + side, x : x + side] for y in rows for x in columns])
    tapers = np.broadcast_to(taper, tiles.shape)
    if valid.size:
        known = np.stack([valid[y : y + side, x : x + side] for y in rows for x in columns]) != 0
        tiles, tapers = np.where(known, tiles, 0), np.where(known, taper, 0)
    total = np.maximum(tapers.sum((1, 2), keepdims=True), np.finfo(taper.dtype).tiny)
    transform = fft2((tiles - (tiles * tapers).sum((1, 2), keepdims=True) / total) * tapers)
    power = (transform.real**2 + transform.imag**2).sum(axis=0, dtype=np.float64)
    return np.asarray(power / max(float((tapers**2).sum()), np.finfo(np.float32).tiny))
