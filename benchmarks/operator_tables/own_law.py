"""Own law: one operator alone, on a pure deformation of its generator about its centre, without noise.

The kernels are chosen on principle, not for a texture: a wave of 9 to 10 px where the window is largest, in the middle
of what speckles and particle images contain; as many periods under the window as leave a range of 2 × 0.1 and more;
and a window that has fallen to nothing at the edge of the patch, since cutting it off is a change of the kernel that
moves with nothing. For the curl any window of r only is exact.

Every texture seed is a pair of frames of its own, deformed about the operator's centre. Readings are those of stable
operators at the default thresholds, phase over order −Δφ/u (the paper's) and phase over instantaneous frequency −Δφ/ν.
A target is met if the worst of them meets it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from cases import show, verdict
from sixflow import synth
from sixflow.convention import SIX, six_from_coefficients
from sixflow.eigenfilters import Gabor, Hyperbolic, LiteralOperator, Spiral
from sixflow.eigenfilters.kernel import Kernel
from sixflow.engine.window import window_sigma

WINDOW = 31


class Case(NamedTuple):
    """An operator with its patch, and the τ up to which its law is a target."""

    kernel: Kernel
    radius: int
    order: float
    most: float

    @property
    def range(self) -> float:
        """π/u."""
        return math.pi / self.order


def _cases() -> dict[str, Case]:
    wave, sigma = 2 * math.pi / 10, window_sigma(WINDOW)
    quarter = math.pi / wave / 2  # half the range, a quarter of the wavelength
    ring = {"scale": 18.0, "bandwidth": 0.4}
    return {
        "u": Case(Gabor(wave, 0.0, sigma=sigma), 35, wave, quarter),
        "v": Case(Gabor(wave, math.pi / 2, sigma=sigma), 35, wave, quarter),
        "divergence": Case(Spiral(12.0, 0, **ring), 73, 12.0, 0.1),
        "curl": Case(Spiral(0.0, 6, scale=12.0, bandwidth=0.3), 35, 6.0, math.pi / 12),
        "stretch": Case(Hyperbolic("stretch", 12.0, width=0.3, **ring), 73, 12.0, 0.1),
        "shear": Case(Hyperbolic("shear", 12.0, width=0.3, **ring), 73, 12.0, 0.1),
    }


TEXTURES: dict[str, Callable[[int], synth.Pattern]] = {
    "speckle": lambda seed: synth.Speckle(sigma=2, seed=seed),
    "particles": lambda seed: synth.Particles(diameter=4, seed=seed),
    "texture": lambda seed: synth.Texture(seed=seed),
}
PARTS = (0.05, 0.25, 0.5, 1.0)  # of the τ of the target
RANGE_PARTS = (0.25, 0.5, 0.75, 0.9, 0.97)  # of π/u
CURL_TARGET, OTHER_TARGET, WRAPPED = 1e-3, 0.02, 0.1


def moved(pattern: Any, name: str, tau: float, radius: int) -> np.ndarray:
    """The frame of a pattern that has moved along one generator by τ about the middle of the patch."""
    coefficients = np.zeros(6)
    coefficients[SIX.index(name)] = tau
    motion = synth.Affine.from_six(tuple(six_from_coefficients(coefficients)), centre=(radius, radius))
    return synth.render(pattern, (2 * radius + 1,) * 2, motion)


def readings(name: str, case: Case, make: Callable[[int], Any], taus: list[float], seeds: int) -> np.ndarray:
    """Shape (seeds, τ, 3): −Δφ/u, −Δφ/ν, and whether the operator is stable."""
    operator = LiteralOperator(case.kernel, radius=case.radius, noise=0)
    out = np.empty((seeds, len(taus), 3))
    for seed in range(seeds):
        pattern = make(seed)
        still = moved(pattern, name, 0.0, case.radius)
        for k, tau in enumerate(taus):
            found = operator.estimate(
                still, moved(pattern, name, tau, case.radius), [case.radius], [case.radius]
            )
            at = (0, 0, SIX.index(name))
            out[seed, k] = found.tau[at], found.tau_by_frequency[at], found.stable[0, 0]
    return out


def table(quick: bool = False) -> None:
    """Print the errors up to the target's τ, and how far the range goes."""
    seeds = 4 if quick else 24
    law, reach = [], []
    for name, case in _cases().items():
        near = [part * case.most for part in PARTS]
        far = [part * case.range for part in RANGE_PARTS]
        right = np.zeros((2, len(far)))
        count = np.zeros(len(far))
        for texture, make in TEXTURES.items():
            found = readings(name, case, make, near + far, seeds)
            tau = np.array(near + far)
            stable = found[..., 2] == 1
            error = np.abs(found[..., :2] - tau[:, None])
            law.append(_law_row(name, texture, case, error[:, : len(near)], tau[: len(near)], stable))
            inside = (error <= WRAPPED * tau[:, None]) & stable[..., None]
            right += inside[:, len(near) :].sum(axis=0).T
            count += stable[:, len(near) :].sum(axis=0)
        shares = right / np.maximum(count, 1)
        reach.append(
            [
                name,
                f"{case.range:.3g}{' px' if name in 'uv' else ''}",
                *(f"{100 * share:.0f} %" for share in shares[0]),
                *(f"{100 * share:.0f} %" for share in shares[1]),
            ]
        )
    show(
        f"Own law: one operator alone, noise-free, {seeds} patterns of each kind × {len(PARTS)} τ up to the given one. "
        f"Errors of stable readings: of the curl in rad, target {CURL_TARGET:g}; of the others as part of τ, target "
        f"{OTHER_TARGET:g} (u, v: up to half the range, a quarter of the wavelength)",
        [
            *("operator", "texture", "τ up to", "stable"),
            *("Δφ/u: median", "worst", "≤ target"),
            *("Δφ/ν: median", "worst", "≤ target", "(of all)"),
            *("Δφ/u", "Δφ/ν"),
        ],
        law,
    )
    parts = [f"{part:g}" for part in RANGE_PARTS]
    show(
        f"Range |uτ| < π: share of stable readings within {100 * WRAPPED:.0f} % of τ, at parts of π/u",
        ["operator", "π/u", *(f"Δφ/u {p}" for p in parts), *(f"Δφ/ν {p}" for p in parts)],
        reach,
    )


def _law_row(
    name: str, texture: str, case: Case, error: np.ndarray, tau: np.ndarray, stable: np.ndarray
) -> list[str]:
    stable = stable[:, : len(tau)]
    target = CURL_TARGET if name == "curl" else OTHER_TARGET
    error = error if name == "curl" else error / tau[:, None]
    (median, worst, met), (median_f, worst_f, met_f) = (
        (np.median(kept), kept.max(), (kept <= target).mean()) for kept in error[stable].T
    )
    return [
        *(name, texture, f"{case.most:.3g}", f"{100 * stable.mean():.0f} %"),
        *(f"{median:.1e}", f"{worst:.1e}", f"{100 * met:.1f} %"),
        *(f"{median_f:.1e}", f"{worst_f:.1e}", f"{100 * met_f:.1f} %"),
        f"{100 * (error[..., 1] <= target).mean():.0f} %",
        *(verdict(worst <= target), verdict(worst_f <= target)),
    ]
