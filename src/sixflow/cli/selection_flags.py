"""Which frames, as flags: the arguments of `open_frames` of the same names."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, TypedDict

from cyclopts import Group, Parameter, Token

from sixflow.cli.flags import Whole

_GROUP = Group.create_ordered("Which frames")


def _read_choice(_: Any, tokens: Sequence[Token]) -> int | str:
    """Read a number or a name; a converter of cyclopts."""
    text = tokens[0].value
    return int(text) if text.isdecimal() else text


def _flag(text: str, *, reads_names: bool = True) -> Any:
    return Parameter(
        help=text, group=_GROUP, converter=_read_choice if reads_names else None, show_default=False
    )


class SelectionFlags(TypedDict, total=False):
    """The flags that were given, by name."""

    channel: Annotated[int | str, _flag("Channel of files with several: number, from 0, or name.")]
    z: Annotated[int | str, _flag("Slice of stacks that have slices and times: number, from 0, or name.")]
    position: Annotated[int | str, _flag("Position, scene, series or dataset: number, from 0, or name.")]
    first: Annotated[Whole, _flag("Number of the first frame, from 0.", reads_names=False)]
    last: Annotated[Whole, _flag("Number of the last frame, which is included.", reads_names=False)]
    every: Annotated[Whole, _flag("Take every so many frames.", reads_names=False)]
