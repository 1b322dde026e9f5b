"""Floor: the noise that every pixel has at least, however small the residual is.

Two frames that agree to the last bit are not measured to the last bit. Their grey values were rounded, and what a lossy
compression left out is in neither. With a step Δ of the grey values, rounding leaves an error of the standard deviation
Δ/√12 in each frame; with the error q that a codec's quantisation leaves, a frame has at least

    floor = √(Δ²/12 + q²).

Where the residual of a window shows less, the covariance becomes that of white noise at the floor
(`sixflow.refine.quality`, `above_floor`); where it shows more, as with a camera's noise of half a grey value, nothing
changes.

The error of a codec is what it left out, and is not correlated with the frame that is seen; rounding adds to that, as a
camera's noise does. Both count in the covariance, rounding alone in the squares of the gradients.

Δ is read off the values themselves: the largest step that leads to all of them. A 12-bit camera in 16-bit files may
have one of 16, and grey values that were divided by 255 one of 1/255. It is no coarser than an eighth of the range of
the values: two-valued pictures were not rounded to two values. Floating-point values that lie on no such lattice were
not rounded. Colour has been added up to luminance, with the weights a: its rounding is that of a channel times |a|.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

_SAMPLE = 4096
_LEAST_STEPS = 8
_MOST_STEPS = 1e5  # more than 16 bits: not distinguished from values that were not rounded
_OFF_LATTICE = 0.05  # of a step: what floating-point rounding leaves


def rounding_noise(frame: ArrayLike) -> float:
    """Return the standard deviation of the error that rounding left in the grey values of a frame.

    Parameters
    ----------
    frame : array_like, shape (height, width) or (height, width, channels)
        Real numbers; what is not finite is passed over.

    Returns
    -------
    float
        In grey values; 0 where the values were not rounded, or are all the same.

    Examples
    --------
    >>> frame = np.arange(100).reshape(10, 10)
    >>> round(rounding_noise(frame), 4), round(rounding_noise(16 * frame), 2)
    (0.2887, 4.62)
    >>> rounding_noise(np.random.default_rng(0).random((10, 10)))
    0.0
    """
    array = np.asarray(frame)
    stride = max(1, math.isqrt(array.shape[0] * array.shape[1] // _SAMPLE))
    for sample in (array[::stride, ::stride], array):
        values = np.unique(sample[np.isfinite(sample)] if array.dtype.kind == "f" else sample)
        if values.size > 1:
            break
    else:
        return 0.0
    steps = _float_step(values) if array.dtype.kind == "f" else _whole_step(values)
    return min(steps, (float(values[-1]) - float(values[0])) / _LEAST_STEPS) / math.sqrt(12)


def _whole_step(values: NDArray[Any]) -> float:
    """Largest whole step that leads from the first of some rising numbers to all others."""
    if values.dtype.kind != "u":
        values = values.astype(np.int64).view(np.uint64)  # differences of any two fit
    return float(np.gcd.reduce(values[1:] - values[:-1]))


def _float_step(values: NDArray[Any]) -> float:
    """The same of floating-point numbers, by Euclid's algorithm; 0 where there is none within their precision."""
    with np.errstate(over="ignore"):
        gaps = np.diff(values.astype(np.float64))
        least = (float(values[-1]) - float(values[0])) / _MOST_STEPS
    if not (np.isfinite(gaps).all() and math.isfinite(least)):
        return 0.0
    step = float(gaps.min())
    while step > least:
        off = np.abs(gaps - step * np.rint(gaps / step))
        if not (off > _OFF_LATTICE * step).any():
            return float(gaps.sum() / np.rint(gaps / step).sum())
        step = float(off[off > _OFF_LATTICE * step].min())
    return 0.0


@dataclasses.dataclass(frozen=True)
class Floor:
    """What is known of the errors of all frames of a recording before they are measured.

    Attributes
    ----------
    rounding : float
        Standard deviation of what rounding left, grey values, where the frames no longer show it: colour.
    compression : float
        Standard deviation of what a lossy compression left, grey values.
    copies : bool
        Whether pixels may be copies of the frame before, which are no evidence of its motion
        (`sixflow.prepare.copies`).
    """

    rounding: float = 0.0
    compression: float = 0.0
    copies: bool = False

    @classmethod
    def of(cls, *sources: Any) -> Floor:
        """Gather what sources of frames state; arrays state nothing.

        Parameters
        ----------
        *sources : FrameSource or anything else
        """
        known = [getattr(getattr(source, "metadata", None), "compression", None) for source in sources]
        lossy = [one for one in known if one is not None]
        return cls(
            rounding=max((float(getattr(source, "rounding", 0.0)) for source in sources), default=0.0),
            compression=max((one.noise for one in lossy), default=0.0),
            copies=any(one.copies for one in lossy),
        )

    def under(self, frame: ArrayLike) -> tuple[float, float]:
        """Return the standard deviation of a frame's least noise, grey values, and the share of rounding in it."""
        rounding = max(rounding_noise(frame), self.rounding)
        floor = math.hypot(rounding, self.compression)
        return floor, rounding / floor if floor else 1.0
