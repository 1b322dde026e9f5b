"""Repeats: where the texture fits itself after a period, a motion that is longer by the period fits as well.

*Period.* The spectrum of tiles of frame 0 gives the autocorrelation c(d). Its highest summit p besides that about 0,
which ends where c has fallen to half, is asked about if it is no chance, ½N ln 1/(1 − c²(p)/c²(0)) > `evidence_limit`
of the lags, N the cells of all tiles.

*Second candidates.* If I₀(x + p) = I₀(x), the motion U(x) + (1 + G) p fits as U does, and so does that with −p. Both
are refined like the first. With ρ and ρ' the correlations of the windows,

    ε = ½N [ln 1/(1 − ρ²) − ln 1/(1 − ρ'²)]

is the evidence for the first. Below `evidence_limit` the point is ambiguous, whatever its residual.

*Together.* A slip by a period is a seam in the field. Points that go on into each other without one slip all together
or not at all. So a region of them is ambiguous where half of its points are, and settled where fewer are, unless it is
smaller than one window.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from sixflow.chance import evidence_limit
from sixflow.maps.grid import Grid
from sixflow.prepare.frame import Frame
from sixflow.refine.likeness import TILES, correlation_area, spectrum_of
from sixflow.refine.problem import Problem, State

PASSES = 3
"""Of the refinement of a second candidate, which is a whole period away and begins close to its end."""
ROUNDING = 1e-5
"""Of c(0): summits that differ by less are as high as each other, for what single precision tells of spectra."""

Array = NDArray[np.float64]


def period_of(frame: Frame, sigma: float) -> Array | None:
    """Period (x, y) after which the texture of a frame fits itself, px; None if it does not, as far as tiles show.

    Of p and −p, which are equal summits, the one with x > 0, or y > 0 where x = 0; of others as high, the one with the
    largest y.

    Examples
    --------
    >>> y, x = np.mgrid[:96, :96]
    >>> from sixflow.prepare.frame import NO_MASK
    >>> dots = np.cos(2 * np.pi * x / 10) * np.cos(2 * np.pi * y / 12)
    >>> period_of(Frame(dots, NO_MASK), 8.7).round().tolist()
    [5.0, 6.0]
    """
    power = spectrum_of(frame, sigma)
    side = len(power)
    taper = np.hanning(side + 1)[:-1]
    overlap = np.fft.ifft(np.abs(np.fft.fft(taper)) ** 2).real
    surface = np.fft.fftshift(np.fft.ifft2(power).real / np.outer(overlap, overlap))
    middle = side // 2
    if not surface[middle, middle] > 0:
        return None
    surface /= surface[middle, middle]
    reach = 3 * side // 8
    near = slice(middle - reach, middle + reach + 1)
    surface = surface[near, near]
    labels, _ = scipy.ndimage.label(surface > 0.5)
    summits = (surface == scipy.ndimage.maximum_filter(surface, 3)) & (labels != labels[reach, reach])
    summits[:, :reach] = summits[: reach + 1, reach] = False
    beyond = np.where(summits, surface, -1.0)
    height = float(beyond.max())
    row, column = np.argwhere(beyond >= height - ROUNDING)[-1]
    if height <= 0 or not (0 < row < 2 * reach and 0 < column < 2 * reach):
        return None
    cells = TILES**2 * (taper.sum() ** 2 / (taper**2).sum()) ** 2 / correlation_area(power, power)
    if -cells / 2 * math.log(max(1 - height**2, 1e-12)) < evidence_limit(surface.size / 2):
        return None
    x = _between(surface[row, column - 1 : column + 2]) + column - reach
    y = _between(surface[row - 1 : row + 2, column]) + row - reach
    return np.array([x, y])


def _between(line: NDArray[Any]) -> float:
    """Place of a summit between three values, by a parabola."""
    before, here, after = (float(value) for value in line)
    bend = before - 2 * here + after
    return 0.5 * (before - after) / bend if bend < 0 else 0.0


def ambiguous(problem: Problem, maps: Array, failed: NDArray[np.bool_], period: Array) -> NDArray[np.bool_]:
    """Points whose motion may be longer by a period.

    Parameters
    ----------
    problem : Problem
        With one window, plain.
    maps : array, shape (6, rows, columns)
        The motion that was found, without NaN.
    failed : bool array, shape (rows, columns)
        Points that are not asked about.
    period : array, shape (2,)
        x, y, px.
    """
    first = problem.step(maps, State())
    (correlation, cells), weight = first.alike, first.statistics.weight
    own = _height(correlation)
    evidence, length = np.full(failed.shape, np.inf), float(np.hypot(*period))
    for sign in (1, -1):
        x, y = sign * period
        start = maps.copy()
        start[0] += x + maps[2] * x + maps[3] * y
        start[1] += y + maps[4] * x + maps[5] * y
        again, state = start, State()
        for _ in range(PASSES):
            made = problem.step(again, state)
            again = np.where(np.isnan(made.maps).any(axis=0), again, made.maps)
            state = made.state
        there = np.hypot(*(made.start[:2] - start[:2])) < length / 2
        with np.errstate(invalid="ignore"):
            there &= made.statistics.weight > weight / 2
            apart = cells / 2 * (own - _height(made.alike[0]))
        evidence = np.where(there & (apart < evidence), apart, evidence)
    doubtful = ~failed & (evidence < evidence_limit())
    least = (problem.plan.window.size / problem.grid.step) ** 2
    return _together(maps, doubtful, failed, length / 4, least, problem.grid) if doubtful.any() else doubtful


def _height(correlation: NDArray[Any] | None) -> Array:
    """Ln 1/(1 − ρ²)."""
    assert correlation is not None
    return np.asarray(-np.log1p(-(np.clip(np.nan_to_num(correlation), 0.0, 1 - 1e-7) ** 2)))


def _together(
    maps: Array,
    doubtful: NDArray[np.bool_],
    failed: NDArray[np.bool_],
    slip: float,
    least: float,
    grid: Grid,
) -> NDArray[np.bool_]:
    """Points of regions without a seam, a slip of so many px, that are ambiguous; settled ones have so many points."""
    seam = failed.copy()
    for axis in (0, 1):
        size = failed.shape[axis]
        before, after = (np.take(maps, range(a, size - 1 + a), axis + 1) for a in (0, 1))
        slope = before[[2, 4]] if axis == 1 else before[[3, 5]]
        broken = np.hypot(*(after[:2] - before[:2] - grid.step * slope)) > slip
        for part in (slice(None, -1), slice(1, None)):
            seam[(slice(None),) * axis + (part,)] |= broken
    labels, count = scipy.ndimage.label(~seam)
    share = np.bincount(labels[doubtful], minlength=count + 1) / np.maximum(np.bincount(labels.ravel()), 1)
    small = np.bincount(labels.ravel()) < least
    region = (share >= 0.5) | (small & (share > 0))
    region[0] = share[0] > 0  # on a seam, by the others
    return np.asarray(region[labels] & ~failed)
