"""The demo: errors against exact truth agree with what was predicted, and files appear together."""

from __future__ import annotations

import numpy as np
import pytest
import tifffile
from PIL import Image

from sixflow.cli import main
from sixflow.demo import FILES, MOTION, PAIRS, SHAPE, run_demo
from sixflow.errors import FieldFileError
from sixflow.field.dataset import SIX
from sixflow.synth import LambOseen, relative
from sixflow.write import open_field


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("demo")


@pytest.fixture(scope="module")
def calls():
    return []


@pytest.fixture(scope="module")
def result(folder, calls):
    return run_demo(folder / "new", progress=lambda: calls.append(1))


def test_errors_are_those_that_were_predicted(result):
    assert [row.name for row in result.rows] == list(SIX)
    # 8000 points with overlapping windows are some 1000 independent ones: a share of 68 % is known to 1.5 %
    # errors hold what windows are expected to leave out where noise hides it, as of turbulence: this motion is smoother
    for row in result.rows:
        assert 0.8 < row.ratio < 1.15, row
        assert 0.64 < row.coverage_68 < 0.78, row
        assert 0.92 < row.coverage_95 < 0.98, row
        assert row.ratio == row.rms_error / row.rms_predicted
        assert row.largest > 4 * row.rms_error


def test_result_says_what_was_measured(result, calls):
    assert result.shape == SHAPE
    assert result.pairs == PAIRS == len(calls)
    assert result.points == PAIRS * 40 * 40
    assert result.valid > 0.99
    assert result.seconds_per_pair > 0


def test_files_are_what_they_are_said_to_be(result, folder):
    assert list(result.files) == [folder / "new" / name for name in FILES]
    assert sorted(path.name for path in (folder / "new").iterdir()) == sorted(FILES)
    frames = tifffile.imread(folder / "new" / "frames.tif")
    assert frames.shape == (PAIRS + 1, *SHAPE)
    assert frames.dtype == np.uint8
    with open_field(folder / "new" / "field.nc") as field:
        assert field.sizes["time"] == PAIRS
    for name in ("field.png", "truth.png"):
        with Image.open(folder / "new" / name) as image:
            assert image.width == 2280


def test_files_are_replaced_only_if_allowed(result, folder):
    with pytest.raises(FieldFileError, match=r"holds frames\.tif and 3 more already.*--overwrite"):
        run_demo(folder / "new")


def test_vortex_is_carried():
    drift = np.array(MOTION.drift)
    np.testing.assert_allclose(np.stack(MOTION.forward(*MOTION.vortex.centre)), MOTION.vortex.centre + drift)
    x, y = np.meshgrid([10.0, 150.0, 300.0], [20.0, 160.0])
    X, Y = MOTION.at(3.0).inverse(*MOTION.at(3.0).forward(x, y))
    np.testing.assert_allclose([X, Y], [x, y], atol=1e-9)
    # between any two frames it is the vortex at the place where it has been carried to
    centre = tuple(MOTION.vortex.centre + 2 * drift)
    step = LambOseen(angle=MOTION.vortex.angle, core=MOTION.vortex.core, centre=centre).six(x, y)
    step[..., :2] += drift
    np.testing.assert_allclose(relative(MOTION.at(2.0), MOTION.at(3.0)).six(x, y), step, atol=1e-9)


def test_command_prints_table_and_places(result, folder, capsys):
    assert main(["demo", "--output", str(folder / "new"), "--overwrite"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    for text in (*SIX, "ratio", "1.96 σ", "ms per pair", "truth.png", "--sharpen 2"):
        assert text in out
    assert main(["demo", "--output", str(folder / "new")]) == 2
