"""Two versions of sixflow on the same frames: do they give the same numbers, and in what time?

    python benchmarks/agreement.py --save before.npz       measure, and keep the result
    python benchmarks/agreement.py --against before.npz    measure again, and compare; a few minutes on two cores
    python benchmarks/agreement.py --against before.npz --public FOLDER    with public cases (docs/public.md)
    python benchmarks/agreement.py --against before.npz mask local         cases whose names contain one of the words

Cases are rendered by `sixflow.synth` with exact truth (`agreement_cases`). A difference is counted in units of the
standard error that was stated before, over the points that both versions give and all six numbers. Printed are

| column | meaning |
|---|---|
| given | grid points with a value, before and after |
| median, largest | of the differences; targets 0.05 and 0.5 |
| ± | median ratio of the standard errors, after over before |
| flags | share of the grid points whose flag changed |
| rms px | error of u and v against truth, before and after |
| spread | standard deviation of error / stated standard error of the six, before and after |
| time | ratio of the processor times (the less of two runs each, all threads together) |

Rounding alone makes differences of some 10⁻³; points at a threshold change their flags.
"""

from __future__ import annotations

import argparse
import dataclasses
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import sixflow
from agreement_cases import Case, public_cases, synthetic_cases
from cases import console, rms, show, verdict
from public_cases.case import CaseError
from sixflow.convention import SIX, change_reference

MEDIAN, LARGEST = 0.05, 0.5  # standard errors
REPEATS = 2
UPPER = np.triu_indices(6)


@dataclasses.dataclass(frozen=True)
class Measured:
    """What one version made of a case: the six (rows, columns, 6), the upper triangle of their covariance (…, 21), flag
    and processor time in seconds.
    """

    six: NDArray[Any]
    covariance: NDArray[Any]
    flag: NDArray[Any]
    seconds: float

    @property
    def given(self) -> NDArray[np.bool_]:
        """Points with a value."""
        return np.isfinite(self.six).all(axis=-1)

    @property
    def standard_error(self) -> NDArray[Any]:
        """Of the six; (rows, columns, 6)."""
        return np.sqrt(self.covariance[..., UPPER[0] == UPPER[1]])


def measure(case: Case) -> tuple[Measured, NDArray[Any]]:
    """Measure a case; its truth at the grid points comes along."""
    scene, seconds = case.scene(), np.inf
    for _ in range(REPEATS):
        begin = time.process_time()
        field = sixflow.measure(scene.frame0, scene.frame1, mask=scene.mask, **case.options)
        seconds = min(seconds, time.process_time() - begin)
    six = np.stack([field[name].values[0] for name in SIX], axis=-1)
    covariance = field.covariance.values[0][..., UPPER[0], UPPER[1]]
    truth = scene.truth(*np.meshgrid(field.x.values.astype(float), field.y.values.astype(float)))
    truth = change_reference(
        truth, "first", case.options.get("reference", "first")
    )  # as it is for affine motions
    return Measured(six, covariance, field.flag.values[0], seconds), truth


def differences(before: Measured, after: Measured) -> NDArray[Any]:
    """Differences of the six in standard errors, over the points given by both; shape (points, 6).

    A number that is stated without error, because its group does not have it, must not differ at all.
    """
    both = before.given & after.given
    difference = np.abs(after.six[both].astype(float) - before.six[both])
    error = before.standard_error[both].astype(float)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(difference == 0, 0.0, difference / error)


def accuracy(measured: Measured, truth: NDArray[Any]) -> tuple[float, float]:
    """Rms error of u and v, px, and standard deviation of the standardised errors of the six."""
    error = measured.six - truth
    stated = measured.standard_error
    with np.errstate(invalid="ignore", divide="ignore"):
        z = np.where(stated > 0, error / stated, np.nan)
    moved, z = error[..., :2], z[np.isfinite(z)]
    moved = moved[np.isfinite(moved)]
    return (float(rms(moved)) if moved.size else np.nan), (float(z.std()) if z.size else np.nan)


def compared(case: Case, before: Measured, after: Measured, truth: NDArray[Any]) -> tuple[list[str], bool]:
    """One row of the table, and whether the targets are met."""
    off = differences(before, after)
    both = before.given & after.given
    median, largest = (float(np.median(off)), float(off.max())) if off.size else (0.0, 0.0)
    ratio = after.standard_error[both] / np.where(
        before.standard_error[both] > 0, before.standard_error[both], np.nan
    )
    known = ratio[np.isfinite(ratio)]
    errors = [accuracy(one, truth) for one in (before, after)]
    met = median <= MEDIAN and largest <= LARGEST
    row = [
        case.name,
        f"{before.given.sum()}",
        f"{after.given.sum()}",
        f"{median:.4f}",
        f"{largest:.3f}",
        f"{np.median(known):.3f}" if known.size else "–",
        f"{100 * (before.flag != after.flag).mean():.2f} %",
        *(f"{error:.4g}" for error, _ in errors),
        *(f"{spread:.3f}" for _, spread in errors),
        f"{after.seconds / before.seconds:.2f}",
        verdict(met),
    ]
    return row, met


def save(path: Path, measured: dict[str, Measured]) -> None:
    """Keep what was measured in one file."""
    arrays: dict[str, Any] = {"names": np.array(list(measured)), "version": np.array(sixflow.__version__)}
    for number, one in enumerate(measured.values()):
        for field in dataclasses.fields(one):
            arrays[f"{number}.{field.name}"] = getattr(one, field.name)
    np.savez_compressed(path, **arrays)


def load(path: Path) -> dict[str, Measured]:
    """Read what `save` has kept."""
    with np.load(path) as file:
        names = [str(name) for name in file["names"]]
        keys = [field.name for field in dataclasses.fields(Measured)]
        return {
            name: Measured(**{key: file[f"{number}.{key}"][()] for key in keys})
            for number, name in enumerate(names)
        }


def against(title: str, cases: Iterable[Case], kept: dict[str, Measured]) -> None:
    """Measure the cases of one table, and print how they agree with what was kept."""
    rows, missed, absent, ratios = [], 0, [], []
    for case in cases:
        if case.name not in kept:
            absent.append(case.name)
            continue
        before = kept[case.name]
        after, truth = measure(case)
        row, met = compared(case, before, after, truth)
        rows.append(row)
        ratios.append(after.seconds / before.seconds)
        missed += not met
    if rows:
        header = ["case", "given", "after", "median", "largest", "±", "flags", "rms px", "after", "spread", "after",
                  "time", ""]  # fmt: skip
        show(f"{title}: difference in standard errors; median ≤ {MEDIAN}, largest ≤ {LARGEST}", header, rows)
        console.print(
            f"{len(rows) - missed} of {len(rows)} cases meet the targets; processor time {np.median(ratios):.2f} of "
            "that before (median)\n"
        )
    if absent:
        console.print(f"not in the file, and not compared: {'; '.join(absent)}\n")


def chosen(words: list[str], public: Path | None) -> dict[str, list[Case]]:
    """The cases whose names contain one of the words, all if there is none, by the table that they stand in."""
    tables = {"Rendered cases": synthetic_cases(), "Public cases": public_cases(public) if public else ()}
    return {
        title: [case for case in cases if not words or any(word in case.name for word in words)]
        for title, cases in tables.items()
    }


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("words", nargs="*", help="cases whose names contain one of these; all if none")
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--save", type=Path, metavar="FILE", help="keep what is measured")
    what.add_argument("--against", type=Path, metavar="FILE", help="compare with what was kept")
    parser.add_argument("--public", type=Path, metavar="FOLDER", help="public cases too")
    arguments = parser.parse_args()
    console.print(f"sixflow {sixflow.__version__}, {Path(sixflow.__file__).parent}\n")
    try:
        tables = chosen(arguments.words, arguments.public)
        if arguments.save:
            save(arguments.save, {case.name: measure(case)[0] for cases in tables.values() for case in cases})
            return
        kept = load(arguments.against)
        for title, cases in tables.items():
            against(title, cases, kept)
    except CaseError as error:
        parser.exit(2, f"{parser.prog}: {error}\n")


if __name__ == "__main__":
    main()
