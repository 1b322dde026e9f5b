"""Which frame: the same motion about points of frame 0, of the middle, of frame 1."""

import json

import numpy as np
import pytest

import measured
from measured import measure
from sixflow import InputError, Settings, convention, measure_sequence
from sixflow.maps.grid import Grid
from sixflow.maps.placing import leaves, masked_points, placed
from sixflow.synth import Affine, Sensor, Speckle, pair, sequence

REFERENCES = ("first", "middle", "second")
STEP, WINDOW = 8, 31


def six_in(made, field, reference):
    """Exact six of an affine pair about the points of a field, in its frame."""
    return convention.change_reference(made.truth(*np.meshgrid(field.x, field.y)), "first", reference)


def random_six(count, seed=0):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(count, 6)) * [5, 5, 0.2, 0.3, 0.2, 0.2]


def test_second_is_the_inverse():
    """G' = I − (I + G)⁻¹, and the displacement of what is at the place in frame 1."""
    six = random_six(50)
    told = convention.change_reference(six, "first", "second")
    F = np.eye(2) + convention.gradient(six)
    np.testing.assert_allclose(convention.gradient(told), np.eye(2) - np.linalg.inv(F), atol=1e-12)
    np.testing.assert_allclose(told, -convention.inverse_six(six), atol=1e-12)


def test_middle_is_half_way():
    six = random_six(50)
    G = convention.gradient(convention.change_reference(six, "first", "middle"))
    one = np.eye(2)
    np.testing.assert_allclose(
        (one + G / 2) @ np.linalg.inv(one - G / 2), one + convention.gradient(six), atol=1e-11
    )


@pytest.mark.parametrize("source", REFERENCES)
@pytest.mark.parametrize("target", REFERENCES)
def test_there_and_back(source, target):
    six = random_six(20, 3)
    there = convention.change_reference(six, source, target)
    np.testing.assert_allclose(convention.change_reference(there, target, source), six, atol=1e-10)


def test_references_that_cannot_be_used():
    for names in (("third", "first"), ("first", "last")):
        with pytest.raises(InputError, match="must be one of"):
            convention.change_reference(np.zeros(6), *names)
    with pytest.raises(InputError, match=r"reference='third': must be one of"):
        Settings(reference="third")
    assert np.isnan(convention.change_reference([0, 0, 2.0, 0, 2.0, 0], "second")).all()  # folds


@pytest.mark.parametrize("share", [-1.0, -0.5, 0.5, 1.0])
def test_placed_follows_a_curved_field(share):
    """Against fixed-point iteration on the analytic field, at every grid point."""
    grid = Grid.over((120, 100), 4)
    x, y = np.meshgrid(grid.x, grid.y)

    def field(x, y):
        a, b = x / 23, y / 31
        u, v = 3 * np.sin(a) * np.cos(b), 2 * np.cos(a + b)
        slope = -2 * np.sin(a + b)
        return np.stack(
            [u, v, 3 * np.cos(a) * np.cos(b) / 23, -3 * np.sin(a) * np.sin(b) / 31, slope / 23, slope / 31]
        )

    X, Y = x.astype(float), y.astype(float)
    for _ in range(100):
        d = field(X, Y)
        X, Y = x - share * d[0], y - share * d[1]
    exact = field(X, Y)
    G = exact[2:].reshape(2, 2, *grid.shape).transpose(2, 3, 0, 1)
    exact[2:] = (G @ np.linalg.inv(np.eye(2) + share * G)).transpose(2, 3, 0, 1).reshape(4, *grid.shape)
    inside = (slice(None), slice(2, -2), slice(2, -2))  # beyond the outermost points the blend is straight
    found = placed(field(x, y), grid, share)
    np.testing.assert_allclose(found[inside], exact[inside], atol=2e-3)
    np.testing.assert_allclose(found[:2][inside], exact[:2][inside], atol=2e-4)


def test_points_that_leave_either_frame():
    grid = Grid.over((40, 40), 8)
    maps = grid.plane(np.array([10.0, 0, 0, 0, 0, 0]))
    x = np.broadcast_to(grid.x, grid.shape)
    np.testing.assert_array_equal(leaves(maps, grid, (40, 40), "first"), x > 29)
    np.testing.assert_array_equal(leaves(maps, grid, (40, 40), "middle"), (x < 5) | (x > 34))
    np.testing.assert_array_equal(leaves(maps, grid, (40, 40), "second"), x < 10)
    valid = (np.arange(40) < 20)[None] * np.ones((40, 1), np.uint8)
    np.testing.assert_array_equal(masked_points(maps, grid, valid, "second"), x - 10 >= 20)


@pytest.mark.parametrize("kind", list(measured.PATTERNS))
def test_errors_in_the_middle_are_as_large_as_predicted(kind):
    """Both frames are interpolated, which smooths the noise of both."""
    z, noise = [], 5
    for seed in range(3):
        made = measured.ideal(kind, seed)
        field = measure(*measured.noisy(made, noise, seed), reference="middle")
        error = measured.six_of(field) - six_in(made, field, "middle")
        inside = measured.complete(field)
        z.append((error / measured.standard_errors(field))[inside])
        assert np.median(field.noise.values[0][inside]) == pytest.approx(noise, rel=0.05)
    z = np.concatenate(z)
    count = measured.windows(len(z), STEP, WINDOW)
    np.testing.assert_allclose(measured.rms(z), 1, atol=4 / np.sqrt(2 * count))


@pytest.mark.parametrize("reference", REFERENCES)
@pytest.mark.parametrize("options", [{}, {"lighting": "gain+offset"}, {"method": "eigenfilter"}])
def test_every_method_measures_in_every_frame(reference, options):
    six = (2.5, -1.5, 0.05, 0.12, 0.04, -0.03)
    made = measured.ideal("speckle", 0, 160, six)
    field = measure(made.frame0, made.frame1, reference=reference, **options)
    inside = measured.depth(field) >= 40
    error = np.abs(measured.six_of(field) - six_in(made, field, reference))[inside]
    limit = 5e-3 if "method" in options else 1e-3
    assert error[:, :2].max() < limit
    assert error[:, 2:].max() < limit / 3
    assert json.loads(field.attrs["settings"])["reference"] == reference


def test_second_is_the_other_way_round():
    made = measured.ideal("speckle", 1, 128, (3.0, 1.0, 0.02, 0.03, 0.01, 0.0))
    frames = measured.noisy(made, 2)
    field, turned = measure(*frames, reference="second"), measure(*frames[::-1])
    np.testing.assert_allclose(measured.six_of(field), -measured.six_of(turned), atol=1e-4)
    np.testing.assert_allclose(field.covariance, turned.covariance, rtol=0.02, atol=1e-9)


def test_a_turning_body_seen_from_the_middle():
    """A steady rotation: seen from the middle, velocity = ω × r to second order; from frame 0 only to first."""
    angle, size = 0.12, 160
    made = pair(Speckle(), Affine.rotation(angle, (79.5, 79.5)), (size, size))
    worst = {}
    for reference in ("first", "middle"):
        field = measure(made.frame0, made.frame1, reference=reference)
        x, y = np.meshgrid(field.x - 79.5, field.y - 79.5)
        inside = measured.complete(field)
        off = np.hypot(field.u.values[0] + angle * y, field.v.values[0] - angle * x)
        worst[reference] = (off[inside] / np.hypot(x, y)[inside]).max()
    assert worst["first"] == pytest.approx(angle**2 / 2, rel=0.2)
    assert worst["middle"] == pytest.approx(angle**3 / 12, abs=1e-4)  # 2 tan(φ/2) − φ


@pytest.mark.parametrize("reference", REFERENCES)
def test_finite_measures_do_not_depend_on_the_frame(reference):
    six = np.array([2.0, -1.0, 0.1, 0.3, 0.06, -0.04])
    made = measured.ideal("speckle", 2, 160, tuple(six))
    field = measure(made.frame0, made.frame1, reference=reference).isel(x=slice(8, 12), y=slice(8, 12))
    G = convention.gradient(six)
    for name in ("green_lagrange", "almansi", "hencky", "biot", "rotation_angle", "area_ratio"):
        exact = getattr(convention, name)(G)
        np.testing.assert_allclose(field.sixflow.derive(name).values[0, 1, 1], exact, atol=1e-3, err_msg=name)
        assert np.isfinite(field.sixflow.standard_error(name)).all()
    log = convention.log_six(six)
    assert float(field.sixflow.vorticity[0, 1, 1]) == pytest.approx(log[3], abs=1e-3)
    own = convention.change_reference(six, "first", reference)
    np.testing.assert_allclose(
        field.sixflow.small_strain.values[0, 1, 1],
        convention.small_strain(convention.gradient(own)),
        atol=1e-3,
    )


def test_errors_of_finite_measures_against_chance():
    """The covariance goes through the change of frame as through any function."""
    rng = np.random.default_rng(0)
    six, spread = np.array([1.0, 2, 0.2, 0.3, -0.1, 0.1]), np.diag([0.02, 0.02, 0.01, 0.01, 0.01, 0.01]) ** 2
    value, predicted = convention.propagate(convention.change_reference, six, spread, source="middle")
    drawn = convention.change_reference(rng.multivariate_normal(six, spread, 20000), "middle")
    np.testing.assert_allclose(value, convention.change_reference(six, "middle"), rtol=1e-12)
    np.testing.assert_allclose(drawn.std(axis=0), np.sqrt(np.diag(predicted)), rtol=0.03)


@pytest.mark.parametrize(
    ("reference", "times"), [("first", [0, 1, 2]), ("middle", [0.5, 1.5, 2.5]), ("second", [1, 2, 3])]
)
def test_times(reference, times):
    frames = sequence(Speckle(), Affine.translation(0.5, 0.2), (64, 64), 4).frames
    field = measure_sequence(frames, reference=reference)
    assert field.time.values.tolist() == times
    assert measure_sequence(frames, pairs="first", reference=reference).time.values.tolist() == [1, 2, 3]


@pytest.mark.parametrize("reference", ["middle", "second"])
def test_a_mask_goes_along(reference):
    """The mask is of frame 0: points are masked where what lies there came from outside it."""
    made = pair(Speckle(), Affine.translation(12.0, 0.0), (120, 120), sensor=Sensor(noise=1))
    mask = np.zeros((120, 120), bool)
    mask[:, 30:70] = True
    field = measure(made.frame0, made.frame1, mask=mask, reference=reference, step=4)
    share = {"middle": 0.5, "second": 1.0}[reference]
    origin = field.x.values - 12 * share
    middle = field.flag.values[0][12:18]
    assert not (middle[:, (origin > 34) & (origin < 65)] & ~np.uint8(2)).any()
    np.testing.assert_allclose(field.u.values[0][12:18][:, (origin > 34) & (origin < 65)], 12, atol=0.1)
    far = (origin < 30 - 31) | (origin > 70 + 31)
    assert np.isnan(field.u.values[0][:, far]).all()
