"""Estimates: numbers with standard errors, and what is assumed in them."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from typing import ClassVar

DISTINCT = 2.576
"""Standard errors by which a number must differ from 0 for its reciprocal, or a direction, to be determined: 1 %."""


@dataclasses.dataclass(frozen=True)
class Estimate:
    """A number with its standard error.

    Attributes
    ----------
    value : float
        NaN where there is none.
    standard_error : float
        To first order; infinite if the measurement does not determine the number.
    unit : str
        "1" for none.
    """

    value: float
    standard_error: float
    unit: str = "1"

    def __post_init__(self) -> None:
        object.__setattr__(self, "value", float(self.value))
        object.__setattr__(self, "standard_error", float(self.standard_error))

    @property
    def determined(self) -> bool:
        """Whether the measurement determines the number."""
        return math.isfinite(self.value) and math.isfinite(self.standard_error)

    def written(self) -> tuple[str, str, str]:
        """Value, standard error and unit as text, to the digits that the error leaves, with one power of ten.

        Examples
        --------
        >>> Estimate(49.8731, 0.3127, "frame").written()
        ('49.87', '0.31', 'frame')
        >>> Estimate(1.8731e-5, 3.1e-7, "1/px").written()
        ('1.873', '0.031', '10⁻⁵ 1/px')
        >>> Estimate(float("nan"), float("inf"), "px").written()
        ('undetermined', '', '')
        """
        unit = "" if self.unit == "1" else self.unit
        if math.isinf(self.value):
            return "unbounded", "", ""
        if not self.determined:
            return "undetermined", "", ""
        size = max(abs(self.value), self.standard_error)
        power = math.floor(math.log10(size)) if size > 0 and not 1e-3 <= size < 1e6 else 0
        value, error = self.value / 10.0**power, self.standard_error / 10.0**power
        digits = 4 if error == 0 else min(12, max(0, 1 - math.floor(math.log10(error))))
        if power:
            exponent = str(power).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
            unit = f"10{exponent} {unit}".rstrip()
        return f"{round(value, digits) + 0.0:.{digits}f}", f"{error:.{digits}f}", unit

    def __str__(self) -> str:
        value, error, unit = self.written()
        if not error:
            return value
        if unit.startswith("10"):
            return f"({value} ± {error}) × {unit}"
        return f"{value} ± {error} {unit}".rstrip()


@dataclasses.dataclass(frozen=True, eq=False)
class Interpretation:
    """What follows from a measured field; the base of all results of this package.

    Attributes
    ----------
    assumptions : tuple of str
        What is taken for granted, one statement each.
    """

    assumptions: tuple[str, ...]

    _title: ClassVar[str] = "interpretation"

    @property
    def title(self) -> str:
        """What it is, in a few words."""
        return self._title

    @property
    def estimates(self) -> dict[str, Estimate]:
        """All numbers by name, in order."""
        return dict(self._named())

    def _named(self) -> Iterator[tuple[str, Estimate]]:
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if isinstance(value, Estimate):
                yield field.name, value

    def __str__(self) -> str:
        lines = [self.title]
        lines += [f"  {label(name):24}{estimate}" for name, estimate in self._named()]
        lines += [f"  assumed: {statement}" for statement in self.assumptions]
        return "\n".join(lines)


def label(name: str) -> str:
    """A name as it is printed: time to contact, but V_X."""
    return name.replace("_", " ") if name.islower() else name


@dataclasses.dataclass(frozen=True)
class Clock:
    """From the time between the two frames of a pair to seconds, or to frame intervals where no times are known.

    Attributes
    ----------
    interval : float or None
        Time between the two frames, s.
    frames : float
        The same in frame intervals of the recording, where no times are known.
    """

    interval: float | None = None
    frames: float = 1.0

    @property
    def span(self) -> float:
        """Time between the two frames, in `unit`."""
        return self.frames if self.interval is None else self.interval

    @property
    def unit(self) -> str:
        """Of times."""
        return "frame" if self.interval is None else "s"

    def time(self, value: float, error: float) -> Estimate:
        """A time, given in intervals of the pair."""
        return Estimate(value * self.span, error * self.span, self.unit)

    def rate(self, value: float, error: float, quantity: str = "1") -> Estimate:
        """A quantity per interval of the pair."""
        return Estimate(value / self.span, error / self.span, f"{quantity}/{self.unit}")


def distinct(value: float, error: float) -> bool:
    """Whether a number differs from 0 by more than its error lets it."""
    return value != 0 and abs(value) > DISTINCT * error
