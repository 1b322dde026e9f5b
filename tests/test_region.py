"""The region of interest of the settings: rectangle, polygons, holes."""

import json

import matplotlib.path
import numpy as np
import pytest

from sixflow import InputError, Settings, measure, measure_sequence
from sixflow.cli import main
from sixflow.masks.outlines import inside_polygon, region_of
from sixflow.settings.region import as_polygons, as_rectangle
from sixflow.synth import Affine, Sensor, Speckle, sequence

SHAPE = (64, 96)
FRAMES = sequence(
    Speckle(seed=1), Affine.translation(0.7, -0.3), SHAPE, 3, sensor=Sensor(noise=1, bits=8)
).frames
TRIANGLE = [[10.5, 5], [90, 20.25], [30, 60]]


def measured(field):
    """Grid points that are not masked."""
    return (field.flag.values[0] & 1) == 0


@pytest.mark.parametrize("seed", range(5))
def test_polygons_are_those_of_matplotlib(seed):
    """No centre lies on these outlines, so that every rule agrees."""
    corners = np.random.default_rng(seed).uniform(-20, 110, (4, 2))
    hull = corners[np.argsort(np.arctan2(*(corners - corners.mean(axis=0)).T))]
    x, y = np.meshgrid(np.arange(SHAPE[1]), np.arange(SHAPE[0]))
    centres = np.stack([x.ravel(), y.ravel()], axis=-1)
    expected = matplotlib.path.Path(hull).contains_points(centres).reshape(SHAPE)
    np.testing.assert_array_equal(inside_polygon(SHAPE, hull), expected)


def test_polygons_that_share_an_edge_share_no_pixel():
    left, right = [(5, 5), (40, 5), (50, 55), (5, 55)], [(40, 5), (90, 5), (90, 55), (50, 55)]
    both = inside_polygon(SHAPE, [(5, 5), (90, 5), (90, 55), (5, 55)])
    np.testing.assert_array_equal(
        inside_polygon(SHAPE, left).astype(int) + inside_polygon(SHAPE, right), both
    )
    assert both.sum() == 85 * 50


def test_rectangles_are_slices():
    for text, rows, columns in (
        ("10:50,20:30", np.s_[20:30], np.s_[10:50]),
        (" 10 : , : 30 ", np.s_[:30], np.s_[10:]),
        (":,:", np.s_[:], np.s_[:]),
    ):
        wanted = np.zeros(SHAPE, bool)
        wanted[rows, columns] = True
        np.testing.assert_array_equal(region_of(SHAPE, text, (), ()), wanted)


@pytest.mark.parametrize(
    "roi",
    ["", "1:2", "1:2,3", "5:5,0:9", "9:2,0:9", "-5:9,0:9", "a:b,c:d", "1.5:9,0:9", "1:2,3:4,5:6", 7, (1, 2)],
)
def test_what_is_no_rectangle(roi):
    with pytest.raises(InputError, match="roi="):
        Settings(roi=roi)
    with pytest.raises(InputError):
        as_rectangle(roi)


@pytest.mark.parametrize(
    "polygons",
    [
        [[1, 2], [3, 4]],
        [[[1, 2], [3, 4], [5, 6]], [[1, 2]]],
        [[1, 2, 3], [4, 5, 6], [7, 8, 9]],
        "1,2 3,4",
        "1,2 3,4 x,y",
        [[np.nan, 1], [2, 3], [4, 5]],
        [[1e300, 1], [2, 3], [4, 5]],
        [[]],
        [[], []],
        7,
        None,
        {"a": 1},
        [["a", "b"]] * 3,
    ],
    ids=str,
)
def test_what_is_no_polygon(polygons):
    for name in ("polygons", "holes"):
        with pytest.raises(InputError, match=f"{name}="):
            Settings(**{name: polygons})


def test_one_form_for_arrays_lists_and_text():
    forms = (TRIANGLE, [TRIANGLE], np.array(TRIANGLE), "10.5,5 90,20.25 30,60", "10.5,5 90,20.25 30,60;")
    assert len({Settings(polygons=form) for form in forms}) == 1
    assert as_polygons((), "polygons") == as_polygons("", "polygons") == ()
    settings = Settings(polygons=TRIANGLE, holes=[TRIANGLE, TRIANGLE], roi="1:9,:")
    assert Settings.from_json(settings.to_json()) == settings


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"roi": "0:97,0:64"}, "96 columns"),
        ({"roi": "96:,:"}, "96 columns"),
        ({"roi": ":,:65"}, "64 rows"),
        ({"polygons": [[200, 200], [220, 200], [200, 220]]}, "polygon 0 holds no pixel"),
        ({"holes": [TRIANGLE, [[200, 200], [220, 200], [200, 220]]]}, "polygon 1 holds no pixel"),
        ({"roi": "0:5,0:5", "polygons": TRIANGLE}, "no pixel is left"),
        ({"roi": "20:40,20:30", "mask": "left"}, "no pixel in common"),
    ],
    ids=str,
)
def test_regions_that_hold_nothing(settings, said):
    options = dict(settings)
    if options.pop("mask", None):
        options["mask"] = np.arange(SHAPE[1]) < np.full(SHAPE, 15)
    with pytest.raises(InputError, match=said):
        measure(FRAMES[0], FRAMES[1], step=8, **options)


def test_what_is_measured_is_inside():
    field = measure(
        FRAMES[0], FRAMES[1], step=4, polygons=TRIANGLE, holes=[[30, 20], [50, 20], [50, 40], [30, 40]]
    )
    inside = inside_polygon(SHAPE, TRIANGLE) & ~inside_polygon(
        SHAPE, [[30, 20], [50, 20], [50, 40], [30, 40]]
    )
    np.testing.assert_array_equal(measured(field), inside[np.ix_(field.y, field.x)])


def test_a_region_is_the_mask_that_it_describes():
    mask = np.zeros(SHAPE, bool)
    mask[8:56, 16:80] = True
    by_mask = measure(FRAMES[0], FRAMES[1], step=8, mask=mask)
    by_roi = measure(FRAMES[0], FRAMES[1], step=8, roi="16:80,8:56")
    np.testing.assert_array_equal(by_roi.u, by_mask.u)
    assert by_roi.attrs["input_digest"] == by_mask.attrs["input_digest"]
    replayed = measure(FRAMES[0], FRAMES[1], settings=Settings.from_json(by_roi.attrs["settings"]))
    np.testing.assert_array_equal(replayed.u, by_roi.u)
    assert replayed.attrs == by_roi.attrs


def test_a_region_and_numbered_bodies():
    labels = np.ones(SHAPE, int)
    labels[:, 48:] = 5
    field = measure(FRAMES[0], FRAMES[1], step=8, mask=labels, roi="8:88,8:56")
    inside = region_of(SHAPE, "8:88,8:56", (), ())
    np.testing.assert_array_equal(field.body.values[0], (labels * inside)[np.ix_(field.y, field.x)])


@pytest.mark.parametrize("pairs", ["consecutive", "first", "incremental"])
def test_a_region_holds_for_every_pair(pairs):
    field = measure_sequence(FRAMES, pairs=pairs, step=8, roi="16:80,8:56")
    inside = region_of(SHAPE, "16:80,8:56", (), ())[np.ix_(field.y, field.x)]
    for time in range(2):
        np.testing.assert_array_equal((field.flag.values[time] & 1) == 0, inside)


def test_with_a_mask_for_each_frame_the_region_is_that_of_the_reference():
    """The partner of a pixel of the region may be out of it, as it may with a mask of frame 0 alone."""
    moving = np.ones((2, *SHAPE), bool)
    moving[:, :, 90:] = False
    field = measure(FRAMES[0], FRAMES[1], step=8, mask=moving, roi="16:80,8:56")
    alone = measure(FRAMES[0], FRAMES[1], step=8, roi="16:80,8:56")
    np.testing.assert_allclose(field.u, alone.u, atol=1e-3)


def test_on_the_command_line_and_in_a_file(tmp_path, monkeypatch):
    from PIL import Image

    monkeypatch.chdir(tmp_path)
    for number in range(2):
        Image.fromarray(FRAMES[number]).save(f"f{number}.png")
    tmp_path.joinpath("s.toml").write_text(f'polygons = [{TRIANGLE}]\nroi = "8:,8:"\nstep = 8\n')
    command = [
        "measure",
        "f0.png",
        "f1.png",
        "-o",
        "f.nc",
        "--settings",
        "s.toml",
        "--roi",
        "16:80,8:56",
        "-q",
    ]
    assert main(command) == 0
    import sixflow

    with sixflow.open_field("f.nc") as field:
        settings = json.loads(field.attrs["settings"])
        assert settings["roi"] == "16:80,8:56"
        assert settings["polygons"] == [TRIANGLE]
        inside = inside_polygon(SHAPE, TRIANGLE) & region_of(SHAPE, "16:80,8:56", (), ())
        np.testing.assert_array_equal(measured(field.load()), inside[np.ix_(field.y, field.x)])
    assert main([*command, "--overwrite", "--polygons", "0,0 3"]) == 2
    assert main([*command, "--overwrite", "--roi", "nonsense"]) == 2
