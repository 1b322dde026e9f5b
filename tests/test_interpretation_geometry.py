"""Every interpretation: exact for exact coefficients, with standard errors that are those of its scatter."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from interpreted import CAMERA, exact_fit, fit_of
from sixflow.errors import InputError
from sixflow.interpretation import (
    Estimate,
    axis_rotation,
    ego_motion,
    fanning,
    focus_of_expansion,
    plane_and_motion,
    slant_and_tilt,
    time_to_contact,
)
from sixflow.interpretation.interval import excess_of_mean
from sixflow.interpretation.sight import look_at, turn_to
from sixflow.scenes import (
    Camera,
    Plane,
    RigidMotion,
    homography_flow,
    planar_flow,
    planar_structure,
    plane_homography,
)

PLANE = Plane.from_slant(2.0, 0.7, 0.5)
V, OMEGA = (0.03, 0.02, 0.045), (0.004, -0.006, 0.01)
POINTS = [CAMERA.centre, (20.0, 30.0), (300.0, -100.0)]
at_points = pytest.mark.parametrize("point", POINTS)


def velocities(plane, motion, centre=(60.0, 50.0), covariance=None, interval=None):
    """A fit of the exact flow at an instant."""
    flow = planar_flow(CAMERA, plane, motion).recentred(centre)
    spread = 1e-16 * np.eye(8) if covariance is None else covariance
    return fit_of(flow.coefficients, spread, centre, interval)


def scenes(count=6, turning=True):
    rng = np.random.default_rng(3)
    for _ in range(count):
        plane = Plane.from_slant(2.0, rng.uniform(0.2, 0.9), rng.uniform(-3, 3))
        V = (*rng.uniform(-0.05, 0.05, 2), rng.uniform(0.02, 0.06))
        rotation = tuple(rng.uniform(-0.02, 0.02, 3)) if turning else (0.0, 0.0, 0.0)
        yield plane, RigidMotion(V, rotation)


def distance_and_speed(plane, motion, point):
    """Distance along the line of sight of a point, and how fast it shrinks, from the scene itself."""
    X = CAMERA.point(*point, plane.depth(CAMERA, *point))
    R = np.linalg.norm(X)
    return R, -float(X @ motion.velocity(X)) / R


def rate_of(estimate: Estimate) -> float:
    """ρ of a time to contact that counts from the reference frame."""
    return -math.log1p(-1 / estimate.value)


# Time to contact


@at_points
def test_contact_with_known_heading(point):
    for plane, motion in scenes():
        if not plane.sees(CAMERA, *point):
            continue
        R, closing = distance_and_speed(plane, motion, point)
        for of, sign in (("camera", 1), ("object", -1)):
            heading = tuple(3.7 * sign * np.array(motion.translation))
            found = time_to_contact(velocities(plane, motion), CAMERA, point=point, heading=heading, of=of)
            assert found.corrected
            assert rate_of(found.time) == pytest.approx(closing / R, rel=1e-9)
            assert found.approach_rate.value == pytest.approx(closing / R, rel=1e-9)


@at_points
def test_contact_with_known_rotation(point):
    for plane, motion in scenes():
        if not plane.sees(CAMERA, *point):
            continue
        R, closing = distance_and_speed(plane, motion, point)
        found = time_to_contact(velocities(plane, motion), CAMERA, point=point, rotation=motion.rotation)
        assert rate_of(found.time) == pytest.approx(closing / R, rel=1e-8)


@at_points
def test_bounds_hold_for_every_slant_and_are_reached(point):
    reached = []
    for plane, motion in scenes(40):
        if not plane.sees(CAMERA, *point):
            continue
        R, closing = distance_and_speed(plane, motion, point)
        found = time_to_contact(velocities(plane, motion), CAMERA, point=point)
        least, most = (
            0.0 if math.isinf(bound.value) else rate_of(bound) for bound in (found.latest, found.earliest)
        )
        assert (1 - 1e-9) * min(least, closing / R) <= closing / R <= most * (1 + 1e-9)
        reached.append((closing / R - least) / (most - least))
    assert min(reached) < 0.1
    assert max(reached) > 0.9


def test_a_facing_wall_needs_no_correction():
    """50 frames before contact, by the displacement itself: from the reference frame, to all digits."""
    for frames in (50.0, 5.0, 1.5):
        motion = RigidMotion((0, 0, 2.0 / frames))
        fit = exact_fit(CAMERA, Plane((0, 0, 1), 2.0), motion)
        found = time_to_contact(fit, CAMERA, point=CAMERA.centre)
        assert found.time.value == pytest.approx(frames, rel=1e-9)
        assert found.earliest.value == pytest.approx(frames, rel=1e-4)
        assert not found.corrected
        receding = exact_fit(CAMERA, Plane((0, 0, 1), 2.0), motion.scaled(-1))
        back = time_to_contact(receding, CAMERA, point=CAMERA.centre)
        assert back.time.value == pytest.approx(-frames, rel=1e-9)


def test_contact_in_seconds():
    fit = dataclasses.replace(velocities(PLANE, RigidMotion(V)), interval=0.04)
    frames = time_to_contact(velocities(PLANE, RigidMotion(V)), CAMERA)
    seconds = time_to_contact(fit, CAMERA)
    assert (frames.time.unit, seconds.time.unit, seconds.approach_rate.unit) == ("frame", "s", "1/s")
    assert seconds.time.value == pytest.approx(0.04 * frames.time.value)
    assert seconds.time.standard_error == pytest.approx(0.04 * frames.time.standard_error)
    assert seconds.approach_rate.value == pytest.approx(frames.approach_rate.value / 0.04)
    # a rotation is then in rad/s
    turning = velocities(PLANE, RigidMotion(V, OMEGA))
    in_seconds = time_to_contact(
        dataclasses.replace(turning, interval=0.04), CAMERA, rotation=tuple(np.array(OMEGA) / 0.04)
    )
    assert in_seconds.time.value == pytest.approx(
        0.04 * time_to_contact(turning, CAMERA, rotation=OMEGA).time.value
    )


def test_contact_is_undetermined_without_approach():
    still = velocities(PLANE, RigidMotion((0, 0, 0), OMEGA), covariance=1e-8 * np.eye(8))
    found = time_to_contact(still, CAMERA)
    assert math.isinf(found.time.standard_error)
    assert not found.time.determined
    assert math.isfinite(found.approach_rate.standard_error)
    none = time_to_contact(fit_of(np.zeros(8), np.eye(8), (0, 0)), CAMERA)
    assert math.isinf(none.time.value)
    assert str(none.time) == "unbounded"
    # nothing moves across the line of sight, so that a known rotation shows no direction
    along = velocities(PLANE, RigidMotion((0, 0, 0.04)), covariance=1e-8 * np.eye(8))
    found = time_to_contact(along, CAMERA, point=CAMERA.centre, rotation=(0, 0, 0))
    assert not found.time.determined
    assert time_to_contact(along, CAMERA, point=CAMERA.centre, heading=(0, 0, 1)).time.determined


# Rotation about the line of sight


def test_rotation_with_known_heading():
    for plane, motion in scenes():
        for of, sign in (("camera", 1), ("object", -1)):
            heading = tuple(sign * np.array(motion.translation))
            found = axis_rotation(velocities(plane, motion), CAMERA, heading=heading, of=of)
            assert found.rate.value == pytest.approx(sign * motion.rotation[2], abs=1e-10)
            assert found.least.value - 1e-9 <= found.rate.value <= found.most.value + 1e-9
            assert found.point == CAMERA.centre
        point = (20.0, 30.0)
        m = CAMERA.direction(*point)
        found = axis_rotation(velocities(plane, motion), CAMERA, heading=motion.translation, point=point)
        assert found.rate.value == pytest.approx(m @ motion.rotation / np.linalg.norm(m), abs=1e-10)


def test_a_disc_that_turns_clockwise_by_any_angle():
    for angle in (0.1, -1.0, 2.5):
        motion = RigidMotion(rotation=(0, 0, angle), of="object", point=(0, 0, 2))
        fit = exact_fit(CAMERA, Plane((0, 0, 1), 2.0), motion)
        assert axis_rotation(fit, CAMERA, of="object").rate.value == pytest.approx(angle, rel=1e-9)
        assert axis_rotation(fit, CAMERA).rate.value == pytest.approx(-angle, rel=1e-9)


# Slant and tilt


@at_points
def test_slant_with_known_motion(point):
    for plane, motion in scenes():
        if not plane.sees(CAMERA, *point):
            continue
        fit = velocities(plane, motion)
        for known in (
            {"heading": motion.translation},
            {"rotation": motion.rotation},
            {"heading": motion.translation, "rotation": motion.rotation},
        ):
            found = slant_and_tilt(fit, CAMERA, point=point, **known)
            assert found.slant.value == pytest.approx(plane.slant, abs=1e-6)
            assert math.cos(found.tilt.value - plane.tilt) == pytest.approx(1, abs=1e-9)
            np.testing.assert_allclose(found.normal, plane.normal, atol=1e-6)
        assert found.assumptions == ("the direction of the translation and the rotation are as given",)


def test_slant_of_an_object_that_passes():
    motion = RigidMotion((0.05, 0, 0), of="object")
    fit = velocities(PLANE, motion)
    for known in ({"rotation": (0, 0, 0)}, {"rotation": (0, 0, 0), "heading": (1, 0, 0)}):
        found = slant_and_tilt(fit, CAMERA, point=CAMERA.centre, of="object", **known)
        assert found.slant.value == pytest.approx(0.7, abs=1e-7)
        assert found.tilt.value == pytest.approx(0.5, abs=1e-7)


def test_undetermined_slants():
    covariance = 1e-8 * np.eye(8)
    passing = velocities(PLANE, RigidMotion((0.05, 0, 0), OMEGA), covariance=covariance)
    along = velocities(PLANE, RigidMotion((0, 0, 0.05), OMEGA), covariance=covariance)
    lost = [
        slant_and_tilt(passing, CAMERA, point=CAMERA.centre, heading=(1, 0, 0)),
        slant_and_tilt(along, CAMERA, point=CAMERA.centre, heading=(0, 0, 1)),
        slant_and_tilt(along, CAMERA, point=CAMERA.centre, rotation=OMEGA),
    ]
    for found in lost:
        assert math.isinf(found.slant.standard_error)
        assert math.isinf(found.tilt.standard_error)
        assert math.isnan(found.slant.value)
        assert np.isnan(found.normal).all()
        assert "undetermined" in str(found)
    facing = velocities(Plane((0, 0, 1), 2.0), RigidMotion((0.05, 0, 0)), covariance=covariance)
    found = slant_and_tilt(facing, CAMERA, point=CAMERA.centre, rotation=(0, 0, 0))
    assert found.slant.determined
    assert not found.tilt.determined


# Line of sight


def test_turning_the_camera_changes_nothing_along_the_line_of_sight():
    """The axiom of `sight`: a camera that looks straight at the point sees the same rates there."""
    point = (300.0, -100.0)
    Q = turn_to(CAMERA.direction(*point))
    straight = Camera(CAMERA.focal, (0.0, 0.0))
    for plane, motion in scenes():
        if not plane.sees(CAMERA, *point):
            continue
        turned = Plane(tuple(Q @ plane.normal), plane.distance)
        moving = RigidMotion(tuple(Q @ motion.translation), tuple(Q @ motion.rotation))
        six = planar_flow(straight, turned, moving).six_at(0, 0)
        sight = look_at(velocities(plane, motion), CAMERA, point)
        seen = [*sight.across, sight.divergence, sight.curl, sight.shearing.real, sight.shearing.imag]
        np.testing.assert_allclose(seen, six / [400, 400, 1, 1, 1, 1], atol=1e-12)


def test_line_of_sight_takes_what_the_six_alone_tell():
    fit = velocities(PLANE, RigidMotion(V, OMEGA), centre=(100.0, 90.0))
    changed = fit.eight.coefficients + np.array([0, 0, 0, 0, 0, 0, 1e-3, -2e-3])
    other = fit_of(changed, 1e-16 * np.eye(8), (100.0, 90.0))
    a, b = (look_at(one, CAMERA, (100.0, 90.0)) for one in (fit, other))
    np.testing.assert_allclose(
        [*a.across, a.divergence, a.curl], [*b.across, b.divergence, b.curl], atol=1e-15
    )


# Fanning


def test_fanning_is_that_of_the_flow():
    truth = planar_flow(CAMERA, PLANE, RigidMotion(V, OMEGA)).coefficients
    found = fanning(velocities(PLANE, RigidMotion(V, OMEGA)))
    assert (found.E.value, found.F.value) == pytest.approx(tuple(truth[6:]))
    assert found.size.value == pytest.approx(math.hypot(*truth[6:]))
    assert found.direction.value == pytest.approx(math.atan2(truth[7], truth[6]))
    flat = fanning(fit_of(np.zeros(8), np.eye(8), (0, 0)))
    assert flat.size.value == 0
    assert not flat.direction.determined


# Focus of expansion


def test_focus_of_expansion_of_a_camera_that_does_not_turn():
    for plane, motion in scenes(turning=False):
        fit = exact_fit(CAMERA, plane, motion)
        found = focus_of_expansion(fit, CAMERA)
        X, Y, Z = motion.translation
        assert found.x.value == pytest.approx(CAMERA.centre[0] + 400 * X / Z, abs=1e-5)
        assert found.y.value == pytest.approx(CAMERA.centre[1] + 400 * Y / Z, abs=1e-5)
        np.testing.assert_allclose(
            found.heading, np.array(motion.translation) / np.linalg.norm(motion.translation), atol=1e-8
        )
        assert found.misfit.value < 1e-6
        back = focus_of_expansion(exact_fit(CAMERA, plane, motion.scaled(-1)), CAMERA)
        np.testing.assert_allclose(back.heading, -found.heading, atol=1e-7)


def test_focus_of_expansion_with_known_rotation():
    for plane, motion in scenes():
        found = focus_of_expansion(exact_fit(CAMERA, plane, motion), CAMERA, rotation=motion.rotation)
        X, _, Z = motion.translation
        assert found.x.value == pytest.approx(CAMERA.centre[0] + 400 * X / Z, abs=1e-5)
        wrong = focus_of_expansion(exact_fit(CAMERA, plane, motion), CAMERA)
        assert wrong.misfit.value > 10
        assert wrong.assumptions[-1].startswith("NOT BORNE OUT")
        assert wrong.x.standard_error > 10 * found.x.standard_error


def test_heading_of_level_flight_is_finite_where_its_focus_is_not():
    ground = Plane.ground(20.0, pitch=math.radians(90))
    fit = exact_fit(CAMERA, ground, RigidMotion((0, -0.3, 0)))
    found = focus_of_expansion(fit, CAMERA)
    assert not found.x.determined
    assert not found.y.determined
    np.testing.assert_allclose(found.heading, [0, -1, 0], atol=1e-6)
    assert found.angle.value == pytest.approx(math.pi / 2)
    oblique = Plane.ground(20.0, pitch=math.radians(40))
    level = RigidMotion((0, -0.3 * math.sin(math.radians(40)), 0.3 * math.cos(math.radians(40))))
    found = focus_of_expansion(exact_fit(CAMERA, oblique, level), CAMERA)
    np.testing.assert_allclose(found.heading, np.array(level.translation) / 0.3, atol=1e-7)


def test_no_translation_no_focus():
    covariance = exact_fit(CAMERA, PLANE, RigidMotion()).eight.covariance * 1e6
    found = focus_of_expansion(
        velocities(PLANE, RigidMotion(rotation=OMEGA), covariance=covariance), CAMERA, rotation=OMEGA
    )
    assert all(math.isinf(estimate.standard_error) for estimate in found.estimates.values())
    assert np.isnan(found.heading).all()


# Plane and motion


def test_both_solutions_one_of_them_true():
    for plane, motion in scenes():
        middle = plane.moved(motion.displacement(0.5))
        for of, sign in (("camera", 1), ("object", -1)):
            solutions = plane_and_motion(exact_fit(CAMERA, plane, motion), CAMERA, of=of)
            assert len(solutions) <= 2
            best = min(solutions, key=lambda one: abs(one.slant.value - middle.slant))
            assert best.slant.value == pytest.approx(middle.slant, abs=1e-5)
            found = [best.V_X.value, best.V_Y.value, best.V_Z.value]
            np.testing.assert_allclose(
                found, sign * np.array(motion.translation) / middle.distance, atol=1e-6
            )
            found = [best.Omega_X.value, best.Omega_Y.value, best.Omega_Z.value]
            np.testing.assert_allclose(found, sign * np.array(motion.rotation), atol=1e-6)
            closing = float(np.dot(middle.normal, motion.translation)) / middle.distance
            assert best.time_to_contact.value == pytest.approx(1 / closing + 0.5, rel=2e-3)


def test_scale_of_plane_and_motion():
    fit = exact_fit(CAMERA, PLANE, RigidMotion(V, OMEGA), interval=0.5)
    free, metric = (
        plane_and_motion(fit, CAMERA)[0],
        plane_and_motion(fit, CAMERA, distance=3, length_unit="m")[0],
    )
    assert (free.V_Z.unit, metric.V_Z.unit, free.Omega_Z.unit) == ("distance/s", "m/s", "rad/s")
    assert metric.V_Z.value == pytest.approx(3 * free.V_Z.value)
    assert metric.Omega_Z.value == free.Omega_Z.value
    assert any("scale" in text for text in free.assumptions)
    assert free.title == "plane and motion, solution 1 of 2"


def test_special_cases_of_plane_and_motion():
    covariance = exact_fit(CAMERA, PLANE, RigidMotion()).eight.covariance * 1e6
    (turning,) = plane_and_motion(
        velocities(PLANE, RigidMotion(rotation=OMEGA), covariance=covariance), CAMERA
    )
    for name in ("slant", "tilt", "time_to_contact"):
        assert math.isinf(turning.estimates[name].standard_error)
    assert turning.Omega_Z.value == pytest.approx(OMEGA[2], abs=1e-9)
    (facing,) = plane_and_motion(exact_fit(CAMERA, Plane((0, 0, 1), 2.0), RigidMotion((0, 0, 0.04))), CAMERA)
    assert facing.title == "plane and motion"
    assert facing.time_to_contact.value == pytest.approx(50, rel=1e-4)
    assert not facing.tilt.determined
    assert "along the plane's normal" in facing.assumptions[0]


def test_solutions_that_cannot_be_told_apart_are_given_as_one():
    """Motion nearly along the normal: one solution, whose errors reach to the other and to the truth."""
    plane = Plane.from_slant(2.0, 0.5, 0.3)
    normal = np.array(plane.normal)
    motion = RigidMotion(tuple(0.05 * normal + 0.004 * np.cross(normal, [0, 1, 0])), OMEGA)
    exact, middle = exact_fit(CAMERA, plane, motion, error=0.006), plane.moved(motion.displacement(0.5))
    fit = fit_of(exact.eight.coefficients, exact.eight.covariance, exact.centre)
    (given,) = plane_and_motion(fit, CAMERA, distance=middle.distance)
    assert str(given.solution.case) == "along normal"
    both = planar_structure(fit.eight, CAMERA)
    own = np.sqrt(np.trace(both[0].covariance[:3, :3]) / 3)
    assert np.linalg.norm(both[1].normal - both[0].normal) > 2 * own  # errors of each are those about itself
    for one in both:
        reach = np.sqrt(np.diagonal(given.solution.covariance)[:3])
        assert (np.abs(one.normal - given.solution.normal) < 1.5 * reach).all()
    names = ("slant", "V_X", "V_Y", "V_Z", "Omega_X", "Omega_Y", "Omega_Z")
    for name, true in zip(names, (middle.slant, *motion.translation, *motion.rotation), strict=True):
        estimate = getattr(given, name)
        assert abs(estimate.value - true) < 1.5 * estimate.standard_error, name


def test_excess_of_the_mean_leaves_the_fifth_order():
    left = []
    for size in (1.0, 0.5):
        motion = RigidMotion((0.2, 0.1, 0.3), (0.05, -0.1, 0.2)).scaled(size)
        mean = homography_flow(plane_homography(CAMERA, PLANE, motion), centre=CAMERA.centre).coefficients
        middle = PLANE.moved(motion.displacement(0.5))
        there = planar_flow(CAMERA, middle, motion).coefficients
        excess = excess_of_mean(middle.scaled_normal, motion.scene_translation, motion.scene_rotation, 400.0)
        assert (np.abs(mean - there - excess) < 0.2 * np.abs(mean - there).max()).all()
        left.append(np.abs(mean - there - excess)[:2].max())
    assert left[0] / left[1] == pytest.approx(32, rel=0.3)


# Ego-motion


@pytest.mark.parametrize("pitch", [90, 50, 0])
def test_ego_motion_over_the_ground(pitch):
    ground = Plane.ground(20.0, pitch=math.radians(pitch), roll=0.1)
    motion = RigidMotion((0.2, -0.3, 0.25), (0.002, -0.004, 0.006))
    flow = homography_flow(plane_homography(CAMERA, ground, motion), centre=(80.0, 90.0))
    fit = fit_of(
        flow.coefficients, exact_fit(CAMERA, PLANE, RigidMotion()).eight.covariance, (80.0, 90.0), 0.1
    )
    found = ego_motion(fit, CAMERA, ground, length_unit="m")
    np.testing.assert_allclose(found.motion.translation, motion.translation, atol=1e-6)
    np.testing.assert_allclose(found.motion.rotation, motion.rotation, atol=1e-8)
    assert found.V_Y.value == pytest.approx(-3.0, abs=1e-5)
    assert found.V_Y.unit == "m/s"
    assert found.speed.value == pytest.approx(10 * np.linalg.norm(motion.translation), rel=1e-6)
    towards = float(np.dot(ground.moved(motion.displacement(0.5)).normal, motion.translation))
    assert found.closing_speed.value == pytest.approx(10 * towards, abs=1e-5)
    assert found.misfit.value < 1e-3  # of what is of fifth order


def test_ego_motion_over_another_plane_is_noticed():
    motion = RigidMotion((0.2, -0.3, 0.25))
    fit = exact_fit(CAMERA, Plane.ground(20.0, pitch=1.0), motion)
    right, wrong = (ego_motion(fit, CAMERA, Plane.ground(20.0, pitch=p)) for p in (1.0, 1.2))
    assert right.misfit.value < 1e-3
    assert len(right.assumptions) == 1
    assert wrong.misfit.value > 10
    assert wrong.assumptions[-1].startswith("NOT BORNE OUT")
    assert wrong.V_X.standard_error > right.V_X.standard_error


def test_level_flight_has_no_contact():
    fit = exact_fit(CAMERA, Plane.ground(20.0, pitch=math.radians(90)), RigidMotion((0, -0.3, 0)))
    found = ego_motion(fit, CAMERA, Plane.ground(20.0, pitch=math.radians(90)))
    assert not found.time_to_contact.determined
    assert found.closing_speed.determined


# Standard errors


def of_the_six(fit):
    yield "contact", time_to_contact(fit, CAMERA)
    yield "contact, heading", time_to_contact(fit, CAMERA, heading=V)
    yield "contact, rotation", time_to_contact(fit, CAMERA, rotation=OMEGA)
    yield "rotation", axis_rotation(fit, CAMERA)
    yield "rotation, heading", axis_rotation(fit, CAMERA, heading=V)
    yield "slant, heading", slant_and_tilt(fit, CAMERA, heading=V)
    yield "slant, rotation", slant_and_tilt(fit, CAMERA, rotation=OMEGA, point=(20, 30))
    yield "slant, both", slant_and_tilt(fit, CAMERA, heading=V, rotation=OMEGA)
    yield "fanning", fanning(fit)


def of_the_eight(fit):
    yield "focus", focus_of_expansion(fit, CAMERA, rotation=OMEGA)
    yield "ego", ego_motion(fit, CAMERA, PLANE)
    solutions = plane_and_motion(fit, CAMERA)
    yield "plane", max(solutions, key=lambda one: float(one.solution.normal @ PLANE.normal))


@pytest.mark.parametrize(("interpretations", "count"), [(of_the_six, 400), (of_the_eight, 90)])
def test_standard_errors_are_the_scatter(interpretations, count):
    """Draws from the covariance of the eight, small enough for first order to hold."""
    fit = exact_fit(CAMERA, PLANE, RigidMotion(V, OMEGA), error=2e-4)
    rng = np.random.default_rng(11)
    root = np.linalg.cholesky(fit.eight.covariance)

    def numbers(fit):
        for name, one in interpretations(fit):
            yield from (((name, key), each) for key, each in one.estimates.items() if key != "misfit")

    predicted = {place: estimate.standard_error for place, estimate in numbers(fit)}
    values = {place: [] for place in predicted}
    for _ in range(count):
        draw = fit.eight.coefficients + root @ rng.normal(size=8)
        for place, estimate in numbers(fit_of(draw, fit.eight.covariance, fit.centre)):
            values[place].append(estimate.value)
    for place, error in predicted.items():
        assert np.std(values[place]) == pytest.approx(error, rel=4.5 / math.sqrt(2 * count)), place


def test_misfits_of_the_eight_are_one_on_average():
    count = 90
    fit = exact_fit(CAMERA, PLANE, RigidMotion(V), error=2e-4)
    rng = np.random.default_rng(5)
    root = np.linalg.cholesky(fit.eight.covariance)
    found = {"focus": [], "ego": []}
    for _ in range(count):
        draw = fit.eight.coefficients + root @ rng.normal(size=8)
        drawn = fit_of(draw, fit.eight.covariance, fit.centre)
        found["focus"].append(focus_of_expansion(drawn, CAMERA).misfit)
        found["ego"].append(ego_motion(drawn, CAMERA, PLANE).misfit)
    for misfits in found.values():
        error = misfits[0].standard_error
        assert np.mean([one.value for one in misfits]) == pytest.approx(1, abs=3.5 * error / math.sqrt(count))


# Estimates


@pytest.mark.parametrize(
    ("estimate", "text"),
    [
        (Estimate(49.8731, 0.3127, "frame"), "49.87 ± 0.31 frame"),
        (Estimate(-0.0, 0.5), "0.00 ± 0.50"),
        (Estimate(1.8731e-5, 3.1e-7, "1/px"), "(1.873 ± 0.031) × 10⁻⁵ 1/px"),
        (Estimate(1234567.0, 100.0, "px"), "(1.23457 ± 0.00010) × 10⁶ px"),
        (Estimate(5.0, 40.0), "5 ± 40"),
        (Estimate(math.nan, math.inf, "px"), "undetermined"),
        (Estimate(3.0, math.inf, "px"), "undetermined"),
        (Estimate(math.inf, math.inf, "s"), "unbounded"),
        (Estimate(2.0, 0.0), "2.0000 ± 0.0000"),
    ],
)
def test_estimates_in_words(estimate, text):
    assert str(estimate) == text


def test_a_result_in_words():
    text = str(time_to_contact(velocities(PLANE, RigidMotion(V)), CAMERA, rotation=(0, 0, 0)))
    lines = text.splitlines()
    assert lines[0] == "time to contact"
    assert lines[1].startswith("  time ")
    assert "±" in lines[1]
    assert lines[-2:] == ["  assumed: the rotation is as given", "  assumed: the speed stays as it is"]


# Bad input


SIX = fit_of(np.zeros(8), np.eye(8), (0, 0), kind="six")
FIT = velocities(PLANE, RigidMotion(V))


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda: Camera(focal=-5), "focal=-5"),
        (lambda: time_to_contact(FIT, 800), "camera=800"),
        (lambda: time_to_contact("fit", CAMERA), "fit='fit'"),
        (lambda: time_to_contact(FIT, CAMERA, heading=(0, 0, 0)), "heading=.0, 0, 0.: must not be 0"),
        (lambda: time_to_contact(FIT, CAMERA, heading=(0, 1)), "heading="),
        (lambda: time_to_contact(FIT, CAMERA, rotation=(0, 0, math.nan)), r"rotation\[2\]"),
        (lambda: time_to_contact(FIT, CAMERA, point=(1,)), "point="),
        (lambda: time_to_contact(FIT, CAMERA, of="wall"), "of='wall'"),
        (lambda: axis_rotation(FIT, CAMERA, of="wall"), "of='wall'"),
        (lambda: slant_and_tilt(FIT, CAMERA), "heading=None, rotation=None"),
        (lambda: fanning(SIX), "fit.coefficients='six': the eight are needed"),
        (lambda: focus_of_expansion(SIX, CAMERA), "the eight are needed"),
        (lambda: plane_and_motion(SIX, CAMERA), "the eight are needed"),
        (lambda: plane_and_motion(FIT, CAMERA, distance=0), "distance=0"),
        (lambda: ego_motion(FIT, CAMERA, "ground"), "plane='ground'"),
        (lambda: ego_motion(SIX, CAMERA, PLANE), "the eight are needed"),
    ],
)
def test_bad_input(call, text):
    with pytest.raises(InputError, match=text):
        call()
