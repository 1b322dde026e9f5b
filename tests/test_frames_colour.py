"""Colour spaces, transparency, depth and size of image files: the right grey values, or a refusal by name."""

import io
import struct
import zlib
from fractions import Fraction

import av
import numpy as np
import pytest
from PIL import Image

from pictures import film
from sixflow.errors import FrameFileError, InputError
from sixflow.frames import BadFrame, open_frames
from sixflow.frames.grey import LUMINANCE, to_grey

A, B, C = film(3, (40, 56))
COLOUR = np.stack([A, B, C], axis=-1)
GREY = COLOUR @ LUMINANCE.astype(float)


def chunk(kind, data):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(width, height, depth=8, colour=0, rows=b"", extra=b""):
    head = struct.pack(">IIBBBBB", width, height, depth, colour, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + extra + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


@pytest.mark.parametrize("suffix", [".png", ".webp"])
def test_transparent_pixels_have_no_value(tmp_path, suffix):
    alpha = np.full(A.shape, 255, np.uint8)
    alpha[:, :20], alpha[:5] = 0, 100
    Image.fromarray(np.dstack([COLOUR, alpha])).save(tmp_path / f"a{suffix}", lossless=True, exact=True)
    source = open_frames(tmp_path / f"a{suffix}")
    frame = source[0]
    assert frame.dtype == np.float32
    np.testing.assert_array_equal(np.isnan(frame), alpha == 0)
    np.testing.assert_allclose(frame[alpha > 0], GREY[alpha > 0], rtol=1e-6)
    hidden = int((alpha == 0).sum())
    assert (
        f"alpha channel: {hidden} transparent pixels have no value; partly transparent pixels keep their value"
        in source.notes
    )


def test_opaque_and_partly_transparent_pixels_keep_their_type():
    frame, notes = to_grey(np.dstack([A, np.full(A.shape, 255, np.uint8)]), "a")
    assert (frame.dtype, notes) == (np.uint8, ("alpha channel dropped",))
    np.testing.assert_array_equal(frame, A)
    _, notes = to_grey(np.dstack([A, np.full(A.shape, 9, np.uint8)]), "a")
    assert notes == ("alpha channel dropped: partly transparent pixels keep their value",)
    deep = np.dstack([A.astype(np.uint32), (A > 128).astype(np.uint32)])
    frame, _ = to_grey(deep, "a")
    assert frame.dtype == np.float64
    np.testing.assert_array_equal(np.isnan(frame), A <= 128)


@pytest.mark.parametrize("deep", [False, True])
def test_transparent_grey_value_of_png(tmp_path, deep):
    values = A.astype(np.uint16) * 200 if deep else A
    key = int(values[3, 4])
    image = Image.fromarray(values)
    image.save(tmp_path / "a.png", transparency=key)
    frame = open_frames(tmp_path / "a.png")[0]
    np.testing.assert_array_equal(np.isnan(frame), values == key)
    np.testing.assert_array_equal(frame[values != key], values[values != key])


def test_palette_with_a_transparent_entry(tmp_path):
    image = Image.fromarray(COLOUR).convert("P", palette=Image.Palette.ADAPTIVE, colors=16)
    indices = np.asarray(image)
    image.save(tmp_path / "a.png", transparency=int(indices[0, 0]))
    source = open_frames(tmp_path / "a.png")
    np.testing.assert_array_equal(np.isnan(source[0]), indices == indices[0, 0])
    assert "palette colours read as colour" in source.notes


def test_print_colours(tmp_path):
    plates = np.zeros((*A.shape, 4), np.uint8)
    plates[..., 3] = 255 - A  # the picture stands in black
    Image.frombytes("CMYK", A.shape[::-1], plates.tobytes()).save(tmp_path / "a.jpg", quality=98)
    source = open_frames(tmp_path / "a.jpg")
    assert np.abs(source[0] - A).max() < 8
    assert any("CMYK" in note for note in source.notes)


@pytest.mark.parametrize(("pixel_format", "channels"), [("rgb48be", 3), ("rgba64be", 4), ("ya16be", 2)])
def test_deep_colour_png_keeps_its_depth(tmp_path, pixel_format, channels):
    values = np.random.default_rng(0).integers(1, 65536, (40, 56, channels)).astype(np.uint16)
    encoder = av.CodecContext.create("png", "w")
    encoder.width, encoder.height, encoder.pix_fmt, encoder.time_base = 56, 40, pixel_format, Fraction(1)
    frame = av.VideoFrame(56, 40, pixel_format)
    rows = np.zeros((40, frame.planes[0].line_size // 2), ">u2")
    rows[:, : 56 * channels] = values.reshape(40, -1)
    frame.planes[0].update(rows.tobytes())
    frame.pts = 0
    packets = [*encoder.encode(frame), *encoder.encode(None)]
    (tmp_path / "a.png").write_bytes(b"".join(map(bytes, packets)))
    wanted = values[..., 0] if channels == 2 else values[..., :3] @ LUMINANCE.astype(float)
    np.testing.assert_allclose(open_frames(tmp_path / "a.png")[0], wanted, rtol=1e-6)


def test_one_scale_in_one_recording(tmp_path):
    """Grey, colour and transparency may follow each other; another depth may not."""
    alpha = np.where(A > 60, 255, 0).astype(np.uint8)
    Image.fromarray(A).save(tmp_path / "p0.png")
    Image.fromarray(np.stack([B] * 3, axis=-1)).save(tmp_path / "p1.png")
    Image.fromarray(np.dstack([C, alpha])).save(tmp_path / "p2.png")
    Image.fromarray(A.astype(np.uint16) * 200).save(tmp_path / "p3.png")
    frames = list(open_frames(tmp_path / "p*.png").attempt())
    np.testing.assert_array_equal(frames[0], A)
    np.testing.assert_allclose(frames[1], B, rtol=1e-6)
    np.testing.assert_array_equal(np.isnan(frames[2]), alpha == 0)
    assert isinstance(frames[3], BadFrame)
    with pytest.raises(
        InputError, match=r"p3.png has 56×40 px of uint16, but .*p0.png has 56×40 px of uint8"
    ):
        list(open_frames(tmp_path / "p*.png"))
    Image.fromarray(np.stack([B] * 3, axis=-1)).save(tmp_path / "a0.png")
    Image.fromarray(A).save(tmp_path / "a1.png")
    assert {frame.dtype for frame in open_frames(tmp_path / "a*.png")} == {np.dtype(np.float32)}


@pytest.mark.parametrize("suffix", [".png", ".webp"])
def test_animated_pictures_are_refused(tmp_path, suffix):
    first, *others = (Image.fromarray(frame) for frame in (A, B, C))
    first.save(tmp_path / f"a{suffix}", save_all=True, append_images=others)
    with pytest.raises(FrameFileError, match=rf"a{suffix}: holds 3 pictures; give one picture a file"):
        open_frames(tmp_path / f"a{suffix}")


def test_pictures_behind_the_first_of_a_jpeg(tmp_path):
    Image.fromarray(A).save(
        tmp_path / "a.jpg", format="MPO", save_all=True, append_images=[Image.fromarray(B)]
    )
    source = open_frames(tmp_path / "a.jpg")
    assert np.abs(source[0].astype(int) - A).mean() < 5
    assert any("further pictures in the file" in note for note in source.notes)


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".bmp", ".pgm"])
def test_larger_than_pillow_allows(tmp_path, monkeypatch, suffix):
    Image.fromarray(A).save(tmp_path / f"a{suffix}")
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 100)
    assert open_frames(tmp_path / f"a{suffix}")[0].shape == A.shape


def test_strips_of_a_large_picture(tmp_path, monkeypatch):
    from sixflow.frames import image

    monkeypatch.setattr(image, "_STRIP", 7 * A.shape[1])
    for name, pixels in (("a.png", A), ("b.png", A.astype(np.uint16) * 200), ("c.png", A > 128)):
        Image.fromarray(pixels).save(tmp_path / name)
        np.testing.assert_array_equal(
            open_frames(tmp_path / name)[0], pixels * (255 if pixels.dtype == bool else 1)
        )


def test_claims_beyond_reason(tmp_path, monkeypatch):
    rows = zlib.compress(bytes(101 * 100))
    bomb = zlib.compress(bytes(50 << 20), 9)
    store = io.BytesIO()
    Image.new("L", (64, 64)).save(store, "JPEG")
    jpeg = bytearray(store.getvalue())
    jpeg[(at := jpeg.find(b"\xff\xc0")) + 5 : at + 9] = struct.pack(">HH", 65000, 65000)
    files = {
        "a.png": png(2**31 - 1, 2**31 - 1, rows=rows),
        "b.png": png(30000, 30000, colour=2, rows=rows),
        "c.png": png(100, 100, rows=rows, extra=chunk(b"zTXt", b"a\0\0" + bomb)),
        "d.png": png(100, 100, rows=rows, extra=chunk(b"iCCP", b"a\0\0" + bomb)),
        "a.pgm": b"P5\n100000 100000\n255\n" + bytes(1000),
        "a.jpg": bytes(jpeg),
    }
    for name, data in files.items():
        (tmp_path / name).write_bytes(data)
        with pytest.raises(FrameFileError, match=name):
            open_frames(tmp_path / name)
    Image.fromarray(A).save(tmp_path / "e.png")
    monkeypatch.setenv("SIXFLOW_MAX_FRAME_MIB", "0.001")
    with pytest.raises(FrameFileError, match=r"e.png: claims a frame of 56×40 px.*SIXFLOW_MAX_FRAME_MIB"):
        open_frames(tmp_path / "e.png")


@pytest.mark.parametrize(
    ("name", "codec", "pixel_format"),
    [("a.avi", "png", "rgba"), ("a.mov", "qtrle", "argb"), ("a.mkv", "ffv1", "yuva444p")],
)
def test_transparent_pixels_of_a_video(tmp_path, name, codec, pixel_format):
    alpha = np.where(A > 100, 255, 0).astype(np.uint8)
    with av.open(str(tmp_path / name), "w") as container:
        stream = container.add_stream(codec, rate=25)
        stream.height, stream.width, stream.pix_fmt = *A.shape, pixel_format
        for shown in (alpha, np.full_like(alpha, 255)):
            frame = av.VideoFrame.from_ndarray(np.dstack([A, A, A, shown]), format="rgba")
            container.mux(stream.encode(frame.reformat(format=pixel_format)))
        container.mux(stream.encode())
    first, second = open_frames(tmp_path / name)
    np.testing.assert_array_equal(np.isnan(first), alpha == 0)
    assert np.isfinite(second).all()
    assert np.corrcoef(second.ravel(), A.ravel())[0, 1] > 0.999
