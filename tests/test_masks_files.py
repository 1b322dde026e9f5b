"""Masks from files: what is inside is what the file says, whatever its kind; what cannot have been meant is said."""

import dataclasses

import numpy as np
import pytest
import tifffile
from PIL import Image

from sixflow import FrameFileError, InputError, measure, measure_sequence, read_mask
from sixflow.cli import main
from sixflow.errors import SixflowError
from sixflow.masks import Bodies, Masks, open_mask
from sixflow.masks.said import said_of_mask
from sixflow.synth import Affine, Sensor, Speckle, sequence

SHAPE = (64, 96)
RIGHT = np.zeros(SHAPE, bool)
RIGHT[:, 48:] = True
LABELS = RIGHT.astype(np.uint8)
LABELS[:32, 48:] = 2
ON = np.where(RIGHT, 255, 0).astype(np.uint8)
FRAMES = sequence(
    Speckle(seed=1), Affine.translation(0.7, -0.3), SHAPE, 3, sensor=Sensor(noise=1, bits=8)
).frames


def palette(index, colours=(200, 200, 200, 40, 160, 40, 0, 0, 0), **more):
    picture = Image.fromarray(index, "P")
    picture.putpalette([*colours, *[0] * (768 - len(colours))])
    return lambda path: picture.save(path, **more)


def picture(array, **more):
    return lambda path: Image.fromarray(array).save(path, **more)


def stacked(*planes):
    return np.stack(planes, axis=-1)


WHITE, BLACK = np.full(SHAPE, 255, np.uint8), np.zeros(SHAPE, np.uint8)
LEFT_INDEX = palette(1 - RIGHT.astype(np.uint8), (10, 10, 10, 200, 0, 0), transparency=1)
INSIDE = {
    "grey.png": picture(ON),
    "one_bit.png": picture(RIGHT),
    "one_bit.bmp": picture(RIGHT),
    "few.png": picture(LABELS),
    "deep.png": picture(ON.astype(np.uint16) * 200),
    "small_and_deep.tif": lambda path: tifffile.imwrite(path, RIGHT.astype(np.uint32)),
    "grey.pgm": picture(ON),
    "palette.png": palette(RIGHT.astype(np.uint8)),
    "palette.gif": palette(RIGHT.astype(np.uint8)),
    "palette.bmp": palette(RIGHT.astype(np.uint8)),
    "transparent_index_0.png": palette(RIGHT.astype(np.uint8), transparency=0),
    "only_index_0_is_opaque.png": LEFT_INDEX,
    "erased.png": picture(stacked(WHITE, WHITE, WHITE, ON)),
    "erased_half.png": picture(stacked(WHITE, WHITE, WHITE, ON // 2)),
    "black_on_nothing.png": picture(stacked(BLACK, BLACK, BLACK, ON)),
    "grey_and_alpha.png": picture(stacked(WHITE, ON)),
    "values_and_opaque.png": picture(stacked(ON, WHITE)),
    "red.png": picture(stacked(ON, BLACK, BLACK)),
    "blue.tif": lambda path: tifffile.imwrite(path, stacked(BLACK, BLACK, ON), photometric="rgb"),
    "erased.tif": lambda path: tifffile.imwrite(
        path, stacked(WHITE, WHITE, WHITE, ON), photometric="rgb", extrasamples=["unassalpha"]
    ),
    "white_is_zero.tif": lambda path: tifffile.imwrite(path, 255 - ON, photometric="miniswhite"),
    "palette.tif": lambda path: tifffile.imwrite(
        path, RIGHT.astype(np.uint16), photometric="palette", colormap=np.full((3, 2**16), 7, np.uint16)
    ),
    "float.tif": lambda path: tifffile.imwrite(path, np.where(RIGHT, 0.5, np.nan).astype(np.float32)),
    "bool.npy": lambda path: np.save(path, RIGHT),
    "float.npy": lambda path: np.save(path, np.where(RIGHT, 0.5, np.nan)),
    "one.npz": lambda path: np.savez(path, anything=LABELS),
    "named.npz": lambda path: np.savez(path, mask=LABELS, other=np.zeros(3)),
}


@pytest.mark.parametrize("name", INSIDE)
def test_what_is_inside(name, tmp_path):
    path = tmp_path / name
    INSIDE[name](path)
    mask = read_mask(path)
    assert mask.dtype == bool
    np.testing.assert_array_equal(mask, RIGHT)


BODIES = {
    "grey.png": picture(LABELS),
    "palette.png": palette(LABELS),
    "palette.gif": palette(LABELS),
    "palette.tif": lambda path: tifffile.imwrite(
        path, LABELS.astype(np.uint16), photometric="palette", colormap=np.full((3, 2**16), 7, np.uint16)
    ),
    "alpha.png": picture(stacked(np.where(RIGHT, LABELS, 9).astype(np.uint8), ON)),
    "grey_rgb.png": picture(stacked(LABELS, LABELS, LABELS)),
    "deep.tif": lambda path: tifffile.imwrite(path, LABELS.astype(np.uint32)),
    "float.npy": lambda path: np.save(path, np.where(RIGHT, LABELS, np.nan)),
    "int.npy": lambda path: np.save(path, LABELS.astype(np.int64)),
}


@pytest.mark.parametrize("name", BODIES)
def test_numbers_of_bodies(name, tmp_path):
    path = tmp_path / name
    BODIES[name](path)
    np.testing.assert_array_equal(read_mask(path, bodies=True), LABELS)


def test_samples_of_four_bits_keep_their_numbers(tmp_path):
    Image.fromarray(LABELS * 17).save(tmp_path / "grey.png", bits=4)
    depth = (tmp_path / "grey.png").read_bytes()[24]
    wanted = LABELS if depth == 4 else LABELS * 17
    np.testing.assert_array_equal(read_mask(tmp_path / "grey.png", bodies=True), wanted)
    assert set(np.unique(read_mask(tmp_path / "grey.png"))) == {False, True}


def test_large_numbers_of_bodies(tmp_path):
    tifffile.imwrite(tmp_path / "m.tif", LABELS.astype(np.uint32) * 70000)
    assert sorted(Bodies.of(read_mask(tmp_path / "m.tif", bodies=True)).boxes) == [70000, 140000]


REFUSED = {
    "photo.jpg": (picture(ON), "JPEG"),
    "renamed.png": (lambda path: Image.fromarray(ON).save(path, "JPEG"), "JPEG"),
    "cmyk.tif": (
        lambda path: tifffile.imwrite(path, np.zeros((*SHAPE, 4), "u1"), photometric="separated"),
        "SEPARATED",
    ),
    "several.npz": (lambda path: np.savez(path, a=LABELS, b=LABELS), "holds a, b"),
    "objects.npy": (
        lambda path: np.save(path, np.array([{}, 1], object), allow_pickle=True),
        "save it again",
    ),
    "line.npy": (lambda path: np.save(path, np.zeros(7)), "shape (7,)"),
    "words.npy": (lambda path: np.save(path, np.array([["a", "b"]])), "<U1"),
    "invisible.png": (picture(stacked(WHITE, WHITE, WHITE, BLACK)), "transparent everywhere"),
    "film.gif": (
        lambda path: Image.fromarray(ON).save(path, save_all=True, append_images=[Image.fromarray(WHITE)]),
        "holds 2 pictures",
    ),
    "text.png": (lambda path: path.write_text("no picture"), "cannot be read"),
    "empty.tif": (lambda path: path.write_bytes(b""), "cannot be read"),
    "cut.tif": (lambda path: path.write_bytes(b"II*\0\x08\0\0\0"), "holds no picture"),
    "unlike.tif": (
        lambda path: [tifffile.imwrite(path, one, append=True) for one in (ON, ON[:32])],
        "all must have one",
    ),
    "film.mp4": (lambda path: path.write_bytes(b"x"), "a video"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_can_be_no_mask(name, tmp_path):
    path = tmp_path / name
    make, said = REFUSED[name]
    make(path)
    with pytest.raises(SixflowError) as caught:
        read_mask(path)
    assert said in str(caught.value)
    assert str(path) in str(caught.value)


def test_colours_and_fractions_are_no_numbers_of_bodies(tmp_path):
    Image.fromarray(stacked(ON, BLACK, BLACK)).save(tmp_path / "red.png")
    np.save(tmp_path / "half.npy", RIGHT * 0.5)
    for name, said in (("red.png", "colours are no numbers"), ("half.npy", "whole numbers")):
        with pytest.raises(InputError, match=said):
            read_mask(tmp_path / name, bodies=True)
    with pytest.raises(FrameFileError, match="no such file"):
        read_mask(tmp_path / "nothing.png")
    with pytest.raises(FrameFileError, match="no file"):
        read_mask(tmp_path / "nothing*.png")


# One for each frame


def test_stacks_and_folders_are_one_for_each_frame(tmp_path):
    masks = np.stack([RIGHT, ~RIGHT, RIGHT | True])
    tifffile.imwrite(tmp_path / "stack.tif", masks.astype(np.uint8), photometric="minisblack")
    tifffile.imwrite(tmp_path / "imagej.tif", masks.astype(np.uint8), imagej=True, metadata={"axes": "TYX"})
    np.save(tmp_path / "stack.npy", masks)
    (tmp_path / "folder").mkdir()
    for number, mask in zip((1, 2, 10), masks, strict=True):
        Image.fromarray(mask).save(tmp_path / "folder" / f"m{number}.png")
    for name in ("stack.tif", "imagej.tif", "stack.npy", "folder", "folder/m*.png"):
        np.testing.assert_array_equal(read_mask(tmp_path / name), masks)
        assert Masks(tmp_path / name).moving
    fields = [
        measure_sequence(FRAMES, mask=mask, step=16)
        for mask in (
            str(tmp_path / "stack.tif"),
            masks,
            [str(tmp_path / "folder" / f"m{n}.png") for n in (1, 2, 10)],
        )
    ]
    for field in fields:
        np.testing.assert_array_equal(field.u, fields[0].u)
        assert field.attrs["mask"]


@pytest.mark.parametrize("count", [1, 2, 4])
def test_a_wrong_number_of_masks(count, tmp_path):
    np.save(tmp_path / "m.npy", np.stack([RIGHT] * count))
    mask = np.stack([RIGHT] * count)
    for given in (mask, tmp_path / "m.npy", iter(mask)) if count < 3 else (mask, tmp_path / "m.npy"):
        if count == 1 and given is not mask and not hasattr(given, "__next__"):
            continue  # a file of one mask is for all frames
        with pytest.raises(InputError, match="one for each frame"):
            measure_sequence(FRAMES, mask=given, step=16)


# What is said


def notes_of(mask, **options):
    return measure(FRAMES[0], FRAMES[1], mask=mask, step=16, **options).attrs["notes"]


def test_a_mask_that_leaves_nothing_out_is_said(tmp_path):
    Image.fromarray(np.where(RIGHT, 200, 60).astype(np.uint8)).save(tmp_path / "m.png")
    said = notes_of(tmp_path / "m.png")
    assert "m.png leaves nothing out" in said
    assert "60, 200" in said
    assert "leaves nothing out" in notes_of(np.ones(SHAPE, bool))
    assert "numbers from 60 to 200" in notes_of(np.where(RIGHT, 200, 60))
    assert "leaves nothing out" not in notes_of(LABELS + 1)  # bodies 1, 2, 3 fill the frame
    assert notes_of(RIGHT) == ""


def test_a_mask_that_leaves_hardly_anything_is_said(tmp_path):
    few = np.zeros(SHAPE, bool)
    few[20:30, 20:30] = True
    said = notes_of(few)
    assert "leaves 100 of 6144 pixels" in said
    assert "inverted" in said
    assert "less than one window" not in notes_of(few, window=9)
    assert "region of interest leaves 100" in notes_of(None, roi="20:30,20:30")


def test_notes_of_reading_reach_the_field_and_the_command_line(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for number in range(2):
        Image.fromarray(FRAMES[number]).save(f"f{number}.png")
    Image.fromarray(stacked(ON, BLACK, BLACK)).save("red.png")
    assert main(["measure", "f0.png", "f1.png", "-o", "f.nc", "--mask", "red.png", "--step", "16"]) == 0
    assert "mask red.png: is in colour" in capsys.readouterr().err
    palette(RIGHT.astype(np.uint8))("p.png")
    field = measure(FRAMES[0], FRAMES[1], mask="p.png", step=16)
    assert "index 0 is outside" in field.attrs["notes"]
    assert field.attrs["mask"].startswith("p.png, sha256 ")


def test_masked_entries_of_numpy_are_outside():
    mask = np.ma.masked_array(np.ones(SHAPE, bool), ~RIGHT)
    np.testing.assert_array_equal(Bodies.of(mask).labels != 0, RIGHT)


def test_bodies_that_fill_the_frame_are_meant():
    assert said_of_mask(Bodies.of(LABELS + 1), 31) == ()
    assert said_of_mask(Bodies.of(np.ones(SHAPE, int)), 31) != ()


# ImageJ


def roi(kind, **values):
    roifile = pytest.importorskip("roifile")
    corners = values.pop("corners", None)
    if corners is not None:
        one = roifile.ImagejRoi.frompoints(corners)
        return dataclasses.replace(one, roitype=roifile.ROI_TYPE[kind], **values)
    return roifile.ImagejRoi(roitype=roifile.ROI_TYPE[kind], **values)


def box(top, left, bottom, right):
    inside = np.zeros(SHAPE, bool)
    inside[top:bottom, left:right] = True
    return inside


BOX = {"top": 10, "left": 20, "bottom": 40, "right": 70}


def test_rectangles_and_polygons_of_imagej(tmp_path):
    corners = np.array([(20, 10), (70, 10), (70, 40), (20, 40)])
    kinds = {kind: roi(kind, corners=corners) for kind in ("POLYGON", "FREEHAND", "TRACED")}
    for name, one in {"r": roi("RECT", **BOX), **kinds}.items():
        one.tofile(tmp_path / f"{name}.roi")
        np.testing.assert_array_equal(read_mask(tmp_path / f"{name}.roi", shape=SHAPE), box(10, 20, 40, 70))
    with pytest.raises(InputError, match=r"shape=\(height, width\)"):
        read_mask(tmp_path / "r.roi")


def test_ovals_and_rounded_rectangles_of_imagej(tmp_path):
    roi("OVAL", **BOX).tofile(tmp_path / "o.roi")
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    ellipse = ((x - 44.5) / 25) ** 2 + ((y - 24.5) / 15) ** 2 <= 1
    np.testing.assert_array_equal(read_mask(tmp_path / "o.roi", shape=SHAPE), ellipse)
    roi("RECT", rounded_rect_arc_size=20, **BOX).tofile(tmp_path / "rr.roi")
    rounded = read_mask(tmp_path / "rr.roi", shape=SHAPE)
    assert not rounded[10, 20]
    assert rounded[10, 30:60].all()
    assert abs(rounded.sum() - (30 * 50 - (4 - np.pi) * 100)) < 10


def test_several_regions_are_a_union_or_bodies(tmp_path):
    path = tmp_path / "RoiSet.zip"
    roi("RECT", name="a", **BOX).tofile(path)
    roi("RECT", name="b", top=30, left=60, bottom=50, right=90).tofile(path, mode="a")
    both = box(10, 20, 40, 70) | box(30, 60, 50, 90)
    np.testing.assert_array_equal(read_mask(path, shape=SHAPE), both)
    numbers = read_mask(path, shape=SHAPE, bodies=True)
    np.testing.assert_array_equal(numbers, np.where(box(30, 60, 50, 90), 2, box(10, 20, 40, 70)))
    field = measure(FRAMES[0], FRAMES[1], mask=path, step=8)
    np.testing.assert_array_equal(field.flag.values[0] != 1, both[np.ix_(field.y, field.x)])
    assert "RoiSet.zip, sha256" in field.attrs["mask"]


@pytest.mark.parametrize("kind", ["LINE", "POINT", "POLYLINE", "FREELINE", "ANGLE", "NOROI"])
def test_regions_without_area(kind, tmp_path):
    corners = None if kind in ("LINE", "NOROI") else np.array([(20, 10), (70, 10), (70, 40)])
    roi(kind, corners=corners, name="thing").tofile(tmp_path / "x.roi")
    with pytest.raises(InputError, match=f"'thing' is of ImageJ's type {kind.lower()}"):
        read_mask(tmp_path / "x.roi", shape=SHAPE)


def test_regions_of_other_frames_and_damage(tmp_path):
    roi("RECT", top=500, left=500, bottom=600, right=600, name="far").tofile(tmp_path / "far.roi")
    with pytest.raises(InputError, match="region 'far' holds no pixel"):
        measure(FRAMES[0], FRAMES[1], mask=tmp_path / "far.roi")
    for name, content in (("cut.roi", b"Iout\0"), ("text.zip", b"no zip"), ("x.roi", b"")):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(FrameFileError, match=name):
            open_mask(tmp_path / name)
    import zipfile

    with zipfile.ZipFile(tmp_path / "none.zip", "w") as archive:
        archive.writestr("readme.txt", "x")
    with pytest.raises(FrameFileError):
        open_mask(tmp_path / "none.zip")
