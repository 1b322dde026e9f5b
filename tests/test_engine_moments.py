"""Node moments and windows against direct sums over every pixel."""

import dataclasses

import numpy as np
import pytest

import naive
from sixflow.engine import threads
from sixflow.engine.moments import plane_at
from sixflow.engine.sweep import NORMAL_RANKS, Images
from sixflow.errors import InputError
from sixflow.maps.grid import Grid
from sixflow.prepare.frame import NO_MASK, Frame
from sixflow.refine.moments import Lattice, Moments, node_spacing
from sixflow.refine.sweep import Sweep
from sixflow.refine.windows import image_sums, motion_sums, squared_window_sums, window_means, window_sums

DTYPES = [np.float32, np.float64]
# steps that divide nothing, windows wider than the frame, steps wider than the nodes, nodes on every pixel
CASES = [((33, 47), 5, 3.3), ((20, 31), 8, 6.0), ((31, 20), 1, 1.5), ((14, 90), 16, 2.7), ((9, 9), 40, 8.0)]
ORDERS = [2, 2, 2, 1, 1]


def images(shape, dtype, seed=1):
    """Random images of a sweep, of which a tenth of the pixels have no partner."""
    gx, gy, q, r, still, warped = np.random.default_rng(seed).normal(size=(6, *shape))
    lost = np.random.default_rng(seed + 1).random(shape) < 0.1
    gx[lost] = gy[lost] = q[lost] = 0
    r[lost] = warped[lost] = np.nan
    return Images(*(image.astype(dtype) for image in (gx, gy, q, r, still, warped)))


def products(seen):
    """Products of the normal equations, statistics and sandwich, in double precision."""
    gx, gy, q, r, still, warped = (image.astype(float) for image in seen)
    known = np.isfinite(r)
    size, i0, i1 = (np.where(known, image, 0) for image in (np.abs(r), still, warped))
    normal = [gx * gx, gx * gy, gy * gy, gx * q, gy * q]
    statistics = [1.0 * known, size, size**2, i0, i0**2, i1, i1**2, i0 * i1]
    return normal, statistics, [size**2 * p for p in normal[:3]]


def sweep(shape, grid, sigma, dtype):
    blank = Frame(np.zeros(shape, dtype), NO_MASK)
    return Sweep(blank, blank, grid, sigma, degree=3)


def rounding(terms, dtype, largest=1.0):
    """What single or double precision leaves of a sum of so many terms of a size."""
    return 16 * np.finfo(dtype).eps * largest * max(np.abs(term).max() for term in terms)


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize(("shape", "step", "sigma"), CASES)
def test_node_moments(dtype, shape, step, sigma):
    grid, seen = Grid.over(shape, step), images(shape, dtype)
    found = sweep(shape, grid, sigma, dtype).moments_of(seen, sandwich=True)
    lattice = found.lattice
    assert lattice.spacing == node_spacing(sigma)
    assert (grid.x0 - lattice.x0) % lattice.spacing == (grid.y0 - lattice.y0) % lattice.spacing == 0
    for planes, terms, orders, ranks in zip(
        (found.normal, found.statistics, found.sandwich), products(seen), (ORDERS, [0] * 8, [2] * 3),
        (NORMAL_RANKS, (0, 0, 8), (3, 0, 0)), strict=True,
    ):  # fmt: skip
        assert planes.dtype == dtype
        for k, (term, order) in enumerate(zip(terms, orders, strict=True)):
            exact = naive.node_moments(term, order, lattice)
            member = k - sum(ranks[: 2 - order])
            powers = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)]
            for at, (a, c) in enumerate(powers[: exact.shape[-1]]):
                plane = planes[:, plane_at(ranks, order, a, c) + member]
                tolerance = rounding([term], dtype, lattice.spacing**2)
                np.testing.assert_allclose(plane, exact[..., at], atol=tolerance, rtol=0)


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize(("shape", "step", "sigma"), CASES)
def test_windows(dtype, shape, step, sigma):
    grid, seen = Grid.over(shape, step), images(shape, dtype)
    moments = sweep(shape, grid, sigma, dtype).moments_of(seen, sandwich=True)
    sums = window_sums(moments, grid, sigma)
    normal, statistics, sandwich = products(seen)
    for fast, terms, orders, power in (
        (sums.normal, normal, ORDERS, 1),
        (sums.statistics, statistics, [0] * 8, 1),
        (sums.sandwich, sandwich, [2] * 3, 2),
        (squared_window_sums(moments, grid, sigma), normal, ORDERS, 2),
    ):
        exact = naive.node_windows(terms, orders, moments.lattice, sigma, grid, power)
        np.testing.assert_allclose(fast, exact, atol=rounding(terms, dtype, 13), rtol=0)


@pytest.mark.parametrize(("step", "sigma"), [(3, 9.0), (7, 2.5), (8, 8.7)])
def test_windows_of_a_coarser_lattice(step, sigma):
    """Merged moments are those of hats of twice the width, and serve a window of twice the size."""
    shape = (41, 50)
    grid, seen = Grid.over(shape, step), images(shape, np.float64)
    fine = sweep(shape, grid, sigma, np.float64).moments_of(seen, sandwich=True)
    coarse = fine.coarser()
    assert coarse.lattice.spacing == 2 * fine.lattice.spacing
    for name, orders, terms in zip(
        ("normal", "statistics", "sandwich"), (ORDERS, [0] * 8, [2] * 3), products(seen), strict=True
    ):
        exact = naive.node_windows(
            terms, orders, coarse.lattice, 2 * sigma, grid, 2 if name == "sandwich" else 1
        )
        fast = getattr(window_sums(coarse, grid, 2 * sigma), name)
        np.testing.assert_allclose(fast, exact, atol=rounding(terms, np.float64, 13), rtol=0)


def test_merging_is_exact():
    """In whole numbers, to the last bit."""
    shape, grid = (37, 44), Grid.over((37, 44), 8)
    whole = np.random.default_rng(4).integers(-9, 9, (6, *shape)).astype(float)
    coarse = sweep(shape, grid, 4.0, np.float64).moments_of(Images(*whole), sandwich=True).coarser()
    lattice = coarse.lattice
    for k, term in enumerate(products(Images(*whole))[0]):
        exact = naive.node_moments(term, ORDERS[k], lattice)
        first = coarse.normal[:, plane_at(NORMAL_RANKS, ORDERS[k], 0, 0) + k % 3]
        np.testing.assert_array_equal(first, exact[..., 0])


def difference(sigma, spacing, phase=0, power=1):
    """Root mean square of what the plane window made of nodes lacks of the Gaussian, over that of the Gaussian."""
    width, x = sigma / np.sqrt(power), np.arange(-100, 101)
    gauss = np.exp(-(x**2) / (2 * width**2)) / np.sqrt(2 * np.pi) / width
    gauss *= (2 * np.sqrt(np.pi) * sigma) ** (1 - power)
    made = naive.hat_weights(sigma, x.size, -phase, spacing, 100, power)
    assert made.sum() == pytest.approx(gauss.sum(), rel=3e-3)
    assert (made * x**2).sum() == pytest.approx(width**2 * gauss.sum(), rel=3e-2)
    return np.sqrt(((np.outer(made, made) - np.outer(gauss, gauss)) ** 2).sum()) / (gauss**2).sum()


@pytest.mark.parametrize("sigma", [2.0, 2.8, 4.0, 7.9, 8.0, 8.74, 17.5])
def test_effective_window(sigma):
    """Linear interpolation misses ½ t(1 − t) b² G'' less its mean: at most 0.054 q of the Gaussian along each axis,
    q = (b/σ)², and terms of order q².

    (G'' has √¾/σ² of the Gaussian's norm; t(1 − t) differs from its mean by ⅛ for b = 2, by less for more pixels.)
    """
    b = node_spacing(sigma)
    for power in (1, 2):
        q = power * (b / sigma) ** 2
        for phase in (0, b // 2):
            assert difference(sigma, b, phase, power) < np.sqrt(2) * (0.054 * q + 0.01 * q * q)
    if b >= 8:  # of second order in b
        assert difference(sigma, b // 2) / difference(sigma, b) == pytest.approx(1 / 4, abs=0.05)


@pytest.mark.parametrize("cut", [1, 8, 13, 36])
def test_halves_of_a_frame_add_to_the_whole(cut):
    made, maps = pair((37, 50), 8, 5.0)
    whole = made.moments(maps, sandwich=True)
    halves = made.moments(maps, sandwich=True, rows=(0, cut)) + made.moments(
        maps, sandwich=True, rows=(cut, 37)
    )
    for name in ("normal", "statistics", "sandwich"):
        total, sum_of_two = getattr(whole, name), getattr(halves, name)
        np.testing.assert_allclose(sum_of_two, total, atol=1e-5 * np.abs(total).max(), rtol=0)


def test_two_pairs_add():
    grid = Grid.over((33, 47), 8)
    one, two = images((33, 47), np.float64, 1), images((33, 47), np.float64, 3)
    made = sweep((33, 47), grid, 5.0, np.float64)
    total = made.moments_of(one) + made.moments_of(two)
    assert total.sandwich is None
    terms = [a + b for a, b in zip(products(one)[0], products(two)[0], strict=True)]
    exact = naive.node_windows(terms, ORDERS, total.lattice, 5.0, grid)
    fast = window_sums(total, grid, 5.0).normal
    np.testing.assert_allclose(fast, exact, atol=rounding(terms, np.float64, 13), rtol=0)


def test_what_cannot_be_added():
    grid = Grid.over((33, 47), 8)
    seen = images((33, 47), np.float64)
    made = sweep((33, 47), grid, 5.0, np.float64)
    with pytest.raises(InputError, match="use one grid"):
        made.moments_of(seen) + sweep((33, 47), grid, 2.0, np.float64).moments_of(seen)
    with pytest.raises(InputError, match="sandwich"):
        made.moments_of(seen) + made.moments_of(seen, sandwich=True)
    with pytest.raises(TypeError):
        made.moments_of(seen) + 1


def test_transposing():
    """x and y are treated alike; sums are in another order, so to within rounding."""
    grid, seen = Grid.over((44, 31), 8), images((44, 31), np.float64)
    turned = Images(
        seen.gradient_y.T.copy(), seen.gradient_x.T.copy(), seen.right.T.copy(), seen.residual.T.copy(),
        seen.still.T.copy(), seen.warped.T.copy(),
    )  # fmt: skip
    other = Grid.over((31, 44), 8)
    one = window_sums(sweep((44, 31), grid, 5.0, np.float64).moments_of(seen), grid, 5.0).normal
    two = window_sums(sweep((31, 44), other, 5.0, np.float64).moments_of(turned), other, 5.0).normal
    swapped = [0, 2, 1, 5, 4, 3]
    order = [12 + k for k in swapped] + [6 + k for k in swapped] + swapped + [21, 23, 22, 18, 20, 19]
    np.testing.assert_allclose(np.swapaxes(two, 0, 1)[..., order], one, atol=1e-13)


def test_weights():
    """√ω on gradient, right-hand side and residual; a pixel of next to no weight has no partner."""
    shape, grid = (33, 47), Grid.over((33, 47), 8)
    seen, weight = images(shape, np.float64), np.random.default_rng(5).random(shape)
    weight[weight > 0.8] = 1
    kept = [image.copy() for image in seen]
    fast = sweep(shape, grid, 5.0, np.float64).moments_of(seen, weight, sandwich=True)
    for image, before in zip(seen, kept, strict=True):
        np.testing.assert_array_equal(image, before)
    root = np.where(weight < 0.05, 0, np.sqrt(weight))
    weighed = Images(
        seen.gradient_x * root, seen.gradient_y * root, seen.right * root,
        np.where(weight < 0.05, np.nan, seen.residual * root), seen.still, seen.warped,
    )  # fmt: skip
    slow = sweep(shape, grid, 5.0, np.float64).moments_of(weighed, sandwich=True)
    for name in ("normal", "statistics", "sandwich"):
        np.testing.assert_allclose(getattr(fast, name), getattr(slow, name), rtol=1e-12, atol=1e-12)


def test_what_has_no_partner_does_not_show():
    seen, grid = images((33, 47), np.float64), Grid.over((33, 47), 8)
    made = sweep((33, 47), grid, 5.0, np.float64)
    plain = made.moments_of(seen, sandwich=True)
    glare = np.where(np.isnan(seen.residual), 1e9, seen.still)
    for still in (glare, np.where(np.isnan(seen.residual), np.nan, seen.still)):
        again = made.moments_of(seen._replace(still=still), sandwich=True)
        for name in ("normal", "statistics", "sandwich"):
            np.testing.assert_array_equal(getattr(again, name), getattr(plain, name))


@pytest.mark.parametrize("name", ["moments", "images"])
def test_threads_do_not_matter(monkeypatch, name):
    made, maps = pair((150, 70), 8, 5.0)
    results = []
    for workers in (1, 2):
        monkeypatch.setattr(threads, "worker_count", lambda workers=workers: workers)
        results.append(getattr(made, name)(maps))
    one, two = (list(dataclasses.astuple(r)[1:3]) if name == "moments" else list(r) for r in results)
    for first, second in zip(one, two, strict=True):
        np.testing.assert_array_equal(first, second)


def test_means_of_images():
    grid = Grid.over((33, 47), 5)
    a, b = np.random.default_rng(1).normal(size=(2, 33, 47))
    lattice = Lattice.over(a.shape, grid, 4)
    exact = naive.node_windows([np.ones_like(a), a, b], [0, 0, 0], lattice, 5.0, grid)
    sums = image_sums((a, b), grid, 5.0)
    np.testing.assert_allclose(np.moveaxis(sums, 0, -1), exact, atol=1e-13)
    np.testing.assert_allclose(window_means((a, b), grid, 5.0), sums[1:] / sums[0])


def test_sums_of_a_motion():
    """Value and gradient fields that are affine come out as their own window fit would see them."""
    shape, grid, sigma = (40, 50), Grid.over((40, 50), 8), 5.0
    rng = np.random.default_rng(2)
    valid = (rng.random(shape) > 0.1).astype(float)
    maps = rng.normal(size=(6, *grid.shape))
    u, v = naive.blend(maps, grid.origin_and_step, shape)
    exact = naive.node_windows(
        [valid, valid * u, valid * v], [2, 1, 1], Lattice.over(shape, grid, 4), sigma, grid
    )
    np.testing.assert_allclose(motion_sums(valid, maps, grid, sigma), exact, atol=1e-12 * np.abs(exact).max())


def pair(shape, step, sigma):
    """A sweep of two random frames in single precision, and maps."""
    rng = np.random.default_rng(8)
    grid = Grid.over(shape, step)
    frames = [Frame(image.astype(np.float32), NO_MASK) for image in rng.normal(size=(2, *shape))]
    maps = grid.plane(np.array([0.7, -0.4, 0.01, -0.02, 0.015, -0.01])) + 0.1 * rng.normal(
        size=(6, *grid.shape)
    )
    return Sweep(*frames, grid, sigma, degree=3), maps


def test_moments_are_a_value():
    made, maps = pair((37, 50), 8, 5.0)
    first = made.moments(maps)
    kept = first.normal.copy()
    made.moments(-maps)
    np.testing.assert_array_equal(first.normal, kept)
    assert isinstance(first, Moments)
    np.testing.assert_array_equal(made.moments(maps).normal, kept)
