"""Masks: where to measure, in which frame, and which pixels move together.

A mask of bool is cut into its connected parts (neighbours along rows, columns and diagonals): what a gap separates may
move on its own, and is measured apart, so that no window looks across. A mask of whole numbers names the bodies: 0 is
not measured, equal numbers move together wherever they lie, and different numbers may touch.

Where two bodies come close, the interpolation at the edge of one would reach into the other: pixels with another body
within `REACH` px are not counted, though grid points on them are measured.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Iterator
from typing import Any, TypeAlias, cast

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from sixflow.errors import InputError

MaskLike: TypeAlias = ArrayLike | Iterable[ArrayLike | None] | Callable[[int], ArrayLike | None]
"""One mask for all, or one for each frame: an array (n, height, width), an iterable, or a function of the number."""

REACH = 2
_ALL_AROUND = np.ones((3, 3), np.bool_)


@dataclasses.dataclass(frozen=True, eq=False)
class Bodies:
    """The bodies of one frame.

    Attributes
    ----------
    labels : int32 array, shape (height, width)
        Number of the body of each pixel; 0 where nothing is measured.
    named : bool
        Whether the numbers were given, and mean the same bodies in every frame.
    clear : bool array, shape (height, width), or None
        Where no other body is within `REACH` px; None where there is one body.
    boxes : dict of (slice, slice) by number
        Rows and columns of each body.
    content : bytes
        For digests.
    """

    labels: NDArray[np.int32]
    named: bool
    clear: NDArray[np.bool_] | None
    boxes: dict[int, tuple[slice, slice]]
    content: bytes

    @classmethod
    def of(cls, mask: ArrayLike, name: str = "mask") -> Bodies:
        """Find the bodies of a mask.

        Raises
        ------
        InputError
            If it is no array (height, width) of bool or whole numbers, or marks nothing.

        Examples
        --------
        >>> sorted(Bodies.of(np.array([[True, False, True]])).boxes)
        [1, 2]
        >>> sorted(Bodies.of(np.array([[7, 0, 7]])).boxes)
        [7]
        """
        array = np.asarray(mask)
        if array.dtype.kind not in "biu" or array.ndim != 2:
            raise InputError(
                f"{name} has dtype {array.dtype} and shape {array.shape}: must be a (height, width) array of bool, "
                "True where to measure, or of whole numbers, one for each body; one for each frame where bodies move"
            )
        if not array.any():
            raise InputError(
                f"{name} is False everywhere: nothing is left to measure; True marks the region of interest"
            )
        if array.dtype.kind == "b":
            labels = scipy.ndimage.label(array, _ALL_AROUND)[0].astype(np.int32)
        else:
            if array.min() < 0 or array.max() > np.iinfo(np.int32).max:
                raise InputError(
                    f"{name} has numbers from {array.min()} to {array.max()}: bodies are numbered from 1, "
                    "0 is not measured"
                )
            labels = array.astype(np.int32)
        numbers = np.unique(labels)
        numbers = numbers[numbers > 0]
        compact = np.where(labels > 0, np.searchsorted(numbers, labels) + 1, 0)
        boxes = dict(zip(numbers.tolist(), scipy.ndimage.find_objects(compact), strict=True))
        clear = _clear(labels) if len(boxes) > 1 else None
        content = labels if len(boxes) > 1 else (labels != 0).astype(np.uint8)
        return cls(labels, array.dtype.kind != "b", clear, boxes, content.tobytes())

    def of_number(self, number: int | None, part: tuple[slice, slice]) -> NDArray[np.uint8]:
        """Where a body is in a part of the frame; None: any of them."""
        labels = self.labels[part]
        return (labels != 0 if number is None else labels == number).astype(np.uint8)


def _clear(labels: NDArray[np.int32]) -> NDArray[np.bool_]:
    side = 2 * REACH + 1
    highest = scipy.ndimage.maximum_filter(labels, side, mode="nearest")
    nothing = np.iinfo(np.int32).max
    lowest = scipy.ndimage.minimum_filter(np.where(labels == 0, nothing, labels), side, mode="nearest")
    clear: NDArray[np.bool_] = (highest == labels) & (lowest == labels)
    return clear


class Masks:
    """The masks of a recording, handed out frame by frame.

    Parameters
    ----------
    mask : None, array, iterable or callable
        See `MaskLike`.

    Raises
    ------
    InputError
        If a mask cannot be used; later, if there are fewer than frames.
    """

    def __init__(self, mask: MaskLike | None) -> None:
        self._one: Bodies | None = None
        self._ask: Callable[[int], Any] | None = None
        self._each: Iterator[Any] | None = None
        self._taken = 0
        self._now: Bodies | None = None
        if mask is None:
            return
        if callable(mask):
            self._ask = mask
        elif _is_series(mask):
            self._each = iter(cast(Iterable[Any], mask))
        else:
            self._one = Bodies.of(cast(ArrayLike, mask))

    @property
    def moving(self) -> bool:
        """Whether there is one for each frame."""
        return self._ask is not None or self._each is not None

    def at(self, number: int) -> Bodies | None:
        """The bodies of a frame, or None where everything counts; frames are asked for in order."""
        name = f"mask of frame {number}"
        if self._ask is not None:
            mask = self._ask(number)
        elif self._each is not None:
            while self._taken <= number:
                mask = next(self._each, self)
                if mask is self:
                    raise InputError(
                        f"mask has {self._taken} masks, but there is a frame {self._taken}: "
                        "give one for each frame, or one for all"
                    )
                self._taken += 1
        else:
            return self._one
        return None if mask is None else Bodies.of(mask, name)


def _is_series(mask: Any) -> bool:
    """Tell one mask for each frame from one for all."""
    if isinstance(mask, str | bytes) or not isinstance(mask, Iterable):
        return False
    if hasattr(mask, "__array__"):
        return np.asarray(mask).ndim == 3
    if isinstance(mask, list | tuple):
        return any(one is None or np.ndim(one) == 2 for one in mask)
    return True
