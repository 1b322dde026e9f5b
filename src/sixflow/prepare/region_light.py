"""Region light: the local mean and contrast of a body, without what lies around it.

With `lighting="local"` every frame is divided by its own local mean and contrast beforehand. Near the edge of a
region of interest these would be those of the background as well, which need not move with the body. Inside the region
alone they are known in frame 0; in frame 1 the region is where the motion found so far carries it,

    region₁(y) = region₀(y − U(y)),   U at the points of frame 1,

between pixels the bilinear mean of the mask. Where there is a mask for each frame, it is that of frame 1.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from sixflow.maps.grid import Grid
from sixflow.maps.placing import placed, surface_of
from sixflow.prepare.frame import Frame, flattened


@dataclasses.dataclass(frozen=True)
class RegionLight:
    """The frames of a pair before their light was divided out, and the region in each.

    Attributes
    ----------
    first, second : Frame
    inside : uint8 array, shape (height, width)
        The region in frame 0.
    there : uint8 array, or None
        The region in frame 1, if it is known.
    grid : Grid
    sigma : float
        Of the window, px.
    backwards : bool
        Whether frame 1 is compared with frame 0, not frame 0 with frame 1.
    """

    first: Frame
    second: Frame
    inside: NDArray[np.uint8]
    there: NDArray[np.uint8] | None
    grid: Grid
    sigma: float
    backwards: bool

    def divided_out(
        self, still: Frame, moved: Frame, maps: NDArray[Any], share: float
    ) -> tuple[Frame, Frame]:
        """The two frames in the order in which they are compared, each with its light divided out.

        Parameters
        ----------
        still, moved : Frame
            Where pixels count.
        maps : array, shape (6, rows, columns)
            Of the motion from `still` to `moved`.
        share : float
            Of the way from `still` to `moved`: where the maps are told (`placing`).
        """
        there: NDArray[Any] | None = self.there
        if there is None:
            there = self._carried(-maps, share) if self.backwards else self._carried(maps, 1 - share)
        pair = [(self.first, self.inside), (self.second, there)]
        lit = [flattened(frame, self.sigma, region) for frame, region in pair]
        if self.backwards:
            lit.reverse()
        return lit[0].within(still.valid), lit[1].within(moved.valid)

    @property
    def reversed(self) -> RegionLight:
        """The same for frames that are compared the other way round."""
        return dataclasses.replace(self, backwards=not self.backwards)

    def _carried(self, maps: NDArray[Any], way: float) -> NDArray[np.float64]:
        """The region in frame 1, 0 to 1, by maps of the motion from frame 0, which `way` of it leads to frame 1."""
        grid = self.grid
        there = placed(maps, grid, way)
        height, width = self.inside.shape
        x, y = np.arange(width, dtype=float), np.arange(height, dtype=float)
        surface = surface_of(there, grid)
        u, v = surface.on_grid(x, y)
        places = np.stack([y[:, None] - v, x - u])
        carried: NDArray[np.float64] = scipy.ndimage.map_coordinates(
            self.inside.astype(float), places, order=1
        )
        return carried
