"""One pair of a field in the units and the orientation in which it is drawn."""

from __future__ import annotations

import dataclasses
from typing import Any, Literal, NamedTuple

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from numpy.typing import NDArray

from sixflow.drawing.look import tidy
from sixflow.errors import InputError
from sixflow.field.calibration import Calibration
from sixflow.field.dataset import FAILING, FLAGS, SIX
from sixflow.field.derived import DERIVED, derive, derived_error
from sixflow.field.physical import PHYSICAL_NAMES, to_physical, turn_up
from sixflow.field.selection import flagged, frame_shape, masked_and_failed, one_pair, require_field

Array = NDArray[Any]
Units = Literal["px", "physical"]


class Quantity(NamedTuple):
    """A number per point, ready to be drawn.

    Attributes
    ----------
    values, error : arrays, shape (y, x)
        The number and its standard error; `error` is None where there is none.
    label, unit : str
        Name and unit, such as "divergence" and "px/px".
    signed : bool
        False for a number that is never negative.
    """

    values: Array
    error: Array | None
    label: str
    unit: str
    signed: bool


@dataclasses.dataclass(frozen=True)
class View:
    """One pair of a field, and the way from its pixels to the coordinates of the plot.

    Attributes
    ----------
    pair : Dataset
        Dims (y, x), coordinates in px and y down, signs of the six as they are drawn.
    calibration : Calibration or None
        None draws in px.
    y_up : bool
        The y axis of the plot points upwards.
    """

    pair: xr.Dataset
    calibration: Calibration | None
    y_up: bool

    @classmethod
    def of(cls, field: xr.Dataset, *, time: int, units: Units, y_up: bool) -> View:
        """Choose pair, units and orientation; InputError if one of them cannot be had."""
        if units not in ("px", "physical"):
            raise InputError(f"units={units!r}: must be 'px' or 'physical'")
        pair = one_pair(require_field(field), time)
        calibration = Calibration.of(pair) if units == "physical" else None
        return cls(turn_up(pair) if y_up else pair, calibration, y_up)

    @property
    def scale(self) -> float:
        """Units of the plot per px."""
        return self.calibration.pixel_size if self.calibration else 1.0

    @property
    def unit(self) -> str:
        """Unit of the axes."""
        return self.calibration.length_unit if self.calibration else "px"

    @property
    def down(self) -> int:
        """1 where y grows downwards, −1 where it grows upwards."""
        return -1 if self.y_up else 1

    @property
    def x(self) -> Array:
        """Coordinates of the grid columns, in units of the plot."""
        return self.pair["x"].values * self.scale

    @property
    def y(self) -> Array:
        """Coordinates of the grid rows, in units of the plot."""
        return self.pair["y"].values * (self.scale * self.down)

    @property
    def spacing(self) -> float:
        """Mean distance between neighbouring grid points, in units of the plot."""
        steps = np.concatenate([np.diff(self.pair["x"].values), np.diff(self.pair["y"].values)])
        return float(steps.mean()) * self.scale if steps.size else self.scale

    @property
    def frame_extent(self) -> tuple[float, float, float, float]:
        """Outer edges of the frame: left, right, bottom, top, in units of the plot."""
        if "frame_shape" in self.pair.attrs:
            height, width = frame_shape(self.pair)
            left, right, top, bottom = -0.5, width - 0.5, -0.5, height - 0.5
        else:
            columns, rows = cell_edges(self.pair["x"].values), cell_edges(self.pair["y"].values)
            left, right, top, bottom = columns[0], columns[-1], rows[0], rows[-1]
        return (
            left * self.scale,
            right * self.scale,
            bottom * self.scale * self.down,
            top * self.scale * self.down,
        )

    @property
    def missing(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Masked and failed points, shape (y, x)."""
        return masked_and_failed(self.pair)

    @property
    def unresolved(self) -> NDArray[np.bool_]:
        """Points that are given, and whose motion is finer than their window resolves; shape (y, x)."""
        if "flag" not in self.pair:
            return np.zeros((self.pair.sizes["y"], self.pair.sizes["x"]), np.bool_)
        masked, failed = self.missing
        return np.asarray(flagged(self.pair, "unresolved").values & ~masked & ~failed)

    @property
    def reasons(self) -> tuple[str, ...]:
        """The flags of failed points, most frequent first."""
        if "flag" not in self.pair:
            return ()
        failed = self.missing[1]
        counts = {
            name: int((flagged(self.pair, name).values & failed).sum())
            for name, bit in FLAGS.items()
            if bit & FAILING and name != "masked"
        }
        return tuple(sorted((name for name in counts if counts[name]), key=lambda name: -counts[name]))

    def quantity(self, name: str) -> Quantity:
        """Return a number per point by its name; InputError if there is no such number."""
        if name in SIX and self.calibration:
            data, name = to_physical(self.pair, self.calibration), PHYSICAL_NAMES[name]
            error = data[f"{name}_standard_error"] if "covariance" in self.pair else None
            return _quantity(data[name], error, signed=True)
        if name in SIX:
            error = derived_error(self.pair, name) if "covariance" in self.pair else None
            quantity = _quantity(self.pair[name], error, signed=True)
            return quantity if name in ("u", "v") else quantity._replace(unit="px/px")
        if name in ("residual", "noise", "resolution") and name in self.pair:
            return _quantity(self.pair[name], None, signed=False)
        if name in DERIVED and not DERIVED[name].dims:
            error = derived_error(self.pair, name) if "covariance" in self.pair else None
            return _quantity(derive(self.pair, name), error, signed=DERIVED[name].signed)
        choices = [
            *SIX,
            "residual",
            "noise",
            "resolution",
            *(key for key, recipe in DERIVED.items() if not recipe.dims),
        ]
        raise InputError(f"name={name!r}: there is no such number to draw; there are {', '.join(choices)}")

    def dress(self, ax: Axes, title: str) -> None:
        """Give axes the limits of the frame, equal aspect, title and labels."""
        left, right, bottom, top = self.frame_extent
        ax.set_xlim(left, right)
        ax.set_ylim(bottom, top)
        ax.set_aspect("equal")
        tidy(ax, title=title, x_label=f"x ({self.unit})", y_label=f"y ({self.unit})")


def cell_edges(nodes: Array) -> Array:
    """Edges of the cells around increasing coordinates: half way between them, as far beyond the ends."""
    nodes = np.asarray(nodes, float)
    if len(nodes) == 1:
        return np.array([nodes[0] - 0.5, nodes[0] + 0.5])
    middle = (nodes[:-1] + nodes[1:]) / 2
    return np.concatenate([[2 * nodes[0] - middle[0]], middle, [2 * nodes[-1] - middle[-1]]])


def _quantity(values: xr.DataArray, error: xr.DataArray | None, *, signed: bool) -> Quantity:
    unit = str(values.attrs.get("units", "1"))
    return Quantity(
        values.values,
        None if error is None else error.values,
        str(values.name).replace("_", " "),
        "" if unit == "1" else unit,
        signed,
    )
