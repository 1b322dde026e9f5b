"""How fast, beside peers in the same run, and what it costs: time, points per second, memory, start.

    python benchmarks/speed.py

Peers: OpenCV's Farnebäck and DIS optical flow, which give two numbers and no error (`pip install
sixflow[benchmarks]`). Machines are shared and noisy: the calls are interleaved, the smallest of several times count,
and ratios are printed. Processor time, of all threads together, is what a call costs; wall time beside it
shows what the threads bring, and what else the machine was doing.
"""

from __future__ import annotations

import argparse
import os
import random
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

import sixflow
from cases import console, show, verdict
from sixflow import synth
from sixflow.engine.threads import worker_count

MOTION = (2.3, -1.7, 0.01, 0.015, 0.008, -0.006)


def frames(side: int) -> tuple[np.ndarray, np.ndarray]:
    """An 8-bit speckle pair; beyond 1024², one tile repeated, which is all the same to the speed."""
    tile = min(side, 1024)
    centre = ((tile - 1) / 2, (tile - 1) / 2)
    made = synth.pair(
        synth.Speckle(seed=1),
        synth.Affine.from_six(MOTION, centre=centre),
        (tile, tile),
        sensor=synth.Sensor(noise=2, bits=8),
    )
    repeat = (side // tile, side // tile)
    return np.tile(made.frame0, repeat), np.tile(made.frame1, repeat)


class Cost(NamedTuple):
    """Seconds of a call."""

    wall: float
    processor: float

    @classmethod
    def least(cls, costs: list[Cost]) -> Cost:
        """The least wall time and the least processor time of several calls."""
        return cls(min(cost.wall for cost in costs), min(cost.processor for cost in costs))


def interleaved(calls: dict[str, Callable[[], object]], repeats: int) -> dict[str, Cost]:
    """Least cost of each call, all called in turn, each turn in another order; one call of each to warm up."""
    shuffle = random.Random(0).shuffle
    names = list(calls)
    costs: dict[str, list[Cost]] = {name: [] for name in calls}
    for turn in range(repeats + 1):
        shuffle(names)
        for name in names:
            call = calls[name]
            time.sleep(0.05)  # a peer's threads may spin for a while after its call; let them come to rest
            wall, processor = time.perf_counter(), time.process_time()
            call()
            if turn:
                cost = Cost(time.perf_counter() - wall, time.process_time() - processor)
                costs[name].append(cost)
    return {name: Cost.least(values) for name, values in costs.items()}


def peers(repeats: int) -> None:
    frame0, frame1 = frames(1024)
    calls: dict[str, Callable[[], object]] = {
        "sixflow": lambda: sixflow.measure(frame0, frame1),
        "sixflow window=31": lambda: sixflow.measure(frame0, frame1, window=31),
        "sixflow 31 cubic": lambda: sixflow.measure(frame0, frame1, window=31, interpolation="cubic"),
        "sixflow 31 sharpen=2": lambda: sixflow.measure(frame0, frame1, window=31, sharpen=2),
        "sixflow 31 step=4": lambda: sixflow.measure(frame0, frame1, window=31, step=4),
        "sixflow threads=1": lambda: sixflow.measure(frame0, frame1, threads=1),
    }
    try:
        import cv2
    except ImportError:
        console.print("OpenCV is not installed: no peers (pip install 'sixflow[benchmarks]')")
    else:
        cv2.setNumThreads(worker_count())
        dis = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
        calls["OpenCV Farnebäck"] = lambda: cv2.calcOpticalFlowFarneback(
            frame0, frame1, None, 0.5, 4, 15, 3, 7, 1.5, 0
        )
        calls["OpenCV DIS medium"] = lambda: dis.calc(frame0, frame1, None)
    costs = interleaved(calls, repeats)
    ours = costs["sixflow"]
    rows = []
    for name, cost in costs.items():
        step = 4 if "step=4" in name else 8
        points = f"{(1024 // step) ** 2 / cost.processor:,.0f}" if "sixflow" in name else "–"
        ratios = f"{ours.processor / cost.processor:.2f}", f"{ours.wall / cost.wall:.2f}"
        rows.append([name, f"{1000 * cost.processor:.1f}", f"{1000 * cost.wall:.1f}", points, *ratios])
    show(
        f"Whole call, 1024² pair, {worker_count()} threads",
        ["", "processor ms", "wall ms", "points/s of a processor", "sixflow / this", "wall"],
        rows,
    )
    rows = []
    if "OpenCV Farnebäck" in costs:
        for name, limit in (("OpenCV Farnebäck", 2.2), ("OpenCV DIS medium", 5.0)):
            ratio = ours.processor / costs[name].processor
            rows.append(
                [f"processor time / {name}", f"{ratio:.2f}", f"≤ {limit:.2f}", verdict(ratio <= limit)]
            )
    rate = 256**2 / costs["sixflow 31 step=4"].processor
    rows.append(["points/s of a processor at step 4", f"{rate:,.0f}", "≥ 700,000", verdict(rate >= 7e5)])
    show("Targets", ["", "measured", "target", ""], rows)


def small(repeats: int) -> None:
    """Small pairs, of which Python is a large part, and whether they gain from a second thread."""
    rows = []
    for side, limit in ((128, None), (256, 9), (512, None)):
        frame0, frame1 = frames(side)
        calls: dict[str, Callable[[], object]] = {
            f"threads={count}": lambda count=count: sixflow.measure(frame0, frame1, threads=count)  # noqa: B023
            for count in (1, 2)
        }
        one, two = interleaved(calls, 3 * repeats).values()
        cells = [f"{1000 * value:.1f}" for value in (one.processor, two.processor, one.wall, two.wall)]
        done = "" if limit is None else verdict(1000 * one.processor <= limit)
        rows.append([f"{side}²", *cells, "" if limit is None else f"≤ {limit}", done])
    header = ["", "processor ms, 1 thread", "2 threads", "wall ms, 1 thread", "2 threads", "target", ""]
    show("Small pairs, window 31, step 8", header, rows)


def cost(repeats: int) -> None:
    frame0, frame1 = frames(1024)
    calls: dict[str, Callable[[], object]] = {}
    for window in (21, 31, 61, 91):
        for step in (4, 8, 16):
            calls[f"{window}/{step}"] = lambda window=window, step=step: sixflow.measure(
                frame0, frame1, window=window, step=step
            )
    costs = interleaved(calls, max(3, repeats // 2))
    rows = [
        [
            f"window {window}",
            *(f"{1000 * costs[f'{window}/{step}'].processor:.0f}" for step in (4, 8, 16)),
            *(f"{1000 * costs[f'{window}/{step}'].wall:.0f}" for step in (4, 8, 16)),
        ]
        for window in (21, 31, 61, 91)
    ]
    header = ["", "processor: step 4", "8", "16", "wall: step 4", "8", "16"]
    show("Cost of window and step: ms for a 1024² pair", header, rows)


_MEMORY = """
import re
import numpy as np
import sixflow
def peak_memory():  # VmHWM, unlike getrusage, does not count what the parent process had used
    return int(re.search(r"VmHWM:\\s+(\\d+)", open("/proc/self/status").read())[1])
frame0, frame1 = np.load({file!r})
rows = slice(0, 128)
sixflow.measure(frame0[rows, rows], frame1[rows, rows])
base = peak_memory()
field = sixflow.measure(frame0, frame1)
peak = peak_memory()
print(base / 1024, peak / 1024, field.attrs["memory_bytes"] / 2**20)
"""


def memory() -> None:
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for side in (1024, 2048, 4096):
            file = os.path.join(folder, "pair.npy")
            np.save(file, np.stack(frames(side)))
            base, peak, stated = map(float, _python(_MEMORY.format(file=file)).split())
            frame = side**2 * 4 / 2**20
            limit = 25 * frame + 200
            added = peak - base
            cells = [f"{added:.0f}", f"{added / frame:.1f}", f"{peak:.0f}", f"{stated:.0f}", f"{limit:.0f}"]
            rows.append([f"{side}²", *cells, verdict(added <= limit)])
    header = [
        "frames",
        "added by measure, MB",
        "= float32 frames",
        "process peak, MB",
        "stated in the field, MB",
        "limit, MB",
        "",
    ]
    show("Memory (limit: 25 float32 frames + 200 MB)", header, rows)


def start() -> None:
    bare, imported = (Cost.least([_timed(code) for _ in range(5)]) for code in ("pass", "import sixflow"))
    first = """
import numpy as np, sixflow
random = np.random.default_rng(0).normal(size=(64, 64))
sixflow.measure(random, random * (1 + 1e-6))
"""
    with tempfile.TemporaryDirectory() as cache:
        environment = os.environ | {"NUMBA_CACHE_DIR": cache}
        compiling = _timed(first, environment)
        later = Cost.least([_timed(first, environment) for _ in range(5)])
    imported = Cost(imported.wall - bare.wall, imported.processor - bare.processor)
    whole = "first measurement of a later process, interpreter included"
    rows = [
        [what, f"{cost.processor:.2f}", f"{cost.wall:.2f}", f"≤ {limit:g}", verdict(cost.processor <= limit)]
        for what, cost, limit in (
            ("import sixflow", imported, 0.3),
            ("first measurement ever, compiling", compiling, 15),
            (whole, later, 0.9),
        )
    ]
    show("Start, s", ["", "processor", "wall", "target", ""], rows)


def _python(code: str, environment: dict[str, str] | None = None) -> str:
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, check=True, capture_output=True, text=True
    )
    return done.stdout


def _timed(code: str, environment: dict[str, str] | None = None) -> Cost:
    """Cost of a process that runs a program."""
    environment = dict(os.environ if environment is None else environment)
    environment.pop("PYTHONDONTWRITEBYTECODE", None)  # as an installed package has it
    wall, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    _python(code, environment)
    wall, after = time.perf_counter() - wall, resource.getrusage(resource.RUSAGE_CHILDREN)
    return Cost(wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--repeats", type=int, default=9, help="calls of which the least counts")
    repeats = parser.parse_args().repeats
    console.print(f"sixflow {sixflow.__version__}, {worker_count()} processors\n")
    peers(repeats)
    small(repeats)
    cost(repeats)
    memory()
    start()


if __name__ == "__main__":
    main()
