"""Copies: blocks of pixels that a video codec took over from the frame before, and that say nothing of the motion.

Where little changes, a codec does not send a block again: it is skipped, and the frame holds the pixels of the one
before to the last bit. Compared with them, the motion is 0 and the residual is 0, whatever happened before the camera.
Such pixels are no evidence, in either frame.

A codec decides by blocks, of 4 × 4 pixels or more. A pixel belongs to a copied block if it lies in a square of 4 × 4
pixels that are all the same in both frames, and that are not flat: their values span more than one step of rounding,
so that a motion, or noise of more than rounding, would have changed one of them. What is flat (black, overexposed) may
well stay as it is, and has no weight in the fit.

Asked of frames of which a codec is known to copy (`Compression.copies`). A still background is legitimate elsewhere.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from sixflow.prepare.frame import NO_MASK

SIDE = 4
"""px: the smallest block of a codec."""


def copied_pixels(
    first: NDArray[Any], second: NDArray[Any], step: float, counted: NDArray[np.uint8] = NO_MASK
) -> NDArray[np.bool_]:
    """Pixels in blocks that are the same in both frames and not flat.

    Parameters
    ----------
    first, second : array, shape (height, width)
    step : float
        Of the grey values: squares whose values span no more are flat.
    counted : uint8 array of the same shape, or `NO_MASK`
        Pixels that count; blocks are made of these alone.

    Returns
    -------
    bool array, shape (height, width)

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> first, second = rng.integers(0, 255, (2, 32, 32))
    >>> second[8:16, 8:24] = first[8:16, 8:24]
    >>> found = copied_pixels(first, second, 1)
    >>> found.sum() == 8 * 16, found[8:16, 8:24].all()
    (np.True_, np.True_)
    """
    same = (first == second) & counted.astype(np.bool_) if counted.size else first == second
    if not same.any():
        return same
    # squares by their upper left pixels; filters put them at the pixel that is SIDE // 2 further
    whole = scipy.ndimage.minimum_filter(same, SIDE, mode="constant", cval=False)
    span = scipy.ndimage.maximum_filter(first, SIDE) - scipy.ndimage.minimum_filter(first, SIDE)
    found = whole & (span > step)
    return np.asarray(scipy.ndimage.maximum_filter(found, SIDE, mode="constant", cval=False, origin=-1))
