"""Start: what is known of a motion before it is measured."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.convention.flags import FAILING, FLAGS
from sixflow.maps.grid import Grid
from sixflow.maps.neighbours import fill_failed
from sixflow.maps.placing import leaves
from sixflow.maps.six import maps_of_six
from sixflow.plan import Plan

LOST_FROM_START = 0.05
"""Share of the points of a start that may fail, before the motion is searched anew."""


@dataclasses.dataclass(frozen=True)
class Start:
    """What is known of a motion before it is measured.

    Attributes
    ----------
    maps : float64 array, shape (6, rows, columns)
        u, v, u_x, u_y, v_x, v_y in the frame that the measurement refers to; NaN where nothing is known.
    body : int array, shape (rows, columns), or None
        Number of the body of each point, where there are several.
    known : bool array, shape (rows, columns), or None
        Points that the maps were measured at; the others are filled.
    """

    maps: NDArray[np.float64]
    body: NDArray[Any] | None = None
    known: NDArray[np.bool_] | None = None

    @classmethod
    def from_six(cls, six: NDArray[Any], flag: NDArray[Any], body: NDArray[Any] | None) -> Start:
        """Take an earlier result of the same grid as a start."""
        maps = maps_of_six(six.astype(np.float64))
        maps[:, (flag & FAILING) != 0] = np.nan
        return cls(
            np.ascontiguousarray(maps), np.where(flag & FLAGS["masked"], 0, 1) if body is None else body
        )

    def of(self, number: int | None, places: tuple[slice, slice], grid: Grid) -> Start | None:
        """The start of one body at some of the points, filled from its own points; None where it has none."""
        maps = self.maps[(slice(None), *places)]
        if self.body is not None:
            body = self.body[places]
            own = body > 0 if number is None else body == number
            maps = np.where(own, maps, np.nan)
        known: NDArray[np.bool_] = np.asarray(np.isfinite(maps).all(axis=0))
        return Start(fill_failed(maps, grid.step), None, known) if known.any() else None

    def succeeded(self, flag: NDArray[np.uint16], grid: Grid, plan: Plan) -> bool:
        """Whether the points that were known, and whose windows stay in the frame, were measured again."""
        asked = (flag & FLAGS["masked"]) == 0
        asked &= ~leaves(self.maps, grid, plan.shape, plan.reference, plan.window.size / 2)
        if self.known is not None:
            asked &= self.known
        return bool(((flag & FAILING) != 0)[asked].mean() <= LOST_FROM_START) if asked.any() else False

    def backwards(self) -> Start:
        """The same from frame 1 to frame 0, at points of frame 1."""
        return dataclasses.replace(self, maps=-self.maps)
