"""Colour: what the samples of a TIFF page mean, by its photometric interpretation.

| interpretation | read as |
|---|---|
| black is zero | grey; with declared alpha, grey and alpha; other samples are channels, of which one is chosen |
| white is zero | the same, not inverted, as ImageJ and NumPy have it: an inverted picture moves as the picture does |
| RGB | colour; an extra sample is alpha only where the file says so |
| palette | the colours of the palette, but for ImageJ, whose palettes only colour the display |
| separated (CMYK) | R = (1 − C)(1 − K) and so on |
| YCbCr | luma Y; JPEG decoders return RGB instead |
| CIELab, ICCLab, ITULab | lightness L |

All others are refused by name.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from sixflow.errors import FrameFileError

Array: TypeAlias = NDArray[Any]

WHITE_IS_ZERO, BLACK_IS_ZERO, RGB, PALETTE, MASK, SEPARATED, YCBCR = range(7)
LAB, CFA, LINEAR_RAW = (8, 9, 10), 32803, 34892

_ALPHA = (1, 2)
_CMYK_INK_SET = 1
_GREY = (WHITE_IS_ZERO, BLACK_IS_ZERO, MASK, CFA)


def photometric(page: Any) -> int:
    """Return the photometric interpretation of a page; black is zero where it states none."""
    stated = 262 in page.tags or int(page.photometric) == YCBCR
    return int(page.photometric) if stated else BLACK_IS_ZERO


def channels(page: Any) -> int:
    """Return the number of channels that the samples of a page are; 1 where they are colours, or grey and alpha."""
    samples = int(page.samplesperpixel)
    alpha = sum(int(kind) in _ALPHA for kind in page.extrasamples)
    return samples if photometric(page) in _GREY and samples - alpha > 1 else 1


def to_picture(
    pixels: Array, page: Any, name: str, *, is_rgb: bool = False, keep_indices: bool = False
) -> tuple[Array, tuple[str, ...]]:
    """Return pixels as `sixflow.frames.grey.to_grey` takes them, with notes on what was done.

    Raises FrameFileError if the interpretation is one that cannot be converted.

    Parameters
    ----------
    pixels : array, shape (h, w) or (h, w, samples)
        As decoded.
    page : tifffile.TiffPage
        Whose tags tell what they mean.
    name : str
        Of the file and page, for messages.
    is_rgb : bool
        The decoder has converted to RGB already.
    keep_indices : bool
        A palette only colours the display; the indices are the values.
    """
    kind, samples = photometric(page), pixels.shape[2] if pixels.ndim == 3 else 1
    if is_rgb:
        return pixels, ()
    if kind in _GREY:
        return _grey(pixels, kind)
    if kind in (RGB, LINEAR_RAW) and samples >= 3:
        return _rgb(pixels, page)
    if kind == PALETTE and samples == 1:
        return (pixels, ()) if keep_indices else _palette(pixels, page, name)
    if kind == SEPARATED and samples >= 4 and page.tags.valueof(332, _CMYK_INK_SET) == _CMYK_INK_SET:
        return _cmyk(pixels, page)
    if kind == YCBCR and samples == 3:
        return pixels[..., 0], ("colour → recorded luma",)
    if kind in LAB:
        return pixels if pixels.ndim == 2 else pixels[..., 0], ("Lab colour → its lightness",)
    stated = getattr(page.photometric, "name", kind)
    raise FrameFileError(
        f"{name}: {samples} samples of photometric interpretation {stated} cannot be turned into grey values; "
        "save it as a grey or RGB TIFF"
    )


def _grey(pixels: Array, kind: int) -> tuple[Array, tuple[str, ...]]:
    notes: tuple[str, ...] = ()
    if kind == CFA:
        notes = ("raw frames of a colour camera: pixels under unlike filters stand side by side",)
    if kind != WHITE_IS_ZERO:
        return pixels, notes
    return pixels, ("white is stored as zero; the values are read as they are stored",)


def _rgb(pixels: Array, page: Any) -> tuple[Array, tuple[str, ...]]:
    if pixels.shape[2] == 3:
        return pixels, ()
    extra = [int(kind) for kind in page.extrasamples]
    alpha = next((3 + index for index, kind in enumerate(extra) if kind in _ALPHA), None)
    kept = [0, 1, 2] if alpha is None or alpha >= pixels.shape[2] else [0, 1, 2, alpha]
    left_out = pixels.shape[2] - len(kept)
    notes = (f"extra samples beside the colours left out: {left_out}",) if left_out else ()
    return pixels[..., kept], notes


def _palette(pixels: Array, page: Any, name: str) -> tuple[Array, tuple[str, ...]]:
    colours = page.colormap
    if colours is None or colours.ndim != 2 or pixels.dtype.kind not in "ub":
        raise FrameFileError(f"{name}: its palette is damaged; save it as a grey or RGB TIFF")
    index = pixels.astype(np.intp)
    if index.max() >= colours.shape[1]:
        raise FrameFileError(
            f"{name}: its palette has {colours.shape[1]} colours, but there is a pixel of index {index.max()}; "
            "the file is damaged: export it again"
        )
    return np.moveaxis(colours[:, index], 0, -1), ("palette colours read as colour",)


def _cmyk(pixels: Array, page: Any) -> tuple[Array, tuple[str, ...]]:
    top = 1.0 if pixels.dtype.kind == "f" else float(2 ** _bits(page) - 1)
    precise = np.result_type(np.float32, pixels.dtype)
    black = 1 - pixels[..., 3:4].astype(precise) / precise.type(top)
    light = (precise.type(top) - pixels[..., :3].astype(precise)) * black
    notes: tuple[str, ...] = ("print colours (CMYK) → colour",)
    if pixels.shape[2] > 4:
        notes += (f"extra samples beside the colours left out: {pixels.shape[2] - 4}",)
    return light, notes


def _bits(page: Any) -> int:
    bits = page.bitspersample
    return int(bits if isinstance(bits, int) else max(bits))
