"""Tables of the results, for the terminal and as Markdown."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator

import numpy as np

from cases import show
from public_cases.ours import STANDING, UNIFORM
from public_cases.run import CaseResult, Entry, Results
from public_cases.targets import verdicts

Names = tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class Table:
    """A table with a line of explanation; cells are text."""

    title: str
    note: str
    header: list[str]
    rows: list[list[str]]

    def show(self) -> None:
        """Print it on the terminal."""
        show(f"{self.title}\n{self.note}", self.header, self.rows)

    def markdown(self) -> str:
        """Write it as Markdown."""
        lines = [self.header, ["---", *["---:"] * (len(self.header) - 1)], *self.rows]
        body = "\n".join(f"| {' | '.join(line)} |" for line in lines)
        return f"## {self.title}\n\n{self.note}\n\n{body}\n"


@dataclasses.dataclass(frozen=True)
class ByCase:
    """A table with one row per case, one column per method; rows without any number are left out."""

    title: str
    note: str
    cell: Callable[[Entry], str]
    experiment: str = ""

    def table(self, results: Results, methods: Names) -> Table:
        """Fill it in."""
        rows = []
        for name, result in results.items():
            if self.experiment and result.case.experiment != self.experiment:
                continue
            cells = [self.cell(result.entries[key]) if key in result.entries else "–" for key in methods]
            if any(text != "–" for text in cells):
                rows.append([name, *cells])
        return Table(self.title, self.note, ["case", *methods], rows)


def number(value: float) -> str:
    """Three digits; – for NaN."""
    if np.isnan(value):
        return "–"
    return f"{value:.1e}" if 0 < abs(value) < 1e-3 else f"{value:.3g}"


def percent(value: float) -> str:
    """A share in %; – for NaN."""
    if np.isnan(value):
        return "–"
    if 0 < value < 0.001:
        return "< 0.1"
    return f"{math.floor(1000 * value) / 10:g}"


def _error(entry: Entry) -> str:
    valid = entry.scores.valid
    return number(entry.scores.error) + ("" if valid > 0.995 else f" ({100 * valid:.0f} %)")


def _edges(entry: Entry) -> str:
    if entry.edges is None:
        return "–"
    away, given, wrong = entry.edges.away_error, entry.edges.away_given, entry.edges.wrong_at
    return f"{number(away)} ({100 * given:.0f} %) / {percent(wrong)}"


BY_CASE = (
    ByCase(
        "End-point error",
        "Mean over the points that are given, px; with the share of the points that are given where that is not "
        "all. OpenPIV has a grid of its own, away from the border, and is compared about the middle of the pair.",
        _error,
    ),
    ByCase(
        "Rms error",
        "Of one component, px, over points with complete windows; peers: over points 16 px from the border.",
        lambda entry: number(entry.scores.rms_complete),
    ),
    ByCase(
        "Gradient",
        "Rms error of one component × 10³ over the same points. Peers: differences over two steps of the grid.",
        lambda entry: number(1e3 * entry.scores.gradient_complete),
    ),
    ByCase(
        "Wrong and not flagged",
        "Share of the given points that are wrong by more than 0.3 px and 5 predicted standard errors, in %; "
        "peers predict none: by more than 0.3 px.",
        lambda entry: percent(entry.scores.wrong),
    ),
    ByCase(
        "Textured points found",
        "Share of the textured points inside both frames that are given and right to 0.3 px, in %.",
        lambda entry: percent(entry.scores.textured),
    ),
    ByCase(
        "Angular error",
        "Mean angle between (u, v, 1) and the truth over the points given, degrees.",
        lambda entry: number(entry.scores.angle),
        "vision",
    ),
    ByCase(
        "Motion edges",
        "Mean end-point error, px, of points more than 16 px from a motion edge (share given), and the share, "
        "in %, of points within 8 px of one that are given and wrong.",
        _edges,
        "vision",
    ),
    ByCase(
        "Points without a truth",
        "Share of the points without a known motion (the sky of Yosemite, occluded points) that are given all "
        "the same, in %. Clouds that move like a texture may be.",
        lambda entry: percent(entry.scores.outside),
        "vision",
    ),
)


def all_tables(results: Results, ours: Names, methods: Names) -> Iterator[Table]:
    """Yield the tables that have rows; `ours` are our columns, `methods` all columns."""
    tables = (
        _targets(results, ours),
        *(table.table(results, methods) for table in BY_CASE),
        _star(results),
        _shifts(results, methods),
        _coverage(results),
        _time(results, methods),
    )
    yield from (table for table in tables if table.rows)


def _targets(results: Results, ours: Names) -> Table:
    note = (
        f"✓ keeps the limit, ✗ does not. A target is met if one of the standing columns, {' or '.join(STANDING)}, "
        f"keeps all of its limits; that of the star, if any column does; that of affine speckles, if {UNIFORM} does. "
        "The figure is that of the worst case."
    )
    header = ["target", "figure", "limit", *ours, "verdict"]
    return Table("Targets", note, header, list(verdicts(results, ours, STANDING)))


def _star(results: Results) -> Table:
    rows = [
        [key, *(number(value) for one in entry.star for value in (one.period, one.noise, one.efficiency))]
        for result in results.values()
        for key, entry in result.entries.items()
        if entry.star is not None
    ]
    note = (
        "P: period at 10 % attenuation, px. Noise: rms of u, and of u_x and u_y, whose truth is 0, where periods are "
        "longer than P. Less is better: first-order DIC subsets have noise × P 0.6, second-order 0.38 to 0.41, an "
        "ideal low-pass 0.28."
    )
    kinds = ("displacement", "gradient")
    units = ("P, px", "noise", "noise × P"), ("P, px", "noise", "noise × P²")
    header = ["", *(f"{kind}: {unit}" for kind, names in zip(kinds, units, strict=True) for unit in names)]
    return Table("Noise × resolution on the star", note, header, rows)


def _shift(result: CaseResult) -> float:
    return float(result.case.truth.u[0, 0])


def _shifts(results: Results, methods: Names) -> Table:
    chosen = sorted((result for name, result in results.items() if name.startswith("piv_shift")), key=_shift)
    rows = []
    for key in methods:
        scores = [result.entries[key].scores for result in chosen if key in result.entries]
        if len(scores) == len(chosen) > 0:
            biases = np.array([(one.bias_u, one.bias_v) for one in scores])
            rows.append(
                [key, number(float(np.abs(biases).max())), *(f"{pair.mean():+.4f}" for pair in biases)]
            )
    note = (
        "Mean error over the points given, px: worst of u and v over all shifts, and mean of u and v at each shift. "
        "The truth itself is good to about 0.01 px."
    )
    header = ["", "worst", *(f"{_shift(result):.4g}" for result in chosen)]
    return Table("Bias over sub-pixel shift", note, header, rows)


def _coverage(results: Results) -> Table:
    rows = [
        [f"{name}: {key}", *one.cells()]
        for name, result in results.items()
        if not name.startswith("piv_shift")
        for key in STANDING
        if key in result.entries and (one := result.entries[key].coverage) is not None
    ]
    note = (
        "Errors divided by their standard errors, of all points that are given, at borders and in what is flagged as "
        "unresolved too. Of normal errors 0.27 % exceed three standard errors, and the root mean square is 1."
    )
    header = ["case: column", "u, v: beyond 3", "rms", "gradient: beyond 3", "rms"]
    return Table("Coverage", note, header, rows)


def _time(results: Results, methods: Names) -> Table:
    sets: dict[str, list[CaseResult]] = {}
    for result in results.values():
        sets.setdefault(result.case.set_name, []).append(result)
    rows = []
    for set_name, chosen in sets.items():
        seconds = [
            [one.entries[key].scores.seconds for one in chosen if key in one.entries] for key in methods
        ]
        rows.append(
            [set_name, *(f"{1000 * float(np.median(some)):.0f}" if some else "–" for some in seconds)]
        )
    note = (
        "Median of a set's cases, ms: one call each, compiled beforehand. `benchmarks/speed.py` compares speeds with "
        "more care."
    )
    return Table("Time", note, ["set", *methods], rows)
