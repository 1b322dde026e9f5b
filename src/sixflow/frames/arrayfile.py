"""Array files: files that hold arrays by name, of which one is the recording."""

from __future__ import annotations

import abc
import contextlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from sixflow.errors import FrameFileError, InputError, SixflowError
from sixflow.frames.axes import Axis, pick
from sixflow.frames.bad import BadFrame
from sixflow.frames.formats import FrameFile
from sixflow.frames.labelled import Labelled, LabelledFrames
from sixflow.frames.metadata import Metadata
from sixflow.frames.selection import Selection

Array: TypeAlias = NDArray[Any]


class NotARecordingError(InputError):
    """The file holds a field, not frames."""

    def __init__(self, path: Path) -> None:
        super().__init__(f"{path}: is a field that sixflow wrote, not a recording; give the frames")


class ArrayFile(FrameFile):
    """A file that holds an array, or several of which one is chosen.

    Subclasses tell how the file is opened and what is in it.
    """

    def __init__(self, path: Path, selection: Selection = Selection()) -> None:  # noqa: B008 - it is frozen
        super().__init__(path, selection)
        self._known: tuple[int, Array | None, Metadata, tuple[str, ...], tuple[str, ...]] | None = None

    @abc.abstractmethod
    def _arrays(self) -> contextlib.AbstractContextManager[Mapping[str, Any]]:
        """Open the file: its arrays by name, as `_label` takes them; closed afterwards."""

    @abc.abstractmethod
    def _label(self, array: Any, name: str) -> Labelled:
        """Give the axes of an array letters."""

    @contextlib.contextmanager
    def _opened(self) -> Iterator[LabelledFrames]:
        with contextlib.ExitStack() as resources:
            with self._guarded():
                arrays = resources.enter_context(self._arrays())
                name = self._chosen(arrays)
                label = f"{self.path}:/{name}" if len(arrays) > 1 else str(self.path)
                frames = LabelledFrames(self._label(arrays[name], label), self._inner(), label)
            yield frames

    def _inner(self) -> Selection:
        """The selection within the array; the position has chosen the array, unless there is but one."""
        return Selection(self.selection.channel, self.selection.z)

    def _chosen(self, arrays: Mapping[str, Any]) -> str:
        names = list(arrays)
        if not names:
            raise FrameFileError(f"{self.path}: holds no array of numbers with rows and columns")
        wanted = self.selection.position
        if wanted is None and len(names) == 1:
            return names[0]
        if isinstance(wanted, str):
            wanted = wanted.strip("/")
        if wanted is not None:
            return names[pick(wanted, Axis("P", range(len(names)), tuple(names)), "position", str(self.path))]
        raise InputError(
            f"{self.path} holds {len(names)} arrays: {_listed(names)}; name one, as in "
            f"'{self.path.name}:/{names[0]}', or by position="
        )

    @contextlib.contextmanager
    def _guarded(self) -> Iterator[None]:
        """Tell whatever a reader raises over a damaged file as one error."""
        try:
            yield
        except SixflowError:
            raise
        except Exception as error:
            reason = " ".join(str(error).split())[:200] or type(error).__name__
            raise FrameFileError(
                f"{self.path}: cannot be read ({reason}); copy or export it again"
            ) from error

    @property
    def _summary(self) -> tuple[int, Array | None, Metadata, tuple[str, ...], tuple[str, ...]]:
        if self._known is None:
            with self._opened() as frames, self._guarded():
                applied = ["position"]
                applied += ["channel"] if "C" in frames.array.codes else []
                applied += ["z"] if "Z" in frames.array.codes else []
                times = None if frames.times is None else np.asarray(frames.times, dtype=float)
                self._known = frames.count, times, frames.array.metadata, frames.notes, tuple(applied)
        return self._known

    @property
    def count(self) -> int:
        """Number of frames."""
        return self._summary[0]

    @property
    def times(self) -> Array | None:
        """Time of each frame, s, where the file has a coordinate of it."""
        return self._summary[1]

    @property
    def metadata(self) -> Metadata:
        """What coordinates and attributes say."""
        return self._summary[2]

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on the axes."""
        return self._summary[3]

    @property
    def applied(self) -> tuple[str, ...]:
        """Which of channel, z and position the file has something to choose from for."""
        return self._summary[4]

    def read(self, start: int = 0) -> Iterator[Array | BadFrame]:
        """Yield the frames from number `start` on.

        Raises
        ------
        FrameFileError
            If the file cannot be opened.
        InputError
            If it holds several arrays, channels or slices of which none was chosen.
        """
        return self.frames(range(start, self.count))

    def frames(self, numbers: range) -> Iterator[Array | BadFrame]:
        """Yield the frames of these numbers."""
        with self._opened() as frames:
            for number in numbers:
                name = f"{self.path}[{number}]" if frames.count > 1 else str(self.path)
                try:
                    with self._guarded():
                        (frame,) = frames.frames(range(number, number + 1))
                except FrameFileError as error:
                    yield BadFrame(name, error)
                else:
                    yield frame


def is_frames(shape: Sequence[int], dtype: Any) -> bool:
    """Tell whether an array may be a recording: numbers, with at least two axes longer than 1."""
    return getattr(dtype, "kind", "O") in "biuf" and sum(size > 1 for size in shape) >= 2


def _listed(names: Sequence[str]) -> str:
    return ", ".join(map(repr, names[:8])) + (", …" if len(names) > 8 else "")
