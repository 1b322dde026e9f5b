"""Settings as flags: names, types, defaults and help all come from the dataclass `Settings`.

A typed dictionary receives the flags, so that it holds what was given and nothing else: this is what lets a
flag win over a settings file, and the file over the defaults.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias, TypedDict, get_args, get_type_hints

from cyclopts import Group, Parameter

from sixflow.cli.flags import number_reader
from sixflow.settings import Settings, SettingsOptions


def settings_help() -> dict[str, str]:
    """Return the description of every setting, from the docstring of `Settings`.

    Examples
    --------
    >>> settings_help()["length_unit"]
    'Unit of --pixel-size.'
    """
    from docstring_parser.numpydoc import parse

    texts = {
        part.arg_name: " ".join((part.description or "").split())
        for part in parse(Settings.__doc__ or "").params
    }
    return {name: _with_flags(text) for name, text in texts.items()}


def _with_flags(text: str) -> str:
    """Write names of settings as the flags that they are here."""
    for field in dataclasses.fields(Settings):
        text = text.replace(f"`{field.name}`", flag(field.name))
    return text


def flag(name: str) -> str:
    """Return a setting's flag, such as --pixel-size."""
    return "--" + name.replace("_", "-")


def _is_number(hint: Any) -> bool:
    """Tell the types int, float and these or None from others."""
    return bool({int, float} & set(get_args(hint) or (hint,)))


def _flags(title: str, names: tuple[str, ...] | None = None) -> Any:
    """Return a typed dictionary whose keys are the settings, or those of them that are named."""
    hints, texts = get_type_hints(SettingsOptions), settings_help()
    group = Group.create_ordered(title)
    hints |= dict.fromkeys(("search", "polygons", "holes"), str)  # numbers as text
    keys = {
        field.name: Annotated[
            hints[field.name],
            Parameter(
                help=texts[field.name],
                converter=number_reader(hints[field.name]) if _is_number(hints[field.name]) else None,
                group=group,
                show_default=False if names or field.default in (None, ()) else str(field.default),
            ),
        ]
        for field in dataclasses.fields(Settings)
        if names is None or field.name in names
    }
    functional: Any = TypedDict  # whose keys a type checker would want to see in the source
    return functional("SettingsFlags", keys, total=False)


if TYPE_CHECKING:
    SettingsFlags: TypeAlias = SettingsOptions
    CalibrationFlags: TypeAlias = SettingsOptions
else:
    SettingsFlags = _flags("Settings")
    CalibrationFlags = _flags("Calibration", ("pixel_size", "length_unit", "frame_interval"))


def gather_settings(flags: SettingsOptions | None, file: Path | None) -> Settings:
    """Return the settings: flags win over the file, the file over the defaults.

    Raises InputError if the file cannot be read, or a value is out of range.
    """
    settings = Settings() if file is None else Settings.from_toml(file.expanduser())
    return settings.replace(**(flags or {}))
