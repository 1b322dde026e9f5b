"""What is counted of a field beside the truth, or beside plain correlation.

| word | meaning |
|---|---|
| asked | points that no mask leaves out, whose true motion is known and does not leave the other frame |
| given | points with six finite numbers, without a flag, or with `border` or `unresolved` alone |
| error | length of (u, v) less the truth, px |
| z | (u less the truth) / its standard error, the same for v, and for the four of the gradient: *all* given points |
| wrong | u or v off by more than 5 standard errors and by more than 0.1 px |
"""

from __future__ import annotations

import dataclasses
import time
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

import sixflow
from honesty.correlation import correlate
from honesty.scenes import Scene
from sixflow.convention import SIX
from sixflow.convention.flags import FAILING, FLAGS

Array = NDArray[Any]

WRONG_ERRORS, WRONG = 5.0, 0.1
LARGE = 3.0
OFF = 1.0
"""px: more than that from correlation is another displacement."""


@dataclasses.dataclass
class Tally:
    """Counts of a row of the table, added up over its scenes."""

    asked: int = 0
    given: int = 0
    unflagged: int = 0
    wrong_unflagged: int = 0
    wrong_given: int = 0
    errors: list[Array] = dataclasses.field(default_factory=list)
    angles: list[Array] = dataclasses.field(default_factory=list)
    scores: list[Array] = dataclasses.field(default_factory=list)
    gradient_scores: list[Array] = dataclasses.field(default_factory=list)
    seconds: float = 0.0
    pixels: int = 0

    def row(self) -> list[str]:
        """Cells of the table `HEADER`."""
        errors, angles, z, zg = (
            np.concatenate(values) if values else np.empty(0)
            for values in (self.errors, self.angles, self.scores, self.gradient_scores)
        )
        return [
            str(self.asked),
            _ratio(self.given, self.asked),
            _ratio(self.unflagged, self.given),
            _of(np.mean, errors),
            _of(np.median, errors),
            _of(np.mean, angles, 2),
            _percent(self.wrong_unflagged, self.unflagged),
            _percent(self.wrong_given, self.given),
            _percent((np.abs(z) > LARGE).sum(), z.size),
            _of(_rms, z, 2),
            _percent((np.abs(zg) > LARGE).sum(), zg.size),
            _of(_rms, zg, 2),
            f"{self.seconds / (self.pixels / 1e6):.2f}" if self.pixels else "–",
        ]


HEADER = (
    "case", "asked", "given", "flag 0 of them", "mean px", "median px", "angle °", "wrong, flag 0", "wrong, given",
    "|z| > 3", "rms z", "|z| > 3 grad.", "rms z grad.", "s/Mpx",
)  # fmt: skip


def measure(scene: Scene, options: dict[str, Any]) -> tuple[xr.Dataset, float]:
    """Measure a scene; the field, and the processor time in seconds."""
    more = {} if scene.mask is None else {"mask": scene.mask}
    begin = time.process_time()
    field = sixflow.measure(*scene.frames, **options | more)
    return field, time.process_time() - begin


def given_points(field: xr.Dataset) -> tuple[Array, NDArray[np.bool_]]:
    """The six of the one pair, shape (rows, columns, 6), and where they are given."""
    six = np.stack([field[name].values[0].astype(float) for name in SIX], axis=-1)
    flag = field.flag.values[0].astype(int)
    failing = (flag & (FAILING | FLAGS["replaced"])) != 0
    return six, np.isfinite(six).all(axis=-1) & ~failing


def count(tally: Tally, scene: Scene, options: dict[str, Any]) -> None:
    """Measure a scene and add it to a row."""
    field, seconds = measure(scene, options)
    tally.seconds += seconds
    tally.pixels += scene.frames[0].size
    x, y = np.meshgrid(field.x.values.astype(float), field.y.values.astype(float))
    truth, flag = scene.truth(x, y), field.flag.values[0].astype(int)
    six, given = given_points(field)
    height, width = scene.frames[0].shape
    with np.errstate(invalid="ignore"):
        stays = (np.abs(x + truth[..., 0] - (width - 1) / 2) <= (width - 1) / 2) & (
            np.abs(y + truth[..., 1] - (height - 1) / 2) <= (height - 1) / 2
        )
    asked = np.isfinite(truth[..., :2]).all(axis=-1) & stays & ((flag & FLAGS["masked"]) == 0)
    given &= asked
    difference = (six - truth)[given]
    error = np.stack([field.sixflow.standard_error(name).values[0] for name in SIX], axis=-1)[given]
    off = np.abs(difference[:, :2])
    wrong = ((off > WRONG_ERRORS * error[:, :2]) & (off > WRONG)).any(axis=-1)
    clean = flag[given] == 0
    tally.asked += int(asked.sum())
    tally.given += int(given.sum())
    tally.unflagged += int(clean.sum())
    tally.wrong_given += int(wrong.sum())
    tally.wrong_unflagged += int((wrong & clean).sum())
    tally.errors.append(np.hypot(*difference[:, :2].T))
    tally.angles.append(_angles(six[given][:, :2], truth[given][:, :2]))
    with np.errstate(divide="ignore", invalid="ignore"):
        z = difference / error
    tally.scores.append(z[:, :2].ravel())
    gradient = z[:, 2:].ravel()
    tally.gradient_scores.append(gradient[np.isfinite(gradient)])


def count_unrelated(scene: Scene, options: dict[str, Any]) -> Array:
    """Points, given points, points without a flag, of frames that have nothing in common; processor time, pixels."""
    field, seconds = measure(scene, options)
    _, given = given_points(field)
    clean = given & (field.flag.values[0] == 0)
    return np.array([given.size, given.sum(), clean.sum(), seconds, scene.frames[0].size], float)


def beside_correlation(scene: Scene, options: dict[str, Any]) -> list[str]:
    """Cells of the table `REAL_HEADER`: a pair without truth beside plain correlation.

    Where correlation stands between the points, ours is read at the nearest one, and carried over by its own gradient.
    """
    field, seconds = measure(scene, options)
    x, y, found, accepted = correlate(*scene.frames)
    six, given = given_points(field)
    columns, rows = (
        np.abs(points[:, None] - at).argmin(axis=0)
        for points, at in ((field.x.values, x), (field.y.values, y))
    )
    place = np.ix_(rows, columns)
    dx, dy = (x - field.x.values[columns])[None, :], (y - field.y.values[rows])[:, None]
    u, v, divergence, curl, stretch, shear = np.moveaxis(six[place], -1, 0)
    ours = np.stack(
        [
            u + (divergence + stretch) / 2 * dx + (shear - curl) / 2 * dy,
            v + (shear + curl) / 2 * dx + (divergence - stretch) / 2 * dy,
        ],
        axis=-1,
    )
    both = accepted & given[place]
    apart = np.hypot(*(ours - found)[both].T)
    flag = field.flag.values[0][place]
    clean = apart[flag[both] == 0]
    return [
        str(accepted.size),
        _ratio(accepted.sum(), accepted.size),
        _ratio(both.sum(), accepted.sum()),
        _ratio(given.sum(), given.size),
        _of(np.median, apart),
        _percent((apart > OFF).sum(), apart.size),
        _percent((clean > OFF).sum(), clean.size),
        f"{seconds / (scene.frames[0].size / 1e6):.2f}",
    ]


REAL_HEADER = (
    "pair", "squares", "measured by correlation", "given of these", "given of all points", "median difference px",
    f"off by > {OFF:.0f} px", "off, flag 0", "s/Mpx",
)  # fmt: skip


def _angles(found: Array, truth: Array) -> Array:
    """Angle between (u, v, 1) and its truth, degrees (Barron et al. 1994)."""
    a, b = (np.concatenate([d, np.ones_like(d[:, :1])], axis=-1) for d in (found, truth))
    cosine = (a * b).sum(axis=-1) / np.sqrt((a**2).sum(axis=-1) * (b**2).sum(axis=-1))
    return np.asarray(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


def _rms(values: Array) -> Any:
    return np.sqrt(np.mean(values**2))


def _of(statistic: Any, values: Array, digits: int = 3) -> str:
    return f"{statistic(values):.{digits}f}" if values.size else "–"


def _ratio(part: Any, whole: Any) -> str:
    return f"{part / whole:.3f}" if whole else "–"


def _percent(part: Any, whole: Any) -> str:
    return f"{100 * part / whole:.2f} %" if whole else "–"
