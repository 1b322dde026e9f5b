"""Image files of one frame: PNG, JPEG, BMP and PNM, read by Pillow."""

from __future__ import annotations

import warnings
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from PIL import ExifTags, Image

from sixflow.errors import FrameFileError
from sixflow.frames.formats import FrameFile
from sixflow.frames.selection import Selection

Array: TypeAlias = NDArray[Any]

_DAMAGE = (OSError, SyntaxError, ValueError, EOFError, IndexError, zlib.error, Image.DecompressionBombError)

_KEPT_MODES = {"1", "L", "LA", "RGB", "RGBA", "I;16", "I;16L", "I;16B", "I", "F"}


class ImageFile(FrameFile):
    """A PNG, JPEG, BMP or PNM file. Grey values keep their depth; only 16-bit colour does not."""

    def __init__(self, path: Path, selection: Selection = Selection()) -> None:  # noqa: B008 - it is frozen
        super().__init__(path, selection)
        self._notes: tuple[str, ...] = ()

    @property
    def count(self) -> int:
        """One."""
        return 1

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on turned pictures and reduced depth."""
        return self._notes

    def read(self, start: int = 0) -> Iterator[Array]:
        """Yield the frame.

        Raises
        ------
        FrameFileError
            If the file is damaged, cut short, or not of the kind that its suffix tells.
        """
        if start > 0:
            return
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # what Pillow warns of is noted or raised here
                with Image.open(self.path) as image:
                    self._notes = _notes(image, self.path)
                    frame = _pixels(image)
        except _DAMAGE as error:
            raise FrameFileError(
                f"{self.path}: cannot be read as an image ({_reason(error)}); "
                "it is damaged, incomplete or of another type than its suffix tells: copy or export it again"
            ) from error
        yield frame


def _pixels(image: Image.Image) -> Array:
    if image.mode not in _KEPT_MODES:
        palette_with_alpha = image.mode in ("P", "PA") and (
            "transparency" in image.info or image.mode == "PA"
        )
        image = image.convert("RGBA" if palette_with_alpha else "RGB")
    pixels = np.array(image)
    # Pillow holds the 16-bit values of PNG and PNM in 32-bit integers.
    return pixels.astype(np.uint16) if image.mode == "I" else pixels


def _notes(image: Image.Image, path: Path) -> tuple[str, ...]:
    notes = []
    if image.getexif().get(ExifTags.Base.Orientation, 1) != 1:
        notes.append("the EXIF orientation is not applied: pixels are read as stored")
    if image.format == "PNG" and _is_deep_colour_png(path):
        notes.append("16-bit colour read with 8 bits per channel; grey PNG or TIFF keeps all 16")
    if image.mode in ("P", "PA"):
        notes.append("palette colours read as colour")
    return tuple(notes)


def _is_deep_colour_png(path: Path) -> bool:
    """Tell from the header whether a PNG has 16 bits in more than one channel."""
    with path.open("rb") as file:
        header = file.read(26)
    depth, colour_type = header[24:26]
    return depth == 16 and colour_type in (2, 4, 6)


def _reason(error: BaseException) -> str:
    text = str(error).strip()
    return "not a known image" if text.startswith("cannot identify") else text or type(error).__name__
