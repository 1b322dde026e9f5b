"""Progress: how much of an unfinished recording is complete, in two small files beside its store.

``progress.json`` is replaced in one step after each batch, and nothing counts before that. ``fields.jsonl``
gets a line for each field, with its last pair, what its attributes said, and the digests of the frames that were read
for it; lines beyond the complete pairs are ignored.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from sixflow.checks import is_whole


class Progress:
    """The pairs of a recording that are complete, and where they came from.

    Attributes
    ----------
    done : int
        Number of complete pairs.
    batch : int
        Pairs per chunk.
    identity : dict
        What tells this recording from others.
    """

    def __init__(self, folder: Path, batch: int, identity: Mapping[str, str]) -> None:
        self._file, self._log = folder / "progress.json", folder / "fields.jsonl"
        self.done, self.batch, self.identity = 0, batch, dict(identity)
        self._fields: list[dict[str, Any]] = []
        self._logged = 0

    @property
    def exists(self) -> bool:
        """Whether any batch was completed."""
        return self._file.exists()

    @property
    def said(self) -> list[dict[str, Any]]:
        """What the attributes of each field said, in order."""
        return [field["said"] for field in self._fields]

    @property
    def frames(self) -> list[str]:
        """Digests of the frames that the fields are of, in order."""
        return [digest for field in self._fields for digest in field.get("frames", [])]

    def load(self) -> None:
        """Take up the state in the files; raises OSError, ValueError, TypeError or KeyError where they are damaged."""
        state = json.loads(self._file.read_text(encoding="utf-8"))
        done, batch, identity = state["done"], state["batch"], state["identity"]
        if not (is_whole(done, 1, 2**40) and is_whole(batch, 1, 2**40) and _is_table(identity, str)):
            raise ValueError("progress.json holds nonsense")
        fields: list[dict[str, Any]] = []
        for line in self._log.read_text(encoding="utf-8").splitlines():
            try:
                field = json.loads(line)
            except ValueError:  # a line that was cut short belongs to a batch that does not count
                break
            begin = fields[-1]["end"] if fields else 0
            if not (_is_table(field["said"], object) and is_whole(field["end"], begin, 2**40)):
                raise ValueError("fields.jsonl holds nonsense")
            if not _is_list_of_text(field.get("frames", [])):
                raise ValueError("fields.jsonl holds digests that are none")
            if field["end"] > done:
                break
            fields.append(field)
        self.done, self.batch, self.identity, self._fields = done, batch, identity, fields
        self._replace(self._log, self._lines(self._fields))
        self._logged = len(self._fields)

    def add(self, pairs: int, said: Mapping[str, Any], frames: Sequence[str] = ()) -> None:
        """Remember a field that was handed over, though not yet written, and the frames that were read for it."""
        begin = self._fields[-1]["end"] if self._fields else self.done
        self._fields.append({"end": begin + pairs, "said": dict(said), "frames": list(frames)})

    def save(self, done: int) -> None:
        """State that the first `done` pairs are complete."""
        new = [field for field in self._fields[self._logged :] if field["end"] <= done]
        with self._log.open("a", encoding="utf-8") as log:
            log.write(self._lines(new))
        self._logged += len(new)
        state = {"done": done, "batch": self.batch, "identity": self.identity}
        self._replace(self._file, json.dumps(state))
        self.done = done

    @staticmethod
    def _lines(fields: list[dict[str, Any]]) -> str:
        return "".join(json.dumps(field) + "\n" for field in fields)

    @staticmethod
    def _replace(path: Path, text: str) -> None:
        beside = path.with_suffix(".new")
        beside.write_text(text, encoding="utf-8")
        os.replace(beside, path)


def _is_table(value: object, kind: type) -> bool:
    return isinstance(value, dict) and all(isinstance(item, kind) for item in value.values())


def _is_list_of_text(value: object) -> bool:
    return isinstance(value, list) and all(isinstance(item, str) for item in value)
