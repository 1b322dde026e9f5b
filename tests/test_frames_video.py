"""Videos: exact luma, true time stamps, and what is refused."""

from fractions import Fraction

import av
import numpy as np
import pytest

from sixflow.errors import FrameFileError, InputError
from sixflow.frames import open_frames

MILLISECONDS = [0, 40, 80, 200, 240, 500, 540, 580, 1000, 1040]


@pytest.fixture
def recording():
    rng = np.random.default_rng(4)
    smooth = np.repeat(np.repeat(rng.integers(20, 230, (10, 6, 8)), 8, axis=1), 8, axis=2)
    return smooth.astype(np.uint8)


def write_video(path, frames, codec, pixel_format, stamps=None, given_as="gray", **options):
    """Write frames, shape (n, h, w[, 3]), at the time stamps given in ms, or at 25 frames/s."""
    base = Fraction(1, 25) if stamps is None else Fraction(1, 1000)
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=25, options=options)
        stream.height, stream.width = frames.shape[1:3]
        stream.pix_fmt = pixel_format
        stream.codec_context.time_base = base
        for number, pixels in enumerate(frames):
            frame = av.VideoFrame.from_ndarray(pixels, format=given_as)
            if given_as != pixel_format:
                frame = frame.reformat(format=pixel_format)
            frame.pts, frame.time_base = (number if stamps is None else stamps[number]), base
            container.mux(stream.encode(frame))
        container.mux(stream.encode())


def test_variable_frame_rate(tmp_path, recording):
    write_video(tmp_path / "a.mkv", recording, "ffv1", "gray", MILLISECONDS)
    source = open_frames(tmp_path / "a.mkv")
    assert (len(source), source.shape, source.dtype) == (10, (48, 64), np.uint8)
    np.testing.assert_allclose(source.times, np.array(MILLISECONDS) / 1000, atol=1e-12)
    for _ in range(2):
        np.testing.assert_array_equal(np.stack(list(source)), recording)
    np.testing.assert_array_equal(np.stack(list(source.iterate(7))), recording[7:])
    assert source.notes == ()
    assert source.names[2] == "a.mkv[2]"
    assert source.description.endswith("a.mkv: 10 frames of 64×48 px, uint8, ffv1, 8.654 frames/s")
    with pytest.raises(InputError, match=r"single frames of a video .* source.iterate\(3\)"):
        source[3]


@pytest.mark.parametrize("pixel_format", ["gray10le", "gray12le", "gray16le"])
def test_deep_video_is_exact(tmp_path, recording, pixel_format):
    bits = int(pixel_format[4:6])
    deep = recording.astype(np.uint16) << (bits - 8) | 3
    with av.open(str(tmp_path / "a.mkv"), "w") as container:
        stream = container.add_stream("ffv1", rate=25)
        stream.height, stream.width, stream.pix_fmt = 48, 64, pixel_format
        for number, pixels in enumerate(deep):
            frame = av.VideoFrame(64, 48, pixel_format)
            padded = np.zeros((48, frame.planes[0].line_size // 2), dtype="<u2")
            padded[:, :64] = pixels
            frame.planes[0].update(padded.tobytes())
            frame.pts = number
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    source = open_frames(tmp_path / "a.mkv")
    assert source.dtype == np.uint16
    np.testing.assert_array_equal(np.stack(list(source)), deep)


@pytest.mark.parametrize(
    ("name", "codec", "pixel_format"),
    [
        ("a.mp4", "libx264", "yuv420p"),
        ("a.mov", "libx264", "yuv420p"),
        ("a.mov", "mjpeg", "yuvj420p"),
        ("a.avi", "mpeg4", "yuv420p"),
        ("a.avi", "rawvideo", "yuyv422"),
        ("a.webm", "libvpx-vp9", "yuv420p"),
        ("a.webm", "libvpx", "yuv420p"),
        ("a.mpg", "mpeg2video", "yuv420p"),
        ("a.ts", "libx264", "yuv420p"),
        ("a.mkv", "ffv1", "yuv420p10le"),
    ],
)
def test_containers_and_codecs(tmp_path, recording, name, codec, pixel_format):
    if codec not in av.codecs_available:
        pytest.skip(f"this PyAV has no {codec}")
    path = tmp_path / name
    write_video(path, recording, codec, pixel_format)
    source = open_frames(path)
    frames = np.stack(list(source)).astype(float)
    assert len(source) == len(frames) == 10
    assert source.notes[0] == "colour → recorded luma"
    assert all("lossy" in note for note in source.notes[1:])
    assert len(source.notes) == 1 + (codec not in ("rawvideo", "ffv1"))
    np.testing.assert_allclose(np.diff(source.times), 0.04, atol=1e-3)
    scale = 4.0 if source.dtype == np.uint16 else 1.0
    for frame, truth in zip(frames / scale, recording, strict=True):
        assert np.corrcoef(frame.ravel(), truth.ravel())[0, 1] > 0.97


def test_rgb_video(tmp_path, recording):
    colour = np.stack([recording, recording[:, ::-1], recording[:, :, ::-1]], axis=-1)
    write_video(tmp_path / "a.mkv", colour, "ffv1", "bgr0", given_as="rgb24")
    source = open_frames(tmp_path / "a.mkv")
    assert source.notes == ("colour → luminance (Rec. 709)",)
    assert source.dtype == np.float32
    np.testing.assert_allclose(next(iter(source)), colour[0] @ [0.2126, 0.7152, 0.0722], rtol=1e-5)


def test_video_in_a_folder(tmp_path, recording):
    write_video(tmp_path / "a.mkv", recording, "ffv1", "gray")
    assert len(open_frames(tmp_path)) == 10
    write_video(tmp_path / "b.mkv", recording, "ffv1", "gray")
    joined = open_frames(tmp_path)
    np.testing.assert_array_equal(list(joined), np.concatenate([recording, recording]))
    assert joined.times is None
    assert any("each file counts from its own beginning" in note for note in joined.notes)


def test_no_frames_and_no_video(tmp_path, capfd):
    with av.open(str(tmp_path / "b.avi"), "w") as container:
        stream = container.add_stream("ffv1", rate=25)
        stream.height, stream.width, stream.pix_fmt = 48, 64, "gray"
        container.start_encoding()
    with pytest.raises(FrameFileError, match=r"b.avi: the video holds no frames"):
        open_frames(tmp_path / "b.avi")
    with av.open(str(tmp_path / "a.avi"), "w") as container:
        stream = container.add_stream("pcm_s16le", rate=8000)
        sound = av.AudioFrame.from_ndarray(np.zeros((1, 800), dtype=np.int16), format="s16", layout="mono")
        sound.sample_rate = 8000
        container.mux(stream.encode(sound))
        container.mux(stream.encode())
    with pytest.raises(FrameFileError, match=r"a.avi: holds no video, only audio"):
        open_frames(tmp_path / "a.avi")
    (tmp_path / "a.mp4").write_bytes(b"no video at all" * 50)
    with pytest.raises(FrameFileError, match=r"a.mp4: cannot be read as a video"):
        open_frames(tmp_path / "a.mp4")
    assert capfd.readouterr() == ("", "")


def test_damaged_video(tmp_path, recording, capfd):
    noisy = np.random.default_rng(1).integers(0, 256, (10, 48, 64), dtype=np.uint8)
    write_video(tmp_path / "a.avi", noisy, "png", "gray")
    data = bytearray((tmp_path / "a.avi").read_bytes())
    write_video(tmp_path / "b.mp4", recording, "libx264", "yuv420p")
    (tmp_path / "b.mp4").write_bytes((tmp_path / "b.mp4").read_bytes()[:-300])
    with pytest.raises(FrameFileError, match=r"b.mp4: the video holds no frames; it is empty or cut short"):
        open_frames(tmp_path / "b.mp4")
    middle = len(data) // 2
    data[middle : middle + 600] = bytes(600)
    (tmp_path / "a.avi").write_bytes(data)
    with pytest.raises(FrameFileError, match=r"a.avi: .*(damaged|can be decoded)"):
        list(open_frames(tmp_path / "a.avi"))
    assert capfd.readouterr() == ("", "")
