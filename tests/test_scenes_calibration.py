"""The six as functions of structure and motion, their derivatives, and what errors of the nine follow."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from projection import derivatives, velocity
from sixflow.convention import numerical_jacobian
from sixflow.errors import FieldFileError, InputError
from sixflow.scenes import (
    NINE,
    Camera,
    Eight,
    Plane,
    RigidMotion,
    calibrate,
    eight_from_nine,
    eight_jacobian,
    planar_flow,
    planar_structure,
    sensitivity,
)

RELATIVE = 1e-7
CAMERA = Camera(focal=600.0, centre=(320.0, 240.0))
PLANE = Plane.from_slant(2.0, 0.6, 0.8)
V, OMEGA = (0.05, -0.03, 0.1), (0.02, -0.04, 0.03)
MOTIONS = {
    "camera": RigidMotion(V, OMEGA),
    "off-axis camera": RigidMotion(V, OMEGA, point=(0.3, -0.2, -0.5)),
    "object": RigidMotion(V, OMEGA, of="object"),
    "object about itself": RigidMotion(V, OMEGA, of="object", point=(0.2, 0.1, 2.5)),
}
by_motion = pytest.mark.parametrize("motion", MOTIONS.values(), ids=MOTIONS.keys())


def scene_of(nine, like: RigidMotion):
    return Plane.from_slopes(*nine[6:]), RigidMotion(tuple(nine[:3]), tuple(nine[3:6]), like.of, like.point)


def exact_six(nine, like, x, y):
    """By complex steps in time and differences over the image, of the exact projection."""
    plane, motion = scene_of(nine, like)
    return derivatives(
        lambda x, y: velocity(CAMERA, motion, x, y, plane.depth(CAMERA, x, y)),
        np.array(x),
        np.array(y),
        h=8.0,
    )


@by_motion
@pytest.mark.parametrize("at", [(320.0, 240.0), (500.0, 100.0)])
def test_jacobian_of_the_six_against_the_exact_projection(motion, at):
    found = calibrate(CAMERA, PLANE, motion, at)
    np.testing.assert_allclose(found.six, exact_six(found.nine, motion, *at), rtol=1e-8, atol=1e-11)
    h = 1e-3
    columns = []
    for step in h * np.eye(9):
        near, far = (
            exact_six(found.nine + k * step, motion, *at) - exact_six(found.nine - k * step, motion, *at)
            for k in (1, 2)
        )
        columns.append((8 * near - far) / (12 * h))
    want = np.stack(columns, axis=-1)
    size = np.abs(want).max(axis=1, keepdims=True)
    assert (np.abs(found.six_jacobian - want) / size).max() < RELATIVE


@by_motion
def test_jacobian_of_the_eight(motion):
    found = calibrate(CAMERA, PLANE, motion)

    def eight(nine):
        return np.stack(
            [planar_flow(CAMERA, *scene_of(one, motion)).coefficients for one in nine.reshape(-1, 9)]
        )

    np.testing.assert_allclose(found.eight, eight(found.nine)[0], rtol=1e-12, atol=1e-16)
    want = numerical_jacobian(lambda nine: eight(nine)[0], found.nine)
    size = np.abs(want).max(axis=1, keepdims=True)
    assert (np.abs(found.eight_jacobian - want) / size).max() < RELATIVE
    many = np.tile(found.nine, (3, 2, 1))
    kind = {"focal": CAMERA.focal, "of": motion.of, "point": motion.point}
    np.testing.assert_array_equal(
        eight_jacobian(many, **kind), np.broadcast_to(found.eight_jacobian, (3, 2, 8, 9))
    )
    np.testing.assert_array_equal(eight_from_nine(many, **kind), np.broadcast_to(found.eight, (3, 2, 8)))


@pytest.mark.parametrize("of", ["camera", "object"])
def test_the_scale_is_not_seen(of):
    found = calibrate(CAMERA, PLANE, RigidMotion(V, OMEGA, of))
    scaling = np.concatenate([found.nine[:3], np.zeros(5), found.nine[8:]])
    np.testing.assert_allclose(
        found.eight_jacobian @ scaling, 0, atol=1e-13 * np.abs(found.eight_jacobian).max()
    )
    assert np.linalg.matrix_rank(found.eight_jacobian / UNITS[:, None]) == 8


def test_table():
    found = calibrate(CAMERA, PLANE, MOTIONS["camera"])
    both = (("six", {"divergence", "shear"}, found.six_jacobian), ("eight", {"A", "F"}, found.eight_jacobian))
    for kind, names, J in both:
        lines = found.table(kind, length="mm").splitlines()
        assert len(lines) == 3 + len(J)
        assert lines[0].split() == ["value", *NINE]
        assert lines[1].count("mm/frame") == 3
        assert {line.split()[0] for line in lines} >= names
        for line, row in zip(lines[3:], J, strict=True):
            np.testing.assert_allclose([float(part) for part in line.split()[2:]], row, rtol=1e-3, atol=1e-12)
    assert str(found) == found.table("six")


def test_picture(tmp_path):
    found = calibrate(CAMERA, Plane.ground(1.5, pitch=0.2), MOTIONS["camera"], at=(320, 300))
    figure = found.picture((480, 640), tmp_path / "nine.png")
    assert (tmp_path / "nine.png").stat().st_size > 10_000
    titles = [axes.get_title() for axes in figure.axes]
    assert len(titles) == 9
    assert "V_X" in titles[0]
    assert titles[8].endswith("per m")
    # the sky is shaded
    assert all(len(axes.collections) == 2 for axes in figure.axes)
    calibrate(CAMERA, PLANE, RigidMotion()).picture((48, 64))  # nothing moves: no arrows for p, q, r
    with pytest.raises(InputError, match=r"path=.*\.docx"):
        found.picture((480, 640), tmp_path / "nine.docx")
    with pytest.raises(FieldFileError, match="cannot be saved"):
        found.picture((480, 640), tmp_path / "nowhere" / "nine.png")
    with pytest.raises(InputError, match="shape="):
        found.picture((480, 1))


SPREAD = np.random.default_rng(0).normal(size=(6, 6)) * 1e-4 * np.array([100, 100, 1, 1, 1, 1.0])[:, None]
SIX_COVARIANCE = SPREAD @ SPREAD.T
UNITS = np.array([600, 600, 1, 1, 1, 1, 1 / 600, 1 / 600])
SPREAD8 = np.random.default_rng(1).normal(size=(8, 8)) * 1e-4 * UNITS[:, None]
EIGHT_COVARIANCE = SPREAD8 @ SPREAD8.T


def derived(nine, at, like):
    plane, motion = scene_of(nine, like)
    contact = -1 / float(plane.scaled_normal @ motion.scene_translation)
    return np.array([float(plane.depth(CAMERA, *at)), plane.distance, plane.slant, plane.tilt, contact])


@by_motion
@pytest.mark.parametrize(
    ("unknown", "prior"),
    [
        (("p", "q", "r"), {}),
        (("r",), {}),
        (("V_X", "V_Y", "V_Z"), {}),
        (("r", "p", "q", "V_Z"), {"V_Z": 0.01}),
        (NINE, {"V_Z": 0.01, "Omega_X": 0.001, "Omega_Y": 0.001, "Omega_Z": 0.001}),
    ],
)
def test_sensitivity_is_the_inverse_of_the_information(motion, unknown, prior):
    """Against the textbook formula, with numerical gradients of the derived quantities."""
    at = (400.0, 200.0)
    found = calibrate(CAMERA, PLANE, motion, at)
    J = found.six_jacobian[:, [NINE.index(name) for name in unknown]]
    information = J.T @ np.linalg.inv(SIX_COVARIANCE) @ J
    information += np.diag([1 / prior[name] ** 2 if name in prior else 0.0 for name in unknown])
    C = np.zeros((9, 9))
    index = [NINE.index(name) for name in unknown]
    C[np.ix_(index, index)] = np.linalg.inv(information)
    got = sensitivity(found, SIX_COVARIANCE, unknown=unknown, prior=prior)
    assert got.undetermined == ()
    errors = list(got.standard_errors.values())
    np.testing.assert_allclose(errors[:9], np.sqrt(np.diag(C)), rtol=1e-5)
    gradient = numerical_jacobian(lambda nine: derived(nine, at, motion), found.nine)
    np.testing.assert_allclose(errors[9:], np.sqrt(np.diag(gradient @ C @ gradient.T)), rtol=1e-4)
    np.testing.assert_allclose(list(got.values.values())[9:], derived(found.nine, at, motion), rtol=1e-12)


@pytest.mark.parametrize("of", ["camera", "object"])
def test_all_nine_unknown_is_the_closed_form_from_the_eight(of):
    """Two roads: the information of the eight with an unseen scale, and the differentiated closed form."""
    motion = RigidMotion(V, OMEGA, of)
    got = sensitivity(calibrate(CAMERA, PLANE, motion), EIGHT_COVARIANCE, unknown=NINE)
    assert got.undetermined == ("V_X", "V_Y", "V_Z", "r", "depth", "distance")
    eight = Eight(planar_flow(CAMERA, PLANE, motion).coefficients, CAMERA.centre, EIGHT_COVARIANCE)
    true = min(planar_structure(eight, CAMERA, of=of), key=lambda one: abs(one.slant - PLANE.slant))
    errors = true.standard_errors
    for name in ("slant", "tilt", "time_to_contact"):
        assert got.standard_errors[name] == pytest.approx(getattr(errors, name), rel=1e-6)
        assert got.values[name] == pytest.approx(getattr(true, name), rel=1e-9)
    rotation = [got.standard_errors[f"Omega_{axis}"] for axis in "XYZ"]
    np.testing.assert_allclose(rotation, errors.rotation, rtol=1e-6)


def test_what_is_not_determined_is_infinite():
    still = sensitivity(calibrate(CAMERA, PLANE, RigidMotion(rotation=OMEGA)), SIX_COVARIANCE)
    assert still.undetermined == ("p", "q", "r", "depth", "distance", "slant", "tilt", "time_to_contact")
    assert still.values["time_to_contact"] == math.inf
    assert "undetermined" in str(still)
    facing = sensitivity(calibrate(CAMERA, Plane((0, 0, 1), 2.0), MOTIONS["camera"]), SIX_COVARIANCE)
    assert facing.undetermined == ("tilt",)
    assert math.isnan(facing.values["tilt"])
    errors = facing.standard_errors
    assert errors["slant"] == pytest.approx(math.sqrt((errors["p"] ** 2 + errors["q"] ** 2) / 2))
    sideways = sensitivity(calibrate(CAMERA, Plane((0, 0, 1), 2.0), RigidMotion((0.1, 0, 0))), SIX_COVARIANCE)
    assert sideways.undetermined == ("tilt", "time_to_contact")
    known = sensitivity(calibrate(CAMERA, PLANE, MOTIONS["camera"]), SIX_COVARIANCE, unknown=("Omega_Z",))
    assert known.standard_errors["depth"] == 0
    assert "known" in str(known)


def test_standard_errors_are_met():
    """Weighted least squares on noisy sixes scatters as predicted."""
    motion, at = MOTIONS["camera"], (400.0, 200.0)
    found = calibrate(CAMERA, PLANE, motion, at)
    predicted = sensitivity(found, SIX_COVARIANCE).standard_errors
    rng = np.random.default_rng(5)
    noisy = found.six + rng.normal(size=(400, 6)) @ SPREAD.T
    J = found.six_jacobian[:, 6:]
    W = np.linalg.inv(SIX_COVARIANCE)
    step = np.linalg.solve(J.T @ W @ J, J.T @ W @ (noisy - found.six).T)
    scatter = np.array(
        [derived(found.nine + np.concatenate([np.zeros(6), one]), at, motion) for one in step.T]
    )
    z = scatter.std(axis=0) / [
        predicted[name] for name in ("depth", "distance", "slant", "tilt", "time_to_contact")
    ]
    assert np.abs(z - 1).max() < 4 / math.sqrt(2 * 400)


def test_monotone_in_what_is_known():
    scene = calibrate(CAMERA, PLANE, MOTIONS["camera"])
    errors = [
        sensitivity(scene, SIX_COVARIANCE, unknown=some, prior=dict.fromkeys(some, 0.01)).standard_errors[
            "V_X"
        ]
        for some in (NINE[:count] for count in range(1, 10))
    ]
    assert all(less <= more * (1 + 1e-9) for less, more in itertools.pairwise(errors))


SCENE = calibrate(CAMERA, PLANE, MOTIONS["camera"])


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: calibrate(CAMERA, Plane.ground(1.0), MOTIONS["camera"]), "does not meet the optical axis"),
        (lambda: calibrate(CAMERA, PLANE, "on"), "motion='on'"),  # type: ignore[arg-type]
        (lambda: calibrate(CAMERA, PLANE, MOTIONS["camera"], at=(9000, 0)), "not seen by the camera"),
        (lambda: calibrate(CAMERA, PLANE, MOTIONS["camera"], at=3), "at=3"),  # type: ignore[arg-type]
        (lambda: eight_from_nine(np.zeros(9), 800), "nine: r=0.0 must be above 0"),
        (lambda: eight_from_nine(np.ones(8), 800), "nine of shape"),
        (lambda: eight_from_nine(np.ones(9), -1), "focal=-1"),
        (lambda: eight_jacobian(np.ones(9), 800, of="me"), "of='me'"),  # type: ignore[arg-type]
        (lambda: eight_jacobian(np.ones(9), 800, point=(1, 2)), "point="),
        (lambda: SCENE.table("nine"), "numbers='nine'"),  # type: ignore[arg-type]
        (lambda: sensitivity("scene", SIX_COVARIANCE), "calibration='scene'"),  # type: ignore[arg-type]
        (lambda: sensitivity(SCENE, np.eye(5)), "covariance of shape"),
        (lambda: sensitivity(SCENE, np.zeros((6, 6))), "covariance: must be symmetric and positive definite"),
        (lambda: sensitivity(SCENE, np.ones((6, 6))), "positive definite"),
        (lambda: sensitivity(SCENE, np.triu(np.ones((6, 6)))), "symmetric"),
        (lambda: sensitivity(SCENE, np.full((6, 6), np.nan)), "covariance: 36 of 36"),
        (
            lambda: sensitivity(SCENE, np.eye(6), unknown=("p", "depth")),
            "unknown=.*must be different names among V_X",
        ),
        (lambda: sensitivity(SCENE, np.eye(6), unknown=()), r"unknown=\(\)"),
        (lambda: sensitivity(SCENE, np.eye(6), unknown=("p", "p")), "different"),
        (
            lambda: sensitivity(SCENE, np.eye(6), prior={"V_X": 0.1}),
            "prior='V_X': must be among the unknown, p, q, r",
        ),
        (lambda: sensitivity(SCENE, np.eye(6), prior={"p": 0.0}), r"prior\['p'\]=0.0"),
    ],
)
def test_refusals(make, said):
    with pytest.raises(InputError, match=said):
        make()
