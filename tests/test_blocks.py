"""JPEG blocks in arrays: what they left is seen in the pixels, and nothing in pictures that were never compressed."""

import io

import numpy as np
import pytest
from PIL import Image

from sixflow import measure
from sixflow.frames.blocks import block_noise
from sixflow.frames.floor import Floor, gradient_area
from sixflow.synth import Affine, Grating, Particles, Sensor, Speckle, pair, render

PATTERNS = {
    "speckle": Speckle(seed=1),
    "smooth": Speckle(sigma=8.0, seed=1),
    "faint": Speckle(sigma=3.0, contrast=15, seed=5),
    "particles": Particles(diameter=2.5, density=0.03, background=60, seed=1),
}


def shot(pattern, seed=0):
    still = Affine.translation(0, 0)
    return pair(pattern, still, (192, 192), sensor=Sensor(noise=2, bits=8, seed=seed)).frame0


def grating(wavelength, noise):
    still = Affine.translation(0, 0)
    return pair(
        Grating(wavelength=wavelength, angle=0.0), still, (128, 128), sensor=Sensor(noise=noise, bits=8)
    ).frame0


def compressed(frame, quality):
    store = io.BytesIO()
    Image.fromarray(frame).save(store, "JPEG", quality=quality)
    return np.asarray(Image.open(store))


@pytest.mark.parametrize("name", PATTERNS)
@pytest.mark.parametrize("quality", [10, 25, 50, 75])
def test_what_a_jpeg_left(name, quality):
    frame = shot(PATTERNS[name])
    seen = compressed(frame, quality)
    if (name, quality) == ("smooth", 10):  # hardly a coefficient is left to tell the others' size
        assert block_noise(seen) > 3
        return
    true = (seen.astype(float) - frame).std()
    # the Laplacian law of the coefficients gives 0.8 to 1.7 times the true error (`frames.jpeg`)
    assert 0.75 * true < block_noise(seen) < 1.75 * true


def test_what_is_no_jpeg():
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:128, :128]
    frames = [shot(pattern, seed) for pattern in PATTERNS.values() for seed in range(3)]
    frames += [
        *(grating(wavelength, noise) for wavelength in (4, 8, 16) for noise in (0, 0.5, 2)),
        (255 * ((x // 8 + y // 8) % 2)).astype(np.uint8),
        (255 * ((x // 6 + y // 10) % 2)).astype(np.uint8),
        (x + y).astype(np.uint8),
        np.zeros((64, 64), np.uint8),
        rng.integers(0, 256, (64, 64)).astype(np.uint8),
        16 * rng.integers(0, 16, (64, 64)).astype(np.uint8),
        np.full((7, 300), 5, np.uint8),
    ]
    assert [block_noise(frame) for frame in frames] == [0.0] * len(frames)


def test_errors_of_compressed_arrays():
    """Blocks come out equal to the last bit; the errors are those of the compression, and a note says so."""
    made = pair(
        Speckle(sigma=8.0, seed=1), Affine.translation(0.5, 0.3), (160, 160), sensor=Sensor(noise=2, bits=8)
    )
    field = measure(*(compressed(frame, 10) for frame in (made.frame0, made.frame1)))
    assert "JPEG is lossy" in field.attrs["notes"]
    assert float(np.sqrt(np.nanmin(field.covariance.values[..., 0, 0]))) > 0.05
    assert "lossy" not in measure(made.frame0, made.frame1).attrs["notes"]


def test_differences_that_a_codec_leaves_out_are_as_long_as_gradients():
    """Of Gaussian blobs of width s, autocorrelation (1 − x²/4s² …): Σ ρ² grows with s²; of white noise it is near 1."""
    areas = [gradient_area(render(Speckle(sigma=sigma, seed=2), (256, 256))) for sigma in (1.5, 3.0)]
    assert areas[1] / areas[0] == pytest.approx(4, rel=0.35)
    frame = shot(PATTERNS["faint"])
    plain, copying = (Floor(compression=3.0, copies=copies).under(frame)[0] for copies in (False, True))
    assert copying / plain == pytest.approx(np.sqrt(gradient_area(frame)), rel=0.02)
