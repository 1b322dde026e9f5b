"""Normalise: frames of any kind become finite floating-point images with a validity mask and a pyramid.

Pixels without a value (NaN, ±Inf) are masked: they get zero weight, not a guessed value. A constant,
the mean of the reference frame, is subtracted from both frames, so that single precision is spent on
contrast. With `lighting="local"` the local mean and standard deviation of each frame, under the
window's Gaussian, are divided out.
"""

from __future__ import annotations

import dataclasses
import math
import os
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sixflow.engine.compiler import kernel
from sixflow.engine.fir import downsample, filter_separable
from sixflow.engine.lowpass import lowpass_noise, lowpass_reach, smoothed
from sixflow.engine.spline import spline_coefficients
from sixflow.engine.threads import over_strips
from sixflow.engine.window import CUT
from sixflow.errors import BadFrameError, InputError
from sixflow.frames.masked import without_mask

_STRIP = 64
CONTINUED = 8  # px: over this distance the coefficients of a quintic spline forget all but 1e-3
_COVERED = 1e-3  # share of the Gaussian that has to lie in a region for its light to be known

_SMALLEST = 1e-305
LARGEST = 1e12
"""Largest distance of a grey value from the first frame's mean, in scaled grey: its square fits single precision."""

NO_MASK = np.empty((0, 0), dtype=np.uint8)
"""Stands for a mask where every pixel is valid."""


def check_frame(frame: ArrayLike, name: str) -> NDArray[Any]:
    """Return a frame as a 2-D real array; what is masked in a `numpy.ma` array is NaN.

    Raises
    ------
    InputError
        If it is not a 2-D array of real numbers, is empty, has no finite pixel or no contrast.
    """
    if isinstance(frame, str | bytes | os.PathLike):
        raise InputError(f"{name} is {frame!r}: give its pixels; sixflow.open_frames reads files")
    try:
        array = without_mask(frame)
    except (ValueError, TypeError) as error:
        raise InputError(f"{name}: a {type(frame).__name__} is no array of grey values ({error})") from error
    if array.dtype.kind == "f" and array.dtype.itemsize > 8:
        with np.errstate(over="ignore", under="ignore", invalid="ignore"):
            array = array.astype(np.float64)
    if array.dtype.kind not in "biuf":
        raise InputError(
            f"{name} has dtype {array.dtype}: frames are real grey values; take the real part, or luminance of colours"
        )
    if array.ndim != 2:
        raise InputError(
            f"{name} has shape {array.shape}: a frame is (height, width); reduce colours to luminance first"
        )
    if array.size == 0:
        raise InputError(f"{name} has shape {array.shape}: it holds no pixels")
    return array


def require_contrast(frame: NDArray[Any], name: str) -> None:
    """Require a frame to have texture.

    Raises
    ------
    BadFrameError
        If it has no finite pixel, or is constant.
    """
    low, high = frame.min(), frame.max()
    if not (np.isfinite(low) and np.isfinite(high)):
        finite = frame[np.isfinite(frame)]
        if not finite.size:
            raise BadFrameError(
                f"{name} has no finite pixel: all {frame.size} are NaN or infinite; check how it was read"
            )
        low, high = finite.min(), finite.max()
    if low == high:
        raise BadFrameError(
            f"{name} is constant ({low}): there is no texture to follow; check the frame or its exposure"
        )


def range_of(first: NDArray[Any], name: str) -> tuple[float, float]:
    """Return the grey constant that is taken from the frames of a recording, and the power of two that scales them.

    Squares of squares of what is left must fit single precision.

    Parameters
    ----------
    first : array, shape (height, width)
        The first frame, or a sample of it.
    name : str
        For messages.

    Raises
    ------
    InputError
        If the values are so small that their differences have no digits.
    """
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        sample = first.astype(np.float64)
        finite = sample[np.isfinite(sample)]
        peak = float(np.abs(finite).max(initial=0.0))
        if not peak:
            return 0.0, 1.0
        finite = finite / peak  # whose sum is finite too
        constant = float(finite.mean())
        spread = float(np.abs(finite - constant).mean()) * peak
    if spread == 0 or 1e-3 < spread < 1e5:
        return constant * peak, 1.0
    if spread < _SMALLEST:
        raise InputError(
            f"{name} has values that differ by {spread:.1g}, which is too little to compute with: multiply all frames"
        )
    return constant * peak, 2.0 ** -round(math.log2(spread) - 5)


def require_range(image: NDArray[Any], scale: float, name: str) -> None:
    """Refuse a frame with values so far from those of the first that both cannot be compared.

    Raises
    ------
    BadFrameError
        If there are values that are more than `LARGEST` after scaling.
    """
    largest = max(-float(image.min()), float(image.max()))
    if largest > LARGEST:
        raise BadFrameError(
            f"{name} has values that differ by {largest / scale:.1g} from the first frame's, by orders more than "
            "these among themselves: give all frames in one unit, and NaN to pixels without a value"
        )


@dataclasses.dataclass
class Frame:
    """A normalised frame: image and validity at full resolution, and what is derived from them, made
    once when asked for.

    Attributes
    ----------
    image : float array, shape (height, width)
        Grey values less a constant; pixels without a value hold that constant.
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
    _filtered: dict[float, Frame] = dataclasses.field(default_factory=dict)

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

    def lowpassed(self, lowpass: float) -> Frame:
        """Return the frame after a Gaussian of `lowpass` px; the frame itself for 0."""
        if not lowpass:
            return self
        if lowpass not in self._filtered:
            reach = self.reach + lowpass_reach(lowpass)
            floor = self.floor * math.sqrt(lowpass_noise(lowpass))
            image = smoothed(self.image, lowpass)
            self._filtered[lowpass] = Frame(image, self.valid, reach, floor, self.rounded)
        return self._filtered[lowpass]

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
        away = _eroded(self.valid, distance) if self.valid.size else np.ones(self.image.shape, np.uint8)
        for axis in (0, 1):
            lines = np.moveaxis(away, axis, 0)
            lines[:rim] = lines[lines.shape[0] - rim :] = 0
        return away

    @property
    def nbytes(self) -> int:
        """Bytes held, all levels and coefficients included."""
        own = self.image.nbytes + self.valid.nbytes + sum(c.nbytes for c in self._coefficients.values())
        own += sum(frame.nbytes for frame in self._filtered.values())
        return own + (self._half.nbytes if self._half else 0)


def _eroded(valid: NDArray[np.uint8], reach: int) -> NDArray[np.uint8]:
    """Pixels of a mask that are further than `reach` from any outside of it, along rows, columns and both."""
    eroded = valid.copy()
    for axis in (0, 1):
        before = eroded.copy()
        for shift in range(1, reach + 1):
            _and_shifted(eroded, before, shift, axis)
    return eroded


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


def to_image(
    frame: NDArray[Any], constant: float, dtype: type, scale: float = 1.0
) -> tuple[NDArray[Any], NDArray[np.uint8], int]:
    """Return (image less the constant, times the scale; validity; number of pixels without a value)."""
    if scale == 1:
        image: NDArray[Any] = np.empty(frame.shape, dtype)

        def subtract(a: int, b: int) -> None:
            with np.errstate(over="ignore", invalid="ignore"):  # what overflows has no value
                np.subtract(frame[a:b], constant, out=image[a:b], dtype=dtype)

        over_strips(subtract, len(frame), _STRIP)
    else:
        with np.errstate(over="ignore", under="ignore", invalid="ignore"):  # as above
            scaled = np.multiply(frame, scale, dtype=np.float64, order="C")
            image = np.subtract(scaled, constant * scale).astype(dtype)
    if frame.dtype.kind != "f":
        return image, NO_MASK, 0
    with np.errstate(over="ignore", invalid="ignore"):
        if np.isfinite(np.dot(image.ravel(), image.ravel())):
            return image, NO_MASK, 0
    finite = np.isfinite(image)
    missing = int(finite.size - np.count_nonzero(finite))
    if not missing:
        return image, NO_MASK, 0
    valid = finite.astype(np.uint8)
    image[~finite] = 0
    return continued(image, valid), valid, missing


@kernel
def _continue(image: NDArray[Any], known: NDArray[Any], out: NDArray[Any], reached: NDArray[Any]) -> None:
    """Give pixels within `CONTINUED` px of a known one of their row or column its reflection about the nearest."""
    height, width = image.shape
    for y in range(height):
        for x in range(width):
            if known[y, x]:
                continue
            for distance in range(1, CONTINUED + 1):
                total, count = 0.0, 0
                for dy, dx in ((0, -1), (0, 1), (-1, 0), (1, 0)):
                    b, a = y + distance * dy, x + distance * dx
                    if b < 0 or a < 0 or b >= height or a >= width or not known[b, a]:
                        continue
                    d, c = b + distance * dy, a + distance * dx
                    inside = d >= 0 and c >= 0 and d < height and c < width
                    total += image[b, a]
                    if inside and known[d, c]:
                        total += image[b, a] - image[d, c]
                    count += 1
                if count > 0:
                    out[y, x] = total / count
                    reached[y, x] = 1
                    break


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
        _continue(source, known, out, reached)
        known = reached
    return out


def both_valid(*masks: NDArray[Any]) -> NDArray[np.uint8]:
    """Combine validity masks, any of which may be `NO_MASK`."""
    present = [m for m in masks if m.size]
    if not present:
        return NO_MASK
    return np.logical_and.reduce(present).astype(np.uint8)


def flatten_lighting(
    image: NDArray[Any], valid: NDArray[np.uint8], sigma: float, region: NDArray[Any] | None = None
) -> NDArray[Any]:
    """Divide out the local mean and standard deviation under a Gaussian of `sigma` px (local normalisation).

    Where the frame has no local contrast at all the result is 0.

    Parameters
    ----------
    image : float array, shape (height, width)
    valid : uint8 array of the same shape, or `NO_MASK`
    sigma : float
    region : array of the same shape, 0 to 1, optional
        Weight of each pixel in mean and standard deviation. What is outside the region of interest must not show in
        the light of what is inside. Pixels near the region are normalised as well.
    """
    centred, contrast = _local_light(image, valid, sigma, region)
    return (centred / contrast).astype(image.dtype)


def flattened(frame: Frame, sigma: float, region: NDArray[Any] | None = None) -> Frame:
    """Return a frame with its local light divided out, as `flatten_lighting`; its noise is divided with it."""
    centred, contrast = _local_light(frame.image, frame.valid, sigma, region)
    floor: float | NDArray[Any] = 0.0
    if np.any(frame.floor):
        floor = np.asarray(frame.floor / contrast, frame.image.dtype)
    image = (centred / contrast).astype(frame.image.dtype)
    return Frame(image, frame.valid, frame.reach, floor, frame.rounded)


def _local_light(
    image: NDArray[Any], valid: NDArray[np.uint8], sigma: float, region: NDArray[Any] | None
) -> tuple[NDArray[Any], NDArray[Any]]:
    """The image less its local mean, and its local contrast, infinite where there is none."""
    reach = int(np.ceil(CUT * sigma))
    half = np.exp(-((np.arange(reach + 1) / sigma) ** 2) / 2)
    half /= half[0] + 2 * half[1:].sum()
    counted = valid.astype(image.dtype) if valid.size else np.ones_like(image)
    weighed = counted if region is None else counted * region.astype(image.dtype)
    covered = filter_separable(weighed, half)
    weight = np.maximum(covered, 1e-6)
    centred = image - filter_separable(image * weighed, half) / weight
    spread = np.sqrt(np.maximum(filter_separable(centred * centred * weighed, half) / weight, 0))
    if region is not None:
        spread = np.where(covered > _COVERED, spread, 0)
    rounding = np.finfo(image.dtype).eps * float(np.abs(image).max(initial=0.0))
    least = max(1e-3 * float(spread.max(initial=0.0)), 64 * rounding)
    return centred, np.where(counted * (spread > least), np.maximum(spread, least or 1), np.inf)
