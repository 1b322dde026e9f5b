"""Recordings: fields of a long measurement, written batch by batch and continued after an interruption.

The batches gather in a Zarr store inside the folder ``<name>.partial`` beside the output. Each batch fills
whole chunks, which are never touched again; a small file beside the store tells how many pairs are complete
and is replaced in one step after each batch. So whatever happens, the pairs counted there are intact. In
the end a ``.zarr`` output is this store, renamed; a ``.nc`` or ``.csv`` output is copied from it, batch by
batch.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
import xarray as xr

from sixflow.errors import FieldFileError, InputError
from sixflow.write.fieldfile import save
from sixflow.write.layout import batches, checked_field, in_order
from sixflow.write.target import check_output, publish, remove


class RecordingWriter:
    """Writes the field of a recording while it is measured.

    Use it in a ``with`` statement. When the block ends well the output appears under its name; when it
    ends with an exception, or the process is killed, what is complete stays in ``<name>.partial`` and can
    be continued.

    Parameters
    ----------
    path : path
        The output, ``.zarr``, ``.nc`` or ``.csv``.
    overwrite : bool
        Whether an existing output, and an unfinished recording without `resume`, are replaced.
    resume : bool
        Whether to continue an unfinished recording, if there is one.
    attrs : mapping, optional
        Attributes that the fields are going to have. With `resume`, ``settings`` and every name with
        ``digest`` in it are compared with the unfinished recording before anything is measured. They are
        compared again with the first field.
    batch : int
        Pairs per chunk and per write, at least 1. A resumed recording keeps the number that it began with.

    Raises
    ------
    FieldFileError
        On entry, if the output cannot be written (`check_output`), if an unfinished recording is in the
        way, or if it belongs to other settings or other frames.
    InputError
        If a field has another grid or other variables than the first.

    Examples
    --------
    >>> import tempfile
    >>> from sixflow.write import open_field
    >>> def pair(number):
    ...     u = np.full((1, 2, 3), float(number))
    ...     return xr.Dataset({"u": (("time", "y", "x"), u)}, {"time": [number]})
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with RecordingWriter(folder + "/run.zarr", batch=2) as writer:
    ...         for number in range(writer.done, 5):
    ...             writer.append(pair(number))
    ...     open_field(folder + "/run.zarr").sizes["time"]
    5
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        overwrite: bool = False,
        resume: bool = False,
        attrs: Mapping[str, Any] | None = None,
        batch: int = 16,
    ) -> None:
        if isinstance(batch, bool) or not isinstance(batch, int) or batch < 1:
            raise InputError(f"batch={batch!r}: must be a whole number of pairs, at least 1")
        self.path = Path(path).expanduser()
        self.partial = self.path.with_name(self.path.name + ".partial")
        self._store = self.partial / "field.zarr"
        self._progress = self.partial / "progress.json"
        self._overwrite, self._resume, self._batch = overwrite, resume, batch
        self._attrs = dict(attrs) if attrs is not None else None
        self._pending: xr.Dataset | None = None
        self._template: xr.Dataset | None = None
        self._done = 0

    @property
    def done(self) -> int:
        """Number of pairs that are already safe: start measuring with this one."""
        return self._done

    def __enter__(self) -> Self:
        check_output(self.path, self._overwrite)
        if self.partial.exists():
            if self._resume:
                self._continue()
            elif self._overwrite:
                remove(self.partial)
            else:
                raise FieldFileError(
                    f"{self.partial}: an unfinished recording; continue it with resume=True (--resume), "
                    "or discard it with overwrite=True (--overwrite)"
                )
        return self

    def _continue(self) -> None:
        from sixflow.write import zarrstore

        if not self._progress.exists():  # stopped before the first batch was complete
            remove(self.partial)
            return
        try:
            progress = json.loads(self._progress.read_text())
            self._done, self._batch = progress["done"], progress["batch"]
            zarrstore.cut(self._store, self._done)
            self._template = zarrstore.read(self._store)
        except (OSError, ValueError, KeyError) as error:
            raise FieldFileError(
                f"{self.partial}: the unfinished recording cannot be read ({error}); "
                "discard it with overwrite=True (--overwrite)"
            ) from error
        if self._attrs is not None:
            self._compare(self._attrs)

    def append(self, field: xr.Dataset) -> None:
        """Add the field of the next pair or pairs, dims (time, y, x, ...), on the same grid as the first.

        Raises
        ------
        InputError
            If the grid or the variables differ.
        FieldFileError
            If the disk refuses, or a resumed recording has other settings.
        """
        field = checked_field(field)
        if "time" not in field.dims:
            raise InputError(
                "field: the dimension 'time' is missing; append fields of pairs, not single maps"
            )
        if self._template is not None:
            _check_alike(field, self._template)
            if self._resume and self._pending is None:
                self._compare(field.attrs)
        else:
            self._template = field.isel(time=slice(0))
        parts = [field] if self._pending is None else [self._pending, field]
        self._pending = _joined(parts) if len(parts) > 1 else field
        while self._pending.sizes["time"] >= self._batch:
            self._flush(self._pending.isel(time=slice(self._batch)))
            self._pending = self._pending.isel(time=slice(self._batch, None))

    def _compare(self, attrs: Mapping[str, Any]) -> None:
        assert self._template is not None
        ours = {name: attrs.get(name) for name in _identifying(attrs)}
        theirs = {name: self._template.attrs.get(name) for name in _identifying(self._template.attrs)}
        for name in sorted(ours.keys() | theirs.keys()):
            if ours.get(name) != theirs.get(name):
                raise FieldFileError(
                    f"{self.partial}: the unfinished recording has {name} = {theirs.get(name)}, "
                    f"but now it is {ours.get(name)}; take the former, "
                    "or discard the recording with overwrite=True (--overwrite)"
                )

    def _flush(self, field: xr.Dataset) -> None:
        from sixflow.write import zarrstore

        try:
            if self._done:
                zarrstore.extend(self._store, field, self._done)
            else:
                self.partial.mkdir(exist_ok=True)
                zarrstore.create(self._store, field, self._batch)
            self._done += field.sizes["time"]
            self._note_progress()
        except OSError as error:
            raise FieldFileError(
                f"{self.partial}: cannot be written ({error.strerror or error}); check the room on the disk"
            ) from error

    def _note_progress(self) -> None:
        beside = self._progress.with_suffix(".new")
        beside.write_text(json.dumps({"done": self._done, "batch": self._batch}))
        os.replace(beside, self._progress)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is not None:
            if self._done:
                error.add_note(
                    f"{self._done} pairs are complete in {self.partial}; continue with resume=True (--resume)"
                )
            else:
                remove(self.partial)
            return
        if self._pending is not None and self._pending.sizes["time"]:
            self._flush(self._pending)
        if not self._done:
            raise FieldFileError(f"{self.path}: nothing was appended, so nothing is written")
        self._finish()

    def _finish(self) -> None:
        from sixflow.write import zarrstore

        if self.path.suffix.lower() == ".zarr":
            zarrstore.seal(self._store)
            publish(self._store, self.path, self._overwrite)
        else:
            save(self._stored(), self.path, self._overwrite)
        remove(self.partial)

    def _stored(self) -> Iterator[xr.Dataset]:
        from sixflow.write import zarrstore

        with zarrstore.read(self._store) as field:
            yield from batches(in_order(field).drop_encoding(), self._batch)


def _identifying(attrs: Mapping[str, Any]) -> set[str]:
    return {name for name in attrs if name == "settings" or "digest" in name}


def _check_alike(field: xr.Dataset, template: xr.Dataset) -> None:
    for name in ("y", "x"):
        if not np.array_equal(field[name].values, template[name].values):
            raise InputError(
                f"field: the {name} of its grid differ from those of the first field; measure on one grid"
            )
    if set(field.variables) != set(template.variables):
        differing = ", ".join(sorted(map(str, set(field.variables) ^ set(template.variables))))
        raise InputError(
            f"field: its variables differ from those of the first field by {differing}; leave none out"
        )


def _joined(parts: list[xr.Dataset]) -> xr.Dataset:
    return xr.concat(
        parts,
        "time",
        data_vars="minimal",
        coords="minimal",
        compat="override",
        join="override",
        combine_attrs="override",
    )
