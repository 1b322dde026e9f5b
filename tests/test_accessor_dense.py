"""The accessor between the grid points: `dense` and `sample`."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
import xarray as xr

from sixflow.convention import gradient, recentre, six_from_gradient
from sixflow.errors import InputError
from sixflow.field.dataset import SIX
from test_accessor import GENERAL, make_field, spoil

Array = np.ndarray[Any, Any]


def affine_field(x: Array, y: Array) -> Array:
    return recentre(GENERAL, np.stack([x - 30, y - 20], axis=-1))


def quadratic_field(x: Array, y: Array) -> Array:
    x, y = x / 40, y / 40
    d = np.stack([x * x + 2 * x * y - y, 3 * y * y - x * y + 1], axis=-1)
    G = [[2 * x + 2 * y, 2 * x - 1], [-y, 6 * y - x]]
    return six_from_gradient(d, np.moveaxis(np.array(G), (0, 1), (-2, -1)) / 40)


def wavy_field(x: Array, y: Array) -> Array:
    k, m = 2 * np.pi / 60, 2 * np.pi / 80
    d = np.stack([np.sin(k * x) * np.cos(m * y), np.cos(k * x + m * y)], axis=-1)
    G = [
        [k * np.cos(k * x) * np.cos(m * y), -m * np.sin(k * x) * np.sin(m * y)],
        [-k * np.sin(k * x + m * y), -m * np.sin(k * x + m * y)],
    ]
    return six_from_gradient(d, np.moveaxis(np.array(G), (0, 1), (-2, -1)))


def on_pixels(motion: Any, dense: xr.Dataset) -> Array:
    return motion(*np.meshgrid(dense["x"].values.astype(float), dense["y"].values.astype(float)))


def test_affine_fields_are_reproduced_to_rounding_at_every_pixel() -> None:
    dense = make_field(affine_field).sixflow.dense().isel(time=0)
    assert dense["u"].shape == (50, 66)
    np.testing.assert_array_equal(dense["x"], np.arange(66))
    np.testing.assert_allclose(dense.sixflow.six.values, on_pixels(affine_field, dense), atol=1e-13)


def test_quadratic_fields_are_reproduced_between_the_grid_points() -> None:
    field = make_field(quadratic_field)
    inside = {"x": slice(8, 56), "y": slice(6, 42)}
    dense = field.sixflow.dense().isel(time=0).sel(inside)
    np.testing.assert_allclose(dense.sixflow.six.values, on_pixels(quadratic_field, dense), atol=1e-12)


def test_beyond_the_grid_the_field_goes_on_along_straight_lines() -> None:
    field = make_field(quadratic_field)
    got = field.sixflow.sample([2.0, 8.0, 60.0], [12.0, 2.0, 12.0])
    for k, (x, y, dx, dy) in enumerate([(8, 12, -6, 0), (8, 6, 0, -4), (56, 12, 4, 0)]):
        edge = quadratic_field(np.array(float(x)), np.array(float(y)))
        expected = recentre(edge, np.array([dx, dy], float))
        np.testing.assert_allclose([got["u"][k], got["v"][k]], expected[:2], atol=1e-13)


def test_smooth_fields_are_interpolated_to_fourth_order() -> None:
    errors = []
    for step in (8, 4, 2):
        grid = range(0, 97, step)
        field = make_field(wavy_field, x=grid, y=grid, frame_shape=(97, 97))
        dense = field.sixflow.dense().isel(time=0)
        difference = dense.sixflow.six.values - on_pixels(wavy_field, dense)
        errors.append(np.abs(difference[16:-16, 16:-16]).max(axis=(0, 1)))
    for coarse, fine in itertools.pairwise(errors):
        assert (coarse[:2] / fine[:2] > 13).all()  # 16 for a fourth-order error
        assert (coarse[2:] / fine[2:] > 6.5).all()  # 8: the gradient is one order behind


def test_values_and_gradients_at_grid_points_are_kept() -> None:
    field = make_field(wavy_field)
    dense = field.sixflow.dense().sel(x=field["x"], y=field["y"])
    np.testing.assert_allclose(dense.sixflow.six, field.sixflow.six, atol=1e-14)


def test_the_dense_gradient_is_the_derivative_of_the_dense_displacement() -> None:
    ds = make_field(wavy_field).sixflow
    x, y, h = np.random.default_rng(0).uniform(0, 50, 30), np.random.default_rng(1).uniform(0, 45, 30), 1e-4
    sample = ds.sample(x, y)
    G = gradient(np.stack([sample[name].values for name in SIX], axis=-1))
    for j, (dx, dy) in enumerate([(h, 0), (0, h)]):
        rise = [ds.sample(x + dx, y + dy)[n] - ds.sample(x - dx, y - dy)[n] for n in ("u", "v")]
        np.testing.assert_allclose(np.stack(rise, axis=-1) / (2 * h), G[..., j], atol=1e-8)


def test_sample_is_dense_at_pixels_and_takes_scalars() -> None:
    field = make_field(wavy_field, pairs=2)
    dense = field.sixflow.dense()
    sample = field.sixflow.sample([0, 17, 65, 33], [49, 0, 12, 21], time=1)
    for name in SIX:
        pixels = dense[name].isel(time=1).sel(x=sample["x"].astype(int), y=sample["y"].astype(int))
        np.testing.assert_allclose(sample[name], pixels, atol=1e-14)
    one = field.sixflow.sample(17, 0)
    assert one["u"].dims == ()
    assert float(one["u"]) == pytest.approx(float(sample["u"][1]))
    assert field.sixflow.sample(17.5, [1.0, 2.0])["u"].dims == ("point",)


def test_unknown_points_spoil_only_what_needs_them() -> None:
    field = spoil(make_field(affine_field), 3, 2, "outlier")
    known = np.isfinite(field.sixflow.dense()["u"].values[0])
    x, y = int(field["x"][2]), int(field["y"][3])
    expected = np.ones_like(known)
    expected[y - 5 : y + 6, x - 7 : x + 8] = False
    np.testing.assert_array_equal(known, expected)
    values = field.sixflow.dense().isel(time=0).sixflow.six.values
    truth = on_pixels(affine_field, field.sixflow.dense())
    np.testing.assert_allclose(values[known], truth[known], atol=1e-13)
    sample = field.sixflow.sample([x, x - 8, x + 1], [y, y, y])
    np.testing.assert_array_equal(np.isfinite(sample["u"]), [False, True, False])
    np.testing.assert_array_equal(np.isfinite(sample["u_standard_error"]), [False, True, False])


def test_an_unknown_corner_point_spoils_its_side_of_the_frame() -> None:
    known = np.isfinite(spoil(make_field(affine_field), 0, 0, "masked").sixflow.dense()["v"].values[0])
    assert not known[:12, :16].any()
    assert known[12:].all()
    assert known[:, 16:].all()


def test_standard_errors_at_and_between_grid_points() -> None:
    field = make_field(affine_field)
    field["covariance"][0, :, 3:] *= 4
    got = field.sixflow.sample([8.0, 8 * 3.5, 8 * 4.0], [6.0, 15.0, 18.0])
    np.testing.assert_allclose(got["curl_standard_error"], 0.01 * np.sqrt([1, 2.5, 4]))


def test_standard_errors_beyond_the_grid_are_those_of_the_extended_map() -> None:
    rng = np.random.default_rng(3)
    mix = rng.normal(size=(6, 6)) * [0.05, 0.05, 0.01, 0.01, 0.01, 0.01]
    covariance = mix.T @ mix
    field = make_field(GENERAL, covariance=covariance)
    got = field.sixflow.sample(3.0, 48.0)
    draws = recentre(rng.multivariate_normal(GENERAL, covariance, size=20000), np.array([-5.0, 6.0]))
    spread = draws.std(axis=0)
    np.testing.assert_allclose(
        [float(got[f"{name}_standard_error"]) for name in SIX], spread, rtol=5 / np.sqrt(40000)
    )


def test_every_measure_works_on_the_dense_field() -> None:
    field = make_field(affine_field, pixel_size=1, frame_interval=1)
    dense = field.sixflow.dense()
    np.testing.assert_allclose(dense.sixflow.hencky[0, 0, 0], field.sixflow.hencky[0, 0, 0])
    np.testing.assert_allclose(dense.sixflow.physical()["vorticity"], float(field.sixflow.vorticity[0, 0, 0]))


def test_grids_of_one_row_float32_and_reversed_rows() -> None:
    row = make_field(affine_field, y=[18]).sixflow.dense().isel(time=0)
    np.testing.assert_allclose(row.sixflow.six.values, on_pixels(affine_field, row), atol=1e-13)
    field = make_field(affine_field)
    single = field.assign({name: field[name].astype(np.float32) for name in SIX}).sixflow.dense()
    assert single["u"].dtype == np.float32
    np.testing.assert_allclose(single["u"], field.sixflow.dense()["u"], atol=1e-4)
    np.testing.assert_array_equal(
        field.isel(y=slice(None, None, -1)).sixflow.dense()["u"], field.sixflow.dense()["u"]
    )


def test_the_frame_shape_as_files_give_it() -> None:
    field = make_field(affine_field)
    field.attrs["frame_shape"] = np.array([50, 66])
    assert field.sixflow.dense()["u"].shape == (1, 50, 66)


@pytest.mark.parametrize(
    ("x", "y", "time", "message"),
    [
        (1.0, 2.0, 3, "time=3: the field has 1 pair"),
        (1.0, 2.0, 0.5, "time=0.5: must be the position"),
        (1.0, 2.0, True, "time=True"),
        ([1.0, 2.0], [1.0, 2.0, 3.0], 0, "x and y: .*two arrays of one length"),
        ("left", 2.0, 0, "x and y"),
        (np.zeros((2, 2)), np.zeros((2, 2)), 0, r"shape \(2, 2\): give one dimension"),
        (np.nan, 1.0, 0, "NaN or infinity"),
    ],
)
def test_sample_refuses(x: Any, y: Any, time: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        make_field(GENERAL).sixflow.sample(x, y, time)


def test_dense_needs_the_frame_shape() -> None:
    field = make_field(GENERAL)
    del field.attrs["frame_shape"]
    with pytest.raises(InputError, match=r"frame_shape=None: .*set field.attrs\['frame_shape'\]"):
        field.sixflow.dense()
