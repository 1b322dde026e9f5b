"""Blank: what lies beyond the content of a frame that software has moved, rotated, stitched or rendered, filled with
one grey value.

Such a frame ends within its array, and its other end is not a thing to be measured. It is told from a background and
from overexposure by the other frame of the pair. A connected region R of exactly one value is blank where

- it holds an eighth of a side of the frame without a gap;
- what it leaves of the frame is in one piece: between particles or speckles the background is a net, with holes;
- the other frame has content at the place of R: no more than half of its pixels there share one value, and their
  standard deviation is at least half that of the whole frame.

Blank pixels have no value. Like pixels beyond the frame they are nobody's partner, and a spline does not see the
jump: `normalise.continued`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.prepare.frame import Frame, both_valid, continued

OF_SIDE = 1 / 8
COMMONEST, OF_CONTRAST = 0.5, 0.5
_SAMPLE = 4096
_BESIDE = np.ones((3, 3), np.bool_)


def blank(image: NDArray[Any], other: NDArray[Any]) -> NDArray[np.bool_] | None:
    """Where a frame is blank, next to the other of its pair; None where it nowhere is.

    Parameters
    ----------
    image, other : array, shape (height, width)

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
    values = _values_of_runs(image)
    if not values:
        return None
    from scipy.ndimage import label

    found = np.zeros(image.shape, np.bool_)
    for value in values:
        regions = label(image == value)[0]
        for number in _numbers_of_runs(regions):
            region = regions == number
            if _has_content(other, region) and label(~region, _BESIDE)[1] <= 1:
                found |= region
    return found if found.any() else None


def without_blanks(reference: Frame, moved: Frame) -> tuple[Frame, Frame, tuple[int, int]]:
    """The two frames of a pair with blank pixels made invalid, and how many there are in each; the same frames where
    there are none.
    """
    images = reference.image, moved.image
    found = blank(*images), blank(*reversed(images))
    frames = [
        frame if where is None else _without(frame, where)
        for frame, where in zip((reference, moved), found, strict=True)
    ]
    first, second = (0 if where is None else int(np.count_nonzero(where)) for where in found)
    return frames[0], frames[1], (first, second)


def _without(frame: Frame, where: NDArray[np.bool_]) -> Frame:
    valid = both_valid((~where).astype(np.uint8), frame.valid)
    return frame.showing(continued(frame.image, valid)).within(valid)


def _rims(image: NDArray[Any]) -> tuple[NDArray[Any], ...]:
    return image[0], image[-1], image[:, 0], image[:, -1]


def _runs(line: NDArray[Any]) -> NDArray[np.int64]:
    """Places at which runs of equal values begin that are long enough."""
    length = max(2, round(OF_SIDE * line.size))
    changes = np.concatenate([[0], np.cumsum(line[1:] != line[:-1])])
    return np.flatnonzero(changes[length - 1 :] == changes[: changes.size - length + 1])


def _values_of_runs(image: NDArray[Any]) -> list[float]:
    return sorted({float(value) for line in _rims(image) for value in line[_runs(line)]})


def _numbers_of_runs(regions: NDArray[Any]) -> list[int]:
    return sorted({int(number) for line in _rims(regions) for number in line[_runs(line)] if number})


def _has_content(other: NDArray[Any], region: NDArray[np.bool_]) -> bool:
    """Whether a frame shows something in a region."""
    values = other[region]
    values = values[:: max(1, values.size // _SAMPLE)]
    commonest = np.unique(values, return_counts=True)[1].max() / values.size
    contrast = float(other[::4, ::4].std())
    return bool(commonest <= COMMONEST and values.std() >= OF_CONTRAST * contrast)
