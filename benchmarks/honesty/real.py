"""Real particle pairs without a known motion: cases of a folder of `kind` piv… that have no `pair`."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray

from honesty.scenes import Maker, Scene
from public_cases.case import name_of


def real(folder: str) -> Iterator[tuple[str, Maker]]:
    """Names of the double-frame pairs of a folder, frames 0 and 1, 2 and 3 …, and what reads them."""
    root = Path(folder)
    for described in sorted(root.rglob("case.json")):
        case = json.loads(described.read_text(encoding="utf-8"))
        if "pair" in case or not str(case.get("kind", "")).startswith("piv"):
            continue
        frames = sorted(described.parent.glob("frame*.tif"))
        for k in range(0, len(frames) - 1, 2):
            name = f"{name_of(described.parent, root)}/{k}-{k + 1}"
            yield name, lambda name=name, pair=tuple(frames[k : k + 2]): _read(name, pair)


def _read(name: str, paths: Any) -> Scene:
    frames = tuple(_grey(tifffile.imread(path)) for path in paths)
    return Scene(name, (frames[0], frames[1]), lambda x, y: np.full((*x.shape, 6), np.nan))


def _grey(frame: NDArray[Any]) -> NDArray[Any]:
    return frame if frame.ndim == 2 else np.asarray(frame[..., :3].mean(axis=-1))
