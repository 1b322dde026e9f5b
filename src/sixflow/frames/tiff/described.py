"""Described: stacks whose writer says in a description what they are: OME in XML, ImageJ in lines, tifffile in JSON."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Mapping
from typing import Any

from sixflow.frames.axes import Axis
from sixflow.frames.tiff import colour, imagej, ome
from sixflow.frames.tiff.chain import Chain
from sixflow.frames.tiff.page import DAMAGE, Pages, Plane
from sixflow.frames.tiff.series import LEFT_OUT, Place, Series, in_order, places


def of_ome(image: ome.OmeImage, pages: Pages, chain: Chain) -> Series:
    """Return the stack of an image of an OME-XML, as far as it lies in this file."""
    first = pages.page(next((page for page in image.planes.values() if page < len(chain.offsets)), 0))
    axes = [Axis(code, sorted({index[k] for index in image.planes})) for k, code in enumerate("TCZ")]
    samples = colour.channels(first)
    sampled = samples > 1 and len(axes[1].numbers) == 1
    if not image.elsewhere:  # what is missing between others is a missing frame
        axes[0] = Axis("T", range(axes[0].numbers[-1] + 1))
    axes[1] = Axis("C", range(samples) if sampled else axes[1].numbers, image.channels)

    def plane(index: Mapping[str, int]) -> Plane | None:
        page = image.planes.get((index.get("T", 0), 0 if sampled else index.get("C", 0), index.get("Z", 0)))
        return None if page is None else Plane(page, sample=index["C"] if sampled else None)

    return Series(
        image.number, image.name, (first.imagelength, first.imagewidth), axes, plane,
        stated=not image.elsewhere, times=None if image.elsewhere else image.sizes["T"], interval=image.increment,
        stamps=image.stamps, pixel=image.pixel_size, origin=image.origin,
    )  # fmt: skip


def of_imagej(lines: dict[str, str], pages: Pages, chain: Chain) -> Series:
    """Return the stack that the lines of ImageJ describe."""
    first, interval = pages.page(0), imagej.frame_interval(lines)
    samples = colour.channels(first)
    order, sizes, notes = _imagej_sizes(lines, int(first.samplesperpixel), len(chain.offsets))
    stored = [Axis(code, range(sizes[code]), _labels(pages, code, order, sizes)) for code in order]
    if (
        interval is not None
        and [a.code for a in stored if len(a.numbers) > 1] == ["C"]
        and not imagej.is_composite(lines)
    ):
        notes.append("the channels (C) of the stack are read as frames over time: it states a frame interval")
        stored = [Axis("T", axis.numbers) for axis in stored if axis.code == "C"]
    axes = (
        [axis for axis in stored if axis.code != "C"] + [Axis("C", range(samples))] if samples > 1 else stored
    )
    at = places(math.prod(sizes.values()), pages, chain, first)
    return Series(
        0, "", (first.imagelength, first.imagewidth), axes,
        in_order([axis for axis in stored if samples == 1 or axis.code != "C"], at, samples > 1), stated=True,
        interval=interval, pixel=imagej.pixel_sizes(lines, first), aspect=imagej.pixel_aspect(first), notes=notes,
    )  # fmt: skip


def _imagej_sizes(lines: dict[str, str], samples: int, pages: int) -> tuple[str, dict[str, int], list[str]]:
    """Order and sizes of the axes of a stack of ImageJ, and notes; samples of a pixel are no pictures."""
    order = imagej.ORDERS.get(lines.get("order", "czt").lower(), "TZC")
    sizes = {
        code: imagej.whole(lines, key) for code, key in (("T", "frames"), ("Z", "slices"), ("C", "channels"))
    }
    if samples > 1 and sizes["C"] == samples:
        sizes["C"] = 1
    number = math.prod(sizes.values())
    if number == 1:
        return "T", {"T": max(imagej.whole(lines, "images"), pages)}, []
    if number < pages:
        note = f"ImageJ's description states {number} pages, the file has {pages}: all are read"
        return "T", {"T": pages}, [note]
    return order, sizes, []


def _labels(pages: Pages, code: str, order: str, sizes: Mapping[str, int]) -> tuple[str, ...]:
    """Labels of ImageJ along channels or slices: those of the pictures at 0 of the other axes."""
    if code not in "CZ" or sizes[code] == 1:
        return ()
    try:
        labels = [str(label) for label in (pages.tif.imagej_metadata or {}).get("Labels", ())]
    except DAMAGE:
        return ()
    step = math.prod(sizes[axis] for axis in order[order.index(code) + 1 :])
    found = tuple(labels[: step * sizes[code] : step])
    return found if len(found) == sizes[code] == len(set(found)) else ()


def of_tifffile(pages: Pages, chain: Chain) -> list[Series]:
    """Return stacks that tifffile wrote; none where each holds a single picture, so that pages are frames."""
    found: list[Series] = []
    number = 0
    while number < len(chain.offsets):
        page = pages.page(number)
        stated = _stated_shape(page)
        axes = None if stated is None else _leading_axes(page, *stated[:2])
        if stated is None or axes is None:
            return []
        planes = math.prod(len(axis.numbers) for axis in axes)
        at = _shifted(
            places(planes, pages, dataclasses.replace(chain, offsets=chain.offsets[number:]), page), number
        )
        if not page.subfiletype & LEFT_OUT:
            found.append(_shaped_series(len(found), stated[2], page, axes, at))
        second = at(1) if planes > 1 else None
        number += 1 if second is not None and second.offset is not None else planes
    if len(found) > 1 and all(math.prod(len(axis.numbers) for axis in one.axes) == 1 for one in found):
        return []
    return found


def _shaped_series(number: int, name: str, page: Any, axes: list[Axis], at: Place) -> Series:
    samples = colour.channels(page)
    sampled = samples > 1 and all(axis.code != "C" for axis in axes)
    notes = []
    if colour.photometric(page) == colour.RGB and page.axes.startswith("S") and not axes:
        notes.append(
            f"{page.shape[0]} planes are read as the colours of one picture; if they are frames, write them with "
            "photometric='minisblack'"
        )
    return Series(
        number, name, (page.imagelength, page.imagewidth),
        [*axes, Axis("C", range(samples))] if sampled else axes, in_order(axes, at, sampled), stated=True,
        aspect=imagej.pixel_aspect(page), notes=notes,
    )  # fmt: skip


def _leading_axes(page: Any, shape: list[int], letters: list[str]) -> list[Axis] | None:
    """Axes of a stated shape before those of its pages; None where the two do not fit."""
    total, size = math.prod(shape), math.prod(page.shape)
    if total == 0 or total % size:
        return None
    leading = list(shape)
    while leading and math.prod(leading) > total // size:
        leading.pop()
    if math.prod(leading) != total // size:
        return None
    codes = letters[: len(leading)] if len(letters) == len(shape) else [f"Q{k}" for k in range(len(leading))]
    return [Axis(code, range(length)) for code, length in zip(codes, leading, strict=True) if length > 1]


def _shifted(found: Place, number: int) -> Place:
    def at(k: int) -> Plane | None:
        place = found(k)
        return None if place is None else dataclasses.replace(place, page=place.page + number)

    return at


def _stated_shape(page: Any) -> tuple[list[int], list[str], str] | None:
    """Shape, axes and name that tifffile wrote into the description of a page."""
    for text in (page.description, page.description1):
        if str(text).startswith('{"shape":'):
            try:
                stated = json.loads(text)
                shape = [max(0, int(length)) for length in stated["shape"]]
                letters = list(str(stated.get("axes", "")))
            except (ValueError, TypeError, KeyError):
                return None
            return shape, letters, str(stated.get("name", ""))
    return None
