"""Structure and motion of a plane from eight coefficients: both solutions, special cases, standard errors."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sixflow.convention import numerical_jacobian
from sixflow.errors import InputError
from sixflow.scenes import (
    Camera,
    Eight,
    Plane,
    RigidMotion,
    eight_from_nine,
    planar_flow,
    planar_structure,
)

EXACT = 1e-8  # the promise for exact coefficients
CAMERA = Camera(focal=800.0, centre=(320.0, 240.0))
UNITS = np.array([800, 800, 1, 1, 1, 1, 1 / 800, 1 / 800])
PLANE = Plane.from_slant(2.0, 0.6, 0.3)
TURN = (0.01, -0.02, 0.03)
GENERAL = RigidMotion((0.05, 0.02, 0.1), TURN)


def along_normal(plane, speed):
    return RigidMotion(tuple(speed * np.array(plane.normal)), TURN)


def mixed_covariance(size, seed=0):
    spread = np.random.default_rng(seed).normal(size=(8, 8)) * (size * UNITS)[:, None]
    return spread @ spread.T / 8


def truth(plane, motion):
    """Normal, V/d and Ω of the camera."""
    camera = motion.seen_as("camera").about((0, 0, 0))
    return np.array(plane.normal), np.array(camera.translation) / plane.distance, np.array(camera.rotation)


def miss(solution, normal, translation, rotation):
    """Largest error: of the normal, of V/d relative to its size, of Ω relative to the size of the motion."""
    speed = np.linalg.norm(translation, axis=-1)
    turn = np.linalg.norm(rotation, axis=-1)
    errors = (
        np.abs(solution.normal - normal).max(axis=-1),
        np.abs(solution.translation - translation).max(axis=-1) / speed,
        np.abs(solution.rotation - rotation).max(axis=-1) / (turn + speed),
    )
    return np.max(errors, axis=0)


def solve(plane, motion, covariance=None, **options):
    eight = planar_flow(CAMERA, plane, motion)
    return planar_structure(Eight(eight.coefficients, eight.centre, covariance), CAMERA, **options)


@pytest.mark.parametrize("of", ["camera", "object"])
def test_ten_thousand_scenes(of):
    rng = np.random.default_rng(0)
    count = 10_000
    p, q, r = rng.normal(0, 0.7, count), rng.normal(0, 0.7, count), rng.uniform(0.3, 30, count)
    V, Omega = rng.normal(0, 0.1, (count, 3)), rng.normal(0, 0.05, (count, 3))
    nine = np.concatenate([V, Omega, np.stack([p, q, r], axis=-1)], axis=-1)
    eight = Eight(eight_from_nine(nine, CAMERA.focal, of=of), CAMERA.centre)
    solutions = planar_structure(eight, CAMERA, of=of)
    long = np.sqrt(1 + p**2 + q**2)
    normal = np.stack([-p, -q, np.ones(count)], axis=-1) / long[:, None]
    inverse_distance = (long / r)[:, None]
    errors = [miss(one, normal, V * inverse_distance, Omega) for one in solutions]
    assert np.min(errors, axis=0).max() < EXACT
    # the other one is another
    assert np.median(np.max(errors, axis=0)) > 0.1
    for one in solutions:
        assert (one.case == "general").all()
        contact = (1 if of == "camera" else -1) / (normal * V * inverse_distance).sum(axis=-1)
        np.testing.assert_allclose(one.time_to_contact, contact, rtol=1e-9)
        # both make the flow that was given
        T, w = ((-1 if of == "camera" else 1) * part for part in (one.translation, one.rotation))
        L = (
            np.stack([np.cross(w, axis) for axis in np.eye(3)], axis=-1)
            + T[:, :, None] * one.normal[:, None, :]
        )
        u0 = L[:, 0, 2] * CAMERA.focal
        np.testing.assert_allclose(u0, eight.coefficients[:, 0], atol=1e-9)
        np.testing.assert_allclose(L[:, 0, 0] - L[:, 2, 2], eight.coefficients[:, 2], atol=1e-12)
    first, second = solutions
    np.testing.assert_array_equal(first.visible | ~second.visible, True)
    less = first.slant <= second.slant
    assert less[first.visible == second.visible].all()


def test_both_solutions_make_the_flow():
    flow = planar_flow(CAMERA, PLANE, GENERAL)
    for one in planar_structure(flow, CAMERA):
        again = planar_flow(CAMERA, one.plane(3.0), one.motion(3.0))
        np.testing.assert_allclose(again.coefficients / UNITS, flow.coefficients / UNITS, atol=1e-15)


def test_motion_and_normal_are_exchanged():
    first, second = solve(PLANE, GENERAL, of="object")
    for one, other in ((first, second), (second, first)):
        np.testing.assert_allclose(np.abs(one.normal @ other.translation) / other.speed, 1, rtol=1e-12)
    assert first.speed == pytest.approx(second.speed)
    assert first.time_to_contact == pytest.approx(second.time_to_contact, rel=1e-12)


def test_the_centre_of_the_coefficients_does_not_matter():
    flow = planar_flow(CAMERA, PLANE, GENERAL)
    C = mixed_covariance(1e-5)
    here = planar_structure(Eight(flow.coefficients, flow.centre, C), CAMERA)
    moved = Eight(flow.coefficients, flow.centre, C).recentred((20.0, 400.0))
    there = planar_structure(moved, CAMERA)
    given = planar_structure(Eight(moved.coefficients, moved.centre), CAMERA, covariance=moved.covariance)
    for one, *others in zip(here, there, given, strict=True):
        for other in others:
            np.testing.assert_allclose(other.normal, one.normal, atol=1e-10)
            np.testing.assert_allclose(other.standard_errors.slant, one.standard_errors.slant, rtol=1e-6)


class TestSpecialCases:
    @pytest.mark.parametrize("covariance", [None, mixed_covariance(1e-4)], ids=["exact", "noisy"])
    def test_pure_rotation(self, covariance):
        for one in solve(PLANE, RigidMotion(rotation=TURN), covariance):
            assert one.case == "pure rotation"
            assert "undetermined" in one.reason
            assert np.isnan(one.normal).all()
            assert np.isnan([one.slant, one.tilt]).all()
            assert one.time_to_contact == math.inf
            assert not one.visible
            np.testing.assert_array_equal(one.translation, 0)
            np.testing.assert_allclose(one.rotation, TURN, atol=1e-15)
            with pytest.raises(InputError, match=r"case='pure rotation'.*no normal"):
                one.plane(2.0)
            assert one.motion(2.0).translation == (0, 0, 0)
            if covariance is not None:
                errors = one.standard_errors
                assert np.isinf([*errors.normal, errors.slant, errors.tilt, errors.time_to_contact]).all()
                assert 0 < errors.speed < 0.01
                assert (errors.translation > 0).all()
                assert (errors.rotation > 0).all()

    def test_no_motion_at_all(self):
        first, _ = planar_structure(Eight(np.zeros(8), CAMERA.centre), CAMERA)
        assert first.case == "pure rotation"
        np.testing.assert_array_equal(first.rotation, 0)

    @pytest.mark.parametrize("speed", [0.1, -0.1], ids=["towards", "away"])
    @pytest.mark.parametrize("covariance", [None, mixed_covariance(1e-4)], ids=["exact", "noisy"])
    def test_along_normal(self, speed, covariance):
        motion = along_normal(PLANE, speed)
        first, second = solve(PLANE, motion, covariance)
        assert miss(first, *truth(PLANE, motion)) < EXACT
        assert first.case == second.case == "along normal"
        assert first.time_to_contact == pytest.approx(PLANE.distance / speed)
        np.testing.assert_array_equal(first.normal, second.normal)
        if covariance is not None:
            errors = first.standard_errors
            # the split of the two solutions goes as the root of the error of an eigenvalue
            assert 0.01 < errors.slant < 0.2
            assert errors.time_to_contact < 0.01 * abs(first.time_to_contact)

    def test_fronto_parallel(self):
        """The slant is 0 in one solution, and only it has no tilt."""
        facing, tilted = solve(Plane((0, 0, 1), 2.0), GENERAL)
        assert facing.case == "general"
        assert facing.fronto_parallel
        assert not tilted.fronto_parallel
        assert facing.slant < 1e-12
        assert math.isnan(facing.tilt)
        assert math.isfinite(tilted.tilt)
        facing, tilted = solve(Plane((0, 0, 1), 2.0), GENERAL, mixed_covariance(1e-4))
        assert facing.standard_errors.tilt == math.inf
        assert 0 < facing.standard_errors.slant < 0.1
        assert math.isfinite(tilted.standard_errors.tilt)

    def test_fronto_parallel_straight_ahead(self):
        wall, motion = Plane((0, 0, 1), 2.0), RigidMotion((0, 0, 0.1), TURN)
        first, second = solve(wall, motion)
        assert miss(first, *truth(wall, motion)) < EXACT
        assert first.case == second.case == "along normal"
        assert first.fronto_parallel
        assert first.time_to_contact == pytest.approx(20)

    def test_motion_in_the_plane_never_meets_it(self):
        wall = Plane((0, 0, 1), 2.0)
        facing, _ = solve(wall, RigidMotion((0.1, 0.05, 0), TURN), mixed_covariance(1e-5))
        assert facing.time_to_contact == math.inf
        assert facing.standard_errors.time_to_contact == math.inf
        np.testing.assert_allclose(facing.normal, [0, 0, 1], atol=EXACT)

    def test_nearly_special_scenes_stay_exact(self):
        """As close to the special cases as double precision tells them apart."""
        for off in (1e-2, 1e-4, 1e-6):
            motion = RigidMotion(tuple(0.1 * np.array(PLANE.normal) + [off, 0, 0]), TURN)
            both = solve(PLANE, motion)
            assert both[0].case == "general"
            assert min(miss(one, *truth(PLANE, motion)) for one in both) < EXACT
        for slow in (1e-3, 1e-6):
            motion = RigidMotion((slow, 2 * slow, slow), TURN)
            both = solve(PLANE, motion)
            assert both[0].case == "general"
            assert min(miss(one, *truth(PLANE, motion)) for one in both) < EXACT

    def test_a_plane_through_the_principal_point_s_horizon(self):
        """Level ground, level camera: the principal point sees no ground; say where it is seen."""
        ground, motion = Plane.ground(1.5), RigidMotion((0.02, 0, 0.3), (0, 0.01, 0))
        both = solve(ground, motion, visible_at=[(100, 460), (320, 470), (600, 480)])
        assert both[0].visible
        assert min(miss(one, *truth(ground, motion)) for one in both) < EXACT

    def test_a_solution_that_cannot_be_seen_everywhere_is_marked(self):
        motion = RigidMotion((0.1, 0, 0.0), TURN)
        wide = [(0, 0), (640, 0), (0, 480), (640, 480)]
        first, second = solve(Plane.from_slant(2.0, 0.2), motion, visible_at=wide)
        assert first.visible
        assert not second.visible
        np.testing.assert_allclose(first.slant, 0.2, atol=EXACT)

    def test_unknown_coefficients_stay_unknown(self):
        flow = planar_flow(CAMERA, PLANE, GENERAL).coefficients
        several = np.stack([flow, np.where(np.arange(8) == 3, np.nan, flow), flow])
        C = np.stack([mixed_covariance(1e-5)] * 3)
        C[2, 0, 0] = np.nan
        for one in planar_structure(Eight(several, CAMERA.centre, C), CAMERA):
            assert one.case.tolist() == ["general", "unknown", "unknown"]
            assert one.reason[1].startswith("a coefficient")
            for part in (one.normal, one.translation, one.rotation, *one.standard_errors):
                assert np.isfinite(part[0]).all()
                assert np.isnan(part[1:]).all()
            assert np.isnan(one.time_to_contact[1])
            assert one.visible.tolist() == [True, False, False]
        lost, _ = planar_structure(Eight(several[1], CAMERA.centre), CAMERA)
        with pytest.raises(InputError, match="case='unknown'"):
            lost.motion(1.0)


class TestStandardErrors:
    @pytest.mark.parametrize("of", ["camera", "object"])
    @pytest.mark.parametrize(
        ("plane", "motion"),
        [
            (PLANE, GENERAL),
            (
                Plane.from_slant(5.0, 1.0, 2.5),
                RigidMotion((0.3, -0.2, -0.1), TURN, of="object", point=(0, 0, 5)),
            ),
            (Plane.ground(1.5, pitch=0.5), RigidMotion((0.02, 0.01, 0.3), (0, 0.01, 0))),
        ],
    )
    def test_covariance_is_that_of_the_derivative(self, plane, motion, of):
        flow = planar_flow(CAMERA, plane, motion)
        C = mixed_covariance(1e-9)

        def parts(scaled, k):
            one = planar_structure(Eight(scaled * UNITS, CAMERA.centre), CAMERA, of=of)[k]
            return np.concatenate([one.normal, one.translation, one.rotation], axis=-1)

        for k, one in enumerate(solve(plane, motion, C, of=of)):
            J = numerical_jacobian(lambda scaled, k=k: parts(scaled, k), flow.coefficients / UNITS) / UNITS
            want = J @ C @ J.T
            size = np.sqrt(np.diag(want))
            assert (np.abs(one.covariance - want) / np.outer(size, size)).max() < 1e-7

            def derived(scaled, k=k):
                one = planar_structure(Eight(scaled * UNITS, CAMERA.centre), CAMERA, of=of)[k]
                return np.stack([one.speed, one.slant, one.tilt, one.time_to_contact], axis=-1)

            J = numerical_jacobian(derived, flow.coefficients / UNITS) / UNITS
            errors = one.standard_errors
            got = [errors.speed, errors.slant, errors.tilt, errors.time_to_contact]
            np.testing.assert_allclose(got, np.sqrt(np.diag(J @ C @ J.T)), rtol=1e-6)
            np.testing.assert_allclose(errors.normal, size[:3], rtol=1e-6)
            np.testing.assert_allclose(errors.rotation, size[6:], rtol=1e-6)

    def scatter(self, plane, motion, size, count=4000):
        """Standardised errors of everything, of the solution nearer to the truth."""
        flow, C = planar_flow(CAMERA, plane, motion), mixed_covariance(size)
        rng = np.random.default_rng(7)
        noisy = flow.coefficients + rng.normal(size=(count, 8)) @ np.linalg.cholesky(C).T
        both = planar_structure(Eight(noisy, CAMERA.centre, C), CAMERA)
        normal, translation, rotation = truth(plane, motion)
        distance = [np.linalg.norm(one.normal - normal, axis=-1) for one in both]
        near = np.asarray(distance[0] <= distance[1])
        want = {
            "normal": normal, "translation": translation, "rotation": rotation,
            "speed": np.linalg.norm(translation), "slant": plane.slant, "tilt": plane.tilt,
            "time_to_contact": 1 / (normal @ translation),
        }  # fmt: skip
        z = {}
        for name, value in want.items():
            a, b = ((getattr(one, name) - value) / getattr(one.standard_errors, name) for one in both)
            z[name] = np.where(near.reshape(-1, *(1,) * (a.ndim - 1)), a, b)
        return z, both

    def test_standardised_errors_have_unit_spread(self):
        z, _ = self.scatter(PLANE, GENERAL, 3e-5)
        for values in z.values():
            np.testing.assert_allclose(values.std(axis=0), 1, atol=5 / math.sqrt(2 * 4000))
            np.testing.assert_allclose(values.mean(axis=0), 0, atol=5 / math.sqrt(4000))

    def test_special_cases_are_taken_at_the_level(self):
        """A true special case is contradicted by 1 % of the noisy measurements."""
        _, (first, _) = self.scatter(PLANE, along_normal(PLANE, 0.1), 1e-4)
        assert np.mean(first.case == "general") == pytest.approx(0.01, abs=5 * math.sqrt(0.01 / 4000))
        eight = planar_flow(CAMERA, PLANE, RigidMotion(rotation=TURN))
        C = mixed_covariance(1e-4)
        noisy = eight.coefficients + np.random.default_rng(8).normal(size=(4000, 8)) @ np.linalg.cholesky(C).T
        first, _ = planar_structure(Eight(noisy, CAMERA.centre, C), CAMERA, level=0.05)
        assert np.mean(first.case != "pure rotation") == pytest.approx(0.05, abs=5 * math.sqrt(0.05 / 4000))

    @pytest.mark.parametrize("off", [0.0, 0.002, 0.004])
    def test_solutions_that_meet_state_an_error_that_covers_the_truth(self, off):
        """Where the two solutions cannot be told apart the error goes as the root of that of an eigenvalue."""
        motion = RigidMotion(tuple(0.1 * np.array(PLANE.normal) + [off, 0, 0]), TURN)
        z, (first, _) = self.scatter(PLANE, motion, 1e-4)
        merged = first.case == "along normal"
        assert merged.mean() > 0.5
        for values in z.values():
            spread = np.sqrt(np.mean(values[merged] ** 2, axis=0))
            assert (spread > 0.3).all()
            assert (spread < 1.2).all()
        assert np.sqrt(np.mean(z["time_to_contact"][merged] ** 2)) > 0.8

    def test_pure_rotation_states_an_error_that_covers_the_truth(self):
        eight = planar_flow(CAMERA, PLANE, RigidMotion(rotation=TURN))
        C = mixed_covariance(1e-4)
        noisy = eight.coefficients + np.random.default_rng(8).normal(size=(2000, 8)) @ np.linalg.cholesky(C).T
        first, _ = planar_structure(Eight(noisy, CAMERA.centre, C), CAMERA)
        z = ((first.rotation - TURN) / first.standard_errors.rotation)[first.case == "pure rotation"]
        assert (z.std(axis=0) < 1.1).all()
        assert (z.std(axis=0) > 0.3).all()


def test_any_leading_shape():
    nine = np.random.default_rng(0).normal(0, 0.1, (4, 3, 9))
    nine[..., 8] = 2.0
    eight = Eight(eight_from_nine(nine, 800.0), CAMERA.centre, mixed_covariance(1e-6))
    first, second = planar_structure(eight, CAMERA)
    assert first.normal.shape == (4, 3, 3)
    assert first.covariance.shape == (4, 3, 9, 9)
    assert first.case.shape == first.slant.shape == first.visible.shape == first.reason.shape == (4, 3)
    one, _ = planar_structure(Eight(eight.coefficients[2, 1], CAMERA.centre, eight.covariance[2, 1]), CAMERA)
    np.testing.assert_allclose(one.normal, first.normal[2, 1], atol=1e-12)
    np.testing.assert_allclose(one.standard_errors.slant, first.standard_errors.slant[2, 1], rtol=1e-9)
    assert isinstance(float(one.slant), float)
    assert str(one.case) == "general"
    with pytest.raises(InputError, match="holds several points"):
        second.plane(1.0)
    empty, _ = planar_structure(Eight(np.zeros((0, 8)), CAMERA.centre), CAMERA)
    assert empty.normal.shape == (0, 3)


FLOW = planar_flow(CAMERA, PLANE, GENERAL)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: planar_structure(FLOW.coefficients, CAMERA), "must be an Eight"),  # type: ignore[arg-type]
        (lambda: planar_structure(FLOW, 800), "camera=800: must be a Camera"),  # type: ignore[arg-type]
        (lambda: planar_structure(FLOW, CAMERA, covariance=np.eye(6)), "covariance of shape"),
        (lambda: planar_structure(FLOW, CAMERA, of="me"), "of='me'"),  # type: ignore[arg-type]
        (lambda: planar_structure(FLOW, CAMERA, visible_at=[]), "visible_at"),
        (lambda: planar_structure(FLOW, CAMERA, visible_at=(3, 4)), "visible_at"),  # type: ignore[arg-type]
        (lambda: planar_structure(FLOW, CAMERA, visible_at=[(math.nan, 0)]), "visible_at: 1 of 2"),
        (lambda: planar_structure(FLOW, CAMERA, level=0), "level=0"),
        (lambda: planar_structure(FLOW, CAMERA, level=1), "level=1.0: must be below 1"),
        (lambda: planar_structure(FLOW, CAMERA)[0].standard_errors, "covariance=None"),
        (lambda: planar_structure(FLOW, CAMERA)[0].plane(0.0), "distance=0.0"),
        (lambda: planar_structure(FLOW, CAMERA)[0].motion(-1.0), "distance=-1.0"),
    ],
)
def test_refusals(make, said):
    with pytest.raises(InputError, match=said):
        make()
