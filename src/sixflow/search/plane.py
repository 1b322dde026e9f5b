"""Plane: one affine map between two whole frames, or parts of them, of any turn, zoom, shear and shift.

1. Candidates for turn, zoom and shear from the amplitude spectra (`spectrum`), which do not move with the shift.
2. For each, the tiles of frame 0 are looked for in frame 1, and the map that they agree upon is kept (`tiles`), with
   its evidence; looked for once more with that map.
3. The map with the most evidence, if that is more than chance has.

The tiles are compared where both frames have about `MATCH_SIDE` px, frame 1 halved as many times more as the map zooms.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sixflow.prepare.frame import NO_MASK, Frame
from sixflow.prepare.light import flatten_lighting
from sixflow.search.spectrum import linear_candidates
from sixflow.search.tiles import Agreement, Haystack, agreement, haystack

Real = NDArray[np.float64]

MATCH_SIDE = 256
CHANCE = 20.0
"""Evidence that a plane needs: as `eigenfilters.capture` (its `CHANCE`)."""

CERTAIN = 100.0
"""Evidence that ends the search."""

_SMALLEST = 48  # px: side of a frame in which tiles can be looked for
_MOST_ZOOM = 4.0
_TILES = {-1: 3, 0: 4, 1: 5}


class Plane(NamedTuple):
    """An affine map.

    Attributes
    ----------
    six : array, shape (6,)
        u, v, u_x, u_y, v_x, v_y about pixel (0, 0).
    evidence : float
        Log-likelihood against chance.
    """

    six: Real
    evidence: float


def find_plane(
    reference: Frame, moved: Frame, window: float, near: tuple[slice, slice] | None = None
) -> Plane | None:
    """Find one affine map from frame 0 to frame 1.

    Parameters
    ----------
    reference, moved : Frame
        At full resolution. Masked pixels do not count.
    window : float
        px; brightness and contrast over about twice as much are evened out beforehand.
    near : (slice, slice), optional
        Rows and columns of frame 1 whose spectrum is compared as well: where a part of frame 0 may still be.

    Returns
    -------
    Plane or None
        None if no map has more evidence than chance.

    Examples
    --------
    >>> from sixflow import synth
    >>> motion = synth.Affine.rotation(2.0, centre=(95.5, 95.5))
    >>> made = synth.pair(synth.Speckle(), motion, (192, 192))
    >>> frames = [Frame(frame - 128, NO_MASK) for frame in (made.frame0, made.frame1)]
    >>> bool(abs(find_plane(*frames, 31).six[2:] - np.ravel(motion.G)).max() < 0.05)
    True
    """
    if min(*reference.image.shape, *moved.image.shape) < _SMALLEST:
        return None
    frames = [_even(frame, 2 * window) for frame in (reference, moved)]
    level = max(_halvings(reference, MATCH_SIDE), _halvings(moved, 2 * MATCH_SIDE))
    hays: dict[int, Haystack] = {}
    best: Agreement | None = None
    best_levels = 0, 0
    candidates = linear_candidates(frames[0].image, frames[1].image)
    if near is not None:
        candidates = linear_candidates(frames[0].image, frames[1].image[near]) + candidates
    for candidate in candidates:
        zoom = math.sqrt(abs(float(np.linalg.det(candidate.linear))))
        if not 1 / _MOST_ZOOM < zoom < _MOST_ZOOM:
            continue
        more = min(max(round(math.log2(zoom)), -1), 1)
        levels = level, max(0, level + more)
        if levels[1] not in hays:
            hays[levels[1]] = haystack(frames[1].level(levels[1]).image)
        found = _tried(frames[0].level(level), hays[levels[1]], candidate.linear, levels, _TILES[more])
        if found is not None and (best is None or found.evidence > best.evidence):
            best, best_levels = found, levels
            if best.evidence > CERTAIN:
                break
    if best is None or best.evidence < CHANCE:
        return None
    return _full(best, best_levels)


def _halvings(frame: Frame, side: int) -> int:
    """How often a frame is halved to have about so many pixels along its shorter side."""
    return max(0, math.ceil(math.log2(min(frame.image.shape) / side) - 0.5))


def _tried(
    frame: Frame, hay: Haystack, linear: Real, levels: tuple[int, int], per_side: int
) -> Agreement | None:
    """Agreement of the tiles with a linear map of full-size frames, and again with what they agree upon."""
    here = linear * 2.0 ** (levels[0] - levels[1])
    found = agreement(frame.image, frame.valid, hay, here, per_side)
    if found is None or found.tiles < 3:
        return found
    again = agreement(frame.image, frame.valid, hay, found.linear, per_side + 1)
    return again if again is not None and again.evidence > found.evidence else found


def _full(found: Agreement, levels: tuple[int, int]) -> Plane:
    """The map between the frames at full size."""
    linear, offset = found.linear * 2.0 ** (levels[1] - levels[0]), found.offset * 2.0 ** levels[1]
    G = linear - np.eye(2)
    return Plane(np.array([*offset, *G.ravel()]), found.evidence)


def _even(frame: Frame, window: float) -> Frame:
    """A frame without differences of brightness and contrast, 0 where masked."""
    image: NDArray[Any] = flatten_lighting(frame.image, frame.valid, window / math.sqrt(4 * math.pi))
    return Frame(image.astype(np.float32, copy=False), frame.valid if frame.valid.size else NO_MASK)
