"""Files of masks: pictures, arrays, and regions drawn in ImageJ.

| kind | measured is |
|---|---|
| grey, 1 to 32 bits or floating point | what is not 0, and not NaN |
| with alpha, or a transparent value or index | of that what is not transparent; all of it where it is 0 throughout |
| palette | the *index* is the value: index 0 is outside, whatever its colour |
| colour | what is not black |
| .npy, .npz | what is not 0, and not NaN; shape (height, width) or (n, height, width) |
| .roi, .zip of ImageJ | the inside of every region |
| a TIFF of several pages, a folder, a pattern | one for each frame |

With `bodies` the values are numbers of bodies, and regions are numbered from 1 in their order; later ones go over
earlier ones.
"""

from __future__ import annotations

import dataclasses
import glob
import hashlib
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.errors import FrameFileError, InputError
from sixflow.masks import imagej
from sixflow.masks.pictures import MOST_PIXELS, Picture, lossy, read_pictures

_SHOWN = 5


@dataclasses.dataclass(frozen=True)
class MaskFile:
    """What the file of a mask holds.

    Attributes
    ----------
    name : str
        Of the mask, for messages: "mask m.png".
    values : array, shape (height, width) or (n, height, width), or None
        bool, or int64 where they are numbers of bodies; None of regions, which need the shape of the frames.
    regions : tuple of Region
        Of ImageJ.
    bodies : bool
    notes : tuple of str
        What should be known of how it was read.
    remark : str
        Which values it holds, if none is outside.
    content : str
        Digest of the file, of regions.
    """

    name: str
    values: NDArray[Any] | None
    regions: tuple[imagej.Region, ...] = ()
    bodies: bool = False
    notes: tuple[str, ...] = ()
    remark: str = ""
    content: str = ""

    def drawn(self, shape: tuple[int, int]) -> NDArray[Any]:
        """The mask of frames of a shape.

        Raises
        ------
        InputError
            If a region holds no pixel of them.
        """
        if self.values is not None:
            return self.values
        drawn: NDArray[Any] = np.zeros(shape, np.int64 if self.bodies else np.bool_)
        for number, region in enumerate(self.regions, start=1):
            inside = region.inside(shape)
            if not inside.any():
                raise InputError(
                    f"{self.name}: region {region.name!r} holds no pixel of the frames, which have {shape[1]} columns "
                    f"and {shape[0]} rows; is it of another recording?"
                )
            drawn[inside] = number
        return drawn

    @property
    def digest(self) -> str:
        """Beginning of the SHA-256 of what it holds."""
        if self.values is None:
            return self.content
        held = f"{self.values.shape} {self.values.dtype}".encode() + self.values.tobytes()
        return hashlib.sha256(held).hexdigest()[:16]

    def first(self, count: int) -> MaskFile:
        """The same of the first frames alone."""
        if self.values is None or self.values.ndim == 2:
            return self
        return dataclasses.replace(self, values=self.values[:count])

    @property
    def count(self) -> int | None:
        """Number of masks where there is one for each frame."""
        return len(self.values) if self.values is not None and self.values.ndim == 3 else None


def read_mask(
    path: str | Path, *, bodies: bool = False, shape: tuple[int, int] | None = None
) -> NDArray[Any]:
    """Read a mask from a file: where to measure, or the numbers of bodies.

    Parameters
    ----------
    path : path
        A picture (PNG, TIFF, BMP, GIF, PNM), .npy, .npz, .roi or .zip of ImageJ, or a folder or pattern of these, one
        for each frame.
    bodies : bool
        The values are numbers of bodies, 0 is outside; otherwise what is not 0 is measured.
    shape : (int, int), optional
        Height and width of the frames, px: regions of ImageJ do not say it.

    Returns
    -------
    bool array, or int64 array if `bodies`
        Shape (height, width), or (n, height, width) where there is one for each frame.

    Raises
    ------
    FrameFileError
        If the file cannot be read.
    InputError
        If it cannot be a mask: compressed with loss, colours for numbers of bodies, numbers that are not whole.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "mask.npy"
    >>> np.save(path, [[0, 7], [7, 9]])
    >>> read_mask(path)
    array([[False,  True],
           [ True,  True]])
    >>> read_mask(path, bodies=True)
    array([[0, 7],
           [7, 9]])
    """
    file = open_mask(path, bodies=bodies)
    if file.values is None and shape is None:
        raise InputError(
            f"{file.name}: regions of ImageJ do not say how large the frames are; give shape=(height, width)"
        )
    return file.drawn(shape or (0, 0))


def open_mask(path: str | Path, *, bodies: bool = False) -> MaskFile:
    """Read the file of a mask, with what is to be said of it; arguments and errors as for `read_mask`."""
    path = Path(path).expanduser()
    paths = _files(path)
    name = f"mask {path}"
    if len(paths) > 1:
        parts = [_one(one, bodies) for one in paths]
        arrays = [part.values for part in parts]
        shapes = [None if array is None else array.shape for array in arrays]
        if len(set(shapes)) > 1 or shapes[0] is None or len(shapes[0]) != 2:
            raise InputError(
                f"{name}: {len(paths)} files that are not masks of one shape; give one picture for each frame"
            )
        values = np.stack([array for array in arrays if array is not None])
        notes = tuple(dict.fromkeys(note for part in parts for note in part.notes))
        return dataclasses.replace(parts[0], name=name, values=values, notes=notes, remark="")
    return dataclasses.replace(_one(paths[0], bodies), name=name)


def _files(path: Path) -> list[Path]:
    """The files of a folder or pattern in natural order, or the file itself."""
    from sixflow.frames.naming import natural_order

    try:
        if path.is_dir():
            found = [one for one in path.iterdir() if one.is_file() and not one.name.startswith(".")]
        elif not path.exists() and glob.has_magic(str(path)):
            found = [Path(one) for one in glob.glob(str(path)) if Path(one).is_file()]
        else:
            found = [path]
    except OSError as error:
        raise FrameFileError(
            f"mask {path}: cannot be opened ({error.strerror or error}); check the path"
        ) from error
    if not found:
        raise FrameFileError(f"mask {path}: no file is there; check the path")
    return natural_order(found)


def _one(path: Path, bodies: bool) -> MaskFile:
    name, suffix = f"mask {path}", path.suffix.lower()
    if not path.is_file():
        raise FrameFileError(f"{name}: no such file; check the path")
    if suffix in imagej.SUFFIXES:
        regions = imagej.read_regions(path)
        notes = tuple(f"{name}: {note}" for region in regions for note in region.notes)
        content = hashlib.sha256(path.read_bytes()).hexdigest()[:16]
        return MaskFile(name, None, tuple(regions), bodies, notes, content=content)
    if suffix in (".npy", ".npz"):
        return _of_pictures([Picture(one) for one in _arrays(path)], name, bodies)
    if suffix in (".jpg", ".jpeg"):
        raise lossy(path, "JPEG")
    _require_picture(path)
    return _of_pictures(read_pictures(path), name, bodies)


def _require_picture(path: Path) -> None:
    from sixflow.frames.formats import find_format

    kind = find_format(path)
    if kind is not None and kind.is_video and path.suffix.lower() != ".gif":
        raise InputError(
            f"mask {path}: a video, whose compression disturbs the zeros of a mask; save the masks as a TIFF stack"
        )


def _arrays(path: Path) -> Iterator[NDArray[Any]]:
    """The mask of an .npy or .npz file, or one for each frame."""
    try:
        if path.suffix.lower() == ".npz":
            with zipfile.ZipFile(path) as archive:
                largest = max((one.file_size for one in archive.infolist()), default=0)
            if largest > 8 * MOST_PIXELS:
                raise InputError(f"mask {path}: holds more than {MOST_PIXELS} values")
            with np.load(path, allow_pickle=False) as arrays:
                names = list(arrays)
                wanted = names[0] if len(names) == 1 else "mask"
                if wanted not in names:
                    raise InputError(
                        f"mask {path}: holds {', '.join(names) or 'nothing'}; name one of them 'mask'"
                    )
                array = np.asarray(arrays[wanted])
        else:
            array = np.load(path, allow_pickle=False, mmap_mode="r")
    except InputError:
        raise
    except Exception as error:
        raise FrameFileError(
            f"mask {path}: cannot be read as an array of NumPy ({' '.join(str(error).split())}); save it again"
        ) from error
    if (
        array.dtype.kind not in "biuf"
        or array.ndim not in (2, 3)
        or not array.size
        or array.size > MOST_PIXELS
    ):
        raise InputError(
            f"mask {path}: holds {array.dtype} of shape {array.shape}; must be numbers or bool, (height, width) or "
            f"(n, height, width), not more than {MOST_PIXELS}"
        )
    return iter(array if array.ndim == 3 else array[None])


def _of_pictures(pictures: Iterator[Picture] | list[Picture], name: str, bodies: bool) -> MaskFile:
    marked: list[NDArray[Any]] = []
    notes: list[str] = []
    remark = ""
    for picture in pictures:
        values, said = _marked(picture, name, bodies)
        if marked and values.shape != marked[0].shape:
            raise InputError(
                f"{name}: its pictures have shapes {marked[0].shape} and {values.shape}; all must have one"
            )
        if picture.values.ndim == 2 and values.all():
            remark = _values_of(picture.values)
        marked.append(values)
        notes += said
    if not marked:
        raise FrameFileError(f"{name}: holds no picture; save it again")
    together = marked[0] if len(marked) == 1 else np.stack(marked)
    return MaskFile(
        name, together, (), bodies, tuple(dict.fromkeys(notes)), remark if len(marked) == 1 else ""
    )


def _values_of(values: NDArray[Any]) -> str:
    """Which values there are, in words."""
    some = np.unique(values)
    shown = ", ".join(f"{value:g}" for value in some[:_SHOWN].astype(float))
    return f"its values are {shown}{', …' if some.size > _SHOWN else ''}"


def _marked(picture: Picture, name: str, bodies: bool) -> tuple[NDArray[Any], list[str]]:
    """Where to measure, or numbers of bodies, of one picture; and notes."""
    values, opaque = picture.values, picture.opaque
    notes: list[str] = []
    if values.ndim == 3:
        values = _without_colours(values, name, bodies, notes)
    if values.dtype.kind == "f":
        values = np.where(np.isnan(values), 0, values)
    if bodies:
        if not (
            np.isfinite(values).all() and (values == np.floor(values)).all() and np.abs(values).max() < 2**31
        ):
            raise InputError(f"{name}: has values that are no whole numbers; number the bodies 1, 2, …")
        marked: NDArray[Any] = np.array(values, np.int64)
    else:
        marked = values != 0
    if picture.palette:
        notes.append(f"{name}: has a palette; its indices are the values, and index 0 is outside")
    if opaque is None or opaque.all():
        return marked, notes
    if not opaque.any():
        raise InputError(f"{name}: is transparent everywhere; nothing is left to measure")
    if not marked[opaque].any():
        notes.append(f"{name}: all that is not transparent is 0 (black); all of that is measured")
        return opaque.astype(marked.dtype), notes
    notes.append(f"{name}: what is transparent is outside")
    return np.where(opaque, marked, marked.dtype.type(0)), notes


def _without_colours(values: NDArray[Any], name: str, bodies: bool, notes: list[str]) -> NDArray[Any]:
    """One value for each pixel of a colour picture."""
    grey: NDArray[Any] = values[..., 0]
    if (values == grey[..., None]).all():
        return grey
    if bodies:
        raise InputError(
            f"{name}: colours are no numbers of bodies; save it with a palette or as grey values"
        )
    notes.append(f"{name}: is in colour; what is not black is measured")
    return np.asarray((values != 0).any(axis=-1))
