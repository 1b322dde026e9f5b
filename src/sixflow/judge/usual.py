"""Usual: what the pixels of a pair cost its motion where nothing is wrong, foreign pixels included.

Unmatched particles and changes of the pattern raise the mean cost m of the pixels in a disc everywhere, here a little
and there more, by as many such spots as chance puts into one disc. √m scatters alike whatever their number is. With s₁
the scatter of √m in discs of half the size, a quarter of the pixels in each, from the median of the differences between
discs that do not overlap,

    s₂ = s₁/2,     √μ = (16th percentile of √m in a block) + s₂,     φ = 2 N₁ (2 √μ s₁)²

16 % of normal deviates lie more than one standard deviation below their mean. So up to 84 % of the points of a block
may lie beside edges, which raise √m by many s₂: the lower end tells what is usual all the same. φ, the dispersion, is
the variance of m over that of noise, ½ for each of N₁ pixels. Neither m nor its scatter is less than noise makes them.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from sixflow.chance import normal_limit
from sixflow.engine.window import window_sigma
from sixflow.maps.grid import Grid
from sixflow.refine.windows import image_sums

BLOCK = 4
"""Windows, and twice as many grid points at least: side of the blocks whose percentiles tell what is usual."""
BELOW = 15.866
"""Percent of normal deviates that are more than one standard deviation below their mean."""
OF_DIFFERENCES = 1.4826 / np.sqrt(2)
"""Standard deviation of normal deviates over the median size of the difference of two."""

Array = NDArray[Any]


class Disc(NamedTuple):
    """What discs of one size about the points show.

    Attributes
    ----------
    m, left : array
        √ of m, NaN where no pixel has a partner, and of m less what is explained.
    share : array
        Of the pixels that have a partner.
    unrelated : bool array
        Where the residual's power is more than half of what unrelated pixels of this contrast would leave.
    """

    m: Array
    left: Array
    share: Array
    unrelated: NDArray[np.bool_]


def disc_of(planes: tuple[Array, ...], grid: Grid, size: float) -> Disc:
    """Means in discs of a size.

    Parameters
    ----------
    planes : three arrays, or six, shape (height, width)
        Cost, what of it is explained, and 1 where a pixel has a partner; r², I₀ and I₀² there.
    grid : Grid
    size : float
        s, px.
    """
    sums = image_sums(planes, grid, size)
    with np.errstate(invalid="ignore", divide="ignore"):
        means = sums[1:] / sums[3]
        unrelated = np.zeros(grid.shape, np.bool_)
        if len(planes) > 3:
            unrelated = means[3] > means[5] - means[4] ** 2
        return Disc(
            np.sqrt(means[0]), np.sqrt(np.maximum(means[0] - means[1], 0)), sums[3] / sums[0].max(), unrelated
        )


class Usual(NamedTuple):
    """What is usual in discs of one size; arrays of shape (rows, columns).

    Attributes
    ----------
    left : array
        √ of m, less what is explained, of every point.
    middle, deviation : array
        √μ and s₂.
    dispersion : array
        φ.
    unrelated : bool array
        As in `Disc`.
    dear : bool array
        Points that cost more than two motions do that are told apart, and are as good (`sixflow.judge.edges`).
    """

    left: Array
    middle: Array
    deviation: Array
    dispersion: Array
    unrelated: NDArray[np.bool_]
    dear: NDArray[np.bool_]


def usual_in(planes: tuple[Array, ...], grid: Grid, size: float, small: float, questions: int) -> Usual:
    """What is usual in discs of a size.

    Parameters
    ----------
    planes : six arrays
        As for `disc_of`.
    grid : Grid
    size, small : float
        s of the discs, and of smaller ones, px.
    questions : int
        How many motions a point is compared with.
    """
    disc, within = disc_of(planes, grid, size), disc_of(planes[:3], grid, small)
    side = max(2 * BLOCK, round(BLOCK * size * 2 / window_sigma(1.0) / grid.step))
    low, scatter = percentiles(disc.m, within.m, max(1, round(4 * small / grid.step)), side)
    # not less than noise makes: ½ ± √(½/N) of m
    scatter = np.maximum(scatter, 1 / (2 * math.sqrt(4 * math.pi) * small))
    middle = np.maximum(low + scatter * small / size, math.sqrt(1 / 2))
    dispersion = np.maximum(1, 8 * math.pi * small**2 * (2 * middle * scatter) ** 2)
    dear = np.zeros(grid.shape, np.bool_)
    with np.errstate(invalid="ignore", divide="ignore"):
        deviation = scatter * small / size / np.sqrt(disc.share)
        for left, s in ((disc.left, size), (within.left, small)):
            dear |= left**2 - middle**2 > normal_limit(questions) ** 2 * dispersion / (8 * math.pi * s**2)
    return Usual(disc.left, middle, deviation, dispersion, disc.unrelated, dear)


def percentiles(m: Array, small: Array, apart: int, side: int) -> tuple[Array, Array]:
    """The 16th percentile of `m` around every point, and the standard deviation of `small`, from its differences.

    Both are taken in blocks that overlap by half, and interpolated between their centres.

    Parameters
    ----------
    m, small : arrays, shape (rows, columns)
        NaN where they are not known.
    apart : int
        Grid points between those whose difference is taken.
    side : int
        Of the blocks, grid points.

    Returns
    -------
    two arrays, shape (rows, columns)
        Infinite where nothing is known.
    """
    differences = np.full((2, *m.shape), np.nan)
    differences[0, :, apart:] = np.abs(small[:, apart:] - small[:, :-apart])
    differences[1, apart:] = np.abs(small[apart:] - small[:-apart])
    half = max(1, side // 2)
    starts = [np.arange(0, max(1, size - half), half) for size in m.shape]
    blocks = np.empty((2, len(starts[0]), len(starts[1])))
    for at in np.ndindex(blocks.shape[1:]):
        here = tuple(slice(start[k], start[k] + side) for start, k in zip(starts, at, strict=True))
        blocks[0, *at] = _percentile(m[here], BELOW)
        blocks[1, *at] = OF_DIFFERENCES * _percentile(differences[(slice(None), *here)], 50)
    centres = [
        np.clip((np.arange(size) + 0.5 - side / 2) / half, 0, len(start) - 1)
        for size, start in zip(m.shape, starts, strict=True)
    ]
    places = np.meshgrid(*centres, indexing="ij")
    known = [np.where(np.isfinite(plane), plane, _percentile(plane, 50)) for plane in blocks]
    low, scatter = (scipy.ndimage.map_coordinates(plane, places, order=1, mode="nearest") for plane in known)
    return low, scatter


def _percentile(values: Array, percent: float) -> float:
    """Percentile of the values that are known; infinite if none is."""
    values = values[np.isfinite(values)]
    return float(np.percentile(values, percent)) if values.size else np.inf
