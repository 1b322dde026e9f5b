"""Pattern: what all frames of a recording have in common at the same pixels, estimated and taken out on request.

Sensors add the same small error to every frame: each pixel, each column, each row its own. What moves over the pixels
averages out, and what the means m₁, m₂ of both halves of the recording have in common is the pattern. Of each of its
parts (columns, rows, pixels), in each octave of frequencies, the power is S = ⟨m₁m₂⟩, and the mean of both has the
noise N = ⟨(m₁ − m₂)²⟩/4. Its best estimate (Wiener) is

    S/(S + N) · (m₁ + m₂)/2,

and it is taken where the correlation of the halves is more than chance, which it never is in octaves of fewer than 16
frequencies: what is so coarse is light. A recording has to move by more than its
texture is long from one half to the other: of what does not, the texture itself is common to all frames.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.chance import normal_limit
from sixflow.errors import InputError

LEAST = 4
"""Frames: of fewer, the halves are no means."""


@dataclasses.dataclass(frozen=True)
class FixedPattern:
    """What is added to every frame at the same pixels.

    Attributes
    ----------
    grey : float32 array, shape (height, width)
        In the grey values of the frames; its mean is 0.
    """

    grey: NDArray[np.float32]

    @classmethod
    def of(cls, frames: Iterable[Any], count: int, shape: tuple[int, int]) -> FixedPattern:
        """Estimate it from all frames.

        Parameters
        ----------
        frames : iterable of array, shape (height, width)
            What is no array of this shape is passed over.
        count : int
            Number of frames, of which the first half makes one mean.
        shape : (int, int)

        Raises
        ------
        InputError
            If there are fewer than `LEAST`.
        """
        sums, numbers = np.zeros((2, *shape)), np.zeros(2)
        for place, frame in enumerate(frames):
            if not isinstance(frame, np.ndarray) or frame.shape != shape:
                continue
            half = int(2 * place >= count)
            values = frame.astype(np.float64)
            finite = np.isfinite(values)
            sums[half] += np.where(finite, values, values[finite].mean() if finite.any() else 0.0)
            numbers[half] += 1
        if numbers.min() < LEAST // 2:
            raise InputError(
                f"fixed_pattern=True: the recording has {int(numbers.sum())} frames that can be used; it needs {LEAST} "
                "at least, and better many, that move"
            )
        return cls(pattern_of_halves(*(sums / numbers[:, None, None])))

    @property
    def size(self) -> float:
        """Standard deviation, grey; 0 where there is none."""
        return float(self.grey.std())


def pattern_of_halves(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float32]:
    """What the mean frames of two halves of a recording have in common.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> columns, noise = rng.normal(0, 3, (1, 256)), rng.normal(0, 1, (2, 64, 256))
    >>> found = pattern_of_halves(columns + noise[0], columns + noise[1])
    >>> bool(np.corrcoef(found[0], columns[0])[0, 1] > 0.9)
    True
    """
    rest = [half - half.mean() for half in (first, second)]
    total = np.zeros(first.shape)
    for axes in ((0,), (1,), ()):
        parts = [one.mean(axis=axes, keepdims=True) if axes else one for one in rest]
        total = total + _in_common(*parts)
        rest = [one - part for one, part in zip(rest, parts, strict=True)]
    return (total - total.mean()).astype(np.float32)


def _in_common(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64]:
    """The common part of two images, octave by octave."""
    from scipy.fft import fft2, ifft2

    one, other = fft2(first), fft2(second)
    y, x = (np.fft.fftfreq(size) for size in first.shape)
    octave = np.floor(-np.log2(np.maximum(np.hypot(y[:, None], x), 1e-9))).astype(int).clip(0, 30)
    weight = np.zeros(first.shape)
    for band in np.unique(octave):
        inside = octave == band
        power = float((one[inside].conj() * other[inside]).real.sum())
        noise = float((np.abs(one[inside] - other[inside]) ** 2).sum()) / 4
        sizes = float(np.sqrt((np.abs(one[inside]) ** 2).sum() * (np.abs(other[inside]) ** 2).sum()))
        if power * np.sqrt(np.count_nonzero(inside)) > normal_limit() * sizes:
            weight[inside] = power / (power + noise)
    return np.asarray(ifft2(weight * (one + other) / 2).real)
