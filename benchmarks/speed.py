"""How fast, beside peers in the same run, and what it costs: time, points per second, memory, start.

    python benchmarks/speed.py

Peers: OpenCV's Farnebäck and DIS optical flow, which give two numbers and no error (`pip install
sixflow[benchmarks]`). Machines are shared and noisy: the calls are interleaved, the medians compared,
and ratios printed.
"""

from __future__ import annotations

import argparse
import os
import random
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable

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


def interleaved(calls: dict[str, Callable[[], object]], repeats: int) -> dict[str, float]:
    """Median seconds of each call, all called in turn, each turn in another order; one call of each to warm up."""
    shuffle = random.Random(0).shuffle
    names = list(calls)
    seconds: dict[str, list[float]] = {name: [] for name in calls}
    for turn in range(repeats + 1):
        shuffle(names)
        for name in names:
            call = calls[name]
            time.sleep(0.05)  # a peer's threads may spin for a while after its call; let them come to rest
            start = time.perf_counter()
            call()
            if turn:
                seconds[name].append(time.perf_counter() - start)
    return {name: statistics.median(values) for name, values in seconds.items()}


def peers(repeats: int) -> None:
    frame0, frame1 = frames(1024)
    calls: dict[str, Callable[[], object]] = {
        "sixflow (quintic)": lambda: sixflow.measure(frame0, frame1),
        "sixflow cubic": lambda: sixflow.measure(frame0, frame1, interpolation="cubic"),
        "sixflow sharpen=2": lambda: sixflow.measure(frame0, frame1, sharpen=2),
        "sixflow step=4": lambda: sixflow.measure(frame0, frame1, step=4),
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
    seconds = interleaved(calls, repeats)
    ours = seconds["sixflow (quintic)"]
    rows = []
    for name, value in seconds.items():
        step = 4 if "step=4" in name else 8
        points = f"{(1024 // step) ** 2 / value:,.0f}" if "sixflow" in name else "–"
        rows.append([name, f"{1000 * value:.1f}", points, f"{ours / value:.2f}"])
    show(
        f"Whole call, 1024² pair, window 31, {worker_count()} processors",
        ["", "ms", "points/s", "sixflow / this"],
        rows,
    )
    rows = []
    if "OpenCV Farnebäck" in seconds:
        for name, limit in (("OpenCV Farnebäck", 1 / 3), ("OpenCV DIS medium", 1.0)):
            ratio = ours / seconds[name]
            rows.append([f"time / {name}", f"{ratio:.2f}", f"≤ {limit:.2f}", verdict(ratio <= limit)])
    rate = 256**2 / seconds["sixflow step=4"]
    rows.append(["points/s at step 4", f"{rate:,.0f}", "≥ 500,000", verdict(rate >= 5e5)])
    show("Targets", ["", "measured", "target", ""], rows)


def cost(repeats: int) -> None:
    frame0, frame1 = frames(1024)
    calls: dict[str, Callable[[], object]] = {}
    for window in (21, 31, 61, 91):
        for step in (4, 8, 16):
            calls[f"{window}/{step}"] = lambda window=window, step=step: sixflow.measure(
                frame0, frame1, window=window, step=step
            )
    seconds = interleaved(calls, max(3, repeats // 2))
    rows = [
        [f"window {window}", *(f"{1000 * seconds[f'{window}/{step}']:.0f}" for step in (4, 8, 16))]
        for window in (21, 31, 61, 91)
    ]
    show("Cost of window and step: ms for a 1024² pair", ["", "step 4", "step 8", "step 16"], rows)


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
    rows = []
    seconds = min(_timed("import sixflow") for _ in range(5)) - min(_timed("pass") for _ in range(5))
    rows.append(["import sixflow", f"{seconds:.3f}", "< 0.3", verdict(seconds < 0.3)])
    first = """
import numpy as np, sixflow
random = np.random.default_rng(0).normal(size=(64, 64))
sixflow.measure(random, random * (1 + 1e-6))
"""
    with tempfile.TemporaryDirectory() as cache:
        environment = os.environ | {"NUMBA_CACHE_DIR": cache}
        compile_seconds = _timed(first, environment)
        later = min(_timed(first, environment) for _ in range(3))
    rows.append(
        ["first measurement ever, compiling", f"{compile_seconds:.1f}", "< 20", verdict(compile_seconds < 20)]
    )
    rows.append(
        [
            "first measurement of a later process, interpreter included",
            f"{later:.2f}",
            "< 1",
            verdict(later < 1),
        ]
    )
    show("Start, s", ["", "measured", "target", ""], rows)


def _python(code: str, environment: dict[str, str] | None = None) -> str:
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, check=True, capture_output=True, text=True
    )
    return done.stdout


def _timed(code: str, environment: dict[str, str] | None = None) -> float:
    environment = dict(os.environ if environment is None else environment)
    environment.pop("PYTHONDONTWRITEBYTECODE", None)  # as an installed package has it
    begin = time.perf_counter()
    _python(code, environment)
    return time.perf_counter() - begin


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--repeats", type=int, default=9, help="calls of which the median is taken")
    repeats = parser.parse_args().repeats
    console.print(f"sixflow {sixflow.__version__}, {worker_count()} processors\n")
    peers(repeats)
    cost(repeats)
    memory()
    start()


if __name__ == "__main__":
    main()
