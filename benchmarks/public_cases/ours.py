"""Ours: which settings are run, and the call.

| column | settings |
|---|---|
| default | none: `measure(frame0, frame1)` |
| window=31, alone and with sharpen=2, 5 | one window for all points |
| eigenfilter | `method="eigenfilter"` |
| by experiment | `BY_EXPERIMENT`, chosen by what was recorded, not by what came out |
| uniform strain | `UNIFORM_STRAIN`, for specimens that are sheared, stretched or moved as a whole |

No setting depends on the case. A setting by experiment follows the custom of its field: particle images are
measured with windows chosen by themselves, speckles with a criterion that allows for a change of light, scenes of a
camera in small windows, because many things move in them. Uniform strain is known before it is measured; the setting
is that of docs/choosing.md for such a specimen and frames without much noise, and was added when the default was seen
to miss the target of affine speckles.
"""

from __future__ import annotations

import json
import time
from typing import Any

import numpy as np

import sixflow
from public_cases.case import Case
from public_cases.measured import STEP, Measured
from sixflow.convention import SIX
from sixflow.errors import InputError

BY_EXPERIMENT: dict[str, dict[str, Any]] = {
    "PIV": {"window": "auto"},
    "DIC": {"lighting": "gain+offset"},
    "vision": {"window": 21, "lighting": "gain+offset"},
}
COLUMNS: dict[str, dict[str, Any]] = {
    "default": {},
    "window=31": {"window": 31},
    "window=31, sharpen=2": {"window": 31, "sharpen": 2},
    "window=31, sharpen=5": {"window": 31, "sharpen": 5},
    "eigenfilter": {"method": "eigenfilter"},
}
UNIFORM = "uniform strain"
UNIFORM_STRAIN: dict[str, Any] = {"window": 41, "lowpass": 1.0}
STANDING = ("default", "by experiment")
"""Columns that can meet a target: settings that a user takes without having seen the case."""


def settings_of(case: Case, extra: dict[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """Settings of each of our columns for a case; `extra` are columns asked for on the command line."""
    uniform = case.experiment == "DIC" and case.truth.constant is not None
    return (
        COLUMNS
        | {"by experiment": BY_EXPERIMENT[case.experiment]}
        | ({UNIFORM: UNIFORM_STRAIN} if uniform else {})
        | extra
    )


def warm_up(extra: dict[str, dict[str, Any]]) -> None:
    """Call every column's code once, so that no case pays for compiling it."""
    frame = np.random.default_rng(0).normal(size=(96, 96))
    options = [*COLUMNS.values(), *BY_EXPERIMENT.values(), UNIFORM_STRAIN, *extra.values()]
    for one in options:
        sixflow.measure(frame, frame * (1 + 1e-6), **one)


def measure_ours(case: Case, options: dict[str, Any]) -> Measured | None:
    """Measure a case; None if it cannot be measured with these settings, such as a window larger than the frame."""
    begin = time.perf_counter()
    try:
        field = sixflow.measure(case.frame0, case.frame1, **{"step": STEP} | options)
    except InputError:
        return None
    seconds = time.perf_counter() - begin
    error = np.stack([field.sixflow.standard_error(name).values[0].astype(float) for name in SIX])
    used = json.loads(field.attrs["settings"])
    return Measured(
        field.x.values,
        field.y.values,
        np.stack([field[name].values[0].astype(float) for name in SIX]),
        error,
        field.flag.values[0] == 0,
        used.get("reference", "first") == "middle",
        seconds,
    )


def spelled(options: dict[str, Any]) -> str:
    """Settings as Python spells them."""
    return ", ".join(f"{name}={value!r}" for name, value in options.items()) or "no options"
