"""The backend by which xarray itself opens field files: ``xr.open_dataset("field.nc", engine="sixflow")``.

xarray imports this module when it looks for its engines, so the accessor is there as soon as any file has
been opened.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import xarray as xr
from xarray.backends import BackendEntrypoint

from sixflow.field import accessor as _accessor  # noqa: F401


class FieldBackend(BackendEntrypoint):
    """Opens ``.nc`` and ``.zarr`` fields, with names as text and flags as arrays."""

    description = "Optical flow fields written by sixflow (.nc, .zarr)"

    def open_dataset(
        self, filename_or_obj: Any, *, drop_variables: str | Iterable[str] | None = None
    ) -> xr.Dataset:
        """Open a field file; see `sixflow.write.open_field`."""
        from sixflow.write import open_field

        field = open_field(filename_or_obj)
        if drop_variables is None:
            return field
        names = [drop_variables] if isinstance(drop_variables, str) else list(drop_variables)
        remaining = field.drop_vars(names, errors="ignore")
        remaining.set_close(field.close)
        return remaining

    def guess_can_open(self, filename_or_obj: Any) -> bool:
        """Tell fields in Zarr stores; netCDF files are left to xarray's own engines."""
        if not isinstance(filename_or_obj, str | os.PathLike):
            return False
        try:
            header = (Path(filename_or_obj) / "zarr.json").read_text(encoding="utf-8")
        except (OSError, ValueError):  # not there, or no text
            return False
        return "six-parameter optical flow field" in header
