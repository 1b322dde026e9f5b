"""A field in a few lines of text."""

from __future__ import annotations

import numpy as np
import xarray as xr

from sixflow.field.dataset import FLAGS, SIX
from sixflow.field.derived import derived_error
from sixflow.field.selection import flagged, stored_settings, valid


def summarise(field: xr.Dataset) -> str:
    """Return points, shares of the flags, medians of the six with their standard errors, and the settings."""
    known = valid(field)
    share = float(known.mean()) if known.size else 0.0
    lines = [
        " × ".join(f"{field.sizes[dim]} {dim}" for dim in ("time", "y", "x") if dim in field.sizes)
        + f" = {known.size} points, {_percent(share)} valid"
    ]
    if "flag" in field:
        lines += ["", "flag             share"]
        lines += [f"{name:14} {_percent(float(flagged(field, name).mean())):>7}" for name in FLAGS]
    lines += ["", "number          median      standard error (median)  unit"]
    for name in SIX:
        error = _median(derived_error(field, name)) if "covariance" in field else "-"
        unit = field[name].attrs.get("units", "1")
        lines.append(f"{name:11} {_median(field[name].where(known)):>10}      {error:>23}  {unit}")
    settings = stored_settings(field)
    if settings:
        lines += ["", "settings"]
        lines += [f"{name:14} {value}" for name, value in settings.items()]
    return "\n".join(lines)


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %"


def _median(values: xr.DataArray) -> str:
    finite = values.values[np.isfinite(values.values)]
    return f"{np.median(finite):.4g}" if finite.size else "none"
