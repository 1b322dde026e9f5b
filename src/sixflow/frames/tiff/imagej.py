"""ImageJ: what its description says of a stack, and of pixels and times.

ImageJ writes lines of ``key=value`` in the description of the first page. The pixels of all pictures may follow the
first page without directories of their own.
"""

from __future__ import annotations

import math
from typing import Any

from sixflow.frames.units import seconds_in

ORDERS = {
    "czt": "TZC", "default": "TZC", "ctz": "ZTC", "zct": "TCZ", "ztc": "CTZ", "tcz": "ZCT", "tzc": "CZT",
}  # fmt: skip
"""Axes, slowest first, of what ImageJ calls the order."""


def is_imagej(description: str) -> bool:
    """Tell whether a description is one of ImageJ."""
    return description.startswith(("ImageJ=", "SCIFIO="))


def read_description(description: str) -> dict[str, str]:
    r"""Return the lines of a description of ImageJ as keys and values.

    Examples
    --------
    >>> read_description("ImageJ=1.54\nimages=3")["images"]
    '3'
    """
    pairs = (line.partition("=") for line in description.splitlines())
    return {key.strip(): value.strip() for key, mark, value in pairs if mark}


def whole(lines: dict[str, str], key: str) -> int:
    """Return a size, at least 1."""
    try:
        return max(1, min(int(lines.get(key, "1")), 2**40))
    except ValueError:
        return 1


def is_composite(lines: dict[str, str]) -> bool:
    """Tell whether ImageJ shows the channels of a stack as colours, so that they are channels indeed."""
    return lines.get("mode", "grayscale") != "grayscale"


def frame_interval(lines: dict[str, str]) -> float | None:
    """Return the time between successive frames, s; None where it is not stated."""
    scale, interval = seconds_in(lines.get("tunit", "s")), _positive(lines.get("finterval"))
    return None if scale is None or interval is None else interval * scale


def pixel_sizes(
    lines: dict[str, str], page: Any
) -> tuple[tuple[float, str] | None, tuple[float, str] | None]:
    """Return width and height of a pixel, each with its unit, from the resolution of a page.

    Parameters
    ----------
    lines : dict
        Of the description.
    page : tifffile.TiffPage
        Its tags state pixels per unit.
    """
    unit = lines.get("unit", "")
    units = unit, lines.get("yunit", unit)
    found = [_spacing(page.tags.valueof(code)) for code in (282, 283)]
    width, height = (None if size is None else (size, unit) for size, unit in zip(found, units, strict=True))
    return width, height


def _spacing(resolution: Any) -> float | None:
    """The inverse of a resolution, which is a fraction."""
    try:
        pixels, units = float(resolution[0]), float(resolution[1])
    except (TypeError, ValueError, IndexError):
        return None
    return units / pixels if pixels > 0 and units > 0 else None


def _positive(text: str | None) -> float | None:
    try:
        value = float(text) if text else 0.0
    except ValueError:
        return None
    return value if 0 < value < math.inf else None


def pixel_aspect(page: Any) -> float:
    """Return the height of a pixel over its width, from the resolution of a page; 1 where it states none."""
    width, height = (_spacing(page.tags.valueof(code)) for code in (282, 283))
    return height / width if width and height else 1.0
