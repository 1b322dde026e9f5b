"""Body: the motion of one body between two frames.

    search → refine (→ a ladder of windows) → judge → back again, if that is asked for

The search and its own refinement see from frame 0, with one window. Where the plan asks for another place
(`reference="middle"`) or for windows of more than one size (`window="auto"`), the field found is refined once more from
there. So it is where a body carries its light along (`prepare.light`), and the search did not know where to.
"""

from __future__ import annotations

import dataclasses
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from sixflow.judge.edges import refuted
from sixflow.judge.flags import bias_rules, isolated, judged
from sixflow.judge.repeats import ambiguous, period_of
from sixflow.judge.roundtrip import no_return
from sixflow.maps.grid import Grid
from sixflow.maps.neighbours import fill_failed, settle
from sixflow.maps.placing import placed
from sixflow.method import problem_of
from sixflow.pair.start import Start
from sixflow.plan import Plan, Window
from sixflow.prepare.frame import Frame
from sixflow.prepare.light import BodyLight
from sixflow.prepare.lighting import Change
from sixflow.prepare.tiles import Tiles
from sixflow.refine.iterate import dense, refine
from sixflow.refine.ladder import refine_ladder
from sixflow.refine.resolution import choose
from sixflow.refine.solution import Solution
from sixflow.search.growth import Scene, extrapolated, grown
from sixflow.search.pyramid import finer
from sixflow.search.stage import MOSTLY_LOST, find_motion


@dataclasses.dataclass(frozen=True)
class Body:
    """What is measured between two frames, and how.

    Attributes
    ----------
    still, moved : Frame
        Frame 0 and frame 1, masked where the body is not.
    asked : Frame
        Frame 0 where points are asked for.
    grid : Grid
    plan : Plan
        `reference` is "first" or "middle": who sees from frame 1 takes the frames the other way round. `lighting` is
        not "auto".
    light : BodyLight, optional
        What divides out the local light of the body in frame 1, where the motion carries it.
    changed : bool, optional
        Whether the light seems to have changed, before the motion is known; what is matched decides about the lighting
        then. Not given: it is as the plan says.
    """

    still: Frame
    moved: Frame
    asked: Frame
    grid: Grid
    plan: Plan
    light: BodyLight | None = None
    changed: bool | None = None

    def measure(self, start: Start | None = None, guess: NDArray[np.float64] | None = None) -> Solution:
        """Search, refine and judge.

        Parameters
        ----------
        start : Start, optional
            What is known of the motion, expressed at the points of the plan's reference. The search is left out where
            refining it succeeds.
        guess : array, shape (6, rows, columns), optional
            A user's first guess, at points of frame 0.
        """
        times = self.plan.between(self.grid.step)
        if times > 1 and self.light is None:
            return self._on_finer_grid(times, start, guess)
        found = self._found(start, guess)
        if self.changed is not None and self._lighting(found) != "none":
            lit = dataclasses.replace(self, plan=self.plan.replace(lighting="gain+offset"), changed=None)
            return lit._continued(found, start, guess)
        return self._completed(found, guess)

    def _continued(self, found: Solution, start: Start | None, guess: NDArray[np.float64] | None) -> Solution:
        """Go on from what was found in the light that was seen as steady."""
        if not found.failed.any():
            return self._finished(self._refined(found), guessed=guess is not None)
        if found.share_failed < MOSTLY_LOST:  # points may have failed for the light
            scene = self._scene
            return self._completed(grown(scene.judge(extrapolated(found, self.grid)), scene), guess)
        return self._completed(self._found(start, guess), guess)

    def _completed(self, found: Solution, guess: NDArray[np.float64] | None) -> Solution:
        """Refine what a search found, where it is not what is asked for, and judge the whole."""
        if self.light is not None or not self.plan.is_searched:
            found = self._refined(found)
        return self._finished(found, guessed=guess is not None)

    def _finished(self, found: Solution, *, guessed: bool) -> Solution:
        """Look at what was refined as a whole: other motions that fit, edges, the way back, points that stand alone."""
        if not guessed:
            found = found.with_flag("ambiguous", self._ambiguous(found))
        if self.plan.robust and self.plan.method == "least_squares":
            found = found.with_flag("edge", self._refuted(found))
        if self.plan.forward_backward:
            found = found.with_flag("forward_backward", self._fails_round_trip(found))
        found = found.with_flag("outlier", isolated(found.flag))
        return found.with_flag("unresolved", bias_rules(found))

    def _on_finer_grid(self, times: int, start: Start | None, guess: NDArray[np.float64] | None) -> Solution:
        """Measure at points that are closer to each other than is asked for, and take those that are."""
        grid, places = self.grid.finer(times, self.plan.shape)
        if start is not None:
            start = Start(finer(start.maps, self.grid, grid, 1))
        if guess is not None:
            guess = finer(guess, self.grid, grid, 1)
        return dataclasses.replace(self, grid=grid).measure(start, guess).sampled(*places)

    def _lighting(self, found: Solution) -> Literal["none", "gain+offset"]:
        """What the tiles that the search matched show of the light; how it seemed where they are few."""
        known = np.where(found.failed, np.nan, found.maps)
        tiles = Tiles.matched(self.still, self.moved, self.grid, known)
        if not tiles.count or found.share_failed > MOSTLY_LOST:
            return "gain+offset" if self.changed else "none"
        noise = float(np.median(found.statistics.noise[~found.failed]))
        changed = Change.between(tiles).matters(tiles, noise, self.plan.window.sigma)
        return "gain+offset" if changed else "none"

    def _found(self, start: Start | None, guess: NDArray[np.float64] | None) -> Solution:
        """What the search finds, or what a start leads to."""
        begun, scene = None, self._scene
        if start is not None:
            if self.plan.share:
                start = dataclasses.replace(start, maps=placed(start.maps, self.grid, -self.plan.share))
            begun = scene.judge(start.maps)
            if start.succeeded(begun.flag, self.grid, scene.plan):
                return begun
        found = find_motion(scene, guess)
        return found if begun is None or found.share_failed < begun.share_failed else begun

    @property
    def _scene(self) -> Scene:
        """What the search for large motion is about."""

        def judge(maps: NDArray[Any], still: Frame, plan: Plan) -> Solution:
            part = self if still is self.still else dataclasses.replace(self, still=still, asked=still)
            return part._measured(maps, plan)

        return Scene(
            self.still, self.moved, self.grid, self.plan.of_search, judge, refined=bool(self.plan.ladder)
        )

    def _refined(self, found: Solution) -> Solution:
        """Refine what the search found once more, seen from where the plan says and with its windows."""
        start = extrapolated(found, self.grid)
        if self.plan.share:
            start = placed(start, self.grid, self.plan.share)
        windows = self.plan.ladder
        if not windows:
            return self._measured(start, self.plan)
        if self.plan.method == "least_squares" and self.plan.group == "affine":
            return self._on_ladder(found, start)
        levels: list[Solution] = []
        for window in reversed(windows):
            levels.insert(
                0,
                self._measured(
                    start, self.plan.replace(window=window), sharpened=bool(levels and window.sharpen)
                ),
            )
            start = settle(levels[0].known, self.grid.step, window.size)
        return choose(levels, windows, self.grid)

    def _on_ladder(self, searched: Solution, start: NDArray[Any]) -> Solution:
        """Measure with all windows at once, choose at every point, and judge."""
        frames = self.still, self.moved
        if self.light is not None:
            frames = self.light.divided_out(*frames, start, self.plan.share)
        found = refine_ladder(*frames, self.grid, self.plan, searched, start)
        middle = float(np.nanmedian(found.window))
        plan = self.plan.replace(window=Window(middle, self.plan.ladder[0].sharpen))
        return judged(found, self.grid, self.asked, plan)

    def _measured(self, start: NDArray[Any], plan: Plan, *, sharpened: bool = False) -> Solution:
        """Refine a start with one window, and judge it; `sharpened`: the start was, by another window."""
        frames = self.still, self.moved
        if self.light is not None:
            frames = self.light.divided_out(*frames, start, plan.share)
        found = refine(
            problem_of(*frames, self.grid, plan), start, sharpened=sharpened, bias=not self.plan.ladder
        )
        flag = judged(self._dense(found), self.grid, self.asked, plan).flag
        return found.replace(flag=flag)

    def _refuted(self, there: Solution) -> NDArray[np.bool_]:
        """Points whose pixels follow another motion than their own."""
        there = self._dense(there)
        frames = self.still, self.moved
        if self.light is not None:
            start = fill_failed(there.known, self.grid.step)
            frames = self.light.divided_out(*frames, start, self.plan.share)
        return refuted(*frames, self.grid, there, self.plan)

    def _ambiguous(self, there: Solution) -> NDArray[np.bool_]:
        """Points whose motion may be longer by a period of the texture."""
        plan = self.plan.replace(window=self.plan.of_search.window, ladder=())
        period = period_of(self.still, plan.window.sigma)
        if period is None or there.failed.all():
            return np.zeros(self.grid.shape, np.bool_)
        maps = fill_failed(self._dense(there).known, self.grid.step)
        frames = self.still, self.moved
        if self.light is not None:
            frames = self.light.divided_out(*frames, maps, plan.share)
        return ambiguous(problem_of(*frames, self.grid, plan), maps, there.failed, period)

    def _fails_round_trip(self, there: Solution) -> NDArray[np.bool_]:
        """Points that do not return where they came from, by a measurement from frame 1 to frame 0."""
        back = dataclasses.replace(
            self,
            still=self.moved,
            moved=self.still,
            asked=self.moved,
            light=None if self.light is None else self.light.reversed,
            plan=self.plan.replace(forward_backward=False),
        ).measure()
        maps = self._dense(there).known, self._dense(back).known
        return no_return(*maps, there.covariance, back.covariance, self.grid, self.plan.share)

    def _dense(self, found: Solution) -> Solution:
        """The solution with maps that fit together to a dense field."""
        return found.replace(maps=dense(found.maps, self.plan, self.grid))
