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
MOST_LEFT = 0.9
"""Of the rate at which sweeps come nearer: beyond, nothing is known of where they end."""
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
    left : array, shape (rows, columns), or None
        What further sweeps may change, px, by the rate at which they come nearer; None: not known.
    """

    window: Window
    problem: LeastSquares
    found: LeastSquaresPass
    aims: list[Array]
    order: NDArray[np.intp]
    left: Array | None = None

    @property
    def usable(self) -> NDArray[np.bool_]:
        """Points that have a map of this window."""
        known = np.isfinite(self.found.maps[0])
        return np.asarray(known & self.found.measurable & (self.order < len(self.aims)))

    @property
    def maps(self) -> Array:
        """The aim that each point bears."""
        return _at(self.aims, np.minimum(self.order, len(self.aims) - 1))

    def level(self, covariance: Array | None) -> Solution:
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
        usable, left = self.usable, np.zeros(self.order.shape) if self.left is None else self.left
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
        self.cut: dict[float, UniformWindow] = {}

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
            rungs, state = self._swept(maps, state, moved, self.problems, last=self.correlated)
            levels = [rung.level(self._covariance(rung)) for rung in rungs]
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

    @property
    def correlated(self) -> bool:
        """Whether the frames' noise is: no likely covariance holds then."""
        return self.plan.lowpass > 0

    def _covariance(self, rung: _Rung) -> Array | None:
        """Covariance that windows are compared by; None for a likely one."""
        if not self.correlated:
            return None
        return rung.problem.solution(rung.found, rung.maps, rung.found.left, sharpened=True).covariance

    def _swept(
        self, maps: Array, state: State, moved: Array | None, problems: list[LeastSquares], *, last: bool
    ) -> tuple[list[_Rung], State]:
        """What windows make of one sweep, and the state for the next."""
        lead = self.lead
        swept = lead.swept(maps, state, total=False, last=last, power=not last)
        uniform = self._uniform(problems, maps, swept.state)
        plane = self.grid.plane(mean_plane(maps, self.grid))
        rungs = [
            self._rung(problem, one, swept, plane, moved, last=last)
            for problem, one in zip(problems, uniform, strict=True)
        ]
        light = None
        if swept.state.light is not None:
            light = next((r.found.state.light for r in rungs if r.problem is lead), swept.state.light)
        return rungs, State(light, swept.state.weights)

    def _uniform(self, problems: list[LeastSquares], maps: Array, state: State) -> list[UniformWindow]:
        """Each window where the texture is uniform; cut once, so that M stays the same from sweep to sweep."""
        lacking = tuple(one.sigma for one in problems if one.sigma not in self.cut)
        if lacking:
            made = uniform_windows(self.lead.sweep, lacking, maps, state.light)
            self.cut |= dict(zip(lacking, made, strict=True))
        return [self.cut[one.sigma] for one in problems]

    def _rung(
        self, problem: LeastSquares, uniform: UniformWindow, swept: Swept, plane: Array, moved: Array | None,
        *, last: bool,
    ) -> _Rung:  # fmt: skip
        """What one window makes of a sweep."""
        found, dtype = problem.solved(swept), self.plan.dtype
        increment = found.maps - swept.maps
        failed = np.isnan(increment).any(axis=0) | ~found.measurable
        known = (swept.maps - plane).astype(dtype)
        seen = uniform.fit(known) + np.where(failed, 0, increment).astype(dtype)
        window = problem.plan.window
        aims = uniform.deconvolved(seen, orders_of(window.sharpen))
        before, self.before[window.size] = self.before.get(window.size), [aim + plane for aim in aims]
        rung = _Rung(window, problem, found, self.before[window.size], np.zeros(self.grid.shape, np.intp))
        if before is not None and moved is not None:
            self._bear(rung, before, moved, last=last)
        return rung

    def _bear(self, rung: _Rung, before: list[Array], moved: Array, *, last: bool) -> None:
        """Find the sharpest response that every point bears, by what the last change of the motion made of it.

        An aim sums the change under its window; seen under one of σ itself, the change counts under one of √2 σ
        (Cauchy and Schwarz). In the last sweep, and of the coarsest window, something is to be said of every point.
        """
        reach, aims = rung.window.sigma / self.grid.step, rung.aims
        cause = np.maximum(
            _power(moved, math.sqrt(2) * reach), self.plan.tolerance**2
        )  # less is of no account
        kept = last or rung.window == self.windows[-1]
        order = np.full(self.grid.shape, len(aims) - (1 if kept else 0))
        effect, lost = np.zeros(self.grid.shape), np.ones(self.grid.shape, np.bool_)
        for k in range(len(aims) - 1, -1, -1):
            power = _power(aims[k] - before[k], reach)
            borne = power <= cause
            order, effect = np.where(borne, k, order), np.where(borne | (order == k), power, effect)
            lost &= ~borne
        rate = np.where(lost, MOST_LEFT, min(math.sqrt(effect.mean() / cause.mean()), MOST_LEFT))
        rung.order, rung.left = order, np.sqrt(effect) * rate / (1 - rate)

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
            left = np.where(chosen.failed, np.nan, SHARPENED * np.hypot(moved[0], moved[1]) / enough)
        return typical(left) < 1

    def _last(
        self, maps: Array, state: State, moved: Array | None, chosen: Solution, levels: list[Solution]
    ) -> Solution:
        """The last sweep, for the windows that were chosen."""
        mix = Mix.of(chosen, levels, self.windows)
        used = mix.used
        rungs, state = self._swept(maps, state, moved, [self.problems[k] for k in used], last=True)
        made = []
        for rung in rungs:
            whole = rung.problem.solution(rung.found, rung.maps, rung.found.left, sharpened=True)
            level = rung.level(whole.covariance)
            made.append(level.replace(statistics=whole.statistics))
        blended = mix.blend(dict(zip(used, made, strict=True)))
        light = None if state.light is None else np.moveaxis(state.light, 0, -1)
        return blended.replace(bias=chosen.bias, light=light)


def _power(planes: Array, reach: float) -> Array:
    """Mean square of a displacement under a window of σ = reach grid points."""
    square = np.nan_to_num(planes[0] ** 2 + planes[1] ** 2)
    return np.asarray(scipy.ndimage.gaussian_filter(square, reach, mode="nearest", truncate=2.5))
