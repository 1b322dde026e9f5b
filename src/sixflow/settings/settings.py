"""Settings of a measurement: one frozen dataclass = keyword arguments = command line = TOML file =
attributes of the result.
"""

from __future__ import annotations

import dataclasses
import difflib
import json
import math
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, get_args

from sixflow.checks import plain, require_choice, shown
from sixflow.errors import InputError
from sixflow.settings.affine_guess import Numbers, as_numbers
from sixflow.settings.ranges import check_ranges, check_together
from sixflow.settings.region import as_polygons
from sixflow.settings.types import Group, Interpolation, Lighting, Method, Polygons, Reference, Search, Window


@dataclasses.dataclass(frozen=True, kw_only=True)
class Settings:
    """How a field is measured. Every choice that changes a number of the result is here, and nothing else.

    Parameters
    ----------
    window : float or "auto"
        "auto" measures with windows from 8 to 62 px, sharpened, and takes at each point the one of least expected
        error; `resolution` in the field says how fine it is. A number is the side of the square subset of the same
        noise, px, from 5 to the frames' smaller side, for all points. The weight is a Gaussian of
        σ = window/√(4π) = window/3.545. Larger: less noise, less resolution.
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
        "auto" takes gain and offset where matched parts of the frames differ in contrast or brightness by
        more than chance, anywhere, else nothing.
    robust : bool
        Give little weight to pixels whose residual is far beyond what noise explains: unmatched particles,
        glints, dead pixels. It changes nothing where there are none. Of `method="eigenfilter"`, it
        replaces dead pixels alone.
    fixed_pattern : bool
        Of a recording: estimate what all of its frames have in common at the same pixels, columns and rows (noise of
        the sensor that stands still), and take it out first. The frames are read twice, and have to move by more than
        their texture is long.
    forward_backward : bool
        Measure from frame 1 to frame 0 too, and flag points that do not return: twice the time.
    replace_failed : bool
        Give failed points what their neighbours predict, with a covariance that holds their scatter. Such points are
        flagged `replaced`, and are never counted as measured.
    search : {"auto", "pyramid", "spectrum"} or a first guess
        How large motion is found. "pyramid": from coarse to fine. "spectrum": from the affine map that the whole
        frames have in common, of any turn, zoom, shear and shift. "auto": from coarse to fine, and for points that
        are missed so, growth from their neighbours and the map of "spectrum". A first guess takes the place of the
        word: six numbers (u, v, divergence, curl, stretch, shear) about pixel (0, 0), or a 2 × 3 or 3 × 3 matrix of
        (x, y, 1). A measurement also takes a field, or a function (x, y) → (u, v), which stands here as "guess".
    levels : int or None
        Number of halvings of the frame that the search for large motion starts from, 0 to 12. None
        chooses it from frame and window.
    passes : int
        Upper limit of passes at full resolution, at least 1.
    tolerance : float
        A point has converged when it is closer than this to where more passes would bring it, px,
        greater than 0.
    roi : str or None
        Rectangle to measure in, "x0:x1,y0:y1", px of the reference frame: columns x0 to x1 − 1 and rows y0 to y1 − 1,
        as slices are. An open end, as in "100:,:300", reaches to the edge.
    polygons : polygons or text
        Measure inside these alone, px of the reference frame: corners [[x, y], …] of one, or several of these; as text
        "10,10 90,10 50,80; …". A pixel is inside if its centre is. Parts that a gap separates are measured apart.
    holes : polygons or text
        Leave out what is inside these; written as `polygons`. A mask, `roi`, `polygons` and `holes` hold together.
    float64 : bool
        Compute in double precision: twice the memory, for noise-free studies.
    pixel_size : float or None
        Length of one pixel in the object, in `length_unit`. It changes no measured number; with it the
        field has physical units.
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
    sixflow.errors.InputError: step=0: must be a whole number of pixels from 1 to 1048576; 8 suits a window of 31
    """

    window: Window = "auto"
    step: int = 8
    method: Method = "least_squares"
    reference: Reference = "first"
    group: Group = "affine"
    sharpen: int = 0
    interpolation: Interpolation = "quintic"
    lowpass: float = 0.0
    lighting: Lighting = "auto"
    robust: bool = True
    fixed_pattern: bool = False
    forward_backward: bool = False
    replace_failed: bool = False
    search: Search | Numbers = "auto"
    levels: int | None = None
    passes: int = 8
    tolerance: float = 0.005
    roi: str | None = None
    polygons: Polygons = ()
    holes: Polygons = ()
    float64: bool = False
    pixel_size: float | None = None
    length_unit: str = "mm"
    frame_interval: float | None = None

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            object.__setattr__(self, field.name, plain(getattr(self, field.name)))
        if isinstance(self.window, float) and self.window.is_integer():
            object.__setattr__(self, "window", int(self.window))  # 31.0 and 31 are the same setting
        check_ranges(self)
        check_together(self)
        if isinstance(self.search, str) and "," not in self.search:
            require_choice("search", self.search, get_args(Search))
        else:
            object.__setattr__(self, "search", as_numbers(self.search))
        for name in ("polygons", "holes"):
            object.__setattr__(self, name, as_polygons(getattr(self, name), name))

    def __repr__(self) -> str:
        """Show only what differs from the defaults."""
        changed = {
            f.name: value for f in dataclasses.fields(self) if (value := getattr(self, f.name)) != f.default
        }
        return f"Settings({', '.join(f'{name}={value!r}' for name, value in changed.items())})"

    @property
    def sigma(self) -> float:
        """Standard deviation of the Gaussian weight, px: window/√(4π); NaN for "auto"."""
        return math.nan if self.window == "auto" else float(self.window) / math.sqrt(4 * math.pi)

    def replace(self, /, **changes: Any) -> Settings:
        """Return the settings with some values changed.

        Raises
        ------
        InputError
            If a name is no setting, or a value is out of range.
        """
        require_names(changes)
        return dataclasses.replace(self, **changes)

    def to_json(self) -> str:
        """Return the settings as a JSON object, as they stand in a field's attributes."""
        return json.dumps(dataclasses.asdict(self))

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any]) -> Settings:
        """Settings from a mapping such as a parsed JSON or TOML table; names not given keep their
        defaults.
        """
        if not isinstance(values, Mapping):
            raise InputError(
                f"settings={shown(values)}: must be a mapping of names to values, such as a dict"
            )
        require_names(values)
        return cls(**values)

    @classmethod
    def from_json(cls, text: str) -> Settings:
        """Settings from the JSON object of `to_json`: those of a field from ``field.attrs["settings"]``.

        Raises
        ------
        InputError
            If it is no JSON object, or holds an unknown name or a bad value.
        """
        try:
            values = json.loads(text)
        except (TypeError, ValueError, RecursionError) as error:
            raise InputError(
                f"settings are no JSON ({error}); give what Settings.to_json returned"
            ) from error
        if not isinstance(values, dict):
            raise InputError(f"settings={text!r}: must be a JSON object of names and values")
        return cls.from_mapping(values)

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
        except tomllib.TOMLDecodeError as error:
            raise InputError(f"settings file {str(path)!r} is not valid TOML: {error}") from error
        except (OSError, TypeError, ValueError) as error:  # no text, or no path
            raise InputError(
                f"settings file {str(path)!r} cannot be read: {error}; give the path of a TOML file"
            ) from error
        except RecursionError as error:
            raise InputError(f"settings file {str(path)!r} is nested too deeply for settings") from error
        return cls.from_mapping(values)


def require_names(given: Mapping[Any, Any]) -> None:
    """Refuse a mapping with a key that is no setting.

    Raises
    ------
    InputError
        It names the key and the settings that there are, and the one that was probably meant.

    Examples
    --------
    >>> require_names({"windwo": 31})
    Traceback (most recent call last):
    sixflow.errors.InputError: windwo: no such setting; there are window, step, ...; did you mean window?
    """
    names = [field.name for field in dataclasses.fields(Settings)]
    unknown = [name for name in given if name not in names]
    if unknown:
        alike = [match for name in unknown for match in difflib.get_close_matches(str(name), names, 1)]
        meant = f"; did you mean {', '.join(alike)}?" if alike else ""
        asked = ", ".join(shown(name).strip("'") for name in unknown)
        raise InputError(f"{asked}: no such setting; there are {', '.join(names)}{meant}")


def require_settings(settings: object) -> Settings:
    """Return settings that are given as such; the defaults for None.

    Raises
    ------
    InputError
        If it is something else.
    """
    if settings is None:
        return Settings()
    if not isinstance(settings, Settings):
        raise InputError(
            f"settings={shown(settings)}: must be a sixflow.Settings; of a mapping it is made by Settings.from_mapping"
        )
    return settings
