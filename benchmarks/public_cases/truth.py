"""The true displacement of a case, at points of frame 0 or of the middle frame, and its gradient.

A field d on frame 0's pixels says where each of its points goes, x → x + d(x). A method that deforms both frames by
half measures at X = x + d/2 instead: there the displacement is d(x), with x = X − d(x)/2 found by iteration.

The gradient is differentiated with seven samples, D7, which leaves k⁶/140 of a wave of k radians per pixel, and
checked by five samples, D5. Where the two differ by more than 2 % of the field's typical gradient plus 10⁻⁴, the
field is not smooth on the scale of pixels (a motion edge, a mountain ridge, rounded numbers): there is no true
gradient to compare with.

| symbol | name |
|---|---|
| d = (u, v) | `u`, `v`; NaN where unknown |
| D7, D5 | `SEVEN`, `FIVE` |
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

SEVEN = {1: 3 / 4, 2: -3 / 20, 3: 1 / 60}
FIVE = {1: 2 / 3, 2: -1 / 12}
SMOOTH_SHARE, SMOOTH_FLOOR = 0.02, 1e-4

Array = NDArray[Any]


@dataclasses.dataclass(frozen=True)
class Truth:
    """Displacement on frame 0's pixels.

    Parameters
    ----------
    u, v : float array, shape (height, width)
        px; NaN where unknown.
    constant : float array, shape (4,), or None
        u_x, u_y, v_x, v_y where these are the same everywhere.
    """

    u: Array
    v: Array
    constant: Array | None = None

    @classmethod
    def affine(cls, shape: tuple[int, int], values: Sequence[float]) -> Truth:
        """Return the field of u0, v0, u_x, u_y, v_x, v_y about pixel (0, 0)."""
        u0, v0, *gradient = values
        y, x = np.mgrid[: shape[0], : shape[1]].astype(float)
        u_x, u_y, v_x, v_y = gradient
        return cls(u0 + u_x * x + u_y * y, v0 + v_x * x + v_y * y, np.array(gradient))

    @classmethod
    def sampled(cls, shape: tuple[int, int], u: ArrayLike, v: ArrayLike, mask: ArrayLike | None) -> Truth:
        """Return the field of samples, which may broadcast; False in the mask means unknown."""
        known = True if mask is None else np.asarray(mask, dtype=bool)
        planes = (np.broadcast_to(np.asarray(values, dtype=float), shape) for values in (u, v))
        return cls(*(np.where(known, plane, np.nan) for plane in planes))

    @property
    def shape(self) -> tuple[int, int]:
        """(height, width)."""
        height, width = self.u.shape
        return height, width

    def displacement(self, x: Array, y: Array, *, middle: bool = False) -> Array:
        """(u, v) at the points of a grid with columns x and rows y; shape (2, rows, columns), NaN outside the frame."""
        at = np.stack(np.meshgrid(np.asarray(x, float), np.asarray(y, float)))
        if not middle and (at == np.round(at)).all():
            (column, row), (height, width) = at.astype(int), self.shape
            inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
            place = row.clip(0, height - 1), column.clip(0, width - 1)
            return np.where(inside, np.stack([self.u[place], self.v[place]]), np.nan)
        moved = np.zeros_like(at)
        for _ in range(30 if middle else 1):
            from_here = at - moved / 2 if middle else at
            moved = np.stack([_interpolate(plane, *from_here) for plane in (self.u, self.v)])
        return moved

    def stays(self, x: Array, y: Array) -> NDArray[np.bool_]:
        """Whether the points of a grid on frame 0 are inside frame 1, by a pixel; False where that is unknown."""
        u, v = self.displacement(x, y)
        with np.errstate(invalid="ignore"):
            there_x, there_y = x + u, np.asarray(y)[:, None] + v
            height, width = self.shape
            return (np.abs(there_x - (width - 1) / 2) <= (width - 3) / 2) & (
                np.abs(there_y - (height - 1) / 2) <= (height - 3) / 2
            )

    def gradient(self, x: Array, y: Array, *, middle: bool = False) -> Array:
        """u_x, u_y, v_x, v_y at the points of a grid; shape (4, rows, columns), NaN where the field is not smooth."""
        if self.constant is not None and not middle:
            return np.broadcast_to(self.constant[:, None, None], (4, len(y), len(x))).copy()
        along_x, along_y = (
            {
                shift: self.displacement(x + shift * dx, y + shift * dy, middle=middle)
                for shift in range(-max(SEVEN), max(SEVEN) + 1)
            }
            for dx, dy in ((1, 0), (0, 1))
        )
        planes, checks = (
            np.stack([_difference(along, stencil)[k] for k in (0, 1) for along in (along_x, along_y)])
            for stencil in (SEVEN, FIVE)
        )
        typical = np.sqrt(np.nanmean(planes**2)) if np.isfinite(planes).any() else 0.0
        with np.errstate(invalid="ignore"):
            smooth = (np.abs(planes - checks) <= SMOOTH_SHARE * typical + SMOOTH_FLOOR).all(axis=0)
        return np.where(smooth, planes, np.nan)

    def edges(self, jump: float = 0.3) -> NDArray[np.bool_]:
        """Pixels next to which the motion jumps by more than `jump` px, or is unknown."""
        unknown = np.isnan(self.u) | np.isnan(self.v)
        edge = unknown.copy()
        for axis in (0, 1):
            with np.errstate(invalid="ignore"):
                far = np.hypot(np.diff(self.u, axis=axis), np.diff(self.v, axis=axis)) > jump
            before, after = [slice(None)] * 2, [slice(None)] * 2
            before[axis], after[axis] = slice(None, -1), slice(1, None)
            edge[tuple(before)] |= far
            edge[tuple(after)] |= far
        return edge


def _difference(samples: dict[int, Array], stencil: dict[int, float]) -> Array:
    """Derivative from samples at whole distances; NaN where one is missing."""
    return np.sum([weight * (samples[shift] - samples[-shift]) for shift, weight in stencil.items()], axis=0)


def _interpolate(plane: Array, x: Array, y: Array) -> Array:
    """Value between pixels: cubic where the neighbours are known, linear elsewhere, NaN outside."""
    outside = {"mode": "constant", "cval": np.nan}
    linear = ndimage.map_coordinates(plane, [y, x], order=1, **outside)
    if np.isnan(plane).any():
        return linear
    cubic = ndimage.map_coordinates(plane, [y, x], order=3, mode="nearest")
    return np.where(np.isnan(linear), np.nan, cubic)
