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
| more than `MOSTLY_LOST` | one affine map of the whole frames, coarse to fine from it, and growth |
| more than `LOST` | one affine map for the largest region that was missed, and growth; for some regions |
| still more than `MOSTLY_LOST` | the map captured about the middle, coarse to fine from it, and growth |

Of two fields, that with fewer missed points is kept. Nothing is tried where nothing was missed: small motion costs the
pyramid, and no more.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sixflow.grid import Grid
from sixflow.normalise import Frame
from sixflow.passes import Workspace
from sixflow.search.captured import captured_plane
from sixflow.search.growth import Judged, Scene, extrapolated, grown
from sixflow.search.plane import Plane, find_plane
from sixflow.search.pyramid import pyramid
from sixflow.settings import Settings

MISSED = 0.03  # share of the points
LOST = 0.1
MOSTLY_LOST = 0.5
_REGIONS = 3


def find_motion(
    scene: Scene, settings: Settings, workspace: Workspace, guess: NDArray[np.float64] | None = None
) -> Judged:
    """Find the motion between two frames, refine and judge it.

    Parameters
    ----------
    scene : Scene
    settings : Settings
        `search`, `levels`, and what passes need.
    workspace : Workspace
    guess : array, shape (6, rows, columns), optional
        With `search="guess"`: u, v, u_x, u_y, v_x, v_y at the grid points.
    """
    search = _Search(scene, settings, workspace)
    if guess is not None:
        return search.from_guess(guess)
    if settings.search == "spectrum":
        return search.from_spectrum()
    found = search.coarse_to_fine()
    return found if settings.search == "pyramid" else search.further(found)


class _Search:
    """The steps, for one scene."""

    def __init__(self, scene: Scene, settings: Settings, workspace: Workspace) -> None:
        self.scene, self.settings, self.workspace = scene, settings, workspace

    def coarse_to_fine(self, start: NDArray[np.float64] | None = None) -> Judged:
        """The field by the pyramid, from a start at the grid points or the frames' common shift."""
        scene = self.scene
        maps = pyramid(scene.reference, scene.moved, scene.grid, self.settings, self.workspace, start)
        return scene.judge(maps)

    def from_guess(self, guess: NDArray[np.float64]) -> Judged:
        """The field from a first guess at the grid points."""
        found = self.scene.judge(guess)
        if self.share(found) <= MISSED:
            return found
        return grown(self.better(found, self.coarse_to_fine(guess)), self.scene)

    def from_spectrum(self) -> Judged:
        """The field from one affine map of the whole frames; by the pyramid if there is none."""
        plane = find_plane(self.scene.reference, self.scene.moved, self.scene.window)
        found = self.coarse_to_fine() if plane is None else self.from_plane(plane.six)
        return grown(found, self.scene)

    def from_plane(self, six: NDArray[np.float64]) -> Judged:
        """The field from one affine map about pixel (0, 0)."""
        start = self.scene.grid.plane(six)
        found = self.coarse_to_fine(start)
        return found if self.share(found) <= MISSED else self.better(found, self.scene.judge(start))

    def further(self, found: Judged) -> Judged:
        """What the pyramid missed."""
        if self.share(found) <= MISSED:
            return found
        found = grown(found, self.scene)
        if self.share(found) > MOSTLY_LOST:
            plane = find_plane(self.scene.reference, self.scene.moved, self.scene.window)
            if plane is not None:
                found = self.better(found, grown(self.from_plane(plane.six), self.scene))
        found = self.by_regions(found)
        if self.share(found) > MOSTLY_LOST:
            six = captured_plane(self.scene.reference, self.scene.moved, self.scene.window)
            if six is not None:
                found = self.better(found, grown(self.from_plane(six), self.scene))
        return found

    def by_regions(self, found: Judged) -> Judged:
        """What regions of missed points have in common, the largest first."""
        for _ in range(_REGIONS):
            missed = self.scene.missed(found)
            if not LOST * missed.size < missed.sum() <= MOSTLY_LOST * missed.size:
                break
            region = _largest(missed)
            plane = _plane_of(region, self.scene)
            if plane is None:
                break
            start = np.where(region, self.scene.grid.plane(plane.six), extrapolated(found, self.scene.grid))
            again = self.better(found, grown(self.scene.judge(start), self.scene))
            if again is found:
                break
            found = again
        return found

    def share(self, found: Judged) -> float:
        """Share of the points that were missed; 0 if at first sight they are too few to matter."""
        if self.scene.staying(found).mean() <= MISSED:
            return 0.0
        return float(self.scene.missed(found).mean())

    def better(self, one: Judged, other: Judged) -> Judged:
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


def _plane_of(region: NDArray[np.bool_], scene: Scene) -> Plane | None:
    """The affine map of a region of points, from the part of frame 0 that they stand for."""
    valid = _pixels(region, scene.grid, scene.reference.image.shape)
    if scene.reference.valid.size:
        valid &= scene.reference.valid
    rows, columns = np.flatnonzero(valid.any(axis=1)), np.flatnonzero(valid.any(axis=0))
    if not rows.size:
        return None
    part = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    frame = Frame(np.ascontiguousarray(scene.reference.image[part]), np.ascontiguousarray(valid[part]))
    plane = find_plane(frame, scene.moved, scene.window)
    if plane is None:
        return None
    six = plane.six.copy()
    six[:2] -= np.array([columns[0], rows[0]]) + six[2:].reshape(2, 2) @ [columns[0], rows[0]]
    return Plane(six, plane.evidence)


def _pixels(region: NDArray[np.bool_], grid: Grid, shape: tuple[int, ...]) -> NDArray[np.uint8]:
    """The pixels nearest to points of a region."""
    row, column = (
        np.clip((np.arange(size) - first + grid.step // 2) // grid.step, 0, count - 1)
        for size, first, count in zip(shape, (grid.y0, grid.x0), region.shape, strict=True)
    )
    return region[np.ix_(row, column)].astype(np.uint8)
