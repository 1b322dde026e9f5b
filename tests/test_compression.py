"""Lossy compression: what the file says of it, against the true error; lossless codecs say nothing."""

import av
import numpy as np
import pytest
from PIL import Image

from pictures import film, write_video
from sixflow.frames import open_frames

FILM = film(8, (96, 128), noise=2)


@pytest.mark.parametrize(
    ("name", "codec", "pixels", "options"),
    [
        *(("a.mp4", "libx264", "yuv420p", {"crf": crf}) for crf in (10, 23, 35)),
        *(("a.avi", "mjpeg", "yuvj420p", {"q": q}) for q in (2, 8, 25)),
        *(("a.avi", "mpeg4", "yuv420p", {"q": q}) for q in (2, 8, 25)),
        *(("a.mpg", "mpeg2video", "yuv420p", {"q": q}) for q in (2, 8, 25)),
        *(("a.webm", "libvpx-vp9", "yuv420p", {"crf": crf, "b:v": 0}) for crf in (10, 40)),
    ],
)
def test_noise_against_the_truth(tmp_path, name, codec, pixels, options):
    if codec not in av.codecs_available:
        pytest.skip(f"this PyAV has no {codec}")
    source = open_frames(write_video(tmp_path / name, FILM, codec, pixels, **options))
    true = np.sqrt(np.mean((np.array(list(source), float) - FILM) ** 2))
    lossy = source.metadata.compression
    assert 0.5 < lossy.noise / true < 3
    assert lossy.copies == (codec != "mjpeg")
    (note,) = (text for text in source.notes if "lossy" in text)
    assert note.startswith(f"{lossy.codec} is lossy: ")
    assert f"about {lossy.noise:.2f} grey" in note


def test_codecs_that_do_not_tell_say_so(tmp_path):
    source = open_frames(write_video(tmp_path / "a.webm", FILM, "libvpx", "yuv420p"))
    assert source.metadata.compression.noise == 0
    assert any("how much it left out is not known" in note for note in source.notes)


@pytest.mark.parametrize(
    ("name", "codec", "pixels", "options"),
    [
        ("a.mkv", "ffv1", "gray", {}),
        ("a.avi", "huffyuv", "yuv422p", {}),
        ("a.avi", "rawvideo", "gray", {}),
        ("a.avi", "ljpeg", "yuvj420p", {}),
        ("a.mp4", "libx264", "yuv444p", {"qp": 0}),
    ],
)
def test_lossless_videos_get_no_note(tmp_path, name, codec, pixels, options):
    source = open_frames(write_video(tmp_path / name, FILM, codec, pixels, **options))
    np.testing.assert_array_equal(list(source), FILM)
    assert source.metadata.compression is None
    assert not any("lossy" in note for note in source.notes)


@pytest.mark.parametrize(
    ("name", "options", "codec"),
    [
        ("a.jpg", {"quality": 60}, "JPEG"),
        ("a.webp", {"quality": 60}, "WebP"),
        ("a.jp2", {"irreversible": True, "quality_mode": "dB", "quality_layers": [30]}, "JPEG 2000"),
        ("a.webp", {"lossless": True}, None),
        ("a.jp2", {"irreversible": False}, None),
        ("a.png", {}, None),
    ],
)
def test_images(tmp_path, name, options, codec):
    colour = np.stack([FILM[0]] * 3, axis=-1)
    Image.fromarray(colour).save(tmp_path / name, **options)
    source = open_frames(tmp_path / name)
    lossy = source.metadata.compression
    assert (lossy and lossy.codec) == codec
    assert any("lossy" in note for note in source.notes) == (codec is not None)
    if codec is None:
        np.testing.assert_allclose(source[0], FILM[0], rtol=1e-6)
    if codec == "JPEG":
        assert 0.5 < lossy.noise / (source[0] - FILM[0]).std() < 2
