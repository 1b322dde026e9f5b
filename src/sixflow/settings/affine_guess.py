"""Affine guess: a first guess of the motion in numbers, as settings hold it, checked and in one form.

| numbers | what |
|---|---|
| six | (u, v, divergence, curl, stretch, shear) about pixel (0, 0), as in `sixflow.convention` |
| 2 × 3 or 3 × 3 | the matrix of the map (x, y, 1) → (x', y'), as of `convention.affine_from_six` |

Without NumPy, which the command line does not need to answer `--help`.
"""

from __future__ import annotations

import math
from typing import Any, TypeAlias

from sixflow.errors import InputError

Numbers: TypeAlias = tuple[Any, ...]
"""Six numbers, or rows of three."""

KINDS = (
    "six numbers (u, v, divergence, curl, stretch, shear) about pixel (0, 0), a 2×3 or 3×3 matrix of (x, y, 1), "
    "a field, or a function (x, y) → (u, v)"
)
_LEAST_AREA = 0.01
"""det F of a guess below which it folds the plane, or presses it together so far that nothing could be matched."""


def as_numbers(guess: Any) -> Numbers:
    """Return a first guess in numbers as a tuple of six, or of two rows of three.

    Raises InputError if it is none of these, not finite, or folds the plane.

    Parameters
    ----------
    guess : array_like, shape (6,), (2, 3) or (3, 3), or str
        As text, six numbers with commas between.

    Examples
    --------
    >>> as_numbers("0.6,0,0,0,0,0")
    (0.6, 0.0, 0.0, 0.0, 0.0, 0.0)
    >>> as_numbers([[1, 0, 3], [0, 1, -2], [0, 0, 1]])
    ((1.0, 0.0, 3.0), (0.0, 1.0, -2.0))
    """
    try:
        numbers = _numbers(guess.split(",") if isinstance(guess, str) else guess)
    except (TypeError, ValueError) as error:
        raise InputError(f"search={guess!r}: a first guess must be {KINDS}") from error
    flat = numbers if len(numbers) == 6 else [number for row in numbers for number in row]
    if not all(math.isfinite(number) for number in flat):
        raise InputError(f"search={guess!r}: the numbers of a first guess must be finite")
    if len(numbers) == 3:
        if numbers[2] != (0, 0, 1):
            raise InputError(f"search={guess!r}: the last row of an affine matrix must be 0, 0, 1")
        numbers = numbers[:2]
    area = _area(numbers)
    if not area > _LEAST_AREA:
        raise InputError(
            f"search={guess!r}: the map folds or collapses the plane, det = {area:.3g}; it must be positive"
        )
    return numbers


def _numbers(guess: Any) -> Numbers:
    parts = [*guess]
    if len(parts) == 6:
        return tuple(float(number) for number in parts)
    rows = tuple(tuple(float(number) for number in row) for row in parts)
    if len(rows) not in (2, 3) or any(len(row) != 3 for row in rows):
        raise ValueError("of another shape")
    return rows


def _area(numbers: Numbers) -> float:
    """Determinant of the map."""
    if len(numbers) == 6:
        _, _, divergence, curl, stretch, shear = numbers
        a, d = 1 + (divergence + stretch) / 2, 1 + (divergence - stretch) / 2
        b, c = (shear - curl) / 2, (shear + curl) / 2
    else:
        (a, b, _), (c, d, _) = numbers
    return float(a * d - b * c)
