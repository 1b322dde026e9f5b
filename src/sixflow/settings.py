"""Settings of a measurement: one frozen dataclass = keyword arguments = command line = TOML file =
attributes of the result.
"""

from __future__ import annotations

import dataclasses
import json
import math
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, TypedDict, get_args

from sixflow.errors import InputError

if TYPE_CHECKING:
    from sixflow.search.guess import Guess
else:
    Guess = Any

Interpolation = Literal["cubic", "quintic"]
Lighting = Literal["auto", "none", "gain+offset", "local"]
Group = Literal["affine", "similarity", "euclidean", "translation"]
Search = Literal["auto", "pyramid", "spectrum", "guess"]
Method = Literal["least_squares", "eigenfilter"]
Reference = Literal["first", "middle", "second"]
Window: TypeAlias = Any
"""A number, or "auto" as it is asked for; what measures has a number (`sixflow.resolution.ladder`)."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Settings:
    """How a field is measured. Every choice that changes a number of the result is here, and nothing else.

    Parameters
    ----------
    window : float or "auto"
        Side of the square subset of the same noise, px, at least 5. The weight is a Gaussian of
        σ = window/√(4π) = window/3.545. Larger: less noise, less resolution. "auto" measures with windows from
        8 to 62 px, sharpened, and takes at each point the one of least expected error; `resolution` in the
        field says how fine it is.
    step : int
        Distance between grid points, px, at least 1. It sets the density of points, not the resolution.
    method : {"least_squares", "eigenfilter"}
        What compares the frames: every pixel, or the responses of an array of operators for all six
        generators (`sixflow.eigenfilters`), which do not see changes of brightness and contrast.
    reference : {"first", "middle", "second"}
        Frame in which the grid points lie: the motion is that of what is at the point in frame 0; in the middle
        between the frames, to which both are brought by half (central, second order in time, for flows); or in
        frame 1. u and v always point from frame 0 to frame 1.
    group : {"affine", "similarity", "euclidean", "translation"}
        Motions that a window may make: all six numbers; shift, rotation and zoom; shift and rotation;
        shift alone. Fewer have less noise, and are wrong where the motion is not of the group. Numbers
        that the group does not have are 0 by assumption, with a covariance of 0.
    sharpen : int
        0 to 16: finer resolution of the same window, for more noise; 1 halves the period that is resolved for
        no more noise in the displacement. With `window="auto"`, 0 means 2.
    interpolation : {"cubic", "quintic"}
        B-spline that interpolates the moved frame; quintic has the least bias and costs more.
    lowpass : float
        Standard deviation of a Gaussian over both frames before they are compared, px, 0 or from 0.4 to 4: against bias
        where the texture is as fine as the pixels (sharp speckles, particles of less than 3 px, frames deformed by
        software). 0.7 costs 10 % of noise there, and next to none for coarser texture. It needs
        `method="least_squares"`.
    lighting : {"auto", "none", "gain+offset", "local"}
        What may change in the light between the frames: nothing; gain and offset of each window (the
        zero-normalised criterion); or the local mean and contrast, divided out of each frame beforehand.
        "auto" takes gain and offset where the frames differ in contrast or brightness, else nothing.
    robust : bool
        Give little weight to pixels whose residual is far beyond what noise explains: unmatched particles,
        glints, dead pixels. It changes nothing where there are none. Of `method="eigenfilter"`, it
        replaces dead pixels alone.
    forward_backward : bool
        Measure from frame 1 to frame 0 too, and flag points that do not return: twice the time.
    replace_failed : bool
        Give failed points what their neighbours predict, with a covariance that holds their scatter. Such points are
        flagged `replaced`, and are never counted as measured.
    search : {"auto", "pyramid", "spectrum"} or a first guess
        How large motion is found. "pyramid": from coarse to fine. "spectrum": from the affine map that the whole
        frames have in common, of any turn, zoom, shear and shift. "auto": from coarse to fine, and for points that
        are missed so, growth from their neighbours and the map of "spectrum". A first guess is given to a
        measurement in place of the word, and stands here as "guess": six numbers (u, v, divergence, curl, stretch,
        shear) about pixel (0, 0), a 2 × 3 or 3 × 3 matrix of (x, y, 1), a field, or a function (x, y) → (u, v).
    levels : int or None
        Number of halvings of the frame that the search for large motion starts from, 0 to 12. None
        chooses it from frame and window.
    passes : int
        Upper limit of passes at full resolution, at least 1.
    tolerance : float
        A point has converged when it is closer than this to where more passes would bring it, px,
        greater than 0.
    float64 : bool
        Compute in double precision: twice the memory, for noise-free studies.
    pixel_size : float or None
        Length of one pixel in the object, in `length_unit`. It changes no measured number; it lets the
        field speak physical units.
    length_unit : str
        Unit of `pixel_size`.
    frame_interval : float or None
        Time between successive frames of the recording, s; with `pairs="double"`, between the two frames of a pair. A
        pair of frames k apart takes k times that. None takes the times of the frames from the recording, where it has
        them.

    Raises
    ------
    InputError
        If a value is outside its range; the message names the setting, the value and the range.

    Examples
    --------
    >>> Settings(window=41).replace(step=4)
    Settings(window=41, step=4)
    >>> Settings(step=0)
    Traceback (most recent call last):
    sixflow.errors.InputError: step=0: must be a whole number of pixels, at least 1; 8 suits a window of 31
    """

    window: Window = 31
    step: int = 8
    method: Method = "least_squares"
    reference: Reference = "first"
    group: Group = "affine"
    sharpen: int = 0
    interpolation: Interpolation = "quintic"
    lowpass: float = 0.0
    lighting: Lighting = "auto"
    robust: bool = True
    forward_backward: bool = False
    replace_failed: bool = False
    search: Search = "auto"
    levels: int | None = None
    passes: int = 8
    tolerance: float = 0.005
    float64: bool = False
    pixel_size: float | None = None
    length_unit: str = "mm"
    frame_interval: float | None = None

    def __post_init__(self) -> None:
        if isinstance(self.window, float) and self.window.is_integer():
            object.__setattr__(self, "window", int(self.window))  # 31.0 and 31 are the same setting
        _require(
            self.window == "auto" or (_is_number(self.window) and self.window >= 5),
            "window",
            self.window,
            "must be at least 5 px, or 'auto'; 31 is a good start",
        )
        _require(
            _is_whole(self.step, 1),
            "step",
            self.step,
            "must be a whole number of pixels, at least 1; 8 suits a window of 31",
        )
        _require(
            _is_whole(self.sharpen, 0, 16), "sharpen", self.sharpen, "must be a whole number from 0 to 16"
        )
        _require_choice("method", self.method, get_args(Method))
        _require_choice("reference", self.reference, get_args(Reference))
        _require_choice("group", self.group, get_args(Group))
        _require(
            self.group == "affine" or self.sharpen == 0,
            "sharpen",
            self.sharpen,
            f"must be 0 with group={self.group!r}: sharpening needs all six numbers; take group='affine'",
        )
        _require(
            self.window != "auto" or (self.method == "least_squares" and self.group == "affine"),
            "window",
            self.window,
            "needs method='least_squares' and group='affine'; otherwise give a number of pixels, such as 31",
        )
        _require_choice("interpolation", self.interpolation, get_args(Interpolation))
        _require(
            _is_number(self.lowpass) and (self.lowpass == 0 or 0.4 <= self.lowpass <= 4),
            "lowpass",
            self.lowpass,
            "must be 0 or from 0.4 to 4 px; 0.7 suits sharp textures",
        )
        _require(
            self.lowpass == 0 or self.method == "least_squares",
            "lowpass",
            self.lowpass,
            f"must be 0 with method={self.method!r}, whose operators have a band of their own; "
            "take method='least_squares'",
        )
        _require_choice("search", self.search, get_args(Search))
        _require_choice("lighting", self.lighting, get_args(Lighting))
        _require(
            self.levels is None or _is_whole(self.levels, 0, 12),
            "levels",
            self.levels,
            "must be from 0 to 12, or None to choose it from the frame",
        )
        _require(_is_whole(self.passes, 1), "passes", self.passes, "must be a whole number, at least 1")
        _require(
            _is_number(self.tolerance) and self.tolerance > 0,
            "tolerance",
            self.tolerance,
            "must be a positive number of pixels, such as 0.005",
        )
        for name in ("float64", "robust", "forward_backward", "replace_failed"):
            value = getattr(self, name)
            _require(isinstance(value, bool), name, value, "must be True or False")
        for name in ("pixel_size", "frame_interval"):
            value = getattr(self, name)
            _require(
                value is None or (_is_number(value) and value > 0),
                name,
                value,
                "must be a positive number, or None if unknown",
            )
        _require(
            isinstance(self.length_unit, str) and self.length_unit.strip() != "",
            "length_unit",
            self.length_unit,
            "must name a unit, such as 'mm'",
        )

    def __repr__(self) -> str:
        """Show only what differs from the defaults."""
        changed = {
            f.name: value for f in dataclasses.fields(self) if (value := getattr(self, f.name)) != f.default
        }
        return f"Settings({', '.join(f'{name}={value!r}' for name, value in changed.items())})"

    @property
    def sigma(self) -> float:
        """Standard deviation of the Gaussian weight, px: window/√(4π)."""
        return float(self.window) / math.sqrt(4 * math.pi)

    def replace(self, **changes: Any) -> Settings:
        """Return the settings with some values changed.

        Raises
        ------
        InputError
            If a name is no setting, or a value is out of range.
        """
        unknown = sorted(set(changes) - _names())
        _require(
            not unknown,
            ", ".join(unknown),
            "given",
            f"no such setting; there are {', '.join(sorted(_names()))}",
        )
        return dataclasses.replace(self, **changes)

    def to_json(self) -> str:
        """Return the settings as a JSON object, as they stand in a field's attributes."""
        return json.dumps(dataclasses.asdict(self))

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any]) -> Settings:
        """Settings from a mapping such as a parsed JSON or TOML table; names not given keep their
        defaults.
        """
        return cls().replace(**values)

    @classmethod
    def from_toml(cls, path: str | Path) -> Settings:
        """Settings from a TOML file, whose keys are the names of this class.

        Raises
        ------
        InputError
            If the file is missing or not TOML, or holds an unknown name or a bad value.
        """
        try:
            values = tomllib.loads(Path(path).read_text(encoding="utf-8"))
        except (OSError, UnicodeDecodeError) as error:
            raise InputError(
                f"settings file {str(path)!r} cannot be read: {error}; give the path of a TOML file"
            ) from error
        except tomllib.TOMLDecodeError as error:
            raise InputError(f"settings file {str(path)!r} is not valid TOML: {error}") from error
        return cls.from_mapping(values)


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
    forward_backward: bool
    replace_failed: bool
    search: Search | Guess
    levels: int | None
    passes: int
    tolerance: float
    float64: bool
    pixel_size: float | None
    length_unit: str
    frame_interval: float | None


def _names() -> set[str]:
    return {f.name for f in dataclasses.fields(Settings)}


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _is_whole(value: object, low: int, high: float = math.inf) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and low <= value <= high


def _require(condition: bool, name: str, value: object, remedy: str) -> None:
    if not condition:
        raise InputError(f"{name}={value!r}: {remedy}")


def _require_choice(name: str, value: object, choices: tuple[str, ...]) -> None:
    _require(value in choices, name, value, f"must be one of {', '.join(map(repr, choices))}")
