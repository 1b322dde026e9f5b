"""Pictures: what the pixels of a mask's file hold, as they stand in it.

A mask is not a photograph: a palette's index is the value, transparency says what is outside, and nothing is converted
to luminance.
"""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.errors import FrameFileError, InputError

MOST_PIXELS = 2**30
"""In all pictures of a file."""

_TIFF = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
_KINDS = ("PNG", "BMP", "DIB", "GIF", "PPM")
_LOSSY = ("JPEG", "MPO", "JPEG2000", "WEBP", "AVIF")
_MODES = ("1", "L", "P", "PA", "LA", "RGB", "RGBA", "I", "F")


@dataclasses.dataclass(frozen=True)
class Picture:
    """One picture of a mask's file.

    Attributes
    ----------
    values : array, shape (height, width) or (height, width, 3)
        As stored; of a palette the indices.
    opaque : bool array, shape (height, width), or None
        Where it is not transparent; None where it cannot be.
    palette : bool
        Whether the values are indices of a palette.
    """

    values: NDArray[Any]
    opaque: NDArray[np.bool_] | None = None
    palette: bool = False


def read_pictures(path: Path) -> Iterator[Picture]:
    """Yield the pictures of a file: one, or the pages of a TIFF.

    Raises
    ------
    FrameFileError
        If it cannot be read.
    InputError
        If it is of a kind that no mask can be.
    """
    try:
        with path.open("rb") as file:
            begin = file.read(4)
    except OSError as error:
        raise FrameFileError(
            f"mask {path}: cannot be opened ({error.strerror or error}); check the path"
        ) from error
    return _of_tiff(path) if begin in _TIFF else _of_image(path)


def lossy(path: Path, compression: str) -> InputError:
    """What is said of a mask that was compressed with loss."""
    return InputError(
        f"mask {path}: {compression} compression disturbs the zeros of a mask; save it as PNG or TIFF"
    )


def _unreadable(path: Path, error: Exception) -> FrameFileError:
    said = " ".join(str(error).split()) or type(error).__name__
    return FrameFileError(
        f"mask {path}: cannot be read ({said}); a mask is a PNG, TIFF, BMP, GIF or PNM picture, .npy, .npz, or .roi "
        "and .zip of ImageJ: save it again"
    )


def _of_image(path: Path) -> Iterator[Picture]:
    from PIL import Image

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with Image.open(path) as image:
                if image.format in _LOSSY:
                    raise lossy(path, str(image.format))
                _require_kind(image, path)
                picture = _decoded(image)
    except (FrameFileError, InputError):
        raise
    except Exception as error:  # whatever a damaged file makes of the decoder
        raise _unreadable(path, error) from error
    yield picture


def _require_kind(image: Any, path: Path) -> None:
    if image.format not in _KINDS:
        raise FrameFileError(f"mask {path}: a {image.format} file; save it as PNG or TIFF")
    if getattr(image, "n_frames", 1) > 1:
        raise InputError(
            f"mask {path}: holds {image.n_frames} pictures, one over the other; save one for each frame as a TIFF "
            "stack or as files of a folder"
        )
    if image.mode.startswith("I;16"):
        return
    if image.mode not in _MODES:
        raise InputError(
            f"mask {path}: its colours are {image.mode}; save it as grey, palette or RGB, with or without alpha"
        )
    if image.format == "PNG" and _depth(path) == 16 and image.mode in ("LA", "RGB", "RGBA"):
        raise InputError(
            f"mask {path}: has 16 bits and several channels; save it as grey, without alpha or colour"
        )


def _depth(path: Path) -> int:
    """Bits of a sample of a PNG, from its header."""
    with path.open("rb") as file:
        return file.read(25)[24]


def _decoded(image: Any) -> Picture:
    key = image.info.get("transparency")
    mode = image.mode
    levels = 255 // (2 ** _depth(Path(image.filename)) - 1) if image.format == "PNG" and mode == "L" else 1
    values = np.array(image)
    if mode in ("LA", "PA"):
        return Picture(values[..., 0], values[..., 1] > 0, mode == "PA")
    if mode == "RGBA":
        return Picture(values[..., :3], values[..., 3] > 0)
    opaque = None
    if mode == "P" and key is not None:
        alpha = np.full(256, 255, np.uint8)
        if isinstance(key, bytes):
            alpha[: len(key)] = np.frombuffer(key[:256], np.uint8)
        else:
            alpha[key] = 0
        opaque = alpha[values] > 0
    elif key is not None:  # one grey value, or one colour, is transparent
        same = values == np.asarray(key)
        opaque = ~(same if values.ndim == 2 else same.all(axis=-1))
    if levels > 1:  # samples of 2 and 4 bits are spread over 0 to 255
        values = values // levels
    return Picture(values, opaque, mode == "P")


def _of_tiff(path: Path) -> Iterator[Picture]:
    import tifffile

    total = 0
    try:
        with tifffile.TiffFile(path) as file:
            pages = [page.aspage() for page in file.pages if not page.aspage().is_reduced]
            if file.is_imagej and len(pages) == 1 and len(file.series[0].shape) == 3:
                values = file.series[0].asarray()  # large stacks have one page for all
                yield from (Picture(one) for one in values)
                return
            for page in pages:
                total += int(np.prod(page.shape))
                if total > MOST_PIXELS:
                    raise InputError(
                        f"mask {path}: more than {MOST_PIXELS} values; give one file for each frame in a folder"
                    )
                yield _of_page(page, path)
    except (FrameFileError, InputError):
        raise
    except Exception as error:
        raise _unreadable(path, error) from error


def _of_page(page: Any, path: Path) -> Picture:
    from tifffile import COMPRESSION, PHOTOMETRIC

    if page.compression in (COMPRESSION.JPEG, COMPRESSION.OJPEG) or "JPEG" in str(page.compression):
        raise lossy(path, "JPEG")
    known = (
        PHOTOMETRIC.MINISBLACK,
        PHOTOMETRIC.MINISWHITE,
        PHOTOMETRIC.RGB,
        PHOTOMETRIC.PALETTE,
        PHOTOMETRIC.MASK,
    )
    if page.photometric not in known:
        kind = getattr(page.photometric, "name", page.photometric)
        raise InputError(f"mask {path}: its colours are {kind}; save it as grey, palette or RGB")
    values = np.asarray(page.asarray())
    if page.planarconfig == 2 and values.ndim == 3:
        values = np.moveaxis(values, 0, -1)
    colours = 3 if page.photometric == PHOTOMETRIC.RGB else 1
    channels = values.shape[-1] if values.ndim == 3 else 1
    if values.ndim not in (2, 3) or not colours <= channels <= colours + 1:
        raise InputError(f"mask {path}: a page of shape {values.shape}; a mask is (height, width)")
    opaque = None
    if channels > colours:
        opaque, values = values[..., -1] > 0, values[..., :-1]
    if colours == 1 and values.ndim == 3:
        values = values[..., 0]
    if page.photometric == PHOTOMETRIC.MINISWHITE and values.dtype.kind in "bu":
        white = True if values.dtype.kind == "b" else 2**page.bitspersample - 1
        values = values ^ values.dtype.type(white)  # 0 is white there
    return Picture(values, opaque, page.photometric == PHOTOMETRIC.PALETTE)
