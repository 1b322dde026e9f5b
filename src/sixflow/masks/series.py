"""Series: the masks of a recording, one for all frames or one for each."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterable, Iterator, Sized
from pathlib import Path
from typing import Any, TypeAlias, cast

import numpy as np
from numpy.typing import ArrayLike

from sixflow.errors import InputError
from sixflow.masks.bodies import Bodies
from sixflow.masks.files import MaskFile, open_mask

PathLike: TypeAlias = str | os.PathLike[str]
MaskLike: TypeAlias = (
    ArrayLike
    | PathLike
    | MaskFile
    | Iterable[ArrayLike | PathLike | None]
    | Callable[[int], ArrayLike | PathLike | None]
)
"""One mask for all, or one for each frame: an array (n, height, width), an iterable, or a function of the number. Each
is an array, or the path of a file (`read_mask`).
"""


class Outlined:
    """A mask of regions that were drawn without a frame: it waits for the shape of one."""

    def __init__(self, file: MaskFile) -> None:
        self.file = file
        self._bodies: Bodies | None = None

    def of_shape(self, shape: tuple[int, int]) -> Bodies:
        """Return the bodies in frames of a shape."""
        if self._bodies is None or self._bodies.labels.shape != shape:
            self._bodies = Bodies.of(self.file.drawn(shape), self.file.name)
        return self._bodies


AnyBodies: TypeAlias = Bodies | Outlined | None
"""The bodies of a frame; those that wait for its shape; or None where everything counts."""


class Masks:
    """The masks of a recording, handed out frame by frame.

    Parameters
    ----------
    mask : None, array, path, MaskFile, iterable or callable
        See `MaskLike`.

    Attributes
    ----------
    notes : tuple of str
        What should be known of how its file was read.
    said : str
        What the mask is, and the digest of what is known of it beforehand; empty without one.
    count : int or None
        Number of masks, where there is one for each frame and the number is known.

    Raises
    ------
    InputError, FrameFileError
        If a mask cannot be used; later, if there are fewer than frames.
    """

    def __init__(self, mask: MaskLike | None) -> None:
        self._one: AnyBodies = None
        self._ask: Callable[[int], Any] | None = None
        self._each: Iterator[Any] | None = None
        self._taken = 0
        self.notes: tuple[str, ...] = ()
        self.name, self.said = "mask", ""
        self.count: int | None = None
        self._shape = ""
        if mask is None:
            return
        if isinstance(mask, str | os.PathLike):
            mask = open_mask(Path(mask))
        if isinstance(mask, MaskFile):
            self._take_file(mask)
        elif callable(mask):
            self._ask, self.said = mask, "a function of the frame's number"
        elif _is_series(mask):
            self._take_series(cast(Iterable[Any], mask))
        else:
            self._one = Bodies.of(cast(ArrayLike, mask))
            self.said = f"array, sha256 {hashlib.sha256(self._one.content).hexdigest()[:16]}"

    def _take_file(self, file: MaskFile) -> None:
        self.notes, self.name, self.count = file.notes, file.name, file.count
        self.said = f"{file.name.removeprefix('mask ')}, sha256 {file.digest}"
        if file.values is None:
            self._one = Outlined(file)
        elif file.count is not None:
            self._each = iter(file.values)
        else:
            self._one = Bodies.of(file.values, file.name, file.remark)

    def _take_series(self, masks: Iterable[Any]) -> None:
        self._each, self.said = iter(masks), "one for each frame"
        self.count = len(masks) if isinstance(masks, Sized) else None
        if isinstance(masks, np.ndarray):
            self._shape = f" has shape {masks.shape}"
            held = np.ascontiguousarray(masks)
            self.said += f", sha256 {hashlib.sha256(held.tobytes()).hexdigest()[:16]}"

    @property
    def moving(self) -> bool:
        """Whether there is one for each frame."""
        return self._ask is not None or self._each is not None

    def require(self, frames: int) -> None:
        """Check that there is one mask for all of so many frames, or one for each.

        Raises
        ------
        InputError
            If there are more or fewer.
        """
        if self.count is not None and self.count != frames:
            raise InputError(
                f"{self.name}{self._shape}: {self.count} masks for {frames} frames; give one for each frame, shape "
                f"({frames}, height, width), or one for all, shape (height, width)"
            )

    def at(self, number: int) -> AnyBodies:
        """The bodies of a frame, or None where everything counts; frames are asked for in order."""
        name = f"{self.name} of frame {number}" if self.name == "mask" else f"{self.name}[{number}]"
        if self._ask is not None:
            mask = self._ask(number)
        elif self._each is not None:
            while self._taken <= number:
                mask = next(self._each, self)
                if mask is self:
                    raise InputError(
                        f"{self.name} has {self._taken} masks, but there is a frame {self._taken}: "
                        "give one for each frame, or one for all"
                    )
                self._taken += 1
        else:
            return self._one
        if isinstance(mask, str | os.PathLike):
            return self._from_path(Path(mask))
        return None if mask is None else Bodies.of(mask, name)

    def _from_path(self, path: Path) -> Bodies | Outlined:
        file = open_mask(path)
        if file.count is not None:
            raise InputError(
                f"{file.name}: holds {file.count} masks; give one file for each frame, or the stack alone"
            )
        self.notes = tuple(dict.fromkeys((*self.notes, *file.notes)))
        if file.values is None:
            return Outlined(file)
        return Bodies.of(file.values, file.name, file.remark)


def _is_series(mask: Any) -> bool:
    """Tell one mask for each frame from one for all."""
    if not isinstance(mask, Iterable):
        return False
    if hasattr(mask, "__array__"):
        return np.asarray(mask).ndim == 3
    if isinstance(mask, list | tuple):
        return any(one is None or isinstance(one, str | os.PathLike) or np.ndim(one) == 2 for one in mask)
    return True
