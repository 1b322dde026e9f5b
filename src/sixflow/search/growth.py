"""Growth: from where the motion is found to where it is not yet.

Points that failed take what their neighbours' affine maps predict, from the edge of each gap inwards, and the whole
field is refined again; its own passes go on doing so, ring by ring. What is not found after that is tried again from
there, until nothing more is found.

A point is *missed* if it failed although it could be measured: it is not masked, it stays in frame 1 by what its
neighbours predict, with half its window, and its window has texture in frame 0 (`sixflow.judge.texture`).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.convention.flags import FLAGS
from sixflow.judge.texture import is_textured
from sixflow.maps.grid import Grid
from sixflow.maps.neighbours import fill_failed
from sixflow.plan import Plan
from sixflow.prepare.frame import Frame
from sixflow.refine.solution import Solution

ROUNDS = 12
LEAST_FOUND = 0.05  # share of the points: fewer may be chance, and are nothing to grow from


@dataclasses.dataclass(frozen=True)
class Scene:
    """What a search is about.

    Attributes
    ----------
    reference : Frame
        Frame 0, masked outside the region of interest.
    moved : Frame
        Frame 1.
    grid : Grid
    plan : Plan
        Of the search.
    judge_in : callable
        Refines a start (6, rows, columns) at full resolution and judges every point; of the frame 0 and by the plan
        that are given.
    refined : bool
        What is found is refined once more, with other windows: points of any window will do.
    """

    reference: Frame
    moved: Frame
    grid: Grid
    plan: Plan
    judge_in: Callable[[NDArray[Any], Frame, Plan], Solution]
    refined: bool = False

    def judge(self, start: NDArray[Any]) -> Solution:
        """Refine a start at full resolution and judge every point."""
        return self.judge_in(start, self.reference, self.plan)

    def missed(self, found: Solution) -> NDArray[np.bool_]:
        """Points that could be measured and failed; shape (rows, columns)."""
        staying = self.staying(found)
        return staying & self._textured(found) if staying.any() else staying

    def staying(self, found: Solution) -> NDArray[np.bool_]:
        """Points that failed, are not masked, and stay in frame 1; shape (rows, columns)."""
        failed = found.failed & ((found.flag & FLAGS["masked"]) == 0)
        if not failed.any() or failed.mean() > 1 - 2 * LEAST_FOUND:  # too little is known to say what leaves
            return failed
        height, width = self.moved.image.shape
        half = self.plan.window.size / 2
        maps = extrapolated(found, self.grid)
        x, y = self.grid.x + maps[0], self.grid.y[:, None] + maps[1]
        return failed & (x >= half) & (x <= width - 1 - half) & (y >= half) & (y <= height - 1 - half)

    def _textured(self, found: Solution) -> NDArray[np.bool_]:
        """Where frame 0 has texture in every direction; shape (rows, columns)."""
        noise = found.statistics.noise[~found.failed]
        return is_textured(self.reference, self.grid, self.plan.window.size, noise)


def extrapolated(found: Solution, grid: Grid) -> NDArray[Any]:
    """The maps, those of failed points from their neighbours; no motion where nothing is found."""
    return fill_failed(found.known, grid.step)


def grown(found: Solution, scene: Scene) -> Solution:
    """Find what can be found from where it was found; never fewer points than before."""
    if found.failed.mean() > 1 - LEAST_FOUND:
        return found
    missed = int(scene.missed(found).sum())
    for left_over in range(ROUNDS - 1, -1, -1):
        if not missed:
            break
        again = scene.judge(extrapolated(found, scene.grid))
        left = int(scene.missed(again).sum())
        if left >= missed:
            break
        gained, missed, found = missed - left, left, again
        if gained * left_over < missed:  # at this rate the rounds that are left would not find the rest
            break
    return found
