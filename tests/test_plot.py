"""Plots: what is drawn, in which units and colours, and what is refused."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch

from sixflow.convention import six_from_gradient
from sixflow.drawing.look import FAILED_FACE, MASKED_FACE, new_figure, power_of_ten, signed_limit, with_power
from sixflow.drawing.saving import save_figure
from sixflow.errors import FieldFileError, InputError
from sixflow.field.dataset import FLAGS, SIX
from sixflow.plot import plot_arrows, plot_field, plot_glyphs, plot_map
from test_accessor import make_field, rotation, spoil

Array = np.ndarray[Any, Any]


def vortex(x: Array, y: Array) -> Array:
    dx, dy = (x - 33) / 20, (y - 25) / 20
    g = 2 * np.exp(-(dx**2 + dy**2) / 2)
    d = np.stack([-dy * g, dx * g], axis=-1)
    G = np.array([[dx * dy * g, (dy * dy - 1) * g], [(1 - dx * dx) * g, -dx * dy * g]]) / 20
    return six_from_gradient(d, np.moveaxis(G, (0, 1), (-2, -1)))


@pytest.fixture
def field() -> xr.Dataset:
    measured = make_field(vortex, pairs=2, pixel_size=0.05, frame_interval=0.002)
    return spoil(spoil(spoil(measured, 0, 0, "masked"), 0, 1, "masked"), 5, 5, "outlier")


@pytest.fixture
def frame() -> Array:
    return np.random.default_rng(0).integers(0, 255, (50, 66)).astype(np.uint8)


@pytest.fixture
def ax() -> Axes:
    return Figure(layout="constrained").add_subplot()


def draw(figure: Any) -> FigureCanvasAgg:
    """Draw a figure, so that its layout is settled."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return canvas


def pixel(ax: Axes, x: float, y: float) -> Array:
    """Colour, 0 to 1, drawn at a place of the axes."""
    picture = np.asarray(draw(ax.figure).buffer_rgba())
    column, row = ax.transData.transform((x, y))
    return picture[round(picture.shape[0] - row), round(column), :3] / 255


@pytest.mark.parametrize("units", ["px", "physical"])
@pytest.mark.parametrize("y_up", [False, True])
@pytest.mark.parametrize("with_frame", [False, True])
def test_the_whole_figure(field: xr.Dataset, frame: Array, units: Any, y_up: bool, with_frame: bool) -> None:
    figure = plot_field(
        field, frame if with_frame else None, units=units, y_up=y_up, time=1, title="a vortex"
    )
    draw(figure)
    titles = [ax.get_title(loc="left").replace("\n", " ") for ax in figure.axes]
    assert len(figure.axes) == 14
    if units == "px":
        assert titles[:3] == ["displacement", "deformation × 6", "u (px)"]
        assert "divergence (px/px)" in titles[6] or "divergence (10⁻³ px/px)" in titles[6]
        assert titles[7].startswith("standard error of divergence (")
        assert figure.axes[0].get_xlabel() == "x (px)"
    else:
        assert titles[2] == "velocity x (mm/s)"
        assert titles[8:10] == ["vorticity (1/s)", "standard error of vorticity (1/s)"]
        assert figure.axes[0].get_xlabel() == "x (mm)"
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels[0] == "masked"
    assert labels[1].startswith("failed (")


def test_without_standard_errors_covariance_flags_and_frame_shape(field: xr.Dataset) -> None:
    assert len(plot_field(field, standard_errors=False).axes) == 8
    bare = field[list(SIX)].isel(time=0)
    del bare.attrs["frame_shape"]
    figure = plot_field(bare)
    draw(figure)
    assert len(figure.axes) == 8


def test_legend_tells_why_points_failed_and_which_are_unresolved(field: xr.Dataset, ax: Axes) -> None:
    flag = field.flag.copy()
    bits = flag.values
    bits[bits != 0] = FLAGS["masked"]
    bits[0, 2:4, 2:4] = FLAGS["ambiguous"]
    bits[0, 5, 5] = FLAGS["unmatched"]
    bits[0, 6:8, 6:8] = FLAGS["unresolved"]
    figure = plot_field(field.assign(flag=flag))
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "failed (ambiguous, unmatched)" in labels
    assert "unresolved" in labels
    plot_map(field.assign(flag=flag), "u", ax)
    patches = [child for child in ax.get_children() if isinstance(child, PathPatch)]
    assert patches[-1].get_facecolor()[3] == 0  # the number shows


@pytest.mark.parametrize("suffix", ["png", "pdf", "svg"])
def test_saving(field: xr.Dataset, frame: Array, tmp_path: Any, suffix: str) -> None:
    path = tmp_path / f"field.{suffix}"
    plot_field(field, frame, path=path)
    start = {"png": b"\x89PNG", "pdf": b"%PDF", "svg": b"<?xml"}[suffix]
    assert path.read_bytes().startswith(start)


def test_nothing_global_is_changed(field: xr.Dataset) -> None:
    before = dict(mpl.rcParams)
    plot_field(field)
    assert dict(mpl.rcParams) == before


def test_masked_failed_and_small_values_look_different(field: xr.Dataset, ax: Axes) -> None:
    image = plot_map(field, "u", ax, limit=100.0)  # every value is small
    patches = [child for child in ax.get_children() if isinstance(child, PathPatch)]
    assert len(patches) == 2
    assert patches[0].get_hatch() != patches[1].get_hatch()
    assert patches[0].get_facecolor()[:3] == to_rgb(MASKED_FACE)
    assert patches[1].get_facecolor()[:3] == to_rgb(FAILED_FACE)
    masked, failed, small = (
        np.mean([pixel(ax, x + dx, y) for dx in np.linspace(-2, 2, 9)], axis=0)
        for x, y in ((8, 6), (48, 36), (32, 24))
    )
    assert np.linalg.norm(masked - small) > 0.15
    assert np.linalg.norm(failed - small) > 0.3
    assert np.linalg.norm(failed - masked) > 0.2
    assert np.ma.getmaskarray(image.get_array())[5, 5]


@pytest.mark.parametrize("name", SIX)
def test_limits_are_symmetric_and_robust(field: xr.Dataset, ax: Axes, name: str) -> None:
    field[name][0, 3, 3] = 1000.0
    low, high = plot_map(field, name, ax).get_clim()
    assert low == -high
    assert high < 1000


def test_a_standard_error_has_a_sequential_scale_from_zero(field: xr.Dataset, ax: Axes) -> None:
    image = plot_map(field, "curl", ax, standard_error=True)
    assert image.get_clim()[0] == 0
    assert ax.get_title(loc="left") == "standard error of\ncurl (10⁻³ px/px)"


def test_pure_noise_stays_pale() -> None:
    noise = np.random.default_rng(2).normal(size=10000)
    assert signed_limit(noise * 0.5, np.ones(10000)) == pytest.approx(3)
    assert signed_limit(noise * 10, np.ones(10000)) == pytest.approx(25.76, rel=0.05)
    assert signed_limit(np.full(3, np.nan), None) == 1


def test_powers_of_ten_in_units() -> None:
    assert [power_of_ten(limit) for limit in (0.1, 999, 0.02, 2e-5, 1e3, 5e6)] == [0, 0, -3, -6, 3, 6]
    assert with_power("px/px", -3) == "10⁻³ px/px"
    assert with_power("", 6) == "10⁶"


@pytest.mark.parametrize(
    "name", ["residual", "noise", "vorticity", "rotation_angle", "area_ratio", "hencky_max_shear"]
)
def test_maps_of_other_numbers(field: xr.Dataset, ax: Axes, name: str) -> None:
    plot_map(field, name, ax)
    draw(ax.figure)
    assert ax.get_title(loc="left").startswith(name.replace("_", " "))


def test_y_up_turns_signs_and_axis_but_not_the_picture(field: xr.Dataset) -> None:
    down, up = (Figure().add_subplot() for _ in range(2))
    images = [plot_map(field, "curl", ax, y_up=y_up) for ax, y_up in ((down, False), (up, True))]
    np.testing.assert_allclose(images[1].get_array(), -images[0].get_array())
    assert down.yaxis_inverted()
    assert not up.yaxis_inverted()
    assert down.get_ylim() == (49.5, -0.5)
    assert up.get_ylim() == (-49.5, 0.5)


def test_map_cells_are_centred_on_the_grid_points(field: xr.Dataset, ax: Axes) -> None:
    left, right, bottom, top = plot_map(field, "u", ax).get_extent()
    assert (left, right, bottom, top) == (4, 60, 45, 3)
    assert ax.get_xlim() == (-0.5, 65.5)
    assert ax.get_aspect() == 1


@pytest.mark.parametrize("y_up", [False, True])
def test_arrows_point_where_the_motion_goes(ax: Axes, y_up: bool) -> None:
    quiver = plot_arrows(make_field(np.array([1.0, 2.0, 0, 0, 0, 0])), ax, y_up=y_up)
    draw(ax.figure)
    # Downwards on the screen for a positive v, whatever the direction of the axis.
    tip = ax.transData.transform((10 + quiver.U[0], quiver.V[0])) - ax.transData.transform((10, 0))
    assert tip[0] > 0
    assert tip[1] == pytest.approx(-2 * tip[0])
    assert len(quiver.U) == 49
    texts = [text.get_text() for text in ax.texts]
    assert texts == ["2 px"]


def test_failed_points_have_no_arrow_but_a_cross(field: xr.Dataset, frame: Array, ax: Axes) -> None:
    quiver = plot_arrows(field, ax, frame)
    assert len(quiver.U) == 49 - 3
    assert [tuple(line.get_xydata()[0]) for line in ax.lines] == [(48, 36)]


@pytest.mark.parametrize("y_up", [False, True])
def test_glyphs_turn_clockwise_for_positive_curl_and_stay_circles(ax: Axes, y_up: bool) -> None:
    angle = 0.1
    field = make_field(rotation(angle), x=[8, 16], y=[8, 16], frame_shape=(24, 24))
    ellipses = plot_glyphs(field, ax, exaggerate=4, y_up=y_up)
    draw(ax.figure)
    outline = ellipses.get_paths()[0].vertices
    radii = np.hypot(*(outline - outline[:-1].mean(axis=0)).T)
    np.testing.assert_allclose(radii, radii[0])
    mark = ax.collections[-1].get_segments()[0]
    start, end = ax.transData.transform(mark)
    # From straight up (0, 1) clockwise by four times the angle.
    assert np.arctan2(*(end - start)) == pytest.approx(4 * angle)
    assert ax.get_title(loc="left") == "deformation × 4"


def test_glyphs_of_noise_are_not_exaggerated_beyond_their_errors(ax: Axes) -> None:
    noise = np.random.default_rng(0).normal(size=(7, 7, 6)) * 0.01
    plot_glyphs(make_field(lambda _x, _y: noise), ax)
    assert float(ax.get_title(loc="left").split("×")[1]) <= 20


def test_fields_at_rest_without_numbers_and_of_one_point(frame: Array) -> None:
    for field in (
        make_field(np.zeros(6)),
        make_field(np.full(6, np.nan), covariance=np.full((6, 6), np.nan)),
        make_field(np.ones(6), x=[30], y=[20]),
        make_field(np.array([0, 0, 0, 0, 5.0, 0])),
    ):
        draw(plot_field(field, frame))


def test_frames_in_colour_float_constant_and_with_nan(field: xr.Dataset, frame: Array) -> None:
    spotted = frame.astype(float)
    spotted[3, 3] = np.nan
    for picture in (np.stack([frame] * 3, axis=-1), spotted, np.zeros((50, 66)), frame > 100):
        draw(plot_arrows(field, Figure().add_subplot(), picture).figure)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda f, ax: plot_field("field.nc"), "field is a str: give the xarray.Dataset"),
        (lambda f, ax: plot_field(f["u"]), "field is a DataArray"),
        (lambda f, ax: plot_field(f, time=2), r"time=2: the field has 2 pair\(s\), positions 0 to 1"),
        (lambda f, ax: plot_field(f, time=0.5), "time=0.5: must be the position of a pair"),
        (lambda f, ax: plot_field(f, units="mm"), "units='mm': must be 'px' or 'physical'"),
        (lambda f, ax: plot_field(f.assign_attrs(settings="{}"), units="physical"), "pixel_size is unknown"),
        (lambda f, ax: plot_field(f, np.zeros((50, 60))), "frame of 50×60 px: .* 50×66 px"),
        (lambda f, ax: plot_field(f, np.zeros(5)), r"frame of shape \(5,\)"),
        (lambda f, ax: plot_field(f, "frame.tif"), "frame of shape"),
        (lambda f, ax: plot_field(f, arrows=0), "0 marks along the longer side"),
        (lambda f, ax: plot_field(f, exaggerate=-1), "exaggerate=-1"),
        (lambda f, ax: plot_field(f, path="field.docx"), "path='field.docx'"),
        (lambda f, ax: plot_map(f, "speed", ax), "name='speed': .*there are u, v"),
        (lambda f, ax: plot_map(f, "hencky", ax), "name='hencky'"),
        (lambda f, ax: plot_map(f, "noise", ax, standard_error=True), "'noise' has no standard error"),
        (lambda f, ax: plot_map(f, "u", ax, limit=0), "limit=0"),
        (lambda f, ax: plot_map(f, "u", None), "ax is a NoneType: give axes of matplotlib"),
        (lambda f, ax: plot_arrows(f, np.zeros((50, 66))), "ax is a ndarray: give axes of matplotlib"),
    ],
)
def test_refusals(field: xr.Dataset, ax: Axes, call: Callable[[Any, Any], Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        call(field, ax)


def test_a_figure_that_cannot_be_saved(field: xr.Dataset, tmp_path: Any) -> None:
    with pytest.raises(FieldFileError, match=r"cannot be saved as .*field\.png"):
        plot_field(field, path=tmp_path / "no such folder" / "field.png")


def test_a_figure_appears_whole_or_not_at_all(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "figure.png"
    figure = new_figure(1, 1)
    save_figure(figure, path)
    earlier = path.read_bytes()
    assert earlier[:4] == b"\x89PNG"

    def stops_half_way(self: Any, target: Any, **options: Any) -> None:
        target.write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Figure, "savefig", stops_half_way)
    with pytest.raises(FieldFileError, match="No space left"):
        save_figure(figure, path)
    assert path.read_bytes() == earlier
    assert list(tmp_path.iterdir()) == [path]


def test_a_figure_needs_a_format(tmp_path: Any) -> None:
    for name in ("figure", "figure.field"):
        with pytest.raises(InputError, match=r"end it in \.png"):
            save_figure(new_figure(1, 1), tmp_path / name)
    assert not list(tmp_path.iterdir())
