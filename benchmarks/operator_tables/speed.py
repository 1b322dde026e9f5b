"""Speed: the array of the default bank over a 1024² pair, and whole measurements.

Machines are shared: the least of several runs counts, and the least-squares method in the same run is the yardstick.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from sixflow.eigenfilters.passes import EigenfilterPasses

import sixflow
from cases import show, verdict
from operator_tables.ensemble import NOISE, SMALL, STEP, TEXTURES, WINDOW, make_pair
from sixflow.pair.session import Session
from sixflow.settings import Settings

SIDE = 1024
TARGET = 0.6  # s


def table(quick: bool = False) -> None:
    """Print times of one pass and of whole measurements."""
    made = make_pair(TEXTURES["speckle σ 2"](0), SMALL, SIDE, NOISE, 0)
    settings = Settings(window=WINDOW, step=STEP, method="eigenfilter")
    session = Session(settings, None)
    frames = [session.prepare(frame, "frame").frame for frame in (made.frame0, made.frame1)]
    passes = EigenfilterPasses(*frames, session.grid, settings, session.workspace)
    maps = session.grid.plane(np.zeros(6))
    runs = 3 if quick else 9
    bank = passes.array.projection.bank
    one = _least(lambda: passes.solve(maps), runs)
    whole = _least(lambda: sixflow.measure(made.frame0, made.frame1, settings=settings), runs)
    plain = _least(lambda: sixflow.measure(made.frame0, made.frame1, window=WINDOW, step=STEP), runs)
    points = passes.pool.lattice.rows * passes.pool.lattice.columns
    rows = [
        [
            f"one pass: warp, {len(bank)} kernels and their six derivatives at {points} positions, pooled",
            f"{one * 1e3:.0f}",
            f"{one / plain:.1f}",
            verdict(one <= TARGET),
        ],
        [
            'measure(method="eigenfilter"): search, refinement, covariance',
            f"{whole * 1e3:.0f}",
            f"{whole / plain:.1f}",
            "",
        ],
        ["measure: least squares", f"{plain * 1e3:.0f}", "1", ""],
    ]
    show(f"Speed, {SIDE}², step {STEP}; target of the bank ≤ {TARGET} s", ["what", "ms", "ratio", ""], rows)


def _least(run: Callable[[], Any], runs: int) -> float:
    """Least time of several runs after a first one, s."""
    run()
    times = []
    for _ in range(runs):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return min(times)
