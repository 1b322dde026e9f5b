"""Sweep: sums over the pixels of a pair of frames, for the motion as it is known."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.blend import twist_of
from sixflow.engine.moments import moments_strip, sandwich_strip, statistics_strip
from sixflow.engine.spline import noise_variance
from sixflow.engine.threads import over_strips
from sixflow.engine.warp import bring_strip, warp_strip
from sixflow.engine.weigh import apply_weights
from sixflow.engine.window import moment_weights
from sixflow.maps.grid import Grid
from sixflow.prepare.frame import Frame

STRIP = 64
GRID_STRIP = 16


@dataclasses.dataclass(frozen=True)
class Images:
    gradient_x: NDArray[Any]
    gradient_y: NDArray[Any]
    right: NDArray[Any]
    residual: NDArray[Any]
    still: NDArray[Any]
    warped: NDArray[Any]


@dataclasses.dataclass(frozen=True)
class Moments:
    images: Images
    with_sandwich: bool


@dataclasses.dataclass(frozen=True)
class WindowSums:
    normal: NDArray[Any]
    sandwich: NDArray[Any] | None
    statistics: NDArray[Any]


class Sweep:
    def __init__(
        self,
        still: Frame,
        moved: Frame,
        grid: Grid,
        sigma: float,
        *,
        degree: int,
        lowpass: float,
        central: bool,
    ) -> None:
        self.still, self.grid, self.sigma, self.degree, self.central, self.lowpass = (
            still,
            grid,
            sigma,
            degree,
            central,
            lowpass,
        )
        self.coefficients = moved.coefficients(degree)
        self.moved_valid = moved.interpolable()
        self.still_valid = still.interpolable() if central else still.counted()
        self.dtype = still.image.dtype

    def images(self, maps: NDArray[Any], *, total: bool = True, light: NDArray[Any] | None = None) -> Images:
        shape, dtype, grid = self.still.image.shape, self.dtype, self.grid
        plane = mean_plane(maps, grid)
        reduced = maps - grid.plane(plane)
        image, valid, still_variance = self.still.image, self.still_valid, np.empty((0, 0), dtype)
        if self.central:
            image, valid, still_variance = self._bring_reference(-reduced / 2, -plane / 2)
            reduced, plane = reduced / 2, plane / 2
        lighting = np.empty((0, 0, 0, 0), dtype) if light is None else light
        residual, warped = np.empty(shape, dtype), np.empty(shape, dtype)
        images = [np.empty(shape, dtype) for _ in range(3)]
        local, twist, plane = (
            reduced.astype(dtype),
            twist_of(reduced, grid.step).astype(dtype),
            plane.astype(dtype),
        )
        variance = noise_variance(self.degree, self.lowpass)
        over_strips(
            lambda start, stop: warp_strip(
                image, self.coefficients, valid, self.moved_valid, local, twist, grid.origin_and_step, plane,
                lighting, self.degree, total, variance, 2.0 if self.central else 1.0, still_variance,
                start, stop, *images, residual, warped,
            ),
            shape[0], STRIP,
        )  # fmt: skip
        return Images(*images, residual, image, warped)

    def _bring_reference(self, reduced: NDArray[Any], plane: NDArray[Any]) -> tuple[Any, Any, Any]:
        shape, dtype, grid = self.still.image.shape, self.dtype, self.grid
        still, valid, variance = np.empty(shape, dtype), np.empty(shape, np.uint8), np.empty(shape, dtype)
        local, twist = reduced.astype(dtype), twist_of(reduced, grid.step).astype(dtype)
        coefficients, asked = self.still.coefficients(self.degree), self.still_valid
        base, noise = plane.astype(dtype), noise_variance(self.degree, self.lowpass)
        over_strips(
            lambda start, stop: bring_strip(
                coefficients, asked, local, twist, grid.origin_and_step, base, self.degree, noise,
                start, stop, still, valid, variance,
            ),
            shape[0], STRIP,
        )  # fmt: skip
        return still, valid, variance

    def moments(
        self,
        maps: NDArray[Any],
        *,
        total: bool = True,
        light: NDArray[Any] | None = None,
        sandwich: bool = False,
    ) -> Moments:
        return Moments(self.images(maps, total=total, light=light), sandwich)

    def moments_of(
        self, images: Images, weight: NDArray[Any] | None = None, *, sandwich: bool = False
    ) -> Moments:
        if weight is not None:
            parts = [
                images.gradient_x.copy(),
                images.gradient_y.copy(),
                images.right.copy(),
                images.residual.copy(),
            ]
            apply_weights(weight, *parts, np.empty_like(parts[0]))
            images = Images(*parts, images.still, images.warped)
        return Moments(images, sandwich)


def with_weights(images: Images, weight: NDArray[Any]) -> Images:
    parts = [images.gradient_x.copy(), images.gradient_y.copy(), images.right.copy(), images.residual.copy()]
    apply_weights(weight, *parts, np.empty_like(parts[0]))
    return Images(*parts, images.still, images.warped)


def window_sums(moments: Moments, grid: Grid, sigma: float) -> WindowSums:
    images, place = moments.images, grid.origin_and_step
    dtype = images.still.dtype
    weights, squared = moment_weights(sigma).astype(dtype), moment_weights(sigma, power=2).astype(dtype)
    normal, statistics = np.empty((*grid.shape, 24), dtype), np.empty((2, *grid.shape, 5), dtype)
    gx, gy, q, r = images.gradient_x, images.gradient_y, images.right, images.residual
    over_strips(lambda a, b: moments_strip(gx, gy, q, weights, place, a, b, normal), grid.rows, GRID_STRIP)
    for image, out in zip((images.still, images.warped), statistics, strict=True):
        over_strips(
            lambda a, b, image=image, out=out: statistics_strip(image, r, weights, place, a, b, out),
            grid.rows,
            GRID_STRIP,
        )
    sandwich = None
    if moments.with_sandwich:
        sandwich = np.empty((*grid.shape, 18), dtype)
        over_strips(
            lambda a, b: sandwich_strip(gx, gy, r, squared, place, a, b, sandwich), grid.rows, GRID_STRIP
        )
    every = np.concatenate([statistics[0], statistics[1][..., 3:], statistics[1][..., :1]], axis=-1)
    return WindowSums(normal, sandwich, every)


def squared_window_sums(moments: Moments, grid: Grid, sigma: float) -> NDArray[Any]:
    images = moments.images
    ones = np.ones_like(images.still)
    out = np.empty((*grid.shape, 18), ones.dtype)
    squared = moment_weights(sigma, power=2).astype(ones.dtype)
    over_strips(
        lambda a, b: sandwich_strip(
            images.gradient_x, images.gradient_y, ones, squared, grid.origin_and_step, a, b, out
        ),
        grid.rows,
        GRID_STRIP,
    )
    return out


def window_means(image: NDArray[Any], grid: Grid, sigma: float) -> NDArray[np.float64]:
    out = np.empty((*grid.shape, 5), image.dtype)
    weights = moment_weights(sigma).astype(image.dtype)
    over_strips(
        lambda a, b: statistics_strip(image, image, weights, grid.origin_and_step, a, b, out),
        grid.rows,
        GRID_STRIP,
    )
    return np.stack([out[..., 0], out[..., 3]]).astype(np.float64)


def mean_plane(maps: NDArray[Any], grid: Grid) -> NDArray[np.float64]:
    mean = maps.mean(axis=(1, 2))
    x, y = grid.x.mean(), grid.y.mean()
    mean[0] -= mean[2] * x + mean[3] * y
    mean[1] -= mean[4] * x + mean[5] * y
    return np.asarray(mean)
