"""Reading: what a user does with a file of each kind, and what became of it.

Run as a program, it reads mutants in turn and writes one line of JSON for each:

    python -m fuzzing.reading KIND SEED FOLDER FIRST COUNT
"""

from __future__ import annotations

import json
import re
import resource
import shutil
import sys
import time
import traceback
import warnings
from pathlib import Path

import sixflow
from fuzzing.mutants import make_mutant
from sixflow.errors import SixflowError
from sixflow.frames import BadFrame

ADDRESS_SPACE = 8 * 2**30
"""Bytes of address space of the reading process: a claim beyond it is a MemoryError, not the end of the machine."""


def read_frames(path: Path) -> str:
    """Open a recording, read all frames, ask everything."""
    source = sixflow.open_frames(path)
    frames = [frame for frame, _ in zip(source.attempt(), range(1000), strict=False)]
    _ = source.notes, source.times, source.names, source.description, source.metadata, source.numbers
    bad = sum(isinstance(frame, BadFrame) for frame in frames)
    return "refused" if bad == len(frames) else f"read, {bad} bad" if bad else "read"


def read_field(path: Path) -> str:
    """Open a field and ask what `sixflow info` asks; or go on with an interrupted recording."""
    if path.name.endswith(".partial"):
        with sixflow.write.RecordingWriter(path.with_suffix(""), resume=True) as writer:
            stored = writer.stored()
            if stored is not None:
                stored.load()
        return "read"
    from sixflow.cli.info import describe_field

    with sixflow.open_field(path) as field:
        describe_field(field, str(path))
        field.load()
        _ = field.sixflow.vorticity, field.sixflow.standard_error("hencky"), field.sixflow.valid
    return "read"


def read_settings(path: Path) -> str:
    """Read settings."""
    sixflow.Settings.from_toml(path)
    return "read"


def read_mask(path: Path) -> str:
    """Read a mask for frames of the seeds' size."""
    sixflow.read_mask(path, shape=(48, 64))
    return "read"


READ = {"frames": read_frames, "field": read_field, "settings": read_settings, "mask": read_mask}


def outcome(kind: str, path: Path) -> tuple[str, str]:
    """What became of a file, "read", "refused" or "foreign", and the last words."""
    try:
        return READ[kind](path), ""
    except SixflowError as error:
        named = path.name in str(error) or kind == "settings"
        return ("refused" if named else "refused, file not named"), str(error)
    except BaseException as error:  # everything else is what this looks for
        where = traceback.extract_tb(error.__traceback__)[-1]
        inner = [frame for frame in traceback.extract_tb(error.__traceback__) if "sixflow" in frame.filename]
        place = f"{Path(inner[-1].filename).name}:{inner[-1].lineno}" if inner else where.name
        return "foreign", f"{type(error).__name__}: {' '.join(str(error).split())[:120]} ({place})"


def peak_memory() -> int:
    """Most bytes that this process has held; Linux only, since others count the parent's too."""
    found = re.search(r"VmHWM:\s+(\d+) kB", Path("/proc/self/status").read_text())
    return int(found[1]) * 1024 if found else 0


def main(kind: str, seed: str, folder: str, first: str, count: str) -> None:
    """Read mutants `first` to `first + count − 1` of a seed, one line for each."""
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_SPACE, ADDRESS_SPACE))
    report = sys.stdout
    sys.stdout = sys.stderr
    for number in range(int(first), int(first) + int(count)):
        target = Path(folder) / Path(seed).name
        done = make_mutant(Path(seed), target, number)
        print(json.dumps({"begins": number, "damage": done}), file=report, flush=True)
        started = time.perf_counter()
        with warnings.catch_warnings(record=True) as heard:
            warnings.simplefilter("always")
            result, said = outcome(kind, target)
        line = {"number": number, "damage": done, "result": result, "said": said, "peak": peak_memory()}
        line |= {
            "seconds": time.perf_counter() - started,
            "warned": [str(one.message)[:100] for one in heard],
        }
        print(json.dumps(line), file=report, flush=True)
        for left in Path(folder).iterdir():
            shutil.rmtree(left) if left.is_dir() else left.unlink()


if __name__ == "__main__":
    main(*sys.argv[1:])
