"""Frame: an image with its validity, and what is derived from both, made once when asked for.

A frame is never changed. Steps of `prepare` make new ones of it, or return it where they change nothing, so that what
was derived serves every pair that a frame belongs to.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.fir import downsample
from sixflow.engine.spline import spline_coefficients

NO_MASK = np.empty((0, 0), dtype=np.uint8)
"""Stands for a mask where every pixel is valid."""


@dataclasses.dataclass
class Frame:
    """Image and validity at full resolution, and what is derived from them.

    Attributes
    ----------
    image : float array, shape (height, width)
        Grey values less a constant; pixels that are not valid continue the valid ones (`nodata.continued`), or hold 0.
    valid : uint8 array of the same shape, or `NO_MASK`
        1 where the pixel counts.
    reach : int
        Pixels from one that does not count over which a filter has mixed in what is not there.
    floor : float, or float array of the same shape
        Standard deviation of the noise that a pixel has at least (`sixflow.frames.floor`). Halved frames, on which
        nothing is measured, state none.
    rounded : float
        Share of the floor that rounding left, and that is noise in the gradients; the rest is what a codec left out.
    """

    image: NDArray[Any]
    valid: NDArray[np.uint8]
    reach: int = 0
    floor: float | NDArray[Any] = 0.0
    rounded: float = 1.0
    _half: Frame | None = None
    _coefficients: dict[int, NDArray[Any]] = dataclasses.field(default_factory=dict)
    _derived: dict[tuple[str, float], Frame] = dataclasses.field(default_factory=dict)
    _spectra: dict[int, NDArray[np.float64]] = dataclasses.field(default_factory=dict)

    def within(self, valid: NDArray[np.uint8]) -> Frame:
        """Return the same image with another validity mask."""
        return self if valid is self.valid else Frame(self.image, valid, self.reach, self.floor, self.rounded)

    def showing(self, image: NDArray[Any]) -> Frame:
        """Return another image with the same validity mask."""
        return Frame(image, self.valid, self.reach, self.floor, self.rounded)

    def less(self, constant: float, degree: int) -> Frame:
        """Return the frame less a grey constant, which its spline of a degree is less too."""
        value = self.image.dtype.type(constant)
        frame = self.showing(self.image - value)
        frame._coefficients[degree] = self.coefficients(degree) - value
        return frame

    def derived(self, step: tuple[str, float], make: Callable[[], Frame]) -> Frame:
        """Return what a step with a number makes of this frame; made the first time."""
        if step not in self._derived:
            self._derived[step] = make()
        return self._derived[step]

    def spectrum(
        self, side: int, make: Callable[[NDArray[Any], NDArray[Any], int], NDArray[np.float64]]
    ) -> NDArray[np.float64]:
        """Return the spectrum of tiles of a side, px, of the pixels that count; made the first time."""
        if side not in self._spectra:
            self._spectra[side] = make(self.image, self.counted(), side)
        return self._spectra[side]

    def part(self, place: tuple[slice, slice]) -> Frame:
        """Return rows and columns of the frame; the frame itself where these are all."""
        if self.image[place].shape == self.image.shape:
            return self
        valid = np.ascontiguousarray(self.valid[place]) if self.valid.size else self.valid
        floor = self.floor if isinstance(self.floor, float) else np.ascontiguousarray(self.floor[place])
        image = np.ascontiguousarray(self.image[place])
        return Frame(image, valid, self.reach, floor, self.rounded)

    def level(self, halvings: int) -> Frame:
        """Return the frame halved so many times; pixel (j, i) of a halved frame lies on pixel (2j, 2i)."""
        if halvings == 0:
            return self
        if self._half is None:
            self._half = _halve(self)
        return self._half.level(halvings - 1)

    def coefficients(self, degree: int) -> NDArray[Any]:
        """Return the B-spline coefficients of the image."""
        if degree not in self._coefficients:
            self._coefficients[degree] = spline_coefficients(self.image, degree)
        return self._coefficients[degree]

    def counted(self) -> NDArray[np.uint8]:
        """Which pixels are compared: valid ones further than `reach` from any that is not, and than half of it from the
        rim, beyond which the image goes on as it was.
        """
        return self._away(self.reach)

    def interpolable(self) -> NDArray[np.uint8]:
        """Where the spline may be asked: two pixels further from any that is not valid."""
        return self._away(self.reach + 2)

    def _away(self, distance: int) -> NDArray[np.uint8]:
        """Valid pixels further than a distance from any that is not, and out of reach of the rim."""
        rim = (self.reach + 1) // 2
        if not rim and not (distance and self.valid.size):
            return self.valid
        away = eroded(self.valid, distance) if self.valid.size else np.ones(self.image.shape, np.uint8)
        for axis in (0, 1):
            lines = np.moveaxis(away, axis, 0)
            lines[:rim] = lines[lines.shape[0] - rim :] = 0
        return away

    @property
    def nbytes(self) -> int:
        """Bytes held, all levels and coefficients included."""
        own = self.image.nbytes + self.valid.nbytes + sum(c.nbytes for c in self._coefficients.values())
        own += sum(frame.nbytes for frame in self._derived.values())
        return own + (self._half.nbytes if self._half else 0)


def both_valid(*masks: NDArray[Any]) -> NDArray[np.uint8]:
    """Combine validity masks, any of which may be `NO_MASK`."""
    present = [m for m in masks if m.size]
    if not present:
        return NO_MASK
    return np.logical_and.reduce(present).astype(np.uint8)


def eroded(valid: NDArray[np.uint8], reach: int) -> NDArray[np.uint8]:
    """Pixels of a mask that are further than `reach` from any outside of it, along rows, columns and both."""
    out = valid.copy()
    for axis in (0, 1):
        before = out.copy()
        for shift in range(1, reach + 1):
            _and_shifted(out, before, shift, axis)
    return out


def _and_shifted(target: NDArray[Any], source: NDArray[Any], shift: int, axis: int) -> None:
    """Clear `target` where `source`, moved by ±shift along the axis, is 0."""
    target, source = (np.moveaxis(a, axis, 0) for a in (target, source))
    target[shift:] &= source[:-shift]
    target[:-shift] &= source[shift:]


def _halve(frame: Frame) -> Frame:
    if not frame.valid.size:
        return Frame(downsample(frame.image), NO_MASK)
    weight = downsample(frame.valid.astype(frame.image.dtype))
    image = downsample(frame.image * frame.valid) / np.maximum(weight, 1e-6)
    valid = (weight > 0.5).astype(np.uint8)
    return Frame(np.where(valid, image, 0).astype(frame.image.dtype), valid)
