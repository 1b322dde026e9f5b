"""Axes: which picture of a stack with several axes is a frame.

A stack has axes beside rows, columns and colours: time (T), channels (C), slices (Z), positions (P), others. Frames lie
along one of them; the rest must be chosen. What is ambiguous is refused with the choices named, never joined.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

from sixflow.errors import InputError
from sixflow.frames.selection import Selection

ARGUMENTS = {"C": "channel", "Z": "z", "P": "position"}
"""Which argument chooses along which axis."""

_WORDS = {"C": "channels", "Z": "slices", "P": "positions", "T": "times"}

_SHOWN = 8
"""Choices that are written out in a message."""

MOST_CHANNELS = 7
"""More channels than ImageJ can show at once, without times or slices, are frames whose axis was named wrong."""


@dataclasses.dataclass(frozen=True)
class Axis:
    """One axis of a stack.

    Attributes
    ----------
    code : str
        T, C, Z, P, or what the file calls it.
    numbers : sequence of int
        The numbers of what lies along it, from 0; a file of a set holds some of them only.
    names : tuple of str
        Their names, where the file gives any; as many as the largest number needs.
    """

    code: str
    numbers: Sequence[int]
    names: tuple[str, ...] = ()

    def describe(self) -> str:
        """Return what lies along the axis, and the argument that chooses, in words."""
        shown = [self._word(number) for number in self.numbers[:_SHOWN]]
        if len(self.numbers) > _SHOWN:
            shown += ["…", self._word(self.numbers[-1])]
        word = _WORDS.get(self.code, f"of axis {self.code}")
        choice = f" ({ARGUMENTS[self.code]}=)" if self.code in ARGUMENTS else ""
        return f"{word} {', '.join(shown)}{choice}"

    def _word(self, number: int) -> str:
        return f"{number} {self.names[number]!r}" if number < len(self.names) else str(number)


@dataclasses.dataclass(frozen=True)
class Choice:
    """What was chosen of a stack.

    Attributes
    ----------
    fixed : mapping from str to int
        The number chosen along each axis but one.
    along : str or None
        The axis of the frames; None where there is a single one.
    notes : tuple of str
    """

    fixed: Mapping[str, int]
    along: str | None
    notes: tuple[str, ...]


def pick(value: int | str, axis: Axis, argument: str, name: str) -> int:
    """Return the number that an argument names along an axis.

    Raises InputError if there is no such number or name.
    """
    if isinstance(value, str):
        same = [number for number in axis.numbers if number < len(axis.names) and axis.names[number] == value]
        same = same or [n for n in axis.numbers if value.isdecimal() and n == int(value)]
        if len(same) == 1:
            return same[0]
        problem = "several have this name" if same else "there is none of this name"
    else:
        if value in axis.numbers:
            return value
        problem = "there is none of this number"
    raise InputError(f"{argument}={value!r}: {problem} in {name}; it holds the {axis.describe()}")


def choose(axes: Sequence[Axis], selection: Selection, name: str) -> Choice:
    """Choose channel, slice and position of a stack, and the axis of its frames.

    Raises InputError if a choice is missing or there is nothing of what was chosen.

    Parameters
    ----------
    axes : sequence of Axis
        Beside rows, columns and colours.
    selection : Selection
    name : str
        Of the file, for messages.

    Examples
    --------
    >>> axes = [Axis("T", range(10)), Axis("C", range(2), ("red", "green"))]
    >>> choose(axes, Selection(channel="green"), "a.tif").fixed
    {'C': 1}
    >>> choose(axes, Selection(), "a.tif")
    Traceback (most recent call last):
    sixflow.errors.InputError: a.tif holds the channels 0 'red', 1 'green' (channel=); choose one...
    """
    by_code = {axis.code: axis for axis in axes}
    fixed = {axis.code: axis.numbers[0] for axis in axes if len(axis.numbers) == 1}
    for code, argument in ARGUMENTS.items():
        value = getattr(selection, argument)
        if value is not None and code in by_code:
            fixed[code] = pick(value, by_code[code], argument, name)
    left = [axis for axis in axes if axis.code not in fixed]
    mistaken = len(left) == 1 and left[0].code == "C" and len(left[0].numbers) > MOST_CHANNELS
    unclear = [axis for axis in left if axis.code in "CP"] or (left if len(left) > 1 else [])
    if mistaken:
        unclear = []
    if unclear:
        choices = [axis for axis in left if axis.code in ARGUMENTS]
        others = [axis for axis in left if axis.code not in ARGUMENTS]
        if len(others) > 1 or not choices:
            seen = " × ".join(f"{axis.code}={len(axis.numbers)}" for axis in left)
            raise InputError(
                f"{name}: the stack has the axes {seen} beside rows and columns, where only time may be; save the "
                "frames that are meant as a file of its own, for instance in ImageJ"
            )
        raise InputError(
            f"{name} holds the {' and the '.join(axis.describe() for axis in choices)}; choose one: they are not "
            f"frames of one recording{_remedy(left)}"
        )
    along = left[0].code if left else None
    notes = (
        (f"the {_WORDS[along]} ({along}) of the stack are read as frames over time",)
        if along in ("Z", "C")
        else ()
    )
    return Choice(fixed, along, notes)


def _remedy(left: Sequence[Axis]) -> str:
    """What to do if frames over time were called channels."""
    if [axis.code for axis in left] != ["C"]:
        return ""
    return ". If they are, name their axis: axes='TYX' in tifffile, Image › Properties in ImageJ"


def refuse_choices(selection: Selection, name: str, applied: Sequence[str] = ()) -> None:
    """Refuse a choice in a file that has nothing to choose from: only number 0 is there.

    Raises InputError if a channel, slice or position other than 0 was chosen that is not among `applied`.
    """
    for argument in ARGUMENTS.values():
        value = getattr(selection, argument)
        if value not in (None, 0, "0") and argument not in applied:
            word = {"z": "slice"}.get(argument, argument)
            raise InputError(
                f"{argument}={value!r}: {name} has one {word} only, number 0; leave {argument} out"
            )
