"""`sixflow interpret`: what it tells of a rendered approach, and what it refuses."""

from __future__ import annotations

import subprocess
import sys

import pytest

from interpreted import make_field, plane_in_view
from sixflow.cli import main
from sixflow.interpretation import fit_region, time_to_contact
from sixflow.scenes import Camera, Plane, RigidMotion
from sixflow.write import open_field, write_field

CAMERA = Camera(400.0, (79.5, 69.5))
PLANE = Plane.from_slant(2.0, 0.6, 0.5)


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """Return a folder with a field of a camera that approaches a slanted wall, and one over ground."""
    folder = tmp_path_factory.mktemp("fields")
    approach = plane_in_view(CAMERA, PLANE, RigidMotion((0.01, 0, 0.04)))
    write_field(make_field(approach, frame_interval=0.04), folder / "field.nc")
    flight = plane_in_view(CAMERA, Plane.ground(30.0, pitch=1.0471975511965976), RigidMotion((0.3, 0, 0)))
    write_field(make_field(flight), folder / "ground.nc")
    (folder / "text.nc").write_text("no field")
    return folder


@pytest.fixture(autouse=True)
def _there(place, monkeypatch):
    monkeypatch.chdir(place)
    monkeypatch.setenv("COLUMNS", "200")


def told(capsys, *arguments):
    """Run the command, and return what it prints as {title: {name: words}} with the assumptions under "assumed"."""
    assert main(["interpret", *arguments]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    sections, current = {}, {}
    for line in out.splitlines():
        if line and not line.startswith(" "):
            current = sections.setdefault(line, {})
        elif line.startswith("  assumed: "):
            current.setdefault("assumed", []).append(line.removeprefix("  assumed: "))
        elif line.strip():
            name, _, words = line.strip().partition("  ")
            current[name] = words.split()
    return sections


def test_what_is_told_by_default(capsys):
    found = told(capsys, "field.nc", "--focal", "400")
    with open_field("field.nc") as field:
        fit = fit_region(field)
    assert list(found) == [
        f"field.nc: region 0,0 to 159,139, 340 points, which stand for {fit.independent_points:.1f} independent ones",
        "motion of the region",
        "time to contact",
        "rotation about the line of sight",
        "fanning",
        "focus of expansion",
        "plane and motion, solution 1 of 2",
        "plane and motion, solution 2 of 2",
    ]
    assert all(section["assumed"] for title, section in found.items() if not title.startswith("field"))
    expected = time_to_contact(fit, CAMERA).time.written()
    assert found["time to contact"]["time"] == [expected[0], "±", expected[1], "s"]


def test_known_motion_region_and_units(capsys):
    found = told(
        capsys, "field.nc", "--focal=400", "--region", "20,20,140,120", "--rotation", "0,0,0",
        "--heading", "0.01,0,0.04", "--distance", "2", "--length-unit", "yd", "--frame-interval", "0.5",
    )  # fmt: skip
    assert next(iter(found)).startswith("field.nc: region 20,20 to 140,120, ")
    value, _, error, unit = found["slant of the surface"]["slant"]
    assert unit == "°"
    assert abs(float(value) - 34.38) < max(3 * float(error), 0.3)
    assert found["plane and motion, solution 1 of 2"]["V_Z"][-1] == "yd/s"
    assert found["time to contact"]["assumed"][0].endswith("are as given")


def test_negative_numbers_first(capsys):
    found = told(capsys, "field.nc", "--focal", "400", "--heading", "-1,0,4", "--point", "-5,3")
    assert "slant of the surface" in found


def test_ground_gives_the_ego_motion(capsys):
    found = told(capsys, "ground.nc", "--focal", "400", "--height", "30", "--pitch", "60")
    value, _, error, unit = found["ego-motion over the plane"]["V_X"]
    assert unit == "m/frame"
    assert float(value) == pytest.approx(0.3, abs=3 * float(error))
    assert found["ego-motion over the plane"]["time to contact"] == ["undetermined"]


def test_six_and_objects(capsys):
    found = told(
        capsys, "field.nc", "--focal", "400", "--coefficients", "six", "--border", "--centre", "80,70"
    )
    assert list(found)[1:] == ["motion of the region", "time to contact", "rotation about the line of sight"]
    found = told(capsys, "field.nc", "--focal", "400", "--of", "object")
    assert "focus of expansion" not in found


def test_narrow_terminals_keep_every_word(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "40")
    found = told(capsys, "field.nc", "--focal", "400")
    assert all("±" in words for words in found["fanning"].values() if words != found["fanning"]["assumed"])


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["field.nc"], "--focal"),
        (["--focal", "400"], "FIELD"),
        (["field.nc", "--focal", "0"], "focal=0.0: must be a finite number of px above 0"),
        (["field.nc", "--focal", "-800"], "focal=-800.0"),
        (["field.nc", "--focal", "wide"], "--focal"),
        (["field.nc", "--focal", "400", "--region", "1,2,3"], "--region 1,2,3: must be 4 numbers"),
        (["field.nc", "--focal", "400", "--region", "900,0,950,50"], "outside the frame of 160×140"),
        (["field.nc", "--focal", "400", "--region", "20,20,24,24"], "needs at least 4. Enlarge the region"),
        (["field.nc", "--focal", "400", "--heading", "0,0,0"], "heading=(0.0, 0.0, 0.0): must not be 0"),
        (["field.nc", "--focal", "400", "--heading", "a,b,c"], "--heading a,b,c: must be 3 numbers"),
        (["field.nc", "--focal", "400", "--rotation", "0,0,inf"], "--rotation 0,0,inf: must be 3 numbers"),
        (["field.nc", "--focal", "400", "--height", "-2"], "height=-2"),
        (["field.nc", "--focal", "400", "--height", "2", "--of", "object"], "of='camera'"),
        (["field.nc", "--focal", "400", "--distance", "0"], "distance=0"),
        (["field.nc", "--focal", "400", "--time", "3"], "time=3: the field has 1 pair(s)"),
        (["field.nc", "--focal", "400", "--frame-interval", "0"], "frame_interval=0"),
        (["field.nc", "--focal", "400", "--of", "wall"], "camera"),
        (["none.nc", "--focal", "400"], "none.nc: no such file"),
        (["text.nc", "--focal", "400"], "cannot be read as a field"),
        (["field.nc", "--focla", "400"], "Did you mean"),
    ],
)
def test_bad_input_is_2_and_one_line(capsys, arguments, text):
    assert main(["interpret", *arguments]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert len(err.splitlines()) == 1
    assert err.startswith("sixflow: error: ")
    assert text in err


def test_help_loads_nothing_heavy():
    heavy = "{'numpy', 'matplotlib', 'xarray', 'scipy', 'numba', 'sixflow.interpretation'}"
    code = f"import sys; from sixflow.cli import main; main(['interpret', '--help']); print({heavy} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "set()"
    assert "--heading" in done.stdout
