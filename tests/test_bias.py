"""What windows leave out: in standard errors, averages, samples and files."""

import shutil

import numpy as np
import pytest
import xarray as xr

import sixflow
from sixflow import convention, synth
from sixflow.field.dataset import SIX, build_field
from sixflow.write import open_field, write_field

SHAPE = (2, 4, 5)
VARIANCE = np.array([1e-4, 4e-4, 1e-6, 1e-6, 4e-6, 1e-6])
BIAS = np.array([9e-4, 0.0, 3e-6, 8e-6, 5e-6, 3e-6])


def made(bias=BIAS, six=(0.5, -0.25, 0.02, 0.1, 0.03, -0.01), pairs=SHAPE[0]):
    shape = (pairs, *SHAPE[1:])
    return build_field(
        six=np.tile(np.array(six), (*shape, 1)),
        covariance=np.tile(np.diag(VARIANCE), (*shape, 1, 1)),
        bias=None if bias is None else np.tile(np.asarray(bias), (*shape, 1)),
        residual=np.full(shape, 0.1),
        noise=np.full(shape, 2.0),
        resolution=np.full(shape, 100.0),
        flag=np.zeros(shape, np.uint16),
        x=np.arange(8, 8 + 8 * shape[2], 8),
        y=np.arange(8, 8 + 8 * shape[1], 8),
        time=np.arange(pairs, dtype=float),
        time_unit="frame",
        frame_numbers=[(2 * k, 2 * k + 1) for k in range(pairs)],
        attrs={"settings": "{}", "notes": "", "frame_shape": [40, 48]},
    )


def test_standard_errors_hold_both():
    field = made()
    for k, name in enumerate(SIX):
        np.testing.assert_allclose(field.sixflow.standard_error(name), np.sqrt(VARIANCE + BIAS)[k])
        noise = field.sixflow.standard_error(name, noise_only=True)
        np.testing.assert_allclose(noise, np.sqrt(VARIANCE)[k])


@pytest.mark.parametrize("name", ["area_ratio", "rotation_angle", "hencky_max_shear"])
def test_derived_quantities_carry_both(name):
    field = made()
    six = np.array([float(field[key][0, 0, 0]) for key in SIX])
    J = np.empty(6)
    for k in range(6):
        there = [
            field.assign({SIX[k]: field[SIX[k]] * 0 + six[k] + side * 1e-6}).sixflow.derive(name)[0, 0, 0]
            for side in (1, -1)
        ]
        J[k] = float(there[0] - there[1]) / 2e-6
    expected = np.sqrt(J**2 @ (VARIANCE + BIAS))
    np.testing.assert_allclose(field.sixflow.standard_error(name)[0, 0, 0], expected, rtol=1e-4)
    expected = np.sqrt(J**2 @ VARIANCE)
    np.testing.assert_allclose(
        field.sixflow.standard_error(name, noise_only=True)[0, 0, 0], expected, rtol=1e-4
    )


@pytest.mark.parametrize("bias", [None, np.full(6, np.nan)])
def test_a_bias_that_was_not_estimated_adds_nothing(bias):
    field = made(bias)
    np.testing.assert_allclose(field.sixflow.standard_error("u"), np.sqrt(VARIANCE[0]))
    assert field.sixflow.valid.all()


def test_a_selection_keeps_its_bias():
    field = made().isel(time=[1], x=[2, 3])
    np.testing.assert_allclose(field.sixflow.standard_error("curl"), np.sqrt((VARIANCE + BIAS)[3]))


def test_bias_does_not_average_out():
    """Noise of pairs that share no frame does."""
    mean = made(pairs=4).sixflow.mean("time")
    np.testing.assert_allclose(mean.bias, np.broadcast_to(BIAS, mean.bias.shape))
    np.testing.assert_allclose(mean.sixflow.standard_error("u"), np.sqrt(VARIANCE[0] / 4 + BIAS[0]))


def test_samples_carry_it_and_extended_maps_let_it_grow():
    field = made()
    inside = field.sixflow.sample(20.0, 20.0)
    assert float(inside.u_standard_error) == pytest.approx(np.sqrt((VARIANCE + BIAS)[0]))
    beyond = field.sixflow.sample(
        44.0, 8.0
    )  # 4 px right of the last column: u grows with u_x = (div + stretch)/2
    total = VARIANCE + BIAS
    assert float(beyond.u_standard_error) == pytest.approx(np.sqrt(total[0] + 16 * (total[2] + total[4]) / 4))


def test_physical_units_with_y_up():
    physical = made().sixflow.physical(pixel_size=0.1, frame_interval=0.5, y_up=True)
    np.testing.assert_allclose(physical.velocity_x_standard_error, 0.2 * np.sqrt((VARIANCE + BIAS)[0]))


@pytest.mark.parametrize("suffix", ["nc", "zarr"])
def test_files_keep_it(tmp_path, suffix):
    field = made()
    again = open_field(write_field(field, tmp_path / f"field.{suffix}")).load()
    xr.testing.assert_equal(again.bias, field.bias)
    old = open_field(write_field(made(None), tmp_path / f"old.{suffix}")).load()
    assert "bias" not in old
    np.testing.assert_allclose(old.sixflow.standard_error("u"), np.sqrt(VARIANCE[0]))


def test_a_bias_that_is_missing_may_be_of_any_size(tmp_path):
    """A copy of a store that was interrupted: that it was not estimated is another matter."""
    path = write_field(made(), tmp_path / "field.zarr")
    shutil.rmtree(path / "bias" / "c")
    assert np.isinf(open_field(path).load().sixflow.standard_error("u")).all()


def test_tables_tell_both(tmp_path):
    lines = write_field(made(), tmp_path / "field.csv").read_text().splitlines()
    names, row = (line.split(",") for line in [line for line in lines if not line.startswith("#")][:2])
    cells = dict(zip(names, row, strict=True))
    assert float(cells["u_se_px"]) == pytest.approx(np.sqrt((VARIANCE + BIAS)[0]))
    assert float(cells["u_bias_px"]) == pytest.approx(np.sqrt(BIAS[0]))


def test_a_change_of_the_reference_carries_both():
    """Of a field that refers to the middle frame: measures are of frame 0."""
    field = made().assign_attrs(settings='{"reference": "middle"}')
    six = np.array([float(field[key][0, 0, 0]) for key in SIX])
    first, spread = convention.propagate(
        convention.change_reference, six, np.diag(VARIANCE + BIAS), source="middle"
    )
    _, variance = convention.propagate(convention.area_ratio, first, spread)
    found = field.sixflow.standard_error("area_ratio")[0, 0, 0]
    np.testing.assert_allclose(found, np.sqrt(variance), rtol=1e-6)


def test_measured_fields_have_it():
    pair = synth.pair(synth.Speckle(), synth.Affine.translation(0.4, 0.2), (64, 64))
    field = sixflow.measure(pair.frame0, pair.frame1)
    assert field.bias.dims == ("time", "y", "x", "param")
    assert field.bias.dtype == field.u.dtype
    known = field.bias.values[~np.isnan(field.bias.values)]
    assert (known >= 0).all()
