"""Blocks that a video codec copied from the frame before are no evidence of motion."""

import numpy as np
import pytest

from sixflow import measure_sequence, synth
from sixflow.convention.flags import FLAGS
from sixflow.frames import Compression, Metadata
from sixflow.prepare.copies import copied_pixels

SHAPE = (96, 128)
MOTION = (0.6, -0.3)
FRAMES = synth.sequence(
    synth.Speckle(seed=3), synth.Affine.translation(*MOTION), SHAPE, 2, sensor=synth.Sensor(noise=1, bits=8)
).frames


class Video:
    """Frames from a codec that copies, or that does not."""

    def __init__(self, frames, copies=True):
        self.frames, self.times = frames, None
        self.metadata = Metadata(compression=Compression("h264", copies=copies))

    def __iter__(self):
        return iter(self.frames)


def with_copies(*blocks):
    first, second = FRAMES[0].copy(), FRAMES[1].copy()
    for block in blocks:
        second[block] = first[block]
    return first, second


def test_every_block_is_found_wherever_it_lies():
    rng = np.random.default_rng(0)
    for _ in range(40):
        first, second = rng.integers(0, 255, (2, 32, 40))
        y, x, h, w = rng.integers((0, 0, 4, 4), (29, 37, 12, 12))
        second[y : y + h, x : x + w] = first[y : y + h, x : x + w]
        block = np.zeros(first.shape, bool)
        block[y : y + h, x : x + w] = True
        found = copied_pixels(first, second, 1.0)
        assert (found >= block).all()
        np.testing.assert_array_equal(found & ~block, found & ~block & (first == second))


def test_noise_and_flat_regions_are_no_copies():
    assert copied_pixels(*FRAMES, 1.0).mean() < 1e-3
    flat = [frame.copy() for frame in FRAMES]
    for frame in flat:
        frame[:, :40] = 16
        frame[10:20, 10:20] = 17
    assert not copied_pixels(*flat, 1.0)[:, :38].any()


def test_a_copied_half_is_not_given_and_the_rest_is_right():
    left = np.s_[:, :64]
    field = measure_sequence(Video(with_copies(left)), step=8).isel(time=0)
    inside, outside = field.sel(x=slice(0, 48)), field.sel(x=slice(80, None))
    assert not bool(inside.sixflow.valid.any())
    assert bool(((inside.flag.values & FLAGS["unmatched"]) != 0).all())
    assert float(outside.sixflow.valid.mean()) > 0.95
    z = (outside.u - MOTION[0]) / outside.sixflow.standard_error("u")
    assert float(abs(z).max()) < 5
    assert "50% of the pixels are copies" in field.attrs["notes"]


def test_scattered_blocks_do_not_pull_the_motion_to_zero():
    rng = np.random.default_rng(1)
    corners = [(16 * j, 16 * i) for j in range(6) for i in range(8) if rng.random() < 0.3]
    video = with_copies(*[np.s_[y : y + 16, x : x + 16] for y, x in corners])
    error = {}
    for copies in (False, True):
        field = measure_sequence(Video(video, copies), step=8, robust=False)
        assert float(field.sixflow.valid.mean()) > 0.7
        error[copies] = float(np.sqrt(((field.u - MOTION[0]) ** 2).mean()))
    assert error[True] < 0.2 * error[False]


def test_a_still_scene_without_a_codec_is_measured():
    still = with_copies(np.s_[:, :64])
    field = measure_sequence(Video(still, copies=False), step=8).isel(time=0)
    inside = field.sel(x=slice(8, 40))
    assert float(inside.sixflow.valid.mean()) > 0.9
    assert "copies" not in field.attrs["notes"]


@pytest.mark.parametrize(
    ("options", "bodies"),
    [
        ({}, False),
        ({}, True),
        ({"method": "eigenfilter"}, False),
        ({"lighting": "local"}, True),
        ({"reference": "middle"}, True),
    ],
    ids=str,
)
def test_a_frame_that_is_all_but_copied(options, bodies):
    """One row is new: nothing is left to measure, and nothing breaks."""
    video = [frame[:64, :64] for frame in with_copies(np.s_[:63])]
    labels = np.ones((64, 64), int)
    labels[:, 30:] = 2
    field = measure_sequence(Video(video), step=16, mask=labels if bodies else None, **options)
    assert not bool(field.sixflow.valid.any())
