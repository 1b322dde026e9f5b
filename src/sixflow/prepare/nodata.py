"""No data: pixels without a value, which change nothing beside them.

They are NaN, what a mask leaves out, and *blank* pixels: what lies beyond the content of a frame that software has
moved, rotated, stitched or rendered, filled with one grey value. An image goes on where it has no value as it does at
its border (`continued`), so that neither a spline nor a low-pass sees a jump, or what was there.

A frame with blank pixels ends within its array, and its other end is not a thing to be measured. It is distinguished
from a background and from overexposure by the other frame of the pair. A connected region R of exactly one value is
blank where

- it holds an eighth of a side of the frame without a gap;
- what it leaves of the frame is in one piece: between particles or speckles the background is a net, with holes;
- the other frame has content at the place of R: no more than half of its pixels there share one value, and their
  standard deviation is at least half that of the whole frame.

Only pixels that have a value, and that the mask of their frame leaves, are looked at.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.pixels import continue_strip
from sixflow.engine.threads import over_strips
from sixflow.prepare.frame import NO_MASK, Frame, both_valid

CONTINUED = 8
"""px: over this distance the coefficients of a quintic spline forget all but 1e-3."""
OF_SIDE = 1 / 8
"""Share of a side of the frame that a blank region holds without a gap."""
COMMONEST, OF_CONTRAST = 0.5, 0.5
"""Of the other frame, where one is blank: largest share of pixels of one value, and least share of its contrast."""
_SAMPLE = 4096
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
    >>> blank(filled, filled) is None
    True
    """
    image = np.where(valid, image, np.nan) if valid.size else image
    values = _values_of_runs(image)
    if not values:
        return None
    from scipy.ndimage import label

    found = np.zeros(image.shape, np.bool_)
    seen = other_valid.astype(np.bool_) if other_valid.size else np.ones(image.shape, np.bool_)
    for value in values:
        regions = label(image == value)[0]
        for number in _numbers_of_runs(regions):
            region = regions == number
            if _has_content(other, region, seen) and label(~region, _BESIDE)[1] <= 1:
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


def _runs(line: NDArray[Any]) -> NDArray[np.int64]:
    """Places at which runs of equal values begin that are long enough."""
    length = max(2, round(OF_SIDE * line.size))
    changes = np.concatenate([[0], np.cumsum(line[1:] != line[:-1])])
    return np.flatnonzero(changes[length - 1 :] == changes[: changes.size - length + 1])


def _values_of_runs(image: NDArray[Any]) -> list[float]:
    """Values of the runs; NaN is none, since no two of it are equal."""
    return sorted({float(value) for line in _rims(image) for value in line[_runs(line)]})


def _numbers_of_runs(regions: NDArray[Any]) -> list[int]:
    return sorted({int(number) for line in _rims(regions) for number in line[_runs(line)] if number})


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
