"""Targets, and what of them is reached.

A check reads one figure for one of our columns off the results of a target's cases. A target is met if one of the
standing settings (the default, or the setting by experiment) meets all of its checks; the other columns are shown
beside them.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from public_cases.edges import error_on_our_points
from public_cases.ours import UNIFORM
from public_cases.run import CaseResult, Entry, Results

EDGE_WRONG = 0.01
EDGE_PEERS = ("Farnebäck", "Farnebäck, Gaussian", "TV-L1")


@dataclasses.dataclass(frozen=True)
class Check:
    """One figure of a target.

    Parameters
    ----------
    words : str
        What it is.
    limit : str
        What it must keep, in words.
    cases : tuple of str
        Beginnings of the names of its cases.
    read : callable
        The figure as text, and whether it keeps the limit, from the cases' results and a column's name.
    """

    words: str
    limit: str
    cases: tuple[str, ...]
    read: Callable[[list[CaseResult], str], tuple[str, bool]]

    def figure(self, results: Results, column: str) -> tuple[str, bool] | None:
        """Return the figure; None if its cases were not run, or not with this column."""
        chosen = [result for name, result in results.items() if name.startswith(self.cases)]
        if not chosen or any(column not in result.entries for result in chosen):
            return None
        return self.read(chosen, column)


def _worst(words: str, limit: float, cases: tuple[str, ...], value: Callable[[Entry], float]) -> Check:
    """The largest of a number over the cases must not exceed the limit."""

    def read(chosen: list[CaseResult], column: str) -> tuple[str, bool]:
        figure = max(_or_infinite(value(result.entries[column])) for result in chosen)
        return ("nothing given" if np.isinf(figure) else f"{figure:.2g}"), figure <= limit

    return Check(words, f"≤ {limit:g}", cases, read)


def _share(words: str, limit: float, cases: tuple[str, ...], value: Callable[[Entry], float]) -> Check:
    """The least share over the cases must reach the limit."""

    def read(chosen: list[CaseResult], column: str) -> tuple[str, bool]:
        figure = min(value(result.entries[column]) for result in chosen)
        return f"{math.floor(1000 * figure) / 10:g} %", figure >= limit

    return Check(words, "all" if limit == 1 else f"≥ {100 * limit:g} %", cases, read)


def _wrong_at_edges(chosen: list[CaseResult], column: str) -> tuple[str, bool]:
    edges = [result.entries[column].edges for result in chosen]
    figure = max(one.wrong_at for one in edges if one is not None)
    return f"{100 * figure:.1f} %", figure <= EDGE_WRONG


def _beyond(limit: float, cases: tuple[str, ...]) -> Check:
    """The largest share of u and v beyond three standard errors must not exceed the limit."""

    def read(chosen: list[CaseResult], column: str) -> tuple[str, bool]:
        shares = [one.beyond for result in chosen if (one := result.entries[column].coverage) is not None]
        figure = max(shares, default=np.inf)
        return ("nothing given" if np.isinf(figure) else f"{100 * figure:.1f} %"), figure <= limit

    return Check("u, v beyond 3 standard errors, all given", f"≤ {100 * limit:g} %", cases, read)


def _beside_peers(chosen: list[CaseResult], column: str) -> tuple[str, bool]:
    """Our error away from motion edges over the best peer's on the same points, worst case."""
    ratios = []
    for result in chosen:
        ours = result.entries[column]
        beside = [result.entries[peer].comparison for peer in EDGE_PEERS if peer in result.entries]
        if not beside or ours.edges is None:
            return "no peer", False
        best = min(error_on_our_points(result.case, ours.comparison, peer) for peer in beside)
        ratios.append(_or_infinite(ours.edges.away_error / best))
    return f"{max(ratios):.2f}", max(ratios) < 1


def _efficiency(entry: Entry) -> float:
    return entry.star[0].efficiency if entry.star else np.nan


def _bias(entry: Entry) -> float:
    return max(abs(entry.scores.bias_u), abs(entry.scores.bias_v))


def _or_infinite(value: Any) -> float:
    return float("inf") if np.isnan(value) else float(value)


_ROTATION, _LARGE, _OPENCORR = ("dice/rotation20",), ("pyvale/rigid_50px",), ("opencorr",)

TARGETS: dict[str, tuple[Check, ...]] = {
    "particle images, one setting for all": (
        _worst("DNS turbulence: mean error, px", 0.060, ("piv_cai/DNS",), lambda e: e.scores.error),
        _worst("backward step: mean error, px", 0.025, ("piv_cai/backstep",), lambda e: e.scores.error),
        _worst("uniform: mean error, px", 0.002, ("piv_cai/uniform",), lambda e: e.scores.error),
        _share("points given", 0.95, ("piv_cai",), lambda e: e.scores.valid),
    ),
    "peak locking": (_worst("worst bias over the shifts, px", 0.018, ("piv_shift",), _bias),),
    "star": (_worst("noise × period at 10 % attenuation, px²", 0.33, ("dic2/star",), _efficiency),),
    "large motion: textured points given and right": (
        _share("dice, rotation by 20°", 1, _ROTATION, lambda e: e.scores.textured),
        _share("pyvale, shift of 71 px", 1, _LARGE, lambda e: e.scores.textured),
        _share("opencorr", 1, _OPENCORR, lambda e: e.scores.textured),
    ),
    "affine speckle (opencorr), complete windows": (
        _worst("rms error, px", 2e-3, _OPENCORR, lambda e: e.scores.rms_complete),
        _worst("rms error of the gradient", 2e-4, _OPENCORR, lambda e: e.scores.gradient_complete),
    ),
    "yosemite, ground": (
        _worst("mean angle, °", 1.5, ("yosemite/ground",), lambda e: e.scores.angle),
        _worst("mean error, px", 0.09, ("yosemite/ground",), lambda e: e.scores.error),
    ),
    "middlebury, away from motion edges": (
        Check("error / best of Farnebäck and TV-L1", "< 1", ("middlebury",), _beside_peers),
        Check("at edges: wrong, not flagged", f"≤ {100 * EDGE_WRONG:g} %", ("middlebury",), _wrong_at_edges),
    ),
    "coverage": (
        _beyond(0.01, ("dic14",)),
        _beyond(0.015, ("dic2/star", "star_strainnet")),
        _beyond(0.04, ("piv_cai/DNS", "piv_cai/backstep")),
    ),
}


OF_ANY_SETTING = ("star",)
"""Targets of what sharpening can reach: any of our columns may meet them."""
OF_UNIFORM_STRAIN = ("affine speckle (opencorr), complete windows",)
"""Targets that the setting for uniform strain may meet too."""


def verdicts(results: Results, columns: tuple[str, ...], standing: tuple[str, ...]) -> Iterator[list[str]]:
    """Rows of the table of targets: target, figure, limit, one cell per column, verdict."""
    for target, checks in TARGETS.items():
        figures = [{name: check.figure(results, name) for name in columns} for check in checks]
        if all(figure is None for row in figures for figure in row.values()):
            continue
        asked = columns if target in OF_ANY_SETTING else standing
        if target in OF_UNIFORM_STRAIN:
            asked = (*standing, UNIFORM)
        met = [name for name in asked if all(_kept(row.get(name)) for row in figures)]
        known = all(row.get(name) is not None for row in figures for name in asked)
        for k, (check, row) in enumerate(zip(checks, figures, strict=True)):
            verdict = (
                "" if k else f"met: {', '.join(met)}" if met else "NOT MET" if known else "not all cases run"
            )
            cells = [_cell(figure) for figure in row.values()]
            yield ["" if k else target, check.words, check.limit, *cells, verdict]


def _kept(figure: tuple[str, bool] | None) -> bool:
    return figure is not None and figure[1]


def _cell(figure: tuple[str, bool] | None) -> str:
    return "–" if figure is None else f"{figure[0]} {'✓' if figure[1] else '✗'}"
