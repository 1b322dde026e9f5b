"""Peers, each only if it is installed, with the settings of its documentation.

| peer | settings | stands on |
|---|---|---|
| OpenCV Farnebäck | of OpenCV's tutorial: 0.5, 3 levels, window 15 (box or Gaussian), 3 iterations, 5, 1.2 | frame 0 |
| OpenCV DIS | preset medium | frame 0 |
| scikit-image TV-L1, ILK | defaults, grey values from 0 to 1 | frame 0 |
| OpenPIV | windows 64, 32, 16, 16, half overlap; both frames deformed by half; particle images only | middle |

OpenCV takes frames of 8 bits. The peers of scikit-image take minutes on large frames and are left out there.
"""

from __future__ import annotations

import contextlib
import importlib
import importlib.util
import io
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from public_cases.case import Case
from public_cases.measured import STEP, Measured, from_dense, from_grid
from sixflow.engine.threads import worker_count
from sixflow.maps.grid import Grid

SLOW_PIXELS = 600_000
OPENPIV_WINDOWS = (64, 32, 16, 16)

Flow = Callable[[Any, Any], Any]


def installed_peers() -> dict[str, Callable[[Case], Measured | None]]:
    """Return the peers that are installed, by name; each gives None for a case that it is not for."""
    peers: dict[str, Callable[[Case], Measured | None]] = {}
    if importlib.util.find_spec("cv2"):
        peers |= {name: _dense(flow, _eight_bits) for name, flow in _opencv().items()}
    if importlib.util.find_spec("skimage"):
        peers |= {name: _dense(flow, _unit_range, SLOW_PIXELS) for name, flow in _skimage().items()}
    if importlib.util.find_spec("openpiv"):
        peers["OpenPIV"] = _openpiv
    return peers


def _opencv() -> dict[str, Flow]:
    cv2: Any = importlib.import_module("cv2")
    cv2.setNumThreads(worker_count())
    dis = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)

    def farneback(window: int) -> Flow:
        return lambda a, b: np.moveaxis(
            cv2.calcOpticalFlowFarneback(a, b, None, 0.5, 3, 15, 3, 5, 1.2, window), -1, 0
        )

    return {
        "Farnebäck": farneback(0),
        "Farnebäck, Gaussian": farneback(cv2.OPTFLOW_FARNEBACK_GAUSSIAN),
        "DIS": lambda a, b: np.moveaxis(dis.calc(a, b, None), -1, 0),
    }


def _skimage() -> dict[str, Flow]:
    registration: Any = importlib.import_module("skimage.registration")
    return {
        "TV-L1": lambda a, b: registration.optical_flow_tvl1(a, b)[::-1],
        "ILK": lambda a, b: registration.optical_flow_ilk(a, b)[::-1],
    }


def _dense(
    flow: Flow, convert: Callable[[NDArray[Any]], NDArray[Any]], limit: int | None = None
) -> Callable[[Case], Measured | None]:
    def measure(case: Case) -> Measured | None:
        if limit is not None and case.frame0.size > limit:
            return None
        frame0, frame1 = convert(case.frame0), convert(case.frame1)
        grid = Grid.over(case.truth.shape, STEP)
        begin = time.perf_counter()
        found = flow(frame0, frame1)
        return from_dense(found, grid.x, grid.y, time.perf_counter() - begin)

    return measure


def _openpiv(case: Case) -> Measured | None:
    """Multi-pass window deformation; its y axis, which points up, is turned down again."""
    if case.experiment != "PIV":
        return None
    windef: Any = importlib.import_module("openpiv.windef")
    settings = windef.PIVSettings()
    settings.windowsizes = OPENPIV_WINDOWS
    settings.overlap = tuple(window // 2 for window in OPENPIV_WINDOWS)
    settings.num_iterations = len(OPENPIV_WINDOWS)
    frames = [frame.astype(np.int32) for frame in (case.frame0, case.frame1)]
    begin = time.perf_counter()
    with contextlib.redirect_stdout(io.StringIO()):  # it prints its counts of bad peaks
        x, y, u, v, flags = windef.simple_multipass(*frames, settings)
    seconds = time.perf_counter() - begin
    bad = np.asarray(flags) != 0
    u, v = np.where(bad, np.nan, u), np.where(bad, np.nan, -v)
    return from_grid(u, v, x[0], y[::-1, 0], seconds, case.truth.shape, middle=True)


def _eight_bits(frame: NDArray[Any]) -> NDArray[Any]:
    return frame if frame.dtype == np.uint8 else np.clip(np.round(frame), 0, 255).astype(np.uint8)


def _unit_range(frame: NDArray[Any]) -> NDArray[Any]:
    return frame.astype(np.float32) / 255
