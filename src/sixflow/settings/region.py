"""Region: the region of interest as settings say it, a rectangle and polygons, checked and in one form.

Without NumPy, which the command line does not need to answer `--help`.
"""

from __future__ import annotations

from typing import Any, TypeAlias

from sixflow.errors import InputError

Polygon: TypeAlias = tuple[tuple[float, float], ...]
"""Corners (x, y), px."""
Span: TypeAlias = tuple[int | None, int | None]
"""First pixel, and the first that is outside; None for the edge of the frame."""

FURTHEST = 1e7
"""px: coordinates beyond are a mistake."""


def as_polygons(value: Any, name: str) -> tuple[Polygon, ...]:
    """Return one polygon or several, as nested numbers or text, in one form.

    Raises InputError if it is none of these, has a polygon of less than three corners, or numbers that are no places.

    Parameters
    ----------
    value : nested sequence, shape (corners, 2) or (polygons, corners, 2), or str
        As text, corners are "x,y" with blanks between, and polygons are separated by ";".
    name : str
        For messages.

    Examples
    --------
    >>> as_polygons("10,10 90,10 50,80", "polygons") == as_polygons([[10, 10], [90, 10], [50, 80]], "polygons")
    True
    """
    try:
        polygons = _from_text(value) if isinstance(value, str) else _from_numbers(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise _no_polygons(value, name) from error
    for polygon in polygons:
        if len(polygon) < 3:
            raise _no_polygons(value, name)
        if not all(abs(number) <= FURTHEST for corner in polygon for number in corner):
            raise InputError(
                f"{name}={_short(value)}: coordinates must be numbers of pixels, not beyond {FURTHEST:.0e}"
            )
    return polygons


def _no_polygons(value: Any, name: str) -> InputError:
    return InputError(
        f"{name}={_short(value)}: must be corners [[x, y], …] of a polygon, at least three, or several of these; as "
        "text '10,10 90,10 50,80; …'"
    )


def _from_text(text: str) -> tuple[Polygon, ...]:
    return tuple(
        tuple(_corner(corner.split(",")) for corner in polygon.split())
        for polygon in text.split(";")
        if polygon.strip()
    )


def _from_numbers(value: Any) -> tuple[Polygon, ...]:
    parts = [[*part] for part in value]
    if parts and not hasattr(parts[0][0] if parts[0] else (), "__len__"):
        parts = [parts]
    return tuple(tuple(_corner([*corner]) for corner in polygon) for polygon in parts)


def _corner(numbers: list[Any]) -> tuple[float, float]:
    x, y = (float(number) for number in numbers)
    return x, y


def _short(value: Any) -> str:
    text = " ".join(repr(value).split())
    return text if len(text) <= 80 else f"{text[:77]}…"


def as_rectangle(value: Any) -> tuple[Span, Span]:
    """Return columns and rows of a region "x0:x1,y0:y1".

    Raises InputError if it is no such text, or holds no pixel.

    Examples
    --------
    >>> as_rectangle("10:200,:50")
    ((10, 200), (None, 50))
    """
    parts = [part.split(":") for part in value.split(",")] if isinstance(value, str) else []
    spans: list[Span] = []
    try:
        spans = [(_end(first), _end(end)) for first, end in parts]
    except ValueError:
        spans = []
    usable = all((first or 0) >= 0 and (end is None or end > (first or 0)) for first, end in spans)
    if len(spans) != 2 or not usable:
        raise InputError(
            f"roi={value!r}: must be 'x0:x1,y0:y1', whole pixels of which x1 and y1 are the first outside, such as "
            "'100:400,50:300'; an open end as in '100:,:300' reaches to the edge"
        )
    return spans[0], spans[1]


def _end(text: str) -> int | None:
    return int(text) if text.strip() else None
