"""How near to the physical limit: efficiency, coverage, bias, sharpening, and a vortex field, each
beside its limit or target.

    python benchmarks/limit.py            all tables, about three minutes on two cores
    python benchmarks/limit.py --seeds 2  fewer repetitions

Everything is rendered by `sixflow.synth`: the truth is exact and free of interpolation. `ratio` is the
rms error over the rms of the Cramér–Rao value of the same window; `spread` is the standard deviation of
error / predicted standard error.
"""

from __future__ import annotations

import argparse

import numpy as np

import sixflow
from cases import console, cramer_rao, errors_at_points, make_pair, rms, show, verdict
from sixflow import synth
from sixflow.convention import SIX
from sixflow.engine.response import response as response_of
from sixflow.engine.window import sharpening_noise, window_sigma
from sixflow.maps.grid import Grid

SIDE, WINDOW, STEP, NOISE = 512, 31, 8, 2.0
SMALL = (2.0, -1.5, 0.008, 0.012, 0.006, -0.005)  # about 1 %, up to 6 px in the corners
LARGE = (5.0, -4.0, 0.05, 0.08, 0.04, -0.05)  # about 5 %, up to 29 px in the corners


def speckle(sigma: float):
    return lambda seed: synth.Speckle(sigma=sigma, seed=seed)


def particles(seed: int) -> synth.Particles:
    return synth.Particles(diameter=4, seed=seed)  # e⁻² diameter: a Gaussian of σ = 1 px


def texture(seed: int) -> synth.Texture:
    return synth.Texture(seed=seed)


def efficiency(seeds: int) -> None:
    cases = [(f"speckle σ {s}, 1 %", speckle(s), SMALL, 1.05) for s in (1.4, 2.0, 2.4)]
    cases += [(f"speckle σ {s}, 5 %", speckle(s), LARGE, 1.10) for s in (1.4, 2.0, 2.4)]
    cases += [("particles σ 1, 1 %", particles, SMALL, 1.10), ("particles σ 1, 5 %", particles, LARGE, 1.10)]
    rows = []
    grid = Grid.over((SIDE, SIDE), STEP)
    for name, make, six, target in cases:
        errors, limits, wild, valid, seen = [], [], 0, 0, 0
        for seed in range(seeds):
            pattern = make(seed)
            made = make_pair(pattern, six, SIDE, NOISE, seed)
            error, predicted, flag = errors_at_points(
                sixflow.measure(made.frame0, made.frame1, window=31), made
            )
            good = flag == 0
            errors.append(error[good])
            limits.append(cramer_rao(pattern, SIDE, grid, WINDOW, NOISE)[good])
            known = np.isfinite(error[..., 0])
            x, y = np.meshgrid(grid.x, grid.y)
            truth = made.truth(x.astype(float), y.astype(float))
            stays = ((x + truth[..., 0]).clip(0, SIDE - 1) == x + truth[..., 0]) & (
                (y + truth[..., 1]).clip(0, SIDE - 1) == y + truth[..., 1]
            )
            valid, seen = valid + int((known & stays).sum()), seen + int(stays.sum())
            far = np.abs(error[known][:, :2]) > np.maximum(0.1, 6 * predicted[known][:, :2])
            wild += int(far.any(axis=1).sum())
        ratio = rms(np.concatenate(errors), 0) / rms(np.concatenate(limits), 0)
        share = valid / seen
        met = bool((ratio <= target).all()) and share >= 0.995 and wild == 0
        rows.append([name, *ratio, target, f"{100 * share:.2f} %", str(wild), verdict(met)])
    show(
        "Efficiency: rms error / Cramér–Rao value of the same window "
        f"(noise {NOISE:g} of 255, {SIDE}², window {WINDOW}, step {STEP})",
        ["case", *SIX, "target ≤", "valid (of points that stay)", "unflagged outliers", ""],
        rows,
    )


def coverage(seeds: int) -> None:
    rows = []
    for name, make in (
        ("speckle σ 2", speckle(2.0)),
        ("particles σ 1", particles),
        ("texture 6–24 px", texture),
    ):
        for noise in (1.0, 2.0, 5.0):
            standardised = []
            for seed in range(seeds):
                made = make_pair(make(seed), SMALL, SIDE, noise, seed)
                error, predicted, flag = errors_at_points(
                    sixflow.measure(made.frame0, made.frame1, window=31), made
                )
                standardised.append((error / predicted)[flag == 0])
            z = np.concatenate(standardised)
            spread = z.std(axis=0)
            inside = (np.abs(z) < 1).mean(), (np.abs(z) < 1.96).mean()
            sampling = 1 / np.sqrt(2 * seeds * SIDE**2 / WINDOW**2)
            met = bool((np.abs(spread - 1) <= 0.05).all())
            cells = [f"{100 * share:.1f} %" for share in inside]
            rows.append([f"{name}, noise {noise:g}", *spread, *cells, f"± {sampling:.3f}", verdict(met)])
    show(
        "Coverage: spread of standardised errors (target 0.95–1.05), share inside 1 and 1.96 (68.3 %, 95 %)",
        ["case", *SIX, "68.3 %", "95 %", "sampling", ""],
        rows,
    )


def bias() -> None:
    rows = []
    for interpolation, limit_u, limit_g in (("cubic", 1e-3, 1e-4), ("quintic", 1e-4, 1e-4)):
        for sigma in (1.4, 2.0, 2.4):
            made = make_pair(synth.Speckle(sigma=sigma, seed=1), SMALL, SIDE, 0.0, 1)
            field = sixflow.measure(made.frame0, made.frame1, window=31, interpolation=interpolation)
            error, _, flag = errors_at_points(field, made)
            error = error[flag == 0]
            worst_u, worst_g = rms(error[:, :2], 0).max(), rms(error[:, 2:], 0).max()
            met = worst_u <= limit_u and worst_g <= limit_g
            extreme = f"{np.abs(error[:, :2]).max():.1e}"
            rows.append(
                [
                    f"{interpolation}, speckle σ {sigma}",
                    f"{worst_u:.1e}",
                    extreme,
                    f"{limit_u:.0e}",
                    f"{worst_g:.1e}",
                    f"{limit_g:.0e}",
                    verdict(met),
                ]
            )
    show("Bias without noise", ["case", "u, v rms px", "u, v max px", "≤", "gradients rms", "≤", ""], rows)


def sharpening(seeds: int) -> None:
    rows = []
    sigma = window_sigma(WINDOW)
    for sharpen in (0, 1, 2, 4):
        for period in (60.0, 90.0, 140.0):
            motion = synth.Star(amplitude=0.5, periods=(period, period), columns=(0, SIDE), row=SIDE / 2)
            made = synth.pair(synth.Speckle(seed=3), motion, (SIDE, SIDE))
            field = sixflow.measure(made.frame0, made.frame1, window=31, sharpen=sharpen, tolerance=1e-3)
            x, y = np.meshgrid(field.x.values.astype(float), field.y.values.astype(float))
            truth = made.truth(x, y)[..., 1]
            good = field.flag.values[0] == 0
            response = (field.v.values[0][good] * truth[good]).sum() / (truth[good] ** 2).sum()
            whole = np.exp(-((2 * np.pi / period * sigma) ** 2) / 2)
            theory = response_of(whole, sharpen)
            rows.append(
                [
                    f"n = {sharpen}, period {period:g}",
                    response,
                    theory,
                    response / theory,
                    verdict(abs(response / theory - 1) <= 0.05),
                ]
            )
    show(
        "Sharpening: response to a sine displacement",
        ["case", "measured", "theory", "ratio", "within 5 %"],
        rows,
    )
    rows = []
    base = None
    for sharpen in (0, 1, 2, 4):
        errors = []
        for seed in range(2 * seeds):
            made = make_pair(synth.Speckle(seed=seed), (0.3, -0.4, 0, 0, 0, 0), SIDE, NOISE, seed)
            error, _, flag = errors_at_points(
                sixflow.measure(made.frame0, made.frame1, window=31, sharpen=sharpen), made
            )
            errors.append(error[flag == 0])
        spread = np.concatenate(errors).std(axis=0)
        base = spread if base is None else base
        factor = np.array([rms(spread[:2]) / rms(base[:2]), rms(spread[2:]) / rms(base[2:])])
        theory = np.array(sharpening_noise(sharpen))
        met = bool((np.abs(factor / theory - 1) <= 0.05).all())
        rows.append([f"n = {sharpen}", factor[0], theory[0], factor[1], theory[1], verdict(met)])
    show(
        "Sharpening: noise relative to n = 0",
        ["case", "u, v", "theory", "gradients", "theory", "within 5 %"],
        rows,
    )


def vortices(seeds: int) -> None:
    rows = []
    for settings in ({}, {"sharpen": 1}, {"sharpen": 2}, {"window": 25, "sharpen": 2}):
        errors, spreads = [], []
        for seed in range(seeds):
            motion = synth.CellularVortices(amplitude=2.0, period=160.0)
            made = synth.pair(
                synth.Speckle(seed=seed), motion, (SIDE, SIDE), sensor=synth.Sensor(noise=NOISE, seed=seed)
            )
            error, predicted, flag = errors_at_points(
                sixflow.measure(made.frame0, made.frame1, **settings), made
            )
            errors.append(error[flag == 0])
            spreads.append((error / predicted)[flag == 0])
        error = np.concatenate(errors)
        divergence, curl, stretch, shear = error[:, 2:].T
        gradient = rms(np.stack([divergence + stretch, divergence - stretch, shear - curl, shear + curl]) / 2)
        u = rms(error[:, 0])
        spread = np.concatenate(spreads).std(axis=0)
        name = ", ".join(f"{k}={v}" for k, v in settings.items()) or "defaults"
        rows.append(
            [
                name,
                u,
                gradient,
                spread[:2].mean(),
                spread[2:].mean(),
                verdict(u <= 0.018 and gradient <= 2.3e-3),
            ]
        )
    rows.append(["(second-order DIC subsets)", 0.0185, 3.8e-3, "", "", ""])
    rows.append(["(first-order DIC subsets)", 0.118, 5.3e-3, "", "", ""])
    show(
        "Cellular vortices, amplitude 2 px, period 160 px, noise 2: target u ≤ 0.018 px, gradients ≤ 2.3e-3",
        ["setting", "u rmse px", "gradient rmse", "spread u, v", "spread gradients", ""],
        rows,
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=6, help="repetitions of every random case")
    seeds = parser.parse_args().seeds
    console.print(f"sixflow {sixflow.__version__}\n")
    efficiency(seeds)
    coverage(seeds)
    bias()
    sharpening(seeds)
    vortices(max(2, seeds // 2))


if __name__ == "__main__":
    main()
