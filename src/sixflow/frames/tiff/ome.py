"""OME: what the OME-XML of a file says of its pictures, and which of them lie in this file.

An OME-TIFF describes images (positions, scenes) of three axes T, C, Z, whose planes may lie in several files: all files
of a set hold the same XML. Only the planes of the file itself are taken. Open Microscopy Environment, model
2016-06.
"""

from __future__ import annotations

import dataclasses
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import TypeAlias

from sixflow.frames.units import seconds_in

Index: TypeAlias = tuple[int, int, int]
"""Numbers of time, channel and slice of a plane."""

_MISSING = 2000
"""Planes beyond the last page of the file that are still distinguished; more are claimed, but not there."""


@dataclasses.dataclass
class OmeImage:
    """One image of an OME-XML.

    Attributes
    ----------
    number : int
        Among the images of the XML.
    name : str
    sizes : dict
        Stated sizes of T, C and Z; channels whose samples stand in one page count once.
    channels : tuple of str
    planes : dict
        Page of each plane that lies in this file.
    elsewhere : set of str
        Other files that hold planes of the image.
    stamps : dict
        Time of each plane that states one, s.
    increment : float or None
        Time between successive frames, s.
    pixel_size : tuple
        Width and height of a pixel, each with its unit; None where it is not stated.
    origin : str
        Tells whether the times of two files count from the same moment.
    """

    number: int
    name: str
    sizes: dict[str, int]
    channels: tuple[str, ...]
    planes: dict[Index, int]
    elsewhere: set[str]
    stamps: dict[Index, float]
    increment: float | None
    pixel_size: tuple[tuple[float, str] | None, tuple[float, str] | None]
    origin: str


def is_ome(text: str) -> bool:
    """Tell whether a description is an OME-XML."""
    return re.search(r"<(\w+:)?OME[\s>]", text[:4000]) is not None


def read_ome(text: str, path: Path, pages: int) -> tuple[list[OmeImage], list[str]]:
    """Return the images of an OME-XML that have planes in a file, and notes.

    Parameters
    ----------
    text : str
        The XML; one that only names a companion file is replaced by that.
    path : Path
        The file.
    pages : int
        Number of its pages.
    """
    root = _parsed(text)
    if root is None:
        return [], ["its OME-XML is damaged: pages are read in the order of the file"]
    own, notes = str(root.get("UUID", "")), []
    companion = _child(root, "BinaryOnly")
    if companion is not None:
        file = path.parent / Path(str(companion.get("MetadataFile", ""))).name
        root = _parsed(file.read_bytes().decode("utf-8", "replace")) if file.is_file() else None
        if root is None:
            notes.append(
                f"its OME metadata is in {file.name!r}, which is not there: pages are read in the order of the file"
            )
            return [], notes
    files = {str(uuid.get("FileName", "")) for uuid in root.iter() if _tag(uuid) == "UUID"} - {""}
    images = []
    for number, element in enumerate(_children(root, "Image")):
        pixels = _child(element, "Pixels")
        if pixels is not None:
            images.append(_image(number, element, pixels, own, path, pages, files))
    found = [image for image in images if image.planes]
    if images and not found:
        notes.append("its OME-XML describes other files only: pages are read in the order of the file")
    return found, notes


def companion_files(path: Path) -> list[Path]:
    """Return the files that a companion file (``.companion.ome``) names, in its order, beside it."""
    root = _parsed(path.read_bytes().decode("utf-8", "replace"))
    names = [] if root is None else [e.get("FileName") for e in root.iter() if _tag(e) == "UUID"]
    return [path.parent / Path(name).name for name in dict.fromkeys(names) if name]


def _parsed(text: str) -> ElementTree.Element | None:
    if "<!ENTITY" in text or "<!DOCTYPE" in text:  # none is needed; they can grow without end
        return None
    text = re.sub(r"^\s*<\?xml[^>]*\?>", "", text.strip("\x00 \r\n\t\ufeff"))
    try:
        return ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError):
        return None


def _image(
    number: int,
    element: ElementTree.Element,
    pixels: ElementTree.Element,
    own: str,
    path: Path,
    pages: int,
    files: set[str],
) -> OmeImage:
    samples = [max(1, _whole(c.get("SamplesPerPixel"), 1)) for c in _children(pixels, "Channel")]
    sizes = {axis: max(1, _whole(pixels.get(f"Size{axis}"), 1)) for axis in "TCZ"}
    if samples:
        sizes["C"] = max(1, sizes["C"] - sum(samples) + len(samples))
    names = tuple(str(c.get("Name") or "") for c in _children(pixels, "Channel"))
    order = [axis for axis in str(pixels.get("DimensionOrder", "XYCZT")) if axis in "TCZ"]
    if sorted(order) != ["C", "T", "Z"]:
        order = ["C", "Z", "T"]
    planes, elsewhere = _own_planes(pixels, order, sizes, own, path, pages, files)
    date = next((e.text for e in element if _tag(e) in ("AcquisitionDate", "AcquiredDate")), "")
    origin = f"{element.get('ID')} {element.get('Name')} {date} {sorted(files)}" if elsewhere else ""
    return OmeImage(
        number,
        str(element.get("Name") or element.get("ID") or f"image {number}"),
        sizes,
        names if any(names) else (),
        planes,
        elsewhere,
        _stamps(pixels),
        _time(pixels.get("TimeIncrement"), pixels.get("TimeIncrementUnit")),
        (_length(pixels, "X"), _length(pixels, "Y")),
        origin,
    )


def _own_planes(
    pixels: ElementTree.Element,
    order: list[str],
    sizes: dict[str, int],
    own: str,
    path: Path,
    pages: int,
    files: set[str],
) -> tuple[dict[Index, int], set[str]]:
    """Which page holds each plane of this file, and the other files that hold planes."""
    planes: dict[Index, int] = {}
    elsewhere: set[str] = set()
    total = sizes["T"] * sizes["C"] * sizes["Z"]
    blocks = _children(pixels, "TiffData")
    if not blocks:
        return {_index(k, order, sizes): k for k in range(min(total, pages))}, elsewhere
    for block in blocks:
        uuid = _child(block, "UUID")
        if uuid is not None and not _is_own(uuid, own, path, files):
            elsewhere.add(str(uuid.get("FileName") or uuid.text or ""))
            continue
        first = {axis: max(0, _whole(block.get(f"First{axis}"), 0)) for axis in "TCZ"}
        begin, factor = 0, 1
        for axis in order:
            begin, factor = begin + first[axis] * factor, factor * sizes[axis]
        page = max(0, _whole(block.get("IFD"), 0))
        count = _whole(block.get("PlaneCount", block.get("NumPlanes")), 1 if block.get("IFD") else 0)
        count = count if count > 0 else max(0, pages - page)
        for k in range(min(count, total - begin, max(0, pages - page) + _MISSING)):
            planes[_index(begin + k, order, sizes)] = page + k
    return planes, elsewhere


def _is_own(uuid: ElementTree.Element, own: str, path: Path, files: set[str]) -> bool:
    """A block names this file by its identifier or by its name; a file that was renamed is the only one named."""
    text, name = (uuid.text or "").strip(), Path(str(uuid.get("FileName") or "")).name
    if name == path.name:
        return True
    if own and text:
        return text == own
    return not name or (len(files) == 1 and not own)


def _index(k: int, order: list[str], sizes: dict[str, int]) -> Index:
    place = {}
    for axis in order:
        k, place[axis] = divmod(k, sizes[axis])
    return place["T"], place["C"], place["Z"]


def _stamps(pixels: ElementTree.Element) -> dict[Index, float]:
    stamps = {}
    for plane in _children(pixels, "Plane"):
        seconds = _time(plane.get("DeltaT"), plane.get("DeltaTUnit"), least=None)
        if seconds is not None:
            index = tuple(_whole(plane.get(f"The{axis}"), 0) for axis in "TCZ")
            stamps[index[0], index[1], index[2]] = seconds
    return stamps


def _time(value: str | None, unit: str | None, least: float | None = 0.0) -> float | None:
    """A time in s; None where it is not stated, or not above `least`."""
    scale, number = seconds_in(unit or "s"), _number(value)
    if number is None or scale is None or (least is not None and number <= least):
        return None
    return number * scale


def _length(pixels: ElementTree.Element, axis: str) -> tuple[float, str] | None:
    size = _number(pixels.get(f"PhysicalSize{axis}"))
    return (size, pixels.get(f"PhysicalSize{axis}Unit") or "µm") if size is not None and size > 0 else None


def _number(value: str | None) -> float | None:
    try:
        number = float(value) if value else None
    except ValueError:
        return None
    return number if number is not None and abs(number) < 1e300 else None


def _whole(value: str | None, missing: int) -> int:
    number = _number(value)
    return missing if number is None else int(max(-1.0, min(number, 2.0**40)))


def _tag(element: ElementTree.Element) -> str:
    return str(element.tag).rpartition("}")[2]


def _children(element: ElementTree.Element, tag: str) -> list[ElementTree.Element]:
    return [child for child in element if _tag(child) == tag]


def _child(element: ElementTree.Element, tag: str) -> ElementTree.Element | None:
    return next(iter(_children(element, tag)), None)
