"""From frames to the world: are the standard errors of every interpretation right, and how good is time to contact.

    python benchmarks/scenes.py           200 scenes, about two minutes on two cores
    python benchmarks/scenes.py --quick   40 scenes
    python benchmarks/scenes.py --first 5000   200 others

Planes in known rigid motion are rendered by `sixflow.synth`, measured and interpreted. `spread` is the standard
deviation of error / standard error over the scenes, ideally 1; `mean` is its mean, ideally 0.

With the environment variable SIXFLOW_BENCHMARKS naming a folder of benchmark cases, the looming sequence
real/nasa_coke in it is interpreted too.
"""

from __future__ import annotations

import argparse
import json
import math
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import sixflow
from cases import console, rms, show, verdict
from sixflow import synth
from sixflow.interpretation import (
    Estimate,
    axis_rotation,
    ego_motion,
    fanning,
    fit_region,
    focus_of_expansion,
    plane_and_motion,
    slant_and_tilt,
    time_to_contact,
)
from sixflow.scenes import Camera, Plane, RigidMotion, calibrate, homography_flow, plane_homography

NOISE, FOCAL, SIDE = 2.0, 400.0, 192
CAMERA = Camera(FOCAL, ((SIDE - 1) / 2, (SIDE - 1) / 2))
LOWEST, HIGHEST = 0.9, 1.1


class Scene(NamedTuple):
    """A plane in motion, with the plane in the middle of the frame interval, and its measured field."""

    plane: Plane
    motion: RigidMotion
    middle: Plane
    field: Any


def make_scene(seed: int, turning: bool) -> Scene:
    """A slanted plane 2 m away that comes nearer and moves across, with or without rotation."""
    rng = np.random.default_rng((seed, 1))  # a stream of its own
    plane = Plane.from_slant(2.0, rng.uniform(0.4, 0.9), rng.uniform(-math.pi, math.pi))
    direction, across = rng.uniform(-math.pi, math.pi), rng.uniform(0.02, 0.05)
    V = (across * math.cos(direction), across * math.sin(direction), rng.uniform(0.03, 0.06))
    rotation = tuple(rng.uniform(-0.01, 0.01, 3)) if turning else (0.0, 0.0, 0.0)
    motion = RigidMotion(V, rotation)
    view = synth.PlaneInView(CAMERA, plane, motion)
    sensor = synth.Sensor(noise=NOISE, seed=50_000 + seed)
    made = synth.pair(synth.Speckle(seed=seed), view, (SIDE, SIDE), sensor=sensor)
    return Scene(
        plane, motion, plane.moved(motion.displacement(0.5)), sixflow.measure(made.frame0, made.frame1)
    )


def of_region(scene: Scene, fit: Any) -> Iterator[tuple[str, Any, Any]]:
    truth = homography_flow(plane_homography(CAMERA, scene.plane, scene.motion), centre=fit.centre)
    errors = np.sqrt(np.diagonal(fit.eight.covariance))
    for name, value, error, true in zip(
        ("u0", "v0", "A", "B", "C", "D", "E", "F"),
        fit.eight.coefficients,
        errors,
        truth.coefficients,
        strict=True,
    ):
        yield f"region: {name}", Estimate(value, error), true
    numbers = ("u", "v", "divergence", "curl", "stretch", "shear")
    six, spread = fit.six_at(CAMERA.centre)
    true_six = calibrate(CAMERA, scene.middle, scene.motion).six
    for k, name in enumerate(numbers):
        yield f"six at the principal point: {name}", Estimate(six[k], math.sqrt(spread[k, k])), true_six[k]
    found, (E, F) = fanning(fit), truth.coefficients[6:]
    yield "fanning: size", found.size, math.hypot(E, F)
    yield "fanning: direction", found.direction, math.atan2(F, E)


def closing(scene: Scene, point: tuple[float, float]) -> float:
    """Rate at which the distance along the line of sight is used up, in the middle of the interval."""
    ray = CAMERA.direction(*point)
    m = ray / np.linalg.norm(ray)
    return float(-m @ scene.motion.scene_translation * (m @ scene.middle.scaled_normal))


def of_the_six(scene: Scene, fit: Any, known: dict[str, Any], said: str) -> Iterator[tuple[str, Any, Any]]:
    contact = time_to_contact(fit, CAMERA, **known)
    rate = closing(scene, contact.point)
    yield f"time to contact, {said}", contact.time, 1 / rate + 0.5
    yield f"rate of approach, {said}", contact.approach_rate, rate
    surface = slant_and_tilt(fit, CAMERA, **known)
    yield f"slant, {said}", surface.slant, scene.middle.slant
    yield f"tilt, {said}", surface.tilt, scene.middle.tilt
    if "heading" in known:
        yield (
            "rotation about the optical axis, known heading",
            axis_rotation(fit, CAMERA, heading=known["heading"]).rate,
            scene.motion.rotation[2],
        )


def of_the_eight(scene: Scene, fit: Any) -> Iterator[tuple[str, Any, Any]]:
    distance, V, Omega = scene.middle.distance, scene.motion.translation, scene.motion.rotation
    solutions = plane_and_motion(fit, CAMERA, distance=distance, length_unit="m")
    nearest = min(solutions, key=lambda one: np.linalg.norm(one.solution.normal - scene.middle.normal))
    yield "plane: slant", nearest.slant, scene.middle.slant
    yield "plane: tilt", nearest.tilt, scene.middle.tilt
    towards = float(np.array(scene.middle.normal) @ V) / distance
    yield "plane: time to contact", nearest.time_to_contact, 1 / towards + 0.5
    ego = ego_motion(fit, CAMERA, scene.plane)
    for said, found in (("plane", nearest), ("known plane", ego)):
        for k, axis in enumerate("XYZ"):
            yield f"{said}: V_{axis}", getattr(found, f"V_{axis}"), V[k]
            yield f"{said}: Ω_{axis}", getattr(found, f"Omega_{axis}"), Omega[k]
    yield "known plane: speed", ego.speed, float(np.linalg.norm(V))
    yield "known plane: closing speed", ego.closing_speed, towards * distance
    yield "known plane: time to contact", ego.time_to_contact, 1 / towards + 0.5


def of_heading(scene: Scene, fit: Any) -> Iterator[tuple[str, Any, Any]]:
    V = scene.motion.translation
    found = focus_of_expansion(fit, CAMERA)
    yield "focus of expansion: x", found.x, CAMERA.centre[0] + FOCAL * V[0] / V[2]
    yield "focus of expansion: y", found.y, CAMERA.centre[1] + FOCAL * V[1] / V[2]
    yield "focus of expansion: angle", found.angle, math.atan2(math.hypot(V[0], V[1]), V[2])


def standardised(estimate: Estimate, truth: float) -> float:
    error = estimate.value - truth
    if estimate.unit == "rad":
        error = (error + math.pi) % (2 * math.pi) - math.pi
    return error / estimate.standard_error


def close_the_loop(count: int, first: int) -> None:
    found: dict[str, list[float]] = {}
    lost: dict[str, int] = {}
    misfits, inside = [], 0
    for seed in range(first, first + count):
        turning, still = make_scene(seed, True), make_scene(10_000 + seed, False)
        fit, still_fit = fit_region(turning.field), fit_region(still.field)
        misfits += [fit.misfit.value, still_fit.misfit.value]
        heading = {"heading": turning.motion.translation}
        outputs = [
            *of_region(turning, fit),
            *of_the_six(turning, fit, heading, "known heading"),
            *of_the_eight(turning, fit),
            *of_the_six(still, still_fit, {"rotation": (0, 0, 0)}, "no rotation"),
            *of_heading(still, still_fit),
        ]
        for name, estimate, truth in outputs:
            values = found.setdefault(name, [])
            if estimate.determined:
                values.append(standardised(estimate, truth))
            else:
                lost[name] = lost.get(name, 0) + 1
        bounds = time_to_contact(fit, CAMERA)
        inside += bounds.earliest.value < 1 / closing(turning, bounds.point) + 0.5 < bounds.latest.value
    sampling = 1 / math.sqrt(2 * count)
    rows = []
    for name, values in found.items():
        z = np.array(values)
        good = LOWEST <= z.std() <= HIGHEST
        rows.append(
            [name, z.mean(), z.std(), (np.abs(z) < 1.96).mean(), str(lost.get(name, 0)), verdict(good)]
        )
    show(
        f"Closing the loop: {count} planes in view, {SIDE}², noise {NOISE:g} of 255 "
        f"(target: spread {LOWEST}–{HIGHEST}; its sampling error here is {sampling:.2f})",
        ["output", "mean", "spread", "within 1.96", "undetermined", ""],
        rows,
    )
    spreads = np.array([np.std(values) for values in found.values()])
    console.print(
        f"{len(rows)} outputs: median spread {np.median(spreads):.3f}, "
        f"from {spreads.min():.3f} to {spreads.max():.3f}\n"
        f"misfit: mean {np.mean(misfits):.3f} (ideal 1)\n"
        f"true time to contact between the bounds for any slant: {inside} of {count}\n"
    )


def approach(count: int) -> None:
    """A wall, facing and slanted, 50 frames before contact: a region of 64² in a frame of 128², and 64² frames."""
    rows = []
    cases = (
        ("facing, region of 64² px", 128, 0.0, (32, 32, 95, 95), False),
        ("slanted by 30°, region of 64² px", 128, math.radians(30), (32, 32, 95, 95), False),
        ("facing, frames of 64² px", 64, 0.0, None, True),
    )
    for name, side, slant, region, border in cases:
        camera = Camera(FOCAL, ((side - 1) / 2, (side - 1) / 2))
        plane = Plane.from_slant(1.0, slant, 0.4)
        view = synth.PlaneInView(camera, plane, RigidMotion((0, 0, 1 / 50)))
        errors, z = [], []
        for seed in range(count):
            sensor = synth.Sensor(noise=NOISE, seed=seed)
            made = synth.pair(synth.Speckle(seed=seed), view, (side, side), sensor=sensor)
            field = sixflow.measure(made.frame0, made.frame1)
            for kind in ("six", "eight"):
                fit = fit_region(field, region, coefficients=kind, border=border)
                time = time_to_contact(fit, camera, heading=(0, 0, 1)).time
                errors.append((kind, time.value / 50 - 1))
                z.append((kind, (time.value - 50) / time.standard_error))
        for kind in ("six", "eight"):
            e = np.array([value for which, value in errors if which == kind])
            spread = np.std([value for which, value in z if which == kind])
            cells = [f"{100 * value:.2f} %" for value in (rms(e), abs(e.mean()), np.abs(e).max())]
            rows.append([f"{name}, {kind}", *cells, spread, verdict(rms(e) <= 0.02)])
    show(
        f"Time to contact, 50 frames before, noise {NOISE:g} of 255, {count} patterns (target: error ≤ 2 %)",
        ["case", "rms error", "mean error", "largest", "spread", ""],
        rows,
    )


def looming() -> None:
    """The can of the NASA sequence: rate of approach over time."""
    folder = os.environ.get("SIXFLOW_BENCHMARKS")
    case = Path(folder or "") / "real" / "nasa_coke"
    if not folder or not (case / "case.json").is_file():
        console.print(
            "The real looming sequence is skipped: set SIXFLOW_BENCHMARKS to a folder that holds real/nasa_coke."
        )
        return
    import tifffile

    frames = [tifffile.imread(path) for path in sorted(case.glob("frame*.tif"))]
    height, width = frames[0].shape
    camera = Camera(560.0, ((width - 1) / 2, (height - 1) / 2))  # not known; hardly matters near the axis
    gap, can = 6, (100, 70, 155, 175)
    rows, starts, rates, errors = [], range(0, len(frames) - gap, 3), [], []
    for k in starts:
        field = sixflow.measure(frames[k], frames[k + gap], window=21, step=4, lighting="gain+offset")
        fit = fit_region(field, can, coefficients="six")
        contact = time_to_contact(fit, camera)
        rate, error = contact.approach_rate.value / gap, contact.approach_rate.standard_error / gap
        frame = k + gap * contact.time.value
        rows.append(
            [
                f"{k} → {k + gap}",
                1e3 * rate,
                1e3 * error,
                frame,
                gap * contact.time.standard_error,
                fit.misfit.value,
            ]
        )
        rates.append(rate)
        errors.append(error)
    show(
        f"NASA looming sequence ({json.loads((case / 'case.json').read_text())['notes']}): the can, in pairs {gap} "
        'frames apart, window=21, lighting="gain+offset" (the light changes by 3 %)',
        [
            "frames",
            "10³ × rate per frame",
            "± standard error",
            "contact in frame",
            "± standard error",
            "misfit",
        ],
        rows,
    )
    middle = np.array(starts) + gap / 2
    # constant speed: 1/rate = t_c − t
    weights = np.array(rates) ** 2 / np.array(errors)
    constant = float((weights**2 * (1 / np.array(rates) + middle)).sum() / (weights**2).sum())
    left = (np.array(rates) - 1 / (constant - middle)) / np.array(errors)
    console.print(
        f"constant speed to contact in frame {constant:.0f}: rms deviation of the rates {rms(left):.2f} standard "
        f"errors, {100 * rms(left * errors / np.array(rates)):.1f} % of the rate\n"
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="40 scenes and 10 patterns")
    parser.add_argument("--scenes", type=int, default=200, help="number of scenes")
    parser.add_argument("--first", type=int, default=0, help="number of the first scene, which seeds it")
    arguments = parser.parse_args()
    console.print(f"sixflow {sixflow.__version__}\n")
    close_the_loop(40 if arguments.quick else arguments.scenes, arguments.first)
    approach(10 if arguments.quick else 50)
    looming()


if __name__ == "__main__":
    main()
