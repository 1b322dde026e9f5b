r"""Demo: a vortex carried by a stream, rendered with exact truth, measured, and compared with it.

Speckle of 320 × 320 px, 8 bits with noise of 3 grey levels, shows a Lamb–Oseen vortex that drifts by (1.2, 0.8) px per
frame; its centre turns by 0.13 rad per frame, so that the curl there is 0.26 and the pattern moves by up to 5.3 px
between frames. The divergence at the centre is not 0: of a finite rotation by θ it is 2 (cos θ − 1).

**Why these settings.** A window sees a wave number k through the response M = exp(−k²σ²/2), σ = window/3.545; what
it does not see is a bias, which no standard error contains. The curl of a vortex of core radius c, ∝ exp(−r²/c²), is
flattened at its centre to c²/(c² + 2σ²): for c = 50 px and a window of 31 px by 6 % or 0.015, which is more than ten
standard errors. Two sharpening passes reduce what is lost at each wave number from 1 − M to (1 − M)³, far
below the noise, and cost twice the noise. What remains is what the covariance predicts: standardised errors of
unit spread, 68 % of them within one standard error and 95 % within 1.96. Measure the frames that the demo saves
with `--sharpen 0` to see the bias.
"""

from __future__ import annotations

import dataclasses
import itertools
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import tifffile
import xarray as xr
from numpy.typing import NDArray

from sixflow.drawing.look import ARROW, FONT, GLYPH_FACE, INK, REFERENCE, new_figure, tidy
from sixflow.field.dataset import SIX
from sixflow.frames import FrameSource, open_frames
from sixflow.measurement import iterate_sequence, join_fields, measure
from sixflow.plot import plot_field
from sixflow.settings import Settings
from sixflow.staging import staged_files
from sixflow.synth import FrameSequence, LambOseen, Sensor, Speckle, sequence
from sixflow.synth.motions.base import Motion
from sixflow.write import write_field

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[Any]

SHAPE, PAIRS = (320, 320), 5
PATTERN = Speckle(sigma=1.5, density=0.2, seed=1)
CAMERA = Sensor(noise=3.0, bits=8, seed=1)
SETTINGS = Settings(window=31, step=8, sharpen=2)

FILES = {
    "frames.tif": "the recording",
    "field.nc": "the field",
    "field.png": "the field of the first pair, on its frame",
    "truth.png": "the field and its errors beside the exact truth",
}
"""What the demo writes."""


@dataclasses.dataclass(frozen=True)
class CarriedVortex(Motion):
    """Lamb–Oseen vortex in a uniform stream: the map of the vortex, and then the drift.

    Parameters
    ----------
    vortex : LambOseen
    drift : (float, float)
        Displacement of the stream in one frame interval, px.
    """

    vortex: LambOseen
    drift: tuple[float, float]

    def _displacement(self, x: Array, y: Array) -> tuple[Array, Array]:
        u, v = self.vortex.displacement(x, y)
        return u + self.drift[0], v + self.drift[1]

    def _gradient(self, x: Array, y: Array) -> tuple[Array, Array, Array, Array]:
        G = self.vortex.gradient(x, y)
        return G[..., 0, 0], G[..., 0, 1], G[..., 1, 0], G[..., 1, 1]

    def _inverse(self, x: Array, y: Array) -> tuple[Array, Array]:
        return self.vortex.inverse(x - self.drift[0], y - self.drift[1])

    def at(self, s: float) -> CarriedVortex:
        """Turned by s times the angle and carried by s times the drift."""
        return CarriedVortex(self.vortex.at(s), (s * self.drift[0], s * self.drift[1]))


MOTION = CarriedVortex(LambOseen(angle=0.13, core=50.0, centre=(156.0, 157.0)), drift=(1.2, 0.8))


@dataclasses.dataclass(frozen=True)
class Comparison:
    """Errors of one of the six numbers against the truth, over all valid points.

    Attributes
    ----------
    name, unit : str
    largest : float
        Largest absolute value of the truth.
    rms_error, rms_predicted : float
        Root mean square of the errors, and of the predicted standard errors.
    coverage_68, coverage_95 : float
        Share of errors within 1 and within 1.96 standard errors.
    """

    name: str
    unit: str
    largest: float
    rms_error: float
    rms_predicted: float
    coverage_68: float
    coverage_95: float

    @property
    def ratio(self) -> float:
        """Error over prediction, ideally 1."""
        return self.rms_error / self.rms_predicted


@dataclasses.dataclass(frozen=True)
class DemoResult:
    """What the demo measured, and where it is.

    Attributes
    ----------
    shape : (int, int)
        Of the frames.
    pairs, points : int
        Pairs, and points of all pairs together.
    valid : float
        Share of valid points.
    seconds_per_pair : float
        Mean time of a measurement, kernels compiled.
    settings : Settings
        Of the measurement.
    rows : tuple of Comparison
        In the order u, v, divergence, curl, stretch, shear.
    files : dict of Path to str
        What was written, with a few words on each; the frames first.
    """

    shape: tuple[int, int]
    pairs: int
    points: int
    valid: float
    seconds_per_pair: float
    settings: Settings
    rows: tuple[Comparison, ...]
    files: dict[Path, str]


def run_demo(
    folder: str | os.PathLike[str], *, overwrite: bool = False, progress: Callable[[], None] | None = None
) -> DemoResult:
    """Render, measure, compare and draw.

    Parameters
    ----------
    folder : path
        Where frames, field and pictures go; it is made if need be.
    overwrite : bool
        Whether the files of an earlier demo are replaced.
    progress : callable, optional
        Called after each pair.

    Raises
    ------
    FieldFileError
        If a file is in the way, or the folder cannot be made or written to.
    """
    folder = Path(folder).expanduser()
    with staged_files(folder, tuple(FILES), overwrite) as place:
        made = sequence(PATTERN, MOTION, SHAPE, PAIRS + 1, sensor=CAMERA)
        tifffile.imwrite(place / "frames.tif", made.frames, photometric="minisblack")
        field, seconds = _measure(open_frames(place / "frames.tif"), progress)
        truth = true_six(made, field)
        write_field(field, place / "field.nc")
        plot_field(field, made.frames[0], path=place / "field.png", title="A vortex carried by a stream")
        draw_comparison(field, truth, place / "truth.png")
    known = field.sixflow.valid
    return DemoResult(
        shape=SHAPE,
        pairs=PAIRS,
        points=known.size,
        valid=float(known.mean()),
        seconds_per_pair=seconds / PAIRS,
        settings=SETTINGS,
        rows=compare(field, truth),
        files={folder / name: what for name, what in FILES.items()},
    )


def _measure(frames: FrameSource, progress: Callable[[], None] | None) -> tuple[xr.Dataset, float]:
    """Return the field, and the seconds that measuring it took, once the kernels are compiled or loaded."""
    first, second = (frame[:64, :64] for frame in itertools.islice(frames, 2))
    measure(first, second, settings=SETTINGS)
    fields, started = [], time.perf_counter()
    for field in iterate_sequence(frames, settings=SETTINGS):
        fields.append(field)
        if progress is not None:
            progress()
    return join_fields(fields), time.perf_counter() - started


def true_six(made: FrameSequence, field: xr.Dataset) -> Array:
    """Return the exact six numbers at the points of a field, shape (time, y, x, 6)."""
    x, y = np.meshgrid(field["x"].values, field["y"].values)
    numbers = zip(field["frame0"].values, field["frame1"].values, strict=True)
    return np.stack([made.truth(x, y, int(first), int(second)) for first, second in numbers])


def compare(field: xr.Dataset, truth: Array) -> tuple[Comparison, ...]:
    """Compare the errors of each of the six with the predicted standard errors.

    Parameters
    ----------
    field : Dataset
        As measured.
    truth : array, shape (time, y, x, 6)
        The exact six numbers.
    """
    known, rows = field.sixflow.valid.values, []
    for number, name in enumerate(SIX):
        error = (field[name].values - truth[..., number])[known]
        predicted = field.sixflow.standard_error(name).values[known]
        size = np.abs(error) / predicted
        rows.append(
            Comparison(
                name=name,
                unit=field[name].attrs["units"],
                largest=float(np.abs(truth[..., number]).max()),
                rms_error=float(np.sqrt(np.mean(error**2, dtype=float))),
                rms_predicted=float(np.sqrt(np.mean(predicted**2, dtype=float))),
                coverage_68=float(np.mean(size < 1)),
                coverage_95=float(np.mean(size < 1.96)),
            )
        )
    return tuple(rows)


def draw_comparison(field: xr.Dataset, truth: Array, path: Path) -> None:
    """Draw v and curl across the vortex beside the truth, and the distributions of the standardised errors."""
    figure = new_figure(7.6, 5.4)
    grid: Any = figure.add_gridspec(3, 6, height_ratios=[1.7, 0.8, 1.1])
    for first, name, unit in ((0, "v", "px"), (3, "curl", "px/px")):
        upper, lower = (figure.add_subplot(grid[row, first : first + 3]) for row in (0, 1))
        _draw_profile(upper, lower, field, truth, name, unit)
    for column, name in enumerate(SIX):
        _draw_histogram(figure.add_subplot(grid[2, column]), field, truth, name)
    figure.savefig(path, dpi=300)


def _draw_profile(upper: Axes, lower: Axes, field: xr.Dataset, truth: Array, name: str, unit: str) -> None:
    """Draw a number of the first pair along the row nearest to the vortex, and its errors below."""
    row, number = int(np.argmin(np.abs(field["y"].values - MOTION.vortex.centre[1]))), SIX.index(name)
    x, y, fine = field["x"].values, int(field["y"].values[row]), np.arange(SHAPE[1])
    measured = field[name].values[0, row]
    bars = 1.96 * field.sixflow.standard_error(name).values[0, row]
    upper.plot(fine, MOTION.six(fine, y)[:, number], color=REFERENCE, linewidth=1, label="exact")
    upper.plot(x, measured, "o", markersize=2, color=ARROW, label="measured")
    tidy(upper, title=f"{name} ({unit}) along row {y}", x_label="", y_label="")
    upper.legend(fontsize=FONT, frameon=False, labelcolor=INK, loc="upper left")
    upper.tick_params(labelbottom=False)
    lower.sharex(upper)
    lower.axhline(0, color=REFERENCE, linewidth=1)
    lower.errorbar(
        x, measured - truth[0, row, :, number], bars, fmt="o", markersize=2, color=ARROW, elinewidth=0.7
    )
    tidy(lower, title="measured − exact, ± 1.96 standard errors", x_label="x (px)", y_label="")


def _draw_histogram(ax: Axes, field: xr.Dataset, truth: Array, name: str) -> None:
    """Draw the distribution of error over standard error, and the normal distribution that it should have."""
    error = (field[name].values - truth[..., SIX.index(name)]) / field.sixflow.standard_error(name).values
    edges = np.linspace(-4, 4, 41)
    ax.hist(error[field.sixflow.valid.values], bins=edges.tolist(), density=True, color=GLYPH_FACE)
    ax.plot(edges, np.exp(-(edges**2) / 2) / np.sqrt(2 * np.pi), color=INK, linewidth=0.8)
    tidy(ax, title=name, x_label="error / std. error", y_label="")
    ax.set_yticks([])
