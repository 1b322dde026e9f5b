"""Light of windows: gain and offset between the reference and the moved frame brought back.

The ratio of the standard deviations of the two windows, unlike a regression of one frame on the other, is not biased by
noise:

    gain = s₁/s₀,    offset = m₁ − gain m₀
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.maps.grid import Grid
from sixflow.refine.sweep import Images, WindowSums, window_means

MOST_GAIN = 20.0
"""A gain beyond this, or below its inverse, is no change of light."""


def light_of_windows(sums: WindowSums, grid: Grid) -> NDArray[Any]:
    """Gain and offset at the grid points, each with its x-slope, y-slope and twist (0); shape (2, 4, rows, columns)."""
    weight, _, _, *means = np.moveaxis(sums.statistics[..., :7], -1, 0).astype(np.float64)
    return _light(weight, means, grid, sums.statistics.dtype)


def light_of_images(images: Images, grid: Grid, sigma: float) -> NDArray[Any]:
    """The same from what was compared, pixel by pixel."""
    counted = np.isfinite(images.residual)
    known = [np.where(counted, image, 0) for image in (images.still, images.warped)]
    weight = window_means(counted.astype(images.still.dtype), grid, sigma)[1]
    means = [window_means(values, grid, sigma)[1] for one in known for values in (one, one * one)]
    return _light(weight, means, grid, images.still.dtype)


def _light(weight: NDArray[Any], means: list[NDArray[Any]], grid: Grid, dtype: Any) -> NDArray[Any]:
    mean0, power0, mean1, power1 = means
    with np.errstate(invalid="ignore", divide="ignore"):
        mean0, mean1 = mean0 / weight, mean1 / weight
        gain = np.sqrt((power1 / weight - mean1**2) / (power0 / weight - mean0**2))
    gain = np.where(np.isfinite(gain) & (gain > 1 / MOST_GAIN) & (gain < MOST_GAIN), gain, 1.0)
    offset = np.where(np.isfinite(mean0), mean1 - gain * mean0, 0.0)
    light = np.zeros((2, 4, *grid.shape), dtype)
    for k, plane in enumerate((gain, offset)):
        light[k, 0] = plane
        for slope, axis in ((1, 1), (2, 0)):
            if plane.shape[axis] > 1:
                light[k, slope] = np.gradient(plane, grid.step, axis=axis)
    return light
