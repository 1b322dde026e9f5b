"""Planes and surfaces in front of a camera as motions: exact maps, exact frames, and what is measured on them."""

from __future__ import annotations

import math

import numpy as np
import pytest

import sixflow
from projection import displaced
from sixflow.errors import InputError
from sixflow.scenes import Camera, DepthMap, Plane, RigidDisplacement, RigidMotion, planar_flow
from sixflow.synth import (
    Affine,
    Homography,
    PlaneInView,
    Sensor,
    Speckle,
    SurfaceInView,
    pair,
    relative,
    sequence,
)

CAMERA = Camera(focal=300.0, centre=(48.0, 48.0))
WALL = Plane.from_slant(2.0, 0.7, 0.5)
MOVE = RigidMotion((0.05, -0.02, 0.15), (0.02, -0.03, 0.1))
rows, columns = np.mgrid[-30:131:5, -30:131:5].astype(float)
HILLS = DepthMap(2 + 0.05 * np.sin(columns / 20) * np.cos(rows / 15), origin=(-30, -30), step=5)
MOTIONS = {
    "plane": PlaneInView(CAMERA, WALL, MOVE),
    "turning plate": PlaneInView(
        CAMERA, WALL, RigidMotion((0.01, 0, 0), (0.1, 0.2, 0.3), "object", (0, 0, 2.0))
    ),
    "given displacement": PlaneInView(
        CAMERA, WALL, RigidDisplacement.of_camera((0, 0.05, 0.2), (0.1, 0, 0.1))
    ),
    "surface": SurfaceInView(CAMERA, HILLS, MOVE),
    "plane as a surface": SurfaceInView(CAMERA, WALL, MOVE),
    "homography": Homography(((1.1, 0.1, 3.0), (-0.1, 0.95, -2.0), (1e-3, -5e-4, 1.0))),
}
each = pytest.mark.parametrize("motion", MOTIONS.values(), ids=MOTIONS.keys())
x, y = np.random.default_rng(0).uniform(0, 96, (2, 200))


@each
def test_gradient_is_the_derivative(motion):
    h = 1e-4
    by_x = (np.array(motion.displacement(x + h, y)) - motion.displacement(x - h, y)) / (2 * h)
    by_y = (np.array(motion.displacement(x, y + h)) - motion.displacement(x, y - h)) / (2 * h)
    np.testing.assert_allclose(motion.gradient(x, y)[..., 0], by_x.T, atol=1e-7)
    np.testing.assert_allclose(motion.gradient(x, y)[..., 1], by_y.T, atol=1e-7)


@each
def test_inverse_to_a_nanopixel(motion):
    np.testing.assert_allclose(motion.inverse(*motion.forward(x, y)), (x, y), rtol=0, atol=1e-8)
    inner = 30 + 0.4 * x, 30 + 0.4 * y
    np.testing.assert_allclose(motion.forward(*motion.inverse(*inner)), inner, rtol=0, atol=1e-9)


@each
def test_course_in_time(motion):
    np.testing.assert_allclose(motion.at(0).displacement(x, y), np.zeros((2, 200)), atol=1e-12)
    np.testing.assert_allclose(motion.at(1).six(x, y), motion.six(x, y), atol=1e-12)
    assert motion.gradient(np.zeros((2, 1)), np.zeros(3)).shape == (2, 3, 2, 2)


@pytest.mark.parametrize("name", ["plane", "turning plate", "surface"])
def test_every_time_is_projected_exactly(name):
    motion = MOTIONS[name]
    depth = getattr(motion, "plane", HILLS).depth(CAMERA, x, y)
    for s in (0.5, 1.0, 2.0, -1.0):
        want = displaced(CAMERA, motion.motion, x, y, depth, s)
        np.testing.assert_allclose(motion.at(s).forward(x, y), want.T, atol=1e-10)


def test_plane_and_surface_agree():
    one, other = MOTIONS["plane"], MOTIONS["plane as a surface"]
    np.testing.assert_allclose(one.six(x, y), other.six(x, y), atol=1e-11)
    np.testing.assert_allclose(one.six(x, y), Homography(one.homography).six(x, y), atol=1e-12)
    np.testing.assert_allclose(one.inverse(x, y), other.inverse(x, y), atol=1e-9)


def test_a_homography_is_a_group():
    motion = MOTIONS["homography"]
    two = motion.at(0.3).forward(*motion.at(0.7).forward(x, y))
    np.testing.assert_allclose(two, motion.forward(x, y), atol=1e-11)
    np.testing.assert_allclose(motion.at(-1).forward(*motion.forward(x, y)), (x, y), atol=1e-11)
    affine = Affine.from_six((1, 2, 0.1, 0.2, 0.05, -0.1))
    (u_x, u_y), (v_x, v_y) = affine.G
    same = Homography(((1 + u_x, u_y, 1.0), (v_x, 1 + v_y, 2.0), (0, 0, 1)))
    np.testing.assert_allclose(same.at(0.4).six(x, y), affine.at(0.4).six(x, y), atol=1e-12)


def test_a_view_is_hashable_and_can_be_compared():
    assert PlaneInView(CAMERA, WALL, MOVE) == MOTIONS["plane"]
    assert hash(PlaneInView(CAMERA, WALL, MOVE)) == hash(MOTIONS["plane"])


def test_rendered_by_casting_rays():
    """A pixel of frame 1 → the moved plane → back in space → frame 0 → the pattern."""
    pattern, motion = Speckle(sigma=2.0, seed=3), MOTIONS["plane"]
    made = pair(pattern, motion, (96, 96))
    step, moved = MOVE.displacement(), WALL.moved(MOVE)
    row, column = np.mgrid[:96, :96]
    points = CAMERA.point(column, row, moved.depth(CAMERA, column, row))
    origin = CAMERA.project(step.inverse().apply(points))
    np.testing.assert_allclose(made.frame1, pattern(*origin), atol=1e-8)
    np.testing.assert_array_equal(made.frame0, pattern(column, row))


def test_truth_between_frames_of_a_sequence():
    made = sequence(Speckle(seed=1), MOTIONS["plane"], (24, 24), 4)
    later = WALL.moved(MOVE.displacement(2))
    want = PlaneInView(CAMERA, later, MOVE).six(20.0, 10.0)
    np.testing.assert_allclose(made.truth(20.0, 10.0, 2, 3), want, atol=1e-10)
    step = relative(made.motion.at(2), made.motion.at(3))
    np.testing.assert_allclose(step.six(20.0, 10.0), want, atol=1e-10)


@pytest.mark.parametrize("name", ["plane", "surface"])
def test_measured_within_the_standard_errors(name):
    """The windows' affine model leaves a bias of second order; for these gentle motions it is below the noise."""
    camera = Camera(focal=600.0, centre=(64.0, 64.0))
    motion = RigidMotion((0.004, -0.003, 0.02), (0.001, -0.002, 0.01))
    view = (
        PlaneInView(camera, Plane.from_slant(2.0, 0.6, 0.4), motion)
        if name == "plane"
        else SurfaceInView(camera, DepthMap(HILLS.table, (-30, -30), 5.5), motion)
    )
    made = pair(Speckle(seed=5), view, (128, 128), sensor=Sensor(noise=2.0, seed=2))
    field = sixflow.measure(made.frame0, made.frame1, window=25, step=16)
    inner = field.isel(x=slice(1, -1), y=slice(1, -1))
    true = made.truth(*np.meshgrid(inner.x, inner.y))
    six = inner.sixflow.six.values.squeeze()
    error = np.sqrt(np.diagonal(inner.covariance.values.squeeze(), axis1=-2, axis2=-1))
    z = (six - true) / error
    assert np.abs(z.mean(axis=(0, 1))).max() < 0.8
    assert np.abs(z).max() < 5
    if name == "plane":
        # and the differential flow is what is measured, to second order in the motion
        flow = planar_flow(camera, view.plane, motion).six_at(*np.meshgrid(inner.x, inner.y))
        assert np.abs(flow - true).max() < 0.05


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: PlaneInView(800, WALL, MOVE), "camera=800"),
        (lambda: PlaneInView(CAMERA, HILLS, MOVE), "plane=DepthMap"),
        (lambda: PlaneInView(CAMERA, WALL, Affine()), "motion=Affine"),
        (lambda: SurfaceInView(800, HILLS, MOVE), "camera=800"),
        (lambda: SurfaceInView(CAMERA, np.ones((3, 3)), MOVE), "surface=array"),
        (lambda: SurfaceInView(CAMERA, HILLS, None), "motion=None"),
        (lambda: PlaneInView(CAMERA, WALL, RigidMotion((0, 0, 3))), "through the camera's centre"),
        (lambda: MOTIONS["plane"].at(20), "through the camera's centre"),
        (lambda: MOTIONS["plane"].at(math.inf), "s=inf"),
        (lambda: MOTIONS["surface"].at(None), "s=None"),
        (lambda: PlaneInView(CAMERA, Plane.ground(1.5), MOVE).six(48, 40), "not seen by the camera"),
        (lambda: pair(Speckle(), PlaneInView(CAMERA, Plane.ground(1.5), MOVE), (96, 96)), "w ≤ 0|not seen"),
        (lambda: MOTIONS["surface"].six(500, 0), "not seen by the camera"),
        (
            lambda: SurfaceInView(CAMERA, HILLS, RigidMotion((0, 0, 1.99))).six(48, 48),
            "leads behind",
        ),
        (lambda: Homography(np.zeros((3, 3))), "is singular"),
        (lambda: Homography(np.diag([1, 1, -1])), "mirrors"),
        (lambda: Homography("H"), "matrix"),
        (lambda: MOTIONS["homography"].six(-2000, 0), "w ≤ 0"),
        (lambda: Homography(np.diag([-2.0, -3.0, 1.0])).at(0.5), "no real logarithm"),
    ],
)
def test_refusals(make, said):
    with pytest.raises(InputError, match=said):
        make()
