"""Search finds the basin, passes find the fixed point: capture range, convergence, stopping."""

import numpy as np
import pytest

import measured
import naive
from sixflow import measure
from sixflow.engine.response import response as response_of
from sixflow.maps.grid import Grid
from sixflow.prepare.frame import NO_MASK, Frame
from sixflow.refine.cut import LatticeWindow
from sixflow.refine.iterate import refine, with_pixel_weights
from sixflow.refine.least_squares import LeastSquares
from sixflow.refine.problem import State
from sixflow.search.pyramid import finer, level_count, pyramid
from sixflow.synth import Affine, Sensor, Speckle, pair
from solved import passes, plan_of


def frames_of(made, dtype=np.float64):
    return [Frame((frame - 128).astype(dtype), NO_MASK) for frame in (made.frame0, made.frame1)]


def true_maps(made, grid):
    x, y = np.meshgrid(grid.x, grid.y)
    six = made.truth(x, y)
    G = made.motion.gradient(x, y)
    return np.stack([six[..., 0], six[..., 1], G[..., 0, 0], G[..., 0, 1], G[..., 1, 0], G[..., 1, 1]])


@pytest.mark.parametrize(
    ("shape", "window", "levels", "expected"),
    [
        ((256, 256), 31, None, 3),
        ((31, 900), 31, None, 0),
        ((40, 40), 31, None, 0),
        ((256, 256), 31, 5, 5),
        ((5, 5), 5, 0, 0),
    ],
)
def test_level_count(shape, window, levels, expected):
    assert level_count(shape, plan_of(shape, window=window, levels=levels)) == expected


@pytest.mark.parametrize("shape", [(64, 64), (61, 90), (33, 200)])
def test_affine_maps_go_from_level_to_level_exactly(shape):
    small = Grid.over(((shape[0] + 1) // 2, (shape[1] + 1) // 2), 8)
    large = Grid.over(shape, 7)
    plane = np.array([1.5, -0.5, 0.02, -0.01, 0.03, 0.04])
    # pixel (j, i) of the small frame is (2j, 2i) of the large one: displacements double, gradients stay
    doubled = plane * [2, 2, 1, 1, 1, 1]
    np.testing.assert_allclose(finer(small.plane(plane), small, large, 2.0), large.plane(doubled), atol=1e-10)


@pytest.mark.parametrize(
    "six",
    [
        (0, 0, 0, 0, 0, 0),
        (25.3, -18.7, 0, 0, 0, 0),
        (-60.2, 31.1, 0, 0, 0, 0),
        (0.4, 0.3, 0.16, 0, 0, 0),
        (0.4, 0.3, 0, 0.2, 0, 0),
        (0.4, 0.3, 0, 0, 0.14, 0.1),
        (6.0, -5.0, 0.05, 0.08, -0.04, 0.03),
    ],
)
def test_large_motion_is_found(six):
    made = pair(Speckle(seed=2), measured.affine(six, (256, 256)), (256, 256), sensor=Sensor(noise=2))
    field = measure(made.frame0, made.frame1)
    x, y = np.meshgrid(field.x, field.y)
    u, v = np.moveaxis(made.truth(x, y)[..., :2], -1, 0)
    stays = (
        (np.minimum(x, x + u) > 16)
        & (np.maximum(x, x + u) < 239)
        & (np.minimum(y, y + v) > 16)
        & (np.maximum(y, y + v) < 239)
    )
    assert measured.failed(field)[stays].mean() < 0.01
    kept = stays & ~measured.failed(field)
    z = (measured.errors(field, made) / measured.standard_errors(field))[kept]
    assert np.abs(z).max() < 7


def test_the_start_is_within_reach():
    made = pair(Speckle(seed=2), Affine.rotation(0.08, (127, 127)), (256, 256))
    grid = Grid.over((256, 256), 8)
    reference, moved = frames_of(made)
    start = pyramid(reference, moved, grid, plan_of((256, 256)))
    assert start.shape == (6, *grid.shape)
    assert np.isfinite(start).all()
    error = np.hypot(*(start - true_maps(made, grid))[:2])
    assert np.quantile(error, 0.95) < 1.5


def test_search_of_nothing_is_no_motion():
    flat = Frame(np.zeros((128, 128), np.float32), NO_MASK)
    grid = Grid.over((128, 128), 8)
    np.testing.assert_array_equal(pyramid(flat, flat, grid, plan_of((128, 128))), 0)


@pytest.mark.parametrize("levels", [0, 1, 4, 8, 12])
def test_the_number_of_levels_changes_nothing_for_small_motion(levels):
    frames = measured.noisy(measured.ideal("speckle", 0, 128), 2)
    usual, other = measure(*frames), measure(*frames, levels=levels)
    inside = measured.complete(usual) & measured.complete(other)
    assert inside.sum() > 0.9 * measured.complete(usual).sum()
    difference = (measured.six_of(usual) - measured.six_of(other))[inside]
    assert np.abs(difference / measured.standard_errors(usual)[inside]).max() < 0.3


class TestPasses:
    @staticmethod
    def problem(made, **options):
        grid = Grid.over(made.frame0.shape, 8)
        return LeastSquares(*frames_of(made), grid, plan_of(made.frame0.shape, **options)), grid

    @pytest.mark.parametrize("noise", [0, 3])
    def test_the_fixed_point_does_not_depend_on_the_start(self, noise):
        made = measured.ideal("speckle", 1, 128)
        made = pair(made.pattern, made.motion, (128, 128), sensor=Sensor(noise=noise))
        problem, grid = self.problem(made)
        rng = np.random.default_rng(1)
        ends = []
        for _ in range(2):
            # redundant directions as well: values and slopes of neighbours that contradict each other
            maps = (
                true_maps(made, grid)
                + rng.normal(0, 0.2, (6, 1, 1)) * np.array([1, 1, 0.03, 0.03, 0.03, 0.03])[:, None, None]
            )
            maps[2:] += rng.normal(0, 0.01, maps[2:].shape)
            ends.append(passes(problem, maps, 25))
        np.testing.assert_allclose(ends[0][:2], ends[1][:2], atol=1e-7)
        np.testing.assert_allclose(ends[0][2:], ends[1][2:], atol=1e-8)

    def test_truth_is_the_fixed_point_without_noise(self):
        made = measured.ideal("speckle", 1, 160)
        problem, grid = self.problem(made)
        truth = true_maps(made, grid)
        step = passes(problem, truth, 1) - truth
        deep = np.minimum.outer(np.minimum(grid.y, 159 - grid.y), np.minimum(grid.x, 159 - grid.x)) >= 48
        assert np.abs(step[:2][:, deep]).max() < 1e-4
        assert np.abs(step[2:][:, deep]).max() < 1e-5

    def test_an_increment_pass_at_the_truth_changes_nothing(self):
        made = measured.ideal("speckle", 1, 160)
        problem, grid = self.problem(made)
        truth = true_maps(made, grid)
        step = passes(problem, truth, 1, total=False) - truth
        deep = np.minimum.outer(np.minimum(grid.y, 159 - grid.y), np.minimum(grid.x, 159 - grid.x)) >= 48
        assert np.abs(step[:2][:, deep]).max() < 1e-4

    def test_refine_ends_at_the_fixed_point(self):
        made = measured.ideal("texture", 1, 128)
        made = pair(made.pattern, made.motion, (128, 128), sensor=Sensor(noise=2))
        problem, grid = self.problem(made, tolerance=1e-3, passes=20)
        found = refine(problem, np.zeros((6, *grid.shape)))
        exact = passes(problem, found.maps, 20)
        distance = np.hypot(*(found.maps - exact)[:2])
        assert np.quantile(distance, 0.95) < 1e-3
        assert np.median(found.left) < 1e-3
        assert np.isfinite(found.covariance).all()

    def test_more_passes_do_not_raise_the_noise(self):
        made = pair(
            Speckle(seed=1), measured.affine(measured.SMALL, (192, 192)), (192, 192), sensor=Sensor(noise=4)
        )
        problem, grid = self.problem(made)
        truth = true_maps(made, grid)
        maps, spreads = truth, []
        for count in (4, 20):
            maps = passes(problem, maps, count)
            spreads.append(np.sqrt(((maps - truth) ** 2)[:, 3:-3, 3:-3].mean(axis=(1, 2))))
        np.testing.assert_allclose(spreads[1], spreads[0], rtol=0.02)


def test_a_pass_is_a_function_of_what_it_is_given():
    """Asked twice, and after other questions, it gives the same to the last bit, and changes nothing."""
    frames = measured.noisy(measured.ideal("speckle", 0, 128), 2)
    frames[1][40:44, 50:54] += 90
    frames = [Frame(frame.astype(np.float32) - 128, NO_MASK) for frame in frames]
    grid = Grid.over((128, 128), 8)
    for lighting in ("none", "gain+offset"):
        problem = LeastSquares(*frames, grid, plan_of((128, 128), lighting=lighting))
        start, state = np.zeros((6, *grid.shape)), State()
        first = problem.step(start, state, last=True)
        solution = problem.solution(first, first.maps, first.left)
        other = problem.step(first.maps, with_pixel_weights(problem.plan, first) or first.state, last=True)
        problem.solution(other, other.maps, other.left)
        again = problem.step(start, state, last=True)
        np.testing.assert_array_equal(first.maps, again.maps)
        for made in (
            problem.solution(first, first.maps, first.left),
            problem.solution(again, again.maps, again.left),
        ):
            np.testing.assert_array_equal(made.covariance, solution.covariance)
            np.testing.assert_array_equal(made.statistics.noise, solution.statistics.noise)
        assert not start.any()


def lattice_fit(u, counted, sigma, x, y):
    """(value, x-slope, y-slope) of the weighted affine fit of a dense displacement at one point."""
    w, X, Y = naive.window(sigma, u.shape, x, y)
    root = np.sqrt(w * counted).ravel()
    columns = np.stack([np.ones(u.size), sigma * X.ravel(), sigma * Y.ravel()], axis=1)
    return np.linalg.lstsq(columns * root[:, None], root * u.ravel(), rcond=None)[0]


def test_uniform_window_is_the_affine_fit_of_the_blend():
    grid, sigma = Grid.over((40, 50), 1), 1.9  # so that lattice and nodes are the pixels
    counted = np.random.default_rng(1).random((40, 50)) > 0.2
    counted[:, 37:] = False
    maps = np.random.default_rng(2).normal(size=(6, *grid.shape))
    fitted = LatticeWindow(grid, sigma, counted).fit(maps)
    dense = naive.blend(maps, grid.origin_and_step, (40, 50))
    for x, y in [(0, 0), (20, 20), (39, 10), (49, 39), (41, 20)]:
        for k in range(2):
            exact = lattice_fit(dense[k], counted, sigma, x, y)
            place = [k, 2 + 2 * k, 3 + 2 * k]
            if x == 49:  # nothing of the window is left
                exact = maps[place, y, x]
            np.testing.assert_allclose(fitted[place, y, x], exact, atol=1e-9)


@pytest.mark.parametrize("period", [30, 60, 120])
@pytest.mark.parametrize("sharpen", [0, 1, 4])
def test_uniform_window_answers_waves_by_theory(period, sharpen):
    grid, sigma = Grid.over((61, 400), 4), 8.7
    k = 2 * np.pi / period
    x = np.broadcast_to(grid.x, grid.shape).astype(float)
    zero = np.zeros(grid.shape)
    maps = np.stack([np.cos(k * x), zero, -k * np.sin(k * x), zero, zero, zero])
    window = LatticeWindow(grid, sigma, np.ones((61, 400), bool))
    M = np.exp(-((k * sigma) ** 2) / 2)
    answered = window.deconvolve(window.fit(maps), sharpen)[..., 30:-30]
    # where the borders, which reach further in with every fit, are far; cutting the window at 3.5 σ leaves 0.002
    response = response_of(M, sharpen)
    for plane in (0, 2):
        wave = maps[plane][..., 30:-30]
        seen = (answered[plane] * wave).sum() / (wave**2).sum()
        assert seen == pytest.approx(response, abs=5e-3 * (sharpen + 1))
    assert np.abs(answered[1]).max() < 1e-9
