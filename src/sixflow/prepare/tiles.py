"""Tiles: what stands at the same place of the pattern in both frames, cut out where points of a grid were measured.

A tile of frame 0 about a point and the tile of frame 1 that the motion leads to hold the same piece of the pattern, but
for the deformation within a tile. What differs between them, over all tiles, is of the camera: light, sharpness,
noise, and what does not move with the pattern. Tiles are cut out at whole pixels; what is left of the motion, less than
a pixel, is in the taper of frame 1's tile, so that both tapers lie alike on the pattern, and in the phase of its
spectrum.

    F₀(k) = Σ w(x) I₀(x) e^(−ikx),    F₁(k) = e^(ik·ε) Σ w(x − ε) I₁(x + r) e^(−ikx),    u = r + ε

| symbol | name in the code |
|---|---|
| u, ε | `shift`, `rest` |
| w | `tapers` |
| F₀, F₁ | `spectra` |
"""

from __future__ import annotations

import dataclasses
import math
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.scales import NORMAL
from sixflow.engine.weigh import FULL
from sixflow.maps.grid import Grid
from sixflow.prepare.frame import Frame

SIDE = 32
"""px: side of a tile, about a window."""
MOST = 64
"""Tiles that are cut out of a frame at most, evenly spread, no closer than half a tile."""
_MIDDLE = (SIDE - 1) / 2


@dataclasses.dataclass(frozen=True)
class Tiles:
    """Pieces of two frames.

    Attributes
    ----------
    x, y : array, shape (tiles,)
        Of the points, px.
    maps : float64 array, shape (6, tiles)
        u, v, u_x, u_y, v_x, v_y there.
    rest : float64 array, shape (tiles, 2)
        What whole pixels leave of (u, v).
    pixels : float32 array, shape (2, tiles, SIDE, SIDE)
        Of both frames.
    moved : bool
        Whether they were brought together by a motion.
    """

    x: NDArray[Any]
    y: NDArray[Any]
    maps: NDArray[np.float64]
    rest: NDArray[np.float64]
    pixels: NDArray[np.float32]
    moved: bool = False

    @classmethod
    def matched(
        cls, first: Frame, second: Frame, grid: Grid, maps: NDArray[Any] | None = None, share: float = 0.0
    ) -> Tiles:
        """Cut tiles out where a motion is known, and where all of their pixels count.

        Parameters
        ----------
        first, second : Frame
        grid : Grid
        maps : array, shape (6, rows, columns), optional
            NaN where nothing is known; not given: both frames at the same place.
        share : float
            Of the way from frame 0 to frame 1 at which the points lie.
        """
        known = np.zeros((6, *grid.shape)) if maps is None else maps
        rows, columns = (
            _spread(at, size) for at, size in zip((grid.y, grid.x), first.image.shape, strict=True)
        )
        j, i = (part.ravel() for part in np.meshgrid(rows, columns, indexing="ij"))
        some = np.asarray(known[:, j, i], np.float64)
        there = np.isfinite(some).all(axis=0)
        j, i, some = j[there], i[there], some[:, there]
        x, y = grid.x[i], grid.y[j]
        corners, valid = [], np.ones(x.size, np.bool_)
        for frame, way in ((first, -share), (second, 1 - share)):
            left, top = (
                np.rint(at + way * move).astype(int) - SIDE // 2 for at, move in ((x, some[0]), (y, some[1]))
            )
            height, width = frame.image.shape
            inside = (left >= 0) & (top >= 0) & (left + SIDE <= width) & (top + SIDE <= height)
            if frame.valid.size:
                left, top = np.where(inside, left, 0), np.where(inside, top, 0)
                if inside.any():
                    inside[inside] = _cut(frame.valid, left[inside], top[inside]).all(axis=(1, 2))
            corners.append((left, top))
            valid &= inside
        pixels = np.empty((2, int(valid.sum()), SIDE, SIDE), np.float32)
        for k, (frame, (left, top)) in enumerate(zip((first, second), corners, strict=True)):
            if valid.any():
                pixels[k] = _cut(frame.image, left[valid], top[valid])
        whole = np.stack([corners[1][axis] - corners[0][axis] for axis in (0, 1)], axis=-1)
        rest = some[:2].T - whole
        return cls(x[valid], y[valid], some[:, valid], rest[valid], pixels, maps is not None)

    @property
    def count(self) -> int:
        """Number of tiles."""
        return int(self.x.size)

    @property
    def shift(self) -> NDArray[np.float64]:
        """(u, v) of each, px; shape (tiles, 2)."""
        return self.maps[:2].T

    @cached_property
    def tapers(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Tapers along columns and rows of both frames' tiles; shape (2, tiles, SIDE) each, with the sum 1."""
        at = np.arange(SIDE) - _MIDDLE
        out = []
        for axis in (0, 1):
            off = np.stack([np.zeros(self.count), self.rest[:, axis]])[..., None]
            inside = np.abs(at - off) < (SIDE + 1) / 2
            taper = np.where(inside, np.cos(np.pi * (at - off) / (SIDE + 1)) ** 2, 0)
            out.append((taper / taper.sum(axis=-1, keepdims=True)).astype(np.float32))
        return out[0], out[1]

    @cached_property
    def light(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Mean and standard deviation of both frames' tiles under their tapers; shape (2, tiles) each.

        What one frame alone shows says nothing of light: of tiles that a motion brought together, pixels that are not
        alike count in neither.
        """
        across, down = self.tapers
        weight = (down[..., :, None] * across[..., None, :]).reshape(2, self.count, SIDE**2)
        mean, contrast = self._moments(weight)
        if not self.moved:
            return mean, contrast
        weight = weight * self._alike(mean, contrast)
        return self._moments(weight / weight.sum(axis=-1, keepdims=True))

    def _moments(self, weight: NDArray[Any]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Mean and standard deviation under weights of sum 1; shape (2, tiles) each."""
        pixels = self.pixels.reshape(weight.shape)
        level = pixels[:, :, ::SIDE].mean(axis=-1)  # so that single precision does for squares
        centred = pixels - level[..., None]
        mean, square = (np.einsum("ftp,ftp->ft", weight, each) for each in (centred, centred * centred))
        contrast = np.sqrt(np.maximum(square - mean**2, 0))
        return (mean + level).astype(np.float64), contrast.astype(np.float64)

    def _alike(self, mean: NDArray[np.float64], contrast: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Pixels whose value in each frame is among those next to them in the other, but for light and noise.

        Shape (tiles, SIDE²). Noise is the median difference, and pixels that are off by `engine.weigh.FULL` of it stand
        out.
        """
        from scipy.ndimage import maximum_filter, minimum_filter

        scale = np.where(contrast > 0, contrast, 1)[..., None, None]
        first, second = (self.pixels - mean[..., None, None]) / scale
        noise = NORMAL * np.median(np.abs(second - first), axis=(1, 2), keepdims=True)
        alike, around = np.ones(first.shape, np.bool_), (1, 3, 3)
        for one, other in ((first, second), (second, first)):
            alike &= other <= maximum_filter(one, around) + FULL * noise
            alike &= other >= minimum_filter(one, around) - FULL * noise
        return alike.reshape(self.count, SIDE**2)

    @property
    def steepness(self) -> NDArray[np.float64]:
        """Mean square of the gradient along one axis, of frame 0's tiles; shape (tiles,)."""
        across, down = (np.diff(self.pixels[0], axis=axis) for axis in (2, 1))
        mean: NDArray[np.float64] = (across**2).mean(axis=(1, 2)) / 2 + (down**2).mean(axis=(1, 2)) / 2
        return mean


def _spread(at: NDArray[Any], size: int) -> NDArray[np.int64]:
    """Numbers of points along an axis about which tiles fit, half a tile apart or more."""
    inside = np.flatnonzero((at >= SIDE // 2) & (at + SIDE // 2 <= size))
    if not inside.size:
        return inside
    length = int(at[inside[-1]] - at[inside[0]])
    count = min(math.isqrt(MOST), 1 + length // (SIDE // 2))
    places: NDArray[np.int64] = inside[np.rint(np.linspace(0, inside.size - 1, count)).astype(int)]
    return np.unique(places)


def _cut(image: NDArray[Any], left: NDArray[Any], top: NDArray[Any]) -> NDArray[Any]:
    """Squares of an image; shape (squares, SIDE, SIDE)."""
    windows = np.lib.stride_tricks.sliding_window_view(image, (SIDE, SIDE))
    return windows[top, left]
