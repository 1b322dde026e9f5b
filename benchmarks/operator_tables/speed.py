"""Speed: whole measurements of a 1024² pair by the array of the default bank, and by least squares on pixels.

Processor time, the least of several runs: machines are shared. Both methods stand in the same run.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, get_args

import sixflow
from cases import show
from operator_tables.ensemble import NOISE, SMALL, STEP, TEXTURES, WINDOW, make_pair
from sixflow.settings import Method

SIDE = 1024


def table(quick: bool = False) -> None:
    """Print times of whole measurements."""
    made = make_pair(TEXTURES["speckle σ 2"](0), SMALL, SIDE, NOISE, 0)
    runs = 2 if quick else 5
    seconds = {
        method: _least(
            lambda method=method: sixflow.measure(
                made.frame0, made.frame1, window=WINDOW, step=STEP, method=method
            ),
            runs,
        )
        for method in get_args(Method)
    }
    yardstick = seconds["least_squares"]
    rows = [[name, f"{1e3 * least:.0f}", f"{least / yardstick:.1f}"] for name, least in seconds.items()]
    show(f"Speed, {SIDE}², step {STEP}", ["measure by", "processor ms", "ratio"], rows)


def _least(run: Callable[[], Any], runs: int) -> float:
    """Least processor time of several runs after a first one, s."""
    run()
    times = []
    for _ in range(runs):
        start = time.process_time()
        run()
        times.append(time.process_time() - start)
    return min(times)
