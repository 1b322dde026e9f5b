"""Outlying pixels: unmatched particles, dead pixels, glare, motion edges, with `robust` off and on, beside
peers.

    python benchmarks/robust.py            about a minute on two cores
    python benchmarks/robust.py --seeds 1  fewer repetitions

Everything is rendered by `sixflow.synth`: the truth is exact. *limit* is the Cramér–Rao value of the same window
without anything foreign; *spread* that of u and v over their predicted standard errors, of the points without a flag;
*wrong* are points off by more than 5 standard errors; *flagged* and *lost* are the shares of the wrong and of the
other points whose flags make them NaN. A wave at the limit of resolution is wrong by 10 % everywhere, which its
covariance does not know; there is no wrong and right to tell, and only the share of NaN counts. Peers give two
numbers and no error: their rms error over the same points of a complete window is printed where they are installed.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import io
from collections.abc import Callable
from typing import Any

import numpy as np

import sixflow
from cases import console, cramer_rao, rms, show, verdict
from sixflow import synth
from sixflow.convention.flags import FAILING
from sixflow.maps.grid import Grid

SIDE, WINDOW, STEP, NOISE = 384, 31, 8, 2.0
SIX = (2.0, -1.5, 0.008, 0.012, 0.006, -0.005)
CENTRE = ((SIDE - 1) / 2, (SIDE - 1) / 2)
DEAD, GLARE = {"dead": 0.05}, {"glare": 2.0}


@dataclasses.dataclass(frozen=True)
class Shown:
    """A pair, the pattern whose limit counts, and the truth at points, shape (…, 6)."""

    frame0: np.ndarray
    frame1: np.ndarray
    pattern: synth.Pattern
    truth: Callable[[np.ndarray, np.ndarray], np.ndarray]


def particles(seed: int, unmatched: float = 0.0) -> synth.Particles:
    return synth.Particles(diameter=4, unmatched=unmatched, seed=seed)


def speckle(seed: int, unmatched: float = 0.0) -> synth.Speckle:
    return synth.Speckle(seed=seed)


def affine(make: Callable[..., Any], seed: int, unmatched: float = 0.0, **sensor: float) -> Shown:
    """An affine motion of 1 %, up to 5 px."""
    camera = synth.Sensor(noise=NOISE, seed=seed, **sensor)  # type: ignore[arg-type]
    motion = synth.Affine.from_six(SIX, centre=CENTRE)
    made = synth.pair(make(seed, unmatched), motion, (SIDE, SIDE), sensor=camera)
    return Shown(made.frame0, made.frame1, make(seed), made.truth)


def moving(make: Callable[..., Any], motion: synth.Motion, seed: int) -> Shown:
    made = synth.pair(make(seed), motion, (SIDE, SIDE), sensor=synth.Sensor(noise=NOISE, seed=seed))
    return Shown(made.frame0, made.frame1, make(seed), made.truth)


def disc(make: Callable[..., Any], seed: int) -> Shown:
    """A disc of 180 px that moves by (3, 1) px before a background that moves by (−1, −0.5) px."""
    x, y = np.meshgrid(np.arange(SIDE, dtype=float), np.arange(SIDE, dtype=float))
    front, back = (3.0, 1.0), (-1.0, -0.5)

    def inside(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.hypot(x - CENTRE[0], y - CENTRE[1]) < 90

    frames = []
    for k in (0, 1):
        layers = [
            synth.render(make(seed + 50 * n), (SIDE, SIDE), synth.Affine.translation(*(k * np.array(d))))
            for n, d in enumerate((front, back))
        ]
        covered = inside(x - k * front[0], y - k * front[1])
        camera = synth.Sensor(noise=NOISE, seed=seed)
        frames.append(camera.expose(np.where(covered, layers[0], layers[1]), k))

    def truth(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        six = np.zeros((*x.shape, 6))
        six[..., :2] = np.where(inside(x, y)[..., None], front, back)
        return six

    return Shown(frames[0], frames[1], make(seed), truth)


CASES: dict[str, Callable[[int], Shown]] = {
    "speckle, clean": lambda seed: affine(speckle, seed),
    "particles, clean": lambda seed: affine(particles, seed),
    "particles, shot noise": lambda seed: affine(particles, seed, electrons=2.0),
    "particles, 20 % unmatched": lambda seed: affine(particles, seed, 0.2),
    "speckle, 5 % dead pixels": lambda seed: affine(speckle, seed, **DEAD),
    "particles, 5 % dead pixels": lambda seed: affine(particles, seed, **DEAD),
    "speckle, glare": lambda seed: affine(speckle, seed, **GLARE),
    "particles, glare": lambda seed: affine(particles, seed, **GLARE),
    "particles, all three": lambda seed: affine(particles, seed, 0.2, **DEAD, **GLARE),
    "speckle, disc before a background": lambda seed: disc(speckle, seed),
    "particles, disc before a background": lambda seed: disc(particles, seed),
}
WAVES: dict[str, Callable[[int], Shown]] = {
    f"{name}, {what}": lambda seed, make=make, motion=motion: moving(make, motion, seed)
    for name, make in (("speckle", speckle), ("particles", particles))
    for what, motion in (
        ("vortices of 240 px", synth.CellularVortices(amplitude=2.0, period=240.0)),
        ("vortices of 160 px", synth.CellularVortices(amplitude=2.0, period=160.0)),
        (
            "wave of 120 px",
            synth.Star(amplitude=2.0, periods=(120.0, 120.0), columns=(0, SIDE), row=SIDE / 2),
        ),
    )
}


@dataclasses.dataclass
class Sums:
    """What is gathered of a case over seeds."""

    errors: list[np.ndarray] = dataclasses.field(default_factory=list)
    limits: list[np.ndarray] = dataclasses.field(default_factory=list)
    scaled: list[np.ndarray] = dataclasses.field(default_factory=list)
    wrong: int = 0
    wrong_flagged: int = 0
    good: int = 0
    good_lost: int = 0

    def add(self, shown: Shown, robust: bool) -> None:
        """Measure a pair and count; wrong or right is asked of the value that a flag may have made NaN."""
        options = {"window": WINDOW, "step": STEP, "robust": robust}
        field = sixflow.measure(shown.frame0, shown.frame1, **options)
        grid = Grid.over((SIDE, SIDE), STEP)
        x, y = np.meshgrid(grid.x.astype(float), grid.y.astype(float))
        truth = shown.truth(x, y)
        stays = np.ones(x.shape, bool)
        for at, d in ((x, truth[..., 0]), (y, truth[..., 1])):
            stays &= (at + d >= 0) & (at + d <= SIDE - 1)
        flag = field.flag.values[0].astype(int)
        error = np.stack([field[name].values[0] for name in sixflow.convention.SIX], -1) - truth
        predicted = np.sqrt(np.diagonal(field.covariance.values[0], axis1=-2, axis2=-1))
        failed = (flag & FAILING) != 0
        with np.errstate(invalid="ignore"):
            wrong = ~failed & (np.abs(error[..., :2]) > 5 * predicted[..., :2]).any(axis=-1)
        good = ~failed & ~wrong
        complete = flag == 0
        self.errors.append(error[complete][:, :2])
        self.scaled.append((error / predicted)[complete][:, :2])
        self.limits.append(cramer_rao(shown.pattern, SIDE, grid, WINDOW, NOISE)[complete][:, :2])
        hidden_wrong, hidden_good = hidden(shown, options, truth, failed & stays)
        self.wrong += int((wrong & stays).sum()) + hidden_wrong
        self.wrong_flagged += hidden_wrong
        self.good += int((good & stays).sum()) + hidden_good
        self.good_lost += hidden_good


def hidden(shown: Shown, options: dict[str, Any], truth: np.ndarray, failed: np.ndarray) -> tuple[int, int]:
    """How many of the failed points have a wrong value, and how many a good one, that their flags hide."""
    if not failed.any():
        return 0, 0
    from sixflow import between

    tries: list[tuple[Any, Any, Any]] = []
    judge = between.flag_points

    def listen(maps: Any, quality: Any, *rest: Any) -> Any:
        flag = judge(maps, quality, *rest)
        tries.append((maps.copy(), quality.covariance.copy(), flag.copy()))
        return flag

    between.flag_points = listen  # type: ignore[assignment]
    try:
        field = sixflow.measure(shown.frame0, shown.frame1, **options)
    finally:
        between.flag_points = judge
    maps, variance, _ = max(tries, key=lambda one: int((one[2] == field.flag.values[0]).sum()))
    off = np.abs(np.moveaxis(maps[:2], 0, -1) - truth[..., :2])
    error = np.sqrt(np.stack([variance[..., k, k] for k in (0, 1)], axis=-1))
    good = (off <= 5 * error).all(axis=-1)
    return int((failed & ~good).sum()), int((failed & good).sum())


def peer_errors(shown: Shown) -> dict[str, np.ndarray]:
    """Errors (u, v) of OpenCV's and OpenPIV's methods at points of a complete window, where they are installed."""
    found: dict[str, np.ndarray] = {}
    low, high = (np.percentile(shown.frame0, q) for q in (0.1, 99.9))
    frames = [
        np.clip((f - low) * 255 / (high - low), 0, 255).astype(np.uint8) for f in (shown.frame0, shown.frame1)
    ]
    inside = slice(WINDOW, SIDE - WINDOW, STEP)
    y, x = np.mgrid[inside, inside].astype(float)
    truth = shown.truth(x, y)[..., :2]
    try:
        import cv2

        flows = {
            "Farnebäck": cv2.calcOpticalFlowFarneback(
                frames[0], frames[1], None, 0.5, 4, WINDOW, 5, 7, 1.5, 256
            ),
            "DIS": cv2.DISOpticalFlow_create(2).calc(frames[0], frames[1], None),
        }
        found |= {name: flow[inside, inside] - truth for name, flow in flows.items()}
    except ImportError:
        pass
    try:
        from openpiv import windef
    except ImportError:
        return found
    settings = windef.PIVSettings()
    settings.windowsizes, settings.overlap, settings.num_iterations = (64, 32, 16), (32, 16, 8), 3
    with contextlib.redirect_stdout(io.StringIO()):  # it prints its counts of bad peaks
        px, py, u, v, _ = windef.simple_multipass(*(f.astype(np.int32) for f in frames), settings)
    u, v, py = np.asarray(u), -np.asarray(v), py[::-1]  # its y axis points up
    middle = np.stack([px - u / 2, py - v / 2])  # and it compares about the middle of the pair
    error = np.stack([u, v], axis=-1) - shown.truth(*middle)[..., :2]
    found["OpenPIV"] = error[4:-4, 4:-4]
    return found


def foreign(seeds: int) -> None:
    rows, peers = [], []
    for name, make in CASES.items():
        errors: dict[str, list[np.ndarray]] = {}
        for robust in (False, True):
            sums = Sums()
            for seed in range(1, seeds + 1):
                sums.add(make(seed), robust)
            error, scaled = np.concatenate(sums.errors), np.concatenate(sums.scaled)
            errors["robust on" if robust else "robust off"] = [error]
            flagged = sums.wrong_flagged / sums.wrong if sums.wrong else np.nan
            lost = sums.good_lost / sums.good
            rows.append(
                [
                    name if not robust else "",
                    "on" if robust else "off",
                    rms(error),
                    rms(error) / rms(np.concatenate(sums.limits)),
                    scaled.std(),
                    f"{100 * sums.wrong / (sums.wrong + sums.good):.2f} %",
                    "–" if np.isnan(flagged) else f"{100 * flagged:.1f} %",
                    f"{100 * lost:.2f} %",
                    verdict((np.isnan(flagged) or flagged >= 0.95) and lost <= 0.01) if robust else "",
                ]
            )
        for seed in range(1, seeds + 1):
            for peer, found in peer_errors(make(seed)).items():
                errors.setdefault(peer, []).append(found.reshape(-1, 2))
        peers.append([name, *(rms(np.concatenate(e)) for e in errors.values())])
    show(
        "Foreign pixels: target: at least 95 % of the wrong flagged, at most 1 % of the others lost",
        ["case", "robust", "rms px", "over limit", "spread", "wrong", "flagged", "lost", ""],
        rows,
    )
    show("Rms error of u and v, px, of all points given", ["case", *errors], peers)


def waves(seeds: int) -> None:
    rows = []
    for name, make in WAVES.items():
        lost, unresolved = [], []
        for seed in range(1, seeds + 1):
            shown = make(seed)
            flag = sixflow.measure(shown.frame0, shown.frame1).flag.values[0].astype(int)
            inside = np.s_[3:-3, 3:-3]
            lost.append(((flag & FAILING) != 0)[inside].mean())
            unresolved.append(((flag & sixflow.convention.flags.FLAGS["unresolved"]) != 0)[inside].mean())
        rows.append([name, f"{100 * np.mean(lost):.2f} %", f"{100 * np.mean(unresolved):.2f} %"])
    show(
        "Smooth flows to the limit of resolution (period 120 px)", ["case", "NaN", "flagged unresolved"], rows
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=3, help="repetitions of every case")
    seeds = parser.parse_args().seeds
    console.print(f"sixflow {sixflow.__version__}\n")
    foreign(seeds)
    waves(seeds)


if __name__ == "__main__":
    main()
