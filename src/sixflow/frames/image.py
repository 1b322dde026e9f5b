"""Image files of one frame: PNG, JPEG, BMP, PNM, WebP and JPEG 2000, read by Pillow.

Grey values keep their depth. PNG in colour with 16 bits per channel, of which Pillow keeps 8, is decoded by FFmpeg. A
size that is claimed is checked before memory is taken for it (`limits`), in place of Pillow's limit on pixels. Files
that hold several pictures are refused.
"""

from __future__ import annotations

import struct
import warnings
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray
from PIL import ExifTags, Image, UnidentifiedImageError

from sixflow.errors import FrameFileError
from sixflow.frames.compression import compression_note, is_reversible
from sixflow.frames.formats import FrameFile
from sixflow.frames.grey import to_grey
from sixflow.frames.jpeg import damage_of_jpeg, luma_steps, quantisation_noise
from sixflow.frames.limits import check_size
from sixflow.frames.metadata import Compression, Metadata
from sixflow.frames.selection import Selection

Array: TypeAlias = NDArray[Any]

_DAMAGE = (
    *(OSError, SyntaxError, ValueError, EOFError, LookupError, TypeError, ArithmeticError, AttributeError),
    *(RuntimeError, MemoryError, struct.error, zlib.error, Image.DecompressionBombError),
)

_KINDS = ("PNG", "JPEG", "BMP", "PPM", "WEBP", "JPEG2000")
"""Pillow's names of the kinds that are read, whatever the suffix says."""

_GROWTH = {"PNG": 8 * 1032, "BMP": 8 * 128, "PPM": 8}
"""Pixels that a byte of the file can stand for, where there is a limit."""

_STRIP = 2**24
"""Pixels that are taken over at once."""

_KEPT = {"1", "L", "LA", "RGB", "RGBA", "I;16", "I;16L", "I;16B", "I;16N", "I", "F"}

_CONVERTED = {
    "P": "RGB", "PA": "RGBA", "CMYK": "RGB", "YCbCr": "RGB", "HSV": "RGB", "RGBX": "RGB", "La": "LA", "RGBa": "RGBA",
}  # fmt: skip

_NOTES = {
    "P": "palette colours read as colour",
    "PA": "palette colours read as colour",
    "CMYK": "print colours (CMYK) converted to RGB without a colour profile",
    "YCbCr": "YCbCr converted to RGB",
    "HSV": "HSV converted to RGB",
    "LAB": "the lightness L* of CIELAB taken as grey",
}


class ImageFile(FrameFile):
    """A file of one picture. Grey values keep their depth."""

    def __init__(self, path: Path, selection: Selection = Selection()) -> None:  # noqa: B008 - it is frozen
        super().__init__(path, selection)
        self._notes: tuple[str, ...] = ()
        self._metadata = Metadata()

    @property
    def count(self) -> int:
        """One."""
        return 1

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on turned pictures, converted colours and lossy compression."""
        return self._notes

    @property
    def metadata(self) -> Metadata:
        """The lossy compression, if any."""
        return self._metadata

    def read(self, start: int = 0) -> Iterator[Array]:
        """Yield the frame.

        Raises FrameFileError if the file is damaged, cut short, larger than the limit, holds several
        pictures, or is not of the kind that its suffix tells.
        """
        if start > 0:
            return
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # what Pillow warns of is noted or raised here
                frame = self._frame()
        except FrameFileError:
            raise
        except _DAMAGE as error:
            raise FrameFileError(
                f"{self.path}: cannot be read as an image ({_reason(error)}); "
                "it is damaged, incomplete or of another type than its suffix tells: copy or export it again"
            ) from error
        yield frame

    def _frame(self) -> Array:
        with _opened(self.path) as image:
            bands = len(image.getbands())
            check_size(
                *image.size, 1 if bands == 1 else 4, 4 if image.mode in ("I", "F") else 1, str(self.path),
                stored=self.path.stat().st_size if image.format in _GROWTH else None,
                growth=_GROWTH.get(image.format or "", 1) * (1 if bands == 1 else 4),
            )  # fmt: skip
            pictures = getattr(image, "n_frames", 1)
            if image.format != "MPO" and pictures > 1:
                raise FrameFileError(
                    f"{self.path}: holds {pictures} pictures; give one picture a file, or convert it to a video "
                    "without loss, for instance with ffmpeg to FFV1"
                )
            orientation = image.getexif().get(ExifTags.Base.Orientation, 1)
            deep = image.format == "PNG" and _is_deep_colour_png(self.path)
            frame = _deep_colours(self.path) if deep else _pixels(image, str(self.path))
            compression = self._compression(image, frame)
        notes = [_NOTES[image.mode]] if image.mode in _NOTES else []
        if orientation != 1:
            notes.append(
                "the EXIF orientation is not applied: the picture is turned, pixels are read as stored"
            )
        if pictures > 1:
            notes.append("further pictures in the file (previews, other views) are passed over")
        if compression is not None:
            notes.append(compression_note(compression, one_of_many=True))
        self._notes, self._metadata = tuple(notes), Metadata(compression=compression)
        return frame

    def _compression(self, image: Image.Image, frame: Array) -> Compression | None:
        if image.format in ("JPEG", "MPO"):
            data = self.path.read_bytes()
            if damage := damage_of_jpeg(data):
                raise ValueError(f"the picture is damaged: {damage}")
            steps = luma_steps(data)
            grey, _ = to_grey(frame, self.path.name)
            return Compression("JPEG", 0.0 if steps is None else quantisation_noise(grey, steps))
        if image.format == "WEBP" and _is_lossy_webp(self.path.read_bytes()):
            return Compression("WebP")
        if image.format == "JPEG2000" and not is_reversible(self.path.read_bytes()):
            return Compression("JPEG 2000")
        return None


def _opened(path: Path) -> Image.Image:
    """Open one of the kinds that are read, without Pillow's limit on pixels."""
    Image.init()
    with path.open("rb") as file:
        prefix = file.read(16)
    for kind in _KINDS:
        plugin, accepts = Image.OPEN.get(kind, (None, None))
        if plugin is not None and (accepts is None or accepts(prefix) is True):
            return cast(Any, plugin)(path, str(path))
    raise UnidentifiedImageError("not a known image")


def _pixels(image: Image.Image, name: str) -> Array:
    """Pixels in a mode of which every channel is grey, red, green, blue or alpha."""
    key = image.info.get("transparency")
    if image.mode == "LAB":
        return _array(image)[..., 0]
    if image.mode not in _KEPT:
        if image.mode not in _CONVERTED:
            raise FrameFileError(
                f"{name}: pixels of the mode {image.mode!r} are not read; save it as grey or RGB, PNG or TIFF"
            )
        image = image.convert("RGBA" if image.mode == "P" and key is not None else _CONVERTED[image.mode])
    elif image.mode == "RGB" and key is not None:
        image = image.convert("RGBA")
    pixels = _array(image)
    if image.mode == "I" and pixels.size and pixels.min() >= 0 and pixels.max() <= 65535:
        pixels = pixels.astype(np.uint16)  # the 16-bit values of PNG and PNM, in 32-bit integers
    if pixels.ndim == 2 and isinstance(key, int):
        if pixels.dtype == bool:
            pixels = pixels.astype(np.uint8) * np.uint8(255)
        shown = (pixels != key).astype(pixels.dtype) * np.iinfo(pixels.dtype).max
        pixels = np.stack([pixels, shown], axis=-1)
    return pixels


def _array(image: Image.Image) -> Array:
    """Pixels of an image, in strips, so that a large one does not stand in memory three times."""
    width, height = image.size
    rows = max(1, _STRIP // max(width, 1))
    if height <= rows:
        return np.array(image)
    strips = (np.asarray(image.crop((0, y, width, min(y + rows, height)))) for y in range(0, height, rows))
    first = next(strips)
    pixels = np.empty((height, *first.shape[1:]), first.dtype)
    pixels[:rows] = first
    for number, strip in enumerate(strips, 1):
        pixels[number * rows : number * rows + len(strip)] = strip
    return pixels


def _is_deep_colour_png(path: Path) -> bool:
    """Tell from the header whether a PNG has 16 bits in more than one channel."""
    with path.open("rb") as file:
        header = file.read(26)
    depth, colour_type = header[24:26]
    return depth == 16 and colour_type in (2, 4, 6)


def _deep_colours(path: Path) -> Array:
    """The 16-bit channels of a PNG, shape (h, w, 2 to 4)."""
    import av

    try:
        with av.open(str(path), format="png_pipe") as container:
            frame = next(container.decode(video=0))
    except (av.FFmpegError, StopIteration) as error:
        raise ValueError(str(error) or "no picture") from error
    channels = len(frame.format.components)
    plane = np.frombuffer(cast(Any, frame.planes[0]), np.uint8).reshape(-1, frame.planes[0].line_size)
    values = plane[: frame.height, : 2 * channels * frame.width].copy().view(">u2")
    return values.reshape(frame.height, frame.width, channels).astype(np.uint16)


def _is_lossy_webp(data: bytes) -> bool:
    """Tell from the chunks of a WebP file whether its picture is of the lossy kind."""
    at = 12
    while at < len(data) - 8:
        if data[at : at + 4] in (b"VP8 ", b"VP8L"):
            return data[at : at + 4] == b"VP8 "
        at += 8 + int.from_bytes(data[at + 4 : at + 8], "little") + data[at + 4] % 2
    return False


def _reason(error: BaseException) -> str:
    text = str(error).strip()
    return "not a known image" if text.startswith("cannot identify") else text or type(error).__name__
