"""Which frames: channels, slices, positions, parts, and what the names of files say."""

from pathlib import Path

import numpy as np
import pytest
import tifffile
from PIL import Image

from sixflow.errors import FrameFileError, InputError
from sixflow.frames import BadFrame, open_frames
from sixflow.frames.naming import natural_order, read_names

FILM = np.random.default_rng(5).integers(0, 255, (12, 16, 24)).astype(np.uint8)


def check(source, frames):
    assert len(source) == len(frames)
    np.testing.assert_array_equal(list(source), frames)
    return source


def save_images(folder, names, frames=FILM):
    for name, frame in zip(names, frames, strict=False):
        Image.fromarray(frame).save(folder / name)


# Parts of a recording


def test_slices_keep_numbers_names_and_times(tmp_path):
    metadata = {"axes": "TYX", "finterval": 0.5}
    tifffile.imwrite(tmp_path / "a.tif", FILM, imagej=True, metadata=metadata)
    part = check(open_frames(tmp_path / "a.tif")[2:9:3], FILM[2:9:3])
    assert list(part.numbers) == [2, 5, 8]
    assert part.names == ("a.tif[2]", "a.tif[5]", "a.tif[8]")
    np.testing.assert_allclose(part.times, [1.0, 2.5, 4.0])
    assert part.description.startswith(f"{tmp_path / 'a.tif'}, frames 2 to 8, every 3: 3 frames of 24×16 px")
    inner = check(part[1:], FILM[[5, 8]])
    assert list(inner.numbers) == [5, 8]
    np.testing.assert_array_equal(inner[-1], FILM[8])
    np.testing.assert_array_equal(next(part.iterate(2)), FILM[8])
    assert inner.fingerprint == open_frames(FILM[5:]).fingerprint != part.fingerprint
    same = check(open_frames(tmp_path / "a.tif", first=2, last=8, every=3), FILM[2:9:3])
    assert same.numbers == part.numbers
    assert check(open_frames(part, first=1), FILM[[5, 8]]).numbers == inner.numbers


def test_parts_of_streams_and_lists():
    assert [int(f[0, 0]) for f in open_frames((f for f in FILM), first=1, every=4)] == FILM[
        1::4, 0, 0
    ].tolist()
    check(open_frames(list(FILM), last=3), FILM[:4])
    np.testing.assert_array_equal(open_frames(FILM)[np.int64(3)], FILM[3])


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ({"first": 12}, "first=12: the recording has the frames 0 to 11"),
        ({"last": 12}, "last=12: the recording has the frames 0 to 11"),
        ({"first": 5, "last": 4}, "comes before first=5"),
        ({"every": 0}, "every=0: must be a whole number, at least 1"),
        ({"channel": 1}, "channel=1: .* has one channel only"),
        ({"z": 2}, "z=2: .* has one slice only"),
        ({"position": "A"}, "position='A': .* has one position only"),
    ],
)
def test_choices_out_of_range(tmp_path, how, message):
    tifffile.imwrite(tmp_path / "a.tif", FILM, photometric="minisblack")
    for source in (FILM, tmp_path / "a.tif"):
        with pytest.raises(InputError, match=message):
            open_frames(source, **how)


def test_slices_that_are_refused():
    source = open_frames(FILM)
    for bad, message in (
        (slice(None, None, -1), "runs forwards"),
        (slice(20, 30), "0 to 11"),
        (slice(5, 5), "none"),
    ):
        with pytest.raises(InputError, match=message):
            source[bad]
    with pytest.raises(InputError, match="count from the beginning"):
        open_frames(f for f in FILM)[-3:]


def test_number_zero_chooses_what_has_but_one(tmp_path):
    save_images(tmp_path, ["a0.png", "a1.png"])
    check(open_frames(tmp_path, channel=0, z=0, position=0), FILM[:2])


# Stacks with several axes


def test_channels_and_slices_of_imagej(tmp_path):
    values = FILM.reshape(2, 3, 2, 16, 24)  # T Z C
    labels = [f"{c} {z}" for _ in range(2) for z in ("low", "mid", "top") for c in ("red", "blue")]
    tifffile.imwrite(tmp_path / "a.tif", values, imagej=True, metadata={"axes": "TZCYX", "Labels": labels})
    with pytest.raises(
        InputError, match=r"slices 0 .*\(z=\) and the channels 0 .*1 'blue low' \(channel=\); choose one"
    ):
        open_frames(tmp_path / "a.tif")
    check(open_frames(tmp_path / "a.tif", channel=1, z=2), values[:, 2, 1])
    check(open_frames(tmp_path / "a.tif", channel="blue low", z="red mid"), values[:, 1, 1])
    with pytest.raises(InputError, match="channel=2: there is none of this number"):
        open_frames(tmp_path / "a.tif", channel=2, z=0)


def test_two_channels_are_no_frames(tmp_path):
    tifffile.imwrite(tmp_path / "c.tif", FILM[:2], imagej=True, metadata={"axes": "CYX"})
    with pytest.raises(InputError, match=r"channels 0, 1 \(channel=\); choose one"):
        open_frames(tmp_path / "c.tif")
    check(open_frames(tmp_path / "c.tif", channel=1), FILM[1:2])


def test_samples_that_are_channels(tmp_path):
    for planar, axis in (("separate", 1), ("contig", -1)):
        values = np.stack([FILM[:3], FILM[3:6]], axis)
        tifffile.imwrite(
            tmp_path / "s.tif", values, photometric="minisblack", planarconfig=planar, metadata=None
        )
        with pytest.raises(InputError, match="channels 0, 1"):
            open_frames(tmp_path / "s.tif")
        check(open_frames(tmp_path / "s.tif", channel=1), FILM[3:6])


def test_channels_of_colour_pictures(tmp_path):
    colour = np.stack([FILM[:3], FILM[3:6], FILM[6:9]], -1)
    tifffile.imwrite(tmp_path / "c.tif", colour, photometric="rgb")
    for source in (colour, tmp_path / "c.tif"):
        assert (
            "the green of the colours is read" in check(open_frames(source, channel="green"), FILM[3:6]).notes
        )
        check(open_frames(source, channel=2), FILM[6:9])
        with pytest.raises(InputError, match="has the channels 0 'red', 1 'green', 2 'blue'"):
            open_frames(source, channel=3)


def test_several_series(tmp_path):
    with tifffile.TiffWriter(tmp_path / "two.tif") as writer:
        writer.write(FILM[:4], photometric="minisblack", metadata={"name": "dark"})
        writer.write(FILM[4:], photometric="minisblack", metadata={"name": "run"})
    with pytest.raises(InputError, match=r"2 positions or series \(position=\): 0 'dark', .*; 1 'run'"):
        open_frames(tmp_path / "two.tif")
    check(open_frames(tmp_path / "two.tif", position="run"), FILM[4:])
    check(open_frames(tmp_path / "two.tif", position=0), FILM[:4])
    with pytest.raises(InputError, match="position=2: there is none of this number"):
        open_frames(tmp_path / "two.tif", position=2)


def test_pages_written_one_by_one_are_frames(tmp_path):
    with tifffile.TiffWriter(tmp_path / "a.tif") as writer:
        for frame in FILM:
            writer.write(frame)
    check(open_frames(tmp_path / "a.tif"), FILM)


# Missing and damaged frames


def test_pages_that_are_not_there(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", FILM, imagej=True, metadata={"axes": "TYX"})
    data = (tmp_path / "a.tif").read_bytes()
    with tifffile.TiffFile(tmp_path / "a.tif") as tif:
        begin = tif.pages[0].dataoffsets[0]
    (tmp_path / "a.tif").write_bytes(data[: begin + 7 * 16 * 24 + 100])
    source = open_frames(tmp_path / "a.tif")
    frames = list(source.attempt())
    assert [isinstance(frame, BadFrame) for frame in frames] == [False] * 7 + [True] * 5
    np.testing.assert_array_equal(frames[:7], FILM[:7])
    assert "the file states 12 frames, 7 are there: it is cut short or damaged" in source.notes
    with pytest.raises(FrameFileError, match="frame 7 is not there"):
        list(source)


def test_a_page_that_cannot_be_decoded(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", FILM, compression="zlib", photometric="minisblack")
    data = bytearray((tmp_path / "a.tif").read_bytes())
    with tifffile.TiffFile(tmp_path / "a.tif") as tif:
        begin = tif.pages[4].dataoffsets[0]
    data[begin + 50 : begin + 60] = bytes(10)
    (tmp_path / "a.tif").write_bytes(data)
    frames = list(open_frames(tmp_path / "a.tif").attempt())
    assert [k for k, frame in enumerate(frames) if isinstance(frame, BadFrame)] == [4]


def test_a_file_that_cannot_be_read_among_others(tmp_path):
    save_images(tmp_path, [f"a{k}.png" for k in range(5)])
    (tmp_path / "a0.png").write_bytes(b"")
    (tmp_path / "a3.png").write_bytes(b"no picture")
    frames = list(open_frames(tmp_path).attempt())
    assert [k for k, frame in enumerate(frames) if isinstance(frame, BadFrame)] == [0, 3]
    np.testing.assert_array_equal(frames[4], FILM[4])
    with pytest.raises(FrameFileError, match=r"a0.png: the file is empty"):
        list(open_frames(tmp_path))


# Names


@pytest.mark.parametrize(
    "names",
    [
        ["img2", "img10", "img100"],
        ["z-10", "z-9", "z0", "z5"],
        ["z_-10", "z_-9"],
        ["x-2", "x-1", "x+0", "x+1"],
        ["t0.25", "t0.5", "t1", "t1.25"],
        ["run-1", "run-2", "run-10"],
        ["a1.8", "a1.9", "a1.10", "a1.11"],
        ["2026.01.02", "2026.01.10", "2026.02.01"],
        ["A_2026-01-09_1", "A_2026-01-10_0"],
        ["1", "2", "12345678901234567890123"],
    ],
)
def test_natural_order(names):
    paths = [Path(f"{name}.tif") for name in names]
    assert natural_order(paths[::-1]) == paths
    assert natural_order(paths[1:] + paths[:1]) == paths


@pytest.mark.parametrize(
    ("names", "notes"),
    [
        ([f"a{k}" for k in (0, 10, 20, 30)], []),
        ([f"t{k}" for k in (1000, 1033, 1067, 1100)], []),
        ([f"a{k}" for k in (0, 10, 20, 40)], ["a gap: a20.tif is followed by a40.tif"]),
        (
            [f"a{k}" for k in (1, 2, 4, 5, 6, 9, 10)],
            ["2 gaps: a2.tif is followed by a4.tif; a6.tif is followed by a9.tif"],
        ),
        ([f"a{k}" for k in range(4)] + ["ref"], [r"ref.tif \(frame 4, the last\) does not follow the names"]),
        (["0ref", *(f"a{k}" for k in range(4))], [r"0ref.tif \(frame 0, the first\)"]),
        (
            [f"r{r}_{k}" for r in (1, 2) for k in range(4)],
            ["2 runs follow each other, new ones begin with r2_0.tif"],
        ),
        ([f"a{k}{side}" for k in range(4) for side in "ab"], []),
        (["a0", "a2"], []),
    ],
)
def test_notes_on_names(names, notes):
    import re

    found = read_names([Path(f"{name}.tif") for name in names]).notes
    assert len(found) == len(notes)
    assert all(re.search(note, text) for note, text in zip(notes, found, strict=True))


def test_a_list_out_of_order_is_told(tmp_path):
    names = ["a1.png", "a10.png", "a2.png"]
    save_images(tmp_path, names)
    source = check(open_frames([tmp_path / name for name in names]), FILM[:3])
    assert source.notes == (
        "the files are taken in the order given, not in that of their numbers: a10.png comes before a2.png",
    )


def test_notes_of_later_files(tmp_path):
    save_images(tmp_path, ["a0.png", "a1.png", "a2.png"], np.stack([FILM] * 3, -1))
    Image.fromarray(np.stack([*[FILM[1]] * 3, np.full((16, 24), 9, np.uint8)], -1)).save(tmp_path / "a1.png")
    source = open_frames(tmp_path)
    assert source.notes == ("colour → luminance (Rec. 709)",)
    assert len(list(source)) == len(list(source)) == 3
    assert any(note.startswith(str(tmp_path / "a1.png")) and "alpha" in note for note in source.notes)
