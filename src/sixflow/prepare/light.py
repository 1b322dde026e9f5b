"""Local light: mean and contrast of every surroundings, divided out of a frame.

With `lighting="local"` every frame becomes (I − m)/c, with m the mean and c the standard deviation under the window's
Gaussian, over the pixels that count. It is the last step: a defect that it met would spread over a window.

Near the edge of a region of interest the surroundings are those of the body alone: the background need not move with
it. In frame 0 the region is known. In frame 1 it is where the mask of that frame says, or else where the motion found
so far carries it (`BodyLight`),

    region₁(y) = region₀(y − U(y)),   U at the points of frame 1,

between pixels the bilinear mean of the mask.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from sixflow.engine.fir import filter_separable
from sixflow.engine.window import CUT
from sixflow.maps.grid import Grid
from sixflow.maps.placing import placed, surface_of
from sixflow.prepare.frame import Frame, eroded
from sixflow.prepare.nodata import continued

_COVERED = 1e-3
"""Share of the Gaussian that has to lie in a region for its light to be known."""
_INWARD = 2
"""px: pixels so near to the rim of a carried region are not in its light; the motion need not be right there."""
_DIGITS = 64
"""Contrast that is distinguished from rounding, in units of the last digit of the surroundings' root mean square."""


def flatten_lighting(
    image: NDArray[Any], valid: NDArray[np.uint8], sigma: float, region: NDArray[Any] | None = None
) -> NDArray[Any]:
    """Divide out the local mean and standard deviation under a Gaussian of `sigma` px (local normalisation).

    Where the frame has no local contrast at all the result is 0.

    Parameters
    ----------
    image : float array, shape (height, width)
    valid : uint8 array of the same shape, or `NO_MASK`
    sigma : float
    region : array of the same shape, 0 to 1, optional
        Weight of each pixel in mean and standard deviation. What is outside the region of interest must not show in
        the light of what is inside. Pixels near the region are normalised as well.
    """
    centred, contrast = _local_light(image, valid, sigma, region)
    return (centred / contrast).astype(image.dtype)


def flattened(frame: Frame, sigma: float, region: NDArray[Any] | None = None) -> Frame:
    """Return a frame with its local light divided out, as `flatten_lighting`; its noise is divided with it.

    Where the frame is not valid, the result is continued.
    """
    if region is not None:
        return _flattened(frame, sigma, region)
    return frame.derived(("local light", sigma), lambda: _flattened(frame, sigma, None))


def _flattened(frame: Frame, sigma: float, region: NDArray[Any] | None) -> Frame:
    centred, contrast = _local_light(frame.image, frame.valid, sigma, region)
    floor: float | NDArray[Any] = 0.0
    if np.any(frame.floor):
        floor = np.asarray(frame.floor / contrast, frame.image.dtype)
    image = (centred / contrast).astype(frame.image.dtype)
    if frame.valid.size:
        image = continued(image, frame.valid)
    return Frame(image, frame.valid, frame.reach, floor, frame.rounded)


def _local_light(
    image: NDArray[Any], valid: NDArray[np.uint8], sigma: float, region: NDArray[Any] | None
) -> tuple[NDArray[Any], NDArray[Any]]:
    """The image less its local mean, and its local contrast, infinite where there is none."""
    reach = int(np.ceil(CUT * sigma))
    half = np.exp(-((np.arange(reach + 1) / sigma) ** 2) / 2)
    half /= half[0] + 2 * half[1:].sum()
    counted = valid.astype(image.dtype) if valid.size else np.ones_like(image)
    weighed = counted if region is None else counted * region.astype(image.dtype)
    covered = filter_separable(weighed, half)
    weight = np.maximum(covered, 1e-6)
    mean = filter_separable(image * weighed, half) / weight
    centred = image - mean
    spread = np.sqrt(np.maximum(filter_separable(centred * centred * weighed, half) / weight, 0))
    if region is not None:
        spread = np.where(covered > _COVERED, spread, 0)
    least = _DIGITS * np.finfo(image.dtype).eps * np.hypot(mean, spread)
    return centred, np.where(counted * (spread > least), spread, np.inf)


@dataclasses.dataclass(frozen=True)
class BodyLight:
    """What divides out the light of a body in a frame that has no mask of its own.

    Attributes
    ----------
    unlit : Frame
        That frame, frame 1, before its light was divided out.
    inside : uint8 array, shape (height, width)
        The region in frame 0, less a rim of 2 px.
    grid : Grid
    sigma : float
        Of the window, px.
    backwards : bool
        Whether frame 1 is compared with frame 0, not frame 0 with frame 1.
    """

    unlit: Frame
    inside: NDArray[np.uint8]
    grid: Grid
    sigma: float
    backwards: bool

    def divided_out(
        self, still: Frame, moved: Frame, maps: NDArray[Any], share: float
    ) -> tuple[Frame, Frame]:
        """The two frames in the order in which they are compared, frame 1 with the light of the body divided out.

        Parameters
        ----------
        still, moved : Frame
            With their light divided out: frame 0 that of the body, frame 1 that of the whole frame.
        maps : array, shape (6, rows, columns)
            Of the motion from `still` to `moved`.
        share : float
            Of the way from `still` to `moved` at which the maps are expressed (`placing`).
        """
        if self.backwards:
            lit = flattened(self.unlit, self.sigma, self._carried(-maps, share))
            return lit.within(still.valid), moved
        lit = flattened(self.unlit, self.sigma, self._carried(maps, 1 - share))
        return still, lit.within(moved.valid)

    @property
    def reversed(self) -> BodyLight:
        """The same for frames that are compared the other way round."""
        return dataclasses.replace(self, backwards=not self.backwards)

    def _carried(self, maps: NDArray[Any], way: float) -> NDArray[np.float64]:
        """The region in frame 1, 0 to 1, by maps of the motion from frame 0, which `way` of it leads to frame 1."""
        there = placed(maps, self.grid, way)
        height, width = self.inside.shape
        x, y = np.arange(width, dtype=float), np.arange(height, dtype=float)
        u, v = surface_of(there, self.grid).on_grid(x, y)
        places = np.stack([y[:, None] - v, x - u])
        carried: NDArray[np.float64] = scipy.ndimage.map_coordinates(
            self.inside.astype(float), places, order=1
        )
        return carried


def body_lit(
    asked: Frame, other: Frame, sigma: float, *, carried: tuple[Grid, bool] | None = None
) -> tuple[Frame, Frame, BodyLight | None]:
    """Divide the light out of frame 0, where a body is, and of frame 1.

    Parameters
    ----------
    asked : Frame
        Frame 0, valid on the body; everywhere where there is no mask.
    other : Frame
        Frame 1, valid where the body may be.
    sigma : float
        Of the window, px.
    carried : (Grid, bool), optional
        The grid of the motion that carries the region to frame 1, and whether frame 1 is compared with frame 0; not
        given where the region in frame 1 is known, or is the whole frame.

    Returns
    -------
    Frame, Frame, BodyLight or None
        Both frames, and what divides out the light of frame 1 once the motion is known.
    """
    second = flattened(other, sigma)
    if carried is None or not asked.valid.size:
        return flattened(asked, sigma), second, None
    grid, backwards = carried
    inside = eroded(asked.valid, _INWARD)
    inside = inside if inside.any() else asked.valid
    return flattened(asked, sigma, inside), second, BodyLight(other, inside, grid, sigma, backwards)
