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

q is known of files; that of a JPEG also shows in arrays of 8 bits (`sixflow.frames.blocks`).

A codec that predicts a frame from the one before leaves out what differs by little: the difference that a motion makes,
which is as long as the gradients are. So its error disturbs the fit as white noise of q √A would, with A the area over
which the gradients are alike (`gradient_area`).

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

from sixflow.frames.blocks import block_noise

_SAMPLE = 4096
_TILE, _TILES = 32, 4
"""px: side of the tiles whose spectra are taken, and how many along each side of a frame."""
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


def gradient_area(frame: NDArray[Any]) -> float:
    """Return the number of pixels over which the gradients of a frame are alike: Σ_d ρ(d)², ρ their correlation.

    What is alike to the gradients and as long as they are, noise of one pixel included, disturbs a fit as white noise
    with the same power times this area does. From spectra of tiles, Σ_d ρ² = N Σ P²/(Σ P)² for N frequencies.

    Parameters
    ----------
    frame : array, shape (height, width)

    Examples
    --------
    >>> round(gradient_area(np.random.default_rng(0).normal(size=(256, 256))), 1)
    1.5
    """
    side = min(_TILE, *frame.shape)
    corners = [
        np.unique(np.linspace(0, size - side, _TILES).astype(int))
        for size in (frame.shape[0], frame.shape[1])
    ]
    tiles = np.stack([frame[y : y + side, x : x + side] for y in corners[0] for x in corners[1]])
    tiles = np.nan_to_num(tiles.astype(np.float32), posinf=0.0, neginf=0.0)
    tiles -= tiles.mean(axis=(1, 2), keepdims=True)
    taper = np.hanning(side + 2)[1:-1]
    spectra = np.abs(np.fft.fft2(tiles * taper * taper[:, None])) ** 2
    square = (np.fft.fftfreq(side) ** 2)[:, None] + np.fft.fftfreq(side) ** 2
    power = spectra.mean(axis=0) * square
    total = float(power.sum())
    return float(power.size * (power**2).sum() / total**2) if total else 1.0


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
        left_out = self.compression
        if self.copies and left_out:
            left_out *= math.sqrt(gradient_area(np.asarray(frame)))
        floor = math.hypot(rounding, left_out)
        return floor, rounding / floor if floor else 1.0

    def with_blocks(self, frame: NDArray[Any]) -> Floor:
        """Return what is known with what the pixels of a frame tell of a JPEG, where nothing is stated.

        Parameters
        ----------
        frame : array, shape (height, width)
            Whole frames of 8 bits are looked at.
        """
        if self.compression or frame.dtype != np.uint8:
            return self
        return dataclasses.replace(self, compression=block_noise(frame))
