"""TIFF files of every kind that cameras and ImageJ write, whole and damaged."""

import struct

import numpy as np
import pytest
import tifffile
from PIL import Image

from sixflow.errors import FrameFileError, InputError
from sixflow.frames import open_frames
from sixflow.frames.packed import unpack_rows


@pytest.fixture
def stack():
    return np.random.default_rng(3).integers(0, 65536, (5, 20, 30), dtype=np.uint16)


def write_pages(path, frames, **options):
    """Write pages that do follow each other with gaps, without metadata that ties them together."""
    with tifffile.TiffWriter(path) as tif:
        for frame in frames:
            tif.write(frame, photometric="minisblack", contiguous=False, metadata=None, **options)


def write_packed(path, frame, bits, rows_per_strip):
    """Write a minimal TIFF by hand, whose samples lie end to end; each row starts on a byte."""
    height, width = frame.shape
    digits = [
        "".join(format(int(value), f"0{bits}b") for value in row).ljust(-(-width * bits // 8) * 8, "0")
        for row in frame
    ]
    rows = [int(row, 2).to_bytes(len(row) // 8, "big") for row in digits]
    strips = [b"".join(rows[k : k + rows_per_strip]) for k in range(0, height, rows_per_strip)]
    offsets = 8 + np.cumsum([0, *map(len, strips)])
    arrays = offsets[-1] + np.array([0, 4 * len(strips)])
    if len(strips) == 1:  # one value stands in the tag itself
        arrays = [offsets[0], len(strips[0])]
    tags = [
        *((256, 4, 1, width), (257, 4, 1, height), (258, 3, 1, bits), (259, 3, 1, 1), (262, 3, 1, 1)),
        *((273, 4, len(strips), arrays[0]), (277, 3, 1, 1), (278, 4, 1, rows_per_strip)),
        (279, 4, len(strips), arrays[1]),
    ]
    directory = struct.pack("<H", len(tags)) + b"".join(
        struct.pack("<HHI", *tag[:3])
        + (struct.pack("<HH", tag[3], 0) if tag[1] == 3 else struct.pack("<I", tag[3]))
        for tag in tags
    )
    lists = struct.pack(f"<{2 * len(strips)}I", *offsets[:-1], *map(len, strips))
    start = offsets[-1] + len(lists)
    path.write_bytes(b"II*\0" + struct.pack("<I", start) + b"".join(strips) + lists + directory + b"\0\0\0\0")


def check_exact(path, stack):
    source = open_frames(path)
    assert len(source) == len(stack)
    assert source.dtype == stack.dtype
    for _ in range(2):
        np.testing.assert_array_equal(np.stack(list(source)), stack)
    np.testing.assert_array_equal(source[-1], stack[-1])
    np.testing.assert_array_equal(list(source.iterate(2)), list(stack[2:]))
    return source


@pytest.mark.parametrize("dtype", ["u1", "u2", "i2", "u4", "f4", "f8"])
@pytest.mark.parametrize(
    "options", [{}, {"bigtiff": True}, {"byteorder": ">"}, {"compression": "zlib"}], ids=str
)
def test_stacks_are_exact(tmp_path, stack, dtype, options):
    values = (stack // 256 if dtype == "u1" else stack).astype(dtype)
    if dtype[0] == "f":
        values = values / values.dtype.type(7)
        values[0, 0, 0] = np.nan
    tifffile.imwrite(tmp_path / "a.tif", values, photometric="minisblack", **options)
    source = check_exact(tmp_path / "a.tif", values)
    assert source.names[3] == "a.tif[3]"


@pytest.mark.parametrize(
    "options", [{}, {"compression": "zlib"}, {"tile": (16, 16)}, {"rowsperstrip": 7}], ids=str
)
def test_separate_pages_are_exact(tmp_path, stack, options):
    write_pages(tmp_path / "a.tiff", stack, **options)
    assert check_exact(tmp_path / "a.tiff", stack).times is None


def test_half_floats_become_floats(tmp_path, stack):
    tifffile.imwrite(tmp_path / "a.tif", (stack[0] / 65536).astype(np.float16))
    assert open_frames(tmp_path / "a.tif").dtype == np.float32


def test_imagej_stack_with_times(tmp_path, stack):
    metadata = {"axes": "TYX", "finterval": 250.0, "tunit": "ms"}
    tifffile.imwrite(tmp_path / "a.tif", stack, imagej=True, metadata=metadata)
    source = check_exact(tmp_path / "a.tif", stack)
    np.testing.assert_allclose(source.times, 0.25 * np.arange(5))


def test_imagej_slices_are_read_as_frames(tmp_path, stack):
    tifffile.imwrite(tmp_path / "a.tif", stack, imagej=True, metadata={"axes": "ZYX"})
    source = check_exact(tmp_path / "a.tif", stack)
    assert source.notes == ("the slices (Z) of the stack are read as frames over time",)


def test_ome_stack_with_times(tmp_path, stack):
    metadata = {"axes": "TYX", "TimeIncrement": 20.0, "TimeIncrementUnit": "ms"}
    tifffile.imwrite(tmp_path / "a.ome.tif", stack, photometric="minisblack", metadata=metadata)
    np.testing.assert_allclose(check_exact(tmp_path / "a.ome.tif", stack).times, 0.02 * np.arange(5))


@pytest.mark.parametrize("planar", ["contig", "separate"])
@pytest.mark.parametrize("compression", [None, "zlib"])
def test_colour(tmp_path, stack, planar, compression):
    colour = np.stack([stack, stack[:, ::-1], stack[:, :, ::-1]], axis=-1 if planar == "contig" else 1)
    tifffile.imwrite(
        tmp_path / "a.tif", colour, photometric="rgb", planarconfig=planar, compression=compression
    )
    source = open_frames(tmp_path / "a.tif")
    assert source.notes == ("colour → luminance (Rec. 709)",)
    assert len(source) == 5
    last = np.moveaxis(colour, 1, -1)[-1] if planar == "separate" else colour[-1]
    np.testing.assert_allclose(source[-1], last @ [0.2126, 0.7152, 0.0722], rtol=1e-5)


def test_palette(tmp_path, stack):
    colours = np.random.default_rng(1).integers(0, 65536, (3, 256), dtype=np.uint16)
    indices = (stack[0] // 256).astype(np.uint8)
    tifffile.imwrite(tmp_path / "a.tif", indices, photometric="palette", colormap=colours)
    source = open_frames(tmp_path / "a.tif")
    assert source.notes[0] == "palette colours read as colour"
    np.testing.assert_allclose(
        source[0], [0.2126, 0.7152, 0.0722] @ colours[:, indices].transpose(1, 0, 2), rtol=1e-5
    )


@pytest.mark.parametrize("bits", [9, 10, 12, 14])
@pytest.mark.parametrize(("width", "rows_per_strip"), [(30, 20), (31, 7)])
def test_packed_bits(tmp_path, bits, width, rows_per_strip):
    frame = np.random.default_rng(bits).integers(0, 2**bits, (20, width), dtype=np.uint16)
    write_packed(tmp_path / "a.tif", frame, bits, rows_per_strip)
    source = open_frames(tmp_path / "a.tif")
    assert source.dtype == np.uint16
    np.testing.assert_array_equal(source[0], frame)


def test_packed_bits_cut_short(tmp_path, stack):
    path = tmp_path / "a.tif"
    write_packed(path, stack[0] // 16, 12, 20)
    assert unpack_rows(b"\xff" * 3, 1, 2, 12).tolist() == [[4095, 4095]]
    data = bytearray(path.read_bytes())
    position = data.index(struct.pack("<HHI", 273, 4, 1)) + 8
    strip = struct.unpack_from("<I", data, position)[0]
    struct.pack_into("<I", data, strip if strip < 8 else position, len(data) - 10)
    path.write_bytes(data)
    with pytest.raises(FrameFileError, match="cut short or damaged"):
        open_frames(path)


def test_bilevel(tmp_path, stack):
    tifffile.imwrite(tmp_path / "a.tif", stack[0] > 30000)
    np.testing.assert_array_equal(open_frames(tmp_path / "a.tif")[0], np.where(stack[0] > 30000, 255, 0))


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_lzw_without_imagecodecs(tmp_path, stack, dtype, monkeypatch):
    pages = [Image.fromarray(frame) for frame in stack.astype(dtype)]
    pages[0].save(tmp_path / "a.tif", compression="tiff_lzw", save_all=True, append_images=pages[1:])
    check_exact(tmp_path / "a.tif", stack.astype(dtype))


def test_what_only_imagecodecs_reads(tmp_path, stack):
    path = tmp_path / "a.tif"
    write_pages(path, stack[:1])
    data = bytearray(path.read_bytes())
    position = data.index(struct.pack("<HHI", 259, 3, 1)) + 8
    struct.pack_into("<H", data, position, 34887)  # LERC
    path.write_bytes(data)
    with pytest.raises(
        FrameFileError, match=r"stored with LERC and need imagecodecs: pip install sixflow\[codecs\]"
    ):
        open_frames(path)


@pytest.mark.parametrize("kind", ["single", "stack", "imagej", "pages", "zlib"])
@pytest.mark.parametrize("fraction", [0.8, 0.5, 0.03])
def test_cut_short(tmp_path, stack, kind, fraction, capfd):
    path = tmp_path / "a.tif"
    if kind == "single":
        tifffile.imwrite(path, stack[0])
    elif kind == "imagej":
        tifffile.imwrite(path, stack, imagej=True, metadata={"axes": "TYX"})
    elif kind == "pages":
        write_pages(path, stack)
    else:
        compression = "zlib" if kind == "zlib" else None
        tifffile.imwrite(path, stack, photometric="minisblack", compression=compression)
    data = path.read_bytes()
    path.write_bytes(data[: int(fraction * len(data))])
    with pytest.raises(
        FrameFileError, match=r"a.tif: .*(cut short or damaged|cannot be read).*copy or export"
    ):
        list(open_frames(path))
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("content", [b"hello world" * 9, b"II*\0", b"II*\0\x08\0\0\0\0\0\0\0\0\0"])
def test_no_tiff_at_all(tmp_path, content, capfd):
    (tmp_path / "a.tif").write_bytes(content)
    with pytest.raises(FrameFileError, match=r"a.tif: .* export it again"):
        open_frames(tmp_path / "a.tif")
    assert capfd.readouterr() == ("", "")


def test_pages_of_different_shape(tmp_path, stack):
    write_pages(tmp_path / "a.tif", [stack[0], stack[1, :, :-2]])
    with pytest.raises(InputError, match=r"holds 2 positions or series .*0, one frame of 30×20 px; 1, one"):
        open_frames(tmp_path / "a.tif")


def test_previews_are_left_out(tmp_path, stack):
    with tifffile.TiffWriter(tmp_path / "a.tif") as tif:
        tif.write(stack[0], metadata=None)
        tif.write(stack[0, ::2, ::2], metadata=None, subfiletype=1)
    check_exact(tmp_path / "a.tif", stack[:1])


def test_folder_of_single_pages_and_of_stacks(tmp_path, stack):
    for number in (1, 2, 10):
        tifffile.imwrite(tmp_path / f"p{number}.tif", stack[number % 5])
    source = check_exact(tmp_path, stack[[1, 2, 0]])
    assert source.names == ("p1.tif", "p2.tif", "p10.tif")
    tifffile.imwrite(tmp_path / "p10.tif", stack, photometric="minisblack")
    with pytest.raises(FrameFileError, match=r"p10.tif: holds more than 1 frame, unlike the first file"):
        list(open_frames(tmp_path))
    tifffile.imwrite(tmp_path / "p1.tif", stack[:2], photometric="minisblack")
    source = check_exact(tmp_path, np.concatenate([stack[:2], stack[2:3], stack]))
    assert source.names[:3] == ("p1.tif[0]", "p1.tif[1]", "p2.tif")
