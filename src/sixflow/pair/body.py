"""Between: the motion of one body between two frames.

    search → refine (→ a ladder of windows) → judge → back again, if that is asked for

The search and its own refinement see from frame 0, with one window. Where the settings ask for another place to see
from (`reference="middle"`) or for windows of more than one size (`window="auto"`), the field found is refined once more
from there. So it is where a body carries its light along (`prepare.light`), and the search did not know where to.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.convention.flags import FAILING, FLAGS
from sixflow.convention.reference import SHARE
from sixflow.engine.window import attenuation_period
from sixflow.judge.edges import refuted
from sixflow.judge.flags import fill_failed, flag_points, isolated, settle
from sixflow.judge.roundtrip import no_return
from sixflow.maps.grid import Grid
from sixflow.maps.placing import placed
from sixflow.maps.restriction import joined
from sixflow.pair.bodies import Start, share_failed
from sixflow.prepare.frame import Frame
from sixflow.prepare.light import BodyLight
from sixflow.prepare.lighting import Light, confirmed
from sixflow.refine.iterate import refine
from sixflow.refine.method import passes_of
from sixflow.refine.quality import Quality
from sixflow.refine.resolution import Level, choose, ladder, search_settings
from sixflow.refine.workspace import Workspace
from sixflow.search.growth import Judged, Scene, extrapolated
from sixflow.search.stage import find_motion
from sixflow.settings import Settings


@dataclasses.dataclass(frozen=True)
class Measured:
    """A measured and judged field; `window` and `period`, attenuated by 10 %, of each point, px; `lighting` that was
    allowed for.
    """

    maps: NDArray[Any]
    quality: Quality
    flag: NDArray[np.uint16]
    window: NDArray[Any]
    period: NDArray[Any]
    lighting: str


@dataclasses.dataclass(frozen=True)
class Between:
    """What is measured between two frames, and how.

    Attributes
    ----------
    still, moved : Frame
        Frame 0 and frame 1, masked where the body is not.
    judged : Frame
        Frame 0 where points are asked for.
    grid : Grid
    settings : Settings
        `reference` is "first" or "middle": who sees from frame 1 takes the frames the other way round. `lighting` is
        not "auto".
    workspace : Workspace
    light : BodyLight, optional
        What divides out the local light of the body in frame 1, where the motion carries it.
    doubtful : bool
        Whether `lighting` holds only if the matched windows say so too.
    """

    still: Frame
    moved: Frame
    judged: Frame
    grid: Grid
    settings: Settings
    workspace: Workspace
    light: BodyLight | None = None
    doubtful: bool = False

    def measure(self, start: Start | None = None, guess: NDArray[np.float64] | None = None) -> Measured:
        """Search, refine and judge.

        Parameters
        ----------
        start : Start, optional
            What is known of the motion, where `settings.reference` sees it from. The search is left out where
            refining it succeeds.
        guess : array, shape (6, rows, columns), optional
            A user's first guess, at points of frame 0.
        """
        simple = search_settings(self.settings, self.still.image.shape).replace(reference="first", sharpen=0)
        found = self._found(simple, start, guess)
        if self.doubtful and not self._confirmed(found):
            steady = dataclasses.replace(
                self, settings=self.settings.replace(lighting="none"), doubtful=False
            )
            measured = steady._seen_as_asked(found)
        elif simple == self.settings and self.light is None:
            measured = self._single(found, simple)
        else:
            measured = self._seen_as_asked(found)
        if measured.quality.foreign is not None:
            measured.flag[self._refuted(measured)] |= FLAGS["edge"]
        if self.settings.forward_backward:
            measured.flag[self._strays(measured)] |= FLAGS["forward_backward"]
        measured.flag[isolated(measured.flag)] |= FLAGS["outlier"]
        return measured

    def _confirmed(self, found: Judged) -> bool:
        light = found.quality.light
        return light is None or confirmed(light, ~found.failed, Light.of(self.still).spread)

    def _found(self, simple: Settings, start: Start | None, guess: NDArray[np.float64] | None) -> Judged:
        """What the search finds, or what a start leads to."""

        def judge(maps: NDArray[Any], still: Frame) -> Judged:
            part = self if still is self.still else dataclasses.replace(self, still=still, judged=still)
            level = part._level(maps, simple)
            return Judged(level.maps, level.quality, level.flag)

        begun = None
        if start is not None:
            if self._share:
                start = dataclasses.replace(start, maps=placed(start.maps, self.grid, -self._share))
            begun = judge(start.maps, self.still)
            if start.succeeded(begun.flag, self.grid, self.still.image.shape, simple):
                return begun
        scene = Scene(self.still, self.moved, self.grid, simple.window, judge)
        found = find_motion(scene, simple, self.workspace, guess)
        return found if begun is None or share_failed(found.flag) < share_failed(begun.flag) else begun

    @property
    def _share(self) -> float:
        return SHARE[self.settings.reference]

    def _single(self, found: Judged, settings: Settings) -> Measured:
        """The field of one window."""
        level = Level(settings, found.maps, found.quality, np.empty(0), found.flag)
        period = np.full(self.grid.shape, level.period)
        if found.quality.held is not None:
            period[found.quality.held] = attenuation_period(settings.sigma, 0)
        window = np.full(self.grid.shape, float(settings.window))
        return Measured(
            found.maps, found.quality, found.flag, window, period,
            settings.lighting,
        )  # fmt: skip

    def _seen_as_asked(self, found: Judged) -> Measured:
        """Refine what the search found once more, seen from where the settings say and with their windows."""
        start = extrapolated(found, self.grid)
        if self._share:
            start = placed(start, self.grid, self._share)
        if self.settings.window != "auto":
            level = self._level(start, self.settings)
            return self._single(Judged(level.maps, level.quality, level.flag), self.settings)
        levels: list[Level] = []
        for settings in reversed(ladder(self.settings, self.still.image.shape)):
            levels.insert(0, self._level(start, settings, sharpened=bool(levels)))
            start = settle(
                np.where(levels[0].usable, levels[0].maps, np.nan), self.grid.step, settings.window
            )
        chosen = choose(levels, self.grid)
        return Measured(
            chosen.maps, chosen.quality, chosen.flag, chosen.window, chosen.period, self.settings.lighting
        )

    def _level(self, start: NDArray[Any], settings: Settings, *, sharpened: bool = False) -> Level:
        """Refine a start with one window, and judge it; `sharpened`: the start was, by another window."""
        frames = self.still, self.moved
        if self.light is not None:
            frames = self.light.divided_out(*frames, start, SHARE[settings.reference])
        passes = passes_of(settings)(*frames, self.grid, settings, self.workspace)
        maps, quality, left = refine(passes, start, sharpened=sharpened)
        flag = flag_points(passes.dense(maps), quality, left, self.grid, self.judged, settings)
        return Level(settings, maps, quality, left, flag)

    def _refuted(self, there: Measured) -> NDArray[np.bool_]:
        """Points beside which a neighbour's motion fits better; where no pixel is foreign there is no edge."""
        maps = self._dense(there.maps)
        frames = self.still, self.moved
        if self.light is not None:
            known = np.where((there.flag & FAILING) != 0, np.nan, maps)
            frames = self.light.divided_out(*frames, fill_failed(known, self.grid.step), self._share)
        return refuted(*frames, self.grid, maps, there.quality, there.flag, there.window, self.settings)

    def _strays(self, there: Measured) -> NDArray[np.bool_]:
        """Points that do not return where they came from, by a measurement from frame 1 to frame 0."""
        back = dataclasses.replace(
            self,
            still=self.moved,
            moved=self.still,
            judged=self.moved,
            light=None if self.light is None else self.light.reversed,
            settings=self.settings.replace(forward_backward=False),
        ).measure()
        maps, back_maps = (
            np.where((one.flag & FAILING) != 0, np.nan, self._dense(one.maps)) for one in (there, back)
        )
        covariances = there.quality.covariance, back.quality.covariance
        return no_return(maps, back_maps, *covariances, self.grid, self._share)

    def _dense(self, maps: NDArray[Any]) -> NDArray[Any]:
        """Maps that fit together to a dense field, as `Passes.dense`."""
        return maps if self.settings.group == "affine" else joined(maps, self.grid.step)
