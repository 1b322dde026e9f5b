"""Quality: what a pass sees of every window, and what the last one says of every point."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.solve import FEEDBACK_STEP, noise_feedback
from sixflow.engine.window import sharpening_noise
from sixflow.judge.flags import MINIMUM_TEXTURE


@dataclasses.dataclass(frozen=True)
class Quality:
    """What the last pass says about every grid point.

    Attributes
    ----------
    covariance : array, shape (rows, columns, 6, 6)
        Of the six numbers; NaN where the texture does not rise above the noise.
    texture : array, shape (rows, columns)
        Signal-to-noise ratio (power) of the gradient in the window's weakest direction.
    weight : array, shape (rows, columns)
        Share of the window's weight on pixels that have a partner, 0 to 1.
    residual : array, shape (rows, columns)
        Zero-normalised residual: rms difference / rms contrast of the reference.
    noise : array, shape (rows, columns)
        Standard deviation of one frame's noise, from the mean absolute residual.
    rho : array, shape (rows, columns)
        What noise adds to the gradients' squares, over what the texture gives them.
    minimum_texture : float
        Texture below which the covariance is not to be trusted.
    partner : array, shape (rows, columns), or None
        As `weight`, with the pixels that were left out as foreign; None where no pixels were weighed.
    foreign, foreign_centre : array, shape (rows, columns), or None
        Share of the window's weight, and of that of a window of half the size, that foreign pixels lost.
    matched : array, shape (rows, columns), or None
        Share of the gradients' squares, less noise, on the pixels that were not left out as foreign.
    light : array, shape (rows, columns, 2), or None
        Gain and offset of each window's light from the reference to the moved frame; None where none was allowed.
    held : bool array, shape (rows, columns), or None
        Points that sharpening left as they were.
    """

    covariance: NDArray[Any]
    texture: NDArray[Any]
    weight: NDArray[Any]
    residual: NDArray[Any]
    noise: NDArray[Any]
    rho: NDArray[Any]
    minimum_texture: float = MINIMUM_TEXTURE
    partner: NDArray[Any] | None = None
    foreign: NDArray[Any] | None = None
    foreign_centre: NDArray[Any] | None = None
    matched: NDArray[Any] | None = None
    light: NDArray[Any] | None = None
    held: NDArray[np.bool_] | None = None


@dataclasses.dataclass(frozen=True)
class Seen:
    """What a pass saw in every window; arrays of shape (rows, columns).

    weight with a partner; noise of one frame; zero-normalised residual; the share of Σ w r² that the
    pass's own update left; what noise adds to Σ w g_x²; texture and rho of `solve.texture_strip`; mean
    square of the residual over that of a Gaussian of the same mean size (None: not known); what the residual lacks of
    the floor's noise, as a share of its power (None: nowhere anything).
    """

    weight: NDArray[Any]
    noise: NDArray[Any]
    residual: NDArray[Any]
    left: NDArray[Any]
    noise_gradient: NDArray[Any]
    texture: NDArray[Any]
    rho: NDArray[Any]
    tail: NDArray[Any] | None = None
    lacking: NDArray[Any] | None = None


def above_floor(noise: NDArray[Any], floor: float | NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any] | None]:
    """Noise that is not below its floor, and what it lacks of that, [1 − noise²/floor²]₊; None if nowhere anything.

    Parameters
    ----------
    noise : array, shape (rows, columns)
        Standard deviation seen in the residual of each window.
    floor : float or array of the same shape
        Least standard deviation; 0 where there is none.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        below = noise < floor
        if not below.any():
            return noise, None
        return np.where(below, floor, noise), np.where(below, 1 - (noise / floor) ** 2, 0.0)


def feedback_scale(rho: NDArray[Any]) -> NDArray[np.float64]:
    """Factors of the six numbers' standard errors by the noise's feedback (`solve.noise_feedback`); (…, 6)."""
    entry = np.clip(np.nan_to_num(rho) / FEEDBACK_STEP, 0, noise_feedback().shape[1] - 1)
    displacement, gradient = noise_feedback()[:, entry.astype(int)]
    return np.stack([displacement] * 2 + [gradient] * 4, axis=-1)


def shrunk_noise(maps: NDArray[Any]) -> NDArray[np.float64]:
    """Factor on the power of the residual's noise where the moved frame is smaller; shape (rows, columns).

    On the pixels of the reference, the moved frame's noise is as white as its own for det F ≥ 1. For det F < 1 it is
    interpolated between pixels further apart: as strong, but of 1/det F the power at the frequencies that are left.
    """
    area = (1 + maps[2]) * (1 + maps[5]) - maps[3] * maps[4]
    with np.errstate(divide="ignore"):
        return (1 + np.nan_to_num(np.clip(1 / np.abs(area), 1, 16), nan=1.0)) / 2


def six_from_unknowns(sigma: float, sharpened: int) -> NDArray[np.float64]:
    """Matrix from θ = (u, σu_x, σu_y, v, σv_x, σv_y) to the six numbers, with the noise factors of
    sharpening.
    """
    displacement, gradient = sharpening_noise(sharpened) if sharpened else (1.0, 1.0)
    g = gradient / sigma
    return np.array(
        [
            [displacement, 0, 0, 0, 0, 0],
            [0, 0, 0, displacement, 0, 0],
            [0, g, 0, 0, 0, g],
            [0, 0, -g, 0, g, 0],
            [0, g, 0, 0, 0, -g],
            [0, 0, g, 0, g, 0],
        ]
    )
