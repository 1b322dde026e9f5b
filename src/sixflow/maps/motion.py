"""Motion: six numbers with their covariance at the points of a grid, measured or joined along trajectories."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.convention.flags import FAILING

Array = NDArray[Any]


@dataclasses.dataclass(frozen=True)
class Motion:
    """A measured or joined motion at the points of a grid; arrays of shape (rows, columns, …).

    Attributes
    ----------
    six, covariance : arrays, shape (rows, columns, 6) and (rows, columns, 6, 6)
        NaN at failed points.
    moved_covariance : array, shape (rows, columns, 6, 6)
        The part of the covariance that is from the noise of the moved frame.
    flag : uint16 array
    residual, noise : arrays
        Of the last step.
    bias : array, shape (rows, columns, 6)
        Expected square of what the windows leave out; NaN where not estimated.
    body : int array, or None
    """

    six: Array
    covariance: Array
    moved_covariance: Array
    flag: NDArray[np.uint16]
    residual: Array
    noise: Array
    body: Array | None
    bias: Array

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Points that did not fail."""
        return (self.flag & FAILING) == 0


def one_frames_share(rho: Array) -> NDArray[np.float64]:
    """Share of a measurement's covariance that is linear in the noise of one of its frames: S/C = 1 / (2 (1 + ρ))."""
    share: NDArray[np.float64] = 0.5 / (
        1 + np.maximum(np.nan_to_num(rho, nan=0.0, posinf=0.0, neginf=0.0), 0.0)
    )
    return share
