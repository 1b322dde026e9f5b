"""One figure per set of cases."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from matplotlib.figure import Figure

from public_cases.curves import draw_bias, draw_errors, draw_profiles, draw_star
from public_cases.maps import draw_maps
from public_cases.run import CaseResult, Results

Draw = Callable[[list[CaseResult], tuple[str, ...], tuple[str, ...]], Figure]

DPI = 180

SPECIAL: dict[str, tuple[Draw, str]] = {
    "piv_shift": (draw_bias, "Mean error over the true shift."),
    "dic2": (draw_star, "Response on the star; dotted: 10 % attenuation."),
    "dic14": (
        draw_profiles,
        "Mean over the rows of the error of u: a wave of 0.1 px whose period shrinks to the right.",
    ),
    "opencorr": (draw_errors, "Rms errors of each case; ours over points with complete windows."),
}
"""Sets whose figure is not a map of errors: how it is drawn, and its caption."""


def draw_figures(
    results: Results, ours: tuple[str, ...], peers: tuple[str, ...], folder: Path
) -> dict[str, tuple[str, str]]:
    """Draw and save the figures; return file name and caption by set."""
    folder.mkdir(parents=True, exist_ok=True)
    sets: dict[str, list[CaseResult]] = {}
    for result in results.values():
        sets.setdefault(result.case.set_name, []).append(result)
    drawn = {}
    for name, chosen in sets.items():
        draw, caption = SPECIAL.get(name, (draw_maps, "End-point error."))
        file = f"public-{name}.png"
        draw(chosen, ours, peers).savefig(folder / file, dpi=DPI)
        drawn[name] = (file, caption)
    return drawn
