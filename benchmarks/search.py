"""Large motion without a first guess: what is found, how well it is refined, what is wrong and not flagged; time.

    python benchmarks/search.py              200 motions on two patterns, about 15 minutes on two cores
    python benchmarks/search.py --quick      20 motions

The motions are F = zoom · R(angle) (I + ½ [[a, b], [b, −a]]) with any angle, zoom from ½ to 2 (uniform in logarithm),
√(a² + b²) ≤ 0.3, and the middle of the frame moved by up to a quarter of it in each direction. *Found*: of the points
that stay in both frames with half their window, at least 90 % are given and right. *Wrong*: given, and off by more than
0.3 px and 5 standard errors. *Refined*: root mean square error over the predicted one.

Peers get the same frames. They do not flag, so *found* is what counts for them: right to 1 px.
"""

from __future__ import annotations

import argparse
import math
import time
from typing import Any, NamedTuple

import numpy as np

import sixflow
from cases import console, rms, show, verdict
from sixflow import synth
from sixflow.convention import SIX
from sixflow.prepare.frame import NO_MASK, Frame
from sixflow.search.plane import find_plane

SIDE, WINDOW, NOISE = 512, 31, 2.0
PATTERNS = {
    "speckle": lambda seed: synth.Speckle(seed=seed),
    "band-limited texture": lambda seed: synth.Texture(seed=seed),
}


class Result(NamedTuple):
    """Of one pair: share of the points that stay given and right, wrong points, refinement, seconds, overlap."""

    right: float
    wrong: int
    refined: float
    seconds: float
    overlap: float


def random_motion(seed: int, side: int = SIDE) -> synth.Affine:
    """One of the motions of this page."""
    rng = np.random.default_rng([20, seed])
    angle, zoom = rng.uniform(-np.pi, np.pi), 2 ** rng.uniform(-1, 1)
    shear, axis = rng.uniform(0, 0.3), rng.uniform(0, 2 * np.pi)
    shift = rng.uniform(-side / 4, side / 4, 2)
    R = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    S = np.eye(2) + shear / 2 * np.array(
        [[math.cos(axis), math.sin(axis)], [math.sin(axis), -math.cos(axis)]]
    )
    middle = (side - 1) / 2
    G = zoom * R @ S - np.eye(2)
    return synth.Affine(tuple(shift), tuple(map(tuple, G)), (middle, middle))


def make(kind: str, seed: int, side: int = SIDE) -> Any:
    sensor = synth.Sensor(noise=NOISE, bits=8, seed=seed)
    return synth.pair(PATTERNS[kind](seed), random_motion(seed, side), (side, side), sensor=sensor)


def inside(x: np.ndarray, y: np.ndarray, margin: float, side: int = SIDE) -> np.ndarray:
    return (x >= margin) & (x <= side - 1 - margin) & (y >= margin) & (y <= side - 1 - margin)


def ours(made: Any, **options: Any) -> Result:
    begin = time.perf_counter()
    field = sixflow.measure(made.frame0, made.frame1, window=WINDOW, **options)
    seconds = time.perf_counter() - begin
    x, y = np.meshgrid(field.x.values.astype(float), field.y.values.astype(float))
    six = np.stack([field[name].values[0] for name in SIX], axis=-1).astype(float)
    truth = made.truth(x, y)
    to_x, to_y = x + truth[..., 0], y + truth[..., 1]
    error = np.hypot(*np.moveaxis(six - truth, -1, 0)[:2])
    variance = np.diagonal(field.covariance.values[0], axis1=-2, axis2=-1)[..., :2].sum(axis=-1)
    limit = np.maximum(0.3, 5 * np.sqrt(variance / 2))
    given = np.isfinite(error)
    # a point whose partner lies outside frame 1 by less than that is not wrong to be there
    wrong = given & ((error > limit) | ~inside(to_x, to_y, -0.3))
    stays = inside(x, y, WINDOW / 2) & inside(to_x, to_y, WINDOW / 2)
    right = given & ~wrong & stays
    refined = rms(error[right]) / math.sqrt(variance[right].mean()) if right.any() else math.nan
    return Result(
        float(right[stays].mean()) if stays.any() else math.nan,
        int(wrong.sum()),
        refined,
        seconds,
        float(inside(to_x, to_y, 0).mean()),
    )


def peers() -> dict[str, Any]:
    """Dense fields (u, v) by OpenCV, where it is installed."""
    try:
        import cv2
    except ImportError:
        console.print("OpenCV is not installed: no peers (pip install 'sixflow[benchmarks]')")
        return {}

    def farneback(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return cv2.calcOpticalFlowFarneback(a, b, None, 0.5, 5, 31, 5, 7, 1.5, 0)

    def dis(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM).calc(a, b, None)

    def features(detector: Any, norm: int) -> Any:
        def match(a: np.ndarray, b: np.ndarray) -> np.ndarray | None:
            (points0, seen0), (points1, seen1) = (detector.detectAndCompute(frame, None) for frame in (a, b))
            if seen0 is None or seen1 is None:
                return None
            matches = cv2.BFMatcher(norm, crossCheck=True).match(seen0, seen1)
            if len(matches) < 3:
                return None
            ends = [
                np.array([points0[m.queryIdx].pt for m in matches]),
                np.array([points1[m.trainIdx].pt for m in matches]),
            ]
            A, _ = cv2.estimateAffine2D(*ends, ransacReprojThreshold=2)
            if A is None:
                return None
            x, y = np.meshgrid(np.arange(a.shape[1]), np.arange(a.shape[0]))
            moved = np.stack([x, y, np.ones_like(x)], axis=-1) @ A.T
            return moved - np.stack([x, y], axis=-1)

        return match

    found = {"OpenCV Farnebäck": farneback, "OpenCV DIS medium": dis}
    for name, norm in (("ORB", cv2.NORM_HAMMING), ("AKAZE", cv2.NORM_HAMMING), ("SIFT", cv2.NORM_L2)):
        create = getattr(cv2, f"{name}_create", None)  # not every build of OpenCV has all of them
        if create is not None:
            found[f"OpenCV {name}, one affine map"] = features(
                create(3000) if name == "ORB" else create(), norm
            )
    return found


def of_peer(call: Any, made: Any) -> Result:
    frames = [frame.astype(np.uint8) for frame in (made.frame0, made.frame1)]
    begin = time.perf_counter()
    flow = call(*frames)
    seconds = time.perf_counter() - begin
    x, y = np.meshgrid(np.arange(3, SIDE, 8), np.arange(3, SIDE, 8))
    truth = made.truth(x.astype(float), y.astype(float))[..., :2]
    to_x, to_y = x + truth[..., 0], y + truth[..., 1]
    stays = inside(x, y, WINDOW / 2) & inside(to_x, to_y, WINDOW / 2)
    if flow is None:
        return Result(0.0, 0, math.nan, seconds, float(inside(to_x, to_y, 0).mean()))
    error = np.linalg.norm(flow[3::8, 3::8] - truth, axis=-1)[stays]
    return Result(float((error < 1).mean()), int((error >= 1).sum()), math.nan, seconds, 0.0)


def row(name: str, results: list[Result]) -> list[str]:
    right = np.array([result.right for result in results])
    refined = np.array([result.refined for result in results])
    known = refined[np.isfinite(refined)]
    return [
        name,
        f"{100 * (right >= 0.9).mean():.1f}",
        f"{100 * np.median(right):.1f}",
        f"{np.median(known):.2f}" if known.size else "–",
        f"{np.quantile(known, 0.95):.2f}" if known.size else "–",
        f"{sum(result.wrong for result in results)}",
        f"{np.median([result.seconds for result in results]):.2f}",
    ]


HEADER = ["", "found, %", "right, median %", "refined", "refined, 95 %", "wrong points", "s per pair"]


def capture(count: int, others: dict[str, Any]) -> None:
    for kind in PATTERNS:
        results: dict[str, list[Result]] = {name: [] for name in ("auto", "spectrum", "pyramid", *others)}
        for seed in range(count):
            made = make(kind, seed)
            for search in ("auto", "spectrum", "pyramid"):
                if search == "auto" or seed < max(20, count // 10):
                    results[search].append(ours(made, search=search))
            if seed < max(20, count // 10):
                for name, call in others.items():
                    results[name].append(of_peer(call, made))
            last = results["auto"][-1]
            if last.right < 0.9 or last.wrong:
                console.print(
                    f"{kind}, motion {seed}: {100 * last.right:.1f} % right, {last.wrong} wrong, "
                    f"overlap {100 * last.overlap:.0f} %"
                )
        rows = []
        for name, values in results.items():
            label = f'search="{name}"' if name not in others else name
            rows.append(row(label if len(values) == count else f"{label} ({len(values)})", values))
        show(f"{kind}, {SIDE}², {count} motions", HEADER, rows)
        share = np.mean([result.right >= 0.9 for result in results["auto"]])
        wrong = sum(result.wrong for result in results["auto"])
        show(
            "Targets",
            ["", "measured", "target", ""],
            [
                ["found, %", f"{100 * share:.1f}", "≥ 95", verdict(bool(share >= 0.95))],
                ["wrong and not flagged", f"{wrong}", "0", verdict(wrong == 0)],
            ],
        )


def seconds_of_search(count: int) -> None:
    """Time of the global search alone, and of whole measurements, on 1024²."""
    rows = []
    for kind in PATTERNS:
        spent, processor, whole = [], [], []
        for seed in range(count):
            made = make(kind, seed, 1024)
            frames = [Frame(frame.astype(np.float32) - 128, NO_MASK) for frame in (made.frame0, made.frame1)]
            begin, busy = time.perf_counter(), time.process_time()
            find_plane(*frames, WINDOW)
            processor.append(time.process_time() - busy)
            middle = time.perf_counter()
            sixflow.measure(made.frame0, made.frame1)
            spent.append(middle - begin)
            whole.append(time.perf_counter() - middle)
        median = float(np.median(spent))
        cells = [
            f"{median:.2f}",
            f"{max(spent):.2f}",
            f"{np.median(processor):.2f}",
            f"{np.median(whole):.2f}",
            "≤ 1",
            verdict(median <= 1),
        ]
        rows.append([kind, *cells])
    header = [
        "",
        "global search, median s",
        "longest s",
        "processor s",
        "whole measurement, median s",
        "target",
        "",
    ]
    show("Time on 1024²", header, rows)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="20 motions")
    parser.add_argument("--motions", type=int, default=200, help="how many; 200 if not given")
    arguments = parser.parse_args()
    count = 20 if arguments.quick else arguments.motions
    console.print(f"sixflow {sixflow.__version__}\n")
    ours(make("speckle", 0))  # compiled and loaded
    seconds_of_search(2 if arguments.quick else 5)
    capture(count, peers())


if __name__ == "__main__":
    main()
