"""The Hermite interpolant and the blend against SciPy's cubic Hermite splines."""

import numpy as np
import pytest

import naive
from sixflow.engine.blend import blend_row, blend_strip, hermite_basis, twist_of
from sixflow.engine.hermite import HermiteSurface, make_stencil, slopes_along

GRIDS = [
    # x0, y0, step, columns, rows, frame shape; the step does not divide the frame
    (3, 2, 8, 6, 5, (39, 50)),
    (0, 0, 1, 9, 7, (7, 9)),
    (5, 3, 4, 1, 6, (31, 13)),
    (2, 9, 7, 4, 1, (22, 30)),
    (4, 4, 8, 1, 1, (9, 12)),
    (0, 2, 5, 8, 6, (33, 41)),
    (20, 1, 3, 3, 3, (50, 60)),
    (1, 1, 16, 4, 4, (37, 40)),
]


def blended(maps, grid, shape, dtype):
    x0, y0, step = grid
    maps, twist = maps.astype(dtype), twist_of(maps.astype(dtype), step)
    basis, line = np.empty((4, step), dtype), np.empty((2, maps.shape[2]), dtype)
    hermite_basis(step, basis)
    out = np.empty((2, *shape), dtype)
    for k in range(2):
        for y in range(shape[0]):
            planes = maps[k], maps[2 + 2 * k], maps[3 + 2 * k], twist[k]
            blend_row(*planes, x0, y0, step, y, basis, line, out[k, y])
    return out


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("case", GRIDS)
def test_blend(dtype, case):
    *grid, columns, rows, shape = case
    maps = np.random.default_rng(1).normal(size=(6, rows, columns))
    maps[2:] /= grid[2]
    exact = naive.blend(maps, grid, shape)
    scale = 8 * (1 + np.abs(exact).max())
    np.testing.assert_allclose(
        blended(maps, grid, shape, dtype), exact, atol=16 * np.finfo(dtype).eps * scale
    )


@pytest.mark.parametrize("case", GRIDS)
def test_blend_reproduces_affine_maps(case):
    *grid, columns, rows, shape = case
    x0, y0, step = grid
    x, y = np.meshgrid(x0 + step * np.arange(columns), y0 + step * np.arange(rows))
    slopes = (0.01, -0.02, 0.03, 0.005)
    flat = [np.full(x.shape, s) for s in slopes]
    maps = np.stack([1 + 0.01 * x - 0.02 * y, 2 + 0.03 * x + 0.005 * y, *flat])
    Y, X = np.mgrid[: shape[0], : shape[1]]
    u, v = blended(maps, grid, shape, np.float64)
    np.testing.assert_allclose(u, 1 + 0.01 * X - 0.02 * Y, atol=1e-13)
    np.testing.assert_allclose(v, 2 + 0.03 * X + 0.005 * Y, atol=1e-13)


def test_strips_are_rows():
    grid, shape = (3, 2, 8), (39, 50)
    maps = np.random.default_rng(1).normal(size=(6, 5, 6))
    u, v = np.empty((2, *shape))
    for start in range(0, 39, 10):
        blend_strip(maps, twist_of(maps, 8), *grid, start, min(start + 10, 39), u, v)
    np.testing.assert_array_equal([u, v], blended(maps, grid, shape, np.float64))


def test_blend_is_of_fourth_order():
    """Halving the step divides the error of a smooth field by 16."""
    errors = []
    for step in (16, 8):
        p = np.arange(0, 129, step)
        x, y = np.meshgrid(p, p)
        k = 2 * np.pi / 100
        u, slope = np.sin(k * x + k * y), k * np.cos(k * x + k * y)
        maps = np.stack([u, u, slope, slope, slope, slope])
        Y, X = np.mgrid[:129, :129]
        error = blended(maps, (0, 0, step), (129, 129), np.float64)[0] - np.sin(k * X + k * Y)
        errors.append(np.abs(error[32:-32, 32:-32]).max())  # where all differences are central
    assert errors[0] / errors[1] == pytest.approx(16, rel=0.35)


@pytest.mark.parametrize("shape", [(2, 5, 6), (2, 1, 6), (2, 5, 1), (2, 2, 2)])
def test_surface(shape):
    rng = np.random.default_rng(2)
    values, slopes_x, slopes_y = rng.normal(size=(3, *shape))
    y, x = (np.cumsum(rng.uniform(2, 5, size)) for size in shape[1:])
    wanted_x, wanted_y = np.linspace(x[0] - 6, x[-1] + 6, 23), np.linspace(y[0] - 6, y[-1] + 6, 19)
    surface = HermiteSurface(x, y, values=values, slopes_x=slopes_x, slopes_y=slopes_y)
    fast = surface.on_grid(wanted_x, wanted_y)
    for k in range(2):
        exact = naive.hermite_surface(x, y, values[k], slopes_x[k], slopes_y[k], wanted_x, wanted_y)
        np.testing.assert_allclose(fast[k], exact, atol=1e-11)
    X, Y = np.meshgrid(wanted_x, wanted_y)
    np.testing.assert_allclose(surface.at(X.ravel(), Y.ravel()).reshape(fast.shape), fast, atol=1e-11)
    np.testing.assert_allclose(surface.on_grid(x, y), values, atol=1e-12)
    np.testing.assert_allclose(surface.on_grid(x, y, along_x=True), slopes_x, atol=1e-12)
    np.testing.assert_allclose(surface.on_grid(x, y, along_y=True), slopes_y, atol=1e-12)


def test_derivatives_of_a_surface_are_those_of_its_values():
    rng = np.random.default_rng(3)
    values, slopes_x, slopes_y = rng.normal(size=(3, 6, 7))
    x, y = 4.0 * np.arange(7), 3.0 * np.arange(6)
    surface = HermiteSurface(x, y, values=values, slopes_x=slopes_x, slopes_y=slopes_y)
    # away from the nodes, where the second derivative jumps
    X, Y, h = rng.uniform(-5, 29, 200), rng.uniform(-5, 20, 200), 1e-5
    numeric = (surface.at(X + h, Y) - surface.at(X - h, Y)) / (2 * h)
    np.testing.assert_allclose(surface.at(X, Y, along_x=True), numeric, atol=1e-4)
    numeric = (surface.at(X, Y + h) - surface.at(X, Y - h)) / (2 * h)
    np.testing.assert_allclose(surface.at(X, Y, along_y=True), numeric, atol=1e-4)


def test_unknown_nodes_spoil_only_what_needs_them():
    x = y = 4.0 * np.arange(6)
    X, Y = np.meshgrid(x, y)
    values = 0.5 * X - 0.25 * Y
    values[2, 3] = np.nan
    surface = HermiteSurface(
        x, y, values=values, slopes_x=np.full_like(X, 0.5), slopes_y=np.full_like(X, -0.25)
    )
    wanted = np.linspace(-3, 23, 53)
    fast = surface.on_grid(wanted, wanted)
    near_x, near_y = np.abs(wanted - 12) < 4, np.abs(wanted - 8) < 4
    np.testing.assert_array_equal(np.isnan(fast), near_y[:, None] & near_x)
    plane = 0.5 * wanted - 0.25 * wanted[:, None]
    np.testing.assert_allclose(fast[~np.isnan(fast)], plane[~np.isnan(fast)], atol=1e-12)
    gx, gy = (a.ravel() for a in np.meshgrid(wanted, wanted))
    np.testing.assert_array_equal(np.isnan(surface.at(gx, gy)).reshape(fast.shape), np.isnan(fast))


def test_slopes_beside_unknown_samples():
    nodes = np.arange(7.0)
    nan = np.nan
    np.testing.assert_allclose(slopes_along(nodes**2, nodes, 0), 2 * nodes)
    np.testing.assert_allclose(
        slopes_along(np.array([0, 2, 4, nan, 8, nan, 12]), nodes, 0)[[0, 1, 2, 4]], [2, 2, 2, 0]
    )
    np.testing.assert_array_equal(slopes_along(np.ones((3, 1)), np.zeros(1), 1), np.zeros((3, 1)))


def test_stencil_at_and_beyond_the_nodes():
    stencil = make_stencil(np.array([0.0, 2.0, 4.0]), np.array([-1.0, 0.0, 1.0, 4.0, 9.0]))
    assert stencil.low.tolist() == [0, 0, 0, 1, 1]
    assert stencil.needs_low.tolist() == [True, True, True, False, False]
    assert stencil.needs_high.tolist() == [False, False, True, True, True]
    np.testing.assert_allclose(stencil.weights[:2].sum(axis=0), 1)
