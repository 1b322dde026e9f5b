"""JPEG from its bytes: scans against a naive walk, damage that is found, the error that quantisation leaves."""

import io

import numpy as np
import pytest
from PIL import Image

import naive
from pictures import film
from sixflow.engine.huffman import WHOLE, walk_scan
from sixflow.frames import jpeg

COLOUR = np.stack(film(3, (53, 75)), axis=-1)


def stored(pixels, **options):
    store = io.BytesIO()
    Image.fromarray(pixels).save(store, "JPEG", **options)
    return store.getvalue()


def tables(words):
    """Code words as strings, from a table of all 16-bit beginnings."""
    found = {}
    for start in np.flatnonzero(np.diff(words, prepend=np.uint16(0))):
        length, symbol = divmod(int(words[start]), 256)
        if length:
            found[format(start, "016b")[:length]] = symbol
    return found


@pytest.mark.parametrize(
    "options",
    [{"quality": 30}, {"quality": 95}, {"quality": 75, "optimize": True}, {"restart_marker_rows": 1}],
)
def test_scan_as_the_naive_walk(monkeypatch, options):
    calls = []

    def both(data, blocks, units, words, limits, first, last, shift):
        status, used = walk_scan(data, blocks, units, words, limits, first, last, shift)
        bits = "".join(format(byte, "08b") for byte in data[:-4])
        slow = [[tables(kind) for kind in component] for component in words]
        calls.append((status, used, naive.walk_scan(bits, blocks, units, slow, limits, first, last, shift)))
        return status, used

    monkeypatch.setattr(jpeg, "walk_scan", both)
    assert jpeg.damage_of_jpeg(stored(COLOUR, **options)) == ""
    assert calls
    assert all(status == WHOLE and used == slow for status, used, slow in calls)


@pytest.mark.parametrize("subsampling", [0, 1, 2])
@pytest.mark.parametrize(
    "options", [{}, {"progressive": True}, {"restart_marker_blocks": 3}, {"optimize": True}]
)
def test_whole_pictures_are_whole(subsampling, options):
    for quality in (5, 60, 100):
        assert jpeg.damage_of_jpeg(stored(COLOUR, quality=quality, subsampling=subsampling, **options)) == ""
        assert jpeg.damage_of_jpeg(stored(COLOUR[..., 0], quality=quality, **options)) == ""


def test_standard_tables_may_be_left_out():
    data = stored(COLOUR, quality=70)
    while (at := data.find(b"\xff\xc4")) >= 0:
        data = data[:at] + data[at + 2 + int.from_bytes(data[at + 2 : at + 4], "big") :]
    assert jpeg.damage_of_jpeg(data) == ""


def test_what_follows_the_picture_is_none_of_it():
    rng = np.random.default_rng(1)
    assert jpeg.damage_of_jpeg(stored(COLOUR) + rng.integers(0, 256, 5000, np.uint8).tobytes()) == ""


def test_damage_is_found():
    data = stored(COLOUR, quality=85)
    start = data.find(b"\xff\xda") + 20
    assert "ends early" in jpeg.damage_of_jpeg(data[: (start + len(data)) // 2])
    rng = np.random.default_rng(2)
    found = 0
    for _ in range(40):
        damaged = bytearray(data)
        at = int(rng.integers(start, len(data) - 200))
        damaged[at : at + 100] = rng.integers(0, 255, 100, np.uint8).tobytes()
        found += jpeg.damage_of_jpeg(bytes(damaged)) != ""
    assert found >= 38  # now and then the number of blocks comes out right


def test_damaged_headers_are_told_or_passed():
    data, rng = stored(COLOUR, quality=85), np.random.default_rng(3)
    for _ in range(100):
        damaged = bytearray(data)
        for _ in range(3):
            damaged[int(rng.integers(2, 600))] = int(rng.integers(0, 256))
        assert isinstance(jpeg.damage_of_jpeg(bytes(damaged)), str)
        steps = jpeg.luma_steps(bytes(damaged))
        assert steps is None or (steps > 0).all()


def test_steps_of_the_quantiser():
    for quality in (20, 80):
        data = stored(COLOUR, quality=quality)
        steps = jpeg.luma_steps(data)
        assert sorted(steps.ravel()) == sorted(Image.open(io.BytesIO(data)).quantization[0])
        assert steps[0, 0] < steps[7, 7]


@pytest.mark.parametrize("quality", [10, 35, 50, 75, 90, 95])
@pytest.mark.parametrize(("noise", "seed"), [(0, 1), (2, 2), (8, 3)])
def test_noise_of_quantisation(quality, noise, seed):
    pixels = film(1, (128, 160), noise, seed)[0]
    data = stored(pixels, quality=quality)
    decoded = np.asarray(Image.open(io.BytesIO(data)))
    true = (decoded.astype(float) - pixels).std()
    assert 0.6 < jpeg.quantisation_noise(decoded, jpeg.luma_steps(data)) / true < 2
