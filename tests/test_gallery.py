"""The gallery: what is drawn is what it is said to be, texts do not collide, and files come whole or not at all."""

from __future__ import annotations

import base64
import dataclasses
import io
import itertools
import re
from xml.etree import ElementTree

import matplotlib as mpl
import numpy as np
import pytest
from PIL import Image

from sixflow.eigenfilters import canonical, correlation_surface
from sixflow.eigenfilters.generators import BY_NAME
from sixflow.errors import FieldFileError, InputError
from sixflow.gallery import CATALOGUE, PAGE, write_gallery, writing
from sixflow.gallery import kernels as k
from sixflow.gallery import maps as m
from sixflow.gallery import quadrature as q
from sixflow.gallery.look import oklab_to_rgb, signed_map
from sixflow.gallery.page import make_page

OPERATORS = (k.X_TRANSLATION, k.Y_TRANSLATION, k.DIVERGENCE, k.CURL, k.STRETCH, k.SHEAR)
SIGNATURES = {"png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF"}


@pytest.fixture(scope="module")
def figures():
    """Return all figures, drawn once, by name; nothing global is changed by drawing."""
    before = dict(mpl.rcParams)
    drawn = {}
    for entry in CATALOGUE:
        drawn[entry.name] = entry.draw()
        drawn[entry.name].canvas.draw()
        drawn[entry.name].set_layout_engine("none")
    assert dict(mpl.rcParams) == before
    return drawn


@pytest.fixture
def quick(figures, monkeypatch):
    """Let the gallery be four figures that are drawn already, at a low resolution."""
    entries = tuple(
        dataclasses.replace(entry, draw=lambda name=entry.name: figures[name]) for entry in CATALOGUE[:4]
    )
    monkeypatch.setattr(writing, "CATALOGUE", entries)
    monkeypatch.setattr(writing, "DPI", 40)
    monkeypatch.setattr(writing, "PAGE_DPI", 30)
    return entries


class TestKernels:
    @pytest.mark.parametrize("operator", OPERATORS, ids=lambda o: o.kernel.label)
    def test_phase_follows_the_deformation(self, operator):
        """With the Jacobian, J w at the moved point is exp(−iuτ) times J w, as the measure is invariant."""
        kernel = operator.kernel
        x, y = np.random.default_rng(0).uniform(-9, 9, (2, 200))
        for name, order in zip(kernel.generators, kernel.orders, strict=True):
            generator, tau = BY_NAME[name], 0.05
            X, Y = generator.flow(tau, x, y)
            moved = k.eigenfunction(kernel, X, Y, jacobian=True) * np.exp(tau * generator.divergence)
            still = k.eigenfunction(kernel, x, y, jacobian=True)
            np.testing.assert_allclose(moved / still, np.exp(-1j * order * tau), rtol=1e-9)

    def test_printed_formulas(self):
        x, y = np.random.default_rng(1).uniform(0.5, 9, (2, 100))
        y = y * 0.9 * np.minimum(1, x / y)  # 0 < y < x, where all of the paper's formulas have a value
        printed = (
            np.exp(-1.5j * x),
            np.exp(-1.0j * y),
            np.exp(-6j * np.log((x**2 + y**2) ** 0.5)),
            np.exp(-6j * np.arctan(y / x)),
            np.exp(3j * 0.5 * np.log(y / x)),
            np.exp(-3j * np.arctanh(y / x)),
        )
        for operator, expected in zip(OPERATORS, printed, strict=True):
            drawn = k.eigenfunction(operator.kernel, x, y, sectors=operator.printed)
            np.testing.assert_allclose(drawn, expected, rtol=0, atol=1e-12)

    def test_print_has_no_value_in_two_sectors(self):
        x, y = np.meshgrid(np.linspace(-5, 5, 30), np.linspace(-5, 5, 28))
        for operator, somewhere in ((k.STRETCH, x * y > 0), (k.SHEAR, np.abs(y) < np.abs(x))):
            drawn = k.eigenfunction(operator.kernel, x, y, sectors=operator.printed)
            np.testing.assert_array_equal(np.isnan(drawn.real), ~somewhere)
            np.testing.assert_array_equal(np.isnan(drawn.imag), ~somewhere)
            regular = canonical(*operator.kernel.generators).sector(x, y) >= 0
            np.testing.assert_array_equal(np.isnan(k.eigenfunction(operator.kernel, x, y)), ~regular)

    @pytest.mark.parametrize("operator", OPERATORS, ids=lambda o: o.kernel.label)
    def test_localised_kernel_is_the_eigenfunction_under_an_envelope(self, operator):
        """Without its DC term, a kernel of the library has the phase that is drawn beside it."""
        kernel, radius = operator.kernel, operator.radius
        y, x = np.mgrid[-radius : radius + 1, -radius : radius + 1].astype(float)
        drawn = k.eigenfunction(kernel, x, y)
        terms = kernel._terms(x.ravel(), y.ravel())
        inside = terms.envelope > 1e-3 * terms.envelope.max()
        np.testing.assert_allclose(terms.carrier[inside], drawn.ravel()[inside], rtol=0, atol=1e-9)

    def test_singular_lines_are_not_sampled_and_not_drawn(self):
        for operator in OPERATORS:
            x, y = k._points(operator.radius + 0.5)
            coordinates = canonical(*operator.kernel.generators)
            assert (coordinates.sector(*np.broadcast_arrays(x, y)) >= 0).all()
        assert np.isnan(k.eigenfunction(k.SHEAR.kernel, 2.0, 2.0, jacobian=True))
        for operator in (k.STRETCH, k.SHEAR):
            angle = np.radians(operator.singular)
            distance = canonical(*operator.kernel.generators).singular_distance(np.cos(angle), np.sin(angle))
            np.testing.assert_allclose(distance, 0, atol=1e-15)

    def test_scales_are_symmetric_and_as_the_captions_say(self):
        for operator in OPERATORS:
            for form in k._forms(operator):
                assert form.norm.vmin == -form.norm.vmax
                if "Jacobian" in form.title:
                    assert form.norm.vmax == pytest.approx(0.1)
                else:
                    largest = max(np.nanmax(np.abs(part)) for part in (form.values.real, form.values.imag))
                    assert largest == pytest.approx(form.norm.vmax, rel=1e-3)


class TestQuadrature:
    def test_pairs(self):
        printed, equal, free = q.quadrature_pairs()
        x = np.arange(-q.RADIUS, q.RADIUS + 1)
        window = np.exp(-(x**2) / (2 * q.SIGMA**2))
        for pair, kernels in (
            (printed, (np.cos(q.FREQUENCY * x), -np.sin(q.FREQUENCY * x))),
            (equal, (np.cos(q.FREQUENCY * x - np.pi / 4), np.cos(q.FREQUENCY * x + np.pi / 4))),
        ):
            gain = np.abs(pair.weights[q.RADIUS])
            np.testing.assert_allclose(pair.weights.real, gain * window * kernels[0], atol=1e-12)
            np.testing.assert_allclose(pair.weights.imag, gain * window * kernels[1], atol=1e-12)
        sums = equal.weights.sum()
        assert sums.real == pytest.approx(sums.imag)
        assert sums.real > 0.05
        assert abs(free.weights.sum()) < 1e-12

    def test_response_is_that_of_the_shifted_pattern(self):
        """g(τ) of the formula in the module's docstring, with ŵ summed directly."""
        x, shifts = np.arange(-q.RADIUS, q.RADIUS + 1), np.linspace(0, q.WAVELENGTH, 33)
        u, a = q.FREQUENCY, q.AMPLITUDE
        for pair in q.quadrature_pairs():
            transform = {k: (pair.weights * np.exp(1j * k * x)).sum() for k in (0, u, -u)}
            expected = q.MEAN * transform[0] + a / 2 * (
                transform[u] * np.exp(-1j * u * shifts) + transform[-u] * np.exp(1j * u * shifts)
            )
            np.testing.assert_allclose(pair.response(q.grating(), shifts), expected, rtol=0, atol=1e-9)

    def test_what_the_caption_says(self):
        shifts = np.linspace(0, q.WAVELENGTH, 321)
        bends = []
        for pair in q.quadrature_pairs():
            phase = np.unwrap(np.angle(pair.response(q.grating(), shifts)))
            bends.append(np.abs(phase - phase[0] + q.FREQUENCY * shifts).max())
        caption = next(entry.caption for entry in CATALOGUE if entry.label == "Figure 4")
        assert f"{bends[0]:.2f} rad" in caption
        assert f"a shift of {bends[0] / q.FREQUENCY:.1f} px" in caption
        assert (
            f"{100 * np.sin(bends[0]):.0f} % of its radius" in caption
        )  # the centre's distance is sin of it
        assert bends[1] == pytest.approx(bends[0])
        assert f"{bends[2]:.2f} rad" in caption


class TestMaps:
    @pytest.mark.parametrize("case", [m.ZOOM_AND_ROTATION, m.STRETCH_AND_ZOOM, m.SHEAR_AND_ZOOM])
    def test_correlation_gives_what_was_made(self, case):
        maps = [case.map(frame) for frame in case.frames()]
        found = correlation_surface(*maps)
        steps = [float(np.diff(maps[0][axis][:2])[0]) for axis in ("eta", "xi")]
        assert abs(found.tau_eta - case.tau_eta) < 0.02 * steps[0]
        assert abs(found.tau_xi - case.tau_xi) < 0.02 * steps[1]

    @pytest.mark.parametrize("case", [m.ZOOM_AND_ROTATION, m.STRETCH_AND_ZOOM, m.SHEAR_AND_ZOOM])
    def test_points_go_with_the_pattern_and_stay_on_the_maps(self, case):
        motion, still = case.motion(), case.map(case.frames()[0])
        for eta, xi, sector in case.followed:
            before = [m.HALF + c for c in case.coordinates.inverse(eta, xi, sector)]
            after = [
                m.HALF + c for c in case.coordinates.inverse(eta + case.tau_eta, xi + case.tau_xi, sector)
            ]
            np.testing.assert_allclose(motion.forward(*before), after, rtol=0, atol=1e-9)
            for axis, ends in (("eta", (eta, eta + case.tau_eta)), ("xi", (xi, xi + case.tau_xi))):
                assert still[axis].min() < min(ends)
                assert max(ends) < still[axis].max()


def to_oklab(rgb):
    """Colours of sRGB in OKLab, from the published matrices of the forward direction."""
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    to_lms = [[0.4122214708, 0.5363325363, 0.0514459929], [0.2119034982, 0.6806995451, 0.1073969566],
              [0.0883024619, 0.2817188376, 0.6299787005]]  # fmt: skip
    to_lab = [[0.2104542553, 0.7936177850, -0.0040720468], [1.9779984951, -2.4285922050, 0.4505937099],
              [0.0259040371, 0.7827717662, -0.8086757660]]  # fmt: skip
    return np.cbrt(linear @ np.transpose(to_lms)) @ np.transpose(to_lab)


class TestColours:
    def test_steps_are_even_and_zero_is_white(self):
        lab = to_oklab(signed_map()(np.linspace(0, 1, 513))[:, :3])
        steps = np.linalg.norm(np.diff(lab, axis=0), axis=1)
        assert steps.max() / steps.min() < 1.001
        np.testing.assert_allclose(lab[256], [1, 0, 0], atol=1e-6)
        assert lab[0, 0] == pytest.approx(lab[-1, 0], abs=1e-6)  # equal lightness at both ends

    def test_conversion_returns(self):
        rgb = np.random.default_rng(2).uniform(0, 1, (50, 3))
        np.testing.assert_allclose(oklab_to_rgb(to_oklab(rgb)), rgb, atol=1e-5)


def boxes(figure):
    """Texts of a figure with their extents, px; empty and invisible ones left out."""
    renderer = figure.canvas.get_renderer()
    found = []
    for text in figure.findobj(mpl.text.Text):
        if text.get_visible() and text.get_text().strip() and shown(text, figure):
            found.append((text.get_text(), text.get_window_extent(renderer)))
    return found


def shown(text, figure):
    """Whether a text is a tick label that is out of the limits, which is not drawn."""
    for ax in figure.axes:
        for axis, limits in ((ax.xaxis, ax.get_xlim()), (ax.yaxis, ax.get_ylim())):
            for tick in axis.get_major_ticks() + axis.get_minor_ticks():
                if text in (tick.label1, tick.label2):
                    low, high = sorted(limits)
                    margin = 1e-6 * (high - low)
                    return low - margin <= tick.get_loc() <= high + margin
    return True


@pytest.mark.parametrize("entry", CATALOGUE, ids=lambda entry: entry.name)
def test_texts_do_not_collide_and_are_on_the_page(entry, figures):
    figure = figures[entry.name]
    found = boxes(figure)
    assert len(found) > 10
    for (one, a), (two, b) in itertools.combinations(found, 2):
        assert not (a.x0 < b.x1 - 1 and b.x0 < a.x1 - 1 and a.y0 < b.y1 - 1 and b.y0 < a.y1 - 1), (one, two)
    width, height = figure.canvas.get_width_height()
    for text, box in found:
        assert box.x0 > -1, text
        assert box.y0 > -1, text
        assert box.x1 < width + 1, text
        assert box.y1 < height + 1, text


@pytest.mark.parametrize("name", [entry.name for entry in CATALOGUE if "quadrature" not in entry.name])
def test_y_points_down_and_pixels_are_square(name, figures):
    planes = [
        ax for ax in figures[name].axes if ax.get_ylabel().endswith("y (px)") or ax.get_xlabel() == "x (px)"
    ]
    assert planes
    for ax in planes:
        bottom, top = ax.get_ylim()
        assert bottom > top
        box, (left, right) = ax.get_window_extent(), ax.get_xlim()
        assert box.width / abs(right - left) == pytest.approx(box.height / abs(bottom - top), rel=1e-3)


def png(width, height):
    """Return a grey picture as PNG."""
    stream = io.BytesIO()
    Image.new("L", (width, height), 128).save(stream, "PNG")
    return stream.getvalue()


class TestPage:
    def test_page_stands_alone(self):
        pictures = [(entry, png(300 + 20 * number, 200)) for number, entry in enumerate(CATALOGUE)]
        page = make_page(pictures)
        tree = ElementTree.fromstring(page)
        sources = [image.get("src", "") for image in tree.iter("img")]
        assert len(sources) == len(CATALOGUE)
        for source, (_, picture) in zip(sources, pictures, strict=True):
            assert base64.b64decode(source.removeprefix("data:image/png;base64,"), validate=True) == picture
        for image in tree.iter("img"):
            assert image.get("alt")
            ratio = int(image.get("width")) / int(image.get("height"))
            with Image.open(io.BytesIO(base64.b64decode(image.get("src").split(",")[1]))) as picture:
                assert ratio == pytest.approx(picture.width / picture.height, rel=0.02)
        assert not re.search(r"https?:|//|@import|url\(|<script|<link", re.sub(r'src="[^"]*"', "", page))
        assert [a.get("href") for a in tree.iter("a")] == [f"#{entry.name}" for entry in CATALOGUE]
        assert {figure.get("id") for figure in tree.iter("figure")} == {entry.name for entry in CATALOGUE}

    def test_every_figure_of_the_paper_is_there_with_words(self):
        labels = [entry.label for entry in CATALOGUE]
        assert labels[:-2] == [f"Figure {n}" for n in (1, 3, 4, 5, 6, 7, 8, 9, 10, 11)]
        assert labels[-2:] == ["Beyond the paper"] * 2
        for entry in CATALOGUE:
            for text in (entry.formula, entry.caption, entry.note):
                ElementTree.fromstring(f"<p>{text}</p>")
            assert len(entry.caption) > 100
        assert all(entry.note for entry in CATALOGUE if entry.label in ("Figure 3", *labels[6:10]))


class TestWriting:
    def test_files(self, quick, tmp_path):
        written = write_gallery(tmp_path / "new" / "gallery")
        folder = tmp_path / "new" / "gallery"
        assert [path.name for path in written] == [*(f"{entry.name}.png" for entry in quick), PAGE]
        assert sorted(folder.iterdir()) == sorted(written)
        for path in list(written)[:-1]:
            with Image.open(path) as image:
                assert image.width == 40 * 7.6 or "translation" in path.name
        assert (folder / PAGE).read_text("utf-8").startswith("<!DOCTYPE html>")

    @pytest.mark.parametrize("format", ["svg", "pdf"])
    def test_formats(self, quick, tmp_path, format, monkeypatch):
        monkeypatch.setattr(writing, "CATALOGUE", quick[3:])
        written = write_gallery(tmp_path, format=format)
        assert [path.suffix for path in written] == [f".{format}", ".html"]
        assert next(iter(written)).read_bytes().startswith(SIGNATURES[format])

    def test_resolution_for_print(self):
        assert writing.DPI == 300

    def test_nothing_is_replaced_unasked(self, quick, tmp_path, monkeypatch):
        monkeypatch.setattr(writing, "CATALOGUE", quick[3:])
        (tmp_path / PAGE).write_text("mine")
        (tmp_path / "other.txt").write_text("mine too")
        with pytest.raises(FieldFileError, match=r"holds operators\.html already; .*--overwrite"):
            write_gallery(tmp_path)
        assert (tmp_path / PAGE).read_text() == "mine"
        write_gallery(tmp_path, overwrite=True)
        assert (tmp_path / PAGE).read_text("utf-8").startswith("<!DOCTYPE")
        with pytest.raises(FieldFileError, match=r"holds figure-05-x-translation\.png and 1 more already"):
            write_gallery(tmp_path)
        assert (tmp_path / "other.txt").read_text() == "mine too"

    @pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
    def test_failure_leaves_nothing(self, quick, tmp_path, monkeypatch, error):
        def fail():
            raise error("boom")

        broken = dataclasses.replace(quick[0], draw=fail)
        monkeypatch.setattr(writing, "CATALOGUE", (quick[3], broken))
        with pytest.raises(error):
            write_gallery(tmp_path / "a" / "b")
        assert list(tmp_path.iterdir()) == []
        (tmp_path / PAGE).write_text("mine")
        with pytest.raises(error):
            write_gallery(tmp_path, overwrite=True)
        assert [path.name for path in tmp_path.iterdir()] == [PAGE]
        assert (tmp_path / PAGE).read_text() == "mine"

    def test_places_that_cannot_be_used(self, quick, tmp_path):
        (tmp_path / "file").write_text("")
        with pytest.raises(FieldFileError, match="file: cannot be made"):
            write_gallery(tmp_path / "file")
        with pytest.raises(FieldFileError, match="cannot be made"):
            write_gallery(tmp_path / "file" / "below")
        (tmp_path / PAGE).mkdir()
        with pytest.raises(FieldFileError, match=r"operators\.html: is a folder"):
            write_gallery(tmp_path, overwrite=True)
        assert sorted(path.name for path in tmp_path.iterdir()) == ["file", PAGE]
        with pytest.raises(InputError, match=r"format='gif': must be one of png, svg, pdf"):
            write_gallery(tmp_path / "new", format="gif")
        assert not (tmp_path / "new").exists()
