"""Pages: one picture of a TIFF, checked before it is decoded.

A damaged tag may claim any size, number of tiles or kind of values. What a page claims is compared with what the file
holds before memory is taken. What tifffile cannot decode without the package imagecodecs is tried with Pillow.
"""

from __future__ import annotations

import contextlib
import dataclasses
import re
import struct
import warnings
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from sixflow.errors import FrameFileError
from sixflow.frames.limits import check_size
from sixflow.frames.packed import unpack_rows
from sixflow.frames.tiff import colour
from sixflow.frames.tiff.log import captured_log

Array: TypeAlias = NDArray[Any]

DAMAGE = (
    *(OSError, ValueError, TypeError, KeyError, IndexError, RuntimeError, AttributeError, AssertionError),
    *(ArithmeticError, EOFError, SyntaxError, MemoryError, struct.error, zlib.error),
)
"""What tifffile and Pillow raise over a file that is damaged."""

_NEEDED = {
    *(254, 255, 256, 257, 258, 259, 262, 266, 273, 277, 278, 279, 284, 317, 320, 322, 323, 324, 325),
    *(332, 338, 339, 347, 530),
}
"""Tags without which the pixels would be read wrong."""

_GROWTH = {1: 1.0, 5: 1400.0, 8: 1040.0, 32773: 64.0, 32946: 1040.0}
"""Most by which decoding makes the stored bytes grow: none, LZW, Deflate, PackBits."""

_JPEG = (6, 7, 33007, 34892)


@dataclasses.dataclass(frozen=True)
class Plane:
    """Where one picture lies.

    Attributes
    ----------
    page : int
        Number of the directory that describes it.
    offset : int or None
        Its first byte, where it has no directory of its own and follows others without gaps.
    depth, sample : int or None
        Which slice of a page that holds a volume, which channel of one whose samples are channels.
    """

    page: int
    offset: int | None = None
    depth: int | None = None
    sample: int | None = None


def damaged(path: Path, reason: str, is_cut: bool = False) -> FrameFileError:
    """Return the error of a file that is damaged, for a reason."""
    cut = is_cut or any(
        word in reason for word in ("invalid page offset", "corrupted IFD", "failed to read", "truncated")
    )
    state = "the file is cut short or damaged" if cut else "cannot be read as a TIFF"
    return FrameFileError(f"{path}: {state} ({reason}); copy or export it again")


class Pages:
    """The pages of an open TIFF.

    Parameters
    ----------
    tif : tifffile.TiffFile
    path : Path
    keep_indices : bool
        Palettes only colour the display.
    messages : list of str
        What tifffile said of the first page, which it reads when it opens the file.
    """

    def __init__(
        self, tif: Any, path: Path, *, keep_indices: bool = False, messages: Sequence[str] = ()
    ) -> None:
        self.tif, self.path, self.keep_indices, self._of_first = tif, path, keep_indices, messages
        self.size = path.stat().st_size
        self._last: tuple[int, Any] | None = None

    def page(self, number: int) -> Any:
        """Return a page whose claims hold; FrameFileError if it cannot be read, or claims what cannot be."""
        if self._last is not None and self._last[0] == number:
            return self._last[1]
        try:
            with captured_log() as messages:
                page = self.tif.pages.get(number)
            _require_tags([*messages, *(() if number else self._of_first)], self.path, number)
            self._check(page, number)
        except FrameFileError:
            raise
        except DAMAGE as error:
            raise damaged(self.path, f"page {number}: {error}") from error
        self._last = number, page
        return page

    def decode(self, plane: Plane) -> tuple[Array, tuple[str, ...]]:
        """Return a picture, shape (h, w) or (h, w, c), and notes on its colours.

        Raises FrameFileError if it is damaged, missing, or of a kind that cannot be decoded.
        """
        page = self.page(plane.page)
        try:
            with captured_log():
                return self._picture(page, plane)
        except FrameFileError:
            raise
        except DAMAGE as error:
            raise damaged(self.path, f"page {plane.page}: {error}") from error

    def _picture(self, page: Any, plane: Plane) -> tuple[Array, tuple[str, ...]]:
        is_rgb = False
        if plane.offset is not None:
            pixels = self._stored(page, plane)
        else:
            pixels, is_rgb = self._decoded(page, plane.page)
        axes = page.axes
        if axes.startswith("S"):
            pixels, axes = np.moveaxis(pixels, 0, -1), axes[1:] + "S"
        if "Z" in axes:
            pixels = pixels[plane.depth or 0]
        if plane.sample is not None:
            pixels = pixels[..., plane.sample]
        name = f"{self.path}: page {plane.page}"
        return colour.to_picture(pixels, page, name, is_rgb=is_rgb, keep_indices=self.keep_indices)

    def _check(self, page: Any, number: int) -> None:
        """Refuse what a page claims and cannot be."""
        name = f"{self.path}: page {number}"
        if not page.shape or 0 in page.shape or page.dtype is None:
            kind = f"{page.bitspersample} bits of sample format {int(page.sampleformat)}"
            claims = f"it has the shape {page.shape}" if page.dtype is not None else f"its values have {kind}"
            raise damaged(self.path, f"page {number}: {claims}")
        samples, compression = int(page.samplesperpixel), int(page.compression)
        bits = page.bitspersample
        bits = max(bits) if isinstance(bits, tuple) else int(bits)
        growth, depth = _GROWTH.get(compression), int(page.imagedepth)
        present = [
            max(0, min(int(count), self.size - int(offset)))
            for offset, count in zip(page.dataoffsets, page.databytecounts, strict=False)
        ]
        size = page.imagewidth, page.imagelength * depth
        check_size(*size, samples, bits / 8, name, stored=self.size, growth=growth or 2.0**62)
        check_size(*size, samples, page.dtype.itemsize, name)
        if page.is_tiled:
            tile = page.tilewidth, page.tilelength * int(page.tiledepth)
            if 0 in tile:
                raise damaged(self.path, f"page {number}: its tiles have no size")
            check_size(*tile, samples, page.dtype.itemsize, f"{name}, its tiles")
        expected = 1
        for count in page.chunked:
            expected *= int(count)
        if len(present) < expected:
            raise damaged(
                self.path,
                f"page {number} has {expected} pieces, of which {len(present)} are listed", is_cut=True,
            )  # fmt: skip
        missing = sum(not count for count in present[:expected])
        if missing:
            raise damaged(
                self.path, f"page {number}: {missing} of its {expected} pieces are not there", is_cut=True
            )

    def _stored(self, page: Any, plane: Plane) -> Array:
        """Read a picture that is stored as it is, without a directory of its own."""
        dtype = page.dtype.newbyteorder(self.tif.byteorder)
        values = int(np.prod(page.shape))
        assert plane.offset is not None
        end = plane.offset + values * dtype.itemsize
        if end > self.size:
            raise damaged(self.path, f"its pixels should end at byte {end} of {self.size}", is_cut=True)
        return np.fromfile(self.path, dtype, values, offset=plane.offset).reshape(page.shape)

    def _decoded(self, page: Any, number: int) -> tuple[Array, bool]:
        """Decode a page; also tell whether the decoder made RGB of its colours."""
        is_ycbcr = colour.photometric(page) == colour.YCBCR
        try:
            if _is_packed(page):
                return _unpacked(page, self.tif.filehandle), False
            with captured_log():
                pixels: Array = page.asarray(maxworkers=1)
            if pixels.shape != page.shape:
                raise ValueError(f"decoded to the shape {pixels.shape}, not {page.shape}")
            return pixels, is_ycbcr and int(page.compression) in _JPEG
        except (*DAMAGE, ImportError) as error:
            if isinstance(error, ImportError) or "imagecodecs" in str(error):
                return _by_pillow(self.path, number, page), is_ycbcr
            raise damaged(self.path, f"page {number}: {error}") from error


def is_contiguous(page: Any) -> bool:
    """Tell whether the pixels of a page lie in the file as they are, without gaps."""
    if int(page.compression) != 1 or page.is_tiled or page.fillorder != 1 or page.predictor != 1:
        return False
    if page.bitspersample not in (8, 16, 32, 64) or not page.dataoffsets:
        return False
    ends = [offset + count for offset, count in zip(page.dataoffsets, page.databytecounts, strict=False)]
    return all(end == begin for end, begin in zip(ends, page.dataoffsets[1:], strict=False))


def _require_tags(messages: list[str], path: Path, number: int) -> None:
    for message in messages:
        found = re.search(r"TiffTag (\d+)", message)
        if "fromfile" in message and (found is None or int(found[1]) in _NEEDED):
            raise damaged(path, f"page {number}: {message.split('> ')[-1].removeprefix('raised ')}")


def _is_packed(page: Any) -> bool:
    return (
        isinstance(page.bitspersample, int)
        and page.bitspersample < 16
        and page.bitspersample not in (1, 8)
        and int(page.compression) == 1
        and page.fillorder == 1
        and page.samplesperpixel == 1
        and not page.is_tiled
        and page.imagedepth == 1
    )


def _unpacked(page: Any, file: Any) -> Array:
    height, width, bits = page.imagelength, page.imagewidth, page.bitspersample
    strips = []
    for number, (offset, size) in enumerate(zip(page.dataoffsets, page.databytecounts, strict=False)):
        rows = min(page.rowsperstrip, height - number * page.rowsperstrip)
        if rows <= 0:
            break
        needed = rows * -(-width * bits // 8)
        file.seek(offset)
        data = file.read(min(size, needed))
        if len(data) < needed:
            raise ValueError(f"failed to read {needed} bytes, got {len(data)}")
        strips.append(unpack_rows(data, rows, width, bits))
    return np.concatenate(strips)


@contextlib.contextmanager
def _any_size() -> Iterator[None]:
    """Let Pillow decode pictures of any size: theirs has been checked."""
    from PIL import Image

    before = Image.MAX_IMAGE_PIXELS
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what Pillow warns of is refused here
        Image.MAX_IMAGE_PIXELS = None
        try:
            yield
        finally:
            Image.MAX_IMAGE_PIXELS = before


def _by_pillow(path: Path, number: int, page: Any) -> Array:
    """Decode a page with Pillow, whose libtiff knows LZW and others; values as they are stored."""
    from PIL import Image

    try:
        with _any_size(), Image.open(path, formats=("TIFF",)) as image:
            image.seek(number)
            mode, pixels = image.mode, np.array(image)
    except DAMAGE as error:
        mode, pixels, reason = "", np.zeros(0), str(error)
    else:
        reason = f"Pillow reads it as {pixels.dtype} of shape {pixels.shape}"
    planar = page.axes.startswith("S")
    wanted = (*page.shape[1:], page.shape[0]) if planar else page.shape
    if pixels.shape != wanted or pixels.dtype.itemsize < page.dtype.itemsize:
        name = getattr(page.compression, "name", page.compression)
        raise FrameFileError(
            f"{path}: its {page.bitspersample}-bit pages are stored with {name} and need imagecodecs: "
            f"pip install sixflow[codecs]; or save the file uncompressed ({reason})"
        )
    if colour.photometric(page) == colour.WHITE_IS_ZERO and mode in ("1", "L"):  # which Pillow inverts
        pixels = ~pixels
    return np.moveaxis(pixels, -1, 0) if planar else pixels
