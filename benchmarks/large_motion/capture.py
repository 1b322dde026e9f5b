"""Capture: a large map about a point at one scale, without a pyramid, beginning with no motion.

| step | what | with |
|---|---|---|
| try | no motion, and the summits of the group correlation of each commuting pair | `group_correlation` |
| approach | the best of them, measured again by low orders: long waves reach far | `JointOperator` |
| close in | the two best that are not the same, by all orders | `JointOperator` |
| once more | where that is not good: shifts after each turn and zoom of a lattice, as above | `candidates` |
| to the limit | the best, by an array of operators under the window | `PooledOperator` |

*Judgement.* ρ is the zero-normalised correlation of the frames under the window after the warp (`warped`). White noise
of power n leaves ρ = P/(P + n) of a pattern of power P; unrelated patterns of N details under the window have by
chance about 1/√N. The log-likelihood ratio between a map and another one is about

    ½ N log((1 − ρ_rival²)/(1 − ρ²)),

with ρ_rival = 0 for chance. A point has *converged* if that is

- at least `CHANCE` against chance: the best of thousands of places, with six fitted numbers, reaches 5 to 15 in frames
  that have nothing to do with each other, and seldom 20;
- at least `RIVAL` against the best other map at which a candidate ended: a repeating pattern is not trusted;

if most of the window has a partner in frame 1, and the last step was small. It says that the windows match as
no chance does, not that no better match exists beyond the places that were tried.

| symbol | name |
|---|---|
| ρ, ρ_rival | `correlation`, `rival` |
| N | `details` |
"""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from large_motion.candidates import (
    SETTLED,
    Candidates,
    approached,
    compared,
    joined,
    of_lattice,
    of_pairs,
    size_of,
)
from large_motion.group_correlation import PAIRS, GroupCorrelation
from large_motion.warped import Neighbourhoods, Spline
from sixflow.checks import number
from sixflow.convention import propagate_composition
from sixflow.eigenfilters.bank import FilterBank
from sixflow.eigenfilters.default import SMALLEST_ARRAY, default_bank
from sixflow.eigenfilters.geometry import Real
from sixflow.eigenfilters.joint import JointOperator
from sixflow.eigenfilters.patches import finite_frame, pixels
from sixflow.eigenfilters.pooled import PooledOperator
from sixflow.engine.window import window_sigma
from sixflow.errors import InputError

CHANCE, RIVAL = 20.0, 5.0
"""Log-likelihood ratios that a converged point has, against chance and against every other map."""

ORIGINS = ("no motion", *(f"{first}, {second}" for first, second in PAIRS), "turn, zoom and shift")
"""What a capture may have begun with."""

_LOW_WAVES, _ALL_WAVES = (14.0, 42.0), (7.0, 21.0)  # px
_REACH = 3.0  # radius of the patches over σ
_SUMMITS, _LATTICE_SUMMITS, _KEPT = 4, 2, 5
_LOW_STEPS, _STEPS, _LAST_STEPS = 4, 8, 6
_LARGEST_LAST = 0.1  # px
_LEAST_WEIGHT = 0.75
_CUBIC, _QUINTIC = 3, 5
_ROUNDING = 1e-9
_BLOCK = 32  # points at a window of 31 px


@dataclasses.dataclass(frozen=True)
class Captured:
    """What `capture` finds at each point; six and covariance are NaN where nothing can be solved.

    Attributes
    ----------
    six : array, shape (points, 6)
        u, v (px), divergence, curl, stretch, shear of the map from frame 0 to frame 1.
    covariance : array, shape (points, 6, 6)
        Of the six, if the map is the right one.
    converged : bool array, shape (points,)
        Whether the map is accepted.
    correlation : array, shape (points,)
        ρ, −1 … 1.
    rival : array, shape (points,)
        ρ of the best other map that a candidate ended at; −1 if there was none.
    details : array, shape (points,)
        N, number of independent details under the window.
    origin : array of str, shape (points,)
        Which of `ORIGINS` the candidate came from.
    iterations : int array, shape (points,)
        How often it was warped and measured again.
    """

    six: NDArray[np.float64]
    covariance: NDArray[np.float64]
    converged: NDArray[np.bool_]
    correlation: NDArray[np.float64]
    rival: NDArray[np.float64]
    details: NDArray[np.float64]
    origin: NDArray[np.str_]
    iterations: NDArray[np.int64]


def capture(
    frame0: ArrayLike, frame1: ArrayLike, x: ArrayLike, y: ArrayLike, *, window: float = 31
) -> Captured:
    """Measure a large map from frame 0 to frame 1 about each point, at one scale.

    Reaches shifts up to the window, zooms from ½ to 2, turns by any angle, stretch and shear up to 1, each alone;
    together, shifts to the window with turns to 30°, zooms to 25 % and small shears.

    Parameters
    ----------
    frame0, frame1 : arrays, shape (height, width)
        Finite, at least as large as the window. The light may differ by a gain and an offset.
    x, y : arrays of whole numbers, shape (points,)
        Centres in frame 0, px.
    window : float
        Side of the square subset of the same noise, px, 10 to 400. The time per point grows like its square.

    Returns
    -------
    Captured

    Raises
    ------
    InputError
        If a frame cannot be used, a point is no pixel of it, or the window is out of range.

    Examples
    --------
    >>> from sixflow import synth
    >>> motion = synth.Affine.rotation(0.5, centre=(64, 64))
    >>> made = synth.pair(synth.Speckle(), motion, (129, 129), sensor=synth.Sensor(noise=2))
    >>> found = capture(made.frame0, made.frame1, [64], [64])
    >>> found.converged[0], found.origin[0], found.six[0].round(1) + 0.0
    (np.True_, np.str_('L_s, L_r'), array([ 0. ,  0. , -0.2,  1. ,  0. ,  0. ]))
    """
    window = number("window", window, least=SMALLEST_ARRAY, most=400, unit="px")
    frames = [finite_frame(frame, f"frame{k}") for k, frame in enumerate((frame0, frame1))]
    shape = frames[0].shape
    if frames[1].shape != shape:
        raise InputError(f"frame1 has shape {frames[1].shape}, frame0 {shape}: crop them to the same size")
    if min(shape) < window:
        raise InputError(f"frame0 has shape {shape}: smaller than window={window:g}; take a smaller window")
    columns, rows = pixels("x", x, shape[1]), pixels("y", y, shape[0])
    if len(columns) != len(rows):
        raise InputError(f"x and y have {len(columns)} and {len(rows)} points: they must be as many")
    scale = 2.0 ** -np.frexp(max(np.abs(frame).max() for frame in frames))[1]  # squares must not overflow
    before, after = (Spline(frame * scale) for frame in frames)
    operators = _operators(window)
    out = _empty(len(columns))
    size = max(1, round(_BLOCK * (31 / window) ** 2))
    for start in range(0, len(columns), size):
        chosen = slice(start, start + size)
        px, py = columns[chosen].astype(np.float64), rows[chosen].astype(np.float64)
        found = _capture(Neighbourhoods(before, after, px, py, operators.sigma), operators)
        for field in dataclasses.fields(Captured):
            getattr(out, field.name)[chosen] = getattr(found, field.name)
    return out


def _empty(count: int) -> Captured:
    """Room for what is found at so many points."""
    name = f"<U{max(map(len, ORIGINS))}"
    return Captured(
        six=np.empty((count, 6)),
        covariance=np.empty((count, 6, 6)),
        converged=np.empty(count, dtype=np.bool_),
        correlation=np.empty(count),
        rival=np.empty(count),
        details=np.empty(count),
        origin=np.empty(count, dtype=name),
        iterations=np.empty(count, dtype=np.int64),
    )


class _Operators(NamedTuple):
    """What is made once for a window."""

    sigma: float
    pairs: tuple[GroupCorrelation, ...]
    low: JointOperator
    all: JointOperator
    array: PooledOperator


@functools.lru_cache(maxsize=4)
def _operators(window: float) -> _Operators:
    sigma = window_sigma(window)
    low, every = (
        FilterBank(default_bank(window, wavelengths=waves).kernels, math.ceil(_REACH * sigma))
        for waves in (_LOW_WAVES, _ALL_WAVES)
    )
    pairs = tuple(GroupCorrelation.of(pair, window) for pair in PAIRS)
    return _Operators(sigma, pairs, JointOperator(low), JointOperator(every), PooledOperator(window))


def _capture(near: Neighbourhoods, operators: _Operators) -> Captured:
    """All steps for a block of points."""
    details = near.details(operators.all.bank.radius)
    ended = _closed_in(near, operators, of_pairs(near, operators.pairs, _SUMMITS))
    best, rival = _best_and_rival(ended, near.sigma)
    poor = np.flatnonzero(~_good(best.correlation, rival, details))
    if poor.size:
        part = near.part(poor)
        found = _closed_in(
            part, operators, of_lattice(part, operators.pairs[0], len(PAIRS), _LATTICE_SUMMITS)
        )
        ended = joined(ended, found._replace(point=poor[found.point]))
        best, rival = _best_and_rival(ended, near.sigma)
    return _limit(near, operators.array, best, rival, details)


def _closed_in(near: Neighbourhoods, operators: _Operators, tried: Candidates) -> Candidates:
    """The two best of each point, as far as all orders bring them."""
    kept = compared(near, tried, operators.low.bank.radius, _CUBIC).best(near.sigma, _KEPT)
    kept = approached(near, kept, operators.low, _LOW_STEPS, _CUBIC).best(near.sigma, 2)
    return approached(near, kept, operators.all, _STEPS, _QUINTIC)


def _best_and_rival(ended: Candidates, sigma: float) -> tuple[Candidates, Real]:
    """The best map of each point, and ρ of the second that is not the same."""
    two = ended.best(sigma, 2)
    first = np.append(True, two.point[1:] != two.point[:-1])
    rival = np.full(int(first.sum()), -1.0)
    rival[two.point[~first]] = two.correlation[~first]
    return two.chosen(first), rival


def _good(correlation: Real, rival: Real, details: Real) -> NDArray[np.bool_]:
    """Whether maps are far more likely than chance, and than their rivals."""
    left, of_rival = (1 - np.clip(rho, 0, 1) ** 2 + _ROUNDING for rho in (correlation, rival))
    return (-details / 2 * np.log(left) >= CHANCE) & (details / 2 * np.log(of_rival / left) >= RIVAL)


def _limit(
    near: Neighbourhoods, array: PooledOperator, best: Candidates, rival: Real, details: Real
) -> Captured:
    """The best maps measured to the noise limit, and judged."""
    six = best.six.copy()
    covariance = np.full((len(six), 6, 6), np.nan)
    last, steps = np.full(len(six), np.inf), best.steps.copy()
    active = np.arange(len(six))
    for _ in range(_LAST_STEPS):
        seen = near.warped(active, six[active], array.reach, _QUINTIC)
        left = array.estimate_patches(seen.still, seen.moved, seen.counted)
        known = six[active], np.zeros_like(covariance[active])
        six[active], covariance[active] = propagate_composition(*known, left.six, left.covariance)
        last[active] = size_of(left.six, near.sigma)
        steps[active] += 1
        active = active[last[active] > SETTLED]
        if not active.size:
            break
    solved = np.flatnonzero(np.isfinite(six).all(axis=1))
    correlation, weight = best.correlation.copy(), np.zeros(len(six))
    seen = near.warped(solved, six[solved], math.ceil(_REACH * near.sigma), _QUINTIC)
    correlation[solved], weight[solved] = seen.correlation, seen.weight
    converged = _good(correlation, rival, details) & (last < _LARGEST_LAST) & (weight > _LEAST_WEIGHT)
    origin = np.array(ORIGINS)[best.origin + 1]
    return Captured(six, covariance, converged, correlation, rival, details, origin, steps)
