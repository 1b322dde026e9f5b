"""Draw the figures of the documentation: python docs/figures.py."""

from __future__ import annotations

import numpy as np
from example_figures import (
    COLOURS,
    IMAGES,
    example_disc,
    example_drone,
    example_looming,
    interpretation_region,
)
from matplotlib.figure import Figure

from sixflow.engine.response import response
from sixflow.engine.window import sharpening_noise, window_sigma
from sixflow.groups import PROJECTIVE, draw_trajectories


def sharpening() -> None:
    """Response against period, and noise factors, for n = 0, 1, 2, 4."""
    figure = Figure(figsize=(7.6, 2.9), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    period = np.geomspace(15, 300, 400)
    whole = np.exp(-((2 * np.pi / period * window_sigma(31)) ** 2) / 2)
    counts = (0, 1, 2, 4)
    for n, colour in zip(counts, COLOURS, strict=True):
        left.semilogx(period, response(whole, n), color=colour, label=f"n = {n}")
    left.axhline(0.9, color="0.6", linewidth=0.8, linestyle=":")
    left.set_xticks([20, 30, 50, 100, 200, 300], labels=["20", "30", "50", "100", "200", "300"])
    left.minorticks_off()
    left.set(
        xlabel="period of the displacement (px), window 31", ylabel="response", ylim=(0, 1.03), xlim=(15, 300)
    )
    left.legend(frameon=False)
    factors = np.array([sharpening_noise(n) for n in counts])
    for k, (name, shift) in enumerate((("displacement", -0.18), ("gradients", 0.18))):
        right.bar(
            np.arange(4) + shift, factors[:, k], width=0.34, label=name, color=(COLOURS[0], COLOURS[2])[k]
        )
    right.set_xticks(np.arange(4), labels=[f"n = {n}" for n in counts])
    right.set(ylabel="noise, relative to n = 0")
    right.legend(frameon=False)
    for axes in (left, right):
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(IMAGES / "sharpening.png", dpi=150)


def foreign_pixels() -> None:
    """A pair with unmatched particles, dead pixels and glare: errors without and with weights."""
    from sixflow import measure, synth

    side = 320
    motion = synth.Affine.from_six((2.0, -1.5, 0.008, 0.012, 0.006, -0.005), centre=(side / 2, side / 2))
    sensor = synth.Sensor(noise=2.0, dead=0.02, glare=2.0, seed=3)
    pattern = synth.Particles(diameter=4, unmatched=0.2, seed=3)
    made = synth.pair(pattern, motion, (side, side), sensor=sensor)
    figure = Figure(figsize=(7.6, 2.7), layout="constrained")
    axes = figure.subplots(1, 3)
    axes[0].imshow(made.frame0[60:220, 60:220], cmap="gray", vmin=0, vmax=255, extent=(60, 220, 220, 60))
    axes[0].set_title("frame 0, a part", fontsize=9)
    for robust, at in zip((False, True), axes[1:], strict=True):
        field = measure(made.frame0, made.frame1, robust=robust)
        x, y = np.meshgrid(field.x.values.astype(float), field.y.values.astype(float))
        error = np.hypot(*(np.moveaxis(made.truth(x, y)[..., :2], -1, 0) - [field.u[0], field.v[0]]))
        shown = at.pcolormesh(field.x, field.y, error, cmap="viridis", vmin=0, vmax=0.2)
        at.set(aspect="equal", ylim=(side, 0), xlim=(0, side))
        at.set_facecolor("#dddddd")
        at.set_title(f"robust={robust}: median {np.nanmedian(error):.3f} px", fontsize=9)
    for at in axes:
        at.tick_params(labelsize=8)
        at.set_xlabel("x (px)", fontsize=8)
    axes[0].set_ylabel("y (px)", fontsize=8)
    bar = figure.colorbar(shown, ax=axes[1:], shrink=0.85, extend="max")
    bar.set_label("end-point error (px); grey: flagged", fontsize=8)
    bar.ax.tick_params(labelsize=8)
    figure.savefig(IMAGES / "robust.png", dpi=150)


def group_trajectories() -> None:
    """The eight one-parameter groups of the plane's projective motions."""
    draw_trajectories(PROJECTIVE).savefig(IMAGES / "groups-trajectories.png", dpi=150)


def operators() -> None:
    """Four figures of the gallery that `sixflow operators` draws."""
    from sixflow.gallery import CATALOGUE

    images = {
        "figure-03-trajectories": "operators-trajectories.png",
        "figure-07-log-polar": "operators-log-polar.png",
        "figure-10-stretch": "operators-stretch.png",
        "beyond-stretch-map": "operators-hyperbolic.png",
    }
    for entry in CATALOGUE:
        if entry.name in images:
            entry.draw().savefig(IMAGES / images[entry.name], dpi=150)


def scenes_calibration() -> None:
    """How the flow of a floor changes with each of the nine parameters of structure and motion."""
    from sixflow import scenes

    camera = scenes.Camera.from_field_of_view(np.radians(60), (480, 640))
    floor = scenes.Plane.from_slant(distance=2.0, slant=np.radians(50), tilt=np.radians(-90))
    motion = scenes.RigidMotion(translation=(0.02, 0.0, 0.1))
    found = scenes.calibrate(camera, floor, motion, at=(420.0, 300.0))
    found.picture((480, 640)).savefig(IMAGES / "scenes-calibration.png", dpi=150)


def scenes_planar() -> None:
    """Both solutions, and stated standard errors against the errors of trials, over the direction of motion."""
    from sixflow import scenes

    camera, slant, trials = scenes.Camera(focal=600.0, centre=(320.0, 240.0)), np.radians(35), 4000
    wall = scenes.Plane.from_slant(distance=2.0, slant=slant)
    # 12 × 12 measurements of the six, of the usual errors, over a region of 240 px
    x, y = np.meshgrid(np.linspace(-120, 120, 12), np.linspace(-120, 120, 12))
    design = scenes.six_matrix(x.ravel(), y.ravel()) / np.array([0.01, 0.01, 1e-3, 1e-3, 1e-3, 1e-3])[:, None]
    covariance = np.linalg.inv(np.einsum("pij,pik->jk", design, design))
    noise = np.random.default_rng(0).normal(size=(trials, 8)) @ np.linalg.cholesky(covariance).T
    normal = np.array(wall.normal)
    across = np.cross([0.0, 1.0, 0.0], normal)
    angles = np.concatenate([[0.1, 0.6, 1.2], np.arange(2, 86, 1.5)])
    solved, stated, found, met = [], [], [], []
    for angle in np.radians(angles):
        heading = 0.08 * (np.cos(angle) * normal + np.sin(angle) * across)
        exact = scenes.planar_flow(camera, wall, scenes.RigidMotion(tuple(heading.tolist())))
        solved.append(sorted(scenes.planar_structure(exact, camera), key=lambda one: abs(one.slant - slant)))
        noisy = scenes.Eight(exact.coefficients + noise, exact.centre, covariance)
        both = scenes.planar_structure(noisy, camera)
        met.append(np.mean(both[0].case == "along normal") > 0.5)
        off = np.stack([one.slant for one in both]) - slant
        near = np.abs(off).argmin(axis=0), np.arange(trials)
        contact = solved[-1][0].time_to_contact
        late = both[0].time_to_contact / contact - 1
        found.append([np.degrees(np.sqrt(np.mean(off[near] ** 2))), 100 * np.sqrt(np.mean(late**2))])
        errors = [one.standard_errors for one in both]
        slants = np.stack([one.slant for one in errors])[near]
        stated.append([np.degrees(np.median(slants)), 100 * np.median(errors[0].time_to_contact) / contact])
    figure = Figure(figsize=(7.6, 2.9), layout="constrained")
    left, right = figure.subplots(1, 2)
    for k, name in enumerate(("true", "false")):
        degrees = [np.degrees(pair[k].slant) for pair in solved]
        left.plot(angles, degrees, color=COLOURS[3 * k], label=name, linestyle=("-", "--")[k])
    left.set(ylabel="slant of the solution (°)", ylim=(0, 90))
    for k, (name, colour) in enumerate((("slant (°)", COLOURS[0]), ("time to contact (%)", COLOURS[2]))):
        line, dots = np.array(stated)[:, k], np.array(found)[:, k]
        for part, style in ((np.array(met), ":"), (~np.array(met), "-")):
            right.semilogy(
                angles[part], line[part], style, color=colour, label=name if style == "-" else None
            )
        right.semilogy(angles[::3], dots[::3], "o", color=colour, markersize=3.5, markerfacecolor="none")
    right.set(ylabel="standard error", ylim=(0.03, 3))
    right.set_yticks([0.03, 0.1, 0.3, 1, 3], labels=["0.03", "0.1", "0.3", "1", "3"])
    right.legend(frameon=False)
    left.legend(frameon=False)
    for axes in (left, right):
        axes.set(xlabel="angle between motion and normal (°)", xlim=(0, 86))
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(IMAGES / "scenes-planar.png", dpi=150)


if __name__ == "__main__":
    IMAGES.mkdir(exist_ok=True)
    sharpening()
    foreign_pixels()
    operators()
    group_trajectories()
    scenes_calibration()
    scenes_planar()
    interpretation_region()
    example_looming()
    example_drone()
    example_disc()
