"""Resolution: noise × period of sharpening against theory, and the automatic window against every fixed one.

    python benchmarks/resolution.py            both tables, about three minutes on two cores
    python benchmarks/resolution.py --seeds 2  fewer repetitions

Everything is rendered by `sixflow.synth`. In the first table a wave of the theory's period P and a shift are measured:
the response at P must be 0.9, the noise that of theory. In the second, `auto/best` is the rms error of `window="auto"`
over that of the ladder's window that is best in the case, which nobody knows beforehand; and over window 31, sharpen 2.
`spread` is the standard deviation of error / predicted standard error.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

import sixflow
from cases import console, errors_at_points, rms, show, verdict
from sixflow import synth
from sixflow.engine.response import resolved
from sixflow.engine.window import attenuation_period, sharpening_noise, window_sigma
from sixflow.plan import LADDER, SHARPEN

SIDE, WINDOW, NOISE = 512, 31, 2.0
SHARP_CUT = (np.sqrt(-2 * np.log(0.9)), -np.sqrt(2) * np.log(0.9))
"""Noise × period and noise × period² of an ideal low-pass, relative to one window's."""


def sharpening(seeds: int) -> None:
    sigma = window_sigma(WINDOW)
    plain = attenuation_period(sigma)
    noises = {sharpen: _noise(sharpen, seeds) for sharpen in (0, 1, 2, 4, 8, 16)}
    rows = []
    for sharpen, noise in noises.items():
        period = attenuation_period(sigma, sharpen)
        response = _response(sharpen, period)
        ratio = period / plain
        theory = np.array(sharpening_noise(sharpen)) * (ratio, ratio**2)
        measured = noise / noises[0] * (ratio, ratio**2)
        old = _repeated(sharpen)
        met = abs(response / 0.9 - 1) <= 0.05 and bool((abs(measured / theory - 1) <= 0.05).all())
        rows.append(
            [
                f"{sharpen}",
                period,
                response,
                measured[0],
                theory[0],
                old[0],
                measured[1],
                theory[1],
                old[1],
                verdict(met),
            ]
        )
    rows.append(["sharp cut", "", "", "", SHARP_CUT[0], "", "", SHARP_CUT[1], "", ""])
    show(
        f"Sharpening, window {WINDOW}: noise × period at 10 % attenuation, relative to one window "
        "(gradient: × period²); theory of repeated corrections beside it",
        [
            "sharpen",
            "P px",
            "response at P",
            "u, v",
            "theory",
            "repeated",
            "gradients",
            "theory",
            "repeated",
            "5 %",
        ],
        rows,
    )


def _repeated(sharpen: int) -> np.ndarray:
    """Noise × period and × period² of T = 1 − (1 − M)^(n+1), relative to one window."""
    x = np.linspace(0, 40, 400001)
    power = (1 - (1 - np.exp(-x)) ** (sharpen + 1)) ** 2
    scale = np.log(resolved(0)) / np.log(resolved(sharpen))
    step = x[1]
    return np.array([np.sqrt(2 * power.sum() * step * scale), np.sqrt(4 * (x * power).sum() * step) * scale])


def _response(sharpen: int, period: float) -> float:
    motion = synth.Star(amplitude=0.3, periods=(period, period), columns=(0, SIDE), row=SIDE / 2)
    made = synth.pair(synth.Speckle(sigma=1.5, seed=3), motion, (SIDE, SIDE))
    field = sixflow.measure(made.frame0, made.frame1, window=31, sharpen=sharpen, step=4, tolerance=1e-3)
    x, y = np.meshgrid(field.x.values.astype(float), field.y.values.astype(float))
    truth = made.truth(x, y)[..., 1]
    good = (field.flag.values[0] == 0) & (np.abs(y - SIDE / 2) < SIDE / 2 - 80)
    return float((field.v.values[0][good] * truth[good]).sum() / (truth[good] ** 2).sum())


def _noise(sharpen: int, seeds: int) -> np.ndarray:
    """Rms error of displacement and of gradients of a uniform shift, away from the border."""
    errors = []
    for seed in range(seeds):
        made = synth.pair(
            synth.Speckle(seed=seed), synth.Affine.translation(0.3, -0.4), (SIDE, SIDE),
            sensor=synth.Sensor(noise=NOISE, seed=seed),
        )  # fmt: skip
        error, _, _ = errors_at_points(
            sixflow.measure(made.frame0, made.frame1, window=31, sharpen=sharpen), made
        )
        inside = error[8:-8, 8:-8].reshape(-1, 6)
        errors.append(inside[np.isfinite(inside).all(axis=1)])
    spread = np.concatenate(errors).std(axis=0)
    return np.array([rms(spread[:2]), rms(spread[2:])])


def automatic(seeds: int) -> None:
    speckle, centre = synth.Speckle, (127.5, 127.5)
    uniform = synth.Affine.from_six((2.3, -1.4, 0.01, 0.012, 0.006, -0.005), centre=centre)
    slow = synth.CellularVortices(amplitude=2.0, period=160.0)
    fast = synth.CellularVortices(amplitude=1.0, period=48.0)
    wave = synth.Star(amplitude=0.5, periods=(24.0, 200.0), columns=(0, 256), row=128)
    cases = [
        ("uniform, speckle, noise 2", speckle, uniform, 2.0),
        ("vortices 160 px, speckle, noise 2", speckle, slow, 2.0),
        ("vortices 160 px, speckle, noise 10", speckle, slow, 10.0),
        ("vortices 48 px, speckle, noise 2", speckle, fast, 2.0),
        ("vortices 48 px, speckle, noise 10", speckle, fast, 10.0),
        ("waves 24 to 200 px, speckle, noise 5", speckle, wave, 5.0),
    ]
    for density in (0.01, 0.03, 0.1):
        cases += [
            (f"{name}, particles {density:g}/px², noise 2", _particles(density), motion, 2.0)
            for name, motion in (("vortices 160 px", slow), ("vortices 48 px", fast))
        ]
    rows = []
    for name, pattern, motion, noise in cases:
        rows.append([name, *_compared(pattern, motion, noise, seeds)])
    show(
        f"Automatic window: rms error; beside it the best of the windows {', '.join(map(str, LADDER))} "
        f"with sharpen {SHARPEN}",
        ["case", "u, v px", "best", "auto/best", "31: auto/", "gradients", "best", "auto/best", "31: auto/",
         "spread u, v", "gradients", "given", "window", "time"],
        rows,
    )  # fmt: skip


def _particles(density: float):
    return lambda seed: synth.Particles(density=density, diameter=3, seed=seed)


def _compared(pattern, motion, noise: float, seeds: int) -> list[object]:
    names = [*LADDER, "auto"]
    errors: dict[object, list[np.ndarray]] = {name: [] for name in names}
    seconds = dict.fromkeys(names, 0.0)
    spreads, windows, given = [], [], []
    for seed in range(seeds):
        made = synth.pair(pattern(seed=seed), motion, (256, 256), sensor=synth.Sensor(noise=noise, seed=seed))
        for name in names:
            begin = time.perf_counter()
            field = sixflow.measure(made.frame0, made.frame1, window=name, sharpen=SHARPEN)
            seconds[name] += time.perf_counter() - begin
            error, predicted, flag = errors_at_points(field, made)
            errors[name].append(error[flag == 0])
            if name == "auto":
                spreads.append((error / predicted)[flag == 0])
                windows.append(field.attrs["effective_window"])
                given.append(np.isfinite(error[..., 0]).mean())
    cells: list[object] = []
    for part in (slice(0, 2), slice(2, 6)):
        size = {name: rms(np.concatenate(kept)[:, part]) for name, kept in errors.items()}
        least = min(LADDER, key=lambda name: size[name])
        cells += [
            size["auto"],
            f"{size[least]:.3g} ({least})",
            size["auto"] / size[least],
            size["auto"] / size[31],
        ]
    spread = np.concatenate(spreads).std(axis=0)
    return [
        *cells, rms(spread[:2]), rms(spread[2:]), f"{100 * np.mean(given):.1f} %", float(np.median(windows)),
        f"{seconds['auto'] / seconds[31]:.0f} ×",
    ]  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=4, help="repetitions of every random case")
    seeds = parser.parse_args().seeds
    console.print(f"sixflow {sixflow.__version__}\n")
    sharpening(seeds)
    automatic(seeds)


if __name__ == "__main__":
    main()
