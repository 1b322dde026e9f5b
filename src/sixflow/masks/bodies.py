"""Bodies: which pixels of a frame are measured, and which of them move together.

A mask of bool is cut into its connected parts (neighbours along rows, columns and diagonals): what a gap separates may
move on its own, and is measured apart, so that no window looks across. A mask of whole numbers names the bodies: 0 is
not measured, equal numbers move together wherever they lie, and different numbers may touch.

Where two bodies come close, the interpolation at the edge of one would reach into the other: pixels with another body
within `REACH` px are not counted, though grid points on them are measured.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from sixflow.errors import InputError

REACH = 3
"""px: half the taps of a quintic spline, which a pixel of the moved frame is interpolated from."""
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
    name : str
        Of the mask, for messages.
    remark : str
        Which values the mask has, if that is known and none is outside.
    whole : Bodies or None
        Without the region that the settings leave of it; None where they leave all.
    """

    labels: NDArray[np.int32]
    named: bool
    clear: NDArray[np.bool_] | None
    boxes: dict[int, tuple[slice, slice]]
    content: bytes
    name: str = "mask"
    remark: str = ""
    whole: Bodies | None = None

    @classmethod
    def of(cls, mask: ArrayLike, name: str = "mask", remark: str = "") -> Bodies:
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
        array = mask.filled(0) if isinstance(mask, np.ma.MaskedArray) else np.asarray(mask)
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
        return cls(labels, array.dtype.kind != "b", clear, boxes, content.tobytes(), name, remark)

    def of_shape(self, shape: tuple[int, int]) -> Bodies:
        """Return the bodies of frames of a shape.

        Raises
        ------
        InputError
            If they are of another.
        """
        if self.labels.shape != shape:
            raise InputError(
                f"{self.name} has shape {self.labels.shape}, the frames {shape}: the mask must have the frames' shape"
            )
        return self

    def within(self, region: NDArray[np.bool_]) -> Bodies:
        """Return the bodies in a region of the settings.

        Raises
        ------
        InputError
            If none is.
        """
        left = self.labels * region
        if not left.any():
            raise InputError(
                f"{self.name} and the region of roi, polygons and holes have no pixel in common: "
                "nothing is left to measure"
            )
        inside = Bodies.of(left if self.named else left != 0, self.name)
        return dataclasses.replace(inside, whole=self)

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
