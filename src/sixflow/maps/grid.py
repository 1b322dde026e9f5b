"""The grid: points on whole pixels, `step` apart, centred in the frame."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclasses.dataclass(frozen=True)
class Grid:
    """Points at columns x0 + i·step and rows y0 + j·step.

    Examples
    --------
    >>> Grid.over((64, 48), 8).x
    array([ 3, 11, 19, 27, 35, 43])
    """

    x0: int
    y0: int
    step: int
    columns: int
    rows: int

    @classmethod
    def over(cls, shape: tuple[int, int], step: int) -> Grid:
        """Return the grid that covers a frame (height, width) to within half a step of every border."""
        rows, columns = ((size - 1) // step + 1 for size in shape)
        y0, x0 = (
            (size - 1 - (count - 1) * step) // 2 for size, count in zip(shape, (rows, columns), strict=True)
        )
        return cls(x0, y0, step, columns, rows)

    @property
    def x(self) -> NDArray[np.int64]:
        """Pixel columns of the grid."""
        return self.x0 + self.step * np.arange(self.columns)

    @property
    def y(self) -> NDArray[np.int64]:
        """Pixel rows of the grid."""
        return self.y0 + self.step * np.arange(self.rows)

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns)."""
        return self.rows, self.columns

    @property
    def origin_and_step(self) -> tuple[int, int, int]:
        """(x0, y0, step), as the kernels take it."""
        return self.x0, self.y0, self.step

    def finer(self, times: int, shape: tuple[int, int]) -> tuple[Grid, tuple[slice, slice]]:
        """Return a grid over a frame (height, width) with points so many times closer, and where this one's are.

        Examples
        --------
        >>> Grid.over((64, 48), 16).finer(2, (64, 48))
        (Grid(x0=7, y0=7, step=8, columns=6, rows=8), (slice(0, 7, 2), slice(0, 5, 2)))
        """
        step, ends = self.step // times, []
        for origin, size in ((self.y0, shape[0]), (self.x0, shape[1])):
            before = origin // step
            ends.append((origin - before * step, (size - 1 - origin) // step + before + 1, before))
        (y0, rows, above), (x0, columns, left) = ends
        places = (
            slice(first, first + times * (count - 1) + 1, times)
            for first, count in ((above, self.rows), (left, self.columns))
        )
        down, across = places
        return Grid(x0, y0, step, columns, rows), (down, across)

    def within(
        self, rows: slice, columns: slice, *, origin: tuple[slice, slice]
    ) -> tuple[Grid, tuple[slice, slice]] | None:
        """Return the points inside a part of the frame, and where they stand in this grid; None if there is none.

        Their columns and rows count from those of `origin`, another part.
        """
        where = []
        for places, part in ((self.y, rows), (self.x, columns)):
            first, last = np.searchsorted(places, [part.start, part.stop])
            if first == last:
                return None
            where.append(slice(int(first), int(last)))
        y, x = where
        x0, y0 = int(self.x[x.start]) - origin[1].start, int(self.y[y.start]) - origin[0].start
        return Grid(x0, y0, self.step, x.stop - x.start, y.stop - y.start), (y, x)

    def plane(self, values: NDArray[Any]) -> NDArray[Any]:
        """Affine maps at the grid points of one map (u, v, u_x, u_y, v_x, v_y) about pixel (0, 0);
        shape (6, rows, columns).
        """
        x, y = np.meshgrid(self.x, self.y)
        maps = np.broadcast_to(np.asarray(values, dtype=np.float64)[:, None, None], (6, *self.shape)).copy()
        maps[0] += values[2] * x + values[3] * y
        maps[1] += values[4] * x + values[5] * y
        return maps
