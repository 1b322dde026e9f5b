"""Ranges of the settings: what each of them may be, alone and beside the others."""

from __future__ import annotations

from typing import TYPE_CHECKING, get_args

from sixflow.checks import A_SCALE, is_choice, is_number, is_scale, is_whole, require, require_choice
from sixflow.settings.region import as_rectangle
from sixflow.settings.types import Group, Interpolation, Lighting, Method, Reference

if TYPE_CHECKING:
    from sixflow.settings.settings import Settings

WIDEST = 2**20
"""Longest window and step, px: longer than the side of any frame."""

_WORDS = {
    "method": Method, "reference": Reference, "group": Group, "interpolation": Interpolation, "lighting": Lighting,
}  # fmt: skip


def check_ranges(settings: Settings) -> None:
    """Refuse a setting that is outside its range, by an `InputError` that names it, its value and the range."""
    s = settings
    for name, words in _WORDS.items():
        require_choice(name, getattr(s, name), get_args(words))
    for name, possible, wanted in (
        (
            "window",
            is_choice(s.window, ("auto",)) or (is_number(s.window) and 5 <= s.window <= WIDEST),
            f"must be from 5 to {WIDEST} px, or 'auto'; 31 is a good start",
        ),
        (
            "step",
            is_whole(s.step, 1, WIDEST),
            f"must be a whole number of pixels from 1 to {WIDEST}; 8 suits a window of 31",
        ),
        ("sharpen", is_whole(s.sharpen, 0, 16), "must be a whole number from 0 to 16"),
        (
            "lowpass",
            is_number(s.lowpass) and (s.lowpass == 0 or 0.4 <= s.lowpass <= 4),
            "must be 0 or from 0.4 to 4 px; 0.7 suits sharp textures",
        ),
        (
            "levels",
            s.levels is None or is_whole(s.levels, 0, 12),
            "must be from 0 to 12, or None to choose it from the frame",
        ),
        ("passes", is_whole(s.passes, 1, 1000), "must be a whole number from 1 to 1000"),
        (
            "tolerance",
            is_number(s.tolerance) and 0 < s.tolerance <= WIDEST,
            f"must be a positive number of pixels, at most {WIDEST}, such as 0.005",
        ),
        (
            "length_unit",
            isinstance(s.length_unit, str) and s.length_unit.strip() != "",
            "must name a unit, such as 'mm'",
        ),
        *(
            (name, isinstance(getattr(s, name), bool), "must be True or False")
            for name in ("float64", "robust", "fixed_pattern", "forward_backward", "replace_failed")
        ),
        *(
            (
                name,
                (value := getattr(s, name)) is None or is_scale(value),
                f"must be {A_SCALE}, or None if unknown",
            )
            for name in ("pixel_size", "frame_interval")
        ),
    ):
        require(possible, name, getattr(s, name), wanted)
    if s.roi is not None:
        as_rectangle(s.roi)


def check_together(settings: Settings) -> None:
    """Refuse settings that exclude each other."""
    s = settings
    require(
        s.group == "affine" or s.sharpen == 0,
        "sharpen",
        s.sharpen,
        f"must be 0 with group={s.group!r}: sharpening needs all six numbers; take group='affine'",
    )
    require(
        s.lowpass == 0 or s.method == "least_squares",
        "lowpass",
        s.lowpass,
        f"must be 0 with method={s.method!r}, whose operators have a band of their own; take method='least_squares'",
    )
