"""Points without numbers: masked and failed ones are marked so that neither looks like a small value.

Points that are given but unresolved are dotted over their colour.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path
from numpy.typing import NDArray

from sixflow.drawing.look import FAILED_EDGE, FAILED_FACE, MASKED_EDGE, MASKED_FACE
from sixflow.plot.view import View, cell_edges

Array = NDArray[Any]

_MASKED = {"facecolor": MASKED_FACE, "edgecolor": MASKED_EDGE, "hatch": "/" * 6, "linewidth": 0.0}
_FAILED = {"facecolor": FAILED_FACE, "edgecolor": FAILED_EDGE, "hatch": "\\" * 6, "linewidth": 0.0}


_UNRESOLVED = {"facecolor": "none", "edgecolor": FAILED_EDGE, "hatch": "." * 3, "linewidth": 0.0}

_MOST_REASONS = 3


def dot_unresolved(ax: Axes, view: View) -> None:
    """Dot the cells of the points whose motion is finer than their window resolves."""
    if view.unresolved.any():
        ax.add_patch(PathPatch(_cells(view.unresolved, view), **_UNRESOLVED))


def fill_missing(ax: Axes, view: View, *, failed: bool = True) -> list[PathPatch]:
    """Fill the cells of masked and failed points with their hatches; return the patches, masked first."""
    patches = []
    for wanted, where, style in zip((True, failed), view.missing, (_MASKED, _FAILED), strict=True):
        if wanted and where.any():
            patch = PathPatch(_cells(where, view), **style)
            ax.add_patch(patch)
            patches.append(patch)
    return patches


def mark_failed(ax: Axes, view: View, shown: NDArray[np.bool_]) -> list[Line2D]:
    """Put a small cross where a mark is missing because the point failed, among the points that are shown."""
    rows, columns = np.nonzero(view.missing[1] & shown)
    if not rows.size:
        return []
    return ax.plot(view.x[columns], view.y[rows], **_CROSS)  # type: ignore[arg-type]


_CROSS = {"linestyle": "none", "marker": "x", "markersize": 2.5, "markeredgewidth": 0.7, "color": FAILED_EDGE}


def legend_handles(view: View, *, crosses: bool = False) -> list[Artist]:
    """Return entries of a legend for the kinds of missing points that occur."""
    masked, failed = (bool(where.any()) for where in view.missing)
    handles: list[Artist] = []
    if masked:
        handles.append(Patch(label="masked", **_MASKED))  # type: ignore[arg-type]
    if failed:
        reasons = [name.replace("_", " ") for name in view.reasons]
        named = ", ".join(reasons[:_MOST_REASONS]) + ", …" * (len(reasons) > _MOST_REASONS)
        handles.append(Patch(label=f"failed ({named})" if named else "failed", **_FAILED))  # type: ignore[arg-type]
    if failed and crosses:
        handles.append(Line2D([], [], label="failed, in a and b", **_CROSS))  # type: ignore[arg-type]
    if view.unresolved.any():
        handles.append(Patch(label="unresolved", **_UNRESOLVED))  # type: ignore[arg-type]
    return handles


def _cells(where: Array, view: View) -> Path:
    """One closed path around every run of cells in a row, so that a large mask stays a small drawing."""
    columns = cell_edges(view.pair["x"].values) * view.scale
    rows = cell_edges(view.pair["y"].values) * (view.scale * view.down)
    padded = np.pad(where.astype(np.int8), ((0, 0), (1, 1)))
    changes = np.diff(padded, axis=1)
    row, start = np.nonzero(changes == 1)
    _, stop = np.nonzero(changes == -1)
    left, right, top, bottom = columns[start], columns[stop], rows[row], rows[row + 1]
    corners = np.stack(
        [
            np.stack([left, top], -1),
            np.stack([right, top], -1),
            np.stack([right, bottom], -1),
            np.stack([left, bottom], -1),
            np.stack([left, top], -1),
        ],
        axis=1,
    )
    codes = np.tile([Path.MOVETO, Path.LINETO, Path.LINETO, Path.LINETO, Path.CLOSEPOLY], len(row))
    return Path(corners.reshape(-1, 2), codes)
