"""The accessor: measures, standard errors, flags, units and words."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import xarray as xr

from sixflow import convention
from sixflow.errors import InputError
from sixflow.field.accessor import SixflowAccessor
from sixflow.field.dataset import FLAGS, SIX, build_field
from sixflow.field.derived import DERIVED, MEASURES

Array = np.ndarray[Any, Any]
ROTATION = 0.7


def make_field(
    motion: Callable[[Array, Array], Array] | Array,
    *,
    x: Any = range(8, 57, 8),
    y: Any = range(6, 43, 6),
    pairs: int = 1,
    frame_shape: tuple[int, int] = (50, 66),
    covariance: Array | None = None,
    time_unit: str = "frame",
    **settings: Any,
) -> xr.Dataset:
    """A field whose six are constant, or a function of x and y that returns them in the last axis."""
    x, y = np.array(x), np.array(y)
    six = motion(*np.meshgrid(x.astype(float), y.astype(float))) if callable(motion) else np.array(motion)
    six = np.broadcast_to(six, (pairs, len(y), len(x), 6)).astype(float)
    spread = np.eye(6) * 1e-4 if covariance is None else covariance
    return build_field(
        six=six.copy(),
        covariance=np.broadcast_to(spread, (*six.shape, 6)).copy(),
        residual=np.full(six.shape[:-1], 0.05),
        noise=np.full(six.shape[:-1], 2.0),
        flag=np.zeros(six.shape[:-1], np.uint8),
        x=x,
        y=y,
        time=np.arange(pairs) * 0.1,
        time_unit=time_unit,
        frame_numbers=[(k, k + 1) for k in range(pairs)],
        attrs={"frame_shape": list(frame_shape), "settings": json.dumps(settings)},
    )


def spoil(field: xr.Dataset, row: int, column: int, flag: str) -> xr.Dataset:
    """Let a point fail."""
    field = field.copy(deep=True)
    for name in (*SIX, "covariance"):
        field[name][:, row, column] = np.nan
    field["flag"][:, row, column] = FLAGS[flag]
    return field


def rotation(angle: float) -> Array:
    return np.array([0, 0, 2 * (np.cos(angle) - 1), 2 * np.sin(angle), 0, 0])


GENERAL = np.array([0.3, -1.2, 0.08, 0.2, -0.05, 0.11])


def test_six_are_stacked_in_their_order() -> None:
    six = make_field(GENERAL).sixflow.six
    assert six.dims == ("time", "y", "x", "param")
    assert list(six["param"].values) == list(SIX)
    np.testing.assert_array_equal(six.values[0, 2, 3], GENERAL)


def test_gradient_is_labelled_by_component_and_direction() -> None:
    G = make_field(GENERAL).sixflow.displacement_gradient
    _, _, divergence, curl, stretch, shear = GENERAL
    assert G.dims == ("time", "y", "x", "i", "j")
    assert G.sel(i="x", j="y").values[0, 0, 0] == pytest.approx((shear - curl) / 2)
    assert G.sel(i="y", j="x").values[0, 0, 0] == pytest.approx((shear + curl) / 2)
    assert G.sel(i="x", j="x").values[0, 0, 0] == pytest.approx((divergence + stretch) / 2)


@pytest.mark.parametrize("name", [name for name in DERIVED if hasattr(SixflowAccessor, name)])
def test_properties_are_the_derived_quantities_of_their_name(name: str) -> None:
    ds = make_field(GENERAL).sixflow
    xr.testing.assert_identical(getattr(ds, name), ds.derive(name))


@pytest.mark.parametrize("name", ["green_lagrange", "almansi", "hencky", "biot", "small_strain"])
def test_measures_are_those_of_the_convention(name: str) -> None:
    expected = getattr(convention, name)(convention.gradient(GENERAL))
    np.testing.assert_allclose(getattr(make_field(GENERAL).sixflow, name).values[0, 1, 1], expected)


def test_a_large_rotation_is_no_deformation() -> None:
    ds = make_field(rotation(ROTATION), frame_interval=0.01).sixflow
    np.testing.assert_allclose(ds.rotation_angle, ROTATION)
    np.testing.assert_allclose(ds.area_ratio, 1)
    np.testing.assert_allclose(ds.green_lagrange, 0, atol=1e-15)
    np.testing.assert_allclose(ds.hencky, 0, atol=1e-15)
    np.testing.assert_allclose(ds.vorticity, 2 * ROTATION / 0.01)
    np.testing.assert_allclose(ds.strain_rate, 0, atol=1e-12)
    assert abs(ds.small_strain.values[0, 0, 0, 0, 0]) > 0.2


def test_the_lie_algebra_element_exponentiates_to_the_motion() -> None:
    element = make_field(GENERAL).sixflow.lie_algebra_element
    assert element.dims == ("time", "y", "x", "param")
    np.testing.assert_allclose(convention.exp_six(element.values), np.broadcast_to(GENERAL, element.shape))


def test_what_does_not_exist_is_nan() -> None:
    ds = make_field(np.array([0, 0, 0, 0, 4.0, 0])).sixflow  # x → 3x, y → −y: folds
    for name in ("lie_algebra_element", "hencky", "almansi", "rotation_angle", "vorticity", "strain_rate"):
        assert np.isnan(getattr(ds, name)).all(), name
        assert np.isnan(ds.standard_error(name)).all(), name
    assert np.isfinite(ds.green_lagrange).all()
    np.testing.assert_allclose(ds.area_ratio, -3)


@pytest.mark.parametrize("measure", MEASURES)
def test_principal_axes_diagonalise(measure: str) -> None:
    ds = make_field(GENERAL).sixflow
    tensor = getattr(ds, measure)
    values, axes = ds.principal_values(measure), ds.principal_axes(measure)
    assert values.dims[-1] == "principal"
    rebuilt = xr.dot(axes * values, axes.rename(i="j"), dim="principal")
    np.testing.assert_allclose(rebuilt.transpose(*tensor.dims), tensor, atol=1e-14)
    np.testing.assert_allclose(
        ds.max_shear(measure), values.sel(principal="major") - values.sel(principal="minor")
    )
    np.testing.assert_allclose(
        np.tan(ds.principal_angle(measure)),
        axes.sel(i="y", principal="major") / axes.sel(i="x", principal="major"),
    )


def test_rates_are_per_frame_until_the_interval_is_known() -> None:
    field = make_field(GENERAL)
    per_frame = field.sixflow.vorticity
    assert per_frame.attrs["units"] == "1/frame"
    per_second = field.sixflow.calibrate(frame_interval=0.5).sixflow.vorticity
    assert per_second.attrs["units"] == "1/s"
    np.testing.assert_allclose(per_second, 2 * per_frame)


def test_nothing_is_taken_from_the_times_of_neighbours() -> None:
    field = make_field(GENERAL, pairs=3, time_unit="s")
    assert field.sixflow.vorticity.attrs["units"] == "1/frame"
    known = field.assign_coords(interval=("time", [0.1, 0.1, 0.4], {"units": "s"})).sixflow.vorticity
    assert known.attrs["units"] == "1/s"
    for k, interval in enumerate((0.1, 0.1, 0.4)):
        np.testing.assert_allclose(known[k], field.sixflow.vorticity[k] / interval)


# Standard errors


def random_covariance(scale: float) -> Array:
    mix = np.random.default_rng(5).normal(size=(6, 6))
    return scale**2 * (mix @ mix.T / 6 + 0.2 * np.eye(6))


@pytest.mark.parametrize("name", [*SIX, *DERIVED])
def test_standard_errors_agree_with_monte_carlo(name: str) -> None:
    covariance = random_covariance(3e-4)
    truth = make_field(GENERAL, x=[8], y=[8], covariance=covariance, frame_interval=0.2)
    rng = np.random.default_rng(11)
    count = 4000
    draws = GENERAL + rng.multivariate_normal(np.zeros(6), covariance, size=(1, count))
    drawn = make_field(lambda _x, _y: draws, x=np.arange(count), y=[8], frame_interval=0.2)

    def value(ds: Any) -> Array:
        return ds.six.sel(param=name).values if name in SIX else ds.derive(name).values

    spread = value(drawn.sixflow).reshape(count, -1).std(axis=0)
    predicted = truth.sixflow.standard_error(name).values.ravel()
    # The standard deviation of a sample of n has a relative error of 1/√(2n); five of them.
    np.testing.assert_allclose(spread, predicted, rtol=5 / np.sqrt(2 * count))


def test_standard_errors_of_everything_share_the_dims_of_the_quantities() -> None:
    ds = make_field(GENERAL).sixflow
    errors = ds.standard_errors
    assert set(errors.data_vars) == {*SIX, *DERIVED}
    assert errors["hencky"].dims == ds.hencky.dims
    assert errors["hencky_principal_values"].dims == ds.principal_values("hencky").dims
    assert errors["u"].attrs["units"] == "px"
    assert errors["rotation_angle"].attrs["units"] == "rad"
    assert all("standard error" in errors[name].attrs["long_name"] for name in errors)


def test_the_axis_of_an_isotropic_tensor_has_no_standard_error() -> None:
    ds = make_field(np.array([0, 0, 0.1, 0, 0, 0])).sixflow
    assert np.isnan(ds.standard_error("green_lagrange_principal_angle")).all()


# Points


def test_failed_points_are_nan_in_every_quantity_and_others_are_not() -> None:
    field = spoil(spoil(make_field(GENERAL), 2, 3, "outlier"), 0, 0, "masked")
    ds = field.sixflow
    np.testing.assert_array_equal(ds.valid, ds.flagged("outlier") | ds.flagged("masked") == False)  # noqa: E712
    assert ds.flagged("outlier").sum() == 1
    for name in ("hencky", "vorticity", "rotation_angle", "lie_algebra_element"):
        known = np.isfinite(getattr(ds, name).values).reshape(*ds.valid.shape, -1).all(axis=-1)
        np.testing.assert_array_equal(known, ds.valid.values)
        known = np.isfinite(ds.standard_error(name).values).reshape(*ds.valid.shape, -1).all(axis=-1)
        np.testing.assert_array_equal(known, ds.valid.values)


def test_border_points_are_valid_and_flagged_numbers_are_not() -> None:
    field = make_field(GENERAL)
    field["flag"][0, 0, :] = FLAGS["border"]
    field["flag"][0, 1, 1] = FLAGS["border"] | FLAGS["unmatched"]
    assert field.sixflow.valid.values[0, 0].all()
    assert not field.sixflow.valid.values[0, 1, 1]


def test_selections_keep_working() -> None:
    field = make_field(GENERAL, pairs=2)
    one = field.isel(time=1)
    assert one.sixflow.hencky.dims == ("y", "x", "i", "j")
    np.testing.assert_array_equal(one.sixflow.hencky, field.sixflow.hencky[1])
    turned = field.transpose("x", "y", "time", ...)
    assert turned.sixflow.hencky.dims[:3] == ("x", "y", "time")
    np.testing.assert_allclose(
        turned.sixflow.standard_error("hencky").transpose("time", "y", "x", ...),
        field.sixflow.standard_error("hencky"),
    )
    np.testing.assert_allclose(
        turned.sixflow.physical(1, "mm", 1, y_up=True)["vorticity"].transpose("time", "y", "x"),
        field.sixflow.physical(1, "mm", 1, y_up=True)["vorticity"],
    )


@pytest.mark.parametrize("kind", ["netcdf", "zarr"])
def test_a_field_read_back_has_the_accessor(kind: str, tmp_path: Any) -> None:
    field = spoil(make_field(GENERAL, pairs=2, pixel_size=0.1, frame_interval=0.01), 1, 1, "outlier")
    if kind == "netcdf":
        pytest.importorskip("h5py")
        field.to_netcdf(tmp_path / "field.nc", engine="h5netcdf")
        back = xr.open_dataset(tmp_path / "field.nc", engine="h5netcdf")
    else:
        field.to_zarr(tmp_path / "field.zarr", zarr_format=2)
        back = xr.open_zarr(tmp_path / "field.zarr", chunks=None)
    with back:
        np.testing.assert_array_equal(back.sixflow.valid, field.sixflow.valid)
        for name in ("hencky", "vorticity", "lie_algebra_element"):
            np.testing.assert_allclose(getattr(back.sixflow, name), getattr(field.sixflow, name))
        xr.testing.assert_allclose(back.sixflow.standard_errors, field.sixflow.standard_errors)
        xr.testing.assert_allclose(back.sixflow.physical(y_up=True), field.sixflow.physical(y_up=True))
        np.testing.assert_allclose(back.sixflow.dense()["u"], field.sixflow.dense()["u"])
        assert back.sixflow.summary() == field.sixflow.summary()


# Units


def test_physical_units() -> None:
    field = make_field(GENERAL, pixel_size=0.05, length_unit="cm", frame_interval=0.002)
    data = field.sixflow.physical()
    assert data["velocity_x"].attrs["units"] == "cm/s"
    assert data["vorticity"].attrs["units"] == "1/s"
    assert data["x"].attrs["units"] == "cm"
    np.testing.assert_allclose(data["velocity_x"], 0.3 * 0.05 / 0.002)
    np.testing.assert_allclose(data["velocity_x_standard_error"], 0.01 * 0.05 / 0.002)
    np.testing.assert_allclose(data["x"], field["x"] * 0.05)
    rates = convention.log_six(GENERAL) / 0.002
    for k, name in enumerate(("divergence_rate", "vorticity", "stretch_rate", "shear_rate"), start=2):
        np.testing.assert_allclose(data[name], rates[k])
        assert (data[f"{name}_standard_error"] > 0).all()
    assert "param" not in data.coords


def test_arguments_go_before_the_settings() -> None:
    field = make_field(GENERAL, pixel_size=0.05, frame_interval=0.002)
    np.testing.assert_allclose(
        field.sixflow.physical(pixel_size=1, frame_interval=1, length_unit="m")["velocity_y"], -1.2
    )
    assert field.sixflow.physical(length_unit="m")["velocity_y"].attrs["units"] == "m/s"


def test_y_up_turns_signs_and_coordinates_but_no_array() -> None:
    field = make_field(lambda x, y: GENERAL * (1 + x / 100 + y / 50)[..., None])
    down, up = (field.sixflow.physical(1, "mm", 1, y_up=y_up) for y_up in (False, True))
    np.testing.assert_array_equal(up["y"], -down["y"])
    np.testing.assert_array_equal(up["x"], down["x"])
    for name in ("velocity_x", "divergence_rate", "stretch_rate"):
        np.testing.assert_allclose(up[name].values, down[name].values)
    for name in ("velocity_y", "vorticity", "shear_rate"):
        np.testing.assert_allclose(up[name].values, -down[name].values)
    for name in down:
        if str(name).endswith("_standard_error"):
            np.testing.assert_allclose(up[name].values, down[name].values)


def test_calibrate_returns_a_copy() -> None:
    field = make_field(GENERAL, window=31)
    known = field.sixflow.calibrate(pixel_size=0.1, length_unit="m", frame_interval=2)
    assert json.loads(known.attrs["settings"]) == {
        "window": 31, "pixel_size": 0.1, "length_unit": "m", "frame_interval": 2.0
    }  # fmt: skip
    assert json.loads(field.attrs["settings"]) == {"window": 31}
    assert json.loads(known.sixflow.calibrate(pixel_size=3).attrs["settings"])["length_unit"] == "m"


# Words


def test_summary_tells_points_flags_medians_and_settings() -> None:
    text = spoil(make_field(GENERAL, window=31), 0, 0, "outlier").sixflow.summary()
    assert "1 time × 7 y × 7 x = 49 points, 98.0 % valid" in text
    lines = {line.split()[0]: line for line in text.splitlines() if line}
    assert "2.0 %" in lines["outlier"]
    assert "0.0 %" in lines["masked"]
    assert "0.3" in lines["u"]
    assert "0.01" in lines["u"]
    assert lines["window"].endswith("31")


def test_summary_of_a_field_without_any_number() -> None:
    field = make_field(np.full(6, np.nan), covariance=np.full((6, 6), np.nan))
    assert "0.0 % valid" in field.sixflow.summary()


# Refusals


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda f: f.sixflow.standard_error("speed"), "'speed'.*there is no such quantity; there are u, v"),
        (lambda f: f.sixflow.derive("strain"), "'strain'.*there is no such quantity.*hencky_max_shear"),
        (lambda f: f.sixflow.principal_values("strain"), "measure='strain'.*green_lagrange"),
        (lambda f: f.sixflow.flagged("bad"), "'bad'.*masked"),
        (lambda f: f.sixflow.physical(), "pixel_size is unknown: give pixel_size=.*calibrate"),
        (lambda f: f.sixflow.physical(pixel_size=1), "frame_interval is unknown"),
        (lambda f: f.sixflow.physical(pixel_size=-1, frame_interval=1), "pixel_size=-1: must be a positive"),
        (lambda f: f.sixflow.physical(1, " ", 1), "length_unit=' '"),
        (lambda f: f.sixflow.calibrate(frame_interval="fast"), "frame_interval='fast'"),
        (lambda f: f.sixflow.calibrate(length_unit=3), "length_unit=3"),
        (lambda f: f.assign_attrs(settings="no").sixflow.vorticity, "settings='no': must be a JSON object"),
        (lambda f: f.drop_vars("covariance").sixflow.standard_error("u"), "no variable 'covariance'"),
        (lambda f: f.sixflow.dense().sixflow.standard_error("hencky"), "no variable 'covariance'"),
        (lambda f: f[["u", "v"]].sixflow, "lacks divergence, curl"),
        (lambda f: f.isel(x=0).sixflow, "y and x are needed"),
    ],
)
def test_refusals_name_the_argument_and_the_remedy(call: Callable[[xr.Dataset], Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        call(make_field(GENERAL))
