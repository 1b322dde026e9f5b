"""The figures of the worked examples: a region interpreted, something that approaches, a drone, a disc."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from sixflow.engine.window import window_sigma

IMAGES = Path(__file__).parent / "images"
COLOURS = ("#1b3a57", "#2f7f79", "#c98a2b", "#a23b3b")


def interpretation_region() -> None:
    """Correlation of the errors of neighbouring points, and standard errors of regions: stated, and found in trials."""
    from sixflow import measure, synth
    from sixflow.interpretation import fit_region

    side, trials = 192, 80
    motion = synth.Affine.from_six((0.8, -0.6, 0.02, 0.006, 0.003, -0.002), centre=(95.5, 95.5))
    pattern = synth.Speckle(seed=1)
    frames = [synth.render(pattern, (side, side), moved) for moved in (None, motion)]
    halves = np.arange(12, 65, 4)
    errors, found, stated, independent = [], [], [], []
    for k in range(trials):
        sensor = synth.Sensor(noise=2, seed=k)
        field = measure(*(sensor.expose(frame, j) for j, frame in enumerate(frames)), step=4)
        x, y = np.meshgrid(field.x, field.y)
        inside = field.isel(time=0, x=slice(9, -9), y=slice(9, -9))
        truth = motion.six(x, y)[9:-9, 9:-9]
        rates = [
            inside[name].values - truth[..., part]
            for part, name in ((0, "u"), (2, "divergence"), (4, "stretch"))
        ]
        errors.append([rates[0], (rates[1] + rates[2]) / 2])
        fits = [fit_region(field, (95.5 - h, 95.5 - h, 95.5 + h, 95.5 + h)) for h in halves]
        sixes = [fit.six_at((95.5, 95.5)) for fit in fits]
        found.append([six[2] for six, _ in sixes])
        stated.append([np.sqrt(spread[2, 2]) for _, spread in sixes])
        point = float(np.sqrt(inside.covariance.values[..., 2, 2].mean()))
        independent.append([point / np.sqrt(fit.points) for fit in fits])
    figure = Figure(figsize=(7.6, 2.9), layout="constrained")
    left, right = figure.subplots(1, 2)
    e = np.array(errors)
    d, gaussian = np.arange(0, 60.1, 0.5), window_sigma(31)
    for part, (name, colour, law) in enumerate(
        (
            ("$u$", COLOURS[0], np.exp(-(d**2) / (4 * gaussian**2))),
            ("$u_x$", COLOURS[2], (1 - d**2 / (2 * gaussian**2)) * np.exp(-(d**2) / (4 * gaussian**2))),
        )
    ):
        values = e[:, part] / e[:, part].std()
        steps = range(16)
        seen = [(values[..., : values.shape[-1] - k] * values[..., k:]).mean() for k in steps]
        left.plot(d, law, color=colour, linewidth=0.9, label=name)
        left.plot([4 * k for k in steps], seen, "o", color=colour, markersize=3.5, markerfacecolor="none")
    left.axhline(0, color="0.6", linewidth=0.6)
    left.set(
        xlabel="distance of two points along x (px)", ylabel="correlation of their errors", xlim=(-1, 61)
    )
    left.legend(frameon=False)
    size, scatter = 2 * halves, 1e5 * np.std(found, axis=0)
    right.loglog(size, 1e5 * np.mean(stated, axis=0), color=COLOURS[0], label="stated")
    label = "if points were independent"
    right.loglog(size, 1e5 * np.mean(independent, axis=0), "--", color=COLOURS[3], label=label)
    style = {"color": COLOURS[0], "markersize": 3.5, "markerfacecolor": "none", "linewidth": 0.8}
    sampling = scatter / np.sqrt(2 * trials)
    right.errorbar(size, scatter, sampling, fmt="o", label=f"scatter of {trials} trials", **style)
    right.set(xlabel="side of the region (px)", ylabel="$10^5$ × error of the divergence")
    right.set(xlim=(22, 140), ylim=(2, 60))
    right.minorticks_off()
    right.set_xticks([24, 32, 48, 64, 96, 128], labels=["24", "32", "48", "64", "96", "128"])
    right.set_yticks([2, 5, 10, 20, 50], labels=["2", "5", "10", "20", "50"])
    right.legend(frameon=False, fontsize=7.5)
    for axes in (left, right):
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(IMAGES / "interpretation-region.png", dpi=150)


def example_looming() -> None:
    """Time to contact of a slanted board over 50 frames, with bounds and errors."""
    from sixflow import measure_sequence, synth
    from sixflow.interpretation import fit_region, time_to_contact
    from sixflow.scenes import Camera, Plane, RigidMotion

    camera = Camera(focal=300, centre=(63.5, 63.5))
    board = Plane.from_slant(distance=3.0, slant=np.radians(35), tilt=np.radians(20))
    motion = RigidMotion(translation=(0.008, 0.012, 0.05))
    view, texture = synth.PlaneInView(camera, board, motion), synth.Texture(longest=60, waves=100)
    film = synth.sequence(texture, view, (128, 128), 51, sensor=synth.Sensor(noise=2))
    field = measure_sequence(film.frames)
    frames, rows = np.arange(50), []
    for k in frames:
        fit = fit_region(field, (24, 24, 103, 103), time=int(k))
        known = time_to_contact(fit, camera, heading=motion.translation)
        at = camera.direction(*fit.centre)
        depth = board.moved(motion.displacement(k + 0.5)).depth(camera, *fit.centre)
        truth = float(at @ at * depth / (at @ motion.translation)) + 0.5
        rows.append(
            [known.time.value, known.time.standard_error, known.earliest.value, known.latest.value, truth]
        )
    time, error, earliest, latest, truth = np.array(rows).T
    figure = Figure(figsize=(7.6, 2.9), layout="constrained")
    seen, left, right = figure.subplots(1, 3, width_ratios=(1.0, 1.55, 1.25))
    seen.imshow(np.concatenate([film.frames[0], film.frames[45]]), cmap="gray", vmin=20, vmax=236)
    seen.set(xticks=[], yticks=[], ylabel="frame 45          frame 0")
    left.fill_between(
        frames, earliest, latest, color=COLOURS[1], alpha=0.22, linewidth=0, label="bounds, any slant"
    )
    left.plot(frames, truth, color="0.25", linewidth=0.8, label="truth")
    left.errorbar(
        frames[::3], time[::3], 2 * error[::3], fmt="o", color=COLOURS[0], markersize=2.6, linewidth=0.9,
        label="corrected by the shear",
    )  # fmt: skip
    left.set(ylabel="time to contact (frames)", ylim=(0, None))
    left.legend(frameon=False, fontsize=7.5)
    right.axhline(0, color="0.25", linewidth=0.8)
    right.errorbar(
        frames, 100 * (time / truth - 1), 100 * error / truth, fmt="o", color=COLOURS[0], markersize=2.4,
        linewidth=0.7,
    )  # fmt: skip
    right.set(ylabel="error ± standard error (%)")
    for axes in (left, right):
        axes.set(xlabel="frame", xlim=(-1, 50))
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(IMAGES / "example-looming.png", dpi=150)


def example_drone() -> None:
    """Speeds and rates of turning of a drone over ground, measured pair by pair."""
    from sixflow import measure, synth
    from sixflow.interpretation import ego_motion, fit_region
    from sixflow.scenes import Camera, Plane, RigidMotion

    camera, pitch = Camera(focal=400, centre=(95.5, 95.5)), np.radians(50)
    ground = Plane.ground(height=30.0, pitch=pitch)
    level = np.array([[1, 0, 0], [0, -np.sin(pitch), np.cos(pitch)], [0, np.cos(pitch), np.sin(pitch)]])
    frames = np.arange(40)
    s = frames / 40
    speeds = np.stack(
        [
            0.15 * np.sin(4 * np.pi * s),
            0.3 + 0.2 * np.tanh(6 * (s - 0.4)),
            0.12 * np.exp(-80 * (s - 0.7) ** 2),
        ]
    ).T
    turns = np.stack([0.004 * np.sin(6 * s), 0.006 * np.cos(5 * s), 0.01 * np.sin(2 * np.pi * s)]).T
    found, errors = [], []
    for k in frames:
        motion = RigidMotion(tuple(speeds[k] @ level), tuple(turns[k]))
        view = synth.PlaneInView(camera, ground, motion)
        sensor = synth.Sensor(noise=2, seed=int(k))
        made = synth.pair(synth.Speckle(seed=int(k)), view, (192, 192), sensor=sensor)
        field = measure(made.frame0, made.frame1)
        one = ego_motion(fit_region(field), camera, ground)
        turn = np.zeros((6, 6))
        turn[:3, :3], turn[3:, 3:] = level, np.eye(3)
        found.append(turn @ [*one.motion.translation, *one.motion.rotation])
        errors.append(np.sqrt(np.diagonal(turn @ one.covariance @ turn.T)))
    found, errors = np.array(found), np.array(errors)
    figure = Figure(figsize=(7.6, 2.9), layout="constrained")
    seen, left, right = figure.subplots(1, 3, width_ratios=(1.0, 1.3, 1.3))
    seen.imshow(made.frame0, cmap="gray", vmin=-120, vmax=330)
    x, y = (part.ravel()[::1] for part in np.meshgrid(field.x.values[2::4], field.y.values[2::4]))
    u, v = made.motion.displacement(x, y)
    seen.quiver(x, y, u, v, color=COLOURS[3], angles="xy", scale_units="xy", scale=0.28, width=0.013)
    seen.set(xticks=[], yticks=[], xlabel="last pair; arrows × 3.6")
    for axes, columns, truth, scale, names in (
        (left, found[:, :3], speeds, 1.0, ("to the right", "forward", "down")),
        (right, found[:, 3:], turns, 1e3, ("pitch, $Ω_X$", "yaw, $Ω_Y$", "roll, $Ω_Z$")),
    ):
        spread = errors[:, :3] if axes is left else errors[:, 3:]
        for part, (name, colour) in enumerate(zip(names, (COLOURS[0], COLOURS[2], COLOURS[3]), strict=True)):
            axes.plot(frames, scale * truth[:, part], color=colour, linewidth=0.8)
            axes.errorbar(
                frames, scale * columns[:, part], 2 * scale * spread[:, part], fmt="o", color=colour,
                markersize=2.4, linewidth=0.8, label=name,
            )  # fmt: skip
        axes.set(xlabel="pair")
        axes.spines[["top", "right"]].set_visible(False)
    left.set(ylabel="speed (m per frame)", ylim=(-0.2, 0.75))
    right.set(ylabel="turning (mrad per frame)", ylim=(-14, 17))
    for axes in (left, right):
        axes.legend(
            frameon=False, fontsize=7.5, loc="upper left", ncols=2, columnspacing=1.0, handletextpad=0.2
        )
    figure.savefig(IMAGES / "example-drone.png", dpi=150)


def example_disc() -> None:
    """A tilted disc that speeds up: the turn of each frame, and its slant and tilt."""
    from sixflow import measure, synth
    from sixflow.interpretation import fit_region, plane_and_motion
    from sixflow.scenes import Camera, Plane, RigidMotion

    size, hub, slant, tilt = 192, (0.0, 0.0, 2.0), np.radians(35), np.radians(60)
    camera, table = Camera(focal=250, centre=(95.5, 95.5)), Plane.from_slant(2.0, slant, tilt)
    y, x = np.mgrid[:size, :size].astype(float)
    disc = np.linalg.norm(camera.point(x, y, table.depth(camera, x, y)) - hub, axis=-1) < 0.62
    behind = synth.render(synth.Speckle(seed=99, mean=90), (size, size))
    degrees, rows = np.arange(1.0, 13.0, 0.5), []
    for k, degree in enumerate(degrees):
        about = tuple(np.radians(degree) * np.array(table.normal))
        spin = RigidMotion(rotation=about, of="object", point=hub)
        made = synth.pair(synth.Speckle(seed=k), synth.PlaneInView(camera, table, spin), (size, size))
        sensor = synth.Sensor(noise=2, seed=k)
        shown = [
            sensor.expose(np.where(disc, frame, behind), j)
            for j, frame in enumerate((made.frame0, made.frame1))
        ]
        field = measure(*shown, mask=disc)
        solutions = plane_and_motion(fit_region(field), camera, of="object")
        one = min(solutions, key=lambda found: found.slant.value)
        Omega, C = one.solution.rotation, one.solution.covariance[6:, 6:]
        axis = Omega / np.linalg.norm(Omega)
        rows.append(
            [np.linalg.norm(Omega), np.sqrt(axis @ C @ axis), one.slant.value, one.slant.standard_error,
             one.tilt.value, one.tilt.standard_error]
        )  # fmt: skip
    turn, turn_error, *angles = np.degrees(np.array(rows)).T
    figure = Figure(figsize=(7.6, 2.9), layout="constrained")
    seen, left, right = figure.subplots(1, 3, width_ratios=(1.0, 1.3, 1.3))
    seen.imshow(shown[0], cmap="gray", vmin=-120, vmax=330)
    inside = field.sixflow.valid.values[0][1::3, 1::3]
    columns, lines = np.meshgrid(field.x.values[1::3], field.y.values[1::3])
    six = field.isel(time=0)
    u, v = (six[name].values[1::3, 1::3][inside] for name in ("u", "v"))
    seen.quiver(
        columns[inside],
        lines[inside],
        u,
        v,
        color=COLOURS[3],
        angles="xy",
        scale_units="xy",
        scale=1,
        width=0.013,
    )
    seen.set(xticks=[], yticks=[], xlabel="turn of 12.5°")
    left.axhline(0, color="0.25", linewidth=0.8)
    left.errorbar(
        degrees, turn - degrees, turn_error, fmt="o", color=COLOURS[0], markersize=2.8, linewidth=0.9
    )
    left.set(ylabel="error of the turn (°)")
    for part, (name, truth) in enumerate((("slant", 35), ("tilt", 60))):
        colour = COLOURS[(0, 3)[part]]
        right.axhline(0, color="0.25", linewidth=0.8)
        right.errorbar(
            degrees + 0.12 * part, angles[2 * part] - truth, angles[2 * part + 1], fmt="o", color=colour,
            markersize=2.8, linewidth=0.9, label=f"{name}, {truth}°",
        )  # fmt: skip
    right.set(ylabel="error of slant and tilt (°)")
    right.legend(frameon=False, fontsize=7.5)
    for axes in (left, right):
        axes.set(xlabel="turn per frame (°)", xlim=(0, 13.2))
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(IMAGES / "example-disc.png", dpi=150)
