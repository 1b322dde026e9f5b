"""Least squares: one pass over the whole field at once, every pixel compared by itself.

A pass blends the grid's local affine maps to a dense displacement U, brings the moved frame to the reference, and
solves at every grid point

    minimise Σ_x w(x − p) [r(x) − g·U(x) + g·(d + G(x − p))]²

for the **total** map (d, G), or in increment form, with r alone, for what U leaves. Six numbers per point are redundant
for a dense field; were each pass to add an increment, errors in the redundant directions would never be corrected. In
the total form the fixed point is the window's own least-squares affine fit, whatever U was, and noise does not grow
with passes.
"""

from __future__ import annotations

import dataclasses
import math
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.likely import likely_strip
from sixflow.engine.rows import DERIVATIVE
from sixflow.engine.solve import explained_strip, normal_matrices, solve_strip, texture_strip
from sixflow.engine.spline import gradient_noise
from sixflow.engine.sweep import Images
from sixflow.engine.threads import over_strips
from sixflow.engine.weigh import LEAST_GAIN, find_weights, largest_gain
from sixflow.maps.grid import Grid
from sixflow.maps.restriction import allowed, confined, maps_of, unknowns, with_shared_gradients
from sixflow.plan import Plan
from sixflow.prepare.frame import Frame
from sixflow.refine.covariance import above_floor, covariance_of_pass, shrunk_noise, solution_of_pass
from sixflow.refine.cut import uniform_windows
from sixflow.refine.light import light_of_windows
from sixflow.refine.likeness import coarseness, likeness, textured_area
from sixflow.refine.moments import Moments, node_spacing
from sixflow.refine.problem import FREEZE, Pass, PixelWeights, State
from sixflow.refine.solution import Solution, WindowStatistics
from sixflow.refine.sweep import Sweep, mean_plane
from sixflow.refine.uniform import UniformWindow
from sixflow.refine.windows import WindowSums, window_means, window_sums

GRID_STRIP = 16
Array = NDArray[Any]


@dataclasses.dataclass(frozen=True, kw_only=True)
class LeastSquaresPass(Pass):
    """A pass, and the sums that it was solved from.

    Attributes
    ----------
    sums : WindowSums
    moments : Moments
    images : Images or None
        What was compared, where pixels are weighed or a low-pass is in front.
    total, plane
        As in `Swept`.
    """

    sums: WindowSums
    moments: Moments
    images: Images | None
    total: bool
    plane: Array

    @property
    def alike(self) -> tuple[Array, Array]:
        """Correlation of the windows, and cells of an even texture (`Pass.alike`)."""
        correlation, density = likeness(self.sums)
        return correlation, 4 * math.pi * self.sigma**2 * self.statistics.weight * density


@dataclasses.dataclass(frozen=True)
class Swept:
    """What a sweep leaves, for windows of any size.

    Attributes
    ----------
    maps : array, shape (6, rows, columns)
        The motion that the frames were compared with.
    total : bool
        Total form, or increments.
    plane : array, shape (6,)
        Map about pixel (0, 0) that the right-hand side of the total form is less.
    state : State
        The light and the pixel weights that were used.
    moments : Moments
    images : Images or None
        As in `LeastSquaresPass`.
    """

    maps: Array
    total: bool
    plane: Array
    state: State
    moments: Moments
    images: Images | None


class LeastSquares:
    """Least-squares passes over one level of one pair of frames.

    Parameters
    ----------
    still, moved : Frame
        Both at the level's resolution.
    grid : Grid
    plan : Plan
    sweep : Sweep, optional
        Of the same frames, for a window that is no larger; several windows may share one.
    """

    def __init__(
        self, still: Frame, moved: Frame, grid: Grid, plan: Plan, sweep: Sweep | None = None
    ) -> None:
        self.still, self.moved, self.grid, self.plan = still, moved, grid, plan
        self.sigma = plan.window.sigma
        self.sweep = sweep or Sweep(
            still,
            moved,
            grid,
            self.sigma,
            degree=plan.degree,
            lowpass=plan.lowpass,
            central=self.central,
        )
        self.floor = floor_of_windows(still, moved, grid, self.sigma)
        self.rounded = max(still.rounded, moved.rounded)

    @property
    def central(self) -> bool:
        """Whether both frames are brought to the middle."""
        return self.plan.reference == "middle"

    def step(self, maps: Array, state: State, *, total: bool = True, last: bool = False) -> LeastSquaresPass:
        """Make a pass (`Problem.step`)."""
        return self.solved(self.swept(maps, state, total=total, last=last))

    def swept(
        self, maps: Array, state: State, *, total: bool, last: bool = False, power: bool = False
    ) -> Swept:
        """Sweep the frames with a motion, as for `step`; `power`: keep what a likely covariance needs."""
        if self.plan.lighting == "gain+offset" and state.light is None:
            sums = self._sums(self.sweep.moments(maps, total=total))
            state = dataclasses.replace(state, light=light_of_windows(sums))
        images, weights = None, state.weights
        resting = weights is None or weights.resting
        if resting and not (last and self.plan.lowpass):
            moments = self.sweep.moments(maps, total=total, light=state.light, sandwich=last, power=power)
        else:
            images = self.sweep.images(maps, total=total, light=state.light)
            if weights is not None and not resting:
                weights = self._weighed(images, weights)
            moments = self.sweep.moments_of(
                images, None if weights is None else weights.weight, sandwich=last, power=power
            )
        return Swept(maps, total, mean_plane(maps, self.grid), State(state.light, weights), moments, images)

    def solved(self, swept: Swept) -> LeastSquaresPass:
        """Solve for the maps of this window, from what a sweep summed."""
        sums = self._sums(swept.moments)
        solution, update = self._solution(sums, swept)
        light = light_of_windows(sums) if self.plan.lighting == "gain+offset" else None
        return LeastSquaresPass(
            start=swept.maps, maps=solution, update=update, statistics=self._statistics(sums, update),
            state=State(light, swept.state.weights), sums=sums, moments=swept.moments, images=swept.images,
            total=swept.total, plane=swept.plane, sigma=self.sigma,
        )  # fmt: skip

    def _sums(self, moments: Moments) -> WindowSums:
        """Window sums of moments about nodes that may be closer than this window needs."""
        return window_sums(self._merged(moments), self.grid, self.sigma)

    def _merged(self, moments: Moments) -> Moments:
        """The same moments about no more nodes than this window needs."""
        while 2 * moments.lattice.spacing <= node_spacing(self.sigma):
            moments = moments.coarser()
        return moments

    def uniform(self, maps: Array, state: State) -> UniformWindow:
        """Return this window where the texture is uniform (`Problem.uniform`)."""
        weight = None if state.weights is None else state.weights.weight
        return uniform_windows(self.sweep, (self.sigma,), maps, state.light, weight)[0]

    def solution(
        self, found: Pass, maps: Array, left: Array, *, borne: NDArray[np.int_] | None = None
    ) -> Solution:
        """Return the field that a last pass found (`Problem.solution`)."""
        assert isinstance(found, LeastSquaresPass)
        covariance, statistics = covariance_of_pass(self, found, sharpened=borne is not None)
        statistics = self._with_likeness(found, statistics)
        solution = solution_of_pass(self.plan, covariance, statistics, maps, left, borne)
        light = None if found.state.light is None else np.moveaxis(found.state.light, 0, -1)
        return solution.replace(light=light, pixels=found.state.weights)

    def likely_covariance(self, found: LeastSquaresPass) -> Array:
        """Covariance of the plain window's six numbers if its texture is the same everywhere in it (`likely_strip`)."""
        statistics, sums = found.statistics, found.sums
        assert sums.sandwich is not None
        out = np.empty((*self.grid.shape, 6, 6), self.plan.dtype)
        with np.errstate(invalid="ignore", divide="ignore"):
            power = sums.sandwich.sum(axis=-1) / (sums.normal[..., 0] + sums.normal[..., 12])
            power = power * np.nan_to_num(statistics.left, nan=1.0) * shrunk_noise(found.maps)
        if statistics.lacking is not None:
            power = power + 2 * np.asarray(self.floor) ** 2 * statistics.lacking
        over_strips(
            lambda a, b: likely_strip(sums.normal, statistics.noise_gradient, power, self.sigma, a, b, out),
            self.grid.rows,
            GRID_STRIP,
        )
        return out

    def _with_likeness(self, found: LeastSquaresPass, statistics: WindowStatistics) -> WindowStatistics:
        """The statistics with correlation and cells, the latter as the texture fills the window and is coarse."""
        correlation, density = likeness(found.sums)
        area = textured_area(self._merged(found.moments), found.sums, self.grid, self.sigma)
        if not self.central:  # gradients are along the axes of the moved frame
            u_x, u_y, v_x, v_y = found.start[2:]
            density = density * np.abs((1 + u_x) * (1 + v_y) - u_y * v_x)
        with np.errstate(invalid="ignore"):
            cells = area * density / self._coarseness
        return dataclasses.replace(statistics, correlation=correlation, cells=cells)

    @cached_property
    def _coarseness(self) -> float:
        return coarseness(self.still, self.moved, self.sigma)

    def _solution(self, sums: WindowSums, swept: Swept) -> tuple[Array, Array]:
        """The solution of the normal equations, and the change of the motion that it makes."""
        maps = swept.maps
        known = self.grid.plane(swept.plane) if swept.total else maps
        if self.plan.group != "affine":
            normal, right = normal_equations(sums)
            base, basis = allowed(self.plan.group, maps, self.sigma)
            done = unknowns(known, self.sigma)
            solution = maps_of(confined(normal, right, base - done, basis) + done, self.sigma)
            return solution, with_shared_gradients(solution, self.grid.step) - maps
        increment = np.empty((6, *self.grid.shape))
        over_strips(
            lambda a, b: solve_strip(sums.normal, self.sigma, a, b, increment), self.grid.rows, GRID_STRIP
        )
        solution = increment + known
        return solution, solution - maps

    def _weighed(self, images: Images, weights: PixelWeights) -> PixelWeights:
        """Find the weights of pixels again, unless they stay; none, if they gain nothing the first time."""
        if not weights.changing:
            return dataclasses.replace(weights, times=weights.times + 1)
        shape, dtype = images.residual.shape, images.residual.dtype
        raw = np.empty(shape, dtype)
        weight = np.ones(shape, dtype) if weights.weight is None else weights.weight.copy()
        parts = images.residual, images.gradient_x, images.gradient_y, images.still
        # a share of the information that moves a point by less than the tolerance, were it wrong by a pixel
        stays = self.plan.tolerance
        changed = find_weights(*parts, raw, weight, stays)
        if weights.weight is None and largest_gain(*parts[:3], weight) < LEAST_GAIN:
            return PixelWeights(None, None, FREEZE, weights.partner)
        times = FREEZE if changed <= stays else weights.times + 1
        return PixelWeights(raw, weight, times, weights.partner)

    def _statistics(self, sums: WindowSums, update: Array) -> WindowStatistics:
        weight, absolute, square, mean, power = np.moveaxis(sums.statistics[..., :5], -1, 0).astype(
            np.float64
        )
        explained = np.empty(self.grid.shape)
        over_strips(
            lambda a, b: explained_strip(sums.normal, update, self.sigma, a, b, explained),
            self.grid.rows,
            GRID_STRIP,
        )
        with np.errstate(invalid="ignore", divide="ignore"):
            left = np.clip(1 - explained / square, 0.01, 1)
            noise = np.sqrt(left) * absolute / weight * np.sqrt(np.pi) / 2  # E|r| = √(2/π)·√2·noise
            contrast = np.sqrt(np.maximum(power / weight - (mean / weight) ** 2, 0))
            residual = np.sqrt(left * square / weight) / contrast
            tail = 2 / np.pi * left * square * weight / absolute**2
        added = above_floor(noise, self.floor * self.rounded)[
            0
        ]  # what a codec left out is not in the gradients
        noise_gradient = self._gradient_noise(added, weight)
        texture, rho = np.empty(self.grid.shape), np.empty(self.grid.shape)
        over_strips(
            lambda a, b: texture_strip(sums.normal, noise_gradient, a, b, texture, rho),
            self.grid.rows,
            GRID_STRIP,
        )
        noise, lacking = above_floor(noise, self.floor)
        return WindowStatistics(weight, noise, residual, left, noise_gradient, texture, rho, tail, lacking)

    def _gradient_noise(self, noise: Array, weight: Array) -> Array:
        """γ: what noise adds to Σ w g_x²."""
        interpolated = 2 if self.central else 1
        share = gradient_noise(self.plan.degree, DERIVATIVE, interpolated, self.plan.lowpass)
        return np.asarray(share * noise**2 * weight)


def normal_equations(sums: WindowSums) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Normal matrix and right-hand side of θ; (rows, columns, 6, 6) and (rows, columns, 6)."""
    return normal_matrices(sums.normal), sums.normal[..., 18:].astype(np.float64)


def mean_floor(still: Frame, moved: Frame) -> float | Array:
    """Root mean square of both frames' floors; that of the reference's pixels where it differs from pixel to pixel."""
    if isinstance(still.floor, float) and isinstance(moved.floor, float):
        return math.hypot(still.floor, moved.floor) / math.sqrt(2)
    return np.broadcast_to(still.floor, still.image.shape)


def floor_of_windows(still: Frame, moved: Frame, grid: Grid, sigma: float) -> float | NDArray[np.float64]:
    """Root mean square of the floor under each window."""
    floor, valid = mean_floor(still, moved), still.counted()
    if isinstance(floor, float):
        return floor
    counted = valid.astype(still.image.dtype) if valid.size else np.ones_like(still.image)
    with np.errstate(invalid="ignore", divide="ignore"):
        square, share = window_means((floor**2 * counted, counted), grid, sigma)
        return np.asarray(np.sqrt(square / share))
