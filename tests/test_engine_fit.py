"""Kernels of the ladder against slow twins: affine fits of a blend, and the likely covariance."""

import numpy as np
import pytest

import naive
from sixflow.engine.fit import fit_strip, taps_of, twist_strip
from sixflow.engine.likely import likely_strip
from sixflow.engine.response import quotient
from sixflow.engine.window import CUT
from sixflow.maps.grid import Grid
from sixflow.refine.cut import LatticeWindow, MaskedWindow, seen_by
from sixflow.refine.uniform import RectangularWindow


def fits(maps, grid, sigma, counted):
    down, across = (
        taps_of(origin, grid.step, count, sides, sigma, maps.dtype.str)
        for origin, count, sides in zip((grid.y0, grid.x0), (grid.rows, grid.columns), counted, strict=True)
    )
    twist, out = np.empty((2, *grid.shape), maps.dtype), np.empty_like(maps)
    twist_strip(maps, float(grid.step), 0, grid.rows, twist)
    plain = np.array([1.0, 0.0, 0.0], maps.dtype), np.empty(0, maps.dtype)
    nothing = np.empty((0, *maps.shape), maps.dtype)
    fit_strip(maps, twist, (down, across), plain, maps, (0, grid.rows), out, nothing)
    return out


def naive_fit(dense, grid, sigma, counted):
    """The weighted affine fit of a dense displacement at every point; NaN where hardly anything is left of a window."""
    height, width = dense.shape[1:]
    y, x = np.mgrid[:height, :width]
    inside = (y >= counted[0][0]) & (y < counted[0][1]) & (x >= counted[1][0]) & (x < counted[1][1])
    reach, out = np.ceil(CUT * sigma), np.full((6, *grid.shape), np.nan)
    for j in range(grid.rows):
        for i in range(grid.columns):
            X, Y = x - grid.x[i], y - grid.y[j]
            w = np.exp(-(X**2 + Y**2) / (2 * sigma**2)) * inside * (abs(X) <= reach) * (abs(Y) <= reach)
            if min((w.sum(axis=axis) > 0).sum() for axis in (0, 1)) < 3:
                continue
            root = np.sqrt(w).ravel()
            columns = np.stack([np.ones(X.size), X.ravel(), Y.ravel()], axis=1) * root[:, None]
            for k in range(2):
                out[[k, 2 + 2 * k, 3 + 2 * k], j, i] = np.linalg.lstsq(
                    columns, root * dense[k].ravel(), rcond=None
                )[0]
    return out


@pytest.mark.parametrize(
    ("step", "shape", "sigma", "left"),
    [
        (5, (47, 60), 3.1, 0),
        (5, (47, 60), 7.0, 13),
        (1, (20, 30), 3.1, 0),
        (8, (40, 9), 7.0, 2),
        (8, (9, 9), 3.1, 0),
    ],
)
def test_fits_are_those_of_the_dense_blend(step, shape, sigma, left):
    grid, counted = Grid.over(shape, step), ((0, shape[0] - left // 2), (left, shape[1]))
    maps = np.random.default_rng(step).normal(size=(6, *grid.shape))
    exact = naive_fit(np.stack(naive.blend(maps, grid.origin_and_step, shape)), grid, sigma, counted)
    known = np.isfinite(exact[0])
    assert known.mean() > 0.5
    fast = fits(maps, grid, sigma, counted)
    np.testing.assert_allclose(fast[:, known], exact[:, known], atol=1e-11)
    single = fits(maps.astype(np.float32), grid, sigma, counted)
    # sums of some hundred terms of size 1, each rounded by 2⁻²⁴
    np.testing.assert_allclose(single[:, known], exact[:, known], atol=3e-5)


def test_a_point_without_a_window_keeps_its_map():
    grid = Grid.over((40, 60), 5)
    maps = np.random.default_rng(0).normal(size=(6, *grid.shape))
    fitted = fits(maps, grid, 3.0, ((0, 40), (0, 30)))
    gone = grid.x > 30 + np.ceil(CUT * 3.0)
    assert gone.any()
    line = fits(maps, grid, 3.0, ((0, 40), (0, 60)))
    assert not np.allclose(line[:, :, gone], fitted[:, :, gone])
    for plane in (0, 1):  # along x nothing is left; along y the window is whole
        assert np.isfinite(fitted[plane]).all()


def test_several_sharpenings_from_one_recurrence():
    grid = Grid.over((90, 110), 6)
    window = RectangularWindow.over(grid, 5.0, ((0, 90), (2, 110)))
    maps = np.random.default_rng(1).normal(size=(6, *grid.shape))
    for order, found in zip((4, 1, 0), window.deconvolved(maps, (4, 1, 0)), strict=True):
        before, here = np.zeros_like(maps), maps
        total = quotient(order)[0] * maps
        for k, share in enumerate(quotient(order)[1:]):
            before, here = here, (4 * window.fit(here) - 2 * here - before) / (1 + (k == 0))
            total = total + share * here
        np.testing.assert_allclose(found, total, atol=1e-9)


def test_large_windows_are_deconvolved_on_fewer_points():
    """A wave that the window attenuates by a tenth: what a coarser grid misses of it is an eighth of that at most."""
    grid, sigma = Grid.over((240, 400), 8), 17.5
    k = 1.117 / sigma
    x = np.broadcast_to(grid.x, grid.shape).astype(float)
    zero = np.zeros(grid.shape)
    wave = np.stack([np.cos(k * x), zero, -k * np.sin(k * x), zero, zero, zero])
    window = RectangularWindow.over(grid, sigma, ((0, 240), (0, 400)))
    seen = window.fit(wave)
    (fast,) = window.deconvolved(seen, (2,))
    (exact,) = super(RectangularWindow, window).deconvolved(seen, (2,))
    inside = np.abs(fast - exact)[0, :, 8:-8]  # at the border the wave goes on straight, and is another
    assert 0 < inside.max() < 0.0125
    # an affine map is the same to rounding
    plane = grid.plane(np.array([1, 2, 0.1, 0.2, 0.3, 0.4]))
    np.testing.assert_allclose(window.deconvolved(plane, (2,))[0], plane, atol=1e-9)


def test_masked_windows_are_rectangular_where_no_mask_is_near():
    grid, sigma = Grid.over((160, 200), 8), 4.0
    counted = np.ones((160, 200), bool)
    counted[:, 190:] = False
    whole = RectangularWindow.over(grid, sigma, ((0, 160), (0, 190)))
    maps = np.random.default_rng(2).normal(size=(6, *grid.shape))
    np.testing.assert_array_equal(MaskedWindow(grid, sigma, counted).fit(maps), whole.fit(maps))
    counted[60:90, 70:100] = False
    cut = MaskedWindow(grid, sigma, counted)
    far = ~cut.cut
    assert 0.5 < far.mean() < 0.95
    np.testing.assert_array_equal(cut.fit(maps)[:, far], whole.fit(maps)[:, far])
    lattice = LatticeWindow(grid, sigma, counted).fit(maps)
    np.testing.assert_allclose(cut.fit(maps)[:, cut.cut], lattice[:, cut.cut], atol=1e-12)


def test_what_the_rim_of_a_frame_cuts():
    grid = Grid.over((100, 140), 8)
    shift = grid.plane(np.array([3.2, -7.5, 0, 0, 0, 0]))
    assert seen_by(shift, grid, (100, 140), 0.0) == (((8, 100), (0, 136)), 0.0)
    assert seen_by(shift, grid, (100, 140), 0.5) == (((4, 96), (2, 138)), 0.0)
    turn = grid.plane(np.array([0, 0, 0, -0.1, 0.1, 0]))
    _, bent = seen_by(turn, grid, (100, 140), 0.0)
    assert bent == pytest.approx(0.1 * 140 / 2, rel=0.2)


def test_likely_covariance():
    """p/(4πσ²) H̃⁻¹ of a window's own moments, with half of that for the gradients."""
    rng, sigma = np.random.default_rng(3), 5.0
    J = (
        rng.normal(size=(200, 2, 1))
        * np.concatenate([np.ones((200, 1)), rng.normal(size=(200, 2))], axis=1)[:, None]
    )
    J = J.reshape(200, 6)  # g_x (1, X, Y), g_y (1, X, Y)
    H = J.T @ J
    order = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]
    moments = np.array([H[a + 3 * (block > 0), b + 3 * (block > 1)] for block in range(3) for a, b in order])
    out = np.empty((1, 1, 6, 6))
    gamma, power = np.full((1, 1), 2.0), np.full((1, 1), 3.0)
    likely_strip(moments[None, None], gamma, power, sigma, 0, 1, out)
    scaled = np.diag([1, 2**-0.5 / sigma, 2**-0.5 / sigma] * 2)
    C = 3.0 / (4 * np.pi * sigma**2) * scaled @ np.linalg.inv(H - 2.0 * np.eye(6)) @ scaled
    to_six = np.array(
        [[1, 0, 0, 0, 0, 0], [0, 0, 0, 1, 0, 0], [0, 1, 0, 0, 0, 1],
         [0, 0, -1, 0, 1, 0], [0, 1, 0, 0, 0, -1], [0, 0, 1, 0, 1, 0]]
    )  # fmt: skip
    exact = to_six @ C @ to_six.T
    np.testing.assert_allclose(np.diag(out[0, 0]), np.diag(exact), rtol=1e-9)
    np.testing.assert_allclose(out[0, 0, 0, 1], exact[0, 1], rtol=1e-9)
