"""Damaged files of every kind: each must be refused by an error of sixflow's own, or read.

    python benchmarks/fuzz.py                        # 300 mutants of every seed
    python benchmarks/fuzz.py --mutants 50 --only mp4,ome
    python benchmarks/fuzz.py --keep kept            # keep the files that were not refused as they should be

A seed is a small whole file; a mutant is a damaged copy, the same for the same number. A process of its own reads the
mutants of a seed, with a limit on memory. A mutant that takes more than --limit seconds counts as a hang; one that ends
the process counts as a crash. Printed for each seed: mutants tried, refused, and read (whole or in part); foreign
exceptions, crashes and hangs; refusals that do not name the file; mutants with warnings that reached the user; seconds
of the slowest; the peak memory of the process.
Exit 1 if there were foreign exceptions, crashes or hangs, or the peak was 2 GiB or more.
"""

from __future__ import annotations

import argparse
import concurrent.futures
import dataclasses
import json
import os
import queue
import shutil
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

from cases import console, show
from fuzzing.mutants import make_mutant
from fuzzing.seeds import make_seeds

PEAK = 2 * 2**30
"""Bytes that reading a damaged file may take at most."""


@dataclasses.dataclass
class Tally:
    """What became of the mutants of one seed."""

    kind: str
    seed: Path
    tried: int = 0
    refused: int = 0
    read: int = 0
    foreign: int = 0
    crashes: int = 0
    hangs: int = 0
    unnamed: int = 0
    warned: int = 0
    slowest: float = 0.0
    peak: int = 0
    found: list[str] = dataclasses.field(default_factory=list)

    def add(self, line: dict) -> None:
        """Count a mutant."""
        self.tried += 1
        result = line["result"]
        self.refused += result.startswith("refused")
        self.unnamed += result.endswith("not named")
        self.read += result.startswith("read")
        self.foreign += result == "foreign"
        self.crashes += result == "crash"
        self.hangs += result == "hang"
        self.warned += bool(line.get("warned"))
        self.slowest, self.peak = (
            max(self.slowest, line.get("seconds", 0)),
            max(self.peak, line.get("peak", 0)),
        )
        if result in ("foreign", "crash", "hang") or result.endswith("not named") or line.get("warned"):
            said = line.get("said") or "; ".join(line.get("warned", ()))
            self.found.append(f"{self.seed.name} {line['number']} ({line['damage']}): {result}: {said}")


class Reader:
    """A process that reads mutants, and is started again after a crash or a hang."""

    def __init__(self, kind: str, seed: Path, limit: float) -> None:
        self.kind, self.seed, self.limit = kind, seed, limit

    def read(self, count: int) -> Tally:
        """Have all mutants read."""
        tally, first = Tally(self.kind, self.seed), 0
        while first < count:
            first = self._from(first, count - first, tally)
        return tally

    def _from(self, first: int, count: int, tally: Tally) -> int:
        """Have mutants read until all are, or the process ends; the number of the next."""
        with tempfile.TemporaryDirectory() as folder:
            command = [sys.executable, "-m", "fuzzing.reading", self.kind, str(self.seed), folder]
            process = subprocess.Popen(
                [*command, str(first), str(count)],
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                cwd=Path(__file__).parent,
                env=os.environ | {"MALLOC_ARENA_MAX": "2", "OPENBLAS_NUM_THREADS": "1"},
            )
            lines: queue.Queue[str | None] = queue.Queue()
            threading.Thread(target=_pass_on, args=(process.stdout, lines), daemon=True).start()
            errors: list[str] = []
            threading.Thread(target=lambda: errors.extend(process.stderr or ()), daemon=True).start()
            now, begun, wait = first, None, self.limit + 60  # the first line comes after the imports
            while True:
                try:
                    text = lines.get(timeout=wait)
                except queue.Empty:
                    process.kill()
                    process.wait()
                    tally.add(
                        {"number": now, "damage": begun, "result": "hang", "said": f"more than {wait:g} s"}
                    )
                    return now + 1
                if text is None:
                    break
                line = json.loads(text)
                if "begins" in line:
                    now, begun, wait = line["begins"], line["damage"], self.limit
                else:
                    tally.add(line)
                    now, begun = now + 1, None
            process.wait()
            if now < first + count:
                said = f"exit {process.returncode} {' '.join(errors[-3:])[-200:]}"
                tally.add({"number": now, "damage": begun, "result": "crash", "said": said})
                return now + 1
            return first + count


def _pass_on(stream: object, lines: queue.Queue[str | None]) -> None:
    for line in stream:  # type: ignore[attr-defined]
        lines.put(line)
    lines.put(None)


def keep(tally: Tally, folder: Path) -> None:
    """Write the mutants that were found again, with what was said of them."""
    for said in tally.found:
        number = int(said.split()[1])
        target = folder / f"{number}-{tally.seed.name}"
        shutil.rmtree(target, ignore_errors=True)
        make_mutant(tally.seed, target, number)
    with (folder / "found.txt").open("a", encoding="utf-8") as file:
        file.writelines(f"{said}\n" for said in tally.found)


def main() -> int:
    """Read the mutants of all seeds, print the table, and return the exit code."""
    arguments = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    arguments.add_argument("--mutants", type=int, default=300)
    arguments.add_argument("--only", default="", help="parts of seeds' names, separated by commas")
    arguments.add_argument("--limit", type=float, default=10.0, help="seconds for one mutant")
    arguments.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    arguments.add_argument("--keep", type=Path, help="folder for the mutants that were found")
    asked = arguments.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        seeds = [
            (kind, path)
            for kind, path in make_seeds(Path(folder))
            if not asked.only or any(part in f"{kind}/{path.name}" for part in asked.only.split(","))
        ]
        with concurrent.futures.ThreadPoolExecutor(asked.jobs) as pool:
            tallies = list(pool.map(lambda one: Reader(*one, asked.limit).read(asked.mutants), seeds))
        if asked.keep:
            asked.keep.mkdir(parents=True, exist_ok=True)
            for tally in tallies:
                keep(tally, asked.keep)
    names = ("kind", "seed", "tried", "refused", "read", "foreign", "crashes", "hangs", "unnamed", "warned")
    rows = [
        [
            *(str(tally.seed.name if name == "seed" else getattr(tally, name)) for name in names),
            f"{tally.slowest:.1f}",
            f"{tally.peak / 2**20:.0f}",
        ]
        for tally in tallies
    ]
    show(f"{asked.mutants} damaged copies of {len(seeds)} files", [*names, "slowest, s", "peak, MiB"], rows)
    for tally in tallies:
        for said in tally.found:
            console.print(said, soft_wrap=True, markup=False)
    wrong = sum(tally.foreign + tally.crashes + tally.hangs for tally in tallies)
    peak = max(tally.peak for tally in tallies)
    tried = sum(tally.tried for tally in tallies)
    console.print(f"{tried} tried, {wrong} foreign exceptions, crashes or hangs, peak {peak / 2**20:.0f} MiB")
    return int(wrong > 0 or peak >= PEAK)


if __name__ == "__main__":
    sys.exit(main())
