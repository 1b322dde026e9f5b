"""Solution: a field of affine maps with its covariance, what every window shows of it, and the flags.

One type from the first refinement to the finished field: the search, the judgement and the choice of windows take
solutions and return solutions. Nothing is written into one.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from sixflow.convention.flags import FAILING, FLAGS

if TYPE_CHECKING:
    from sixflow.refine.problem import PixelWeights

Array: TypeAlias = NDArray[Any]
Part: TypeAlias = tuple[slice, slice]
"""Rows and columns."""


@dataclasses.dataclass(frozen=True)
class WindowStatistics:
    """What the pixels of every window show of a pass; arrays of shape (rows, columns).

    Attributes
    ----------
    weight : array
        Share of the window's weight on pixels that have a partner, 0 to 1.
    noise : array
        Standard deviation of one frame's noise, from the mean absolute residual, and not less than the frames' floor.
    residual : array
        Zero-normalised residual: rms difference over rms contrast of the reference.
    left : array
        Share of Σ w r² that the pass's own update left.
    noise_gradient : array
        γ: what noise adds to Σ w g_x².
    texture : array
        Signal-to-noise ratio (power) of the gradient in the window's weakest direction.
    rho : array
        γ over what the texture gives to Σ w g_x².
    tail : array or None
        Mean square of the residual over that of a Gaussian of the same mean size. None: not known.
    lacking : array or None
        What the residual lacks of the floor's noise, as a share of its power. None: nowhere anything.
    partner : array or None
        As `weight`, outlying pixels included; None, like the three below, where pixels were not weighed.
    outlying, outlying_centre : array or None
        Share of the window's weight, and of that of a window of half the size, that outlying pixels lost.
    matched : array or None
        Share of the gradients' squares, less noise, on the pixels that were not left out.
    correlation : array or None
        Zero-normalised correlation of the two windows. None: not known.
    cells : array or None
        Independent cells of texture in the window (`sixflow.refine.likeness`). None: not known.
    """

    weight: Array
    noise: Array
    residual: Array
    left: Array
    noise_gradient: Array
    texture: Array
    rho: Array
    tail: Array | None = None
    lacking: Array | None = None
    partner: Array | None = None
    outlying: Array | None = None
    outlying_centre: Array | None = None
    matched: Array | None = None
    correlation: Array | None = None
    cells: Array | None = None


@dataclasses.dataclass(frozen=True)
class Solution:
    """A measured field.

    Attributes
    ----------
    maps : float64 array, shape (6, rows, columns)
        u, v, u_x, u_y, v_x, v_y; NaN where the equations were singular.
    covariance : array, shape (rows, columns, 6, 6)
        Of the noise of the six numbers; NaN where the texture does not rise above the noise.
    statistics : WindowStatistics
    left : array, shape (rows, columns)
        How far each point may still be from its fixed point, px.
    window, period : array, shape (rows, columns)
        Size of each point's window, and the period of a displacement that it attenuates by 10 %, px.
    flag : uint16 array, shape (rows, columns)
        Bits as in `sixflow.field.FLAGS`; 0 before the points are judged.
    bias : array, shape (rows, columns, 6), or None
        Expected square of what each point's window leaves out of the six numbers. None: not estimated.
    light : array, shape (rows, columns, 2), or None
        Gain and offset of each window's light from the reference to the moved frame; None where none was allowed.
    lighting : str
        What was allowed to change in the light, as in `Settings`.
    body : int32 array, shape (rows, columns), or None
        Number of the body of each point, where there are several.
    pixels : PixelWeights or None
        The weights of pixels that the last pass had; None where none was outlying.
    """

    maps: Array
    covariance: Array
    statistics: WindowStatistics
    left: Array
    window: Array
    period: Array
    flag: NDArray[np.uint16]
    bias: Array | None = None
    light: Array | None = None
    lighting: str = "none"
    body: NDArray[np.int32] | None = None
    pixels: PixelWeights | None = None

    @property
    def failed(self) -> NDArray[np.bool_]:
        """Points that have no value, masked ones included; shape (rows, columns)."""
        return (self.flag & FAILING) != 0

    @property
    def share_failed(self) -> float:
        """Share of the points that are not masked and failed."""
        asked = (self.flag & FLAGS["masked"]) == 0
        return float(self.failed[asked].mean()) if asked.any() else 0.0

    @property
    def known(self) -> Array:
        """The maps, NaN at points that failed."""
        return np.where(self.failed, np.nan, self.maps)

    def replace(self, **changes: Any) -> Solution:
        """Return the solution with some parts changed."""
        return dataclasses.replace(self, **changes)

    def with_flags(self, bits: Array) -> Solution:
        """Return the solution with more bits set; `bits` of shape (rows, columns)."""
        return self.replace(flag=(self.flag | bits).astype(np.uint16))

    def with_flag(self, name: str, points: Array) -> Solution:
        """Return the solution with one bit set at some points."""
        return self.with_flags(np.where(points, FLAGS[name], 0)) if points.any() else self

    def sampled(self, rows: slice, columns: slice) -> Solution:
        """Return the solution at some of its rows and columns."""
        where = rows, columns

        def part(value: Any) -> Any:
            return value[where] if isinstance(value, np.ndarray) else value

        statistics = {
            f.name: part(getattr(self.statistics, f.name)) for f in dataclasses.fields(self.statistics)
        }
        points = {
            name: part(getattr(self, name))
            for name in ("covariance", "left", "window", "period", "flag", "bias", "light", "body")
        }
        return self.replace(
            maps=self.maps[:, rows, columns], statistics=WindowStatistics(**statistics), **points
        )

    def merged(self, other: Solution, where: NDArray[np.bool_]) -> Solution:
        """Return this solution, and the other's points where that is said."""
        return _merged(self, other, where)


def _merged(one: Any, other: Any, where: NDArray[np.bool_]) -> Any:
    """Two solutions or statistics of one grid, field by field; what only one of them has is that one's."""
    changes: dict[str, Any] = {}
    for field in dataclasses.fields(one):
        mine, theirs = getattr(one, field.name), getattr(other, field.name)
        if isinstance(mine, WindowStatistics):
            changes[field.name] = _merged(mine, theirs, where)
        elif isinstance(mine, np.ndarray) and isinstance(theirs, np.ndarray):
            # maps have their points last, everything else first
            shape = where.shape if field.name == "maps" else where.shape + (1,) * (mine.ndim - 2)
            changes[field.name] = np.where(where.reshape(shape), theirs, mine)
    return dataclasses.replace(one, **changes)


def assembled(shape: tuple[int, int], parts: Sequence[tuple[int, Part, Solution]]) -> Solution:
    """Put the solutions of bodies, each of a part of a grid, together; the other points are masked.

    Where two bodies claim a point, which happens away from frame 0 only, one that was measured goes before one that
    failed, and the better match before the other.

    Parameters
    ----------
    shape : (int, int)
        Rows and columns of the whole grid.
    parts : sequence of (number of the body, its rows and columns, Solution)
    """
    flag = np.full(shape, FLAGS["masked"], np.uint16)
    body = np.zeros(shape, np.int32)
    maps, covariance = np.full((6, *shape), np.nan), np.full((*shape, 6, 6), np.nan)
    points = {name: np.full(shape, np.nan) for name in ("left", "window", "period")}
    bias = None if any(one.bias is None for _, _, one in parts) or not parts else np.full((*shape, 6), np.nan)
    statistics = {name: np.full(shape, np.nan) for name in _OF_ALL_WINDOWS}
    lighting = "none"
    for number, places, one in parts:
        own = (one.flag & FLAGS["masked"]) == 0
        free = (flag[places] & FLAGS["masked"]) != 0
        was_failed = (flag[places] & FAILING) != 0
        with np.errstate(invalid="ignore"):
            closer = one.statistics.residual < statistics["residual"][places]
        new = own & (free | np.where(one.failed == was_failed, closer, was_failed))
        maps[(slice(None), *places)][:, new] = one.maps[:, new]
        covariance[places][new] = one.covariance[new]
        flag[places][new], body[places][new] = one.flag[new], number
        if bias is not None and one.bias is not None:
            bias[places][new] = one.bias[new]
        for name, values in points.items():
            values[places][new] = getattr(one, name)[new]
        for name, values in statistics.items():
            values[places][new] = getattr(one.statistics, name)[new]
        if new.any() and one.lighting != "none":
            lighting = one.lighting
    return Solution(
        maps,
        covariance,
        WindowStatistics(**statistics),
        flag=flag,
        left=points["left"],
        window=points["window"],
        period=points["period"],
        bias=bias,
        lighting=lighting,
        body=body,
    )


_OF_ALL_WINDOWS = ("weight", "noise", "residual", "left", "noise_gradient", "texture", "rho")
