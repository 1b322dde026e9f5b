"""Eigenfilter problem: passes like those of least squares, with an operator array in place of the pixels.

Least squares compares the frames pixel by pixel. Here a bank of the paper's operators stands at every position of a
lattice, and the frames are compared by its responses alone: each position finds normal equations for the six numbers
(`array`), and those under the window are pooled (`pool`). Search, blend, warp, total form and judgement are
those of `sixflow.refine.least_squares`; so are the settings, and the meaning of the window.

The covariance of a point is that of the pooled responses, whose noise is correlated where operators overlap,

    C = Ñ⁻¹ [Σ_q Σ_δ w_q w_{q+δ} s_q s_{q+δ} D̃_q K_δ D̃_{q+δ}ᵀ] Ñ⁻¹,    K_δ = S(o) S(o − δ)ᵀ,

with s the noise that the bank itself sees in the residual, and Ñ less what noise adds to N.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.eigenfilters.array import Images, LocalEquations, local_equations, products
from sixflow.eigenfilters.default import SMALLEST_ARRAY, array_bank, array_spacing
from sixflow.eigenfilters.geometry import Real
from sixflow.eigenfilters.pool import Pool, shifted
from sixflow.eigenfilters.projection import Projection
from sixflow.engine.rows import DERIVATIVE
from sixflow.engine.window import window_sigma
from sixflow.errors import InputError
from sixflow.maps.grid import Grid
from sixflow.maps.restriction import allowed, confined, inverse, maps_of, unknowns, with_shared_gradients
from sixflow.plan import Plan
from sixflow.prepare.frame import Frame, both_valid
from sixflow.refine.covariance import (
    above_floor,
    covariance_in_group,
    feedback_scale,
    six_from_unknowns,
    solution_of_pass,
)
from sixflow.refine.cut import uniform_windows
from sixflow.refine.least_squares import floor_of_windows, mean_floor
from sixflow.refine.light import light_of_images
from sixflow.refine.problem import Pass, State
from sixflow.refine.solution import Solution, WindowStatistics
from sixflow.refine.sweep import Sweep, mean_plane
from sixflow.refine.uniform import UniformWindow
from sixflow.refine.windows import image_sums

_NEIGHBOURS = ((1, 0), (0, 1), (1, 1), (1, -1), (2, 0), (0, 2), (2, 1), (1, 2), (2, -1), (1, -2))
"""One of each pair ±δ of positions whose noise is counted as shared; further ones share too little to matter."""
_SHARED_NOISE = 0.25
"""Share of the noise that operators share with the pattern: the bank leaves out the rest, and texture that is so much
above it is enough.
"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class EigenfilterPass(Pass):
    """A pass, and the equations that it was solved from.

    Attributes
    ----------
    equations : LocalEquations
        Of every position of the array.
    normal : array, shape (rows, columns, 6, 6)
        Pooled.
    """

    equations: LocalEquations
    normal: NDArray[np.float64]


class EigenfilterProblem:
    """Passes over one level of one pair of frames by the responses of operators.

    Parameters
    ----------
    still, moved : Frame
    grid : Grid
    plan : Plan

    Raises
    ------
    InputError
        If the window is smaller than 10 px, in which no array of operators fits.
    """

    def __init__(self, still: Frame, moved: Frame, grid: Grid, plan: Plan) -> None:
        size = plan.window.size
        if size < SMALLEST_ARRAY:
            raise InputError(
                f"window={size!r}: method='eigenfilter' needs a window of at least {SMALLEST_ARRAY} px; "
                "widen it, or take method='least_squares'"
            )
        self.still, self.grid, self.plan, self.sigma = still, grid, plan, plan.window.sigma
        # operators do not see brightness, but its step beside pixels without a partner is a gradient
        even = moved.less(_brightness_change(still, moved), plan.degree)
        self.sweep = Sweep(
            still, even, grid, self.sigma, degree=plan.degree, lowpass=plan.lowpass,
            central=plan.reference == "middle",
        )  # fmt: skip
        self.floor, self.rounded = (
            floor_of_windows(still, moved, grid, self.sigma),
            max(still.rounded, moved.rounded),
        )
        self.array = OperatorArray.of(size, still.image.dtype)
        height, width = still.image.shape
        lattice = Grid.over((height, width), self.array.spacing)
        self.pool = Pool(lattice, grid, self.array.width, self.sigma)
        floor = mean_floor(still, moved)
        self._floor_of_positions = floor if isinstance(floor, float) else floor[np.ix_(lattice.y, lattice.x)]

    def step(self, maps: Real, state: State, *, total: bool = True, last: bool = False) -> EigenfilterPass:
        """Make a pass (`Problem.step`)."""
        by_window = self.plan.lighting == "gain+offset"
        if by_window and state.light is None:
            seen = self.sweep.images(maps, total=total)
            state = State(light_of_images(seen, self.grid, self.sigma))
        seen = self.sweep.images(maps, total=total, light=state.light)
        counted = np.isfinite(seen.residual)
        residual = np.where(counted, seen.residual, 0)
        mean = np.where(counted, seen.still + residual / 2, 0)
        images = Images(seen.gradient_x, seen.gradient_y, seen.right, residual, mean, counted)
        equations = local_equations(self.array.projection, self.pool.lattice, images)
        normal = self.pool.matrices(equations.normal) / self.array.frame_constant
        right = self.pool.vectors(equations.right) / self.array.frame_constant
        solution, update = self._solved(normal, right, maps, total)
        weight = image_sums((counted.astype(seen.still.dtype),), self.grid, self.sigma)[1]
        light = light_of_images(seen, self.grid, self.sigma) if by_window else None
        return EigenfilterPass(
            start=maps, maps=solution, update=update,
            statistics=self._statistics(equations, normal, update, weight), state=State(light),
            equations=equations, normal=normal, sigma=self.sigma,
        )  # fmt: skip

    def uniform(self, maps: Real, state: State) -> UniformWindow:
        """Return this window where the texture is uniform (`Problem.uniform`)."""
        return uniform_windows(self.sweep, (self.sigma,), maps, state.light)[0]

    def solution(
        self, found: Pass, maps: Real, left: Real, *, borne: NDArray[np.int_] | None = None
    ) -> Solution:
        """Return the field that a last pass found (`Problem.solution`)."""
        assert isinstance(found, EigenfilterPass)
        covariance = self._covariance(found, self.plan.window.sharpen if borne is not None else 0)
        made = solution_of_pass(self.plan, covariance, found.statistics, maps, left, borne)
        light = found.state.light
        return made if light is None else made.replace(light=np.moveaxis(light, 0, -1))

    def _solved(self, normal: Real, right: Real, maps: Real, total: bool) -> tuple[Real, Real]:
        """The solution of the pooled equations, and the change of the motion that it makes."""
        known = self.grid.plane(mean_plane(maps, self.grid)) if total else maps
        if self.plan.group == "affine":
            solution = maps_of((inverse(normal) @ right[..., None])[..., 0], self.sigma) + known
            return solution, solution - maps
        base, basis = allowed(self.plan.group, maps, self.sigma)
        done = unknowns(known, self.sigma)
        solution = maps_of(confined(normal, right, base - done, basis) + done, self.sigma)
        return solution, with_shared_gradients(solution, self.grid.step) - maps

    def _statistics(
        self, equations: LocalEquations, normal: Real, update: Real, weight: Real
    ) -> WindowStatistics:
        """As the bank sees it: what a change of light adds is not in the noise, nor is noise out of its band."""
        array, pool = self.array, self.pool
        power, freedom, contrast = (
            pool.scalars(values) for values in (equations.power, equations.freedom, equations.contrast)
        )
        change = unknowns(update, self.sigma)
        explained = np.einsum("...i,...ij,...j->...", change, normal, change) * array.frame_constant
        with np.errstate(invalid="ignore", divide="ignore"):
            left = np.clip(1 - explained / power, 0.01, 1)
            noise = np.sqrt(left * power / freedom / 2)
            added = above_floor(noise, self.floor * self.rounded)[
                0
            ]  # what a codec left out is not in gradients
            residual = np.sqrt(left * power / contrast)
            # the mean of two frames has a quarter of the power of their difference
            share = freedom / array.freedom
            gamma = share * added**2 / 2 * array.gradient_noise[[0, 3], [0, 3]].mean() / array.frame_constant
            a, b, c = normal[..., 0, 0] - gamma, normal[..., 0, 3], normal[..., 3, 3] - gamma
            weakest = (a + c) / 2 - np.sqrt((a - c) ** 2 / 4 + b**2)
            rho = 2 * gamma / (a + c)
            texture = np.where(weakest > 1e-4 * (a + c), weakest / gamma / _SHARED_NOISE, 0.0)
            steepness = np.sqrt(
                np.maximum(normal[..., 0, 0] * normal[..., 3, 3] - normal[..., 0, 3] ** 2, 0.0)
            )
            cells = 4 * self.sigma**2 * weight * steepness * array.frame_constant / contrast
            correlation = 1 - residual**2 / 2
        noise, lacking = above_floor(noise, self.floor)
        return WindowStatistics(
            weight, noise, residual, left, gamma, texture, rho, None, lacking,
            correlation=correlation, cells=cells,
        )  # fmt: skip

    def _covariance(self, found: EigenfilterPass, sharpen: int) -> Real:
        array, pool, equations, statistics = self.array, self.pool, found.equations, found.statistics
        transform = six_from_unknowns(self.sigma, sharpen)
        power, floor = equations.power, 2 * self._floor_of_positions**2
        meat = self._correlated(equations.design, np.sqrt(power / equations.freedom))
        meat *= statistics.left[..., None, None]
        if statistics.lacking is not None:
            least = np.broadcast_to(np.sqrt(floor), power.shape)
            meat += statistics.lacking[..., None, None] * self._correlated(equations.design, least)
            power = np.maximum(power, floor * self.rounded**2 * equations.freedom)
        meat /= array.frame_constant**2
        on_gradient = array.gradient_noise * (power / array.freedom / 4)[..., None, None]
        clean = found.normal - pool.matrices(on_gradient) / array.frame_constant
        dtype = self.still.image.dtype
        if self.plan.group != "affine":
            return covariance_in_group(
                self.plan, found.maps, (clean, meat), statistics.rho, transform
            ).astype(dtype)
        bread = feedback_scale(statistics.rho)[..., None] * (transform @ inverse(clean))
        return np.asarray((bread @ meat @ np.swapaxes(bread, -1, -2)).astype(dtype))

    def _correlated(self, design: NDArray[Any], noise: NDArray[np.float64]) -> Real:
        """Σ_q Σ_δ w_q w_{q+δ} s_q s_{q+δ} M(d)ᵀ D̃_q K_δ D̃_{q+δ}ᵀ M(d + δ)."""
        lattice, m = self.pool.lattice, design.shape[-1]
        D = design * noise.reshape(-1, 1, 1).astype(design.dtype)
        total = self.pool.pairs(products(D, D, lattice), (0, 0))
        for delta in _NEIGHBOURS:
            seen = (D.reshape(-1, m) @ self.array.overlaps[delta]).reshape(D.shape)
            shift = shifted(*(d * lattice.step / self.pool.length for d in delta))
            one_way = self.pool.pairs(products(seen, D, lattice, delta) @ shift, delta)
            total += one_way + np.swapaxes(one_way, -1, -2)
        return total


def _brightness_change(reference: Frame, moved: Frame) -> float:
    """Mean of the moved frame less that of the reference, over the pixels that both have."""
    valid = both_valid(reference.valid, moved.valid)
    difference = moved.image - reference.image
    kept = difference[valid.astype(bool)] if valid.size else difference
    return float(kept.mean(dtype=np.float64)) if kept.size else 0.0


class OperatorArray:
    """The bank of an array for a window, and the constants of the array.

    Parameters
    ----------
    window : float
        Of the pooled array, px.
    dtype : numpy dtype
        In which patches are multiplied.

    Attributes
    ----------
    projection : Projection
    spacing : int
        Between positions, px: about two standard deviations of the kernels.
    width : float
        Standard deviation of the pooling Gaussian, px: with the extent of the operators themselves, the pooled array
        has the window's σ. That holds for patterns with details of some 3 px; of coarser ones the pooled array answers
        displacements as a Gaussian of up to 3 % more would.
    frame_constant : float
        Σ_q |S f|² over |f|².
    freedom : int
        Number of responses less the three of contrast.
    overlaps : dict of arrays, shape (m, m)
        K_δ by (δ_x, δ_y), in spacings.
    gradient_noise : array, shape (6, 6)
        What unit white noise in an image adds to Dᵀ D of one position.
    """

    def __init__(self, window: float, dtype: Any) -> None:
        bank, sigma = array_bank(window), window_sigma(window)
        self.projection = Projection(bank, sigma, dtype)
        extent = self.projection.extent
        self.spacing = array_spacing(window)
        self.width = math.sqrt(sigma**2 - extent**2)
        self.frame_constant = self.projection.frame_constant(self.spacing)
        self.freedom = len(self.projection) - 3
        self.overlaps = {
            (dx, dy): self.projection.overlap(dx * self.spacing, dy * self.spacing).astype(dtype)
            for dx, dy in _NEIGHBOURS
        }
        self.gradient_noise = self.projection.gradient_noise(DERIVATIVE)

    @staticmethod
    @functools.lru_cache(maxsize=8)
    def of(window: float, dtype: Any) -> OperatorArray:
        """The array of a window, made once."""
        return OperatorArray(window, dtype)
