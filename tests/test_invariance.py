"""What must not change a measurement, or change it in a known way: turned frames, other grey values, what is far away,
and the order of things. How much may be left is derived in `invariant`.
"""

import numpy as np
import pytest

import measured
from invariant import (
    CASES,
    LATTICE,
    ROUNDING,
    SETTINGS,
    SHAPE,
    STEP,
    TOLERANCE,
    TURNED,
    assert_alike,
    assert_identical,
    assert_turned,
    field_of,
    fraction_of,
    in_doubt,
    plain_field,
    recording,
    turned,
)
from sixflow import convention, measure, measure_sequence

every_case = pytest.mark.parametrize(("kind", "name"), CASES)

FEW_PIXELS = pytest.mark.xfail(
    reason="a pixel that is weighed in one field alone changes what a window is said to leave out: 8 of 520 points are "
    "unresolved in one of the two",
    strict=False,
)

AXES = {
    "transposed": np.array([[0.0, 1.0], [1.0, 0.0]]),
    "left to right": np.diag([-1.0, 1.0]),
    "upside down": np.diag([1.0, -1.0]),
}


@pytest.mark.parametrize("how", TURNED)
def test_how_the_six_are_turned(how):
    """d' = A d and G' = A G A⁻¹ in the axes x' = A x."""
    six, A = np.random.default_rng(0).normal(size=6), AXES[how]
    turned = np.array(TURNED[how]) @ six
    np.testing.assert_allclose(convention.displacement(turned), A @ convention.displacement(six))
    np.testing.assert_allclose(convention.gradient(turned), A @ convention.gradient(six) @ np.linalg.inv(A))


@pytest.mark.parametrize("how", TURNED)
@pytest.mark.parametrize("kind", ["speckle", "dead", "unmatched"])
def test_turned_frames_give_the_turned_field(kind, how):
    other = field_of(turned(recording(kind), how), "default", kind)
    assert_turned(plain_field(kind, "default"), other, how, fraction_of(kind, "default"))


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        pytest.param(*case, marks=FEW_PIXELS if case == ("dead", "local") else ())
        for case in CASES
        if "lowpass" not in case[1]
    ],
)
def test_every_setting_turns_with_the_frames(kind, name):
    other = field_of(turned(recording(kind), "by 90°"), name, kind)
    assert_turned(plain_field(kind, name), other, "by 90°", fraction_of(kind, name))


@pytest.mark.parametrize(("step", "how"), [(1, "left to right"), (3, "upside down"), (6, "by 90°")])
def test_turned_frames_whose_lattice_does_not_map_onto_itself(step, how):
    """Grid points do, 0 to 84 and to 126 in steps of 1, 3 and 6; nodes 8 px apart from the first do not."""
    frames = recording(shape=(85, 127))
    assert_turned(field_of(frames, step=step), field_of(turned(frames, how), step=step), how, LATTICE)


# --- grey values -----------------------------------------------------------------------------------------------


GREY = [(kind, name, 0.37, -20.0) for kind, name in CASES]
GREY += [("speckle", "default", 1, 50.0), ("speckle", "default", 2, 0.0), ("dead", "local", 2, 0.0)]


@pytest.mark.parametrize(("kind", "name", "factor", "constant"), GREY)
def test_grey_values_have_no_unit(kind, name, factor, constant):
    field = plain_field(kind, name)
    other = field_of(factor * recording(kind) + constant, name, kind)
    fraction = ROUNDING if kind == "speckle" else in_doubt()
    assert_alike(measured.six_of(other), other.flag.values[0], field, fraction=fraction)
    given = np.isfinite(field.noise.values) & np.isfinite(other.noise.values)
    ratio = other.noise.values[given] / field.noise.values[given]
    expected = 1 if SETTINGS[name].get("lighting") == "local" else factor  # local contrast is the unit there
    np.testing.assert_allclose(ratio, expected, rtol=fraction / 10)


# --- what is far away ------------------------------------------------------------------------------------------

WINDOW = 15  # its Gaussian is cut 15 px from the point
FAR = 32  # px: a window to the changed pixels, and a window from there to the point
AROUND = 16  # px: a whole number of steps, and of tiles


def inner(field):
    """Points of a field that are far from its rim."""
    return measured.depth(field) >= FAR


SMALL_WINDOWS = ["default", "middle", "second", "euclidean", "gain+offset", "local", "lowpass", "eigenfilter"]
"""Without sharpening, whose passes reach over several windows."""


@pytest.mark.parametrize("name", SMALL_WINDOWS)
def test_what_is_cropped_far_away_was_not_seen(name):
    frames = recording(shape=(129, 161))
    field = field_of(frames[:, AROUND:-AROUND, AROUND:-AROUND], name, window=WINDOW)
    whole = field_of(frames, name, window=WINDOW)
    part = whole.sel(x=field.x.values + AROUND, y=field.y.values + AROUND)
    fraction = fraction_of("speckle", name)
    assert_alike(measured.six_of(part), part.flag.values[0], field, fraction=fraction, where=inner(field))


@pytest.mark.parametrize("name", SMALL_WINDOWS)
def test_padding_without_values_is_not_seen(name):
    frames = recording()
    field = field_of(frames, name, window=WINDOW)
    padded = np.pad(frames, ((0, 0), (AROUND, AROUND), (AROUND, AROUND)), constant_values=np.nan)
    around = field_of(padded, name, window=WINDOW)
    part = around.sel(x=field.x.values + AROUND, y=field.y.values + AROUND)
    fraction = max(in_doubt(WINDOW), fraction_of("speckle", name))
    assert_alike(measured.six_of(part), part.flag.values[0], field, fraction=fraction, where=inner(field))
    if SETTINGS[name].get("reference", "first") == "first":
        outside = np.pad(np.zeros(field.flag.shape[1:], bool), AROUND // STEP, constant_values=True)
        np.testing.assert_array_equal(measured.flagged(around, "masked"), outside)


# --- order -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("kind", "name"), [case for case in CASES if case[1].startswith("middle")])
def test_from_the_middle_the_way_back_is_the_opposite(kind, name):
    fraction = fraction_of(kind, name)
    back = field_of(recording(kind)[::-1], name, kind)
    assert_alike(-measured.six_of(back), back.flag.values[0], plain_field(kind, name), fraction=fraction)


SPLIT = [
    ("speckle", name) for name in ("default", "auto", "middle", "local", "gain+offset", "lowpass", "sharpen")
]
SPLIT += [("dead", "default"), ("unmatched", "default")]


@pytest.mark.parametrize(("kind", "name"), SPLIT)
def test_a_recording_may_be_split(kind, name):
    """Its first frame sets the grey constant, which is rounding; nothing else is carried from pair to pair."""
    frames = recording(kind, count=3)
    options = {"tolerance": TOLERANCE} | SETTINGS[name]
    whole = measure_sequence(frames, **options)
    assert_identical(measure_sequence(list(frames), **options), whole)
    for k in (0, 1):
        pair, expected = measure(*frames[k : k + 2], **options), whole.isel(time=slice(k, k + 1))
        fraction = ROUNDING if kind == "speckle" else in_doubt()
        assert_alike(measured.six_of(pair), pair.flag.values[0], expected, fraction=fraction)


@pytest.mark.parametrize(
    ("count", "name"), [(3, "default"), (3, "middle"), (3, "local"), (3, "eigenfilter"), (6, "default")]
)
def test_numbers_of_bodies_are_names(count, name):
    """Up to three are searched one by one, more of them first in common."""
    y, x = np.indices(SHAPE)
    numbers = 1 + np.minimum(x * 3 // SHAPE[1], 2) + (3 * (y > SHAPE[0] // 2) if count == 6 else 0)
    mask = np.where((x + y) % 97 < 4, 0, numbers)
    named = np.random.default_rng(count).permutation(count) + 1
    field = field_of(recording(), name, mask=mask, window=21)
    other = field_of(recording(), name, mask=np.where(mask > 0, named[mask - 1] + 10, 0), window=21)
    body = field.body.values
    np.testing.assert_array_equal(other.body.values, np.where(body > 0, named[body - 1] + 10, 0))
    assert_identical(other.drop_vars("body"), field.drop_vars("body"))
