"""Opening: what a user may give as frames, and the source that each becomes."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any, TypeAlias

from sixflow.errors import FrameFileError, InputError
from sixflow.frames.arrayfile import NotARecordingError
from sixflow.frames.arrays import ArraySource, ListSource, StreamSource
from sixflow.frames.axes import refuse_choices
from sixflow.frames.dataarray import is_data_array, labelled
from sixflow.frames.files import FileSource
from sixflow.frames.formats import find_format
from sixflow.frames.part import PartSource
from sixflow.frames.paths import find_files
from sixflow.frames.selection import Selection
from sixflow.frames.source import FrameSource

PathLike: TypeAlias = str | os.PathLike[str]


def open_frames(
    source: PathLike | Iterable[Any] | FrameSource,
    *,
    channel: int | str | None = None,
    z: int | str | None = None,
    position: int | str | None = None,
    first: int | None = None,
    last: int | None = None,
    every: int = 1,
) -> FrameSource:
    """Open a recording, and read its first frame.

    Parameters
    ----------
    source : path, pattern, folder, sequence of paths, array or iterable of arrays
        - a file: an image, a stack of pages, a video, or an array in a .npy, .npz, .zarr, .h5 or .nc file; of several
          arrays in a file, one is named after ``:/``, as in ``"run.h5:/camera/frames"``;
        - a pattern such as ``"run/*.tif"``, or a folder: the files in natural order, img2 before img10.
          Hidden files and files without frames are passed over; a mixture of kinds is refused;
        - a list of files, taken in the order given;
        - an array of shape (n, h, w) or (n, h, w, c), or anything that is indexed like one, such as a
          memory map, an HDF5 dataset, a Zarr or Dask array; an xarray.DataArray, whose dimensions are named
          and whose time coordinate gives the times. What is masked in a `numpy.ma` array has no value;
        - any iterable of arrays of shape (h, w) or (h, w, c). A generator can be read once, a list as often
          as one likes.
    channel : int or str, optional
        Channel of a file that holds several: number, from 0, or name. Of colour pictures 0 "red", 1 "green", 2 "blue";
        without it they become luminance.
    z : int or str, optional
        Slice of a stack that has slices and times.
    position : int or str, optional
        Position, scene, series or dataset of a file that holds several.
    first, last : int, optional
        Numbers of the first and last frame, from 0, both included.
    every : int
        Take every so many frames.

    Raises
    ------
    FrameFileError
        If a file, folder or pattern leads to no readable frames; the message says what was found.
    InputError
        If an array is no frame, `source` is none of the above, a file holds several channels, slices or positions of
        which none was chosen, or there is nothing of what was chosen.

    Examples
    --------
    >>> import numpy as np
    >>> frames = open_frames(np.zeros((3, 20, 30), dtype=np.uint8))
    >>> len(frames), frames.shape, frames.dtype
    (3, (20, 30), dtype('uint8'))
    >>> open_frames(np.zeros((10, 20, 30)), first=2, last=8, every=3).numbers
    range(2, 9, 3)
    """
    selection = Selection(channel, z, position, first, last, every)
    opened = _open(source, selection)
    if selection.frames == slice(None, None, 1):
        return opened
    if opened.count is not None and max(first or 0, last or 0) >= opened.count:
        name, value = ("last", last) if (last or 0) >= opened.count else ("first", first)
        raise InputError(f"{name}={value}: the recording has the frames 0 to {opened.count - 1}")
    return PartSource(opened, selection.frames)


def _open(source: Any, selection: Selection) -> FrameSource:
    if isinstance(source, FrameSource):
        refuse_choices(selection, "a source that is open already", ())
        return source
    if isinstance(source, str | os.PathLike):
        return FileSource(find_files(_path(source)), selection)
    if is_data_array(source):
        return ArraySource(labelled(source), selection)
    if hasattr(source, "shape") and hasattr(source, "__getitem__"):
        return ArraySource(source, selection)
    if not isinstance(source, Iterable):
        raise InputError(
            f"frames of type {type(source).__name__} cannot be read; "
            "give a path, a pattern, a folder, a list of paths, or arrays"
        )
    if not isinstance(source, list | tuple):
        return StreamSource(source, selection)
    are_paths = {isinstance(item, str | os.PathLike) for item in source}
    if are_paths == {True}:
        return FileSource(find_files([_path(item) for item in source]), selection)
    if are_paths == {True, False}:
        raise InputError("frames: a list of paths and other things; give either paths or arrays")
    return ListSource(source, selection)


def _path(given: PathLike) -> Path:
    text = os.fspath(given)
    if not isinstance(text, str) or not text or "\0" in text:
        raise InputError(f"frames={given!r}: is no path of a file; give its name as text")
    return Path(text)


def holds_frames(path: Path) -> bool:
    """Tell whether a netCDF file or Zarr store that exists holds frames, rather than a field."""
    found = find_format(path)
    if found is None or not path.exists():
        return False
    try:
        return found.open(path).count > 0
    except (NotARecordingError, FrameFileError):
        return False
    except InputError:  # frames of which some must be chosen
        return True
