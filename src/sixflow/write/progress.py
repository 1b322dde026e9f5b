"""Progress: how much of an unfinished recording is complete, in two small files beside its store.

``progress.json`` is replaced in one step after each batch, and nothing counts before that. ``fields.jsonl``
gets a line for each field, with its last pair and what its attributes said; lines beyond the complete pairs
are ignored.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any


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
    def said(self) -> list[dict[str, str]]:
        """What the attributes of each field said, in order."""
        return [field["said"] for field in self._fields]

    def load(self) -> None:
        """Take up the state in the files; raises OSError, ValueError or KeyError where they are damaged."""
        state = json.loads(self._file.read_text(encoding="utf-8"))
        self.done, self.batch, self.identity = state["done"], state["batch"], state["identity"]
        for line in self._log.read_text(encoding="utf-8").splitlines():
            try:
                field = json.loads(line)
            except ValueError:  # a line that was cut short belongs to a batch that does not count
                break
            if field["end"] > self.done:
                break
            self._fields.append(field)
        self._replace(self._log, self._lines(self._fields))
        self._logged = len(self._fields)

    def add(self, pairs: int, said: Mapping[str, str]) -> None:
        """Remember a field that was handed over, though not yet written."""
        begin = self._fields[-1]["end"] if self._fields else self.done
        self._fields.append({"end": begin + pairs, "said": dict(said)})

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
