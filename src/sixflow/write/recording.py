"""Recordings: fields of a long measurement, written batch by batch and continued after an interruption.

The batches gather in a Zarr store inside the folder ``<name>.partial`` beside the output. Each batch fills
whole chunks, which are never touched again, and `Progress` counts the pairs that are complete: whatever
happens, these are intact. In the end a ``.zarr`` output is this store, renamed; a ``.nc`` or ``.csv``
output is copied from it, batch by batch.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
import xarray as xr

from sixflow.checks import is_whole, shown
from sixflow.errors import BadFrameError, FieldFileError, FrameFileError, InputError
from sixflow.field.provenance import joined_attrs, said_of_pairs
from sixflow.frames.digests import FrameDigests
from sixflow.staging import disk_errors, publish, remove
from sixflow.write import zarrstore
from sixflow.write.fieldfile import save
from sixflow.write.guarded import damage_reported, guarded
from sixflow.write.layout import batches, checked_field, in_order
from sixflow.write.lock import locked
from sixflow.write.progress import Progress
from sixflow.write.target import check_output, check_replaceable

MOST_PAIRS = 2**20
"""Most pairs per chunk."""


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
    identity : mapping of str to str, optional
        What tells this measurement from others, such as its settings and `FrameSource.fingerprint`. It is
        kept with an unfinished recording and compared, before anything is measured, when that is resumed.
    batch : int
        Pairs per chunk and per write, at least 1. A resumed recording keeps the number that it began with.

    Raises
    ------
    FieldFileError
        On entry, if the output cannot be written (`check_output`), if somebody else is writing it, if an
        unfinished recording is in the way, or if it belongs to other settings or other frames.
    InputError
        If a field has another grid or other variables than the first.

    Attributes
    ----------
    frames : FrameDigests
        Of the frames that the complete pairs are of, where `iterate_sequence` is given this to fill and to compare
        with: a recording whose frames have changed since is not resumed.

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
        identity: Mapping[str, str] | None = None,
        batch: int = 16,
    ) -> None:
        if not is_whole(batch, 1, MOST_PAIRS):
            raise InputError(
                f"batch={shown(batch)}: must be a whole number of pairs, at least 1 and at most {MOST_PAIRS}"
            )
        self.path = Path(path).expanduser()
        self.partial = self.path.with_name(self.path.name + ".partial")
        self._store = self.partial / "field.zarr"
        self._progress = Progress(self.partial, batch, identity or {})
        self._overwrite, self._resume = overwrite, resume
        self._pending: list[xr.Dataset] = []
        self._template: xr.Dataset | None = None
        self._lock = contextlib.ExitStack()
        self.frames = FrameDigests()
        self._logged_frames = 0

    @property
    def done(self) -> int:
        """Number of pairs that are already safe: start measuring with this one."""
        return self._progress.done

    def __enter__(self) -> Self:
        check_output(self.path, self._overwrite)
        with contextlib.ExitStack() as lock:
            lock.enter_context(locked(self.path))
            self._begin()
            self._lock = lock.pop_all()
        return self

    def _begin(self) -> None:
        check_output(self.path, self._overwrite)  # another writer may have come before the lock
        if self.partial.exists():
            if self._resume and self._progress.exists:
                self._continue()
            elif self._resume or self._overwrite:  # resumed, but stopped before its first batch was complete
                remove(self.partial)
            else:
                raise FieldFileError(
                    f"{self.partial}: an unfinished recording; continue it with resume=True (--resume), "
                    "or discard it with overwrite=True (--overwrite)"
                )

    def _continue(self) -> None:
        identity = self._progress.identity
        try:
            self._progress.load()
            zarrstore.require_described(self._store)
            zarrstore.cut(self._store, self.done)
            self._template = zarrstore.read(self._store)
            if self._template.sizes["time"] != self.done:
                raise ValueError(f"{self._template.sizes['time']} of {self.done} pairs are there")
        except Exception as error:  # whatever damage leads to
            raise FieldFileError(
                f"{self.partial}: the unfinished recording cannot be read ({error}); "
                "discard it with overwrite=True (--overwrite)"
            ) from error
        if identity:
            self._compare(identity, self._progress.identity)
        self.frames = FrameDigests(self._progress.frames)
        self._logged_frames = len(self.frames.known)

    def stored(self) -> xr.Dataset | None:
        """The pairs that are already safe, to be read as they are needed; None if there are none."""
        if not self.done:
            return None
        with damage_reported(self.partial):
            return guarded(zarrstore.read(self._store), self.partial)

    def append(self, field: xr.Dataset) -> None:
        """Add the field of the next pair or pairs, dims (time, y, x, ...), on the same grid as the first.

        Raises
        ------
        InputError
            If the grid or the variables differ.
        FieldFileError
            If the disk refuses, or the settings are not those that the recording began with.
        """
        field = checked_field(field)
        if "time" not in field.dims:
            raise InputError(
                "field: the dimension 'time' is missing; append fields of pairs, not single maps"
            )
        if self._template is None:
            self._template = field.isel(time=slice(0))
        _check_alike(field, self._template)
        self._compare(_settings(field), _settings(self._template))
        new = self.frames.known[self._logged_frames :]
        self._progress.add(field.sizes["time"], said_of_pairs(field.attrs), new)
        self._logged_frames += len(new)
        self._pending.append(field)
        if sum(part.sizes["time"] for part in self._pending) >= self._room:
            rest = _joined(self._pending)
            while rest.sizes["time"] >= self._room:
                room = self._room
                self._flush(rest.isel(time=slice(room)))
                rest = rest.isel(time=slice(room, None))
            self._pending = [rest] if rest.sizes["time"] else []

    @property
    def _room(self) -> int:
        """Pairs that are missing to a whole chunk."""
        return self._progress.batch - self.done % self._progress.batch

    def _compare(self, ours: Mapping[str, Any], theirs: Mapping[str, Any]) -> None:
        for name in sorted(ours.keys() | theirs.keys()):
            if ours.get(name) != theirs.get(name):
                raise FieldFileError(
                    f"{self.partial}: the recording began with {name} = {theirs.get(name)}, "
                    f"but now it is {ours.get(name)}; take the former, "
                    "or discard the recording with overwrite=True (--overwrite)"
                )

    def _flush(self, field: xr.Dataset) -> None:
        with disk_errors(self.partial):
            if self.done:
                zarrstore.extend(self._store, field, self.done)
            else:
                self.partial.mkdir(exist_ok=True)
                zarrstore.create(self._store, field, self._progress.batch)
            self._progress.save(self.done + field.sizes["time"])

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._lock:
            if error is not None:
                self._keep(error)
                return
            try:
                with disk_errors(self.path):
                    self._finish()
            except BaseException as problem:  # an interruption too leaves what is complete
                self._keep(problem)
                raise

    def _keep(self, error: BaseException) -> None:
        """Leave what is complete for resuming, and say so in the error."""
        if isinstance(error, BadFrameError | FrameFileError) and self._pending:
            self._flush(_joined(self._pending))  # a frame has stopped the measurement, and these are right
            self._pending = []
        if self.done:
            error.add_note(
                f"{self.done} pairs are complete in {self.partial}; continue with resume=True (--resume)"
            )
        elif self._pending:
            remove(self.partial)

    def _finish(self) -> None:
        if self._pending:
            self._flush(_joined(self._pending))
            self._pending = []
        if not self.done:
            raise FieldFileError(f"{self.path}: nothing was appended, so nothing is written")
        said = self._progress.said
        joined = joined_attrs(said)
        disputed = {name for one in said for name in one} - set(joined)
        with damage_reported(self.partial):
            zarrstore.describe(self._store, joined, disputed)
        if self.path.suffix.lower() == ".zarr":
            zarrstore.seal(self._store)
            check_replaceable(self.path, self._overwrite)
            publish(self._store, self.path)
        else:
            save(self._stored(), self.path, self._overwrite)
        remove(self.partial)

    def _stored(self) -> Iterator[xr.Dataset]:
        with damage_reported(self.partial), zarrstore.read(self._store) as field:
            whole = guarded(in_order(field), self.partial).drop_encoding()
            yield from batches(whole, self._progress.batch)


def _settings(field: xr.Dataset) -> dict[str, Any]:
    return {"settings": field.attrs.get("settings")}


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
