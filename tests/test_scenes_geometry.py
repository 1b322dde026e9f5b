"""Cameras, planes, surfaces and rigid motions against elementary geometry."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from sixflow import scenes
from sixflow.errors import InputError
from sixflow.scenes import Camera, DepthMap, Plane, RigidDisplacement, RigidMotion
from sixflow.scenes.rotation import drift_matrix, rotation_matrix, rotation_vector, skew, unskew

CAMERA = Camera(focal=800.0, centre=(320.0, 240.0))
rng = np.random.default_rng(3)
X, Y = rng.uniform(0, 640, 50), rng.uniform(0, 480, 50)
INF, NAN = math.inf, math.nan


def twist(motion: RigidMotion) -> np.ndarray:
    """4×4 generator of the body's own motion, in homogeneous coordinates."""
    T = np.zeros((4, 4))
    T[:3, :3] = np.stack([np.cross(motion.rotation, axis) for axis in np.eye(3)], axis=1)
    T[:3, 3] = np.array(motion.translation) - np.cross(motion.rotation, motion.point)
    return T


class TestCamera:
    def test_projection_and_back(self):
        depth = rng.uniform(0.1, 100, 50)
        points = CAMERA.point(X, Y, depth)
        np.testing.assert_array_equal(points[:, 2], depth)
        np.testing.assert_allclose(CAMERA.project(points), (X, Y), atol=5e-13)
        homogeneous = points @ CAMERA.matrix.T
        np.testing.assert_allclose(homogeneous[:, :2].T / homogeneous[:, 2], (X, Y), atol=5e-13)
        np.testing.assert_allclose(CAMERA.matrix @ CAMERA.inverse_matrix, np.eye(3), atol=1e-13)

    def test_field_of_view_counts_from_edge_to_edge(self):
        camera = Camera.from_field_of_view(math.radians(90), (100, 200))
        assert camera.centre == (99.5, 49.5)
        np.testing.assert_allclose(camera.direction([-0.5, 199.5], 49.5)[:, 0], [-1, 1], atol=1e-15)

    def test_x_is_right_y_is_down_z_is_forward(self):
        np.testing.assert_array_equal(CAMERA.project([1.0, 0, 4]), [520, 240])
        np.testing.assert_array_equal(CAMERA.project([0, 1.0, 4]), [320, 440])

    @pytest.mark.parametrize(
        ("make", "said"),
        [
            (lambda: Camera(0), "focal=0: must be a finite number of px above 0"),
            (lambda: Camera(-800.0), "focal=-800.0"),
            (lambda: Camera(INF), "focal=inf"),
            (lambda: Camera("wide"), "focal='wide'"),  # type: ignore[arg-type]
            (lambda: Camera(800, centre=(1,)), "centre="),  # type: ignore[arg-type]
            (lambda: Camera(800, centre=(1, NAN)), r"centre\[1\]=nan"),
            (lambda: Camera.from_field_of_view(math.pi, (10, 10)), "angle=.*below π"),
            (lambda: Camera.from_field_of_view(1.0, (0, 10)), "shape="),
            (
                lambda: CAMERA.project([[0, 0, 1.0], [1, 1, 0.0]]),
                "points: 1 of 2 are not in front.*leave them out",
            ),
            (lambda: CAMERA.project([0, 0, -1.0]), "points: 1 of 1 are not in front"),
            (lambda: CAMERA.project([0, 0, INF]), "points: 1 of 3 numbers are not finite"),
            (lambda: CAMERA.project([0, 0]), "points of shape"),
            (lambda: CAMERA.point(0, 0, 0.0), "depth: 1 of 1 are not above 0"),
            (lambda: CAMERA.point(0, 0, INF), "depth: 1 of 1 numbers are not finite"),
            (lambda: CAMERA.point([0, 1], 0, [1.0, 2.0, 3.0]), "shapes"),
            (lambda: CAMERA.direction(NAN, 0), "x: 1 of 1"),
            (lambda: CAMERA.direction([0, 1], [0, 1, 2]), "shapes x"),
            (lambda: CAMERA.direction("left", 0), "x of dtype"),
        ],
    )
    def test_refusals(self, make, said):
        with pytest.raises(InputError, match=said):
            make()


class TestRotation:
    @pytest.mark.parametrize(
        "angle", [0.0, 1e-12, 1e-7, 1e-3, 0.0999, 0.1001, 1.0, 3.0, math.pi - 1e-9, math.pi]
    )
    def test_against_scipy(self, angle):
        vector = angle * np.array([2.0, -1.0, 2.0]) / 3
        S = skew(vector)
        np.testing.assert_allclose(S @ [1, 2, 3], np.cross(vector, [1, 2, 3]), atol=1e-14)
        np.testing.assert_array_equal(unskew(S), vector)
        R = rotation_matrix(vector)
        np.testing.assert_allclose(R, Rotation.from_rotvec(vector).as_matrix(), atol=2e-15)
        big = np.zeros((6, 6))
        big[:3, :3], big[:3, 3:] = S, np.eye(3)
        np.testing.assert_allclose(drift_matrix(vector), expm(big)[:3, 3:], atol=5e-15)
        back = rotation_vector(R)
        back = back if angle < math.pi - 1e-12 or back @ vector > 0 else -back
        np.testing.assert_allclose(back, vector, rtol=1e-12, atol=1e-16)

    def test_logarithm_of_random_rotations(self):
        for R in Rotation.random(200, random_state=0).as_matrix():
            np.testing.assert_allclose(rotation_matrix(rotation_vector(R)), R, atol=1e-14)

    def test_positive_about_z_is_clockwise_on_the_screen(self):
        turned = RigidDisplacement.of_object(rotation=(0, 0, 0.1)).apply([1.0, 0, 5])
        assert turned[1] > 0


class TestPlane:
    @pytest.mark.parametrize("seed", range(20))
    def test_parameterisations_agree(self, seed):
        r = np.random.default_rng(seed)
        slant, tilt, distance = r.uniform(0.05, 1.2), r.uniform(-3, 3), r.uniform(0.5, 9)
        plane = Plane.from_slant(distance, slant, tilt)
        p, q, depth = plane.slopes
        assert depth == pytest.approx(distance, rel=1e-13)
        assert math.hypot(p, q) == pytest.approx(math.tan(slant), rel=1e-12)
        assert plane.slant == pytest.approx(slant, abs=1e-13)
        assert plane.tilt == pytest.approx(tilt, abs=1e-13)
        again = Plane.from_slopes(p, q, depth)
        np.testing.assert_allclose(again.normal, plane.normal, atol=1e-14)
        assert again.distance == pytest.approx(plane.distance, rel=1e-13)
        x = 320 + r.uniform(-50, 50, 10)
        Z = plane.depth(CAMERA, x, 230.0)
        points = CAMERA.point(x, 230.0, Z)
        np.testing.assert_allclose(points[:, 2], p * points[:, 0] + q * points[:, 1] + depth, rtol=1e-12)
        np.testing.assert_allclose(points @ plane.normal, plane.distance, rtol=1e-12)

    def test_depth_grows_along_the_tilt(self):
        plane = Plane.from_slant(2.0, 0.5, tilt=math.radians(90))
        near, far = plane.depth(CAMERA, 320, [200, 280])
        assert near < 2 < far

    def test_ground(self):
        height, pitch = 1.5, 0.3
        ground = Plane.ground(height, pitch)
        horizon = 240 - 800 * math.tan(pitch)
        sees = ground.sees(CAMERA, 320, [horizon - 1, horizon + 1])
        assert sees.tolist() == [False, True]
        assert np.isnan(ground.depth(CAMERA, 320, horizon - 1))
        point = CAMERA.point(320, 240, ground.depth(CAMERA, 320, 240))
        assert np.linalg.norm(point) == pytest.approx(height / math.sin(pitch))
        rolled = Plane.ground(height, 0.0, roll=0.2)
        # the camera is turned clockwise: its right side goes down, the ground is nearer there
        assert rolled.depth(CAMERA, 620, 400) < rolled.depth(CAMERA, 20, 400)

    def test_moved_keeps_its_points(self):
        plane = Plane.from_slant(2.0, 0.5, 1.0)
        motion = RigidMotion((0.1, -0.2, 0.3), (0.2, 0.1, -0.3))
        points = CAMERA.point(X, Y, plane.depth(CAMERA, X, Y))
        moved, after = plane.moved(motion), motion.displacement().apply(points)
        np.testing.assert_allclose(after @ moved.normal, moved.distance, rtol=1e-13)
        np.testing.assert_allclose(np.linalg.norm(moved.normal), 1, rtol=1e-15)

    @pytest.mark.parametrize(
        ("make", "said"),
        [
            (lambda: Plane((0, 0, 0), 1.0), "normal=.*must not be 0"),
            (lambda: Plane((0, 0, 1), 0.0), "distance=0.0: must be.*above 0"),
            (lambda: Plane((0, 0, -1), 1.0), "normal=.*behind the camera"),
            (lambda: Plane((0, 0), 1.0), "normal="),  # type: ignore[arg-type]
            (lambda: Plane.from_slopes(0, 0, 0.0), "r=0.0: must be above 0.*passes through the camera"),
            (lambda: Plane.from_slopes(0, 0, -2.0), "r=-2.0"),
            (lambda: Plane.from_slopes(NAN, 0, 2.0), "p=nan"),
            (lambda: Plane.from_slant(0.0, 0.1), "distance=0.0"),
            (lambda: Plane.from_slant(2.0, math.pi / 2), "slant=1.57.*edge-on"),
            (lambda: Plane.from_slant(2.0, -0.1), "slant=-0.1"),
            (lambda: Plane.ground(-1.0), "height=-1.0"),
            (lambda: Plane.ground(1.0, -math.pi / 2), "normal=.*behind"),
            (lambda: Plane.ground(1.0).slopes, "does not meet the optical axis"),
            (
                lambda: Plane((0, 0, 1), 1.0).moved(RigidMotion((0, 0, 1.0))),
                "motion=.*through the camera's centre",
            ),
            (
                lambda: Plane((0, 0, 1), 1.0).moved(RigidDisplacement((math.pi, 0, 0))),
                "normal=.*behind the camera",
            ),
            (lambda: Plane((0, 0, 1), 1.0).moved("ahead"), "motion='ahead'"),  # type: ignore[arg-type]
            (lambda: Plane((0, 0, 1), 1.0).sees("camera", 0, 0), "camera='camera'"),  # type: ignore[arg-type]
        ],
    )
    def test_refusals(self, make, said):
        with pytest.raises(InputError, match=said):
            make()


class TestDepthMap:
    y, x = np.mgrid[-20:220:5, -20:220:5].astype(float)
    relief = DepthMap(2 + 0.1 * np.sin(x / 30) * np.cos(y / 40), origin=(-20, -20), step=5)

    def test_passes_through_its_table_and_has_its_own_slope(self):
        camera = Camera(500, (100, 100))
        Z, Z_x, Z_y = self.relief._depth(camera, self.x, self.y)
        np.testing.assert_allclose(Z, self.relief.table, rtol=1e-13)
        # off the knots, where the spline is one polynomial
        x, y, h = X[:20] / 4 + 0.3, Y[:20] / 3 + 0.3, 1e-3
        x, y = np.floor(x / 5) * 5 + 2, np.floor(y / 5) * 5 + 2
        _, Z_x, Z_y = self.relief._depth(camera, x, y)
        by_x = (self.relief.depth(camera, x + h, y) - self.relief.depth(camera, x - h, y)) / (2 * h)
        by_y = (self.relief.depth(camera, x, y + h) - self.relief.depth(camera, x, y - h)) / (2 * h)
        np.testing.assert_allclose(Z_x, by_x, atol=1e-10)
        np.testing.assert_allclose(Z_y, by_y, atol=1e-10)
        np.testing.assert_allclose(Z_x, 0.1 / 30 * np.cos(x / 30) * np.cos(y / 40), atol=2e-6)

    def test_nothing_beyond_the_table(self):
        Z = self.relief.depth(CAMERA, [-20, -20.1, 215, 215.1], 0.0)
        assert np.isnan(Z).tolist() == [False, True, False, True]
        with pytest.raises(InputError, match=r"DepthMap\(48×48.*not seen by the camera at 1 of 2"):
            self.relief.require_depth(CAMERA, np.array([0.0, 500.0]), np.array([0.0, 0.0]))

    @pytest.mark.parametrize(
        ("make", "said"),
        [
            (lambda: DepthMap(np.ones((3, 9))), "depth of shape"),
            (lambda: DepthMap(np.ones(9)), "depth of shape"),
            (lambda: DepthMap(np.zeros((9, 9))), "depth: 81 of 81 are not above 0"),
            (lambda: DepthMap(np.full((9, 9), NAN)), "depth: 81 of 81 numbers are not finite"),
            (lambda: DepthMap(np.ones((9, 9)), step=0), "step=0"),
            (lambda: DepthMap(np.ones((9, 9)), origin=3), "origin=3"),  # type: ignore[arg-type]
        ],
    )
    def test_refusals(self, make, said):
        with pytest.raises(InputError, match=said):
            make()


class TestMotion:
    motions = (
        RigidMotion((0.1, -0.2, 0.3), (0.4, 0.1, -0.5)),
        RigidMotion((0.1, -0.2, 0.3), (0.4, 0.1, -0.5), of="object"),
        RigidMotion((0.1, -0.2, 0.3), (0.4, 0.1, -0.5), of="object", point=(0.3, -0.4, 5.0)),
        RigidMotion((0.1, -0.2, 0.3), (0.0, 0.0, 0.0), point=(0.3, -0.4, -1.0)),
        RigidMotion((0.1, -0.2, 0.3), (0.0, 0.02, 0.0), point=(0.3, -0.4, -1.0)),
    )
    points = rng.normal(0, 3, (20, 3))

    @pytest.mark.parametrize("motion", motions)
    def test_displacement_is_the_exponential_of_the_velocities(self, motion):
        """For a camera: the pose after the time is exp(s twist), the scene is seen from there."""
        for s in (0.3, 1.0, -2.5):
            pose = expm(s * twist(motion))
            pose = pose if motion.of == "object" else np.linalg.inv(pose)
            want = self.points @ pose[:3, :3].T + pose[:3, 3]
            np.testing.assert_allclose(motion.displacement(s).apply(self.points), want, atol=1e-13)

    @pytest.mark.parametrize("motion", motions)
    def test_velocity_is_the_derivative_of_the_displacement(self, motion):
        h = 1e-5
        ahead, behind = motion.displacement(h), motion.displacement(-h)
        numeric = (ahead.apply(self.points) - behind.apply(self.points)) / (2 * h)
        np.testing.assert_allclose(motion.velocity(self.points), numeric, atol=1e-9)

    @pytest.mark.parametrize("motion", motions)
    def test_other_words_for_the_same_motion(self, motion):
        other = "object" if motion.of == "camera" else "camera"
        for same in (motion.seen_as(other), motion.about((1, 2, 3)), motion.seen_as(other).about((5, 0, 1))):
            np.testing.assert_allclose(same.velocity(self.points), motion.velocity(self.points), atol=1e-14)
        assert motion.seen_as(motion.of) is motion
        steady = RigidMotion.from_displacement(motion.displacement())
        np.testing.assert_allclose(steady.velocity(self.points), motion.velocity(self.points), atol=1e-12)
        twice = motion.scaled(2.0).displacement()
        np.testing.assert_allclose(
            twice.apply(self.points), motion.displacement(2).apply(self.points), atol=1e-13
        )

    def test_the_point_of_an_object_moves_by_its_translation(self):
        motion = self.motions[2]
        np.testing.assert_allclose(motion.velocity(motion.point), motion.translation, atol=1e-15)

    def test_displacements(self):
        one = RigidDisplacement.of_object((0.1, 0.2, 0.3), (1, 2, 3), point=(0, 0, 4))
        np.testing.assert_allclose(one.apply([0, 0, 4.0]), [1, 2, 7], atol=1e-14)
        np.testing.assert_allclose(one.inverse().apply(one.apply(self.points)), self.points, atol=1e-14)
        both = one.then(RigidDisplacement((0, 0, 0.5), (1, 0, 0)))
        want = RigidDisplacement((0, 0, 0.5), (1, 0, 0)).apply(one.apply(self.points))
        np.testing.assert_allclose(both.apply(self.points), want, atol=1e-14)
        # a camera that goes forward by 2 and then looks to the right: what was ahead is on the left
        seen = RigidDisplacement.of_camera((0, math.pi / 2, 0), (0, 0, 2)).apply([0, 0, 5.0])
        np.testing.assert_allclose(seen, [-3, 0, 0], atol=1e-15)

    @pytest.mark.parametrize(
        ("make", "said"),
        [
            (lambda: RigidMotion((0, 0)), "translation="),  # type: ignore[arg-type]
            (lambda: RigidMotion(rotation=(0, NAN, 0)), r"rotation\[1\]=nan"),
            (lambda: RigidMotion(of="scene"), "of='scene': must be 'camera' or 'object'"),  # type: ignore[arg-type]
            (lambda: RigidMotion(point=3), "point=3"),  # type: ignore[arg-type]
            (lambda: RigidMotion().seen_as("me"), "of='me'"),  # type: ignore[arg-type]
            (lambda: RigidMotion().displacement(INF), "duration=inf"),
            (lambda: RigidMotion().scaled(NAN), "factor=nan"),
            (lambda: RigidMotion.from_displacement("on"), "displacement='on'"),  # type: ignore[arg-type]
            (lambda: RigidMotion().velocity([1.0, 2.0]), "points of shape"),
            (lambda: RigidDisplacement(np.diag([1.0, 1, -1])), "rotation=.*must be a rotation"),  # type: ignore[arg-type]
            (lambda: RigidDisplacement(np.eye(3) * 1.1), "rotation=.*RᵀR"),  # type: ignore[arg-type]
            (lambda: RigidDisplacement(np.zeros((3, 3))), "rotation="),  # type: ignore[arg-type]
            (lambda: RigidDisplacement(np.eye(2)), "rotation=.*3×3"),  # type: ignore[arg-type]
            (lambda: RigidDisplacement.of_object(point=(0, 0)), "point="),
            (lambda: RigidDisplacement((0, 0, 0)).then("x"), "later='x'"),  # type: ignore[arg-type]
        ],
    )
    def test_refusals(self, make, said):
        with pytest.raises(InputError, match=said):
            make()


def test_every_public_name_is_documented():
    for name in dir(scenes):
        value = getattr(scenes, name)
        if callable(value) and name[0] != "_":
            assert value.__doc__, name
