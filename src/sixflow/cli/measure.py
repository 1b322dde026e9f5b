"""`sixflow measure`: from frames to a field file."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

from cyclopts import Parameter

from sixflow.cli.errors import BAD_FRAMES, say
from sixflow.cli.flags import Output, Switch, Whole, number_reader, read_update
from sixflow.cli.progress import announce_compilation, progress
from sixflow.cli.selection_flags import SelectionFlags
from sixflow.cli.settings_flags import SettingsFlags, gather_settings
from sixflow.errors import InputError, MeasurementError
from sixflow.settings import Settings
from sixflow.version import __version__

if TYPE_CHECKING:
    from sixflow.cli.tally import Tally
    from sixflow.frames import FrameSource
    from sixflow.masks import MaskFile
    from sixflow.recording.schedule import Schedule
    from sixflow.recording.sequence import Update

Pairs: TypeAlias = Literal["consecutive", "double", "first", "incremental"]
UpdateFlag: TypeAlias = Annotated[
    int | Literal["lost"] | None, Parameter(converter=read_update, show_default=False)
]
SHOWN_NOTES = 5
"""Notes that are written out; a long recording may have one for every pair."""


def measure(
    frames: Annotated[tuple[str, ...], Parameter(name="FRAMES")],
    /,
    *,
    output: Output,
    selection: Annotated[SelectionFlags | None, Parameter(name="*")] = None,
    flags: Annotated[SettingsFlags | None, Parameter(name="*")] = None,
    settings: Path | None = None,
    mask: Path | None = None,
    bodies: Switch = False,
    pairs: Pairs = "consecutive",
    lag: Whole = 1,
    update: UpdateFlag = None,
    strict: Switch = False,
    threads: Annotated[int | None, Parameter(converter=number_reader(int), show_default=False)] = None,
    overwrite: Switch = False,
    resume: Switch = False,
    plot: Path | None = None,
    quiet: Annotated[Switch, Parameter(name=("--quiet", "-q"))] = False,
) -> int:
    """Measure the six-parameter flow field of a pair of frames, or of a recording.

    Two files are a pair. A folder, a pattern in quotes, a stack, a video, or more than two files are a
    recording. The output is checked before anything is measured, and appears under its name only when it is
    complete.

    Parameters
    ----------
    frames
        Files, a folder, a pattern in quotes such as 'run/A_*.tif', or a video.
    output
        The field: .nc (netCDF-4), .zarr (a folder, for long recordings) or .csv (a table).
    settings
        TOML file of settings, with lines such as: window = 41. Flags win over it.
    mask
        Picture of the frames' size: non-zero where to measure; also .npy, and .roi or .zip of ImageJ. A stack or a
        folder has one for each frame, for bodies that move.
    bodies
        The values of the mask are numbers of bodies, which are measured apart even where they touch.
    pairs
        Each frame against the next; 0 against 1, 2 against 3 …, as double-frame cameras record; the first frame against
        each later one; or the latter by steps from frame to frame.
    lag
        With --pairs consecutive: each frame against the one so many frames later.
    update
        With --pairs first: compare with a new frame every so many frames, or when correlation is 'lost'.
    strict
        Stop at the first frame that cannot be used, instead of flagging its pairs and going on.
    threads
        How many threads may compute; without it the environment variable SIXFLOW_THREADS, or one per processor.
    overwrite
        Replace the output, and the picture of --plot, if they exist.
    resume
        Continue a recording that was interrupted.
    plot
        Draw the field of the first pair too: .png, .pdf or .svg.
    quiet
        No progress, notes or closing lines; errors only.
    """
    from sixflow.cli.figures import check_figure
    from sixflow.frames import open_frames
    from sixflow.recording.schedule import Schedule
    from sixflow.recording.sequence import check_update
    from sixflow.write import check_output

    output = check_output(output, overwrite)
    picture = None if plot is None else check_figure(plot, overwrite)
    chosen = gather_settings(flags, settings)
    source = open_frames(frames[0] if len(frames) == 1 else list(frames), **(selection or {}))
    _require_pair(source, frames)
    if bodies and mask is None:
        raise InputError("--bodies: there is no mask whose values could be numbers of bodies; give --mask")
    check_update(update, pairs, chosen.reference)
    job = Job(
        source,
        chosen,
        Schedule(pairs, lag),
        update,
        strict,
        threads,
        None if mask is None else _open_mask(mask, bodies, source),
    )
    tally, seconds = _measure_into(output, job, overwrite=overwrite, resume=resume, quiet=quiet)
    if picture is not None:
        _draw_first(job, picture)
    if not quiet:
        say_notes(tally.notes)
        print(f"{output}: {tally.describe(job.pair_count, seconds)}")
    _require_some(tally, output)
    return BAD_FRAMES if tally.unusable else 0


@dataclasses.dataclass(frozen=True)
class Job:
    """What is measured, and how."""

    source: FrameSource
    settings: Settings
    schedule: Schedule
    update: Update
    strict: bool
    threads: int | None
    mask: MaskFile | None

    @property
    def pair_count(self) -> int:
        """Number of pairs."""
        return self.schedule.count(len(self.source))

    @property
    def options(self) -> dict[str, Any]:
        """How to measure the recording, as keywords of `iterate_sequence`."""
        return {
            "pairs": self.schedule.pairs,
            "lag": self.schedule.lag,
            "update": self.update,
            "mask": self.mask,
            "settings": self.settings,
            "threads": self.threads,
            "strict": self.strict or self.pair_count == 1,  # a pair is measured or refused
        }

    @property
    def identity(self) -> dict[str, str]:
        """What tells this measurement from others, when an interrupted one is continued."""
        mask = "none" if self.mask is None else self.mask.digest
        return {
            "settings": self.settings.to_json(),
            "frames": f"{len(self.source)} frames, the first with digest {self.source.fingerprint}",
            "pairs": self.schedule.pairs
            + f", lag {self.schedule.lag}" * (self.schedule.lag > 1)
            + f", update {self.update}" * (self.update is not None),
            "mask": mask,
            "sixflow_version": __version__,
        }


def _measure_into(
    output: Path, job: Job, *, overwrite: bool, resume: bool, quiet: bool
) -> tuple[Tally, float]:
    """Measure pair by pair into the output; return what was measured, and the seconds it took."""
    from sixflow.cli.tally import Tally
    from sixflow.measurement import iterate_sequence
    from sixflow.write import RecordingWriter

    tally, options = Tally(), {"overwrite": overwrite, "resume": resume}
    with RecordingWriter(output, identity=job.identity, **options) as writer:
        announce_compilation("float64" if job.settings.float64 else "float32", quiet=quiet)
        started = time.perf_counter()
        with progress(job.pair_count, writer.done, quiet=quiet) as advance:
            for field in iterate_sequence(
                job.source,
                skip=writer.done,
                done=writer.stored(),
                seen=writer.frames,
                **job.options,
            ):
                writer.append(field)
                tally.add(field)
                advance()
    return tally, time.perf_counter() - started


def _draw_first(job: Job, path: Path) -> None:
    """Draw the field of the first pair, measured once more: a long recording is not read back for it."""
    from sixflow.frames import BadFrame
    from sixflow.measurement import iterate_sequence
    from sixflow.plot import plot_field

    field = next(iter(iterate_sequence(job.source, **job.options)))
    place = job.schedule.lag if job.settings.reference == "second" else 0
    frame = next(job.source.attempt(place))
    plot_field(field, None if isinstance(frame, BadFrame) else frame, path=path)


def _open_mask(path: Path, bodies: bool, source: FrameSource) -> MaskFile:
    """Read the mask, and check its number and shape before anything is measured."""
    from sixflow.masks import Masks, open_mask

    file = open_mask(path, bodies=bodies)
    masks = Masks(file)
    masks.require(len(source))
    first = masks.at(0)
    if first is not None:
        first.of_shape(source.shape)
    return file


def say_notes(notes: Iterable[str]) -> None:
    """Write each note once to stderr, the first few of many."""
    unique = list(dict.fromkeys(notes))
    for note in unique[:SHOWN_NOTES]:
        say(f"note: {note}")
    if len(unique) > SHOWN_NOTES:
        say(f"note: and {len(unique) - SHOWN_NOTES} more, in the attribute 'notes' of the field")


def _require_pair(source: FrameSource, given: tuple[str, ...]) -> None:
    if len(source) < 2:
        raise InputError(
            f"{' '.join(given)}: a single frame; give two files, or a folder, a pattern, a stack or a video"
        )


def _require_some(tally: Tally, output: Path) -> None:
    if tally.pairs and not tally.valid:
        raise MeasurementError(
            f"none of the {tally.points} points could be measured; most are flagged {tally.main_flag()!r}: "
            f"see the flags in {output}, and try a larger --window or another --lighting"
        )
