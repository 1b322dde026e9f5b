"""What `lowpass` gains in bias and costs in noise, on textures from as fine as the pixels to coarse ones.

    python benchmarks/lowpass.py            half a minute on two cores
    python benchmarks/lowpass.py --seeds 2  fewer repetitions

Shifts of 0.1 to 0.4 px, frames rounded to 8 bits. *bias* is the rms over the shifts of the mean error of u, without
noise; *error* the rms error of u with noise 2 of 255; *spread* the standard deviation of error / predicted standard
error there, 1 where noise is all that is wrong. Truth is exact, but for the last two rows: there software has moved
frame 0 by splines, as frames of benchmarks often are, and what splines do to high frequencies is in the data.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import cache

import numpy as np
from scipy import ndimage

import sixflow
from cases import console, rms, show
from sixflow import synth

SIDE, NOISE = 256, 2.0
SHIFTS = (0.1, 0.2, 0.3, 0.4)
LOWPASS = (0.0, 0.5, 0.7, 1.0)
FINE = 8  # parts of a pixel, along each axis, over which sharp edges are integrated

Moved = Callable[[int, float], np.ndarray]


def rendered(make: Callable[[int], synth.Pattern]) -> Moved:
    """Return a pattern as points of it are, moved to the right."""
    y, x = np.mgrid[:SIDE, :SIDE].astype(float)
    return lambda seed, shift: make(seed)(x - shift, y)


@cache
def sharp_discs(seed: int, shift: float) -> np.ndarray:
    """Dark discs of 3 to 7 px with sharp edges on a bright ground, as pixels without a lens integrate them."""
    rng = np.random.default_rng(seed)
    number = round(0.025 * SIDE**2)
    covered = np.zeros((FINE * SIDE, FINE * SIDE), np.bool_)
    for x, y, radius in zip(
        rng.uniform(-8, SIDE + 8, number) + shift, rng.uniform(-8, SIDE + 8, number),
        rng.uniform(1.5, 3.5, number), strict=True,
    ):  # fmt: skip
        x, y, radius = FINE * (x + 0.5) - 0.5, FINE * (y + 0.5) - 0.5, FINE * radius
        rows, columns = (slice(max(0, int(c - radius)), max(0, int(c + radius + 2))) for c in (y, x))
        there = covered[rows, columns]
        j, i = np.mgrid[: there.shape[0], : there.shape[1]]
        there |= np.hypot(i + columns.start - x, j + rows.start - y) < radius
    return 200 - 150 * covered.reshape(SIDE, FINE, SIDE, FINE).mean(axis=(1, 3))


def by_software(still: Moved, order: int) -> Moved:
    """Frame 0 as rounded, moved by splines of a degree."""
    return lambda seed, shift: ndimage.shift(
        np.round(still(seed, 0.0)), (0, shift), order=order, mode="mirror"
    )


CASES: dict[str, Moved] = {
    "particles of 2 px": rendered(lambda seed: synth.Particles(diameter=2, density=0.06, seed=seed)),
    "particles of 2.5 px": rendered(lambda seed: synth.Particles(diameter=2.5, density=0.06, seed=seed)),
    "particles of 3 px": rendered(lambda seed: synth.Particles(diameter=3, seed=seed)),
    "discs with sharp edges": sharp_discs,
    "speckle σ 1": rendered(lambda seed: synth.Speckle(sigma=1.0, seed=seed)),
    "speckle σ 2": rendered(lambda seed: synth.Speckle(sigma=2.0, seed=seed)),
    "sharp discs, moved by cubic splines": by_software(sharp_discs, 3),
    "speckle σ 1, moved by cubic splines": by_software(
        rendered(lambda seed: synth.Speckle(sigma=1.0, seed=seed)), 3
    ),
}


def errors(
    moved: Moved, seed: int, noise: float, lowpass: float
) -> tuple[list[float], np.ndarray, np.ndarray]:
    """Mean error of u at each shift, and all errors and predicted standard errors."""
    means, found, predicted = [], [], []
    for number, shift in enumerate(SHIFTS):
        rng = np.random.default_rng([seed, number])
        frames = [
            np.clip(np.round(moved(seed, s) + rng.normal(0, noise, (SIDE, SIDE))), 0, 255).astype(np.uint8)
            for s in (0.0, shift)
        ]
        field = sixflow.measure(*frames, lowpass=lowpass, search="pyramid")
        good = field.flag.values[0] == 0
        error = (field.u.values[0] - shift)[good].astype(float)
        means.append(float(error.mean()))
        found.append(error)
        predicted.append(np.sqrt(field.covariance.values[0, ..., 0, 0][good]).astype(float))
    return means, np.concatenate(found), np.concatenate(predicted)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=3, help="repetitions of every case")
    seeds = range(1, parser.parse_args().seeds + 1)
    rows = []
    for name, moved in CASES.items():
        row = [name]
        for lowpass in LOWPASS:
            biases = [errors(moved, seed, 0.0, lowpass)[0] for seed in seeds]
            noisy = [errors(moved, seed, NOISE, lowpass)[1:] for seed in seeds]
            error, predicted = (np.concatenate(part) for part in zip(*noisy, strict=True))
            bias = rms(np.array(biases), (0, 1))
            row.append(f"{1e3 * bias:.2f} {1e3 * rms(error, 0):.1f} {rms(error / predicted, 0):.2f}")
        rows.append(row)
    console.print(f"sixflow {sixflow.__version__}\n")
    show(
        f"lowpass: bias, error [10⁻³ px] and spread (noise {NOISE:g} of 255, window 31)",
        ["texture", *(f"lowpass={s:g}" for s in LOWPASS)],
        rows,
    )


if __name__ == "__main__":
    main()
