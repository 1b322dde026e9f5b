"""Flags that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, TypeAlias

from cyclopts import Parameter

Output: TypeAlias = Annotated[Path, Parameter(name=("--output", "-o"))]
"""Where the result goes."""

Switch: TypeAlias = Annotated[bool, Parameter(negative="", show_default=False)]
"""Off unless given; it has no opposite."""
