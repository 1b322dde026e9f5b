"""Pairs with known motion: synthetic ones of every kind, and the cases of a folder.

A scene has the name `kind/…/member`. Scenes of one row of the table are added up: the members of a synthetic kind, and
the affine cases of a set; every other public case has its own row.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from public_cases.case import find_cases, name_of, read_case
from sixflow import synth
from sixflow.convention import SIX_FROM_GRADIENT

Array = NDArray[Any]

CAMERA: dict[str, Any] = {"noise": 3.0, "bits": 8}
SEEDS = (1, 2, 3)


@dataclasses.dataclass(frozen=True)
class Scene:
    """Two frames and what is true of them.

    Attributes
    ----------
    row : str
        Row of the table that it is counted in.
    frames : (array, array)
    truth : callable
        (x, y), arrays of one shape, ↦ the six at these places, shape (..., 6); NaN where they are not known.
    mask : bool array or None
        Where to measure.
    """

    row: str
    frames: tuple[Array, Array]
    truth: Callable[[Array, Array], Array]
    mask: NDArray[np.bool_] | None = None


Maker = Callable[[], Scene]


def _made(
    row: str, pattern: synth.Pattern, motion: synth.Motion, shape: tuple[int, int], **sensor: Any
) -> Scene:
    camera = synth.Sensor(**CAMERA | sensor)
    made = synth.pair(pattern, motion, shape, sensor=camera, pixel_integration=2)
    return Scene(row, (made.frame0, made.frame1), made.truth)


def _affine(row: str, pattern: synth.Pattern, seed: int) -> Scene:
    six = np.random.default_rng([7, seed]).normal(0, [3, 3, 0.02, 0.02, 0.02, 0.02])
    motion = synth.Affine.from_six(tuple(six), centre=(191.5, 191.5))
    return _made(row, pattern, motion, (384, 384), seed=seed)


def _vortex(row: str, angle: float, seed: int) -> Scene:
    pattern = synth.Particles(diameter=2.8, rigid=True, unmatched=0.1, seed=seed)
    return _made(
        row, pattern, synth.LambOseen(angle=angle, core=40, centre=(128, 128)), (256, 256), seed=seed
    )


def _cells(row: str, pattern: synth.Pattern, period: float, seed: int) -> Scene:
    motion = synth.CellularVortices(amplitude=2.0, period=period, centre=(11.0 * seed, 17.0 * seed))
    return _made(row, pattern, motion, (384, 384), seed=seed)


def _plate(row: str, noise: float, seed: int) -> Scene:
    """A hole under tension; the mask lies on its rim, and inside it is dark."""
    motion = synth.PlateWithHole(strain=0.01, radius=40, centre=(127.3, 128.6), angle=0.3 * seed)
    x, y = np.meshgrid(np.arange(256.0), np.arange(256.0))
    pattern, camera = synth.Speckle(seed=seed), synth.Sensor(**CAMERA | {"noise": noise, "seed": seed})
    still = synth.Affine.translation(0.0, 0.0)
    material = [motion.mask(x, y), motion.mask(*motion.inverse(x, y))]
    frames = [
        camera.expose(np.where(inside, synth.render(pattern, (256, 256), moved), 30.0), k)
        for k, (inside, moved) in enumerate(zip(material, (still, motion), strict=True))
    ]
    return Scene(row, (frames[0], frames[1]), motion.six, material[0])


def _star(row: str, seed: int) -> Scene:
    motion = synth.Star(amplitude=0.5, periods=(20.0, 200.0), columns=(0.0, 1023.0), row=128.0)
    return _made(row, synth.Speckle(sigma=1.5, seed=seed), motion, (257, 1024), seed=seed)


def _lost(row: str, share: float, diameter: float, brightness: float, noise: float, seed: int) -> Scene:
    """Particles of which some are lost, in a gentle flow."""
    pattern = synth.Particles(
        diameter=diameter, density=0.05, brightness=brightness, brightness_spread=0.4,
        unmatched=share, rigid=True, background=20, seed=seed,
    )  # fmt: skip
    motion = synth.CellularVortices(amplitude=0.6, period=200.0, centre=(31.0, 77.0))
    return _made(row, pattern, motion, (256, 256), noise=noise, seed=seed)


def synthetic() -> Iterator[tuple[str, Maker]]:
    """Names of the synthetic scenes, and what makes them."""
    kinds: dict[str, Callable[[str, int], Scene]] = {
        "affine/speckle": lambda row, seed: _affine(row, synth.Speckle(seed=seed), seed),
        "affine/particles": lambda row, seed: _affine(row, synth.Particles(rigid=True, seed=seed), seed),
    }
    for angle in (0.12, 0.5, 0.8, 1.0):
        kinds[f"vortex/{angle}"] = lambda row, seed, angle=angle: _vortex(row, angle, seed)
    for period in (240.0, 120.0):
        for name, make in (("speckle", synth.Speckle), ("particles", synth.Particles)):
            kinds[f"cells/{period:.0f} {name}"] = lambda row, seed, period=period, make=make: _cells(
                row, make(seed=seed), period, seed
            )
    kinds["plate/little noise"] = lambda row, seed: _plate(row, 0.5, seed)
    kinds["plate/noise"] = lambda row, seed: _plate(row, 3.0, seed)
    kinds["star"] = lambda row, seed: _star(row, seed)
    kinds["lost/30 % of 2 px"] = lambda row, seed: _lost(row, 0.3, 2.0, 150.0, 4.0, seed)
    kinds["lost/30 % of 1.6 px"] = lambda row, seed: _lost(row, 0.3, 1.6, 150.0, 4.0, seed)
    kinds["lost/40 % of 2 px, faint"] = lambda row, seed: _lost(row, 0.4, 2.0, 60.0, 4.0, seed)
    for kind, of_kind in kinds.items():
        for seed in SEEDS:
            yield f"{kind}/{seed}", lambda kind=kind, of_kind=of_kind, seed=seed: of_kind(kind, seed)


def public(folder: str) -> Iterator[tuple[str, Maker]]:
    """Names of the cases of a folder, and what reads them; `CaseError` if it holds none."""
    root = Path(folder)
    for path in find_cases(folder):
        yield name_of(path, root), lambda path=path: _read(path, root)


def _read(path: Path, root: Path) -> Scene:
    case = read_case(path, name_of(path, root))

    def truth(x: Array, y: Array) -> Array:
        columns, rows = x[0], y[:, 0]
        gradient = case.truth.gradient(columns, rows)
        six = np.tensordot(SIX_FROM_GRADIENT, np.concatenate([np.zeros_like(gradient[:2]), gradient]), axes=1)
        six[:2] = case.truth.displacement(columns, rows)
        return np.moveaxis(six, 0, -1)

    affine = case.truth.constant is not None
    row = f"{case.set_name}, affine" if affine else case.name
    return Scene(row, (case.frame0, case.frame1), truth)
