"""What the samples of a TIFF mean, and how large it may claim to be."""

import itertools
import struct

import numpy as np
import pytest
import tifffile

from sixflow.errors import FrameFileError, InputError
from sixflow.frames import open_frames
from sixflow.frames.limits import check_size, frame_limit

FILM = np.random.default_rng(5).integers(0, 255, (2, 16, 24)).astype(np.uint8)


def written(path, samples, photometric, **options):
    tifffile.imwrite(path, samples, photometric=photometric, metadata=None, **options)
    return open_frames(path)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_print_colours(tmp_path, dtype):
    top = np.iinfo(dtype).max
    ink = np.random.default_rng(1).integers(0, top, (16, 24, 4)).astype(dtype)
    source = written(tmp_path / "a.tif", ink, "separated")
    light = (1 - ink[..., :3] / top) * (1 - ink[..., 3:] / top) * top
    np.testing.assert_allclose(source[0], light @ [0.2126, 0.7152, 0.0722], rtol=1e-5, atol=1e-5 * top)
    assert "print colours (CMYK) → colour" in source.notes
    black = np.zeros((2, 16, 24, 4), dtype)
    black[..., 3] = top - FILM.astype(dtype)
    np.testing.assert_allclose(list(written(tmp_path / "k.tif", black, "separated")), FILM, atol=1e-5 * top)


@pytest.mark.parametrize(
    ("kind", "note"), [("ycbcr", "recorded luma"), ("cielab", "lightness"), ("icclab", "lightness")]
)
def test_luma_and_lightness(tmp_path, kind, note):
    source = written(tmp_path / "a.tif", np.stack([FILM, FILM // 2, FILM // 3], -1), kind)
    np.testing.assert_array_equal(list(source), FILM)
    assert note in source.notes[0]


@pytest.mark.parametrize("kind", ["logl", "logluv"])
def test_what_cannot_be_converted(tmp_path, kind):
    samples = FILM if kind == "logl" else np.stack([FILM] * 3, -1)
    with pytest.raises(
        FrameFileError, match=f"photometric interpretation {kind.upper()} cannot be turned into grey"
    ):
        written(tmp_path / "a.tif", samples, kind)


def test_grey_with_alpha_and_extra_samples(tmp_path):
    alpha = np.full_like(FILM, 200)
    source = written(
        tmp_path / "a.tif", np.stack([FILM, alpha], -1), "minisblack", planarconfig="contig", extrasamples=[2]
    )
    np.testing.assert_array_equal(list(source), FILM)
    assert "alpha" in source.notes[0]
    five = np.stack([FILM] * 3 + [alpha // 100] * 2, -1)
    source = written(tmp_path / "b.tif", five, "rgb", extrasamples=[0, 0])
    np.testing.assert_allclose(list(source), FILM, rtol=1e-6)
    assert source.notes[0] == "extra samples beside the colours left out: 2"
    four = written(tmp_path / "c.tif", five[..., :4], "rgb", extrasamples=[0])
    np.testing.assert_allclose(list(four), FILM, rtol=1e-6)


def test_white_is_zero_is_noted(tmp_path):
    source = written(tmp_path / "a.tif", FILM, "miniswhite")
    np.testing.assert_array_equal(list(source), FILM)
    assert source.notes == ("white is stored as zero; the values are read as they are stored",)


def test_planes_that_may_be_frames_are_told(tmp_path):
    tifffile.imwrite(
        tmp_path / "a.tif", np.stack([*FILM, FILM[0]]), photometric="rgb", planarconfig="separate"
    )
    assert "3 planes are read as the colours of one picture" in open_frames(tmp_path / "a.tif").notes[0]


# Claims


def claim(path, width, height, compression=1, data=bytes(1000), more=()):
    """Write a TIFF whose tags say what they like."""
    tags = [
        *((256, 4, 1, width), (257, 4, 1, height), (258, 3, 1, 8), (259, 3, 1, compression), (262, 3, 1, 1)),
        *((273, 4, 1, 8), (277, 3, 1, 1), (278, 4, 1, height), (279, 4, 1, len(data)), *more),
    ]
    entries = b"".join(struct.pack("<HHII", *tag) for tag in tags)
    path.write_bytes(
        b"II*\0" + struct.pack("<I", 8 + len(data)) + data + struct.pack("<H", len(tags)) + entries + bytes(4)
    )
    return path


@pytest.mark.parametrize(
    ("tags", "message"),
    [
        ({"width": 2**32 - 1, "height": 2**32 - 1}, "claims a frame of 4294967295×4294967295 px"),
        ({"width": 50000, "height": 50000, "compression": 5}, "of which only"),
        (
            {"width": 50000, "height": 50000, "compression": 50000},
            "more than the limit of 1024 MiB; if the file is right",
        ),
        ({"width": 40, "height": 0}, "it has the shape"),
        ({"width": 40, "height": 40}, "of which only|cut short"),
        (
            {"width": 40, "height": 20, "more": ((322, 4, 1, 0), (323, 4, 1, 0))},
            "tiles have no size|cannot be read",
        ),
        ({"width": 40, "height": 20, "more": ((322, 4, 1, 2**31 - 1), (323, 4, 1, 16))}, "its tiles: claims"),
        ({"width": 16, "height": 16 * 50, "more": ((322, 4, 1, 16), (323, 4, 1, 16))}, "claims|pieces"),
    ],
)
def test_claims_beyond_reason(tmp_path, tags, message):
    with pytest.raises(FrameFileError, match=message):
        list(open_frames(claim(tmp_path / "a.tif", **tags)))


def test_a_tag_that_cannot_be_read(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", FILM)
    whole = (tmp_path / "a.tif").read_bytes()
    for code in (256, 257, 258, 259, 273, 279):
        data = bytearray(whole)
        at = next(
            data.find(struct.pack("<HH", code, kind))
            for kind in (4, 3)
            if struct.pack("<HH", code, kind) in whole
        )
        data[at + 3] = 0x7F
        (tmp_path / "a.tif").write_bytes(data)
        with pytest.raises(FrameFileError, match=r"a.tif: .*; copy or export it again"):
            list(open_frames(tmp_path / "a.tif"))


def test_pages_in_a_circle(tmp_path):
    with tifffile.TiffWriter(tmp_path / "a.tif") as writer:
        for frame in FILM:
            writer.write(frame, contiguous=False, metadata=None)
    data = bytearray((tmp_path / "a.tif").read_bytes())
    with tifffile.TiffFile(tmp_path / "a.tif") as tif:
        first, last = tif.pages[0].offset, tif.pages[1].offset
    end = last + 2 + 12 * struct.unpack_from("<H", data, last)[0]
    struct.pack_into("<I", data, end, first)
    (tmp_path / "a.tif").write_bytes(data)
    source = open_frames(tmp_path / "a.tif")
    assert len(source) == 3
    assert "go round in a circle" in source.notes[0]
    np.testing.assert_array_equal(list(itertools.islice(source, 2)), FILM)


def test_the_limit_can_be_raised(monkeypatch):
    size = 40000, 40000, 1, 1, "a.tif"
    with pytest.raises(
        FrameFileError, match="set the environment variable SIXFLOW_MAX_FRAME_MIB to at least 1526"
    ):
        check_size(*size)
    monkeypatch.setenv("SIXFLOW_MAX_FRAME_MIB", "1526")
    check_size(*size)
    assert frame_limit() == 1526 * 2**20
    monkeypatch.setenv("SIXFLOW_MAX_FRAME_MIB", "much")
    with pytest.raises(InputError, match="SIXFLOW_MAX_FRAME_MIB='much': must be a number of MiB"):
        check_size(*size)
