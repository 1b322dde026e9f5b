"""Outlines: polygons and rectangles as pixels.

A pixel is inside a polygon if its centre is: centres lie at whole numbers, x to the right and y down. A ray to the left
crosses the outline an odd number of times (even–odd rule), also where it crosses itself. Of a centre that lies exactly
on the outline, the left and upper edges count as inside, the right and lower ones do not: polygons that share an edge
share no pixel, and leave none out.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.errors import InputError
from sixflow.settings.region import Polygon, Span, as_rectangle


def inside_polygon(shape: tuple[int, int], *outlines: Any) -> NDArray[np.bool_]:
    """Pixels inside a polygon, or inside an odd number of several.

    Parameters
    ----------
    shape : (int, int)
        Height and width of the frames, px.
    *outlines : array_like, shape (corners, 2)
        x and y of the corners, px; the last is joined with the first.

    Returns
    -------
    bool array, shape `shape`

    Examples
    --------
    >>> inside_polygon((4, 6), [(1, 1), (5, 1), (5, 3), (1, 3)]).astype(int)
    array([[0, 0, 0, 0, 0, 0],
           [0, 1, 1, 1, 1, 0],
           [0, 1, 1, 1, 1, 0],
           [0, 0, 0, 0, 0, 0]])
    """
    height, width = shape
    crossings = np.zeros((height, width + 1), np.uint8)  # of the outline, counted where a row comes past it
    for outline in outlines:
        corners = np.asarray(outline, dtype=np.float64).reshape(-1, 2)
        for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            first, last = (min(max(math.ceil(y), 0), height) for y in sorted((y0, y1)))
            rows = np.arange(first, last)
            if rows.size:
                at = x0 + (rows - y0) * ((x1 - x0) / (y1 - y0))
                np.add.at(crossings, (rows, np.clip(np.ceil(at), 0, width).astype(int)), 1)
    inside: NDArray[np.bool_] = np.cumsum(crossings, axis=1, dtype=np.uint32)[:, :width] % 2 == 1
    return inside


def region_of(
    shape: tuple[int, int], roi: str | None, polygons: Sequence[Polygon], holes: Sequence[Polygon]
) -> NDArray[np.bool_] | None:
    """Pixels of the region that the settings describe: in `roi`, in one of `polygons`, in none of `holes`.

    Raises InputError if the rectangle reaches out of the frame, a polygon holds no pixel of it, or nothing is left.

    Returns
    -------
    bool array, shape `shape`, or None where nothing is said
    """
    if roi is None and not polygons and not holes:
        return None
    height, width = shape
    region = np.ones(shape, np.bool_)
    if roi is not None:
        columns, rows = as_rectangle(roi)
        if not (_reaches(columns) <= width and _reaches(rows) <= height):
            raise InputError(
                f"roi={roi!r}: reaches out of the frames, which have {width} columns (x) and {height} rows (y)"
            )
        region[:] = False
        region[slice(*rows), slice(*columns)] = True
    if polygons:
        region &= _union(shape, polygons, "polygons")
    if holes:
        region &= ~_union(shape, holes, "holes")
    if not region.any():
        given = [f"roi={roi!r}"] * (roi is not None) + ["polygons"] * bool(polygons) + ["holes"] * bool(holes)
        raise InputError(f"{', '.join(given)}: no pixel is left to measure; check the coordinates (x, y)")
    return region


def _reaches(span: Span) -> int:
    """Pixels that a frame must have for a span to lie in it."""
    return (span[0] or 0) + 1 if span[1] is None else span[1]


def _union(shape: tuple[int, int], polygons: Iterable[Polygon], name: str) -> NDArray[np.bool_]:
    total = np.zeros(shape, np.bool_)
    for number, polygon in enumerate(polygons):
        inside = inside_polygon(shape, polygon)
        if not inside.any():
            raise InputError(
                f"{name}: polygon {number} holds no pixel of the frames, which have {shape[1]} columns (x) and "
                f"{shape[0]} rows (y)"
            )
        total |= inside
    return total
