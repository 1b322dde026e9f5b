"""What the tables of the operators share: the three textures, and pairs of them in noise."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from cases import cramer_rao, errors_at_points, make_pair
from sixflow import synth
from sixflow.maps.grid import Grid

WINDOW, STEP, NOISE = 31, 8, 2.0
SMALL = (0.4, -0.3, 0.004, -0.006, 0.003, 0.002)

TEXTURES: dict[str, Callable[[int], Any]] = {
    "speckle σ 2": lambda seed: synth.Speckle(seed=seed),
    "particles σ 1": lambda seed: synth.Particles(diameter=4, seed=seed),  # the e⁻² diameter is 4 σ
    "texture 6 – 24 px": lambda seed: synth.Texture(seed=seed),
}


def limit(pattern: Any, side: int, noise: float) -> np.ndarray:
    """The Cramér–Rao value at the points of `measure`."""
    return cramer_rao(pattern, side, Grid.over((side, side), STEP), WINDOW, noise)


def measured(made: Any, **options: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Error, predicted standard error and flag of `measure`."""
    import sixflow

    return errors_at_points(
        sixflow.measure(made.frame0, made.frame1, window=WINDOW, step=STEP, **options), made
    )


__all__ = ["NOISE", "SMALL", "STEP", "TEXTURES", "WINDOW", "limit", "make_pair", "measured"]
