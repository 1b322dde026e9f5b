"""Arrays, lists and streams of arrays as recordings."""

import subprocess
import sys

import numpy as np
import pytest

from sixflow.errors import InputError
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
