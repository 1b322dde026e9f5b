"""Windows that match, and windows that are alike by chance; texture and noise."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from scipy.stats import beta

from sixflow import measure
from sixflow.convention.flags import FAILING, FLAGS
from sixflow.judge.chance import FALSE_ALARMS, evidence_limit, normal_limit
from sixflow.judge.contradiction import gradient_variances
from sixflow.judge.match import apart, matches
from sixflow.judge.texture import is_textured, noise_power
from sixflow.maps.grid import Grid
from sixflow.prepare.frame import NO_MASK, Frame
from sixflow.refine.likeness import PARAMETERS, coarseness, evidence, evidence_of
from sixflow.refine.problem import least_texture
from sixflow.synth import Affine, Particles, Sensor, Speckle, pair
from solved import solution_of

GRID = Grid(3, 3, 8, 20, 18)
PLANE = GRID.plane(np.array([2.0, -1.0, 0.01, -0.02, 0.02, 0.01]))


def texture(sigma, seed, shape=(192, 192)):
    soft = gaussian_filter(np.random.default_rng(seed).normal(size=shape), sigma)
    return 128 + 40 * soft / soft.std()


def test_evidence_is_the_probability_of_chance():
    for cells in (40.0, 200.0):
        a, b = PARAMETERS / 2, (cells - 1 - PARAMETERS) / 2
        for logarithm in (-3.0, -9.2, -40.0):
            square = beta.isf(np.exp(logarithm), a, b)
            found = evidence(np.array(np.sqrt(square)), np.array(cells))
            # a leading term: the next is smaller by about (p/2 − 1)(1 − ρ²)/ρ²(b + 1), a third for e⁻³
            assert abs(found + logarithm) < 0.4
    assert evidence(np.array(-0.9), np.array(100.0)) == 0
    assert evidence(np.array(0.99), np.array(5.0)) == 0


def test_a_larger_rate_of_false_alarms_needs_less():
    assert evidence_limit() == pytest.approx(np.log(1 / FALSE_ALARMS))
    assert evidence_limit(50) - evidence_limit() == pytest.approx(np.log(50))


def known_of(found):
    return found.maps, gradient_variances(found.covariance)


def test_a_lone_window_has_to_prove_itself():
    lone = np.full((6, *GRID.shape), np.nan)
    lone[:, 9, 9] = 0
    for correlation, proven in ((0.4, False), (0.7, True)):
        found = solution_of(lone, correlation=np.full(GRID.shape, correlation))
        assert matches(found, *known_of(found), GRID.step)[9, 9] == proven


def test_windows_that_agree_prove_each_other():
    found = solution_of(PLANE, correlation=np.full(GRID.shape, 0.4))
    assert matches(found, *known_of(found), GRID.step).all()
    rng = np.random.default_rng(2)
    scattered = PLANE.copy()
    scattered[:2] += rng.normal(0, 3, (2, *GRID.shape))
    found = solution_of(scattered, correlation=np.full(GRID.shape, 0.2))
    assert not matches(found, *known_of(found), GRID.step).any()


def test_a_window_that_is_more_like_chance_than_like_its_neighbours_is_none_of_them():
    correlation = np.full(GRID.shape, 0.9)
    correlation[9, 9] = 0.5
    found = solution_of(PLANE, correlation=correlation)
    expected = np.ones(GRID.shape, bool)
    expected[9, 9] = False
    np.testing.assert_array_equal(matches(found, *known_of(found), GRID.step), expected)


def test_kept_pixels_alone_are_no_evidence():
    """Where outlying pixels lost their weight, those that are kept look alike."""
    shape = GRID.shape
    for kept, proven in ((0.03, False), (0.6, True)):
        statistics = solution_of(
            PLANE,
            correlation=np.full(shape, 0.989),
            residual=np.full(shape, 0.15),
            matched=np.full(shape, kept),
        ).statistics
        assert (evidence_of(statistics)[0, 0] > evidence_limit(100)) == proven


def test_apart_is_the_median_distance_of_predictions():
    maps = PLANE.copy()
    maps[0, 9, 9] += 0.3
    distance = apart(maps, np.zeros_like(maps), GRID.step, 31.0)
    assert distance[9, 9] == pytest.approx(0.09)
    distance[9, 9] = 0
    np.testing.assert_allclose(distance, 0, atol=1e-12)  # one that is off disturbs nobody


@pytest.mark.parametrize("sigma", [0.0, 1.5, 4.0])
@pytest.mark.parametrize(("window", "step"), [(15, 4), (31, 8)])
def test_unrelated_frames(sigma, window, step):
    make = (lambda seed: texture(sigma, seed)) if sigma else (lambda seed: texture(0.01, seed))
    field = measure(make(1), make(2), window=window, step=step, search="pyramid")
    assert not (field.flag.values == 0).any()


def test_unrelated_particles():
    xy = np.meshgrid(np.arange(192.0), np.arange(192.0))
    frames = [Particles(density=0.03, seed=k).image(*xy) for k in (1, 2)]
    field = measure(*frames, window=15, step=4, search="pyramid")
    assert not ((field.flag.values & FAILING) == 0).any()


def test_windows_half_of_whose_power_is_not_common_match():
    """Correlation 0.5 over some hundred cells is no chance."""
    xy = np.meshgrid(np.arange(192.0), np.arange(192.0))
    made = pair(Particles(density=0.02, seed=4), Affine.translation(1.3, -0.7), (192, 192))
    frames = [
        frame + Particles(density=0.02, seed=seed).image(*xy)
        for frame, seed in ((made.frame0, 5), (made.frame1, 6))
    ]
    field = measure(*frames, window=31, robust=False)
    assert ((field.flag.values & FAILING) == 0)[:, 2:-2, 2:-2].mean() > 0.97
    assert abs(float(field.u.median()) - 1.3) < 0.1


def test_a_blurred_frame_is_unmatched_not_without_texture():
    made = pair(Speckle(sigma=1.0, seed=5), Affine.translation(0.4, 0.2), (192, 192), sensor=Sensor(noise=2))
    field = measure(made.frame0, gaussian_filter(made.frame1, 5.0))
    failed = (field.flag.values & FAILING) != 0
    assert ((field.flag.values & FLAGS["low_texture"]) != 0).mean() < 0.05
    assert ((field.flag.values & FLAGS["unmatched"]) != 0)[failed].all()


def test_blank_frames_have_no_texture():
    frames = 100 + np.random.default_rng(6).normal(size=(2, 128, 128))
    flag = measure(*frames).flag.values
    assert ((flag & FLAGS["low_texture"]) != 0).mean() > 0.9


def test_texture_above_noise():
    """Noise alone is called texture at the rate of false alarms, texture as strong as twice the limit always."""
    assert least_texture(961.0) == pytest.approx(2 * normal_limit() / 31)
    noise = np.random.default_rng(7).normal(0, 3, (192, 192))
    grid = Grid.over(noise.shape, 8)
    assert not is_textured(Frame(noise, NO_MASK), grid, 31, np.array([3.0])).any()
    assert is_textured(Frame(texture(2.0, 8), NO_MASK), grid, 31, np.array([3.0])).all()
    assert noise_power(Frame(texture(2.0, 8) + noise, NO_MASK), 31) == pytest.approx(9, rel=0.4)


def test_a_coarse_texture_under_noise_has_fewer_cells():
    """Noise makes gradients steep, and a Gaussian of their steepness too narrow."""
    noise = np.random.default_rng(9).normal(0, 8, (2, 192, 192))
    coarse = [texture(4.0, seed) for seed in (1, 2)]
    assert coarseness(*(Frame(image, NO_MASK) for image in coarse), 8.7) < 1.5
    assert coarseness(*(Frame(image, NO_MASK) for image in coarse + noise), 8.7) > 2
