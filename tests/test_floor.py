"""The noise that every pixel has at least: rounding of grey values, and what a lossy compression leaves."""

import numpy as np
import pytest
from PIL import Image

from measured import measure
from sixflow import measure_sequence, open_frames, synth
from sixflow.frames import Compression, Metadata
from sixflow.frames.floor import Floor, rounding_noise
from sixflow.pair.session import Session
from sixflow.settings import Settings

SHAPE = (96, 96)
ROUNDED = 1 / np.sqrt(12)


def rendered(u, v, noise=0.0, seed=1):
    light = synth.render(synth.Speckle(seed=1), SHAPE, synth.Affine.translation(u, v))
    return light + noise * np.random.default_rng(seed).normal(size=SHAPE)


@pytest.fixture(scope="module")
def still():
    return np.rint(rendered(0, 0)).astype(np.uint8)


def errors(field):
    """Standard errors of u by the noise alone: what a window leaves out has no floor."""
    return np.sqrt(field.covariance[..., 0, 0]).where(field.sixflow.valid)


@pytest.mark.parametrize("kind", [np.uint8, np.int16, np.uint16, np.int64, np.float32, np.float64])
def test_rounding_is_read_off_the_values(still, kind):
    frame = still.astype(kind)
    assert rounding_noise(frame) == pytest.approx(ROUNDED, rel=1e-6)
    if kind in (np.uint16, np.int64):
        assert rounding_noise(frame * kind(16) + kind(3)) == pytest.approx(16 * ROUNDED)
    if frame.dtype.kind == "f":
        assert rounding_noise(frame / kind(255)) == pytest.approx(ROUNDED / 255, rel=1e-3)
        frame[0, 0] = np.nan
        assert rounding_noise(frame) == pytest.approx(ROUNDED, rel=1e-6)


def test_rounding_of_extreme_integers():
    ends = np.array([[-(2**63), 2**63 - 1, 0]])
    assert rounding_noise(ends) == pytest.approx(ROUNDED)
    assert rounding_noise(np.array([[-128, 127, 0]], np.int8)) == pytest.approx(ROUNDED)


def test_what_was_not_rounded_has_no_floor():
    assert rounding_noise(rendered(0, 0)) == 0
    assert rounding_noise(rendered(0, 0).astype(np.float32)) == 0
    assert rounding_noise(np.full(SHAPE, 7)) == 0
    assert rounding_noise(np.full(SHAPE, np.nan)) == 0
    assert rounding_noise(np.array([[0.0, 1e308, -1e308]])) == 0


def test_pictures_of_two_values_were_not_rounded_to_two_values(still):
    assert rounding_noise((still > 128) * np.uint8(240)) == pytest.approx(30 * ROUNDED)


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"method": "eigenfilter"},
        {"sharpen": 2},
        {"lowpass": 0.7},
        {"reference": "middle"},
        {"reference": "second", "float64": True},
        {"group": "euclidean"},
        {"lighting": "gain+offset"},
        {"lighting": "local"},
        {"lighting": "local", "method": "eigenfilter"},
    ],
    ids=str,
)
def test_equal_frames_have_the_error_that_rounding_leaves(still, options):
    """Frames moved by whole pixels agree to the last bit; others, by 2.5, show their rounding."""
    options = {"step": 16, **options}
    equal = errors(measure(still, np.roll(still, (1, 2), (0, 1)), **options))
    rounded = errors(measure(still, np.rint(rendered(2.5, 1.5)).astype(np.uint8), **options))
    # the two see other parts of the texture; operators, and light that is divided out, add to what rounding leaves
    assert 0.6 < float(equal.median() / rounded.median()) < 1.2


def test_floor_is_in_the_covariance_of_automatic_windows(still):
    field = measure(still, np.roll(still, (1, 2), (0, 1)), step=16, window="auto")
    assert float(errors(field).min()) > 1e-4
    assert float(field.noise.min()) == pytest.approx(ROUNDED, rel=1e-3)


def test_floor_holds_for_bodies_and_sixteen_bits(still):
    bodies = np.ones(SHAPE, int)
    bodies[:, 48:] = 2
    deep = still.astype(np.uint16) * np.uint16(257)
    fields = [measure(f, np.roll(f, 2, 1), mask=bodies, step=16) for f in (still, deep, still * 1e-9)]
    # whether the last pixels at the border have a partner 2 px away is a matter of rounding
    inner = [errors(field)[0, 1:-1, 1:-1] for field in fields]
    for field in inner[1:]:
        np.testing.assert_allclose(field, inner[0], rtol=0.01)


@pytest.mark.parametrize("noise", [0.5, 2.0])
def test_ordinary_noise_is_above_the_floor(noise):
    """Half a grey value of noise and that of rounding: next to nothing changes."""
    frames = [np.rint(rendered(u, 0, noise, seed)).astype(np.uint8) for seed, u in enumerate((0, 0.4))]
    field = measure(*frames, step=8)
    finer = [frame + 0.01 * np.random.default_rng(seed).random(SHAPE) for seed, frame in enumerate(frames)]
    free = measure(*finer, step=8)  # no floor, and next to no more noise
    assert float((errors(field) / errors(free)).median()) == pytest.approx(1, abs=0.003)
    assert float((field.noise / free.noise).max()) < 1.01


def test_noise_free_frames_of_floating_point_have_no_floor():
    exact = rendered(0, 0), rendered(0.4, 0.2)
    free, rounded = (measure(*frames, step=16) for frames in (exact, [np.rint(frame) for frame in exact]))
    assert float(errors(free).median()) < 0.1 * float(errors(rounded).median())


def test_a_source_states_its_floor(still):
    """What a codec leaves in the pixels is told by the source, in grey values."""

    class Lossy:
        metadata = Metadata(compression=Compression("h264", noise=3.0))
        times = None

        def __iter__(self):
            return iter([still, np.roll(still, 2, 1)])

    plain = measure_sequence([still, np.roll(still, 2, 1)], step=16)
    lossy = measure_sequence(Lossy(), step=16)
    expected = np.hypot(3.0, ROUNDED) / ROUNDED
    ratio = float((errors(lossy) / errors(plain)).median())
    assert ratio == pytest.approx(expected, rel=1e-4)  # what the codec left out is no noise in the gradients
    assert float(lossy.noise.min()) == pytest.approx(np.hypot(3.0, ROUNDED), rel=1e-3)
    assert Floor.of(still, Lossy()).compression == 3.0


@pytest.mark.parametrize("quality", [40, 75])
def test_compressed_pictures_are_given_with_the_errors_that_they_have(tmp_path, quality):
    motion = synth.Affine.translation(0.6, -0.3)
    made = synth.pair(
        synth.Speckle(sigma=3, contrast=15, seed=5), motion, (160, 160), sensor=synth.Sensor(noise=2)
    )
    for k, frame in enumerate((made.frame0, made.frame1)):
        Image.fromarray(np.rint(frame).astype(np.uint8)).save(tmp_path / f"f{k}.jpg", quality=quality)
    field = measure_sequence(open_frames(tmp_path), step=16)
    given = field.sixflow.valid
    assert float(given.mean()) > 0.9
    beyond = abs(field.u - 0.6) > 5 * field.sixflow.standard_errors.u
    assert not bool((beyond & given).any())


def test_luminance_has_been_rounded_in_three_channels(still):
    colour = np.stack([still, still[::-1], still.T], axis=-1)
    source = open_frames([colour, np.roll(colour, 2, 1)])
    share = np.sqrt(0.2126**2 + 0.7152**2 + 0.0722**2)
    assert source.rounding == pytest.approx(share * ROUNDED)
    assert open_frames([still, still]).rounding == 0
    field = measure_sequence(source, step=16)
    assert float(field.noise.median()) == pytest.approx(share * ROUNDED, rel=1e-3)


def test_weak_texture_below_the_floor_is_no_texture():
    """A slope that rounding has made stairs of moves as the stairs do."""
    x = np.arange(SHAPE[1]) / 40 + np.zeros(SHAPE)
    y = np.arange(SHAPE[0])[:, None] / 40
    frames = [np.rint(100 + np.sin(x + u / 40) + np.sin(y)).astype(np.uint8) for u in (0, 0.5)]
    field = measure(*frames, step=16)
    assert not bool(field.sixflow.valid.any())


def test_session_takes_a_floor(still):
    session = Session(Settings(step=16), floor=Floor(rounding=2.0, compression=1.5))
    prepared = session.prepare(still.astype(np.float64) + 1e-3 * rendered(0, 0), "frame 0")
    assert prepared.frame.floor == pytest.approx(2.5)
