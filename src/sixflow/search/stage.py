"""Stage: how the motion between two frames is found, from nothing or from a first guess, to a judged field.

| `search` | what is tried |
|---|---|
| "pyramid" | coarse to fine, from the frames' common shift |
| "spectrum" | coarse to fine, from one affine map of the whole frames (`plane`), and growth |
| "auto" | the pyramid, and what follows |
| a guess | refinement from the guess; where more than `MISSED` are missed, coarse to fine from it, and growth |

| "auto", while … of the points are missed | what is tried |
|---|---|
| more than `MISSED` | growth |
| more than `LOST` | one affine map of the whole frames, coarse to fine from it, and growth |
| still more than `LOST` | coarse to fine with windows of half the size, growth, and then the window asked for |
| still more than `LOST` | for a few regions, the largest first: one affine map, and growth, each region by itself |

Of two fields, that with fewer missed points is kept. In the end points in doubt are tried again (`doubt`), but for
"pyramid". Nothing is tried where nothing was missed, and no pixel is outlying: small motion costs the pyramid, and no
more.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from sixflow.maps.grid import Grid
from sixflow.plan import Window
from sixflow.prepare.frame import Frame
from sixflow.refine.solution import Solution
from sixflow.search.doubt import reconsidered
from sixflow.search.growth import Scene, extrapolated, grown
from sixflow.search.plane import Plane, find_plane
from sixflow.search.pyramid import pyramid

MISSED = 0.03  # share of the points
LOST = 0.1
MOSTLY_LOST = 0.5
_REGIONS = 3


def find_motion(scene: Scene, guess: NDArray[np.float64] | None = None) -> Solution:
    """Find the motion between two frames, refine and judge it.

    Parameters
    ----------
    scene : Scene
    guess : array, shape (6, rows, columns), optional
        With `search="guess"`: u, v, u_x, u_y, v_x, v_y at the grid points.
    """
    search = _Search(scene)
    if guess is not None:
        found = search.from_guess(guess)
    elif scene.plan.search == "spectrum":
        found = search.from_spectrum()
    else:
        found = search.coarse_to_fine()
        if scene.plan.search == "pyramid":
            return found
        found = search.further(found)
    return reconsidered(found, scene)


class _Search:
    """The steps, for one scene."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene

    def coarse_to_fine(self, start: NDArray[np.float64] | None = None) -> Solution:
        """The field by the pyramid, from a start at the grid points or the frames' common shift."""
        scene = self.scene
        maps = pyramid(scene.reference, scene.moved, scene.grid, scene.plan, start)
        return scene.judge(maps)

    def from_guess(self, guess: NDArray[np.float64]) -> Solution:
        """The field from a first guess at the grid points."""
        found = self.scene.judge(guess)
        if self.share(found) <= MISSED:
            return found
        return grown(self.better(found, self.coarse_to_fine(guess)), self.scene)

    def from_spectrum(self) -> Solution:
        """The field from one affine map of the whole frames; by the pyramid if there is none."""
        plane = find_plane(self.scene.reference, self.scene.moved, self.scene.plan.window.size)
        found = self.coarse_to_fine() if plane is None else self.from_plane(plane.six)
        return grown(found, self.scene)

    def from_plane(self, six: NDArray[np.float64]) -> Solution:
        """The field from one affine map about pixel (0, 0)."""
        start = self.scene.grid.plane(six)
        found = self.coarse_to_fine(start)
        return found if self.share(found) <= MISSED else self.better(found, self.scene.judge(start))

    def further(self, found: Solution) -> Solution:
        """What the pyramid missed."""
        if self.share(found) <= MISSED:
            return found
        found = grown(found, self.scene)
        if self.share(found) > LOST:
            plane = find_plane(self.scene.reference, self.scene.moved, self.scene.plan.window.size)
            if plane is not None:
                found = self.better(found, grown(self.from_plane(plane.six), self.scene))
            if self.share(found) > LOST:
                found = self.by_smaller_windows(found)
            if plane is not None or self.share(found) <= MOSTLY_LOST:  # else the region is the frame
                found = self.by_regions(found)
        return found

    def by_smaller_windows(self, found: Solution) -> Solution:
        """What windows of half the size see: they match where the motion turns or stretches much over a whole one."""
        plan = self.scene.plan
        smaller = plan.replace(window=Window(plan.window.size / 2))
        scene = dataclasses.replace(self.scene, plan=smaller)
        start = pyramid(scene.reference, scene.moved, scene.grid, smaller)
        finer = grown(scene.judge(start), scene)
        if finer.failed.sum() >= found.failed.sum():
            return found
        again = self.better(found, self.scene.judge(extrapolated(finer, scene.grid)))
        return again.merged(finer, again.failed & ~finer.failed) if self.scene.refined else again

    def by_regions(self, found: Solution) -> Solution:
        """What regions of missed points have in common, the largest first."""
        for _ in range(_REGIONS):
            missed = self.scene.missed(found)
            if missed.sum() <= LOST * missed.size:
                break
            part = _part_of(_largest(missed), self.scene)
            plane = None if part is None else _plane_of(part, self.scene)
            if part is None or plane is None:
                break
            alone = dataclasses.replace(self.scene, reference=part)
            again = grown(alone.judge(self.scene.grid.plane(plane.six)), alone)
            gained = found.failed & ~again.failed & ~self.beside(~found.failed)
            if not gained.any():
                break
            found = found.merged(again, gained)
        return found

    def beside(self, known: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Points within half a window of known ones: their windows see both motions, and the edge may be on either
        side of them.
        """
        from scipy.ndimage import maximum_filter

        reach = math.ceil(self.scene.plan.window.size / 2 / self.scene.grid.step)
        near: NDArray[np.bool_] = maximum_filter(known.astype(np.uint8), 2 * reach + 1, mode="constant") > 0
        return near

    def share(self, found: Solution) -> float:
        """Share of the points that were missed; 0 if at first sight they are too few to matter."""
        if self.scene.staying(found).mean() <= MISSED:
            return 0.0
        return float(self.scene.missed(found).mean())

    def better(self, one: Solution, other: Solution) -> Solution:
        """That with fewer failed points; the first if there are as many."""
        return other if other.failed.sum() < one.failed.sum() else one


def _largest(missed: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The largest connected region of points."""
    from scipy.ndimage import label

    labels, _ = label(missed, np.ones((3, 3)))
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    largest: NDArray[np.bool_] = labels == sizes.argmax()
    return largest


def _part_of(region: NDArray[np.bool_], scene: Scene) -> Frame | None:
    """Frame 0 where its pixels stand for a region of points; None if nothing of it is valid."""
    valid = _pixels(region, scene.grid, scene.reference.image.shape)
    if scene.reference.valid.size:
        valid &= scene.reference.valid
    return scene.reference.within(valid) if valid.any() else None


def _plane_of(part: Frame, scene: Scene) -> Plane | None:
    """The affine map of a part of frame 0."""
    rows, columns = np.flatnonzero(part.valid.any(axis=1)), np.flatnonzero(part.valid.any(axis=0))
    box = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    frame = Frame(np.ascontiguousarray(part.image[box]), np.ascontiguousarray(part.valid[box]))
    plane = find_plane(frame, scene.moved, scene.plan.window.size, box)
    if plane is None:
        return None
    six = plane.six.copy()
    corner = np.array([columns[0], rows[0]])
    six[:2] -= corner + six[2:].reshape(2, 2) @ corner
    return Plane(six, plane.evidence)


def _pixels(region: NDArray[np.bool_], grid: Grid, shape: tuple[int, ...]) -> NDArray[np.uint8]:
    """The pixels nearest to points of a region."""
    row, column = (
        np.clip((np.arange(size) - first + grid.step // 2) // grid.step, 0, count - 1)
        for size, first, count in zip(shape, (grid.y0, grid.x0), region.shape, strict=True)
    )
    return region[np.ix_(row, column)].astype(np.uint8)
