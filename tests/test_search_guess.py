"""First guesses of every kind, and those that are none."""

import numpy as np
import pytest
import xarray as xr

import measured
from sixflow import (
    InputError,
    Settings,
    convention,
    measure,
    measure_sequence,
    open_field,
    write_field,
)
from sixflow.maps.grid import Grid
from sixflow.search.guess import maps_of_guess
from sixflow.synth import Affine, Sensor, pair

SIDE = 129
CENTRE = (64.0, 64.0)
MOTION = Affine((14.0, -9.0), ((0.1, -0.45), (0.5, 0.05)), CENTRE)
GRID = Grid.over((SIDE, SIDE), 8)


def made():
    return pair(measured.PATTERNS["speckle"](4), MOTION, (SIDE, SIDE), sensor=Sensor(noise=1))


def true_maps(motion=MOTION, grid=GRID):
    x, y = np.meshgrid(grid.x.astype(float), grid.y.astype(float))
    G = motion.gradient(x, y)
    return np.stack(
        [*motion.displacement(x, y), *(np.broadcast_to(part, x.shape) for part in G.reshape(*x.shape, 4).T)]
    )


def test_six_numbers_matrix_and_function_are_the_same_guess():
    six = MOTION.six(0.0, 0.0)
    matrix = convention.affine_from_six(six)
    expected = maps_of_guess(six, GRID)
    x, y = np.meshgrid(GRID.x, GRID.y)
    np.testing.assert_allclose(expected[:2], MOTION.displacement(x, y), atol=1e-10)
    np.testing.assert_allclose(expected[2:, 3, 2], np.ravel(MOTION.G))
    for guess in (list(six), matrix, matrix[:2], MOTION.displacement):
        np.testing.assert_allclose(maps_of_guess(guess, GRID), expected, atol=1e-9)


def test_a_field_of_another_grid_with_gaps():
    found = made()
    field = measure(found.frame0, found.frame1, step=12)
    assert 0.05 < measured.failed(field).mean() < 0.6
    maps = maps_of_guess(field, GRID)
    x, y = np.meshgrid(GRID.x, GRID.y)
    error = np.hypot(*(maps[:2] - MOTION.displacement(x, y)))
    assert error.max() < 1
    again = maps_of_guess(
        field.isel(time=0), Grid(int(field.x[0]), int(field.y[0]), 12, *field.u.shape[:0:-1])
    )
    known = ~measured.failed(field)
    np.testing.assert_array_equal(again[0][known], field.u.values[0][known])


@pytest.mark.parametrize("kind", ["six", "matrix", "function", "field"])
def test_a_guess_replaces_the_search(kind):
    found = made()
    guess = {
        "six": np.add(MOTION.six(0.0, 0.0), [1, -1, 0.01, 0, 0, 0.01]),
        "matrix": convention.affine_from_six(MOTION.six(0.0, 0.0)),
        "function": MOTION.displacement,
        "field": measure(found.frame0, found.frame1, step=16),
    }[kind]
    field = measure(found.frame0, found.frame1, search=guess)
    stored = Settings.from_json(field.attrs["settings"])
    if kind in (
        "six",
        "matrix",
    ):  # the settings replay the result; a field or a function is in the field itself
        again = measure(found.frame0, found.frame1, settings=stored)
    else:
        assert stored.search == "guess"
        with pytest.raises(InputError, match=r"field\.sixflow\.guess"):
            measure(found.frame0, found.frame1, settings=stored)
        again = measure(found.frame0, found.frame1, settings=stored, search=field.sixflow.guess)
    xr.testing.assert_allclose(again, field, rtol=1e-4, atol=1e-5)
    assert again.attrs["settings"] == field.attrs["settings"]
    good = ~measured.failed(field)
    error = np.abs(measured.errors(field, found)[good][:, :2])
    assert good.mean() > 0.5
    assert (error < np.maximum(0.3, 6 * measured.standard_errors(field)[good][:, :2])).all()


def test_a_guess_that_is_some_pixels_off_is_corrected_from_coarse_to_fine():
    found = made()
    field = measure(found.frame0, found.frame1, search=np.add(MOTION.six(0.0, 0.0), [8, 6, 0, 0, 0, 0]))
    right = np.abs(measured.errors(field, found)[..., 0]) < 0.3
    assert right.sum() > 0.5 * right.size


def test_every_pair_of_a_sequence_starts_from_the_guess():
    found = made()
    frames = [found.frame0, found.frame1, found.frame0]
    fields = measure_sequence(frames[:2], search=MOTION.displacement)
    np.testing.assert_array_equal(fields.u.values, measure(*frames[:2], search=MOTION.displacement).u.values)


@pytest.mark.parametrize(
    ("guess", "said"),
    [
        ([1, 2], "six numbers"),
        (np.zeros((4, 4)), "six numbers"),
        ("left", "must be one of 'auto', 'pyramid', 'spectrum'"),
        ("guess", "give the first guess itself"),
        ([1, 2, np.nan, 0, 0, 0], "finite"),
        ([[1, 0, 0], [0, 1, 0], [0, 1, 1]], "last row"),
        ([0, 0, -2, 0, 0, 0], "folds or collapses"),
        (object(), "six numbers"),
        (lambda x, y: x, "must return"),
        (lambda x: x, "must return"),
        (lambda x, y: (x[:2], y), "must return"),
        (lambda x, y: (x * np.inf, y), "not finite"),
    ],
)
def test_what_is_no_guess(guess, said):
    frames = np.random.default_rng(0).normal(size=(2, 64, 64))
    with pytest.raises(InputError, match=said):
        measure(*frames, search=guess)


def test_fields_that_are_no_guess():
    field = measure(*(made().frame0,) * 2, step=16)
    for spoiled, said in (
        (field.drop_vars("curl"), "no curl"),
        (field.isel(time=[0, 0]), "2 times"),
        (field.assign(u=field.u * np.nan), "no point with a value"),
        (field.assign_coords(x=field.x * 1.5), "equally spaced|whole pixels"),
        (field.assign_coords(x=field.x[::-1].values), "rising"),
        (field.assign(u=field.u.assign_attrs(units="m/s")), "physical units"),
    ):
        with pytest.raises(InputError, match=said):
            maps_of_guess(spoiled, GRID)


def test_settings_alone_hold_no_guess():
    frames = np.random.default_rng(0).normal(size=(2, 64, 64))
    with pytest.raises(InputError, match="give the first guess itself"):
        measure(*frames, settings=Settings(search="guess"))


def test_two_guesses_leave_two_records():
    found = made()
    fields = [measure(found.frame0, found.frame1, search=[u, 0, 0, 0, 0, 0], step=32) for u in (0.6, 0.5)]
    assert fields[0].attrs["settings"] != fields[1].attrs["settings"]
    with pytest.raises(InputError, match="numbers stands in its settings"):
        _ = fields[0].sixflow.guess


def test_a_guess_in_a_settings_file_and_as_text(tmp_path):
    path = tmp_path / "settings.toml"
    path.write_text("search = [0.5, 0, 0, 0.01, 0, 0]\nwindow = 41\n")
    settings = Settings.from_toml(path)
    assert settings == Settings(search="0.5, 0, 0, 0.01, 0, 0", window=41)
    assert Settings.from_json(settings.to_json()) == settings
    path.write_text("search = [[1, 0, 3], [0, 1, -2], [0, 0, 1]]\n")
    assert Settings.from_toml(path).search == ((1, 0, 3), (0, 1, -2))


@pytest.mark.parametrize("text", ["1,2", "a,b,c,d,e,f", "0,0,0,0,5,0", "nan,0,0,0,0,0", "[1, 2", "{"])
def test_settings_that_are_no_settings(text):
    with pytest.raises(InputError):
        Settings(search=text)
    with pytest.raises(InputError, match="settings"):
        Settings.from_json("[" + text)


def test_a_stored_guess_survives_the_file(tmp_path):
    """A recording measured from a function: every pair holds the guess, the store gives it back."""
    frames = np.stack([made().frame0, made().frame1, made().frame0])
    field = measure_sequence(frames, search=MOTION.displacement, step=64)
    path = write_field(field, tmp_path / "field.nc")
    with open_field(path) as back:
        guess = back.load().sixflow.guess
    x, y = (coordinate.astype(float) for coordinate in xr.broadcast(guess.x, guess.y))
    np.testing.assert_allclose(guess.u.transpose("x", "y"), MOTION.displacement(x, y)[0], atol=1e-9)
