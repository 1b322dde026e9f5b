"""Running the methods on a case and keeping what they found."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

from numpy.typing import NDArray

from public_cases.case import Case
from public_cases.coverage import Coverage, coverage
from public_cases.edges import EdgeScores, edge_scores
from public_cases.measured import Measured
from public_cases.ours import measure_ours, settings_of
from public_cases.scores import Comparison, Scores, compare, score, textured_pixels
from public_cases.star import Resolution, is_star, resolutions

STAR_COLUMNS: dict[str, dict[str, Any]] = {
    f"window=31, sharpen={n}": {"window": 31, "sharpen": n} for n in (4, 8)
}
"""More of ours on the star alone, which shows what sharpening is worth."""


@dataclasses.dataclass(frozen=True)
class Entry:
    """What one method made of one case."""

    comparison: Comparison
    scores: Scores
    coverage: Coverage | None
    edges: EdgeScores | None
    star: tuple[Resolution, Resolution] | None


@dataclasses.dataclass(frozen=True)
class CaseResult:
    """A case, and the entries of the methods that could be run on it, by name."""

    case: Case
    entries: dict[str, Entry]


Results = dict[str, CaseResult]


def run_case(
    case: Case, peers: dict[str, Callable[[Case], Measured | None]], extra: dict[str, dict[str, Any]]
) -> CaseResult:
    """Run our columns and the peers on a case."""
    columns = settings_of(case, extra) | (STAR_COLUMNS if is_star(case.name) else {})
    found = {name: measure_ours(case, options) for name, options in columns.items()}
    found |= {name: peer(case) for name, peer in peers.items()}
    texture = textured_pixels(case.frame0)
    return CaseResult(
        case,
        {name: _entry(case, measured, texture) for name, measured in found.items() if measured is not None},
    )


def _entry(case: Case, measured: Measured, texture: NDArray[Any]) -> Entry:
    comparison = compare(case, measured, texture)
    return Entry(
        comparison,
        score(comparison),
        coverage(comparison),
        edge_scores(case, comparison) if case.experiment == "vision" else None,
        resolutions(comparison, case.truth.v) if is_star(case.name) else None,
    )
