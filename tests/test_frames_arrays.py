"""Arrays, lists and streams of arrays as recordings."""

import subprocess
import sys

import numpy as np
import pytest

from sixflow.errors import FrameFileError, InputError
from sixflow.frames import FrameSource, open_frames


@pytest.fixture
def stack():
    return np.random.default_rng(1).integers(0, 4096, (5, 12, 16), dtype=np.uint16)


def test_array(stack):
    source = open_frames(stack)
    assert isinstance(source, FrameSource)
    assert (len(source), source.count, source.shape, source.dtype) == (5, 5, (12, 16), np.uint16)
    assert source.names[4] == "frame 4"
    assert source.times is None
    assert repr(source) == "<ArraySource a ndarray: 5 frames of 16×12 px, uint16>"
    for _ in range(2):
        np.testing.assert_array_equal(np.stack(list(source)), stack)
    np.testing.assert_array_equal(source[-2], stack[3])
    assert open_frames(source) is source
    assert source.fingerprint == open_frames(list(stack)).fingerprint
    assert source.fingerprint != open_frames(stack[1:]).fingerprint


def test_memory_map_and_foreign_byte_order(tmp_path, stack):
    np.save(tmp_path / "a.npy", stack.astype(">u2"))
    source = open_frames(np.load(tmp_path / "a.npy", mmap_mode="r"))
    assert source.dtype == np.dtype("=u2")
    np.testing.assert_array_equal(source[1], stack[1])


def test_colour_array():
    colour = np.random.default_rng(1).random((2, 6, 7, 3))
    source = open_frames(colour)
    assert source.shape == (6, 7)
    assert source.dtype == np.float64
    assert source.notes == ("colour → luminance (Rec. 709)",)
    np.testing.assert_allclose(source[0], colour[0] @ [0.2126, 0.7152, 0.0722], rtol=1e-6)


@pytest.mark.parametrize("dtype", [bool, np.int16, np.int32, np.float16, np.float32, np.float64])
def test_types(dtype):
    frame = open_frames(np.ones((2, 4, 5), dtype=dtype))[0]
    expected = {bool: np.uint8, np.float16: np.float32}.get(dtype, dtype)
    assert frame.dtype == expected
    assert frame[0, 0] == (255 if dtype is bool else 1)


def test_list_and_generator(stack):
    listed = open_frames(list(stack))
    assert len(listed) == 5
    stream = open_frames(frame for frame in stack)
    assert stream.count is None
    assert stream.names == ()
    assert bool(stream)
    assert stream.description == "a generator: frames of 16×12 px, uint16"
    with pytest.raises(TypeError, match="unknown until they have been read"):
        len(stream)
    np.testing.assert_array_equal(np.stack(list(stream)), stack)
    with pytest.raises(InputError, match="can be read once, and have been; give a list"):
        list(stream)


def test_iterable_that_can_be_read_again(stack):
    class Recording:
        def __iter__(self):
            return iter(stack)

    source = open_frames(Recording())
    assert len(list(source)) == len(list(source)) == 5
    assert len(list(source.iterate(3))) == 2


@pytest.mark.parametrize(
    ("frames", "message"),
    [
        (np.zeros((4, 5)), r"shape \(4, 5\) is no recording; give \(n, h, w\)"),
        (np.zeros((480, 640, 3)), "with n = 1 for a single frame"),
        (np.zeros((0, 4, 5)), "a ndarray: no frames"),
        (np.zeros((2, 4, 0)), "is no frame"),
        (np.zeros((2, 4, 5, 6)), r"frame 0: an array of shape \(4, 5, 6\) is no frame"),
        (np.zeros((2, 4, 5), dtype=complex), "values of type complex128 are no grey values"),
        ([], "a list of arrays: no frames"),
        (iter([]), "no frames"),
        (["a.png", np.zeros((4, 5))], "a list of paths and other things"),
        (17, "frames of type int cannot be read"),
        ((name for name in ["a.png"]), "of paths has no certain order"),
    ],
)
def test_refused(frames, message):
    with pytest.raises(InputError, match=message):
        open_frames(frames)


def test_unlike_arrays():
    source = open_frames([np.zeros((4, 5)), np.zeros((5, 4))])
    with pytest.raises(InputError, match="frame 1 has 4×5 px of float64, but frame 0 has 5×4 px of float64"):
        list(source)


def test_importing_the_package_is_light():
    code = (
        "import sys, sixflow.frames; "
        "print([m for m in ('tifffile', 'av', 'PIL', 'imageio', 'xarray', 'scipy') if m in sys.modules])"
    )
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert answer.stdout.strip() == "[]"


# Masked, chunked and labelled arrays


def test_masked_arrays(stack):
    hidden = np.ma.masked_greater(stack, 4000)
    for source in (open_frames(hidden), open_frames(list(hidden)), open_frames(f for f in hidden)):
        for frame, values in zip(source, stack, strict=True):
            np.testing.assert_array_equal(frame, np.where(values > 4000, np.nan, values))
    later = open_frames([stack[0], np.ma.masked_greater(stack[1], 4000)])
    assert later.dtype == np.uint16
    assert np.isnan(list(later)[1]).sum() == (stack[1] > 4000).sum()
    assert later.notes == ("frame 1: masked pixels have no value",)


def test_masked_frames_of_a_pair():
    from sixflow.prepare.image import check_frame

    values = np.arange(12.0).reshape(3, 4)
    frame = check_frame(np.ma.masked_greater(values, 8), "frame0")
    np.testing.assert_array_equal(frame, np.where(values > 8, np.nan, values))
    for bad in ("a.png", b"a.png", [[1, 2], [3]], {1: 2}):
        with pytest.raises(InputError, match="frame0"):
            check_frame(bad, "frame0")


class Chunked:
    """Behaves like a Dask array, and counts what is computed."""

    def __init__(self, values, sizes):
        self.values, self.chunks, self.computed = values, (sizes, *((n,) for n in values.shape[1:])), []
        self.shape, self.dtype = values.shape, values.dtype

    def __getitem__(self, index):
        chunked, along = self, index[0]

        class Lazy:
            def __array__(self, dtype=None, copy=None):
                chunked.computed.append(along)
                return chunked.values[index]

        return Lazy()


def test_chunks_are_computed_once(stack):
    chunked = Chunked(stack, (2, 2, 1))
    source = open_frames(chunked)
    np.testing.assert_array_equal(list(source), stack)
    assert chunked.computed == [slice(0, 2), slice(2, 4), slice(4, 5)]
    part = Chunked(stack, (2, 2, 1))
    np.testing.assert_array_equal(list(open_frames(part, first=2, every=2)), stack[2::2])
    assert part.computed == [slice(0, 2), slice(2, 4), slice(4, 5)]


def test_named_dimensions_and_times(stack):
    import xarray as xr

    times = np.datetime64("2026-01-01", "ms") + 40 * np.arange(5)
    coords = {"time": times, "x": ("x", 0.5 * np.arange(16), {"units": "mm"})}
    array = xr.DataArray(stack.transpose(0, 2, 1), dims=("time", "x", "y"), coords=coords)
    source = open_frames(array)
    np.testing.assert_array_equal(list(source), stack)
    np.testing.assert_allclose(source.times, 0.04 * np.arange(5))
    assert (source.metadata.pixel_size, source.metadata.length_unit) == (0.5, "mm")
    channels = xr.DataArray(
        np.stack([stack, stack[::-1]]), dims=("channel", "t", "row", "col"), coords={"channel": ["a", "b"]}
    )
    with pytest.raises(InputError, match="channels 0 'a', 1 'b'"):
        open_frames(channels)
    np.testing.assert_array_equal(list(open_frames(channels, channel="b")), stack[::-1])
    with pytest.raises(InputError, match="rows and columns are not clear"):
        open_frames(xr.DataArray(stack, dims=("t", "x", "w")))


@pytest.mark.parametrize(
    ("values", "attrs", "times", "note"),
    [
        ([0, 0.5, 2], {}, [0, 0.5, 2], "taken for seconds"),
        ([0, 500, 2000], {"units": "ms"}, [0, 0.5, 2], None),
        ([0, 1, 2], {}, None, None),
        ([0, 10, 20], {"units": "frame"}, None, "no time"),
        (["a", "b", "c"], {}, None, "holds no times"),
        (np.array([0, 500, 2000], "m8[ms]"), {}, [0, 0.5, 2], None),
    ],
)
def test_time_coordinates(stack, values, attrs, times, note):
    import xarray as xr

    source = open_frames(
        xr.DataArray(stack[:3], dims=("time", "y", "x"), coords={"time": ("time", values, attrs)})
    )
    assert (source.times is None) == (times is None)
    if times is not None:
        np.testing.assert_allclose(source.times, times)
    assert (note is None and not source.notes) or note in source.notes[0]


# Arrays in files


def test_numpy_files(tmp_path, stack):
    np.save(tmp_path / "a.npy", stack)
    np.save(tmp_path / "f.npy", np.asfortranarray(stack))
    np.savez(tmp_path / "b.npz", run=stack, dark=stack[::-1], n=np.arange(3))
    np.savez_compressed(tmp_path / "c.npz", run=stack)
    for name in ("a.npy", "f.npy", "c.npz", "b.npz:/run"):
        source = open_frames(tmp_path / name)
        np.testing.assert_array_equal(list(source), stack)
        np.testing.assert_array_equal(source[3], stack[3])
    np.testing.assert_array_equal(
        list(open_frames(tmp_path / "b.npz", position="dark", first=3)), stack[1::-1]
    )
    with pytest.raises(InputError, match=r"holds 2 arrays: 'run', 'dark'; name one, as in 'b.npz:/run'"):
        open_frames(tmp_path / "b.npz")
    with pytest.raises(InputError, match="position='light': there is none of this name"):
        open_frames(tmp_path / "b.npz:/light")
    for number in range(3):
        np.save(tmp_path / f"s{number}.npy", stack[number])
    np.testing.assert_array_equal(list(open_frames(tmp_path / "s*.npy")), stack[:3])


def test_numpy_files_that_are_refused(tmp_path, stack):
    np.save(tmp_path / "o.npy", np.array([{}], dtype=object), allow_pickle=True)
    np.save(tmp_path / "a.npy", stack)
    (tmp_path / "cut.npy").write_bytes((tmp_path / "a.npy").read_bytes()[:-1])
    (tmp_path / "none.npz").write_bytes(b"none")
    for name, message in (
        ("o.npy", "Python objects"),
        ("cut.npy", "cut short"),
        ("none.npz", "cannot be read"),
    ):
        with pytest.raises(FrameFileError, match=message):
            open_frames(tmp_path / name)


def test_hdf5(tmp_path, stack):
    import h5py

    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("run/frames", data=stack, chunks=(2, 12, 16), compression="gzip")
        file["run/times"] = np.arange(5)
    source = open_frames(tmp_path / "a.h5")
    np.testing.assert_array_equal(list(source), stack)
    with h5py.File(tmp_path / "a.h5", "a") as file:
        file["dark"] = stack[:1].repeat(2, 0)
    np.testing.assert_array_equal(list(open_frames(f"{tmp_path}/a.h5:/run/frames")), stack)
    with pytest.raises(InputError, match="holds 2 arrays: 'dark', 'run/frames'"):
        open_frames(tmp_path / "a.h5")


@pytest.mark.parametrize("version", ["0.4", "0.5"])
def test_ome_zarr(tmp_path, stack, version):
    import zarr

    path = tmp_path / "a.zarr"
    group = zarr.open_group(path, mode="w", zarr_format=2 if version == "0.4" else 3)
    values = np.stack([stack, stack[::-1]], 1)[:, :, None]
    group.create_array("0", data=values, chunks=(1, 1, 1, 12, 16))
    group.create_array("1", data=values[..., ::2, ::2])
    units = {"t": "millisecond", "y": "micrometer", "x": "micrometer"}
    axes = [
        {"name": name, "type": "space", **({"unit": units[name]} if name in units else {})}
        for name in "tczyx"
    ]
    scales = [[40, 1, 1, 0.5, 0.25], [40, 1, 1, 1, 0.5]]
    levels = [
        {"path": str(k), "coordinateTransformations": [{"type": "scale", "scale": scale}]}
        for k, scale in enumerate(scales)
    ]
    attrs = {
        "multiscales": [{"axes": axes, "datasets": levels}],
        "omero": {"channels": [{"label": "red"}, {"label": "green"}]},
    }
    group.attrs.update(attrs if version == "0.4" else {"ome": {"version": "0.5", **attrs}})
    with pytest.raises(InputError, match="channels 0 'red', 1 'green'"):
        open_frames(path)
    source = open_frames(path, channel="green")
    np.testing.assert_array_equal(list(source), stack[::-1])
    stated = source.metadata
    assert (stated.pixel_size, stated.length_unit, stated.frame_interval, stated.pixel_aspect) == (
        0.25,
        "µm",
        0.04,
        2,
    )
    half = open_frames(f"{path}:/1", channel=0)
    np.testing.assert_array_equal(list(half), stack[:, ::2, ::2])
    assert half.metadata.pixel_size == 0.5


def test_plain_zarr_and_netcdf(tmp_path, stack):
    import xarray as xr
    import zarr

    zarr.save(str(tmp_path / "p.zarr"), stack)
    np.testing.assert_array_equal(list(open_frames(tmp_path / "p.zarr")), stack)
    array = xr.DataArray(
        stack, dims=("time", "y", "x"), coords={"time": ("time", np.arange(5.0), {"units": "ms"})}
    )
    array.to_dataset(name="frames").to_netcdf(tmp_path / "a.nc", engine="h5netcdf")
    source = open_frames(tmp_path / "a.nc")
    np.testing.assert_array_equal(list(source), stack)
    np.testing.assert_allclose(source.times, 1e-3 * np.arange(5))


def test_pictures_go_before_arrays_in_a_folder(tmp_path, stack):
    from PIL import Image

    for number in range(2):
        Image.fromarray((stack[number] // 16).astype(np.uint8)).save(tmp_path / f"a{number}.png")
    np.save(tmp_path / "mask.npy", stack[0] > 9)
    assert len(open_frames(tmp_path)) == 2
    assert open_frames(tmp_path).notes == ("other files in the folder passed over: 1",)


@pytest.mark.parametrize("bad", ["", "a\0b", b"a.tif", [None, None], ["a.tif", None], {1: 2}, None])
def test_things_that_are_no_frames(bad):
    with pytest.raises((InputError, FrameFileError)):
        open_frames(bad)
