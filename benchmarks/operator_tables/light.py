"""Light: how far changes of light move the six, without noise, in units of the standard error at noise 2.

The second frame's grey values are scaled, shifted, or shaded; what that alone changes in the six is the added bias. The
shading has a slope of 50 % per window: steadily over the whole frame (from 0.5 to 1.5 in 62 px, there and back,
rounded), or as a steady ramp over 62 px about single points.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

import sixflow
from cases import rms, show, verdict
from operator_tables.efficiency import TINY
from operator_tables.ensemble import NOISE, SMALL, TEXTURES, WINDOW, make_pair, measured
from sixflow.convention import SIX
from sixflow.eigenfilters import PooledOperator

TARGET = 0.5  # of the standard error
FIELD_SIDE, POINT_SIDE = 256, 129
MIDDLE = POINT_SIDE // 2

Light = Callable[[Any, Any], Any]


def ramp(frame: Any, x: Any) -> Any:
    """50 % per window, steadily, about the middle of the frame, between 0.5 and 1.5."""
    return frame * (1 + np.clip(0.5 * (x - MIDDLE) / WINDOW, -0.5, 0.5))


def waves(frame: Any, x: Any) -> Any:
    """A sine of shading whose steepest slope is 50 % per window; amplitude 25 %."""
    return frame * (1 + 0.25 * np.sin(2 * x / WINDOW))


LIGHTS: dict[str, Light] = {
    "gain 0.5, offset +50": lambda frame, x: 0.5 * frame + 50,
    "gain 2, offset −50": lambda frame, x: 2 * frame - 50,
    "offset +50": lambda frame, x: frame + 50,
    "shading, waves of 97 px": waves,
}


def table(quick: bool = False) -> None:
    """Print the added bias of `measure` on fields, and of the estimates at points."""
    rows = [_field_row(name, light) for name in TEXTURES for light in LIGHTS]
    header = ["texture: light", *SIX, f"target ≤ {TARGET}"]
    show('Light: added bias over standard error, measure(method="eigenfilter")', header, rows)
    points = dict(LIGHTS) | {"shading, 50 % across the window": ramp}
    seeds = 4 if quick else 12
    rows = [
        _point_row(
            f"{kind}: {name}: {light}",
            texture,
            points[light],
            PooledOperator(WINDOW, phase_only=phase),
            seeds,
        )
        for kind, phase in (("eigenvalue", False), ("phase", True))
        for name, texture in TEXTURES.items()
        for light in points
    ]
    show("Light: added bias over standard error, at points", header, rows)


def _field_row(name: str, light: str) -> list[Any]:
    pattern = TEXTURES[name](0)
    clean, noisy = (make_pair(pattern, SMALL, FIELD_SIDE, noise, 0) for noise in (0.0, NOISE))
    _, error, flag = measured(noisy, method="eigenfilter")
    x = np.arange(FIELD_SIDE, dtype=float)
    before, after = (
        sixflow.measure(clean.frame0, second, window=WINDOW, method="eigenfilter")
        for second in (clean.frame1, LIGHTS[light](clean.frame1, x))
    )
    change = np.stack([(after[k] - before[k]).values[0] for k in SIX], axis=-1)
    good = (flag == 0) & np.isfinite(change).all(axis=-1)
    return _row(f"{name}: {light}", change[good], error[good])


def _point_row(name: str, texture: Any, light: Light, operator: PooledOperator, seeds: int) -> list[Any]:
    changes, errors = [], []
    x = np.arange(POINT_SIDE, dtype=float)
    for seed in range(seeds):
        clean, noisy = (make_pair(texture(seed), TINY, POINT_SIDE, noise, seed) for noise in (0.0, NOISE))
        at = [MIDDLE], [MIDDLE]
        covariance = operator.estimate(noisy.frame0, noisy.frame1, *at).covariance[0]
        errors.append(np.sqrt(np.diagonal(covariance)))
        before, after = (
            operator.estimate(clean.frame0, second, *at).six[0]
            for second in (clean.frame1, light(clean.frame1, x))
        )
        changes.append(after - before)
    return _row(name, np.array(changes), np.array(errors))


def _row(name: str, change: np.ndarray, error: np.ndarray) -> list[Any]:
    ratio = rms(change, 0) / rms(error, 0)
    return [name, *(f"{r:.3f}" for r in ratio), verdict(ratio.max() <= TARGET)]
