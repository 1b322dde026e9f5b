"""Blocks: whether the pixels of an array have gone through a JPEG, seen in the pixels themselves.

An array does not say where it is from. A JPEG cuts a picture into blocks of 8 × 8 pixels, and rounds the coefficients c
of their cosine transforms to multiples of steps q, so that those of one frequency stand in a comb. When it was decoded
its pixels were rounded once more, which leaves an error of 1/√12 in c. Of the coefficients with |c| > q/2 a share s is
closer to a multiple of q than h = min(1, q/4). The densities of transform coefficients are convex there (Laplacian), of
which no more than p = 2h/q is so close: each level of the quantiser that is taken is evidence of

    s ln s/p + (1 − s) ln (1 − s)/(1 − p)    nats

against chance. What repeats in a picture takes few levels, and is no comb. The frequencies (0, 1) and (1, 0) together
have to give more than `sixflow.chance` asks for. The step is the one with the largest |Σ exp(2πi c/q)|/n.

The steps of the other frequencies are taken in proportion from the table that encoders scale (ITU-T T.81, annex K.1);
from all of them follows the error that is left (`jpeg.quantisation_noise`). What is looked at are the blocks from the
first pixel on: of a picture that was cut out otherwise nothing is seen, and nothing of one that is cut off at black in
most of them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.chance import evidence_limit

SIDE = 8
_TABLE = np.array(
    [
        [16, 11, 10, 16, 24, 40, 51, 61],
        [12, 12, 14, 19, 26, 58, 60, 55],
        [14, 13, 16, 24, 40, 57, 69, 56],
        [14, 17, 22, 29, 51, 87, 80, 62],
        [18, 22, 37, 56, 68, 109, 103, 77],
        [24, 35, 55, 64, 81, 104, 113, 92],
        [49, 64, 78, 87, 103, 121, 120, 101],
        [72, 92, 95, 98, 112, 100, 103, 99],
    ]
)
_LOWEST = (0, 1), (1, 0)
_STEPS = np.arange(2, 129, dtype=np.float32)
_BLOCKS = 128
"""Blocks that are looked at."""


def block_noise(frame: NDArray[Any]) -> float:
    """Return the standard deviation of the error that a JPEG left in the pixels of a frame, grey values; 0 for none.

    Parameters
    ----------
    frame : array, shape (height, width)
        Grey values as they were decoded.

    Examples
    --------
    >>> block_noise(np.random.default_rng(0).integers(0, 255, (64, 64)))
    0.0
    """
    from scipy.fft import dctn

    from sixflow.frames.jpeg import quantisation_noise  # it compiles kernels

    rows, columns = (size // SIDE for size in frame.shape)
    if not rows * columns:
        return 0.0
    places = np.unique(np.linspace(0, rows * columns - 1, _BLOCKS).astype(int))
    whole = frame[: SIDE * rows, : SIDE * columns].reshape(rows, SIDE, columns, SIDE)
    blocks = whole[places // columns, :, places % columns].astype(np.float32)
    coefficients = dctn(blocks, axes=(1, 2), norm="ortho")
    combs = [_comb(coefficients[:, y, x]) for y, x in _LOWEST]
    if sum(evidence for evidence, _ in combs) < evidence_limit(_STEPS.size ** len(_LOWEST)):
        return 0.0
    scales = [step / _TABLE[place] for (_, step), place in zip(combs, _LOWEST, strict=True) if step]
    return quantisation_noise(frame, np.maximum(1.0, float(np.mean(scales)) * _TABLE))


def _comb(values: NDArray[Any]) -> tuple[float, float]:
    """Evidence that values stand in a comb, nats, and its step; 0 and 0 for none."""
    from scipy.special import entr

    levels = values / _STEPS[:, None]
    whole = np.rint(levels)
    counted, near = np.abs(levels) > 0.5, np.minimum(1 / _STEPS, 0.25)
    close = counted & (np.abs(levels - whole) < near[:, None])
    count = np.maximum(counted.sum(axis=1), 1)
    share, chance = close.sum(axis=1) / count, 2 * near
    nats = -entr(share) - entr(1 - share) - share * np.log(chance) - (1 - share) * np.log(1 - chance)
    shown = np.flatnonzero((share > chance) & (count * nats > evidence_limit(_STEPS.size)))
    if not shown.size:
        return 0.0, 0.0
    length = np.abs((np.exp(2j * np.pi * levels[shown]) * counted[shown]).sum(axis=1)) / count[shown]
    best = shown[length.argmax()]
    taken = np.unique(whole[best][counted[best]]).size
    return float(taken * nats[best]), float(_STEPS[best])
