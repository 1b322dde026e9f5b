"""Flow and displacement of scenes against the exact projection, differentiated numerically."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg import expm

from projection import derivatives, displaced, velocity
from sixflow.errors import InputError
from sixflow.scenes import (
    EIGHT,
    Camera,
    Eight,
    KanataniScene,
    Plane,
    RigidDisplacement,
    RigidMotion,
    Surface,
    apply_homography,
    from_kanatani,
    homography_flow,
    homography_six,
    image_velocity,
    kanatani_coefficients,
    planar_flow,
    plane_homography,
    recentring_matrix,
    six_matrix,
    surface_displacement,
    surface_flow,
    to_kanatani,
)

RELATIVE = 1e-7  # the promise: against differentiation of the exact projection
CAMERA = Camera(focal=700.0, centre=(310.0, 250.0))
MOTIONS = {
    "camera": RigidMotion((0.05, -0.03, 0.1), (0.02, -0.04, 0.03)),
    "object": RigidMotion((0.05, -0.03, 0.1), (0.02, -0.04, 0.03), of="object"),
    "object about itself": RigidMotion(
        (0.05, -0.03, 0.1), (0.2, -0.1, 0.3), of="object", point=(0.2, 0.1, 3)
    ),
    "off-axis camera": RigidMotion((0.05, -0.03, 0.1), (0.02, -0.04, 0.03), point=(0.3, 0.0, -0.5)),
    "pure rotation": RigidMotion(rotation=(0.02, -0.04, 0.03)),
}
UNITS = np.array([700, 700, 1, 1, 1, 1, 1 / 700, 1 / 700])
PLANES = {
    "fronto-parallel": Plane((0, 0, 1), 2.0),
    "slanted": Plane.from_slant(2.0, 0.7, -1.0),
    "ground": Plane.ground(1.5, pitch=0.6, roll=0.1),
}
grid = np.meshgrid(np.linspace(0, 640, 7), np.linspace(10, 480, 6))
by_motion = pytest.mark.parametrize("motion", MOTIONS.values(), ids=MOTIONS.keys())
by_plane = pytest.mark.parametrize("plane", PLANES.values(), ids=PLANES.keys())


class Hills(Surface):
    """A smooth curved surface in closed form."""

    def _depth(self, camera, x, y):
        sin_x, cos_x, sin_y, cos_y = np.sin(x / 90), np.cos(x / 90), np.sin(y / 70), np.cos(y / 70)
        return 3 + 0.2 * sin_x * cos_y, 0.2 / 90 * cos_x * cos_y, -0.2 / 70 * sin_x * sin_y


def assert_close(got, want):
    """Relative to the largest of each number over the image."""
    got, want = np.asarray(got), np.asarray(want)
    size = np.abs(want).reshape(-1, want.shape[-1]).max(axis=0)
    # a number that vanishes everywhere is 0 to the rounding of the others
    size = np.maximum(size, 1e-6 * np.array([700, 700, 1, 1, 1, 1][: want.shape[-1]]))
    assert (np.abs(got - want) / size).max() < RELATIVE


@by_motion
def test_equation_1_at_any_depth(motion):
    depth = np.random.default_rng(0).uniform(1, 20, grid[0].shape)
    u, v = image_velocity(CAMERA, motion, *grid, depth)
    assert_close(np.stack([u, v], axis=-1), velocity(CAMERA, motion, *grid, depth))


def test_equation_1_as_written():
    x, y, Z, f = -37.0, 55.0, 4.0, CAMERA.focal
    (V_X, V_Y, V_Z), (W_X, W_Y, W_Z) = MOTIONS["camera"].translation, MOTIONS["camera"].rotation
    v_x = (x * V_Z - f * V_X) / Z + x * y / f * W_X - (f + x * x / f) * W_Y + y * W_Z
    v_y = (y * V_Z - f * V_Y) / Z + (f + y * y / f) * W_X - x * y / f * W_Y - x * W_Z
    got = image_velocity(CAMERA, MOTIONS["camera"], 310 + x, 250 + y, Z)
    np.testing.assert_allclose(got, (v_x, v_y), rtol=1e-14)


@by_motion
@pytest.mark.parametrize("surface", [*PLANES.values(), Hills()], ids=[*PLANES, "hills"])
def test_six_of_the_flow(motion, surface):
    want = derivatives(lambda x, y: velocity(CAMERA, motion, x, y, surface.depth(CAMERA, x, y)), *grid)
    assert_close(surface_flow(CAMERA, surface, motion, *grid), want)


@by_motion
@by_plane
def test_equation_2(motion, plane):
    want = derivatives(lambda x, y: velocity(CAMERA, motion, x, y, plane.depth(CAMERA, x, y)), *grid)
    eight = planar_flow(CAMERA, plane, motion)
    assert eight.centre == CAMERA.centre
    assert_close(eight.six_at(*grid), want)
    assert_close(np.stack(eight.at(*grid), axis=-1), want[..., :2])


@by_motion
def test_equation_2_as_printed(motion):
    """Kanatani's convention, directly and through the conversion both ways."""
    plane = PLANES["slanted"]
    eight = planar_flow(CAMERA, plane, motion).coefficients
    scene = to_kanatani(CAMERA, plane, motion)
    np.testing.assert_allclose(kanatani_coefficients(CAMERA.focal, *scene), eight, rtol=1e-12, atol=1e-15)
    plane_back, motion_back = from_kanatani(CAMERA.focal, scene)
    np.testing.assert_allclose(plane_back.normal, plane.normal, atol=1e-14)
    assert plane_back.distance == pytest.approx(plane.distance, rel=1e-12)
    points = np.random.default_rng(1).normal(0, 2, (9, 3))
    np.testing.assert_allclose(motion_back.velocity(points), motion.velocity(points), atol=1e-13)


def test_kanatani_in_space():
    """His own axes: the view point (0, 0, −f), the point (0, 0, r) moving by (a, b, c), in one unit, px."""
    f, p, q, r = 700.0, 0.3, -0.4, 500.0
    translation, rotation = np.array([3.0, -2.0, 5.0]), np.array([0.02, 0.01, -0.03])
    x, y = np.random.default_rng(2).uniform(-300, 300, (2, 12))
    # (X, Y, Z) = (x k, y k, (k − 1) f) on the plane Z = pX + qY + r
    k = (f + r) / (f - p * x - q * y)
    X = np.stack([x * k, y * k, (k - 1) * f], axis=-1)
    velocity_3d = translation + np.cross(rotation, X - [0, 0, r])
    h = 1e-30j
    moved = X + h * velocity_3d
    flow = (
        np.stack([f * moved[:, 0] / (f + moved[:, 2]), f * moved[:, 1] / (f + moved[:, 2])], axis=-1).imag
        / 1e-30
    )
    u0, v0, A, B, C, D, E, F = kanatani_coefficients(f, p, q, r, translation, rotation)
    np.testing.assert_allclose(u0 + A * x + B * y + (E * x + F * y) * x, flow[:, 0], rtol=1e-11)
    np.testing.assert_allclose(v0 + C * x + D * y + (E * x + F * y) * y, flow[:, 1], rtol=1e-11)


@by_motion
@pytest.mark.parametrize("surface", [*PLANES.values(), Hills()], ids=[*PLANES, "hills"])
def test_six_of_the_displacement(motion, surface):
    want = derivatives(
        lambda x, y: displaced(CAMERA, motion, x, y, surface.depth(CAMERA, x, y)) - np.stack([x, y], -1),
        *grid,
    )
    assert_close(surface_displacement(CAMERA, surface, motion, *grid), want)


@by_motion
@by_plane
def test_homography_is_the_displacement_of_a_plane(motion, plane):
    H = plane_homography(CAMERA, plane, motion)
    want = surface_displacement(CAMERA, plane, motion, *grid)
    np.testing.assert_allclose(homography_six(H, *grid), want, rtol=0, atol=1e-11)
    np.testing.assert_allclose(homography_six(3 * H, *grid), want, rtol=0, atol=1e-11)
    x, y = apply_homography(H, *grid)
    np.testing.assert_allclose(apply_homography(np.linalg.inv(H), x, y), grid, atol=1e-10)
    # the third row is the ratio of the depths, the determinant that of the distances
    depth = plane.depth(CAMERA, *grid)
    points = motion.displacement().apply(CAMERA.point(*grid, depth))
    ratio = np.stack([*grid, np.ones_like(grid[0])], axis=-1) @ H[2]
    np.testing.assert_allclose(ratio, points[..., 2] / depth, rtol=1e-12)
    assert np.linalg.det(H) == pytest.approx(plane.moved(motion).distance / plane.distance, rel=1e-11)


@by_motion
def test_displacement_of_a_short_time_is_the_flow(motion):
    """The difference falls with the square of the time."""
    plane, flow = PLANES["slanted"], surface_flow(CAMERA, PLANES["slanted"], motion, *grid)
    errors = [
        np.abs(
            homography_six(plane_homography(CAMERA, plane, motion.displacement(s)), *grid) - s * flow
        ).max()
        for s in (2e-2, 1e-2)
    ]
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.05)


@by_motion
def test_the_logarithm_of_a_homography_is_the_flow_half_way(motion):
    """To third order: the error falls with the cube of the time, and the plane is that of the middle."""
    errors = []
    for s in (0.1, 0.05):
        middle = PLANES["slanted"].moved(motion.displacement(s / 2))
        found = homography_flow(
            plane_homography(CAMERA, PLANES["slanted"], motion.displacement(s)), CAMERA.centre
        )
        want = s * planar_flow(CAMERA, middle, motion).coefficients
        errors.append(np.abs((found.coefficients - want) / UNITS).max())
    if motion is MOTIONS["pure rotation"]:
        assert max(errors) < 1e-14
    else:
        assert errors[0] / errors[1] == pytest.approx(8, rel=0.1)


def test_the_logarithm_undoes_the_exponential():
    L = np.array([[0.1, 0.2, 3.0], [-0.2, 0.05, -1.0], [1e-4, -2e-4, 0.0]])
    flow = homography_flow(2.0 * expm(L))
    np.testing.assert_allclose(flow.coefficients, [3, -1, 0.1, 0.2, -0.2, 0.05, -1e-4, 2e-4], atol=1e-12)
    again = homography_flow(expm(L), (100, -50)).recentred((0, 0))
    np.testing.assert_allclose(again.coefficients, flow.coefficients, atol=1e-12)


class TestEight:
    coefficients = np.array([1.0, -2.0, 0.02, 0.03, -0.01, 0.04, 1e-4, -2e-4])

    def test_six_at_the_centre(self):
        u0, v0, A, B, C, D, _, _ = self.coefficients
        six = Eight(self.coefficients, (5, 6)).six_at(5, 6)
        np.testing.assert_allclose(six, [u0, v0, A + D, C - B, A - D, B + C], atol=1e-16)
        assert EIGHT == ("u0", "v0", "A", "B", "C", "D", "E", "F")

    def test_six_anywhere(self):
        def flow(x, y):
            u0, v0, A, B, C, D, E, F = self.coefficients
            return np.stack(
                [u0 + A * x + B * y + (E * x + F * y) * x, v0 + C * x + D * y + (E * x + F * y) * y], -1
            )

        x, y = np.random.default_rng(0).uniform(-100, 100, (2, 9))
        want = derivatives(flow, x, y)
        np.testing.assert_allclose(Eight(self.coefficients, (5, 6)).six_at(x + 5, y + 6), want, atol=1e-12)
        np.testing.assert_allclose(six_matrix(x, y) @ self.coefficients, want, atol=1e-12)

    def test_recentred_is_the_same_flow(self):
        spread = np.random.default_rng(1).normal(size=(8, 8))
        flow = Eight(self.coefficients, (5, 6), spread @ spread.T)
        moved = flow.recentred((-40, 30))
        np.testing.assert_allclose(moved.six_at(*grid), flow.six_at(*grid), atol=1e-11)
        np.testing.assert_allclose(moved.six_covariance_at(100, 9), flow.six_covariance_at(100, 9), rtol=1e-9)
        np.testing.assert_allclose(recentring_matrix(3, 4) @ recentring_matrix(-3, -4), np.eye(8), atol=1e-13)

    def test_covariance_of_the_six(self):
        spread = np.random.default_rng(1).normal(size=(8, 8)) * 1e-3
        flow = Eight(self.coefficients, (0, 0), spread @ spread.T)
        M = six_matrix(30, -20)
        np.testing.assert_allclose(flow.six_covariance_at(30, -20), M @ flow.covariance @ M.T, rtol=1e-12)
        assert flow.six_covariance_at(*grid).shape == (*grid[0].shape, 6, 6)

    def test_leading_dimensions(self):
        many = Eight(np.tile(self.coefficients, (4, 3, 1)), (0, 0), np.eye(8))
        assert many.covariance.shape == (4, 3, 8, 8)
        assert many.six_at(1.0, 2.0).shape == (4, 3, 6)
        assert many.six_at(np.zeros((5, 1, 1)), 2.0).shape == (5, 4, 3, 6)
        assert many.recentred((1, 1)).coefficients.shape == (4, 3, 8)
        assert np.isnan(Eight(np.full(8, np.nan)).six_at(0, 0)).all()

    def test_homogeneous_form_gives_the_same_flow(self):
        """Velocity of (x, y, 1) by L, projected."""
        u0, v0, A, B, C, D, E, F = self.coefficients
        L = np.array([[A, B, u0], [C, D, v0], [-E, -F, 0]])
        m = np.array([30.0, -20.0, 1.0])
        flow = (L @ m - (L @ m)[2] * m)[:2]
        np.testing.assert_allclose(Eight(self.coefficients).at(30, -20), flow, rtol=1e-13)


HORIZON = [[1, 0, 0], [0, 1, 0], [-0.01, 0, 1]]  # at x = 100
FRONT, AHEAD = PLANES["fronto-parallel"], RigidMotion((0, 0, 0.1))


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: image_velocity(CAMERA, AHEAD, 0, 0, -1.0), "depth: 1 of 1 are not above 0"),
        (lambda: image_velocity(CAMERA, AHEAD, 0, 0, math.inf), "depth: 1 of 1 numbers are not finite"),
        (lambda: image_velocity("c", AHEAD, 0, 0, 1.0), "camera='c': must be a Camera"),  # type: ignore[arg-type]
        (lambda: image_velocity(CAMERA, None, 0, 0, 1.0), "motion=None: must be a RigidMotion"),  # type: ignore[arg-type]
        (
            lambda: surface_flow(CAMERA, PLANES["ground"], AHEAD, 320, -900),
            r"not seen.*1 of 1.*\(320, -900\)",
        ),
        (lambda: surface_flow(CAMERA, "wall", AHEAD, 0, 0), "surface='wall'"),  # type: ignore[arg-type]
        (lambda: planar_flow(CAMERA, Hills(), AHEAD), "plane=.*must be a Plane"),  # type: ignore[arg-type]
        (
            lambda: surface_displacement(CAMERA, FRONT, RigidMotion((0, 0, 3.0)), 0, 0),
            "leads behind.*1 of 1",
        ),
        (lambda: surface_displacement(CAMERA, FRONT, "on", 0, 0), "motion='on': must be a RigidMotion or a"),  # type: ignore[arg-type]
        (lambda: plane_homography(CAMERA, FRONT, RigidMotion((0, 0, 2.0))), "through the camera's centre"),
        (
            lambda: plane_homography(CAMERA, FRONT, RigidDisplacement((0, 0, 0), (0, 0, -5))),
            "through the camera's centre",
        ),
        (lambda: apply_homography(np.zeros((3, 3)), 0, 0), "is singular"),
        (lambda: apply_homography(np.diag([1.0, 1.0, 0.0]), 0, 0), "is singular"),
        (lambda: apply_homography(np.diag([1.0, 1.0, -1.0]), 0, 0), "mirrors"),
        (lambda: apply_homography(np.eye(2), 0, 0), "matrix of shape"),
        (
            lambda: apply_homography([[1, 0, 0], [0, 1, 0], [-0.01, 0, 1]], [0, 100.0], 0),
            r"w ≤ 0 at 1 of 2.*\(100, 0\)",
        ),
        (lambda: homography_six(HORIZON, 200.0, 0), "w ≤ 0.*infinity"),
        (lambda: homography_flow(np.diag([-2.0, -3.0, 1.0])), "no real logarithm"),
        (lambda: homography_flow(np.eye(3), centre=1), "centre=1"),  # type: ignore[arg-type]
        (lambda: kanatani_coefficients(0, 0, 0, 1, (0, 0, 0), (0, 0, 0)), "focal=0"),
        (
            lambda: kanatani_coefficients(800, 0, 0, -800, (0, 0, 0), (0, 0, 0)),
            "r=-800.0: f \\+ r must be above 0",
        ),
        (lambda: kanatani_coefficients(800, 0, 0, 1, (0, 0), (0, 0, 0)), "translation of shape"),
        (lambda: from_kanatani(800, KanataniScene(0, 0, -900, (0, 0, 0), (0, 0, 0))), "r=-900"),
        (lambda: from_kanatani(800, "scene"), "scene='scene'"),  # type: ignore[arg-type]
        (lambda: to_kanatani(CAMERA, Plane.ground(1.0), AHEAD), "does not meet the optical axis"),
        (lambda: Eight(np.zeros(7)), "coefficients of shape"),
        (lambda: Eight(np.zeros(8), covariance=np.zeros((6, 6))), "covariance of shape"),
        (lambda: Eight(np.zeros((3, 8)), covariance=np.zeros((2, 8, 8))), "covariance of shape"),
        (lambda: Eight(np.zeros(8), covariance=np.triu(np.ones((8, 8)))), "covariance: must be symmetric"),
        (lambda: Eight(np.zeros(8), covariance=-np.eye(8)), "covariance: must be symmetric, with variances"),
        (lambda: Eight(np.zeros(8), centre=(math.nan, 0)), r"centre\[0\]=nan"),
        (lambda: Eight(np.zeros(8)).six_covariance_at(0, 0), "covariance=None"),
        (lambda: Eight(np.zeros((3, 8))).six_at([0, 1], 0), "shapes points"),
        (lambda: Eight(np.zeros(8)).recentred(3), "centre=3"),  # type: ignore[arg-type]
    ],
)
def test_refusals(make, said):
    with pytest.raises(InputError, match=said):
        make()


def test_a_plane_along_the_axis_has_coefficients():
    """Level ground before a level camera has no p, q, r, but a flow."""
    ground = Plane.ground(1.5)
    below = CAMERA.centre[1] + np.array([20.0, 100, 200])
    flow = planar_flow(CAMERA, ground, AHEAD).six_at(300, below)
    np.testing.assert_allclose(flow, surface_flow(CAMERA, ground, AHEAD, 300, below), rtol=1e-10, atol=1e-15)
