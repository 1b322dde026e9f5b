"""Tiles: where in frame 1 the tiles of frame 0 are, after a linear map A; the affine map that they agree upon.

A tile of frame 0 about p, seen through A, T(d) = w(d) I₀(p + A⁻¹ d), is correlated with the whole of frame 1, with the
magnitude of the spectra under a square root (`shift`). At its summit q, z standard deviations above the surface, it
matches q = p' = A p + t. A is known to a few percent, and the tile need not lie in frame 1 at all: one tile proves
little. Tiles that agree with one another prove much. Two agree if

    |q₂ − q₁ − A (p₂ − p₁)| < slack + share · |A (p₂ − p₁)|.

*Evidence.* Among n independent places the highest summit of chance has z²/2 ≈ log n. The log-likelihood that k tiles
in agreement have against chance is therefore about

    Σ z²/2 − log n − (k − 1) log n',

n' the places within which a further tile agrees. It is compared with the limit of `eigenfilters.capture`.

| symbol | name |
|---|---|
| A | linear |
| p, q | centre, place |
| z | height |
| n, n' | `places`, `PLACES_NEAR` |
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Real = NDArray[np.float64]

SIDE = 64
"""Side of a tile in pixels of frame 1."""

PLACES_NEAR = 20.0
_SLACK = 2.5, 0.06  # px, share of the distance
_ENOUGH_SEEN = 0.7  # of a tile's weight, inside frame 0
_DETAIL = 10.0  # px² that a detail of the texture covers at least


class Haystack(NamedTuple):
    """A frame that tiles are looked for in: the transform of the image, continued by 0.

    Attributes
    ----------
    transform : complex array
    padded : (int, int)
        Shape that was transformed.
    shape : (int, int)
        Of the frame.
    """

    transform: NDArray[Any]
    padded: tuple[int, int]
    shape: tuple[int, int]


class Agreement(NamedTuple):
    """An affine map that tiles agree upon.

    Attributes
    ----------
    linear : array, shape (2, 2)
    offset : array, shape (2,)
        t; a point p of frame 0 is at linear · p + offset in frame 1.
    evidence : float
        Log-likelihood against chance.
    tiles : int
        How many tiles agree.
    """

    linear: Real
    offset: Real
    evidence: float
    tiles: int


def haystack(image: NDArray[Any]) -> Haystack:
    """Prepare a frame, without a mean and 0 where masked, to look for tiles in it."""
    from scipy.fft import next_fast_len, rfft2

    padded = next_fast_len(image.shape[0] + SIDE, True), next_fast_len(image.shape[1] + SIDE, True)
    return Haystack(rfft2(image, padded), padded, (image.shape[0], image.shape[1]))


def agreement(
    image: NDArray[Any], valid: NDArray[np.uint8], hay: Haystack, linear: Real, per_side: int
) -> Agreement | None:
    """Look for the tiles of a frame, and for the affine map that most of them agree upon.

    Parameters
    ----------
    image : array, shape (height, width)
        Frame 0, without a mean, 0 where masked.
    valid : uint8 array of the same shape, or (0, 0)
    hay : Haystack
        Frame 1.
    linear : array, shape (2, 2)
        A, good to a few percent.
    per_side : int
        Tiles along each side of frame 0.

    Returns
    -------
    Agreement or None
        None if there is no tile to look for.
    """
    centres = _centres(image.shape, linear, per_side)
    tiles, seen = _tiles(image, valid, centres, linear)
    centres, tiles = centres[seen], tiles[seen]
    if not len(centres):
        return None
    places, heights = _matched(tiles, hay)
    return _agreed(centres, places, heights, linear, max(hay.shape[0] * hay.shape[1] / _DETAIL, 2.0))


def _centres(shape: tuple[int, ...], linear: Real, per_side: int) -> Real:
    """Centres (x, y) of tiles spread over a frame, so that they lie within it where it is large enough."""
    reach = np.abs(np.linalg.inv(linear)).sum(axis=1) * SIDE / 4
    lines = []
    for size, margin in ((shape[1], reach[0]), (shape[0], reach[1])):
        first = min(float(margin), (size - 1) / 2)
        lines.append(np.linspace(first, size - 1 - first, per_side))
    x, y = np.meshgrid(*lines)
    return np.stack([x.ravel(), y.ravel()], axis=1)


def _tiles(
    image: NDArray[Any], valid: NDArray[np.uint8], centres: Real, linear: Real
) -> tuple[NDArray[Any], NDArray[np.bool_]]:
    """Tiles (n, SIDE, SIDE) under a Hann window, without a mean; whether enough of each is seen."""
    from scipy.ndimage import map_coordinates

    inverse = np.linalg.inv(linear)
    d = np.arange(SIDE) - SIDE // 2
    dx, dy = np.meshgrid(d, d)
    window = np.outer(*[np.hanning(SIDE + 1)[:-1]] * 2)
    x = centres[:, 0, None, None] + inverse[0, 0] * dx + inverse[0, 1] * dy
    y = centres[:, 1, None, None] + inverse[1, 0] * dx + inverse[1, 1] * dy
    tiles = map_coordinates(image, [y, x], order=1, mode="constant", output=np.float32)
    height, width = image.shape
    seen = ((x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1)).astype(np.float32)
    if valid.size:
        seen *= map_coordinates(valid, [y, x], order=0, mode="constant")
    weight = seen * window
    total = weight.sum(axis=(1, 2))
    mean = (tiles * weight).sum(axis=(1, 2)) / np.maximum(total, 1e-6)
    tiles = ((tiles - mean[:, None, None]) * weight).astype(np.float32)
    enough = (total > _ENOUGH_SEEN * window.sum()) & (np.abs(tiles).max(axis=(1, 2)) > 0)
    return tiles, enough


def _matched(tiles: NDArray[Any], hay: Haystack) -> tuple[Real, Real]:
    """Summit (x, y) of each tile's correlation with frame 1, and its height in standard deviations."""
    from scipy.fft import irfft2, rfft2

    places, heights = np.empty((len(tiles), 2)), np.zeros(len(tiles))
    rows, columns = hay.shape
    half = SIDE // 2
    for k, tile in enumerate(tiles):
        product = rfft2(tile, hay.padded).conj() * hay.transform
        magnitude = np.abs(product)
        product /= np.sqrt(magnitude + 1e-6 * magnitude.max() + np.finfo(np.float32).tiny)
        surface = irfft2(product, hay.padded)
        # entry (j, i) has the tile's first pixel on pixel (j, i); entries from the end on are negative
        surface = np.roll(surface, (half, half), axis=(0, 1))[:rows, :columns]
        spread = float(surface.std())
        row, column = np.unravel_index(int(surface.argmax()), surface.shape)
        if spread > 0:
            heights[k] = (float(surface[row, column]) - float(surface.mean())) / spread
        places[k] = _summit(surface, int(column), int(row))
    return places, heights


def _summit(surface: NDArray[Any], column: int, row: int) -> tuple[float, float]:
    """Place of a summit between the pixels, by a parabola along each axis."""
    out = []
    for at, line in ((column, surface[row]), (row, surface[:, column])):
        if 0 < at < len(line) - 1:
            before, here, after = (float(value) for value in line[at - 1 : at + 2])
            bend = before - 2 * here + after
            out.append(at + (0.5 * (before - after) / bend if bend < 0 else 0.0))
        else:
            out.append(float(at))
    return out[0], out[1]


def _agreed(centres: Real, places: Real, heights: Real, linear: Real, count: float) -> Agreement:
    """The affine map of the tiles that agree with one of them, of all these sets the one with most evidence."""
    predicted = centres @ linear.T
    apart = predicted[None] - predicted[:, None]
    off = np.linalg.norm(places[None] - places[:, None] - apart, axis=-1)
    agree = off < _SLACK[0] + _SLACK[1] * np.linalg.norm(apart, axis=-1)
    gain = heights**2 / 2 - math.log(PLACES_NEAR)
    best = agree[int((agree * np.maximum(gain, 0)).sum(axis=1).argmax())] & (gain > 0)
    if not best.any():
        return Agreement(linear, (places - predicted).mean(axis=0), -math.inf, 0)
    A, t = _fitted(centres[best], places[best], linear)
    evidence = float(gain[best].sum()) + math.log(PLACES_NEAR) - math.log(count)
    return Agreement(A, t, evidence, int(best.sum()))


def _fitted(centres: Real, places: Real, linear: Real) -> tuple[Real, Real]:
    """Affine map of p → q by least squares, drawn to `linear` by what a tile's place is uncertain; A and t.

    Minimises Σ |q − A p − t|² + λ |A − linear|², λ = (1 px / 0.03)²: three tiles in a row leave what they cannot tell.
    """
    middle, aim = centres.mean(axis=0), places.mean(axis=0)
    p, rest = centres - middle, places - aim - (centres - middle) @ linear.T
    penalty = (1 / 0.03) ** 2
    change = np.linalg.solve(p.T @ p + penalty * np.eye(2), p.T @ rest).T
    A = linear + change
    return A, aim - A @ middle
