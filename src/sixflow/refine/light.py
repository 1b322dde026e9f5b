"""Light of windows: gain and offset between the reference and the moved frame brought back.

The ratio of the standard deviations of the two windows, unlike a regression of one frame on the other, is not biased by
noise:

    gain = s₁/s₀,    offset = m₁ − gain m₀
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.sweep import Images
from sixflow.maps.grid import Grid
from sixflow.refine.windows import WindowSums, image_sums

MOST_GAIN = 20.0
"""A gain beyond this, or below its inverse, is no change of light."""


def light_of_windows(sums: WindowSums) -> NDArray[np.float64]:
    """Gain and offset at the grid points; shape (2, rows, columns)."""
    weight, _, _, *totals = np.moveaxis(sums.statistics[..., :7], -1, 0).astype(np.float64)
    return _light(weight, totals)


def light_of_images(images: Images, grid: Grid, sigma: float) -> NDArray[np.float64]:
    """The same from what was compared, pixel by pixel."""
    counted = np.isfinite(images.residual)
    known = [np.where(counted, image, 0) for image in (images.still, images.warped)]
    squares = [part for one in known for part in (one, one * one)]
    _, weight, *totals = image_sums((counted.astype(images.still.dtype), *squares), grid, sigma)
    return _light(weight, totals)


def _light(weight: NDArray[Any], totals: list[NDArray[Any]]) -> NDArray[np.float64]:
    mean0, power0, mean1, power1 = totals
    with np.errstate(invalid="ignore", divide="ignore"):
        mean0, mean1 = mean0 / weight, mean1 / weight
        gain = np.sqrt((power1 / weight - mean1**2) / (power0 / weight - mean0**2))
    gain = np.where(np.isfinite(gain) & (gain > 1 / MOST_GAIN) & (gain < MOST_GAIN), gain, 1.0)
    return np.stack([gain, np.where(np.isfinite(mean0), mean1 - gain * mean0, 0.0)])
