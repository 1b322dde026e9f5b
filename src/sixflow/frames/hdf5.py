"""HDF5: one of the datasets of a file, read frame by frame."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from typing import Any

import h5py

from sixflow.frames.arrayfile import ArrayFile, is_frames
from sixflow.frames.labelled import Labelled, codes_of_names, codes_of_shape

_MOST = 1000
"""Datasets that are looked at."""


class Hdf5File(ArrayFile):
    """A dataset of an HDF5 file; labels of its dimensions are heeded."""

    @contextlib.contextmanager
    def _arrays(self) -> Iterator[Mapping[str, Any]]:
        with h5py.File(self.path, "r") as file:
            found: dict[str, Any] = {}

            def visit(name: str, thing: Any) -> bool | None:
                if isinstance(thing, h5py.Dataset) and is_frames(thing.shape or (), thing.dtype):
                    found[name] = thing
                return True if len(found) >= _MOST else None

            file.visititems(visit)
            yield found

    def _label(self, array: Any, name: str) -> Labelled:
        labels = [array.dims[k].label for k in range(array.ndim)]
        codes = (
            codes_of_names(labels, array.shape, name) if all(labels) else codes_of_shape(array.shape, name)
        )
        return Labelled(array, codes, chunks=array.chunks)
