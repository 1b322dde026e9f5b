"""The sweep of one pass against SciPy's interpolation and plain differences."""

import numpy as np
import pytest

import naive
from sixflow.engine.blend import twist_of
from sixflow.engine.interpolate import Interpolant
from sixflow.engine.spline import noise_variance, spline_coefficients
from sixflow.engine.sweep import Form, Images, Motion, Pair, image_strip
from sixflow.maps.grid import Grid
from sixflow.prepare.frame import NO_MASK, Frame
from sixflow.refine.sweep import Sweep, mean_plane

DTYPES = [np.float32, np.float64]


def smooth(shape, seed):
    """Random image of a few waves: its spline is well conditioned, so that tolerances are those of rounding."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[: shape[0], : shape[1]]
    image = np.zeros(shape)
    for _ in range(12):
        k = rng.uniform(-1, 1, 2)
        image += rng.normal() * np.cos(k[0] * x + k[1] * y + rng.uniform(0, 7))
    return image


def scene(shape, step, dtype, *, scale=1.0, seed=5):
    """Two unrelated images, a grid and wavy maps on it with a plane taken off; all exact in `dtype`."""
    grid = Grid.over(shape, step)
    rng = np.random.default_rng(seed)
    maps = scale * rng.uniform(-1, 1, (6, *grid.shape))
    maps[2:] *= 0.2 / max(step, 4)
    plane = np.array([0.7, -0.4, 0.01, -0.02, 0.015, -0.01]) * scale
    images = smooth(shape, seed + 1), smooth(shape, seed + 2)
    return grid, *(a.astype(dtype) for a in (*images, maps, plane))


def run(
    reference,
    moved,
    maps,
    grid,
    plane,
    degree,
    total,
    *,
    valid0=None,
    valid1=None,
    light=None,
    strip=16,
    central=False,
):
    dtype, shape = reference.dtype, reference.shape
    names = "gradient_x", "gradient_y", "right", "residual", "still", "warped"
    out = {name: np.full(shape, 7, dtype) for name in names}
    masks = [NO_MASK if v is None else v.astype(np.uint8) for v in (valid0, valid1)]
    noise, share = noise_variance(degree), dtype.type(2 if central else 1)
    pair = Pair(
        reference,
        NO_MASK if central else masks[0],
        Interpolant(spline_coefficients(reference, degree), masks[0], noise),
        Interpolant(spline_coefficients(moved, degree), masks[1], noise),
    )
    lighting = np.empty((0, 0, 0), dtype)
    if light is not None:  # (gain, offset) of (value, x-slope, y-slope, twist)
        lighting = np.concatenate([light[:, 0], light[0, 1:3], light[1, 1:3], light[:, 3]])
    motion = Motion(
        maps / share, twist_of(maps / share, grid.step), grid.origin_and_step, plane / share, lighting
    )
    for start in range(0, shape[0], strip):
        stop = min(start + strip, shape[0])
        part = Images(*(image[start:stop] for image in out.values()))
        image_strip(pair, motion, Form(degree + 1, total, central), start, stop, part)
    if not central:
        out["still"] = reference
    return out


def slow(reference, moved, maps, grid, plane, degree, total, **options):
    a, b, c = noise_variance(degree)

    def noise(f):
        s = f * (1 - f)
        return 1 + s * (a + s * (b + s * c))

    images = (image.astype(float) for image in (reference, moved, maps))
    first, second, maps = images
    return naive.warp(
        first, second, maps, grid.origin_and_step, plane.astype(float), degree, total, noise, **options
    )


def assert_same(fast, exact, dtype):
    for name, values in fast.items():
        # positions of some 100 px are rounded before they are interpolated: slope × rounding of the position;
        # and where the motion all but folds the plane, the axes of the moved frame are drawn out by 1/0.05
        roundings = 400 if name in ("residual", "warped") else 2000
        tolerance = roundings * np.finfo(dtype).eps * max(1, np.nanmax(np.abs(exact[name])))
        np.testing.assert_array_equal(np.isnan(values), np.isnan(exact[name]), err_msg=name)
        np.testing.assert_allclose(values, exact[name], atol=tolerance, rtol=0, err_msg=name)


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("degree", [3, 5])
@pytest.mark.parametrize("total", [True, False])
@pytest.mark.parametrize(("shape", "step"), [((37, 50), 8), ((23, 19), 7), ((16, 70), 1), ((9, 9), 30)])
def test_warp(dtype, degree, total, shape, step):
    grid, *images = scene(shape, step, dtype)
    reference, moved, maps, plane = images
    arguments = reference, moved, maps, grid, plane, degree, total
    assert_same(run(*arguments), slow(*arguments), dtype)


@pytest.mark.parametrize("degree", [3, 5])
@pytest.mark.parametrize("scale", [5.0, 40.0])
def test_motion_out_of_the_frame(degree, scale):
    grid, *images = scene((40, 60), 8, np.float64, scale=scale)
    reference, moved, maps, plane = images
    arguments = reference, moved, maps, grid, plane, degree, True
    exact = slow(*arguments)
    assert 0.02 < np.isnan(exact["residual"]).mean() < 1
    assert_same(run(*arguments), exact, np.float64)


def test_motion_entirely_out_of_the_frame_or_beyond_numbers():
    grid, *images = scene((20, 20), 8, np.float32)
    reference, moved, maps, _ = images
    for far in (100.0, -1e6, 1e12, np.inf, np.nan):
        out = run(reference, moved, maps, grid, np.array([far, 0, 0, 0, 0, 0], np.float32), 5, True)
        assert np.isnan(out["residual"]).all()
        for name in ("gradient_x", "gradient_y", "right"):
            np.testing.assert_array_equal(out[name], 0)


@pytest.mark.parametrize("shift", [(0, 0), (3, -2), (-19, 0), (0, 14)])
def test_whole_pixels_are_exact_up_to_the_border(shift):
    """A pixel that lands exactly on the last row or column still has a partner."""
    reference, moved = smooth((15, 20), 1), smooth((15, 20), 2)
    grid = Grid.over((15, 20), 5)
    plane = np.array([*shift, 0, 0, 0, 0], float)
    out = run(reference, moved, np.zeros((6, *grid.shape)), grid, plane, 3, True)
    expected = np.full((15, 20), np.nan)
    y, x = np.mgrid[:15, :20]
    to_x, to_y = x + shift[0], y + shift[1]
    inside = (to_x >= 0) & (to_x < 20) & (to_y >= 0) & (to_y < 15)
    expected[inside] = moved[to_y[inside], to_x[inside]]
    np.testing.assert_allclose(out["warped"], expected, atol=1e-12)


@pytest.mark.parametrize("degree", [3, 5])
def test_masks(degree):
    grid, *images = scene((33, 41), 8, np.float64)
    reference, moved, maps, plane = images
    rng = np.random.default_rng(3)
    valid0, valid1 = rng.random((2, 33, 41)) > 0.01
    arguments = reference, moved, maps, grid, plane, degree, True
    masks = {"valid0": valid0, "valid1": valid1}
    exact = slow(*arguments, **masks)
    assert 0.05 < np.isnan(exact["residual"]).mean() < 0.9
    assert_same(run(*arguments, **masks), exact, np.float64)


def test_lighting():
    grid, *images = scene((33, 41), 8, np.float64)
    reference, moved, maps, plane = images
    rng = np.random.default_rng(4)
    light = np.zeros((2, 4, *grid.shape))
    light[0, 0], light[1, 0] = rng.uniform(0.8, 1.2, grid.shape), rng.normal(size=grid.shape)
    nodes = grid.x.astype(float), grid.y.astype(float)
    dense = []
    y, x = (np.arange(size, dtype=float) for size in reference.shape)
    for part in light:
        part[1], part[2] = naive.slopes(part[0], nodes[0], 1), naive.slopes(part[0], nodes[1], 0)
        part[3] = (naive.slopes(part[1], nodes[1], 0) + naive.slopes(part[2], nodes[0], 1)) / 2
        dense.append(naive.hermite_surface(*nodes, part[0], part[1], part[2], x, y))
    arguments = reference, moved, maps, grid, plane, 5, True
    assert_same(run(*arguments, light=light), slow(*arguments, light=dense), np.float64)


def test_strips_do_not_matter():
    grid, *images = scene((50, 41), 8, np.float32)
    reference, moved, maps, plane = images
    arguments = reference, moved, maps, grid, plane, 5, True
    one = run(*arguments, strip=50)
    for strip in (1, 3, 16):
        for name, values in run(*arguments, strip=strip).items():
            np.testing.assert_array_equal(values, one[name])


@pytest.mark.parametrize("total", [True, False])
@pytest.mark.parametrize("masked", [True, False])
def test_seen_from_the_middle(total, masked):
    grid, *images = scene((33, 41), 8, np.float64)
    reference, moved, maps, plane = images
    valid0, valid1 = np.random.default_rng(3).random((2, 33, 41)) > 0.01
    options = {"valid0": valid0, "valid1": valid1} if masked else {}
    arguments = reference, moved, maps, grid, plane, 5, total
    exact = slow(*arguments, central=True, **options)
    assert_same(run(*arguments, central=True, **options), exact, np.float64)


@pytest.mark.parametrize("central", [True, False])
def test_light_is_given_by_gain_and_offset(central):
    """`Sweep` finds the slopes of light between the grid points, and takes the mean plane off the maps."""
    grid, *images = scene((33, 41), 8, np.float64)
    reference, moved, maps, _ = images
    light = np.stack([1 + 0.01 * grid.plane(np.arange(6) / 50)[0], grid.plane(np.arange(6) / 70)[1]])
    sweep = Sweep(Frame(reference, NO_MASK), Frame(moved, NO_MASK), grid, 5.0, degree=5, central=central)
    found = sweep.images(maps, light=light)
    plane = mean_plane(maps, grid)
    y, x = (np.arange(size, dtype=float) for size in reference.shape)
    nodes = grid.x.astype(float), grid.y.astype(float)
    dense = [
        naive.hermite_surface(*nodes, part, *(np.gradient(part, 8, axis=a) for a in (1, 0)), x, y)
        for part in light
    ]
    reduced = maps - grid.plane(plane)
    exact = slow(reference, moved, reduced, grid, plane, 5, True, light=dense, central=central)
    assert_same(found._asdict(), exact, np.float64)
