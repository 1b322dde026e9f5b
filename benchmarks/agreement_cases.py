"""The cases of `agreement.py`: a scene with its truth, and the settings that it is measured with.

Only the public interface of sixflow is used here, so that another version of the package, whatever its inner modules
are called, can be measured on the same frames.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cases import make_pair
from public_cases.case import find_cases, name_of, read_case
from sixflow import convention, synth

SIDE, NOISE = 256, 2.0
SMALL = (2.0, -1.5, 0.008, 0.012, 0.006, -0.005)  # 1 %, as in limit.py
LARGE = (5.0, -4.0, 0.05, 0.08, 0.04, -0.05)  # 5 %, as in limit.py
PUBLIC_SETTINGS: tuple[dict[str, Any], ...] = ({}, {"sharpen": 2, "lighting": "gain+offset"})

Truth = Callable[[NDArray[Any], NDArray[Any]], NDArray[Any]]


@dataclasses.dataclass(frozen=True)
class Scene:
    """Two frames and the six numbers of what is at a point, as a function of (x, y); NaN where unknown."""

    frame0: NDArray[Any]
    frame1: NDArray[Any]
    truth: Truth
    mask: NDArray[Any] | None = None


@dataclasses.dataclass(frozen=True)
class Case:
    """A scene, rendered or read when it is asked for, and the settings."""

    name: str
    scene: Callable[[], Scene]
    options: dict[str, Any]


def speckle(sigma: float = 2.0) -> synth.Pattern:
    return synth.Speckle(sigma=sigma, seed=1)


def particles() -> synth.Pattern:
    return synth.Particles(diameter=4, seed=1)


def natural() -> synth.Pattern:
    """As much contrast in every octave from 4 to 96 px, as natural scenes have."""
    return synth.Texture(shortest=4, longest=96, waves=300, seed=1)


@functools.cache
def affine(
    pattern: synth.Pattern, six: tuple[float, ...] = SMALL, noise: float = NOISE, side: int = SIDE
) -> Scene:
    made = make_pair(pattern, six, side, noise, 1)
    return Scene(made.frame0, made.frame1, made.truth)


def through(camera: synth.Sensor, second: synth.Sensor | None = None, unmatched: float = 0.0) -> Scene:
    """Particles that move by 1 %, through a camera that may change between the frames."""
    pattern = synth.Particles(diameter=4, unmatched=unmatched, seed=1)
    motion = synth.Affine.from_six(SMALL, centre=((SIDE - 1) / 2, (SIDE - 1) / 2))
    made = synth.pair(pattern, motion, (SIDE, SIDE), sensor=(camera, second or camera))
    return Scene(made.frame0, made.frame1, made.truth)


@functools.cache
def flow(motion: synth.Motion, pattern: synth.Pattern) -> Scene:
    made = synth.pair(pattern, motion, (SIDE, SIDE), sensor=synth.Sensor(noise=NOISE, seed=1))
    return Scene(made.frame0, made.frame1, made.truth)


def disc(pattern: Callable[[int], synth.Pattern], masked: bool) -> Scene:
    """A disc of 120 px that moves by (3, 1) px before a background that moves by (−1, −0.5) px.

    `masked`: with a mask that names the two bodies.
    """
    x, y = np.meshgrid(np.arange(SIDE, dtype=float), np.arange(SIDE, dtype=float))
    front, back, middle = (3.0, 1.0), (-1.0, -0.5), (SIDE - 1) / 2

    def inside(x: NDArray[Any], y: NDArray[Any]) -> NDArray[np.bool_]:
        return np.asarray(np.hypot(x - middle, y - middle) < 60)

    frames = []
    for k in (0, 1):
        layers = [
            synth.render(pattern(n), (SIDE, SIDE), synth.Affine.translation(*(k * np.array(shift))))
            for n, shift in enumerate((front, back))
        ]
        covered = inside(x - k * front[0], y - k * front[1])
        frames.append(synth.Sensor(noise=NOISE, seed=1).expose(np.where(covered, *layers), k))

    def truth(x: NDArray[Any], y: NDArray[Any]) -> NDArray[Any]:
        six = np.zeros((*x.shape, 6))
        six[..., :2] = np.where(inside(x, y)[..., None], front, back)
        return six

    return Scene(frames[0], frames[1], truth, np.where(inside(x, y), 2, 1) if masked else None)


def masked(kind: str) -> Scene:
    """Speckle with a hole and a rim left out: by a mask of frame 0, by one for each frame, or by NaN in both."""
    scene = affine(speckle())
    x, y = np.meshgrid(np.arange(SIDE), np.arange(SIDE))
    keep = (np.hypot(x - 150, y - 90) > 30) & (x > 12) & (y < SIDE - 20)
    if kind == "nan":
        frames = (np.where(keep, frame, np.nan) for frame in (scene.frame0, scene.frame1))
        return Scene(*frames, scene.truth)
    return dataclasses.replace(scene, mask=keep if kind == "one" else np.stack([keep, keep]))


def spelled(options: dict[str, Any]) -> str:
    """Settings as a case's name gives them."""
    return ", ".join(f"{key}={value}" for key, value in options.items()) or "default"


def case(name: str, scene: Callable[[], Scene], **options: Any) -> Case:
    return Case(f"{name}; {spelled(options)}" if options else name, scene, options)


def small(name: str, pattern: synth.Pattern, **options: Any) -> Case:
    return case(name, functools.partial(affine, pattern), **options)


def synthetic_cases() -> Iterator[Case]:
    """All cases that are rendered."""
    for sigma in (1.4, 2.0, 2.4):
        yield case(f"speckle σ {sigma}, 1 %, 512²", functools.partial(affine, speckle(sigma), side=512))
        yield case(f"speckle σ {sigma}, 5 %", functools.partial(affine, speckle(sigma), LARGE))
        for degree in ("cubic", "quintic"):
            noiseless = functools.partial(affine, speckle(sigma), noise=0.0)
            yield case(f"speckle σ {sigma}, no noise", noiseless, interpolation=degree)
    for name, pattern in (("particles", particles()), ("natural", natural()), ("texture", synth.Texture())):
        for noise in (1.0, 2.0, 5.0, 12.0):
            yield case(f"{name}, noise {noise:g}", functools.partial(affine, pattern, noise=noise))
        yield case(f"{name}, 5 %", functools.partial(affine, pattern, LARGE))
    yield from _motions()
    yield from _settings()
    yield from _groups()
    yield from _light_and_foreign()


def _motions() -> Iterator[Case]:
    for name, six in (
        ("shift of 23.4 px", (23.4, -11.3, 0, 0, 0, 0)),
        ("rotation by 20°", (0, 0, 2 * np.cos(0.35) - 2, 2 * np.sin(0.35), 0, 0)),
        ("zoom by 1.2", (1, 0, 0.4, 0, 0, 0)),
        ("shear of 0.2", (1, -1, 0, -0.2, 0, 0.2)),
    ):
        yield case(f"speckle, {name}", functools.partial(affine, speckle(), six))
    vortices = synth.CellularVortices(amplitude=2.0, period=160.0)
    star = synth.Star(amplitude=0.5, periods=(60.0, 140.0), columns=(0, SIDE), row=SIDE / 2)
    for options in ({}, {"sharpen": 1}, {"sharpen": 2}, {"sharpen": 4}, {"sharpen": 8, "window": 25}):
        yield case("speckle, vortices", functools.partial(flow, vortices, speckle()), **options)
        yield case("speckle, star", functools.partial(flow, star, speckle()), **options)
    yield case("particles, vortices", functools.partial(flow, vortices, particles()), window="auto")
    yield case("speckle, star", functools.partial(flow, star, speckle()), window="auto")


def _settings() -> Iterator[Case]:
    for window in (8, 11, 16, 21, 41, 62):
        yield small("speckle", speckle(), window=window)
    for step in (4, 5, 11):
        yield small("speckle", speckle(), step=step)
    yield small("speckle", speckle(), step=1, roi="60:140,80:150")
    for name, pattern in (("speckle", speckle()), ("natural", natural())):
        for reference in ("middle", "second"):
            yield small(name, pattern, reference=reference)
        for lighting in ("none", "gain+offset", "local"):
            yield small(name, pattern, lighting=lighting)
        for lowpass in (0.7, 1.5):
            yield small(name, pattern, lowpass=lowpass)
        yield small(name, pattern, method="eigenfilter")
    yield small("speckle", speckle(), reference="middle", lowpass=0.7, lighting="gain+offset")
    yield small("speckle", speckle(), float64=True)
    yield small("speckle", speckle(), robust=False)
    yield small("speckle", speckle(), forward_backward=True)
    for kind in ("one", "two", "nan"):
        for options in ({}, {"lighting": "local"}, {"reference": "middle", "sharpen": 2}):
            yield case(f"speckle, mask: {kind}", functools.partial(masked, kind), **options)


def _groups() -> Iterator[Case]:
    """Motions of each group, and once one that is not of it."""
    turn = (2 * np.cos(0.006) - 2, 2 * np.sin(0.006))
    motions = {
        "similarity": (2.0, -1.5, 0.008, 0.012, 0, 0),
        "euclidean": (2.0, -1.5, *turn, 0, 0),
        "translation": (2.0, -1.5, 0, 0, 0, 0),
    }
    for group, six in motions.items():
        for name, pattern in (("speckle", speckle()), ("natural", natural())):
            yield case(f"{name}, {group}", functools.partial(affine, pattern, six), group=group)
    euclidean = functools.partial(affine, speckle(), motions["euclidean"])
    yield case("speckle, euclidean", euclidean, method="eigenfilter", group="euclidean", reference="middle")
    yield case("speckle, strain of 1 %", functools.partial(affine, speckle()), group="euclidean")


def _light_and_foreign() -> Iterator[Case]:
    plain = synth.Sensor(noise=NOISE, seed=1)
    dim = dataclasses.replace(plain, gain=0.7, offset=20, shading=0.2)
    for lighting in ("auto", "gain+offset", "local"):
        lit = functools.partial(through, plain, dim)
        yield case("particles, light 0.7", lit, lighting=lighting)
    foreign = {
        "shot noise": (dataclasses.replace(plain, electrons=2.0), 0.0),
        "8 bits": (dataclasses.replace(plain, bits=8), 0.0),
        "20 % unmatched": (plain, 0.2),
        "5 % dead": (dataclasses.replace(plain, dead=0.05), 0.0),
        "glare": (dataclasses.replace(plain, glare=2.0), 0.0),
        "all three": (dataclasses.replace(plain, dead=0.05, glare=2.0), 0.2),
    }
    for name, (camera, unmatched) in foreign.items():
        for options in ({}, {"reference": "middle"}, {"robust": False}):
            yield case(
                f"particles, {name}", functools.partial(through, camera, unmatched=unmatched), **options
            )
    for name, pattern in (
        ("speckle", lambda n: synth.Speckle(seed=n)),
        ("particles", lambda n: synth.Particles(diameter=4, seed=n)),
    ):
        yield case(f"{name}, disc", functools.partial(disc, pattern, False))
        yield case(f"{name}, disc, two bodies", functools.partial(disc, pattern, True))
        yield case(f"{name}, disc, two bodies", functools.partial(disc, pattern, True), sharpen=2, window=21)


def public_cases(root: Path) -> Iterator[Case]:
    """The cases of a folder whose motion is known (`public_cases.case`), each with `PUBLIC_SETTINGS`.

    Raises
    ------
    public_cases.case.CaseError
        If the folder holds no such case.
    """
    for folder in find_cases(str(root)):
        name = name_of(folder, root)
        for options in PUBLIC_SETTINGS:
            yield Case(f"{name}; {spelled(options)}", functools.partial(_read, folder, name), options)


@functools.lru_cache(maxsize=1)
def _read(folder: Path, name: str) -> Scene:
    read = read_case(folder, name)

    def truth(x: NDArray[Any], y: NDArray[Any]) -> NDArray[Any]:
        columns, rows = x[0], y[:, 0]
        displacement = np.moveaxis(read.truth.displacement(columns, rows), 0, -1)
        gradient = np.moveaxis(read.truth.gradient(columns, rows), 0, -1)
        return convention.six_from_gradient(displacement, gradient.reshape(*gradient.shape[:-1], 2, 2))

    return Scene(read.frame0, read.frame1, truth)
