"""The grid: where its points lie."""

import numpy as np
import pytest

from sixflow.maps.grid import Grid


@pytest.mark.parametrize("step", [1, 2, 7, 8, 30, 1000])
@pytest.mark.parametrize("shape", [(1, 1), (5, 31), (64, 48), (113, 100)])
def test_points_cover_the_frame(shape, step):
    grid = Grid.over(shape, step)
    assert (len(grid.y), len(grid.x)) == grid.shape == (grid.rows, grid.columns)
    for points, size in ((grid.y, shape[0]), (grid.x, shape[1])):
        assert points.dtype == np.int64
        assert set(np.diff(points)) <= {step}
        before, after = points[0], size - 1 - points[-1]
        assert min(before, after) >= 0
        # centred to the pixel, and no room for a further point
        assert 0 <= after - before <= 1
        assert before + after < step
    assert grid.origin_and_step == (grid.x[0], grid.y[0], step)


def test_plane():
    grid = Grid.over((40, 60), 9)
    values = np.array([1.0, -2.0, 0.1, 0.2, -0.3, 0.4])
    maps = grid.plane(values)
    x, y = np.meshgrid(grid.x, grid.y)
    np.testing.assert_allclose(maps[0], 1 + 0.1 * x + 0.2 * y)
    np.testing.assert_allclose(maps[1], -2 - 0.3 * x + 0.4 * y)
    np.testing.assert_array_equal(maps[2:], np.broadcast_to(values[2:, None, None], (4, *grid.shape)))
    maps[0, 0, 0] = 5  # its own memory
    assert values[0] == 1


def test_grids_are_values():
    assert Grid.over((64, 48), 8) == Grid(3, 3, 8, 6, 8)
    with pytest.raises(AttributeError):
        Grid.over((64, 48), 8).step = 4
