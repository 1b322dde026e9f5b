"""sixflow: optical flow as a field of six numbers per point, each with its uncertainty.

Displacement (u, v), divergence, curl, stretch and shear, measured directly from an image pair or a recording.

>>> import sixflow
>>> from sixflow import synth
>>> made = synth.pair(synth.Speckle(), synth.Affine.rotation(0.01, centre=(64, 64)), (128, 128))
>>> field = sixflow.measure(made.frame0, made.frame1)
>>> round(float(field.curl.mean()), 4)
0.02

Names are loaded when they are first used, so that importing the package costs next to nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sixflow import convention as convention
    from sixflow import eigenfilters as eigenfilters
    from sixflow import groups as groups
    from sixflow import interpretation as interpretation
    from sixflow import invariants as invariants
    from sixflow import scenes as scenes
    from sixflow import synth as synth
    from sixflow.errors import FieldFileError as FieldFileError
    from sixflow.errors import FrameFileError as FrameFileError
    from sixflow.errors import InputError as InputError
    from sixflow.errors import MeasurementError as MeasurementError
    from sixflow.errors import SixflowError as SixflowError
    from sixflow.frames import open_frames as open_frames
    from sixflow.masks import read_mask as read_mask
    from sixflow.measurement import iterate_sequence as iterate_sequence
    from sixflow.measurement import measure as measure
    from sixflow.measurement import measure_sequence as measure_sequence
    from sixflow.plot import plot_field as plot_field
    from sixflow.settings import Settings as Settings
    from sixflow.version import __version__ as __version__
    from sixflow.write import open_field as open_field
    from sixflow.write import write_field as write_field

_HOME = {
    "FieldFileError": "errors",
    "FrameFileError": "errors",
    "InputError": "errors",
    "MeasurementError": "errors",
    "Settings": "settings",
    "SixflowError": "errors",
    "__version__": "version",
    "iterate_sequence": "measurement",
    "measure": "measurement",
    "measure_sequence": "measurement",
    "open_field": "write",
    "open_frames": "frames",
    "plot_field": "plot",
    "read_mask": "masks",
    "write_field": "write",
}
_MODULES = (
    "convention",
    "eigenfilters",
    "frames",
    "groups",
    "interpretation",
    "invariants",
    "plot",
    "scenes",
    "synth",
    "write",
)

__all__ = sorted([*_HOME, *_MODULES])


def __getattr__(name: str) -> Any:
    """Load a public name on first use."""
    if name in _MODULES:
        return importlib.import_module(f"sixflow.{name}")
    if name not in _HOME:
        raise AttributeError(f"module 'sixflow' has no attribute {name!r}")
    value = getattr(importlib.import_module(f"sixflow.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
