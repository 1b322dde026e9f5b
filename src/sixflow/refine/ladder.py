"""Ladder: windows of several sizes from the same sweeps, and the best of them at every point.

A sharpened window forms U ← Q (M U + Δ) of what it finds in the frames, Δ = M̃ (U* − U) (`sharpen`). About any U that is
near, its fixed point has the response T. So one sweep, with one U, serves every window: its moments, merged to the
spacing that each window needs, give Δ, and

    aim_w = Q_w (M_w U + Δ_w)

is what the window w says. The best window of each point is chosen (`resolution`), and the field of the chosen is the
next U. An aim depends on U by −Q P (U* − U) alone, P what the texture in the window makes of M. It has arrived when the
next sweep would change it by less than its standard error tells.

Sweeps begin with the windows from `FIRST` px. Only where a structure leans to the finest of them do finer ones follow.
The last sweep takes what the covariance needs, for the windows that are used.

*What a point bears.* Between two sweeps U moves by δ, and the aim of a window sharpened n times by Q_n P δ. Where that
is more than δ itself, the root of their mean squares under the window, passes would diverge, and the pattern acts on
what T misses with more than its whole: the window takes the next lower n there, and is not used if even n = 0 is too
much.

| symbol | name |
|---|---|
| U, U* | maps, blended; the true motion |
| aim_w | `_Rung.aims`, for every n |
| n at each point | `_Rung.order` |
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from sixflow.convention.flags import FLAGS
from sixflow.engine.window import attenuation_period, sharpening_noise
from sixflow.maps.grid import Grid
from sixflow.maps.neighbours import settle, typical
from sixflow.plan import SEARCHED, Plan, Window
from sixflow.prepare.frame import Frame
from sixflow.refine.least_squares import LeastSquares, LeastSquaresPass, Swept
from sixflow.refine.mix import Mix
from sixflow.refine.problem import PixelWeights, State
from sixflow.refine.resolution import choose
from sixflow.refine.sharpen import SHARPENED
from sixflow.refine.solution import Solution
from sixflow.refine.sweep import mean_plane
from sixflow.refine.uniform import UniformWindow, uniform_windows

FIRST = 16
"""px: the finest window of the first sweeps: its nodes stand 4 px apart, and those of finer ones cost several times as
much."""
SWEEPS = 6
"""Upper limit, the last one included."""
STANDS = 0.25
"""Of a point's standard error, which a change of so much makes 3 % larger."""

Array = NDArray[Any]


def refine_ladder(
    still: Frame, moved: Frame, grid: Grid, plan: Plan, start: Array, pixels: PixelWeights | None
) -> Solution:
    """Measure with all windows of a plan's ladder, and choose at every point.

    Parameters
    ----------
    still, moved : Frame
    grid : Grid
    plan : Plan
    start : float64 array, shape (6, rows, columns)
        A field that is near; without NaN.
    pixels : PixelWeights or None
        Weights of outlying pixels about it; None where there are none.

    Returns
    -------
    Solution
        Not yet judged, but for points where no window could be used.
    """
    return _Ladder(still, moved, grid, plan).refine(start, State(weights=pixels))


def orders_of(sharpen: int) -> tuple[int, ...]:
    """How far a window may be sharpened where the texture does not bear all: half as much, and half again, to not at
    all.

    Examples
    --------
    >>> orders_of(4), orders_of(0)
    ((4, 2, 1, 0), (0,))
    """
    return (sharpen, *orders_of(sharpen // 2)) if sharpen else (0,)


@dataclasses.dataclass
class _Rung:
    """One window, and what it makes of a sweep.

    Attributes
    ----------
    window : Window
    problem : LeastSquares
    found : LeastSquaresPass
    aims : list of arrays, shape (6, rows, columns)
        By order of sharpening.
    order : int array, shape (rows, columns)
        Which of them each point bears; their number where none.
    """

    window: Window
    problem: LeastSquares
    found: LeastSquaresPass
    aims: list[Array]
    order: NDArray[np.intp]

    @property
    def usable(self) -> NDArray[np.bool_]:
        """Points that have a map of this window."""
        known = np.isfinite(self.found.maps[0])
        return np.asarray(known & self.found.measurable & (self.order < len(self.aims)))

    @property
    def maps(self) -> Array:
        """The aim that each point bears."""
        return _at(self.aims, np.minimum(self.order, len(self.aims) - 1))

    def level(self, covariance: Array | None, left: Array) -> Solution:
        """The field of this window; `covariance`: that of its own passes, or None for a likely one."""
        orders = orders_of(self.window.sharpen)
        statistics, sigma = self.found.statistics, self.window.sigma
        noise = np.array([sharpening_noise(n) if n else (1.0, 1.0) for n in (*orders, orders[-1])])
        if covariance is None:
            covariance = self.problem.likely_covariance(self.found)
            covariance *= _outer(noise[0]).astype(covariance.dtype)
        for k in range(1, len(noise)):
            lower = self.order == k
            if lower.any():
                covariance[lower] *= _outer(noise[k] / noise[0]).astype(covariance.dtype)
        periods = np.array([attenuation_period(sigma, n) for n in (*orders, orders[-1])])
        usable = self.usable
        flag = np.where(usable, 0, FLAGS["low_texture"]).astype(np.uint16)
        return Solution(
            np.where(usable, self.maps, np.nan),
            covariance, statistics, left, np.full(left.shape, float(self.window.size)), periods[self.order], flag,
            lighting=self.problem.plan.lighting,
        )  # fmt: skip


def _outer(noise: Array) -> Array:
    """Factors of the covariance of the six of those of the displacement's and the gradient's noise."""
    each = np.repeat(noise, (2, 4))
    return np.outer(each, each)


def _at(planes: list[Array], index: NDArray[np.intp]) -> Array:
    """Of several arrays (…, rows, columns) the one that is wanted at each point."""
    out = planes[0]
    for k in range(1, len(planes)):
        if (index == k).any():
            out = np.where(index == k, planes[k], out)
    return out


class _Ladder:
    """The windows of one pair, on one grid."""

    def __init__(self, still: Frame, moved: Frame, grid: Grid, plan: Plan) -> None:
        self.frames, self.grid, self.plan = (still, moved), grid, plan
        coarse = tuple(one for one in plan.ladder if one.size >= FIRST)
        self.windows = coarse or plan.ladder
        self.problems = self._problems_of(self.windows)
        self.before: dict[float, list[Array]] = {}

    def _problems_of(self, windows: tuple[Window, ...]) -> list[LeastSquares]:
        """One problem for each window; all share the sweep of the finest."""
        first = LeastSquares(*self.frames, self.grid, self.plan.replace(window=windows[0], ladder=()))
        rest = [
            LeastSquares(*self.frames, self.grid, self.plan.replace(window=one, ladder=()), first.sweep)
            for one in windows[1:]
        ]
        return [first, *rest]

    @property
    def lead(self) -> LeastSquares:
        """The window that light and outlying pixels are found with: that of the search, or the nearest to it."""
        return min(self.problems, key=lambda one: abs(one.plan.window.size - SEARCHED))

    def refine(self, start: Array, state: State) -> Solution:
        """Sweep until the points stay (`refine_ladder`)."""
        maps, moved = start, None
        for _ in range(1, SWEEPS):
            rungs, state = self._swept(maps, state, moved, self.problems, last=False)
            levels = [rung.level(None, self._left(moved)) for rung in rungs]
            chosen = choose(levels, self.windows, self.grid)
            following = self._following(chosen)
            moved = following - maps
            maps = following
            if self._leans(chosen):
                self.windows = self.plan.ladder
                self.problems = self._problems_of(self.windows)
                continue
            if self._stays(chosen, moved):
                break
        return self._last(maps, state, moved, chosen, levels)

    def _swept(
        self, maps: Array, state: State, moved: Array | None, problems: list[LeastSquares], *, last: bool
    ) -> tuple[list[_Rung], State]:
        """What windows make of one sweep, and the state for the next."""
        lead = self.lead
        swept = lead.swept(maps, state, total=False, last=last, power=not last)
        sigmas = tuple(problem.sigma for problem in problems)
        uniform = uniform_windows(lead.sweep, sigmas, maps, swept.state.light)
        plane = self.grid.plane(mean_plane(maps, self.grid))
        rungs = [
            self._rung(problem, one, swept, plane, moved)
            for problem, one in zip(problems, uniform, strict=True)
        ]
        light = None
        if swept.state.light is not None:
            light = next((r.found.state.light for r in rungs if r.problem is lead), swept.state.light)
        return rungs, State(light, swept.state.weights)

    def _rung(
        self, problem: LeastSquares, uniform: UniformWindow, swept: Swept, plane: Array, moved: Array | None
    ) -> _Rung:
        """What one window makes of a sweep."""
        found, dtype = problem.solved(swept), self.plan.dtype
        increment = found.maps - swept.maps
        failed = np.isnan(increment).any(axis=0) | ~found.measurable
        known = (swept.maps - plane).astype(dtype)
        seen = uniform.fit(known) + np.where(failed, 0, increment).astype(dtype)
        window = problem.plan.window
        aims = uniform.deconvolved(seen, orders_of(window.sharpen))
        before, self.before[window.size] = self.before.get(window.size), [aim + plane for aim in aims]
        order = np.zeros(self.grid.shape, np.intp)
        if before is not None and moved is not None:
            order = self._borne(window, self.before[window.size], before, moved)
        return _Rung(window, problem, found, self.before[window.size], order)

    def _borne(
        self, window: Window, aims: list[Array], before: list[Array], moved: Array
    ) -> NDArray[np.intp]:
        """The sharpest response that every point bears, by what the last change of the motion made of it.

        An aim sums the change under its window; seen under one of σ itself, the change counts under one of √2 σ
        (Cauchy and Schwarz).
        """
        reach = window.sigma / self.grid.step
        made = np.maximum(
            _power(moved, math.sqrt(2) * reach), self.plan.tolerance**2
        )  # less is of no account
        coarsest = window == self.windows[-1]  # something is to be said of every point
        order = np.full(self.grid.shape, len(aims) - (1 if coarsest else 0))
        for k in range(len(aims) - 1, -1, -1):
            order = np.where(_power(aims[k] - before[k], reach) <= made, k, order)
        return order

    def _left(self, moved: Array | None) -> Array:
        """What the next sweep may still change."""
        if moved is None:
            return np.zeros(self.grid.shape)
        return SHARPENED * np.hypot(moved[0], moved[1])

    def _following(self, chosen: Solution) -> Array:
        """The motion of the next sweep: no NaN, and no point that contradicts its neighbours."""
        known = chosen.known
        finite = np.isfinite(chosen.window)
        reach = float(np.median(chosen.window[finite])) if finite.any() else float(self.windows[0].size)
        return settle(known, self.grid.step, Window(reach, self.windows[0].sharpen).resolving)

    def _leans(self, chosen: Solution) -> bool:
        """Whether the finest of the first windows is the best over as much as one structure that it resolves."""
        if self.windows == self.plan.ladder:
            return False
        first, second = self.windows[0], self.windows[min(1, len(self.windows) - 1)]
        leaning = chosen.window < np.sqrt(first.size * second.size)
        return bool((leaning & ~chosen.failed).sum() > (first.period / self.grid.step) ** 2)

    def _stays(self, chosen: Solution, moved: Array) -> bool:
        """Whether another sweep would change nothing that matters."""
        with np.errstate(invalid="ignore"):
            error = np.sqrt((chosen.covariance[..., 0, 0] + chosen.covariance[..., 1, 1]) / 2)
            enough = np.maximum(self.plan.tolerance, STANDS * error)
            left = np.where(chosen.failed, np.nan, self._left(moved) / enough)
        return typical(left) < 1

    def _last(
        self, maps: Array, state: State, moved: Array | None, chosen: Solution, levels: list[Solution]
    ) -> Solution:
        """The last sweep, for the windows that were chosen."""
        mix = Mix.of(chosen, levels, self.windows)
        used = mix.used
        rungs, state = self._swept(maps, state, moved, [self.problems[k] for k in used], last=True)
        made = []
        left = self._left(np.stack([moved[0], moved[1]]) if moved is not None else None) * SHARPENED
        for rung in rungs:
            whole = rung.problem.solution(rung.found, rung.maps, left, sharpened=True)
            level = rung.level(whole.covariance, left)
            made.append(level.replace(statistics=whole.statistics))
        blended = mix.blend(dict(zip(used, made, strict=True)))
        light = None if state.light is None else np.moveaxis(state.light, 0, -1)
        return blended.replace(bias=chosen.bias, light=light)


def _power(planes: Array, reach: float) -> Array:
    """Mean square of a displacement under a window of σ = reach grid points."""
    square = np.nan_to_num(planes[0] ** 2 + planes[1] ** 2)
    return np.asarray(scipy.ndimage.gaussian_filter(square, reach, mode="nearest", truncate=2.5))
