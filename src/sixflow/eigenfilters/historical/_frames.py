"""Two frames as the historical operators take them, and how they are refused."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from sixflow.checks import number, require, whole
from sixflow.engine.window import window_sigma
from sixflow.errors import InputError
from sixflow.maps.grid import Grid
from sixflow.prepare.image import check_frame

Array = NDArray[Any]

FLAT = 1e-3
"""A window whose rms slope is below this fraction of the frame's counts as without structure."""

LEAST_WINDOW = 5.0


@dataclasses.dataclass(frozen=True, eq=False)
class Problem:
    """Two frames, less the median of the first, with the pixels that have a value in each; grid and window."""

    frame0: Array
    frame1: Array
    valid0: Array
    valid1: Array
    grid: Grid
    sigma: float

    @classmethod
    def of(cls, frame0: ArrayLike, frame1: ArrayLike, grid_step: int, window: float) -> Problem:
        """Check the arguments that all methods share.

        Raises InputError if a frame, the step or the window cannot be used.
        """
        first, second = check_frame(frame0, "frame0"), check_frame(frame1, "frame1")
        if first.shape != second.shape:
            raise InputError(
                f"frame1 has shape {second.shape}, frame0 {first.shape}: crop both to the same size"
            )
        smallest = min(first.shape)
        if smallest < LEAST_WINDOW:
            raise InputError(f"frame0 has shape {first.shape}: give frames of at least 5×5 pixels")
        step = whole("grid_step", grid_step, 1, smallest)
        window = number("window", window, least=LEAST_WINDOW, unit="px")
        require(
            window <= smallest,
            "window",
            window,
            f"must be at most {smallest} px, the smaller side of the frames; choose a smaller window or larger frames",
        )
        with np.errstate(over="ignore", invalid="ignore"):
            first, second = first.astype(np.float64), second.astype(np.float64)
        valid0, valid1 = np.isfinite(first), np.isfinite(second)
        for name, valid in (("frame0", valid0), ("frame1", valid1)):
            if not valid.any():
                raise InputError(f"{name} has no finite pixel: give a frame with grey values")
        grey = np.median(first[valid0])  # exact where the frame is constant
        first, second = np.where(valid0, first - grey, 0.0), np.where(valid1, second - grey, 0.0)
        return cls(first, second, valid0, valid1, Grid.over(first.shape, step), window_sigma(window))


def central_differences(image: Array) -> tuple[Array, Array]:
    """(I_x, I_y) by (I(x+1) − I(x−1))/2; at the border one-sided, and not to be trusted there."""
    I_y, I_x = np.gradient(image)
    return I_x, I_y


def away_from_gaps(valid: Array, reach: int) -> Array:
    """Where all pixels within `reach` columns and rows lie in the frame and have a value."""
    size = 2 * reach + 1
    return ndimage.minimum_filter(valid.astype(np.uint8), size, mode="constant", cval=0) > 0
