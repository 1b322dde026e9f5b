"""Opening: what a user may give as frames, and the source that each becomes."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any, TypeAlias

from sixflow.errors import InputError
from sixflow.frames.paths import find_files
from sixflow.frames.source import ArraySource, FileSource, FrameSource, StreamSource

PathLike: TypeAlias = str | os.PathLike[str]


def open_frames(source: PathLike | Iterable[Any] | FrameSource) -> FrameSource:
    """Open a recording, and read its first frame.

    Parameters
    ----------
    source : path, pattern, folder, sequence of paths, array or iterable of arrays
        - a file: an image, a stack of pages or a video;
        - a pattern such as ``"run/*.tif"``, or a folder: the files in natural order, img2 before img10.
          Hidden files and files without frames are passed over; a mixture of kinds is refused;
        - a list of files, taken in the order given;
        - an array of shape (n, h, w) or (n, h, w, c), or anything that is indexed like one, such as a
          memory map, an HDF5 dataset or a Zarr array;
        - any iterable of arrays of shape (h, w) or (h, w, c). A generator can be read once, a list as often
          as one likes.

    Returns
    -------
    FrameSource

    Raises
    ------
    FrameFileError
        If a file, folder or pattern leads to no readable frames; the message says what was found.
    InputError
        If an array is no frame, or `source` is none of the above.

    Examples
    --------
    >>> import numpy as np
    >>> frames = open_frames(np.zeros((3, 20, 30), dtype=np.uint8))
    >>> len(frames), frames.shape, frames.dtype
    (3, (20, 30), dtype('uint8'))
    """
    if isinstance(source, FrameSource):
        return source
    if isinstance(source, str | os.PathLike):
        return FileSource(find_files(Path(source)))
    if hasattr(source, "shape") and hasattr(source, "__getitem__"):
        return ArraySource(source)
    if not isinstance(source, Iterable):
        raise InputError(
            f"frames of type {type(source).__name__} cannot be read; "
            "give a path, a pattern, a folder, a list of paths, or arrays"
        )
    if not isinstance(source, list | tuple):
        return StreamSource(source)
    are_paths = {isinstance(item, str | os.PathLike) for item in source}
    if are_paths == {True}:
        return FileSource(find_files([Path(item) for item in source]))
    if are_paths == {True, False}:
        raise InputError("frames: a list of paths and other things; give either paths or arrays")
    return ArraySource(source)
