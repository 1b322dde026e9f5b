"""Problem: what the refinement of a field asks of a method, and what it gets back from a pass.

A method compares two frames for the motion as it is known, and solves for the six numbers of every window at once. Two
methods do so: every pixel by itself (`least_squares`), or the responses of operators (`sixflow.eigenfilters`).

A pass takes maps and a state, and returns a new one. It changes neither, and asking the same twice gives the same.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from sixflow.chance import evidence_limit, normal_limit
from sixflow.maps.grid import Grid
from sixflow.plan import Plan
from sixflow.refine.likeness import evidence_of
from sixflow.refine.solution import Solution, WindowStatistics
from sixflow.refine.uniform import UniformWindow

Array = NDArray[Any]

MINIMUM_WEIGHT = 0.2
"""Share of a window on pixels that have a partner, below which a point is not measured."""
MINIMUM_KEPT = 0.1
"""The same where outlying pixels are down-weighted: fewer pixels could match by chance."""
FREEZE = 10
"""Weighed passes after which the weights stay: pixels in doubt could change sides for ever."""
CONTRACTION = 0.05
"""What a pass leaves of the distance to its fixed point, at least (measured: 0.01 to 0.03)."""
WEIGHED_CONTRACTION = 0.4
"""The same where the weights of pixels change from pass to pass."""


def least_texture(pixels: Array | float) -> Array:
    """Power of the gradients in a window's weakest direction, over that of noise, that is texture.

    Noise alone gives every direction the power γ, which scatters by √(2/n) γ for n pixels, each with a gradient of its
    own. What is above γ has to exceed `normal_limit` times that, and √2 more, since γ is known from as many pixels.

    Examples
    --------
    >>> least_texture(np.array([64.0, 961.0])).round(2)
    array([0.97, 0.25])
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(normal_limit() * 2 / np.sqrt(pixels))


@dataclasses.dataclass(frozen=True)
class PixelWeights:
    """Weights of pixels: 1, less for those whose residual is far beyond noise, 0 for outlying ones.

    Attributes
    ----------
    raw : array, shape (height, width), or None
        Of every pixel by itself; None before the first weighing.
    weight : array of the same shape, or None
        With those of its neighbours taken into account; None: all 1.
    times : int
        How often they were found.
    partner : array, shape (rows, columns)
        Share of each window on pixels that have a partner, outlying ones included.
    """

    raw: Array | None
    weight: Array | None
    times: int
    partner: Array

    @property
    def changing(self) -> bool:
        """Whether the next pass finds them again."""
        return self.times < FREEZE

    @property
    def resting(self) -> bool:
        """Whether they were found to gain nothing: all are 1."""
        return self.weight is None and not self.changing


@dataclasses.dataclass(frozen=True)
class State:
    """What a pass takes over from the one before it.

    Attributes
    ----------
    light : array, shape (2, rows, columns), or None
        Gain and offset of every window's light; None where light is steady or not yet known.
    weights : PixelWeights or None
        None: pixels are not weighed.
    """

    light: Array | None = None
    weights: PixelWeights | None = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class Pass:
    """What a pass found.

    Attributes
    ----------
    start, maps : float64 array, shape (6, rows, columns)
        What the pass began with, and its solution; NaN where the equations were singular.
    update : array of the same shape
        The change of the motion that the frames were compared with.
    statistics : WindowStatistics
        Of the residual that the start left.
    state : State
        For the next pass.
    sigma : float
        Of the window, px.
    """

    start: Array
    maps: Array
    update: Array
    statistics: WindowStatistics
    state: State
    sigma: float

    @property
    def weighed(self) -> bool:
        """Whether outlying pixels were down-weighted."""
        return self.state.weights is not None and not self.state.weights.resting

    @property
    def moved(self) -> Array:
        """Distance between start and solution, px; shape (rows, columns)."""
        return np.hypot(self.maps[0] - self.start[0], self.maps[1] - self.start[1])

    @property
    def measurable(self) -> NDArray[np.bool_]:
        """Where there was enough of a window, and texture above the noise; shape (rows, columns)."""
        least = MINIMUM_KEPT if self.weighed else MINIMUM_WEIGHT
        with np.errstate(invalid="ignore"):
            enough = self.statistics.weight > least
            pixels = 4 * math.pi * self.sigma**2 * self.statistics.weight
            return np.asarray(enough & (self.statistics.texture > least_texture(pixels)))

    @property
    def trusted(self) -> NDArray[np.bool_]:
        """Where the windows match besides, by themselves.

        Windows of one contrast that have nothing in common differ by √2 of it. What differs by more holds something
        else in the moved frame, such as what lies outside the mask, and its map is not to be built upon.
        """
        correlation, cells = self.alike
        statistics = dataclasses.replace(self.statistics, correlation=correlation, cells=cells)
        with np.errstate(invalid="ignore"):
            alike = self.statistics.residual < math.sqrt(2)
        return np.asarray(self.measurable & alike & (evidence_of(statistics) > evidence_limit()))

    @property
    def alike(self) -> tuple[Array, Array]:
        """Correlation of the windows, and independent cells of texture in each (`sixflow.refine.likeness`)."""
        correlation, cells = self.statistics.correlation, self.statistics.cells
        assert correlation is not None
        assert cells is not None
        return correlation, cells

    @property
    def changing(self) -> bool:
        """Whether the weights of pixels may still change."""
        weights = self.state.weights
        return weights is not None and weights.changing

    @property
    def left(self) -> Array:
        """How far each point may still be from its fixed point, px; shape (rows, columns).

        The update times the rate at which passes contract: the noise's share of the normal matrix, or a few percent
        where that is less.
        """
        rho = self.statistics.rho
        with np.errstate(invalid="ignore", divide="ignore"):
            noise_share = np.where(rho >= 0, rho / (1 + rho), 1.0)
        rate = np.clip(noise_share, WEIGHED_CONTRACTION if self.changing else CONTRACTION, 0.9)
        return np.asarray(self.moved * rate / (1 - rate))

    @property
    def explained(self) -> float:
        """Share of the residual's power that the update took out, median over the points."""
        return 1 - float(np.nanmedian(self.statistics.left))


class Problem(Protocol):
    """Two frames, a grid and a plan, compared by one method."""

    grid: Grid
    plan: Plan

    def step(self, maps: Array, state: State, *, total: bool = True, last: bool = False) -> Pass:
        """Make a pass.

        Parameters
        ----------
        maps : float64 array, shape (6, rows, columns)
            u, v, u_x, u_y, v_x, v_y at the grid points, without NaN.
        state : State
        total : bool
            Total form, or increment form (a sharpening pass).
        last : bool
            Keep what the covariance needs.
        """
        ...

    def uniform(self, maps: Array, state: State) -> UniformWindow:
        """Return this window where the texture is uniform, cut as the frames cut it."""
        ...

    def solution(
        self, found: Pass, maps: Array, left: Array, *, borne: NDArray[np.int_] | None = None
    ) -> Solution:
        """Return the field that a last pass found, with its covariance, not yet judged.

        Parameters
        ----------
        found : Pass
            Made with `last=True`.
        maps, left : array, shape (6, rows, columns) and (rows, columns)
            The field, and how far its points may be from their fixed points.
        borne : int array, shape (rows, columns), optional
            How far each point was sharpened; None where none was.
        """
        ...
