"""`sixflow warm-up`: compile what measurements need, before the first of them."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from sixflow.cli.errors import say
from sixflow.cli.flags import Switch
from sixflow.cli.progress import progress

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Frames = tuple[NDArray[np.uint8], NDArray[np.uint8]]

PLAIN: tuple[dict[str, Any], ...] = ({},)
"""Settings of a plain measurement."""

OTHERS: tuple[dict[str, Any], ...] = (
    {"sharpen": 1, "lighting": "gain+offset", "forward_backward": True},
    {"lighting": "local", "interpolation": "cubic", "lowpass": 0.7},
    {"robust": False, "group": "similarity"},
    {"window": "auto"},
    {"method": "eigenfilter"},
    {"float64": True},
    {"float64": True, "sharpen": 1, "lighting": "gain+offset"},
    {"float64": True, "window": "auto"},
)
"""Settings that need kernels, or types of numbers, which a plain measurement does not."""


def warm_up(
    *,
    everything: Annotated[Switch, Parameter(name="--all")] = False,
    quiet: Annotated[Switch, Parameter(name=("--quiet", "-q"))] = False,
) -> None:
    """Compile the kernels that a plain measurement needs, and keep the machine code on disk.

    The first measurement does this too, and waits for it. What is compiled already is not compiled again.

    Parameters
    ----------
    everything
        Compile also what other settings need: float64, eigenfilters, window=auto, sharpening, changes of light.
    quiet
        No progress or closing line; errors only.
    """
    from sixflow.engine.compiler import compiled_now, watched

    started, before = time.perf_counter(), compiled_now()
    shown = progress(_expected(everything), title="compiling", unit="kernels", quiet=quiet)
    with shown as advance, watched(advance):
        _measure(everything)
    count, seconds = compiled_now() - before, time.perf_counter() - started
    if quiet:
        return
    place = _place()
    if place is None:
        say("note: no folder can be written to, so that nothing is kept; set NUMBA_CACHE_DIR to one that can")
    kept = "" if place is None else f"; machine code is kept in {place}"
    if count:
        print(f"{count} kernels compiled in {seconds:.0f} s{kept}")
    else:
        print(f"nothing to compile: all is there{kept}")


def _measure(everything: bool) -> None:
    """Make small measurements that call all kernels of plain settings, or of all."""
    from sixflow import measure, measure_sequence

    frames = _frames()
    for settings in (*PLAIN, *(OTHERS if everything else ())):
        measure(*frames, **settings)
    if everything:
        measure_sequence([*frames, frames[0]], pairs="incremental")


def _frames() -> Frames:
    """Random texture of which a part moves otherwise, with glare: so small a pair as meets everything."""
    import numpy as np

    side = 128
    random = np.random.default_rng(0)
    wave = np.hypot(*np.meshgrid(np.fft.fftfreq(side), np.fft.rfftfreq(side), indexing="ij"))
    spectrum = np.fft.rfft2(random.normal(size=(side, side))) * np.exp(-((8 * wave) ** 2))
    texture = np.fft.irfft2(spectrum, (side, side))
    frame0 = 128 + 40 * texture / texture.std()
    frame1 = np.roll(frame0, (2, 3), (0, 1))
    frame1[:, side // 2 :] = np.roll(frame0, (-3, 1), (0, 1))[:, side // 2 :]
    frame1[40:52, 20:32] = 255
    both = (np.clip(frame + random.normal(0, 2, frame.shape), 0, 255) for frame in (frame0, frame1))
    first, second = (np.rint(frame).astype(np.uint8) for frame in both)
    return first, second


def _expected(everything: bool) -> int:
    """About as many kernels as have no machine code yet."""
    from sixflow import measurement  # noqa: F401 - makes all kernels known
    from sixflow.engine.compiler import missing

    return sum(missing(dtype) for dtype in (("float32", "float64") if everything else ("float32",)))


def _place() -> str | None:
    """The folder that holds the machine code, or None."""
    import os

    from sixflow.engine.compiler import folders

    found = folders()
    return os.path.commonpath(found) if found else None
