"""Image files, folders, patterns and lists: what is read, in which order, and what is refused."""

import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from sixflow.errors import FrameFileError, InputError
from sixflow.frames import open_frames
from sixflow.frames.grey import LUMINANCE
from sixflow.frames.paths import find_files


@pytest.fixture
def picture():
    return np.random.default_rng(1).integers(0, 250, (24, 32), dtype=np.uint8)


def save_folder(folder, picture, names):
    folder.mkdir(exist_ok=True)
    for number, name in enumerate(names):
        Image.fromarray(picture + np.uint8(number)).save(folder / name)
    return folder


@pytest.mark.parametrize("suffix", [".png", ".bmp", ".pgm", ".PNG"])
def test_lossless_grey_images_are_exact(tmp_path, picture, suffix):
    Image.fromarray(picture).save(tmp_path / f"a{suffix}")
    source = open_frames(tmp_path / f"a{suffix}")
    assert source.shape == (24, 32)
    assert source.dtype == np.uint8
    assert source.names == (f"a{suffix}",)
    assert source.times is None
    assert source.notes == ()
    np.testing.assert_array_equal(source[0], picture)


def test_jpeg_is_close(tmp_path):
    smooth = np.tile(np.arange(0, 256, 4, dtype=np.uint8), (48, 1))
    Image.fromarray(smooth).save(tmp_path / "a.jpeg", quality=95)
    assert np.abs(open_frames(tmp_path / "a.jpeg")[0].astype(int) - smooth).max() < 6


@pytest.mark.parametrize("suffix", [".png", ".pgm"])
def test_sixteen_bits_stay_sixteen_bits(tmp_path, suffix):
    deep = np.random.default_rng(2).integers(0, 65536, (24, 32), dtype=np.uint16)
    Image.fromarray(deep).save(tmp_path / f"a{suffix}")
    frame = open_frames(tmp_path / f"a{suffix}")[0]
    assert frame.dtype == np.uint16
    np.testing.assert_array_equal(frame, deep)


@pytest.mark.parametrize("mode", ["RGB", "RGBA", "LA", "1", "P", "CMYK"])
def test_other_modes_become_grey(tmp_path, picture, mode):
    colour = Image.fromarray(np.dstack([picture, picture[::-1], picture[:, ::-1]]))
    name = tmp_path / ("a.jpg" if mode == "CMYK" else "a.png")
    image = colour.convert(mode)
    image.save(name)
    source = open_frames(name)
    (frame,) = source
    notes = " ".join(source.notes)
    assert frame.shape == (24, 32)
    assert ("luminance (Rec. 709)" in notes) == (mode in ("RGB", "RGBA", "P", "CMYK"))
    assert ("alpha" in notes) == (mode in ("RGBA", "LA"))
    if mode == "RGB":
        assert frame.dtype == np.float32
        np.testing.assert_allclose(frame, np.asarray(image) @ LUMINANCE.astype(float), rtol=1e-6)
    if mode == "1":
        assert set(np.unique(frame)) <= {0, 255}
    if mode == "LA":
        np.testing.assert_array_equal(frame, np.asarray(image)[..., 0])


def test_equal_channels_give_the_same_grey(tmp_path, picture):
    Image.fromarray(np.dstack([picture] * 3)).save(tmp_path / "a.png")
    np.testing.assert_allclose(open_frames(tmp_path / "a.png")[0], picture, rtol=1e-6)


def test_orientation_is_noted_and_not_applied(tmp_path, picture):
    exif = Image.Exif()
    exif[0x0112] = 6
    Image.fromarray(picture).save(tmp_path / "a.jpg", exif=exif)
    source = open_frames(tmp_path / "a.jpg")
    assert source.shape == (24, 32)
    assert any("orientation is not applied" in note for note in source.notes)


def test_folder_in_natural_order(tmp_path, picture):
    folder = save_folder(tmp_path / "run", picture, ["img10.png", "img2.png", "img1.png"])
    (folder / ".img0.png").write_bytes(b"hidden")
    (folder / "notes.txt").write_text("x")
    (folder / "sub").mkdir()
    source = open_frames(folder)
    assert source.names == ("img1.png", "img2.png", "img10.png")
    assert source.notes[0] == "other files in the folder passed over: 1"
    assert source.notes[1] == "the numbers of the files have a gap: img2.png is followed by img10.png"
    assert len(source) == 3
    assert [int(frame[0, 0]) - int(picture[0, 0]) for frame in source] == [2, 1, 0]
    assert source.description.endswith("run (3 PNG files): 3 frames of 32×24 px, uint8")
    np.testing.assert_array_equal(source[-1], picture)
    np.testing.assert_array_equal(next(source.iterate(2)), picture)
    with pytest.raises(InputError, match="frame 3: the recording has the frames 0 to 2"):
        source[3]


def test_pattern_and_list(tmp_path, picture):
    folder = save_folder(tmp_path / "run", picture, ["a_10.png", "a_9.png", "b_1.png"])
    assert open_frames(str(folder / "a_*.png")).names == ("a_9.png", "a_10.png")
    assert open_frames(str(tmp_path / "**" / "b*.png")).names == ("b_1.png",)
    assert open_frames([folder / "b_1.png", str(folder / "a_10.png")]).names == ("b_1.png", "a_10.png")


def test_a_name_with_brackets_is_a_name_first(tmp_path, picture):
    Image.fromarray(picture).save(tmp_path / "a[1].png")
    assert open_frames(tmp_path / "a[1].png").names == ("a[1].png",)


def test_missing_file_suggests_similar_names(tmp_path, picture):
    save_folder(tmp_path, picture, ["image_001.png"])
    with pytest.raises(FrameFileError, match=r"image_01.png: no such file; did you mean 'image_001.png'\?"):
        open_frames(tmp_path / "image_01.png")
    with pytest.raises(FrameFileError, match=r"the folder .*nowhere' does not exist either"):
        open_frames(tmp_path / "nowhere" / "a.png")


def test_refused_folders(tmp_path, picture):
    (tmp_path / "empty").mkdir()
    with pytest.raises(FrameFileError, match="a folder without frames; it holds nothing"):
        open_frames(tmp_path / "empty")
    with pytest.raises(FrameFileError, match="it holds the folders 'empty'; give one of them"):
        open_frames(tmp_path)
    (tmp_path / "text").mkdir()
    (tmp_path / "text" / "a.dat").write_text("x")
    with pytest.raises(FrameFileError, match=r"it holds only files of other kinds \(.dat\); convert"):
        open_frames(tmp_path / "text")
    mixed = save_folder(tmp_path / "mixed", picture, ["a.png", "b.png", "c.bmp"])
    with pytest.raises(FrameFileError, match=r"different kinds, 2 PNG and 1 BMP; .*\*.png"):
        open_frames(mixed)


def test_refused_patterns(tmp_path, picture):
    with pytest.raises(FrameFileError, match="no file matches; check the pattern"):
        open_frames(tmp_path / "*.png")
    (tmp_path / "a.dat").write_text("x")
    with pytest.raises(FrameFileError, match="what it matches are no files of frames"):
        open_frames(tmp_path / "*")


def test_refused_files(tmp_path):
    (tmp_path / "a.xyz").write_text("x")
    with pytest.raises(FrameFileError, match=r"the suffix '.xyz' is unknown; sixflow reads .*\.tiff"):
        open_frames(tmp_path / "a.xyz")
    (tmp_path / "plain").write_text("x")
    with pytest.raises(FrameFileError, match="it has no suffix"):
        open_frames(tmp_path / "plain")
    (tmp_path / "empty.png").touch()
    with pytest.raises(FrameFileError, match=r"empty.png: the file is empty \(0 bytes\)"):
        open_frames(tmp_path / "empty.png")
    with pytest.raises(FrameFileError, match="an empty list of files"):
        find_files([])
    with pytest.raises(FrameFileError, match="a folder in a list of files"):
        open_frames([tmp_path])


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".bmp"])
def test_damaged_images(tmp_path, picture, suffix):
    path = tmp_path / f"a{suffix}"
    Image.fromarray(picture).save(path)
    whole = path.read_bytes()
    for damaged in (whole[: len(whole) // 2], whole[:4], b"not an image at all"):
        path.write_bytes(damaged)
        with pytest.raises(
            FrameFileError, match=rf"a{suffix}: cannot be read as an image .* export it again"
        ):
            open_frames(path)


def test_png_with_a_wrong_checksum(tmp_path, picture):
    path = tmp_path / "a.png"
    Image.fromarray(picture).save(path)
    data = bytearray(path.read_bytes())
    data[60] ^= 0xFF
    path.write_bytes(data)
    with pytest.raises(FrameFileError, match="cannot be read as an image"):
        open_frames(path)


def test_unreadable_file(tmp_path, picture, monkeypatch):
    folder = save_folder(tmp_path / "run", picture, ["a.png", "b.png"])
    opened = Path.open

    def refusing(path, *args, **kwargs):
        if path.name == "b.png":
            raise PermissionError(13, os.strerror(13))
        return opened(path, *args, **kwargs)

    monkeypatch.setattr(Path, "open", refusing)
    frames = iter(open_frames(folder))
    next(frames)
    with pytest.raises(
        FrameFileError, match=r"b.png: cannot be opened \(Permission denied\); check its perm"
    ):
        next(frames)


def test_frames_must_be_alike(tmp_path, picture):
    folder = save_folder(tmp_path / "run", picture, ["a.png", "b.png"])
    Image.fromarray(picture[:, :-2]).save(folder / "c.png")
    source = open_frames(folder)
    with pytest.raises(InputError, match=r"c.png has 30×24 px of uint8, but .*a.png has 32×24 px of uint8"):
        list(source)
    Image.fromarray(picture.astype(np.uint16)).save(folder / "c.png")
    with pytest.raises(InputError, match=r"c.png has 32×24 px of uint16, but .*a.png has 32×24 px of uint8"):
        list(source)


def test_a_file_that_vanishes_is_reported(tmp_path, picture):
    folder = save_folder(tmp_path / "run", picture, ["a.png", "b.png"])
    source = open_frames(folder)
    (folder / "b.png").unlink()
    with pytest.raises(FrameFileError, match=r"b.png: cannot be opened \(No such file or directory\)"):
        list(source)
