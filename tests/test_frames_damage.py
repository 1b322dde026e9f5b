"""Damaged and cut videos: which frames are bad, what is noted, and that whole videos are whole."""

import io
import re
from fractions import Fraction

import av
import numpy as np
import pytest
from PIL import Image

from pictures import film, jpeg_starts, overwrite, packet_places, write_video
from sixflow.errors import FrameFileError
from sixflow.frames import BadFrame, open_frames

FILM = film()


def bad_frames(source):
    """Numbers of the frames that are bad, and the others."""
    frames = list(source.attempt())
    return [k for k, frame in enumerate(frames) if isinstance(frame, BadFrame)], frames


WHOLE = [
    ("a.avi", "mjpeg", "yuvj420p", {}),
    ("a.mkv", "ffv1", "gray", {}),
    ("a.avi", "rawvideo", "gray", {}),
    ("a.avi", "huffyuv", "yuv422p", {}),
    ("a.avi", "png", "gray", {}),
    ("a.gif", "gif", "gray", {}),
    ("a.y4m", "rawvideo", "gray", {}),
    ("a.mp4", "libx264", "yuv420p", {"bf": 2, "gop": 4}),
    ("a.mkv", "libx264", "yuv420p", {"bf": 2, "gop": 4, "x264-params": "open-gop=1"}),
    ("a.mp4", "libx264", "yuv420p", {"bf": 0, "x264-params": "intra-refresh=1"}),
    ("a.avi", "libx264", "yuv420p", {"bf": 2, "gop": 4}),  # AVI has no time stamps of presentation
    ("a.flv", "libx264", "yuv420p", {"bf": 2}),
    ("a.mp4", "libx265", "yuv420p", {"gop": 4, "x265-params": "log-level=none"}),
    ("a.webm", "libvpx-vp9", "yuv420p", {"lag-in-frames": 6, "auto-alt-ref": 1}),
    ("a.webm", "libvpx", "yuv420p", {"lag-in-frames": 6, "auto-alt-ref": 1}),
    ("a.avi", "mpeg4", "yuv420p", {"bf": 2, "gop": 4}),
    ("a.mpg", "mpeg2video", "yuv420p", {"bf": 2, "gop": 4}),
    ("a.ts", "mpeg2video", "yuv420p", {"bf": 2, "gop": 4}),
]


@pytest.mark.parametrize(("name", "codec", "pixels", "options"), WHOLE)
def test_whole_videos_are_whole(tmp_path, name, codec, pixels, options):
    if codec not in av.codecs_available:
        pytest.skip(f"this PyAV has no {codec}")
    source = open_frames(write_video(tmp_path / name, FILM, codec, pixels, **options))
    bad, frames = bad_frames(source)
    assert bad == []
    assert len(frames) == len(source) == len(FILM)
    for number, frame in enumerate(frames):  # each is the one that it should be
        alike = [np.corrcoef(frame.ravel(), truth.ravel())[0, 1] for truth in FILM]
        assert np.argmax(alike) == number
    np.testing.assert_allclose(np.diff(source.times), 0.04, atol=1e-9)
    assert not any("cut short" in note or "time stamps" in note for note in source.notes)
    assert source.metadata.time_resolution == 0


def test_damaged_motion_jpeg(tmp_path):
    path = write_video(tmp_path / "a.avi", FILM, "mjpeg", "yuvj420p", q=3)
    starts = jpeg_starts(path.read_bytes())
    whole = list(open_frames(path))
    damaged = overwrite(path, tmp_path / "bad.avi", (starts[3] + starts[4]) // 2, bytes(150))
    source = open_frames(damaged)
    bad, frames = bad_frames(source)
    assert bad == [3]
    assert "bad.avi: frame 3 cannot be used: its data" in str(frames[3].error)
    for number in {*range(8)} - {3}:
        np.testing.assert_array_equal(frames[number], whole[number])
    with pytest.raises(FrameFileError, match=r"frame 3 cannot be used"):
        list(source)
    assert len(list(source.attempt(4))) == 4


@pytest.mark.parametrize(("name", "codec"), [("a.mkv", "ffv1"), ("a.avi", "png")])
def test_checksums_count(tmp_path, capfd, name, codec):
    path = write_video(tmp_path / name, FILM, codec, gop=1)
    at, size = packet_places(path)[5]
    source = open_frames(overwrite(path, tmp_path / f"bad_{name}", at + size // 2, b"\x55\xaa\x55"))
    level = av.logging.get_level()
    bad, frames = bad_frames(source)
    assert bad == [5]
    np.testing.assert_array_equal(frames[6], FILM[6])
    assert av.logging.get_level() == level
    assert capfd.readouterr() == ("", "")


def test_what_depends_on_a_damaged_frame_is_bad(tmp_path):
    path = write_video(tmp_path / "a.avi", film(12), "mpeg4", "yuv420p", gop=4)
    whole, (at, size) = list(open_frames(path)), packet_places(path)[5]
    bad, frames = bad_frames(open_frames(overwrite(path, tmp_path / "bad.avi", at + size // 2, bytes(20))))
    assert bad == [5, 6, 7]  # frames 4 and 8 are key frames
    assert "predicted from frame 5" in str(frames[6].error)
    np.testing.assert_array_equal(frames[8], whole[8])


def test_cut_in_the_last_picture(tmp_path):
    path = write_video(tmp_path / "a.avi", FILM, "mjpeg", "yuvj420p", q=3)
    data = path.read_bytes()
    starts = jpeg_starts(data)
    (tmp_path / "cut.avi").write_bytes(data[: (starts[5] + starts[6]) // 2])
    source = open_frames(tmp_path / "cut.avi")
    bad, frames = bad_frames(source)
    assert (len(frames), bad) == (6, [5])
    assert any("states 8 frames (0.32 s), 6 frames are there" in note for note in source.notes)


CUT = [
    ("a.mkv", "ffv1", "gray", r"states about 8 frames \(0.32 s\), \d frames are there"),
    ("a.webm", "libvpx-vp9", "yuv420p", r"states about 8 frames"),
    ("a.avi", "rawvideo", "gray", r"states 8 frames \(0.32 s\), \d frames are there"),
    ("a.gif", "gif", "gray", r"cut short: its end is missing; \d frames are there"),
    ("a.wmv", "wmv2", "yuv420p", r"cut short: it states \d+ bytes, \d+ are there"),
    ("a.y4m", "rawvideo", "gray", r"cut short: it states \d+ bytes, \d+ are there; \d frames are there"),
    ("a.ts", "mpeg2video", "yuv420p", r"cut short: it states \d+ bytes, \d+ are there"),
]


@pytest.mark.parametrize(("name", "codec", "pixels", "note"), CUT)
def test_containers_that_state_more_than_they_have(tmp_path, name, codec, pixels, note):
    path = write_video(tmp_path / name, film(noise=6), codec, pixels)
    path.write_bytes(path.read_bytes()[: int(0.6 * path.stat().st_size)])
    source = open_frames(path)
    assert len(source) < 8
    assert any(re.search(note, text) for text in source.notes), source.notes


def test_mp4_cut_behind_its_header(tmp_path):
    path = write_video(tmp_path / "w.mp4", FILM, "mpeg4", "yuv420p", q=3, gop=1)
    fast = tmp_path / "a.mp4"
    with av.open(str(path)) as source, av.open(str(fast), "w", options={"movflags": "faststart"}) as target:
        stream = target.add_stream_from_template(source.streams.video[0])
        for packet in source.demux(source.streams.video[0]):
            if packet.size:
                packet.stream = stream
                target.mux(packet)
    fast.write_bytes(fast.read_bytes()[:-4000])
    source = open_frames(fast)
    bad, frames = bad_frames(source)
    assert len(frames) < 8
    assert bad in ([], [len(frames) - 1])
    assert any("states 8 frames (0.32 s)" in note for note in source.notes)


def test_stamps_that_repeat(tmp_path):
    every = Fraction(1, 2000)
    path = write_video(tmp_path / "a.mkv", FILM, "ffv1", unit=every)  # Matroska counts whole milliseconds
    source = open_frames(path)
    np.testing.assert_allclose(np.diff(source.times), 5e-4, rtol=1e-3)
    assert any("time stamps repeat, as the file counts in 0.001 s" in note for note in source.notes)
    np.testing.assert_array_equal(list(source), FILM)
    stamps = [0, 40, 40, 120, 160, 300, 500, 800]
    path = write_video(tmp_path / "b.mkv", FILM, "ffv1", stamps=stamps, unit=Fraction(1, 1000))
    source = open_frames(path)
    assert source.times is None
    assert "time stamps repeat or go back: times are not known" in source.notes
    np.testing.assert_array_equal(list(source), FILM)


def test_clock_of_the_container(tmp_path):
    stamps = [round(k * 1000 / 30) for k in range(8)]
    source = open_frames(write_video(tmp_path / "a.mkv", FILM, "ffv1", stamps=stamps, unit=Fraction(1, 1000)))
    assert source.metadata.time_resolution == 0.001
    np.testing.assert_allclose(source.times, np.array(stamps) / 1000)


def test_title_that_is_not_utf8(tmp_path):
    path = tmp_path / "a.avi"
    with av.open(str(path), "w") as container:
        container.metadata["title"] = "Muenchen"
        stream = container.add_stream("rawvideo", rate=25)
        stream.height, stream.width, stream.pix_fmt = *FILM.shape[1:], "gray"
        container.mux(stream.encode(av.VideoFrame.from_ndarray(FILM[0], format="gray")))
        container.mux(stream.encode())
    path.write_bytes(path.read_bytes().replace(b"Muenchen", b"M\xfcnchen "))
    np.testing.assert_array_equal(list(open_frames(path)), FILM[:1])


def test_videos_larger_than_the_limit(tmp_path, monkeypatch):
    path = tmp_path / "a.y4m"
    path.write_bytes(b"YUV4MPEG2 W30000 H30000 F25:1 Ip A1:1 Cmono\nFRAME\n" + bytes(1000))
    with pytest.raises(FrameFileError, match=r"a.y4m: "):
        open_frames(path)
    monkeypatch.setenv("SIXFLOW_MAX_FRAME_MIB", "0.01")
    path = write_video(tmp_path / "a.mkv", FILM, "ffv1")
    with pytest.raises(FrameFileError, match=r"a.mkv: claims a frame of 96×64 px.*SIXFLOW_MAX_FRAME_MIB"):
        open_frames(path)


@pytest.mark.parametrize("kind", ["jpeg", "progressive", "restart", "grey"])
def test_damaged_jpeg_files(tmp_path, kind):
    colour = np.stack([FILM[0], FILM[1], FILM[2]], axis=-1)
    options = {"progressive": {"progressive": True}, "restart": {"restart_marker_rows": 1}}.get(kind, {})
    store = io.BytesIO()
    Image.fromarray(FILM[0] if kind == "grey" else colour).save(store, "JPEG", quality=85, **options)
    data = bytearray(store.getvalue())
    (tmp_path / "a.jpg").write_bytes(data)
    open_frames(tmp_path / "a.jpg")
    at = data.find(b"\xff\xda") + 400
    data[at : at + 200] = bytes(200)
    (tmp_path / "b.jpg").write_bytes(data)
    with pytest.raises(FrameFileError, match=r"b.jpg: cannot be read as an image"):
        open_frames(tmp_path / "b.jpg")
