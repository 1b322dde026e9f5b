"""Defects: dead and hot pixels found in a pair of frames, and replaced before anything is interpolated.

An image that a lens has made does not change within a pixel: a pixel that stands out of its eight neighbours by
itself, in both frames at the same place, by the same sign, is of the sensor. With

    B = the least of the four differences p − ½(a + b) to opposite neighbours a, b, if all have one sign, else 0,
    A = p − median of the neighbours,

a pixel is defective where, in both frames, |B| > 4 q with q the 90 % quantile of |B|, |B| exceeds half the standard
deviation of the frame, and |B| > 0.8 |A|. The image of a
particle of e⁻² diameter d has B = (1 − exp(−8/d²))A at its peak: those of 2.2 px and more are never taken for defects,
even when they stand still.

The value of a defective pixel is the biharmonic one, 20 p = 8 Σ(next) − 2 Σ(diagonal) − Σ(next but one), exact for
cubic images; it would otherwise spread over the ten pixels around it when the frame is interpolated. What the
replacement does not get right is left to the weights of `engine.weigh`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.compiler import kernel
from sixflow.engine.threads import over_strips
from sixflow.normalise import Frame

STANDS_OUT, OF_CONTRAST, ALONE = 4.0, 0.5, 0.8
_SWEEPS, _REPAIR_SWEEPS = 2, 8
_STRIP = 64


@kernel
def lone_strip(image: NDArray[Any], start: int, stop: int, out: NDArray[Any]) -> None:
    """B of the rows start … stop; 0 in the frame's outermost rows and columns."""
    height, width = image.shape
    zero = image.dtype.type(0)
    for y in range(start, stop):
        target = out[y]
        for x in range(width):
            target[x] = zero
        if y == 0 or y == height - 1:
            continue
        above, row, below = image[y - 1], image[y], image[y + 1]
        for x in range(1, width - 1):
            p = row[x]
            a = p - (row[x - 1] + row[x + 1]) / 2
            b = p - (above[x] + below[x]) / 2
            c = p - (above[x - 1] + below[x + 1]) / 2
            d = p - (above[x + 1] + below[x - 1]) / 2
            least, most = min(min(a, b), min(c, d)), max(max(a, b), max(c, d))
            target[x] = max(least, zero) + min(most, zero)


def lone(image: NDArray[Any]) -> NDArray[Any]:
    """B of every pixel of an image."""
    out = np.empty_like(image)
    over_strips(lambda a, b: lone_strip(image, a, b, out), image.shape[0], _STRIP)
    return out


def defects(image0: NDArray[Any], image1: NDArray[Any]) -> NDArray[np.int64]:
    """Rows and columns of the defective pixels of a pair; shape (2, pixels)."""
    spikes = lone(image0), lone(image1)
    found = spikes[0] * spikes[1] > 0
    for spike, image in zip(spikes, (image0, image1), strict=True):
        size = np.abs(spike)
        level = float(np.quantile(size[::4, ::4], 0.9))
        found &= size > max(STANDS_OUT * level, OF_CONTRAST * float(image[::4, ::4].std()))
    y, x = np.nonzero(found)
    for image, spike in zip((image0, image1), spikes, strict=True):
        around = np.stack([image[y + j, x + i] for j in (-1, 0, 1) for i in (-1, 0, 1) if (j, i) != (0, 0)])
        alone = np.abs(spike[y, x]) > ALONE * np.abs(image[y, x] - np.median(around, axis=0))
        y, x = y[alone], x[alone]
    return np.stack([y, x])


def repaired(image: NDArray[Any], at: NDArray[np.int64]) -> NDArray[Any]:
    """Copy of an image with new values at the pixels `at`, shape (2, pixels)."""
    y, x = at
    out = np.pad(image, 2, mode="reflect")
    bad = np.zeros(out.shape, np.bool_)
    bad[y + 2, x + 2] = True
    stencil = [(j, i, 8.0) for j, i in ((-1, 0), (1, 0), (0, -1), (0, 1))]
    stencil += [(j, i, -2.0) for j in (-1, 1) for i in (-1, 1)]
    stencil += [(j, i, -1.0) for j, i in ((-2, 0), (2, 0), (0, -2), (0, 2))]
    near = np.stack([out[y + 2 + j, x + 2 + i] for j in (-1, 0, 1) for i in (-1, 0, 1)])
    spoilt = np.stack([bad[y + 2 + j, x + 2 + i] for j in (-1, 0, 1) for i in (-1, 0, 1)])
    good = np.ma.median(np.ma.array(near, mask=spoilt), axis=0)
    out[y + 2, x + 2] = np.ma.filled(good, np.ma.median(good) if len(y) else 0)
    for _ in range(_REPAIR_SWEEPS):
        out[y + 2, x + 2] = sum(w * out[y + 2 + j, x + 2 + i] for j, i, w in stencil) / 20
    return np.ascontiguousarray(out[2:-2, 2:-2])


def without_defects(reference: Frame, moved: Frame) -> tuple[Frame, Frame, int]:
    """The two frames with defective pixels replaced, and how many there are.

    Parameters
    ----------
    reference, moved : Frame
        At full resolution.

    Returns
    -------
    Frame, Frame, int
        The same frames where no pixel is defective.
    """
    if min(reference.image.shape) < 3:
        return reference, moved, 0
    images, count = [reference.image, moved.image], 0
    places = np.empty((2, 0), np.int64)
    for _ in range(_SWEEPS):
        found = defects(images[0], images[1])
        if not found.size:
            break
        places = np.unique(np.concatenate([places, found], axis=1), axis=1)
        images = [repaired(frame.image, places) for frame in (reference, moved)]
    count = places.shape[1]
    if not count:
        return reference, moved, 0
    return Frame(images[0], reference.valid), Frame(images[1], moved.valid), count
