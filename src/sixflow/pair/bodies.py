"""Pieces: what is known and found of the bodies of a pair, measured one by one, and the field they make."""

from __future__ import annotations

import dataclasses
import math
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from sixflow.convention import GRADIENT_FROM_SIX
from sixflow.convention.flags import FAILING, FLAGS
from sixflow.judge.flags import fill_failed
from sixflow.maps.grid import Grid
from sixflow.maps.placing import leaves
from sixflow.settings import Settings

Part: TypeAlias = tuple[slice, slice]
"""Rows and columns."""

LOST_FROM_START = 0.05  # share of the points of a start that may fail, before the motion is searched anew


def with_margin(box: Part, shape: tuple[int, int], margin: int) -> Part:
    """Rows and columns of a part of the frame and so many around it."""
    rows, columns = (
        slice(max(0, part.start - margin), min(size, part.stop + margin))
        for part, size in zip(box, shape, strict=True)
    )
    return rows, columns


def share_failed(flag: NDArray[np.uint16]) -> float:
    """Share of the points that are not masked and failed."""
    asked = (flag & FLAGS["masked"]) == 0
    return float(((flag & FAILING) != 0)[asked].mean()) if asked.any() else 0.0


def room_to_move(box: Part, window: float) -> int:
    """Pixels around a body that it is looked for in first: two windows, or half its longer side."""
    return math.ceil(max(2 * window, max(part.stop - part.start for part in box) / 2))


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
        maps = np.moveaxis(six.astype(np.float64) @ GRADIENT_FROM_SIX.T, -1, 0)
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

    def succeeded(
        self, flag: NDArray[np.uint16], grid: Grid, shape: tuple[int, int], settings: Settings
    ) -> bool:
        """Whether the points that were known, and whose windows stay in the frame, were measured again."""
        asked = (flag & FLAGS["masked"]) == 0
        asked &= ~leaves(self.maps, grid, shape, settings.reference, settings.window / 2)
        if self.known is not None:
            asked &= self.known
        return bool(((flag & FAILING) != 0)[asked].mean() <= LOST_FROM_START) if asked.any() else False

    def backwards(self) -> Start:
        """The same from frame 1 to frame 0, at points of frame 1."""
        return dataclasses.replace(self, maps=-self.maps)


_OF_POINTS = ("residual", "noise", "rho", "window", "period")


@dataclasses.dataclass
class Found:
    """What was found of one body, or of all together; arrays of shape (rows, columns, …)."""

    maps: NDArray[Any]
    covariance: NDArray[Any]
    residual: NDArray[Any]
    noise: NDArray[Any]
    rho: NDArray[Any]
    window: NDArray[Any]
    period: NDArray[Any]
    flag: NDArray[np.uint16]
    body: NDArray[np.int32] | None
    lighting: str = "none"

    @classmethod
    def nothing(cls, shape: tuple[int, int]) -> Found:
        """Start with all points masked."""
        unknown: dict[str, Any] = {name: np.full(shape, np.nan) for name in _OF_POINTS}
        return cls(
            maps=np.full((6, *shape), np.nan),
            covariance=np.full((*shape, 6, 6), np.nan),
            flag=np.full(shape, FLAGS["masked"], np.uint16),
            body=np.zeros(shape, np.int32),
            **unknown,
        )

    def take(self, one: Found, number: int, places: tuple[slice, slice]) -> None:
        """Put the points of a body in their places. Where two bodies claim a point, which only happens off frame 0,
        one that was measured goes before one that failed, and the better match before the other.
        """
        assert self.body is not None
        flag, residual = self.flag[places], self.residual[places]
        failed, was_failed = (one.flag & FAILING) != 0, (flag & FAILING) != 0
        with np.errstate(invalid="ignore"):
            better = np.where(failed == was_failed, one.residual < residual, was_failed)
        new = ((one.flag & FLAGS["masked"]) == 0) & (better | ((flag & FLAGS["masked"]) != 0))
        self.maps[(slice(None), *places)][:, new] = one.maps[:, new]
        for name in ("covariance", *_OF_POINTS, "flag"):
            getattr(self, name)[places][new] = getattr(one, name)[new]
        self.body[places][new] = number
        if new.any() and one.lighting != "none":
            self.lighting = one.lighting
