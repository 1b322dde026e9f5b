"""Defects: dead and hot pixels found in a pair of frames, and replaced before anything is interpolated.

An image that a lens has made does not change within a pixel: a pixel that stands out of its eight neighbours by
itself, in both frames at the same place, by the same sign, is of the sensor. With

    B = the least of the four differences p − ½(a + b) to opposite neighbours a, b, if all have one sign, else 0,
    A = p − median of the sixteen pixels around the neighbours,
    D = the larger, by size, of the differences p − ½(a + b) along x and along y,

a pixel is defective where, in both frames, |B| > 4 q with q the 90 % quantile of |B|, |B| exceeds half the standard
deviation of the frame, and |D| > 0.9 |A|: in one direction at least its neighbours are free of it, and of particles
beside it. The image of a particle of e⁻² diameter d has D = (1 − exp(−8/d²))A at its peak, 0.9 A where d = 1.9 px.
Where the pattern moves hardly any is taken for a defect, where it stands still, 1 peak in 100 of 3 px and 5 in
100 of 2.4 px, of which nothing but the top is lost.

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
from sixflow.prepare.frame import Frame

STANDS_OUT, OF_CONTRAST, ALONE = 4.0, 0.5, 0.9
_SWEEPS, _REPAIR_SWEEPS = 2, 8
_STRIP = 64
_RING = tuple((j, i) for j in range(-2, 3) for i in range(-2, 3) if max(abs(j), abs(i)) == 2)


@kernel
def lone(image: NDArray[Any], y: int, x: int) -> float:
    """B of a pixel that has eight neighbours."""
    p, half = image[y, x], image.dtype.type(0.5)
    a = p - (image[y, x - 1] + image[y, x + 1]) * half
    b = p - (image[y - 1, x] + image[y + 1, x]) * half
    c = p - (image[y - 1, x - 1] + image[y + 1, x + 1]) * half
    d = p - (image[y - 1, x + 1] + image[y + 1, x - 1]) * half
    return max(min(min(a, b), min(c, d)), 0.0) + min(max(max(a, b), max(c, d)), 0.0)


@kernel
def _sample_strip(image: NDArray[Any], start: int, stop: int, out: NDArray[Any]) -> None:
    """|B| of every fourth pixel of every eighth row."""
    for k in range(start, stop):
        for n in range(out.shape[1]):
            out[k, n] = abs(lone(image, 1 + 8 * k, 1 + 4 * n))


@kernel
def _find_strip(
    image0: NDArray[Any], image1: NDArray[Any], level0: float, level1: float, start: int, stop: int,
    found: NDArray[Any],
) -> None:  # fmt: skip
    """Mark pixels whose B exceeds the level in both images, with one sign."""
    width, half = image0.shape[1], image0.dtype.type(0.5)
    least0, least1 = image0.dtype.type(level0), image0.dtype.type(level1)
    for y in range(start, stop):
        row0, row1, out = image0[y], image1[y], found[y]
        for x in range(1, width - 1):
            a = row0[x] - (row0[x - 1] + row0[x + 1]) * half
            b = row1[x] - (row1[x - 1] + row1[x + 1]) * half
            out[x] = (abs(a) > least0) & (abs(b) > least1)
        for x in range(1, width - 1):
            if out[x]:
                a, b = lone(image0, y, x), lone(image1, y, x)
                out[x] = abs(a) > level0 and abs(b) > level1 and a * b > 0


def _level(image: NDArray[Any]) -> float:
    """|B| that stands out of a frame."""
    height, width = image.shape
    sample = np.empty(((height + 5) // 8, (width + 1) // 4), image.dtype)
    over_strips(lambda a, b: _sample_strip(image, a, b, sample), sample.shape[0], _STRIP)
    level = float(np.quantile(sample, 0.9)) if sample.size else 0.0
    return max(STANDS_OUT * level, OF_CONTRAST * float(image[::16].std()))


def defects(image0: NDArray[Any], image1: NDArray[Any]) -> NDArray[np.int64]:
    """Rows and columns of the defective pixels of a pair; shape (2, pixels)."""
    height, width = image0.shape
    found = np.zeros(image0.shape, np.bool_)
    levels = _level(image0), _level(image1)
    over_strips(
        lambda a, b: _find_strip(image0, image1, *levels, max(a, 1), min(b, height - 1), found),
        height,
        _STRIP,
    )
    y, x = np.nonzero(found) if found.any() else (np.empty(0, np.int64),) * 2
    for image in (image0, image1):
        if not len(y):
            break
        around = np.stack(
            [image[np.clip(y + j, 0, height - 1), np.clip(x + i, 0, width - 1)] for j, i in _RING]
        )
        along = (
            image[y, x] - np.stack([image[y, x - 1] + image[y, x + 1], image[y - 1, x] + image[y + 1, x]]) / 2
        )
        alone = np.abs(along).max(axis=0) > ALONE * np.abs(image[y, x] - np.median(around, axis=0))
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
    return reference.showing(images[0]), moved.showing(images[1]), count
