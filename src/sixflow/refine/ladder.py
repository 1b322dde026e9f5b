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

What a point bears is found as in `sharpen`; a window that is not even borne plain is not used there.

| symbol | name |
|---|---|
| U, U* | maps, blended; the true motion |
| aim_w | `_Rung.aims`, for every n |
| n at each point | `_Rung.sharpened` |
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from sixflow.convention.flags import FLAGS
from sixflow.maps.grid import Grid
from sixflow.maps.neighbours import settle, typical
from sixflow.plan import SEARCHED, Plan, Window
from sixflow.prepare.frame import Frame
from sixflow.refine.covariance import order_scale, solution_of_pass
from sixflow.refine.cut import uniform_windows
from sixflow.refine.least_squares import LeastSquares, LeastSquaresPass, Swept
from sixflow.refine.mix import Mix
from sixflow.refine.problem import State
from sixflow.refine.resolution import choose
from sixflow.refine.sharpen import SHARPENED, Borne, at_order, orders_of
from sixflow.refine.solution import Solution
from sixflow.refine.uniform import UniformWindow

FIRST = 16
"""px: the finest window of the first sweeps: its nodes stand 4 px apart, and those of finer ones cost several times as
much."""
SWEEPS = 6
"""Upper limit, the last one included."""
STANDS = 0.25
"""Of a point's standard error, which a change of so much makes 3 % larger."""

Array = NDArray[Any]


def refine_ladder(
    still: Frame, moved: Frame, grid: Grid, plan: Plan, found: Solution, start: Array
) -> Solution:
    """Measure with all windows of a plan's ladder, and choose at every point.

    Parameters
    ----------
    still, moved : Frame
    grid : Grid
    plan : Plan
    found : Solution
        What the search found, judged: which of its points failed, and how it weighed pixels.
    start : float64 array, shape (6, rows, columns)
        Its maps, seen from where the plan says; without NaN.

    Returns
    -------
    Solution
        Not yet judged, but for points where no window could be used.
    """
    return _Ladder(still, moved, grid, plan, _unknown(found)).refine(start, State(weights=found.pixels))


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
    borne : Borne or None
        Which of them each point bears; None: not known yet.
    """

    window: Window
    problem: LeastSquares
    found: LeastSquaresPass
    aims: list[Array]
    borne: Borne | None

    @property
    def order(self) -> NDArray[np.intp]:
        """Which of the aims is taken."""
        shape = self.aims[0].shape[1:]
        return (
            np.zeros(shape, np.intp)
            if self.borne is None
            else np.minimum(self.borne.order, len(self.aims) - 1)
        )

    @property
    def sharpened(self) -> NDArray[np.int_]:
        """How far each point is sharpened."""
        return np.array(orders_of(self.window.sharpen))[self.order]

    @property
    def maps(self) -> Array:
        """The aim that each point bears."""
        return at_order(self.aims, self.order)

    @property
    def left(self) -> Array:
        """What further sweeps may change, px; 0 where that is not known."""
        return np.zeros(self.aims[0].shape[1:]) if self.borne is None else self.borne.left

    def level(self, *, exact: bool, kept: bool) -> Solution:
        """The field of this window.

        Parameters
        ----------
        exact : bool
            With the covariance of its passes, or a likely one.
        kept : bool
            Whether something is to be said of points that bear not even the plain window.
        """
        found, sharpened = self.found, self.sharpened
        usable = np.isfinite(found.maps[0]) & found.measurable
        if not kept and self.borne is not None:
            usable &= self.borne.order < len(self.aims)
        maps = np.where(usable, self.maps, np.nan)
        if exact:
            level = self.problem.solution(found, maps, self.left, borne=sharpened)
        else:
            covariance = self.problem.likely_covariance(found)
            covariance *= order_scale(self.window.sharpen).astype(covariance.dtype)
            level = solution_of_pass(
                self.problem.plan, covariance, found.statistics, maps, self.left, sharpened
            )
        return level.replace(flag=np.where(usable, 0, FLAGS["low_texture"]).astype(np.uint16))


class _Ladder:
    """The windows of one pair, on one grid."""

    def __init__(
        self, still: Frame, moved: Frame, grid: Grid, plan: Plan, unknown: NDArray[np.bool_]
    ) -> None:
        self.frames, self.grid, self.plan = (still, moved), grid, plan
        self.unknown, self.few = unknown, _few(unknown, (plan.window.size / grid.step) ** 2)
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
            levels = [rung.level(exact=self.correlated, kept=rung is rungs[-1]) for rung in rungs]
            chosen = choose(levels, self.windows, self.grid)
            following = self._following(chosen, rungs)
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

    def _swept(
        self, maps: Array, state: State, moved: Array | None, problems: list[LeastSquares], *, last: bool
    ) -> tuple[list[_Rung], State]:
        """What windows make of one sweep, and the state for the next."""
        lead = self.lead
        swept = lead.swept(maps, state, total=False, last=last, power=not last)
        uniform = self._uniform(problems, maps, swept.state)
        plane = self.grid.plane(swept.plane)
        rungs = [
            self._rung(problem, one, swept, plane, moved)
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
            weight = None if state.weights is None else state.weights.weight
            made = uniform_windows(self.lead.sweep, lacking, maps, state.light, weight, self.unknown)
            self.cut |= dict(zip(lacking, made, strict=True))
        return [self.cut[one.sigma] for one in problems]

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
        borne = None
        if before is not None and moved is not None:
            reach = window.sigma / self.grid.step
            borne = Borne.of(self.before[window.size], before, moved, reach, self.plan.tolerance)
        return _Rung(window, problem, found, self.before[window.size], borne)

    def _following(self, chosen: Solution, rungs: list[_Rung]) -> Array:
        """The motion of the next sweep: no NaN, and no point that contradicts its neighbours.

        Where the search knew nothing, windows of other sizes may follow anything, and those around would read it: there
        neighbours say what they see. Of a few points, fewer than one window holds, they do until frames look alike.
        """
        lead = min(rungs, key=lambda rung: abs(rung.window.size - SEARCHED))
        self.unknown = self.unknown & ~(lead.found.trusted & self.few)
        known = np.where(self.unknown, np.nan, chosen.known)
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
        made = [rung.level(exact=True, kept=True) for rung in rungs]
        blended = mix.blend(dict(zip(used, made, strict=True)))
        light = None if state.light is None else np.moveaxis(state.light, 0, -1)
        return blended.replace(bias=chosen.bias, light=light)


def _unknown(found: Solution) -> NDArray[np.bool_]:
    """Points that the search failed at, but for those at the rim, whose windows are cut as it is."""
    return np.asarray(found.failed & ((found.flag & FLAGS["border"]) == 0))


def _few(points: NDArray[np.bool_], most: float) -> NDArray[np.bool_]:
    """Points of connected regions of so many at most."""
    labels, _ = scipy.ndimage.label(points, np.ones((3, 3)))
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    return np.asarray(points & (sizes[labels] <= most))
