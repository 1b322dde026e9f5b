"""Defects: dead and hot pixels found in a pair of frames, and replaced before anything is interpolated or filtered.

An image that a lens has made does not change within a pixel: a pixel that stands out of its eight neighbours by
itself, in both frames at the same place, by the same sign, is of the sensor. With

    B = the least of the four differences p − ½(a + b) to opposite neighbours a, b, if all have one sign, else 0,
    A = p − median of the sixteen pixels around the neighbours,
    D = the larger, by size, of the differences p − ½(a + b) along x and along y,

a pixel is defective where, in both frames, |B| > 4 q with q the 90 % quantile of |B|, |B| exceeds half the standard
deviation of the frame, and |D| > 0.9 |A|: in one direction at least its neighbours are free of it, and of particles
beside it. Quantile and standard deviation are those of its surroundings, medians of 3 × 3 tiles of 64 × 64 px: a
reflection or a dark corner elsewhere says nothing about a pixel. The image of a particle of e⁻² diameter d has
D = (1 − exp(−8/d²))A at its peak, 0.9 A where d = 1.9 px. Where the pattern moves hardly any is taken for a defect,
where it stands still, 1 peak in 100 of 3 px and 5 in 100 of 2.4 px, of which nothing but the top is lost.

Particle images of hardly more than a pixel that move hardly any stand out and stay as well. But a lens makes them: they
light the pixels beside them, if by a few percent, and a pixel of the sensor does not. Of every pixel that was found the
mean of the four next ones, above that of the sixteen around, is compared with its own; if the mean of these shares is
above 0 by more than chance (Student's t at `chance.FALSE_ALARMS`), they are images, and none is a defect. The shares of
defects are below 0: pixels stand out for not being beside something bright.

The value of a defective pixel is the biharmonic one, 20 p = 8 Σ(next) − 2 Σ(diagonal) − Σ(next but one), exact for
cubic images; it would otherwise spread over the ten pixels around it when the frame is interpolated. What the
replacement does not get right is left to the weights of `engine.weigh`.

Only pixels that count in both frames are judged. Where a neighbour does not count, the opposite one stands in for it.
A slope then stands out as well, and B has to be twice as large. A mask of frame 0 alone says nothing of frame 1, where
pixels beside it count: there defects are replaced too, found in both frames as they are without the mask.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.chance import FALSE_ALARMS
from sixflow.engine.pixels import DEFECT_TILE, find_lone_strip, tile_levels_strip
from sixflow.engine.scales import median_around
from sixflow.engine.threads import over_strips
from sixflow.prepare.frame import NO_MASK, Frame, both_valid
from sixflow.prepare.nodata import continued

STANDS_OUT = 4.0
"""|B| of a defect over its 90 % quantile: Gaussian noise reaches it in one pixel of 2·10⁵, and not in both frames."""
OF_CONTRAST = 0.5
"""|B| of a defect over the local standard deviation: less disturbs no more than the pattern does."""
ALONE = 0.9
"""|D| of a defect over |A|: particles of more than 1.9 px have less."""
AT_RIM = 2.0
"""Times the level beside pixels that do not count: slopes of a speckle reach it in one pixel of 10⁵."""
_REACH = 1  # tiles around one that say what is usual there
_SWEEPS, _REPAIR_SWEEPS = 2, 8
_STRIP = 64
Places = tuple[tuple[int, int], ...]
_RING = tuple((j, i) for j in range(-2, 3) for i in range(-2, 3) if max(abs(j), abs(i)) == 2)
_NEXT, _DIAGONAL = ((-1, 0), (1, 0), (0, -1), (0, 1)), ((-1, -1), (-1, 1), (1, -1), (1, 1))
_NEXT_BUT_ONE = ((-2, 0), (2, 0), (0, -2), (0, 2))


def _levels(image: NDArray[Any], valid: NDArray[np.uint8]) -> NDArray[np.float64]:
    """|B| that stands out of each tile; shape (tile rows, tile columns), infinite where no pixel counts."""
    height, width = image.shape
    tiles = np.empty((2, -(-height // DEFECT_TILE), -(-width // DEFECT_TILE)))
    over_strips(lambda a, b: tile_levels_strip(image, valid, a, b, tiles), tiles.shape[1], 1)
    quantile, contrast = (median_around(plane, _REACH) for plane in tiles)
    return np.nan_to_num(np.maximum(STANDS_OUT * quantile, OF_CONTRAST * contrast), nan=np.inf, posinf=np.inf)


def defects(
    image0: NDArray[Any],
    image1: NDArray[Any],
    valid0: NDArray[np.uint8] = NO_MASK,
    valid1: NDArray[np.uint8] = NO_MASK,
    replaced: NDArray[np.int64] | None = None,
) -> NDArray[np.int64]:
    """Rows and columns of the defective pixels of a pair; shape (2, pixels).

    Parameters
    ----------
    image0, image1 : float array, shape (height, width)
        Continued where they have no value.
    valid0, valid1 : uint8 array of the same shape, or `NO_MASK`
        Which of their pixels count.
    replaced : int array, shape (2, pixels), optional
        Defects that have been replaced: what stands beside them is alone.
    """
    height = len(image0)
    found, counted = np.zeros(image0.shape, np.bool_), both_valid(valid0, valid1)
    levels = np.stack([_levels(image0, valid0), _levels(image1, valid1)])
    over_strips(
        lambda a, b: find_lone_strip(
            image0, image1, levels, counted, AT_RIM, max(a, 1), min(b, height - 1), found
        ),
        height,
        _STRIP,
    )
    if not found.any():
        return np.empty((2, 0), np.int64)
    y, x = np.nonzero(found)
    known = counted.astype(np.bool_) if counted.size else np.ones(image0.shape, np.bool_)
    if replaced is not None:
        known[tuple(replaced)] = False
    for image in (image0, image1):
        alone = _is_alone(image, known, y, x)
        y, x = y[alone], x[alone]
    if y.size and _light_their_neighbours(image0 + image1, known, y, x):
        return np.empty((2, 0), np.int64)
    return np.stack([y, x])


def _beside(
    image: NDArray[Any], known: NDArray[np.bool_], y: NDArray[np.int64], x: NDArray[np.int64], places: Places
) -> NDArray[Any]:
    """Values at places about some pixels, NaN where they are not known; shape (places, pixels)."""
    height, width = image.shape
    values = []
    for j, i in places:
        row, column = np.clip(y + j, 0, height - 1), np.clip(x + i, 0, width - 1)
        values.append(np.where(known[row, column], image[row, column], np.nan))
    return np.stack(values)


def _light_their_neighbours(
    image: NDArray[Any], known: NDArray[np.bool_], y: NDArray[np.int64], x: NDArray[np.int64]
) -> bool:
    """Whether pixels that stand out light those next to them, all together more than chance does."""
    around = _beside(image, known, y, x, _RING).mean(axis=0)
    p, q = image[y, x] - around, _beside(image, known, y, x, _NEXT).mean(axis=0) - around
    told = np.isfinite(p) & np.isfinite(q) & (p != 0)
    share = (q[told] / p[told]).astype(np.float64)
    if share.size < 2:
        return False
    from scipy.special import stdtrit

    limit = float(stdtrit(share.size - 1, 1 - FALSE_ALARMS / 2))
    return float(share.mean()) > limit * float(share.std(ddof=1)) / math.sqrt(share.size)


def _is_alone(
    image: NDArray[Any], known: NDArray[np.bool_], y: NDArray[np.int64], x: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Whether |D| > 0.9 |A| at some pixels, shape (pixels,), by their neighbours that are known."""
    p = image[y, x]
    differences = []
    for j, i in ((0, 1), (1, 0)):
        one, other = _beside(image, known, y, x, ((j, i), (-j, -i)))
        one, other = np.where(np.isnan(one), other, one), np.where(np.isnan(other), one, other)
        differences.append(np.nan_to_num(p - (one + other) / 2))
    around = _beside(image, known, y, x, _RING)
    told = ~np.isnan(around).all(axis=0)
    middle = np.zeros(p.shape, image.dtype)
    middle[told] = np.nanmedian(around[:, told], axis=0)
    alone: NDArray[np.bool_] = np.abs(differences).max(axis=0) > ALONE * np.abs(p - middle)
    return alone & told


def repaired(image: NDArray[Any], at: NDArray[np.int64], valid: NDArray[np.uint8] = NO_MASK) -> NDArray[Any]:
    """Copy of an image with new values at the pixels `at`, shape (2, pixels), and continued where it is not valid."""
    y, x = at
    out = np.pad(image, 2, mode="reflect")
    spoilt = np.zeros(out.shape, np.bool_)
    if valid.size:
        spoilt[2:-2, 2:-2] = valid == 0
    spoilt[y + 2, x + 2] = True
    near, bad = (
        np.stack([a[y + 2 + j, x + 2 + i] for j in (-1, 0, 1) for i in (-1, 0, 1)]) for a in (out, spoilt)
    )
    good = np.ma.median(np.ma.array(near, mask=bad), axis=0)
    out[y + 2, x + 2] = np.where(np.ma.getmaskarray(good), np.median(near, axis=0), np.ma.getdata(good))
    if valid.size:  # what was continued from a defect
        out[2:-2, 2:-2] = continued(out[2:-2, 2:-2], valid)

    def around(places: Places) -> NDArray[Any]:
        return sum(out[y + 2 + j, x + 2 + i] for j, i in places)

    for _ in range(_REPAIR_SWEEPS):
        out[y + 2, x + 2] = (8 * around(_NEXT) - 2 * around(_DIAGONAL) - around(_NEXT_BUT_ONE)) / 20
    inner = np.ascontiguousarray(out[2:-2, 2:-2])
    return continued(inner, valid) if valid.size else inner


def without_defects(
    reference: Frame, moved: Frame, unmasked: Frame | None = None
) -> tuple[Frame, Frame, int]:
    """The two frames with defective pixels replaced, and how many there are.

    Parameters
    ----------
    reference, moved : Frame
        At full resolution.
    unmasked : Frame, optional
        Frame 0 without its mask, where that does not hold in frame 1.

    Returns
    -------
    Frame, Frame, int
        The same frames where no pixel is defective. Those outside the mask of frame 0 are not counted.
    """
    if min(reference.image.shape) < 3:
        return reference, moved, 0
    frames = [reference, moved] if unmasked is None else [reference, moved, unmasked]
    images = [frame.image for frame in frames]
    inside, every = (np.empty((2, 0), np.int64) for _ in range(2))
    for _ in range(_SWEEPS):  # beside one that stands out far, others are found once it is gone
        found = defects(images[0], images[1], reference.valid, moved.valid, inside)
        beside = np.empty((2, 0), np.int64)
        if unmasked is not None:
            beside = defects(images[2], images[1], unmasked.valid, moved.valid, every)
            beside = beside[:, reference.valid[tuple(beside)] == 0]
        if not found.size + beside.size:
            break
        inside = np.unique(np.concatenate([inside, found], axis=1), axis=1)
        every = np.unique(np.concatenate([every, found, beside], axis=1), axis=1)
        images = [
            repaired(frame.image, places, frame.valid)
            for frame, places in zip(frames, (inside, every, every), strict=False)
        ]
    if inside.size:
        reference = reference.showing(images[0])
    return reference, moved.showing(images[1]) if every.size else moved, inside.shape[1]
