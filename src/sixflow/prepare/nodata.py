"""No data: pixels without a value, which change nothing beside them.

They are NaN, what a mask leaves out, and *blank* pixels: what lies beyond the content of a frame that software has
moved, rotated, stitched or rendered, filled with one grey value. An image goes on where it has no value as it does at
its border (`continued`), so that neither a spline nor a low-pass sees a jump, or what was there.

A frame with blank pixels ends within its array, and its other end is not a thing to be measured. It is distinguished
from a background and from overexposure by the other frame of the pair. A connected region R of exactly one value is
blank where

- it holds a run of the rim that chance does not make. With p the share of equal neighbours elsewhere in the frame, any
  of n places begins a run of length L by chance with the probability n p^(L−1);
- what it leaves of the frame is in one piece: between particles or speckles the background is a net, with holes;
- the other frame has content at the place of R: no more than half of its pixels there share one value, and their
  standard deviation is at least half that of the whole frame; or

- the other frame has a region of one value there too, with the same outline: where software has moved or rectified the
  frames in one way, the rim stands still. Pixels of the pattern that have the value by chance, and touch the region,
  make a difference of B p′ pixels, with B the length of the outline and p′ the share of the value in the pattern; what
  is beyond that count's scatter is the motion of something dark or overexposed, which is data.

Only pixels that have a value, and that the mask of their frame leaves, are looked at.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.chance import count_limit, run_limit
from sixflow.engine.pixels import continue_strip
from sixflow.engine.threads import over_strips
from sixflow.prepare.frame import NO_MASK, Frame, both_valid

CONTINUED = 8
"""px: over this distance the coefficients of a quintic spline forget all but 1e-3."""
COMMONEST, OF_CONTRAST = 0.5, 0.5
"""Of the other frame, where one is blank: largest share of pixels of one value, and least share of its contrast."""
_SAMPLE = 4096
_LEAST = 3
"""Pixels: shorter runs are not looked at."""
_LINES = 8
"""Of so many rows one is looked at for the share of equal neighbours."""
_STRIP = 64
_BESIDE = np.ones((3, 3), np.bool_)


def continued(image: NDArray[Any], valid: NDArray[np.uint8]) -> NDArray[Any]:
    """The image with values for its invalid pixels near valid ones, for splines that reach over; 0 further away.

    As at the border of a frame, what is known is reflected about the nearest pixel along a row or column, and about its
    value as well. A jump would ring through the spline's coefficients; the values themselves count nowhere.

    Parameters
    ----------
    image : float array, shape (height, width)
    valid : uint8 array of the same shape
    """
    out, known = np.where(valid, image, 0).astype(image.dtype), valid
    for _ in range(2):  # the second time from what the first has reached: outer corners
        source, reached = out.copy(), known.copy()
        over_strips(_continuing(source, known, out, reached), len(image), _STRIP)
        known = reached
    return out


def _continuing(
    source: NDArray[Any], known: NDArray[Any], out: NDArray[Any], reached: NDArray[Any]
) -> Callable[[int, int], None]:
    return lambda a, b: continue_strip(source, known, CONTINUED, a, b, out, reached)


def within_region(frame: Frame, region: NDArray[np.uint8]) -> Frame:
    """The frame where a region leaves it; the same frame where that is all of it.

    Parameters
    ----------
    frame : Frame
    region : uint8 array, shape (height, width), or `NO_MASK`
    """
    if not region.size or region.all():
        return frame
    valid = both_valid(region, frame.valid)
    return frame.showing(continued(frame.image, valid)).within(valid)


def blank(
    image: NDArray[Any],
    other: NDArray[Any],
    valid: NDArray[np.uint8] = NO_MASK,
    other_valid: NDArray[np.uint8] = NO_MASK,
) -> NDArray[np.bool_] | None:
    """Where a frame is blank, next to the other of its pair; None where it nowhere is.

    Parameters
    ----------
    image, other : array, shape (height, width)
    valid, other_valid : uint8 array of the same shape, or `NO_MASK`
        Which of their pixels count.

    Examples
    --------
    >>> image = np.random.default_rng(0).random((64, 64))
    >>> filled = image.copy()
    >>> filled[:3] = 1
    >>> blank(filled, image).any(axis=1).nonzero()[0]
    array([0, 1, 2])
    >>> blank(filled, filled).any(axis=1).nonzero()[0]  # a rim that both frames have
    array([0, 1, 2])
    >>> blank(image, filled) is None
    True
    """
    image = np.where(valid, image, np.nan) if valid.size else image
    values = _values_of_runs(image)
    if not values:
        return None
    from scipy.ndimage import label

    found = np.zeros(image.shape, np.bool_)
    seen = other_valid.astype(np.bool_) if other_valid.size else np.ones(image.shape, np.bool_)
    for value, length in values.items():
        regions = label(image == value)[0]
        for number in _numbers_of_runs(regions, length):
            region = regions == number
            if label(~region, _BESIDE)[1] > 1:
                continue
            if _has_content(other, region, seen) or _stands_still(region, image, other, seen):
                found |= region
    return found if found.any() else None


def without_blanks(reference: Frame, moved: Frame) -> tuple[Frame, Frame, tuple[int, int]]:
    """The two frames of a pair with blank pixels made invalid, and how many there are in each; the same frames where
    there are none.
    """
    pair = (reference, moved), (moved, reference)
    found = [blank(one.image, other.image, one.valid, other.valid) for one, other in pair]
    frames = [
        frame if where is None else within_region(frame, (~where).astype(np.uint8))
        for frame, where in zip((reference, moved), found, strict=True)
    ]
    first, second = (0 if where is None else int(np.count_nonzero(where)) for where in found)
    return frames[0], frames[1], (first, second)


def _rims(image: NDArray[Any]) -> tuple[NDArray[Any], ...]:
    return image[0], image[-1], image[:, 0], image[:, -1]


def _runs(line: NDArray[Any]) -> tuple[NDArray[Any], NDArray[np.int64]]:
    """Values and lengths of the runs of equal values of a line; NaN is no value, since no two of it are equal."""
    ends = np.flatnonzero(np.append(line[1:] != line[:-1], True))
    return line[ends], np.diff(ends, prepend=-1)


def _values_of_runs(image: NDArray[Any]) -> dict[float, int]:
    """Values of the rim's runs that chance does not make, each with the length that chance makes at most."""
    longest: dict[float, int] = {}
    for line in _rims(image):
        values, lengths = _runs(line)
        some = lengths >= _LEAST
        for value, length in zip(values[some].tolist(), lengths[some].tolist(), strict=True):
            longest[value] = max(length, longest.get(value, 0))
    if not longest:
        return {}
    lines, found = image[::_LINES], {}
    same = lines[:, 1:][lines[:, 1:] == lines[:, :-1]]
    for value, length in sorted(longest.items()):
        own = np.count_nonzero(same == value)
        others = lines.size - np.count_nonzero(lines == value)
        share = (same.size - own + 1) / (others + 2)
        if length < _longest_by_chance(share, image.shape):
            continue
        share = max(share, min(_share_inside(one[::_LINES] == value) for one in (image, image.T)))
        least = _longest_by_chance(share, image.shape)
        if length >= least:
            found[value] = least
    return found


def _share_inside(held: NDArray[np.bool_]) -> float:
    """Share of pixels of a value that the next along the line has too, of runs that do not reach an end of the line."""
    inside = (
        held & ~np.minimum.accumulate(held, axis=1) & ~np.minimum.accumulate(held[:, ::-1], axis=1)[:, ::-1]
    )
    return float(np.count_nonzero(inside[:, 1:] & inside[:, :-1]) / (np.count_nonzero(inside) + 1))


def _longest_by_chance(share: float, shape: tuple[int, ...]) -> int:
    """Length of a run of the rim that chance does not reach where so many neighbours are equal."""
    return math.ceil(run_limit(share, 2 * sum(shape)))


def _numbers_of_runs(regions: NDArray[Any], least: int) -> list[int]:
    """Numbers of the regions that hold a run of the rim of at least some length."""
    runs = (_runs(line) for line in _rims(regions))
    return sorted(
        {int(number) for numbers, lengths in runs for number in numbers[lengths >= least] if number}
    )


def _stands_still(
    region: NDArray[np.bool_], image: NDArray[Any], other: NDArray[Any], seen: NDArray[np.bool_]
) -> bool:
    """Whether the other frame has a region of one value with the same outline."""
    from scipy.ndimage import binary_erosion, label

    values, counts = np.unique(other[region & seen], return_counts=True)
    if not values.size or 2 * counts.max() <= np.count_nonzero(region):
        return False
    value = values[counts.argmax()]
    regions = label((other == value) & seen)[0]
    shared = np.bincount(regions[region])[1:]
    there = regions == 1 + shared.argmax()
    if label(~there, _BESIDE)[1] > 1:
        return False
    outline = np.count_nonzero(region & ~binary_erosion(region, border_value=1))
    own = image[region][0]
    alike = 0.0
    for frame, each, where in ((image, own, region), (other, value, there)):
        alike += np.count_nonzero((frame == each) & ~where) / max(1, int(np.count_nonzero(~where)))
    return bool(np.count_nonzero((region != there) & seen) <= count_limit(float(outline * alike)))


def _has_content(other: NDArray[Any], region: NDArray[np.bool_], seen: NDArray[np.bool_]) -> bool:
    """Whether a frame shows something in a region, of what is seen of it."""
    values = other[region & seen]
    if not values.size:
        return False
    values = values[:: max(1, values.size // _SAMPLE)]
    commonest = np.unique(values, return_counts=True)[1].max() / values.size
    some = other[::4, ::4][seen[::4, ::4]]
    contrast = float(some.std()) if some.size else 0.0
    return bool(commonest <= COMMONEST and values.std() >= OF_CONTRAST * contrast)
