"""Stacks: the series of a TIFF, by what its writer says of them.

Writers disagree on where this stands: OME in XML, ImageJ and tifffile in descriptions of their own, microscopes in
private tags, which tifffile knows, and most say nothing: then the pages are the frames.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sixflow.errors import FrameFileError
from sixflow.frames.axes import Axis
from sixflow.frames.tiff import colour, imagej, ome
from sixflow.frames.tiff.chain import Chain
from sixflow.frames.tiff.described import of_imagej, of_ome, of_tifffile
from sixflow.frames.tiff.log import captured_log
from sixflow.frames.tiff.page import DAMAGE, Pages, Plane, damaged, is_contiguous
from sixflow.frames.tiff.series import LEFT_OUT, Series, in_order

_SPECIAL = (
    *("lsm", "mmstack", "ndtiff", "fluoview", "stk", "sis", "svs", "scn", "qpi", "ndpi", "bif", "avs", "eer"),
    *("philips", "scanimage", "nih", "mdgel"),
)
"""Kinds whose private tags tifffile knows."""

_FEW = 0.25
"""Share of the pages that may be unlike the others: single bad frames rather than a series of their own."""


def find_series(pages: Pages, chain: Chain, path: Path) -> list[Series]:
    """Return the stacks of pictures in a file; FrameFileError if there is none that could be read."""
    first = pages.tif.pages.first
    text = str(first.description or "")
    if ome.is_ome(text):
        images, notes = ome.read_ome(text, path, len(chain.offsets))
        found = [of_ome(image, pages, chain) for image in images]
        if not found:
            found = _special(pages, path) or _plain(pages, chain, path)
            found[0].notes += notes
        return found
    special = _special(pages, path)
    if special:
        return special
    if imagej.is_imagej(text):
        return [of_imagej(imagej.read_description(text), pages, chain)]
    return of_tifffile(pages, chain) or _plain(pages, chain, path)


def _special(pages: Pages, path: Path) -> list[Series]:
    """Stacks of the kinds whose private tags tifffile knows."""
    tif = pages.tif
    try:
        if not any(getattr(tif, f"is_{kind}", False) for kind in _SPECIAL):
            return []
        with captured_log():
            stacks = [one for one in tif.series if not int(one.keyframe.subfiletype) & LEFT_OUT]
            found = [_of_tifffile(number, stack, tif, path) for number, stack in enumerate(stacks)]
        if len(found) == 1 and {axis.code for axis in found[0].axes} == {"I"}:
            return []  # nothing but pages, which tifffile may have guessed the places of
        return found
    except FrameFileError:
        raise
    except DAMAGE:
        return []


def _of_tifffile(number: int, stack: Any, tif: Any, path: Path) -> Series:
    key = stack.keyframe
    leading = [(code, size) for code, size in zip(stack.axes, stack.shape, strict=True) if code not in "YXS"]
    axes = [Axis("P" if code == "R" else code, range(size)) for code, size in leading if size > 1]
    planes = math.prod(size for _, size in leading)
    if stack.dataoffset is not None and is_contiguous(key):
        size = math.prod(key.shape) * key.dtype.itemsize
        begin, page = int(stack.dataoffset), int(key.index)
        total = path.stat().st_size
        return Series(
            number, stack.name, (key.imagelength, key.imagewidth), axes,
            in_order(axes, lambda k: Plane(page, begin + k * size) if begin + (k + 1) * size <= total else None),
            stated=True,
        )  # fmt: skip
    if len(stack) != planes:
        raise FrameFileError(
            f"{path}: a stack of kind {stack.kind!r} that is not understood; save it as a plain TIFF"
        )
    places = [_place_of(stack[k], key, tif) for k in range(planes)]
    return Series(
        number,
        stack.name,
        (key.imagelength, key.imagewidth),
        axes,
        in_order(axes, places.__getitem__),
        stated=True,
    )


def _place_of(page: Any, key: Any, tif: Any) -> Plane | None:
    if page is None or page.parent is not tif:
        return None
    if page.offset is None or page.offset == 0:
        return Plane(int(key.index), int(page.dataoffsets[0]))
    return Plane(int(page.index))


def _plain(pages: Pages, chain: Chain, path: Path) -> list[Series]:
    """Pages of which nothing is said: frames in their order, where they are alike."""
    kinds: dict[int, tuple[Any, ...] | None] = {}
    for number in range(len(chain.offsets)):
        try:
            with captured_log():
                page = pages.tif.pages.get(number)
            if int(page.subfiletype) & LEFT_OUT:
                continue
            kinds[number] = (
                page.imagelength,
                page.imagewidth,
                str(page.dtype),
                page.imagedepth,
                colour.channels(page),
            )
        except DAMAGE:
            kinds[number] = None
    counts = Counter(kind for kind in kinds.values() if kind is not None)
    if not counts:
        if len(chain.offsets):
            pages.page(0)  # whose error says why
            kinds, counts = {0: (0,)}, Counter()
        raise damaged(path, chain.broken or "it holds no pages", bool(chain.broken))
    common, most = counts.most_common(1)[0]
    others = sum(counts.values()) - most
    if others and not (most > 1 and (others == 1 or others <= _FEW * len(kinds))):
        return [
            _of_pages(k, [n for n, one in kinds.items() if one == kind], kind, "", pages)
            for k, kind in enumerate(counts)
        ]  # fmt: skip
    return [_of_pages(0, list(kinds), common, chain.broken, pages)]


def _of_pages(number: int, members: list[int], kind: tuple[Any, ...], broken: str, pages: Pages) -> Series:
    """Frames that are pages; one more, which is missing, where the chain of pages breaks off."""
    height, width, _, depth, samples = kind
    axes = [Axis("T", range(len(members) + bool(broken)))]
    axes += [Axis("Z", range(depth))] if depth > 1 else []
    axes += [Axis("C", range(samples))] if samples > 1 else []

    def plane(index: Mapping[str, int]) -> Plane | None:
        k = index.get("T", 0)
        if k >= len(members):
            return None
        return Plane(
            members[k],
            depth=index.get("Z") if depth > 1 else None,
            sample=index.get("C") if samples > 1 else None,
        )

    first = pages.tif.pages.get(members[0])
    return Series(number, "", (height, width), axes, plane, aspect=imagej.pixel_aspect(first))
