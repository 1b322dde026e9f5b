"""ImageJ: regions of interest that were drawn in ImageJ or Fiji, .roi and RoiSet.zip.

Their coordinates are those of pixel corners: the centre of pixel (0, 0) is at (0.5, 0.5). What has no area (lines,
angles, points) is no region. Files are read by Christoph Gohlke's `roifile`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from sixflow.errors import FrameFileError, InputError
from sixflow.masks.outlines import inside_polygon
from sixflow.settings.region import FURTHEST

Drawn: TypeAlias = Callable[[tuple[int, int]], NDArray[np.bool_]]
"""From the shape of the frames to the pixels inside."""

SUFFIXES = (".roi", ".zip")
_ARC = np.linspace(0, np.pi / 2, 17)


@dataclasses.dataclass(frozen=True)
class Region:
    """A region of interest: its name, the pixels inside, and what should be known of it."""

    name: str
    inside: Drawn
    notes: tuple[str, ...] = ()


def read_regions(path: Path) -> list[Region]:
    """Read the regions of a .roi or .zip file, in their order.

    Raises
    ------
    FrameFileError
        If the file cannot be read, or holds none.
    InputError
        If a region has no area.
    """
    try:
        import roifile
    except ImportError as error:
        raise InputError(
            f"mask {path}: regions of ImageJ need the package roifile, which is not installed; run: pip install roifile"
        ) from error
    try:
        found = roifile.roiread(path)
    except Exception as error:
        raise FrameFileError(
            f"mask {path}: cannot be read as regions of ImageJ ({type(error).__name__}: {error}); save them again"
        ) from error
    rois = found if isinstance(found, list) else [found]
    if not rois:
        raise FrameFileError(
            f"mask {path}: holds no region of ImageJ (.roi); save the ROI manager's set again"
        )
    return [_region(roi, path, number) for number, roi in enumerate(rois, start=1)]


def _region(roi: Any, path: Path, number: int) -> Region:
    from roifile import ROI_OPTIONS, ROI_TYPE

    name = roi.name or f"region {number}"
    notes = []
    if roi.t_position > 0 or roi.position > 0 or roi.z_position > 0:
        notes.append(f"{name}: its position in the stack is not used")
    if roi.multi_coordinates is not None:
        return Region(name, _polygon(_outlines(roi, path, name)), tuple(notes))
    if roi.roitype == ROI_TYPE.RECT:
        return Region(name, _rectangle(*_box(roi), roi.rounded_rect_arc_size), tuple(notes))
    if roi.roitype == ROI_TYPE.OVAL:
        return Region(name, _oval(*_box(roi)), tuple(notes))
    if roi.roitype in (ROI_TYPE.POLYGON, ROI_TYPE.FREEHAND, ROI_TYPE.TRACED):
        if ROI_OPTIONS.SPLINE_FIT in roi.options:
            notes.append(f"{name}: is drawn as a spline; its corners are joined by straight lines here")
        return Region(name, _polygon(_outlines(roi, path, name)), tuple(notes))
    raise InputError(
        f"mask {path}: {name!r} is of ImageJ's type {roi.roitype.name.lower()}, which encloses no pixels; "
        "give areas: rectangles, ovals, polygons, freehand or traced regions"
    )


def _outlines(roi: Any, path: Path, name: str) -> list[NDArray[np.float64]]:
    try:
        outlines = [np.asarray(one, np.float64).reshape(-1, 2) - 0.5 for one in roi.coordinates(multi=True)]
    except Exception as error:  # paths of other kinds, or cut short
        raise FrameFileError(
            f"mask {path}: the outline of {name!r} cannot be read ({error}); convert it to a polygon in ImageJ"
        ) from error
    outlines = [one for one in outlines if len(one) > 2]
    if not outlines or not all((np.abs(one) <= FURTHEST).all() for one in outlines):
        raise InputError(f"mask {path}: the outline of {name!r} encloses no pixels; draw it again")
    return outlines


def _box(roi: Any) -> tuple[float, float, float, float]:
    """Left, top, right, bottom, px of centres."""
    if roi.subpixelrect:
        left, top, right, bottom = roi.xd, roi.yd, roi.xd + roi.widthd, roi.yd + roi.heightd
    else:
        left, top, right, bottom = roi.left, roi.top, roi.right, roi.bottom
    box = [min(max(float(end) - 0.5, -FURTHEST), FURTHEST) for end in (left, top, right, bottom)]
    return box[0], box[1], box[2], box[3]


def _polygon(outlines: list[NDArray[np.float64]]) -> Drawn:
    return lambda shape: inside_polygon(shape, *outlines)


def _rectangle(left: float, top: float, right: float, bottom: float, arc: float) -> Drawn:
    """A rectangle, its corners rounded by quarters of circles of the diameter `arc`."""
    radius = min(max(arc, 0) / 2, (right - left) / 2, (bottom - top) / 2)
    if radius <= 0:
        return _polygon([np.array([(left, top), (right, top), (right, bottom), (left, bottom)])])
    centres = (
        (right - radius, bottom - radius), (left + radius, bottom - radius),
        (left + radius, top + radius), (right - radius, top + radius),
    )  # fmt: skip
    corners = [
        np.stack(
            [x + radius * np.cos(_ARC + k * np.pi / 2), y + radius * np.sin(_ARC + k * np.pi / 2)], axis=-1
        )
        for k, (x, y) in enumerate(centres)
    ]
    return _polygon([np.concatenate(corners)])


def _oval(left: float, top: float, right: float, bottom: float) -> Drawn:
    """The ellipse that touches the sides of a box."""

    def inside(shape: tuple[int, int]) -> NDArray[np.bool_]:
        y, x = np.ogrid[: shape[0], : shape[1]]
        half_width, half_height = max(right - left, 1e-9) / 2, max(bottom - top, 1e-9) / 2
        from_centre = ((x - (left + right) / 2) / half_width) ** 2 + (
            (y - (top + bottom) / 2) / half_height
        ) ** 2
        return np.asarray(from_centre <= 1)

    return inside
