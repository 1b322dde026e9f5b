"""Bias: the expected square of what a window leaves out, told by windows of other sizes on the same frames.

Window j measures θ_j = T_j θ + noise of variance V_j, and leaves out β_j = (1 − T_j) θ. Two neighbouring windows of a
ladder, i the finer, differ by a **band** of the motion and by noise,

    d_i = θ_i − θ_{i+1} = (T_i − T_{i+1}) θ + noise,    E|noise|² = N_i = f_i V_i,  f_i = ∫(T_i − T_{i+1})² / ∫T_i²

(∫ over wave numbers as in `engine.response`, for gradients with k²). So what window j leaves out is the bands of all
finer pairs, and what the finest leaves out. Each of the six is treated by itself.

**The energy of a band**, E_i, is what K d² is above K N, K the mean under a Gaussian of twice the coarser window's σ
(or step), in which points count by 1/V_i.
Two things blur that: chance, which lets the mean of n squares be 1 + x as rarely as a normal deviate exceeds z, at the
rate of `sixflow.chance`; and N itself, which holds for a uniform texture: it varies from point to point as V does, and
its mean is as wrong as it varies (measured on speckle for windows of 8, 11, 16, 22 and 31 px: d² is above N by .73,
.65, .35, .17, .02 of it, V varies by .77, .51, .33, .22, .15). So

    doubt² = (N x/z)² + var_K N,      E = P + w (K d² − K N − P),

P = `SHARES` E_{i+1} what the next coarser band lets expect. Bands are taken from coarse to fine, because the noise of
fine windows would hide what coarse ones rule out. Of two reasons to believe what is found rather than what is expected,
the stronger holds: it is plainly there, w = 1 − z² doubt²/(…)² (Stein's positive part), or it is not unlikely,
w = E_{i+1}²/(E_{i+1}² + doubt²): a band may well differ from what is expected by all that the coarser one has. The
first band has no coarser: E = 0 is expected. It is what noise hides least, and all the others are hidden behind it:
there z = 1. Components of a kind are judged together.

K spreads over four windows, and one discontinuity, or anything foreign, that far away makes E what it is not here.
But what is found, beyond what is expected, is not more than the differences about the point allow: with k the mean of
logarithms, which nothing single rules, under a Gaussian as wide as the window,

    ln (E + N) < k ln d² − x',    x' = ψ(n/2) − ln n/2 − z √(ψ′(n/2)/m)

for n components and m independent values under k; chance makes it more as rarely as `RARE` says.

**At the point** the band is between 0 and d: given E and N, it is d E/(E + N), with variance v = E N/(E + N) (Wiener).
Bands overlap, and a wave lies in several at once. With the correlation c_m between two that are m half-octaves apart,
for a spectrum that is even over an octave,

    E|β_j|² = Σ_a Σ_b c_|a−b| √(E_a E_b) + rest
    given d:  (Σ_b d_b E_b/(E_b + N_b))² + Σ_a Σ_b c_|a−b| √(v_a v_b) + rest

The rest is what the finest window leaves out: more bands, each with the share q of the energy of the one before and
correlated as they are, which add up to E q/(1 − q) (1 + 2a/(1 − a)), a = c_1 √q; their mean is a/(1 − a) of the
finest band. A wave that a plain window attenuates a little lies in all finer bands: q goes on as it is found. Sharpened
windows pass it, and their finer bands hold other waves.

Where a window is cut, by a border or a mask, its fit sees one side only and errs in first order, and at an outline
structures begin that the inside does not have: what is found in the first band is taken at its word, and bands may fall
as slowly as at a discontinuity. Beside an outline, unlike a border, the motion is steepest where the fewest points are,
and what is about the point bounds nothing.

| symbol | name |
|---|---|
| f, x | `law_of` |
| c | `overlap` |
| E|β|², given d | `Bands.expected`, `Bands.seen` |
"""

from __future__ import annotations

import dataclasses
import math
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.chance import normal_limit
from sixflow.engine.bias import (
    CUT,
    OUTLINED,
    PLANES,
    difference_strip,
    energy_strip,
    left_out_strip,
    log_strip,
    smooth_strip,
)
from sixflow.engine.response import response
from sixflow.engine.threads import over_strips
from sixflow.engine.window import CUT as CUT_AT
from sixflow.maps.grid import Grid
from sixflow.plan import Window
from sixflow.refine.solution import Solution

SPREAD = 2.0
"""Standard deviation of K in those of the coarser window, or in steps of the grid where that is more: K spreads over
four such windows, and holds 50 points, whose mean square chance moves by a fifth."""
NEAR = 1.0
"""The same of k."""
RARE = 1.0
"""z of the least that chance makes of a mean under k."""
LOGARITHM = {2: (-0.5772, 1.6449), 4: (-0.2704, 0.6449)}
"""Mean and variance of ln(χ²/n) by its degrees of freedom n: ψ(n/2) − ln(n/2) and ψ′(n/2)."""
SHARES = (0.5, 1.0)
"""Energy of a band over that of the next coarser, of displacement and gradient, where nothing more is seen: that of
kinks, and of two-dimensional turbulence, whose spectra fall by k⁻² per octave."""
ROUGHER = math.sqrt(2)
"""Factor of these where a window is cut: that of discontinuities, k⁻¹."""
BEYOND = math.sqrt(0.5)
"""q: the same share for bands finer than the finest window, at most; and at least, where windows are sharpened."""
SMOOTH = 0.25
"""q at least, where windows are plain: that of a motion which is smooth over them, β = σ²/2 ∇²u."""
WHOLE = 0.98
"""Share of a window on counted pixels, below which it is cut."""
GRID_STRIP = 16

Array = NDArray[Any]


@dataclasses.dataclass(frozen=True)
class Bands:
    """What neighbouring windows of a ladder differ by.

    Attributes
    ----------
    expected : array, shape (levels, rows, columns, 6)
        Expected square of what each window leaves out of the six, by the energies around each point.
    seen : array, shape (levels, rows, columns, 6)
        The same, given the differences at the point itself.
    noise : array, shape (levels, rows, columns, 6)
        Variance of each window's six: that of the point, or their mean about it if it is greater.
    """

    expected: Array
    seen: Array
    noise: Array


def bias_of(levels: list[Solution], windows: tuple[Window, ...], grid: Grid) -> NDArray[np.float64]:
    """Expected square of what each window leaves out of the six; (levels, rows, columns, 6).

    For one window w, take the middle of a ladder [w/√2, w, √2 w]: the coarser tells what to expect of the finer, whose
    noise may hide it.

    Parameters
    ----------
    levels : list of Solution
        From fine to coarse, √2 apart, on one grid. Failed points take no part.
    windows : tuple of Window
        That they were measured with, all sharpened alike.
    grid : Grid
    """
    return bands_of(levels, windows, grid).seen


def rules(bias: Array, covariance: Array) -> NDArray[np.bool_]:
    """Points where what the window leaves out rules the error: u or v by more than noise is ever taken for an error.

    Parameters
    ----------
    bias : array, shape (..., 6)
    covariance : array, shape (..., 6, 6)

    Examples
    --------
    >>> [bool(rules(np.full(6, 1e-4), np.eye(6) * noise)) for noise in (1e-4, 6e-6)]
    [False, True]
    """
    noise = np.stack([covariance[..., k, k] for k in range(2)], axis=-1)
    with np.errstate(invalid="ignore"):
        return np.asarray((bias[..., :2] > normal_limit() ** 2 * noise).any(axis=-1))


def bands_of(levels: list[Solution], windows: tuple[Window, ...], grid: Grid) -> Bands:
    """Compare neighbouring windows (`bias_of`)."""
    count, shape = len(levels) - 1, (*grid.shape, 6)
    usable = [~level.failed & np.isfinite(level.maps[0] + level.covariance[..., 0, 0]) for level in levels]
    energies, noises, differences = (np.empty((count, *shape), np.float32) for _ in range(3))
    above, noise = np.zeros(shape, np.float32), np.empty((count + 1, *shape), np.float32)
    for b in range(count - 1, -1, -1):
        (fine, coarse), top = levels[b : b + 2], b == count - 1
        planes = np.empty((*grid.shape, PLANES), np.float32)
        measured = fine.maps, fine.covariance, fine.left
        known = usable[b] & usable[b + 1] & (fine.period < coarse.period)
        _over(
            grid,
            difference_strip,
            measured,
            coarse.maps,
            windows[b].sigma,
            known,
            out=(differences[b], planes),
        )
        law = law_of(windows[b], windows[b + 1], grid.step, top=top)
        logarithms = np.empty((*grid.shape, 3), np.float32)
        _over(grid, log_strip, planes, law, out=(logarithms,))
        near = _smooth(logarithms, windows[b + 1], grid, NEAR)
        band = planes, _smooth(planes, windows[b + 1], grid, SPREAD), near, noise[b]
        _over(
            grid,
            energy_strip,
            band,
            above,
            _cut(coarse, windows[b + 1], grid),
            law,
            out=(noises[b], energies[b]),
        )
        above = energies[b]
    for b, (level, window) in enumerate(zip(levels, windows, strict=True)):
        own = _variances(level, window)
        noise[b] = np.fmax(noise[b], own) if b < count else own
    expected, seen = (np.zeros((count + 1, *shape), np.float32) for _ in range(2))
    if count:
        sharpen, flat = windows[0].sharpen, (grid.rows, -1)
        bands = tuple(array.reshape(count, *flat) for array in (energies, noises, differences))
        laws = overlap(sharpen, max(count, 2)), np.array([BEYOND if sharpen else SMOOTH, BEYOND])
        out = expected.reshape(count + 1, *flat), seen.reshape(count + 1, *flat)
        _over(grid, left_out_strip, bands, *laws, out=out)
    _as_far_as_sharpened(levels, windows, expected, seen)
    return Bands(expected, seen, noise)


def _as_far_as_sharpened(
    levels: list[Solution], windows: tuple[Window, ...], expected: Array, seen: Array
) -> None:
    """Let points that did not bear the sharpening leave out what the window does that resolves as little as they."""
    periods = np.array([window.period for window in windows])
    whole = expected.copy()
    for b, level in enumerate(levels):
        alike = np.searchsorted(periods * 1.01, np.nan_to_num(level.period))
        lower = alike > b
        if lower.any():
            rows, columns = np.nonzero(lower)
            expected[b, rows, columns] = whole[np.minimum(alike[lower], len(levels) - 1), rows, columns]
            seen[b, rows, columns] = np.maximum(seen[b, rows, columns], expected[b, rows, columns])


def _variances(level: Solution, window: Window) -> Array:
    """Variances of the six, with what passes may have left; (rows, columns, 6)."""
    variance = np.diagonal(level.covariance, axis1=-2, axis2=-1).astype(np.float32)
    left = np.where(np.isfinite(level.left), level.left, 0.0)[..., None] ** 2
    variance[..., :2] += left / 2
    variance[..., 2:] += left / (4 * window.sigma**2)
    return variance


@cache
def law_of(fine: Window, coarse: Window, step: int, *, top: bool) -> NDArray[np.float64]:
    """What `energy_strip` needs to know of a band, for displacement and gradient; shape (2, 7)."""
    ratio, reach = coarse.size / fine.size, max(coarse.sigma, step)
    law, limit = [], normal_limit()
    for kind, components in enumerate((2, 4)):
        f, squared = difference_noise(ratio, fine.sharpen)[kind]
        # noise of mean square wave number k² has (ΔΔ)² ≈ exp(−r² k²/2); there are no more values than grid points
        many, few = (
            min(1 + 2 * r**2 * squared / fine.sigma**2, 4 * math.pi * (r / step) ** 2)
            for r in (SPREAD * reach, NEAR * reach)
        )
        part = 2 / (9 * components * max(many, 1.0))  # Wilson and Hilferty: the cube root of χ² is normal
        chance = (((1 - part + limit * math.sqrt(part)) ** 3 - 1) / limit) ** 2
        mean, variance = LOGARITHM[components]
        rarely = RARE * math.sqrt(variance / max(few, 1.0)) - mean
        expected = [0.0, ROUGHER, 1.0, 0.0] if top else [SHARES[kind], ROUGHER, limit, limit]
        law.append([f, chance, *expected, rarely])
    return np.array(law)


@cache
def difference_noise(ratio: float, sharpen: int) -> tuple[tuple[float, float], tuple[float, float]]:
    """Noise of the difference of two windows, for displacement and gradient.

    Parameters
    ----------
    ratio : float
        Of the coarser window to the finer.
    sharpen : int

    Returns
    -------
    (f, k²), (f, k²)
        Its variance over the finer's, and its mean square wave number in units of 1/σ of the finer.

    Examples
    --------
    >>> [[round(part, 2) for part in parts] for parts in difference_noise(2**0.5, 2)]
    [[0.29, 1.53], [0.5, 1.66]]
    """
    x = np.linspace(0, 40, 40001)
    fine = response(np.exp(-x), sharpen)
    power = (fine - response(np.exp(-x * ratio**2), sharpen)) ** 2
    found = []
    for weight in (np.ones_like(x), x):
        part = float((weight * power).sum())
        squared = 2 * float((x * weight * power).sum()) / part if part else 0.0
        found.append((part / float((weight * fine**2).sum()), squared))
    return found[0], found[1]


@cache
def overlap(sharpen: int, count: int) -> NDArray[np.float64]:
    """c_m: correlation of bands m half-octaves apart, of a spectrum that is even over octaves; shape (count,).

    Examples
    --------
    >>> overlap(2, 3).round(2), overlap(0, 3).round(2)
    (array([1.  , 0.44, 0.06]), array([1.  , 0.89, 0.65]))
    """
    x = np.exp(np.linspace(-16 - count, 4, 4001))

    def band(m: int) -> Array:
        scaled = x * 2.0**m
        return np.asarray(response(np.exp(-scaled), sharpen) - response(np.exp(-2 * scaled), sharpen))

    first = band(0)
    return np.array([float((first * band(m)).sum() / (first * first).sum()) for m in range(count)])


def _cut(level: Solution, window: Window, grid: Grid) -> NDArray[np.uint8]:
    """What cuts the window of every point, if anything does."""
    statistics = level.statistics
    share = statistics.weight if statistics.partner is None else statistics.partner
    reach = math.ceil(CUT_AT * window.sigma / grid.step)
    inside = np.zeros(grid.shape, np.bool_)
    inside[reach : grid.rows - reach, reach : grid.columns - reach] = True
    return np.where(np.asarray(share) >= WHOLE, 0, np.where(inside, OUTLINED, CUT)).astype(np.uint8)


def _smooth(planes: Array, window: Window, grid: Grid, spread: float) -> Array:
    """Sums of planes (rows, columns, planes) under a Gaussian of `spread` times the window's σ."""
    reach = spread * max(window.sigma / grid.step, 1.0)
    half = np.exp(-((np.arange(math.ceil(2.5 * reach) + 1) / reach) ** 2) / 2).astype(planes.dtype)
    out = np.empty_like(planes)
    over_strips(lambda start, stop: smooth_strip(planes, half, start, stop, out), grid.rows, GRID_STRIP)
    return out


def _over(grid: Grid, strip: Any, *given: Any, out: tuple[Array, ...]) -> None:
    over_strips(lambda start, stop: strip(*given, start, stop, *out), grid.rows, GRID_STRIP)
