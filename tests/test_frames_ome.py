"""OME-TIFF: sets of files, orders of planes, times and sizes; ImageJ's calibration."""

import numpy as np
import pytest
import tifffile

from sixflow.errors import FrameFileError, InputError
from sixflow.frames import BadFrame, open_frames

FILM = np.random.default_rng(5).integers(0, 255, (6, 16, 24)).astype(np.uint8)


def image(blocks, sizes=(6, 1, 1), order="XYZCT", attributes="", planes="", name="P"):
    t, c, z = sizes
    return (
        f'<Image ID="Image:0" Name="{name}"><Pixels ID="Pixels:0" DimensionOrder="{order}" SizeX="24" SizeY="16" '
        f'SizeZ="{z}" SizeC="{c}" SizeT="{t}" Type="uint8" {attributes}>{blocks}{planes}</Pixels></Image>'
    )


def block(file="", uuid="", **numbers):
    given = " ".join(f'{key}="{value}"' for key, value in numbers.items())
    inner = f'<UUID FileName="{file}">urn:uuid:{uuid}</UUID>' if file else ""
    return f"<TiffData {given}>{inner}</TiffData>"


def write(path, frames, *images, uuid="own"):
    xml = (
        '<?xml version="1.0" encoding="UTF-8"?><OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06" '
        f'UUID="urn:uuid:{uuid}">{"".join(images)}</OME>'
    )
    tifffile.imwrite(path, frames, description=xml.encode(), metadata=None, photometric="minisblack")
    return path


def check(source, frames):
    np.testing.assert_array_equal(list(source), frames)
    return source


@pytest.mark.parametrize("order", ["XYZCT", "XYZTC", "XYCZT", "XYCTZ", "XYTCZ", "XYTZC"])
def test_orders_of_planes(tmp_path, order):
    """Pages are stored with the first letter after XY fastest."""
    values = np.arange(12).reshape(3, 2, 2)  # t, c, z
    stored = values.transpose(["TCZ".index(axis) for axis in order[:1:-1]]).ravel()
    pages = np.stack([np.full((16, 24), value, np.uint8) for value in stored])
    path = write(tmp_path / "a.ome.tif", pages, image(block(), (3, 2, 2), order))
    with pytest.raises(InputError, match=r"channels 0, 1 \(channel=\) and the slices 0, 1 \(z=\)"):
        open_frames(path)
    source = open_frames(path, channel=1, z=0)
    assert [int(frame[0, 0]) for frame in source] == values[:, 1, 0].tolist()


def test_a_file_of_a_set_opens_its_own_pages(tmp_path):
    blocks = "".join(block(f"a_T{t}.ome.tif", f"k{t}", FirstT=t, IFD=0, PlaneCount=1) for t in range(6))
    for t in range(6):
        write(
            tmp_path / f"a_T{t}.ome.tif", FILM[t], image(blocks, attributes='TimeIncrement="2"'), uuid=f"k{t}"
        )
    source = check(open_frames(tmp_path / "a_T*.ome.tif"), FILM)
    np.testing.assert_allclose(source.times, 2.0 * np.arange(6))
    pair = check(open_frames([tmp_path / "a_T1.ome.tif", tmp_path / "a_T4.ome.tif"]), FILM[[1, 4]])
    np.testing.assert_allclose(pair.times, [2, 8])
    check(open_frames(tmp_path / "a_T3.ome.tif"), FILM[3:4])
    (tmp_path / "a_T3.ome.tif").rename(tmp_path / "renamed.ome.tif")
    check(open_frames(tmp_path / "renamed.ome.tif"), FILM[3:4])


def test_positions_and_channels_in_files_are_not_joined(tmp_path):
    blocks = [
        "".join(block(f"x_C{c}.ome.tif", f"k{c}", FirstC=c, FirstT=t, IFD=t, PlaneCount=1) for t in range(3))
        for c in (0, 1)
    ]
    for c in (0, 1):
        write(
            tmp_path / f"x_C{c}.ome.tif",
            FILM[3 * c : 3 * c + 3],
            image("".join(blocks), (3, 2, 1)),
            uuid=f"k{c}",
        )
    check(open_frames(tmp_path / "x_C1.ome.tif"), FILM[3:])
    check(open_frames(tmp_path / "x_C1.ome.tif", channel=1), FILM[3:])
    with pytest.raises(InputError, match="channel=0: there is none"):
        open_frames(tmp_path / "x_C1.ome.tif", channel=0)
    with pytest.raises(
        InputError, match=r"the files of one set hold several recordings: .*channel 0.*; .*channel 1"
    ):
        open_frames(tmp_path / "x_C*.ome.tif")


def test_positions_in_a_file(tmp_path):
    with tifffile.TiffWriter(tmp_path / "p.ome.tif", ome=True) as writer:
        for name, frames in (("left", FILM[:3]), ("right", FILM[3:])):
            writer.write(frames, photometric="minisblack", metadata={"axes": "TYX", "Name": name})
    with pytest.raises(InputError, match=r"0 'left', T=3 of 24×16 px; 1 'right', T=3"):
        open_frames(tmp_path / "p.ome.tif")
    for position in (1, "right"):
        check(open_frames(tmp_path / "p.ome.tif", position=position), FILM[3:])


def test_companion_files(tmp_path):
    binary = '<BinaryOnly MetadataFile="x.companion.ome" UUID="urn:uuid:companion"/>'
    write(tmp_path / "x.ome.tif", FILM, binary)
    source = check(open_frames(tmp_path / "x.ome.tif"), FILM)
    assert "its OME metadata is in 'x.companion.ome', which is not there" in source.notes[0]
    text = image(block("x.ome.tif", "own", IFD=0, PlaneCount=6), attributes='TimeIncrement="0.5"')
    (tmp_path / "x.companion.ome").write_text(f"<OME>{text}</OME>")
    for name in ("x.ome.tif", "x.companion.ome"):
        np.testing.assert_allclose(check(open_frames(tmp_path / name), FILM).times, 0.5 * np.arange(6))


def test_missing_planes(tmp_path):
    blocks = "".join(block(FirstT=t, IFD=k, PlaneCount=1) for k, t in enumerate((0, 1, 3, 4)))
    source = open_frames(write(tmp_path / "a.ome.tif", FILM[:4], image(blocks)))
    frames = list(source.attempt())
    assert [k for k, frame in enumerate(frames) if isinstance(frame, BadFrame)] == [2]
    np.testing.assert_array_equal(frames[3], FILM[2])
    assert "the file states 5 frames, 4 are there" in source.notes[0]
    assert "states 6 times, 5 are there" in source.notes[1]


def test_claims_and_broken_xml(tmp_path):
    endless = write(tmp_path / "a.ome.tif", FILM, image(block(IFD=0, PlaneCount=10**9), (10**9, 1, 1)))
    with pytest.raises(FrameFileError, match="frames, of which 6 are there"):
        open_frames(endless)
    late = write(tmp_path / "b.ome.tif", FILM, image(block(IFD=0, FirstT=10**8, PlaneCount=1), (10**9, 1, 1)))
    with pytest.raises(FrameFileError, match="for which it is too short"):
        open_frames(late)
    source = open_frames(write(tmp_path / "c.ome.tif", FILM, "<Image>"))
    assert check(source, FILM).notes == ("its OME-XML is damaged: pages are read in the order of the file",)


def test_times_of_planes(tmp_path):
    stamps = [0, 1, 3, 6, 10, 15]
    planes = "".join(
        f'<Plane TheT="{t}" TheC="0" TheZ="0" DeltaT="{s}" DeltaTUnit="ms"/>' for t, s in enumerate(stamps)
    )
    path = write(tmp_path / "a.ome.tif", FILM, image(block(), attributes='TimeIncrement="3"', planes=planes))
    np.testing.assert_allclose(open_frames(path).times, 1e-3 * np.array(stamps))
    zeros = planes.replace('DeltaT="', 'DeltaT="-0')
    path = write(tmp_path / "b.ome.tif", FILM, image(block(), attributes='TimeIncrement="3"', planes=zeros))
    source = open_frames(path)
    np.testing.assert_allclose(source.times, 3.0 * np.arange(6))
    assert "DeltaT" in source.notes[0]


@pytest.mark.parametrize(
    ("unit", "seconds"),
    [
        ("s", 1),
        ("ms", 1e-3),
        ("µs", 1e-6),
        ("ns", 1e-9),
        ("min", 60),
        ("h", 3600),
        ("d", 86400),
        ("ks", 1e3),
        ("?", None),
    ],
)
def test_units_of_time(tmp_path, unit, seconds):
    given = f'TimeIncrement="2" TimeIncrementUnit="{unit}"'
    source = open_frames(write(tmp_path / "a.ome.tif", FILM, image(block(), attributes=given)))
    assert source.metadata.frame_interval == (None if seconds is None else pytest.approx(2 * seconds))


@pytest.mark.parametrize(
    ("unit", "name"),
    [
        *(("µm", "µm"), ("nm", "nm"), ("mm", "mm"), ("cm", "cm"), ("m", "m"), ("in", "inch"), ("Å", "Å")),
        *(("pixel", None), ("reference frame", None)),
    ],
)
def test_units_of_length(tmp_path, unit, name):
    given = f'PhysicalSizeX="0.65" PhysicalSizeXUnit="{unit}" PhysicalSizeY="0.65" PhysicalSizeYUnit="{unit}"'
    metadata = open_frames(write(tmp_path / "a.ome.tif", FILM, image(block(), attributes=given))).metadata
    assert (metadata.pixel_size, metadata.length_unit) == ((0.65, name) if name else (None, None))
    assert metadata.pixel_aspect == 1


def test_pixels_in_two_units_that_are_not_square(tmp_path):
    given = 'PhysicalSizeX="650" PhysicalSizeXUnit="nm" PhysicalSizeY="1.3"'
    source = open_frames(write(tmp_path / "a.ome.tif", FILM, image(block(), attributes=given)))
    assert source.metadata.pixel_aspect == pytest.approx(2)
    assert source.notes == (
        "pixels are not square: they are 2 times as high as wide, which is not corrected",
    )


@pytest.mark.parametrize(
    ("unit", "name"), [("micron", "µm"), (r"\u00B5m", "µm"), ("mm", "mm"), ("pixel", None)]
)
def test_calibration_of_imagej(tmp_path, unit, name):
    metadata = {"axes": "TYX", "finterval": 2, "tunit": "min", "unit": unit}
    tifffile.imwrite(tmp_path / "a.tif", FILM, imagej=True, metadata=metadata, resolution=(4, 4))
    stated = open_frames(tmp_path / "a.tif").metadata
    assert (stated.pixel_size, stated.length_unit, stated.frame_interval) == (
        0.25 if name else None,
        name,
        120,
    )


def test_resolution_of_a_plain_file_is_no_calibration(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", FILM, resolution=(72, 72), resolutionunit="INCH")
    assert open_frames(tmp_path / "a.tif").metadata.pixel_size is None
