"""netCDF: one of the variables of a file, read frame by frame by xarray."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from typing import Any

from sixflow.frames.arrayfile import ArrayFile, NotARecordingError, is_frames
from sixflow.frames.dataarray import labelled
from sixflow.frames.labelled import Labelled


class NetcdfFile(ArrayFile):
    """A variable of a netCDF file, with its coordinates."""

    @contextlib.contextmanager
    def _arrays(self) -> Iterator[Mapping[str, Any]]:
        import h5py
        import xarray as xr

        with h5py.File(self.path, "r") as file:  # h5netcdf complains of damaged files twice
            file.visititems(lambda _, thing: dict(thing.attrs) and None)
        with xr.open_dataset(self.path, engine="h5netcdf", decode_times=True) as data:
            if "sixflow_version" in data.attrs:
                raise NotARecordingError(self.path)
            yield {
                str(name): array
                for name, array in data.data_vars.items()
                if is_frames(array.shape, array.dtype)
            }

    def _label(self, array: Any, name: str) -> Labelled:
        return labelled(array, name)
