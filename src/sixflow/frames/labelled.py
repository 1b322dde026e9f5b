"""Labelled: arrays whose axes have names, read frame by frame.

Axes are named by letters: T time, C channel, Z slice, Y row, X column, S sample of a colour; what has another name
keeps it. An array without names has them from its shape.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from sixflow.errors import InputError
from sixflow.frames.axes import Axis, Choice, choose
from sixflow.frames.limits import check_size
from sixflow.frames.metadata import Metadata
from sixflow.frames.selection import Selection

Array: TypeAlias = NDArray[Any]

_LETTERS = {
    **dict.fromkeys(("t", "time", "times", "frame", "frames"), "T"),
    **dict.fromkeys(("c", "channel", "channels", "band", "bands", "wavelength"), "C"),
    **dict.fromkeys(("z", "slice", "slices", "depth", "level", "plane"), "Z"),
    **dict.fromkeys(("y", "row", "rows", "height", "lat", "latitude"), "Y"),
    **dict.fromkeys(("x", "col", "cols", "column", "columns", "width", "lon", "longitude"), "X"),
    **dict.fromkeys(("s", "sample", "samples", "rgb", "rgba", "colour", "color"), "S"),
    **dict.fromkeys(("p", "position", "positions", "scene", "site", "fov", "view"), "P"),
}

_BLOCK = 2**28
"""Bytes of a block of frames that is read at once because it is stored so."""


@dataclasses.dataclass
class Labelled:
    """An array, or anything indexed like one, and what its axes are.

    Attributes
    ----------
    data : array-like
        Has `shape` and `dtype`; is indexed by whole numbers and slices.
    codes : tuple of str
        One for each axis.
    names : mapping
        Names along an axis, by its code.
    times : array or None
        Along T, s.
    metadata : Metadata
    notes : tuple of str
    chunks : sequence, optional
        Sizes of chunks along each axis: one number, or all.
    """

    data: Any
    codes: tuple[str, ...]
    names: Mapping[str, tuple[str, ...]] = dataclasses.field(default_factory=dict)
    times: Array | None = None
    metadata: Metadata = dataclasses.field(default_factory=Metadata)
    notes: tuple[str, ...] = ()
    chunks: Sequence[Any] | None = None

    def choose(self, selection: Selection, name: str) -> Choice:
        """Choose channel, slice and position, and the axis of the frames; as `axes.choose`."""
        axes = [
            Axis(code, range(size), self.names.get(code, ()))
            for code, size in zip(self.codes, self.data.shape, strict=True)
            if code not in "YXS"
        ]
        return choose(axes, selection, name)


def codes_of_names(dims: Sequence[str], shape: Sequence[int], name: str) -> tuple[str, ...]:
    """Return the codes of axes that have names.

    Names that say nothing (``dim_0``) are counted from the end: rows and columns are the last two.

    Raises InputError if only one of rows and columns is named, or two axes have one meaning.

    Examples
    --------
    >>> codes_of_names(("time", "x", "y"), (5, 64, 48), "a")
    ('T', 'X', 'Y')
    """
    codes = [_LETTERS.get(dim.lower(), dim) for dim in dims]
    known = {"Y", "X"} & set(codes)
    if not known and not any(code in "TCZSP" for code in codes):
        return codes_of_shape(shape, name)
    if not known and len(codes) >= 2:
        free = [k for k, code in enumerate(codes) if len(code) > 1]
        for k, code in zip(free[-2:], "YX" if len(free) > 1 else "", strict=False):
            codes[k] = code
        known = {"Y", "X"} & set(codes)
    repeated = {code for code in codes if codes.count(code) > 1}
    if known != {"Y", "X"} or repeated:
        raise InputError(
            f"{name}: of the dimensions {tuple(dims)} rows and columns are not clear; name them 'y' and 'x'"
        )
    return tuple(codes)


def codes_of_shape(shape: Sequence[int], name: str) -> tuple[str, ...]:
    """Return the codes of axes without names: (h, w), (h, w, c), (n, h, w) or (n, h, w, c), c at most 4.

    Raises InputError if the shape is none of these.
    """
    if len(shape) == 2:
        return "Y", "X"
    if len(shape) == 3:
        return ("Y", "X", "S") if shape[2] <= 4 < shape[0] else ("T", "Y", "X")
    if len(shape) == 4:
        return "T", "Y", "X", "S"
    raise InputError(
        f"{name}: an array of shape {tuple(shape)} is no recording; give (n, h, w), (n, h, w, c) for colour, or name "
        "the axes as the dims of an xarray.DataArray"
    )


class LabelledFrames:
    """The frames of a labelled array; blocks that are stored together are read together, and once.

    Parameters
    ----------
    array : Labelled
    selection : Selection
    name : str
        Of the recording, for messages.
    """

    def __init__(self, array: Labelled, selection: Selection, name: str) -> None:
        self.array, self.name = array, name
        self.choice = array.choose(selection, name)
        self._at = {code: k for k, code in enumerate(array.codes)}
        shape = dict(zip(array.codes, array.data.shape, strict=True))
        along = self.choice.along
        self.count: int = shape[along] if along else 1
        check_size(shape["X"], shape["Y"], shape.get("S", 1), np.dtype(array.data.dtype).itemsize, name)
        itemsize = np.dtype(array.data.dtype).itemsize
        self._frame_bytes = max(1, shape["X"] * shape["Y"] * shape.get("S", 1) * itemsize)
        self._edges = self._block_edges()
        self._block: tuple[int, int, Array] | None = None

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on the array, and on how its axes were read."""
        return (*self.array.notes, *self.choice.notes)

    @property
    def times(self) -> Array | None:
        """Time of each frame, s."""
        return self.array.times if self.choice.along == "T" else None

    def _block_edges(self) -> Array | None:
        """Where blocks of frames begin that are stored together; None where each is by itself."""
        along, chunks = self.choice.along, self.array.chunks
        if along is None or chunks is None:
            return None
        sizes = chunks[self._at[along]]
        if isinstance(sizes, int | np.integer):
            if not 1 < sizes <= max(1, _BLOCK // self._frame_bytes):
                return None
            return np.minimum(np.arange(0, self.count + sizes, sizes), self.count)
        return np.concatenate([[0], np.cumsum(sizes)])

    def frames(self, numbers: range) -> Iterator[Array]:
        """Yield the frames of these numbers, shape (h, w) or (h, w, c)."""
        for number in numbers:
            if number >= self.count:
                return
            yield self._frame(number)

    def _frame(self, number: int) -> Array:
        if self._edges is None or self.choice.along is None:
            return self._ordered(self._taken(number))
        if self._block is None or not self._block[0] <= number < self._block[1]:
            k = int(np.searchsorted(self._edges, number, side="right")) - 1
            begin, end = int(self._edges[k]), int(self._edges[k + 1])
            self._block = begin, end, self._taken(slice(begin, end))
        begin, _, block = self._block
        place = [code for code in self.array.codes if code not in self.choice.fixed].index(self.choice.along)
        return self._ordered(block.take(number - begin, axis=place))

    def _taken(self, along: int | slice) -> Array:
        index = tuple(
            along if code == self.choice.along else self.choice.fixed.get(code, slice(None))
            for code in self.array.codes
        )
        return np.asanyarray(self.array.data[index])

    def _ordered(self, frame: Array) -> Array:
        """Put rows before columns, and colours last."""
        codes = [code for code in self.array.codes if code in "YXS"]
        return frame.transpose([codes.index(code) for code in "YXS" if code in codes])
