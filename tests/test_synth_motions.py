"""Motions: exact gradients, inverses, groups, and the mechanics that each stands for."""

import math

import numpy as np
import pytest

from sixflow.errors import InputError
from sixflow.synth import (
    Affine,
    BoundaryLayer,
    CellularVortices,
    LambOseen,
    Motion,
    PlateWithHole,
    ScaledMotion,
    Star,
    relative,
)

GROUPS = {
    "translation": Affine.translation(0.3, -4.0),
    "six": Affine.from_six((0.3, -0.2, 0.05, -0.1, 0.02, 0.07), centre=(20.0, 30.0)),
    "rotation": Affine.rotation(2.0, centre=(5.0, 5.0)),
    "shifted rotation": Affine((3.0, 1.0), Affine.rotation(0.4).G, (50.0, 0.0)),
    "zoom": Affine.zoom(1.7, centre=(-10.0, 0.0)),
    "pure shear": Affine.pure_shear(1.2, 0.3),
    "simple shear": Affine((1.0, 2.0), Affine.simple_shear(0.4, 1.0).G),
    "tiny": Affine.from_six((0.1, 0.2, 1e-9, -2e-9, 1e-10, 0.0)),
    "lamb-oseen": LambOseen(angle=2.5, core=20.0, centre=(40.0, 30.0)),
    "boundary layer": BoundaryLayer(speed=3.0, thickness=12.0, wall=60.0),
}
OTHERS = {
    "vortices": CellularVortices(amplitude=3.0, period=50.0, centre=(3.0, 4.0)),
    "star": Star(amplitude=0.5, periods=(10.0, 60.0), columns=(0.0, 90.0), row=45.0),
    "plate": PlateWithHole(strain=0.02, radius=15.0, centre=(40.0, 45.0), angle=0.5),
    "scaled": ScaledMotion(CellularVortices(amplitude=3.0, period=50.0), 0.3),
    "relative": relative(CellularVortices(amplitude=3.0, period=50.0), Affine.rotation(0.3)),
}
MOTIONS = GROUPS | OTHERS


def by_name(motions):
    return pytest.mark.parametrize("motion", motions.values(), ids=motions.keys())


def anywhere(count=300, seed=0):
    return np.random.default_rng(seed).uniform(-5, 100, (2, count))


@by_name(MOTIONS)
def test_gradient_is_the_derivative(motion):
    x, y = anywhere()
    h = 1e-4
    by_x = (np.array(motion.displacement(x + h, y)) - motion.displacement(x - h, y)) / (2 * h)
    by_y = (np.array(motion.displacement(x, y + h)) - motion.displacement(x, y - h)) / (2 * h)
    G = motion.gradient(x, y)
    assert G.shape == (300, 2, 2)
    np.testing.assert_allclose(G[..., 0], by_x.T, atol=1e-7)
    np.testing.assert_allclose(G[..., 1], by_y.T, atol=1e-7)


@by_name(MOTIONS)
def test_six_are_made_of_displacement_and_gradient(motion):
    x, y = anywhere()
    u, v, divergence, curl, stretch, shear = np.moveaxis(motion.six(x, y), -1, 0)
    G = motion.gradient(x, y)
    np.testing.assert_array_equal([u, v], motion.displacement(x, y))
    np.testing.assert_allclose(divergence + stretch, 2 * G[:, 0, 0], atol=1e-14)
    np.testing.assert_allclose(shear - curl, 2 * G[:, 0, 1], atol=1e-14)
    np.testing.assert_allclose(shear + curl, 2 * G[:, 1, 0], atol=1e-14)
    np.testing.assert_allclose(divergence - stretch, 2 * G[:, 1, 1], atol=1e-14)


@by_name(MOTIONS)
def test_inverse_to_a_nanopixel(motion):
    x, y = anywhere()
    np.testing.assert_allclose(motion.forward(*motion.inverse(x, y)), (x, y), rtol=0, atol=1e-9)
    np.testing.assert_allclose(motion.inverse(*motion.forward(x, y)), (x, y), rtol=0, atol=1e-8)


@by_name(MOTIONS)
def test_any_shape(motion):
    assert motion.gradient(3.0, 4.0).shape == (2, 2)
    assert motion.six(np.zeros((2, 1)), np.zeros(3)).shape == (2, 3, 6)
    assert motion.six(np.zeros(0), np.zeros(0)).shape == (0, 6)
    assert motion.inverse(np.zeros(0), np.zeros(0))[0].shape == (0,)
    assert motion.inverse(1, 2)[0].shape == ()


@by_name(MOTIONS)
def test_time_starts_at_rest_and_passes_the_motion(motion):
    x, y = anywhere()
    np.testing.assert_allclose(motion.at(0).displacement(x, y), np.zeros((2, 300)), atol=1e-13)
    np.testing.assert_array_equal(motion.at(1).six(x, y), motion.six(x, y))


@by_name(GROUPS)
@pytest.mark.parametrize(("s", "t"), [(0.3, 0.7), (1.0, 1.0), (-0.6, 1.1), (2.0, -2.0)])
def test_group(motion, s, t):
    x, y = anywhere()
    two_steps = motion.at(s).forward(*motion.at(t).forward(x, y))
    np.testing.assert_allclose(two_steps, motion.at(s + t).forward(x, y), atol=1e-10)


@by_name(OTHERS)
def test_straight_course(motion):
    x, y = anywhere()
    np.testing.assert_allclose(motion.at(0.25).six(x, y), motion.six(x, y) / 4, atol=1e-13)
    np.testing.assert_allclose(motion.at(0.5).at(0.5).six(x, y), motion.six(x, y) / 4, atol=1e-13)


@pytest.mark.parametrize("angle", [0.1, math.pi / 2, 3.0, math.pi])
def test_at_turns_a_rotation_by_a_fraction(angle):
    motion = Affine.rotation(angle, centre=(7.0, 8.0)).at(0.3)
    np.testing.assert_allclose(motion.G, Affine.rotation(0.3 * angle).G, atol=1e-14)
    np.testing.assert_allclose(motion.displacement(7.0, 8.0), 0, atol=1e-13)


def test_affine_logarithm_near_the_parabolic_case():
    for eps in (0.0, 1e-20, 1e-14, 1e-9, -1e-9, 1e-5):
        motion = Affine(shift=(1.0, -1.0), G=((0.0, 0.5), (eps, 0.0)))
        M = np.array(motion.at(0.5).G) + np.eye(2)
        np.testing.assert_allclose(M @ M, np.array(motion.G) + np.eye(2), atol=1e-14)


def test_six_of_the_affine_constructors():
    six = (0.3, -0.2, 0.05, -0.1, 0.02, 0.07)
    np.testing.assert_allclose(Affine.from_six(six, centre=(3, 4)).six(3, 4), six, atol=1e-15)
    np.testing.assert_allclose(Affine.rotation(0.01).six(0, 0)[2:], [-1e-4, 0.02, 0, 0], atol=1e-6)
    np.testing.assert_allclose(Affine.zoom(1.1).six(0, 0)[2:], [0.2, 0, 0, 0], atol=1e-15)
    np.testing.assert_allclose(Affine.simple_shear(0.1).six(0, 0)[2:], [0, -0.1, 0, 0.1], atol=1e-15)
    turned = Affine.pure_shear(1.1, math.pi / 4)
    assert np.linalg.det(np.eye(2) + np.array(turned.G)) == pytest.approx(1)
    np.testing.assert_allclose(turned.forward(1.0, 1.0), (1.1, 1.1))


def test_affine_takes_arrays_and_can_be_compared():
    one = Affine(np.array([1, 2]), np.zeros((2, 2)), [0, 0])
    assert one == Affine.translation(1.0, 2.0)
    assert hash(one) == hash(Affine.translation(1.0, 2.0))


def test_positive_rotation_is_clockwise_on_the_screen():
    # a point to the right moves down
    assert Affine.rotation(0.1).displacement(10.0, 0.0)[1] > 0
    assert LambOseen(angle=0.1, core=5.0).displacement(3.0, 0.0)[1] > 0


def test_lamb_oseen_keeps_areas_and_radii():
    x, y = anywhere()
    motion = GROUPS["lamb-oseen"]
    np.testing.assert_allclose(np.linalg.det(np.eye(2) + motion.gradient(x, y)), 1, atol=1e-12)
    X, Y = motion.forward(x, y)
    np.testing.assert_allclose(np.hypot(X - 40, Y - 30), np.hypot(x - 40, y - 30), atol=1e-12)
    near = motion.gradient([40.0, 40.0 + 1e-9], 30.0)
    np.testing.assert_allclose(near[0], near[1], atol=1e-8)
    np.testing.assert_allclose(near[0], Affine.rotation(2.5).G, atol=1e-14)


def test_vortices_are_free_of_divergence():
    assert np.abs(OTHERS["vortices"].six(*anywhere())[:, 2]).max() < 1e-14


def test_the_star_on_its_row():
    motion = OTHERS["star"]
    np.testing.assert_array_equal(motion.displacement([-20.0, 0.0, 50.0, 200.0], 45.0)[1], 0.5)
    np.testing.assert_allclose(motion.period([-20.0, 0.0, 45.0, 90.0, 200.0]), [10, 10, 35, 60, 60])
    backwards = Star(amplitude=0.5, periods=(60.0, 10.0), columns=(90.0, 0.0), row=45.0)
    np.testing.assert_allclose(backwards.six(*anywhere()), motion.six(*anywhere()), atol=1e-13)


def test_boundary_layer_sticks_to_the_wall():
    motion = GROUPS["boundary layer"]
    np.testing.assert_allclose(motion.displacement(0.0, [60.0, 70.0, -1000.0])[0], [0, 0, 3.0])
    assert motion.mask(0.0, [59.0, 60.0, 61.0]).tolist() == [True, True, False]


def stress(motion, x, y, poisson):
    """Plane stress divided by Young's modulus: xx, yy, xy."""
    G = motion.gradient(x, y)
    xx, yy, xy = G[..., 0, 0], G[..., 1, 1], (G[..., 0, 1] + G[..., 1, 0]) / 2
    size = 1 / (1 - poisson**2)
    return size * (xx + poisson * yy), size * (yy + poisson * xx), xy / (1 + poisson)


@pytest.mark.parametrize("poisson", [0.0, 0.3, 0.5])
@pytest.mark.parametrize("angle", [0.0, 0.7])
def test_plate_with_hole_is_in_equilibrium(poisson, angle):
    motion = PlateWithHole(strain=0.01, radius=15.0, poisson=poisson, angle=angle)
    t = np.linspace(0, 2 * np.pi, 50)
    # no traction at the edge
    edge = 15.0 * (1 + 1e-12)
    xx, yy, xy = stress(motion, edge * np.cos(t), edge * np.sin(t), poisson)
    np.testing.assert_allclose(xx * np.cos(t) + xy * np.sin(t), 0, atol=1e-12)
    np.testing.assert_allclose(xy * np.cos(t) + yy * np.sin(t), 0, atol=1e-12)
    # hoop stress of Kirsch: S (1 − 2 cos 2(θ − angle))
    np.testing.assert_allclose(xx + yy, 0.01 * (1 - 2 * np.cos(2 * (t - angle))), atol=1e-12)
    # divergence of the stress
    x, y = 22 * np.cos(t), 25 * np.sin(t)
    h = 1e-4
    by_x = (np.array(stress(motion, x + h, y, poisson)) - stress(motion, x - h, y, poisson)) / (2 * h)
    by_y = (np.array(stress(motion, x, y + h, poisson)) - stress(motion, x, y - h, poisson)) / (2 * h)
    np.testing.assert_allclose(by_x[0] + by_y[2], 0, atol=1e-9)
    np.testing.assert_allclose(by_x[2] + by_y[1], 0, atol=1e-9)
    # uniform tension far away
    far = motion.gradient(1e7 * np.cos(angle), 1e7 * np.sin(angle))
    n = np.array([np.cos(angle), np.sin(angle)])
    assert n @ far @ n == pytest.approx(0.01, rel=1e-6)


def test_plate_with_hole_continues_inside_the_hole():
    motion = PlateWithHole(strain=0.01, radius=15.0, angle=0.7)
    t = np.linspace(0, 2 * np.pi, 40)
    edge = np.array(motion.displacement(15 * (1 + 1e-13) * np.cos(t), 15 * (1 + 1e-13) * np.sin(t)))
    for r in (0.0, 5.0, 14.9999):
        inner = motion.displacement(r * np.cos(t), r * np.sin(t))
        np.testing.assert_allclose(inner, r / 15 * edge, atol=1e-13)
    assert motion.mask([0.0, 14.99, 15.0], 0.0).tolist() == [False, False, True]


def test_relative_is_the_way_from_frame_to_frame():
    start, end = OTHERS["vortices"].at(0.5), GROUPS["lamb-oseen"]
    X, Y = anywhere()
    x, y = start.forward(X, Y)
    step = relative(start, end)
    np.testing.assert_allclose(step.forward(x, y), end.forward(X, Y), atol=1e-9)
    F = (np.eye(2) + end.gradient(X, Y)) @ np.linalg.inv(np.eye(2) + start.gradient(X, Y))
    np.testing.assert_allclose(np.eye(2) + step.gradient(x, y), F, atol=1e-9)
    group = GROUPS["six"]
    np.testing.assert_allclose(relative(group.at(2), group.at(3)).six(x, y), group.six(x, y), atol=1e-11)


@pytest.mark.parametrize(
    "motion",
    [
        CellularVortices(amplitude=10.0, period=50.0),
        Star(amplitude=2.0, periods=(10.0, 60.0), columns=(0.0, 90.0), row=45.0),
        ScaledMotion(Affine(G=((-0.5, 0.0), (0.0, 0.0))), 3.0),
    ],
    ids=["vortices", "star", "scaled"],
)
def test_folding_motions_are_refused(motion):
    x, y = np.meshgrid(np.arange(80.0), np.arange(80.0))
    with pytest.raises(InputError, match=r"folds.*smaller"):
        motion.inverse(x, y)


def test_a_tearing_motion_is_refused():
    class Torn(Motion):
        """Jumps by 1 px at x = 0: nothing arrives in between."""

        def _displacement(self, x, y):
            return np.where(x > 0, 1.0, 0.0), 0.0

        def _gradient(self, x, y):
            return 0.0, 0.0, 0.0, 0.0

    with pytest.raises(InputError, match="no origin found for 1 points"):
        Torn().inverse([0.5, 5.0], [0.0, 0.0])


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (lambda: Affine(shift=(1.0,)), "shift="),
        (lambda: Affine(shift=(1.0, np.nan)), r"shift\[1\]=nan"),
        (lambda: Affine(G=((1, 2, 3),)), "G="),
        (lambda: Affine(G=((1, 2), (3,))), "G="),
        (lambda: Affine(G="zoom"), "G='zoom'"),
        (lambda: Affine(G=((-2, 0), (0, 0))), "G=.*folds or flips"),
        (lambda: Affine(centre=3.0), "centre=3.0"),
        (lambda: Affine.from_six((1, 2, 3)), "six="),
        (lambda: Affine.zoom(0), "factor=0"),
        (lambda: Affine.rotation("90"), "angle='90'"),
        (lambda: Affine.rotation(0.1).at(np.inf), "s=inf"),
        (lambda: CellularVortices(1.0, 0.0), "period=0.0"),
        (lambda: CellularVortices(1.0, 10.0).at(None), "s=None"),
        (lambda: LambOseen(0.1, -3), "core=-3"),
        (lambda: BoundaryLayer(1.0, 0, 5), "thickness=0"),
        (lambda: Star(0.5, (10.0, -3.0), (0, 9), 4), r"periods\[1\]=-3.0"),
        (lambda: Star(0.5, (10.0, 30.0), (9, 9), 4), "columns="),
        (lambda: PlateWithHole(0.1, 0), "radius=0"),
        (lambda: PlateWithHole(0.1, 10, poisson=0.6), "poisson=0.6"),
        (lambda: ScaledMotion("still", 1.0), "motion='still'"),
        (lambda: relative(Affine(), None), "end=None"),
    ],
)
def test_a_bad_parameter_is_named(make, name):
    with pytest.raises(InputError, match=f"{name}.*must"):
        make()


def test_a_map_without_a_real_logarithm_has_no_fractions():
    motion = Affine(G=((-3.0, 0.0), (0.0, -2.5)))
    assert motion.at(1) is motion
    with pytest.raises(InputError, match="no steady motion"):
        motion.at(0.5)
    with pytest.raises(InputError, match="G="):
        Affine.zoom(2.0).at(1e5)
