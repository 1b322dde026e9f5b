"""Reading the cases of a folder.

A case is a folder that holds

| file | content |
|---|---|
| case.json | `kind` (dic-…, piv-…, of-…) and, where the motion is known, `pair` [k, l]: the frames compared |
| frame*.tif | the frames in the order of their names, grey, one shape |
| truth.npz | `u`, `v` [px] on frame k's pixels, broadcast to its shape; `mask`: where they are known |

or, in place of truth.npz, `affine` in case.json: u = u0 + ux x + uy y, v = v0 + vx x + vy y. The motion maps frame
k onto frame l, I_l(x + u) = I_k(x), with x to the right, y down, and pixel centres at whole numbers. Folders may be
nested: the name of a case is its path, and the first part of it the set that it belongs to.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray

from public_cases.truth import Truth

EXPERIMENTS = {"piv": "PIV", "dic": "DIC", "of": "vision"}


class CaseError(Exception):
    """A folder of cases cannot be used; the message says what to do."""


@dataclasses.dataclass(frozen=True)
class Case:
    """One pair of frames with its true displacement."""

    name: str
    experiment: str
    frame0: NDArray[Any]
    frame1: NDArray[Any]
    truth: Truth

    @property
    def set_name(self) -> str:
        """First part of the name: cases of one set share a table and a figure."""
        return self.name.split("/")[0]


def find_cases(folder: str | None, wanted: Sequence[str] = ()) -> list[Path]:
    """Return the folders of the cases with known motion whose names contain one of the words wanted, in order.

    Raises
    ------
    CaseError
        If the folder is not given, does not exist, or holds no such case.
    """
    if not folder:
        raise CaseError(
            "SIXFLOW_BENCHMARKS is not set: set it to a folder of cases; docs/public.md says what a case is"
        )
    root = Path(folder)
    if not root.is_dir():
        raise CaseError(
            f"SIXFLOW_BENCHMARKS={folder!r}: no such folder; docs/public.md says what it must hold"
        )
    known = [path.parent for path in sorted(root.rglob("case.json")) if "pair" in _description(path)]
    if not known:
        raise CaseError(
            f"SIXFLOW_BENCHMARKS={folder!r}: holds no case with known motion (a case.json with a pair); "
            "docs/public.md says what a case is"
        )
    chosen = [path for path in known if not wanted or any(word in name_of(path, root) for word in wanted)]
    if not chosen:
        names = ", ".join(sorted({name_of(path, root).split("/")[0] for path in known}))
        raise CaseError(f"no case is named like {', '.join(wanted)}; the sets are {names}")
    return chosen


def read_cases(folders: Sequence[Path], root: Path) -> Iterator[Case]:
    """Read one case after the other."""
    for folder in folders:
        yield read_case(folder, name_of(folder, root))


def name_of(folder: Path, root: Path) -> str:
    """Name of a case: its folder as seen from the root."""
    return folder.relative_to(root).as_posix()


def read_case(folder: Path, name: str) -> Case:
    """Read one case.

    Raises
    ------
    CaseError
        If a file is missing, or does not hold what this module's text says.
    """
    described = _description(folder / "case.json")
    experiment = EXPERIMENTS.get(str(described.get("kind", "")).split("-")[0])
    if experiment is None:
        raise CaseError(
            f"{name}: kind={described.get('kind')!r} begins with none of {', '.join(EXPERIMENTS)}"
        )
    frames = sorted(folder.glob("frame*.tif"))
    try:
        frame0, frame1 = (tifffile.imread(frames[k]) for k in described["pair"])
        if frame0.ndim != 2 or frame0.shape != frame1.shape:
            raise CaseError(
                f"{name}: frames of shapes {frame0.shape}, {frame1.shape}: must be grey, of one shape"
            )
        return Case(name, experiment, frame0, frame1, _truth(folder, name, described, frame0.shape))
    except IndexError as error:
        raise CaseError(f"{name}: pair={described['pair']}, with {len(frames)} files frame*.tif") from error
    except (KeyError, TypeError, ValueError, OSError) as error:
        raise CaseError(f"{name}: cannot be read: {type(error).__name__}: {error}") from error


def _truth(folder: Path, name: str, described: dict[str, Any], shape: tuple[int, int]) -> Truth:
    if "affine" in described:
        values = described["affine"]
        return Truth.affine(shape, [values[key] for key in ("u0", "v0", "ux", "uy", "vx", "vy")])
    if not (folder / "truth.npz").exists():
        raise CaseError(f"{name}: neither truth.npz nor affine in case.json: no motion to compare with")
    with np.load(folder / "truth.npz") as file:
        return Truth.sampled(shape, file["u"], file["v"], file.get("mask"))


def _description(path: Path) -> dict[str, Any]:
    try:
        described = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise CaseError(f"{path.parent.name}/{path.name} cannot be read: {error}") from error
    if not isinstance(described, dict):
        raise CaseError(f"{path.parent.name}/{path.name}: must hold a JSON object")
    return described
