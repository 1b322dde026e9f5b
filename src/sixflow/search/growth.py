"""Growth: from where the motion is found to where it is not yet.

Points that failed take what their neighbours' affine maps predict, from the edge of each gap inwards, and the whole
field is refined again; its own passes go on doing so, ring by ring. What is not found after that is tried again from
there, until nothing more is found.

A point is *missed* if it failed although it could be measured: it is not masked, its window has more contrast than
noise, and it stays in frame 1 by what its neighbours predict, with half its window.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sixflow.field.flags import FAILING, FLAGS
from sixflow.grid import Grid
from sixflow.normalise import Frame
from sixflow.passes import Quality
from sixflow.validate import fill_failed

ROUNDS = 12
GAIN = 0.02  # share of the missed points that a round has to find for another one
CONTRAST = 4.0  # variance of a window over the noise's


class Judged(NamedTuple):
    """Maps (6, rows, columns), the quality of the last pass and the flags of every point."""

    maps: NDArray[Any]
    quality: Quality
    flag: NDArray[np.uint16]

    @property
    def failed(self) -> NDArray[np.bool_]:
        """Points that have no value, masked ones included; shape (rows, columns)."""
        return (self.flag & FAILING).astype(bool)


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
    window : float
        px.
    judge : callable
        Refines a start (6, rows, columns) at full resolution and judges every point.
    """

    reference: Frame
    moved: Frame
    grid: Grid
    window: float
    judge: Callable[[NDArray[Any]], Judged]

    def missed(self, found: Judged) -> NDArray[np.bool_]:
        """Points that could be measured and failed; shape (rows, columns)."""
        failed = found.failed & ((found.flag & FLAGS["masked"]) == 0)
        if not failed.any():
            return failed
        height, width = self.moved.image.shape
        half = self.window / 2
        maps = extrapolated(found, self.grid)
        x, y = self.grid.x + maps[0], self.grid.y[:, None] + maps[1]
        stays = (x >= half) & (x <= width - 1 - half) & (y >= half) & (y <= height - 1 - half)
        return failed & stays & self._contrasted(found)

    def _contrasted(self, found: Judged) -> NDArray[np.bool_]:
        """Where frame 0 has more contrast than noise, by the noise of the points that were measured."""
        from scipy.ndimage import uniform_filter

        image, side = self.reference.image, max(3, round(self.window))
        mean = uniform_filter(image, side)[np.ix_(self.grid.y, self.grid.x)]
        power = uniform_filter(image * image, side)[np.ix_(self.grid.y, self.grid.x)]
        measured = found.quality.noise[~found.failed]
        noise = float(np.median(measured)) if measured.size else 0.0
        contrasted: NDArray[np.bool_] = power - mean**2 > CONTRAST * noise**2
        return contrasted


def extrapolated(found: Judged, grid: Grid) -> NDArray[Any]:
    """The maps, those of failed points from their neighbours; no motion where nothing is found."""
    return fill_failed(np.where(found.failed, np.nan, found.maps), grid.step)


def grown(found: Judged, scene: Scene) -> Judged:
    """Find what can be found from where it was found; never fewer points than before."""
    missed = int(scene.missed(found).sum())
    for _ in range(ROUNDS):
        if not missed or found.failed.all():
            break
        again = scene.judge(extrapolated(found, scene.grid))
        left = int(scene.missed(again).sum())
        if left >= missed:
            break
        gained, missed, found = missed - left, left, again
        if gained < GAIN * (missed + gained):
            break
    return found
