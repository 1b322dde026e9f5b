"""Types of the settings: the words that a setting may be, and the settings as keyword arguments."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, TypedDict

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import ArrayLike

    Guess: TypeAlias = ArrayLike | xr.Dataset | Callable[[Any, Any], Any]
else:
    Guess = Any  # NumPy and xarray are not loaded for the sake of a hint

Interpolation = Literal["cubic", "quintic"]
Lighting = Literal["auto", "none", "gain+offset", "local"]
Group = Literal["affine", "similarity", "euclidean", "translation"]
Search = Literal["auto", "pyramid", "spectrum", "guess"]
Method = Literal["least_squares", "eigenfilter"]
Reference = Literal["first", "middle", "second"]
Polygons: TypeAlias = Any
"""Corners [[x, y], …] of one polygon or several, or text, as given; kept as tuples (`sixflow.settings.region`)."""
Window: TypeAlias = Any
"""A number, or "auto" as it is asked for; what measures has a number (`sixflow.refine.resolution.ladder`)."""


class SettingsOptions(TypedDict, total=False):
    """The fields of `Settings` as keyword arguments, for editors and type checkers; `search` may be a first guess."""

    window: float | Literal["auto"]
    step: int
    method: Method
    reference: Reference
    group: Group
    sharpen: int
    interpolation: Interpolation
    lowpass: float
    lighting: Lighting
    robust: bool
    fixed_pattern: bool
    forward_backward: bool
    replace_failed: bool
    search: Search | Guess
    levels: int | None
    passes: int
    tolerance: float
    roi: str | None
    polygons: Polygons
    holes: Polygons
    float64: bool
    pixel_size: float | None
    length_unit: str
    frame_interval: float | None
