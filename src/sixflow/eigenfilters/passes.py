"""Eigenfilter passes: the passes of the main method, with an operator array in place of the pixels.

Least squares compares the frames pixel by pixel. Here a bank of the paper's operators stands at every position of a
lattice, and the frames are compared by its responses alone: each position finds normal equations for the six numbers
(`array`), and those under the window are pooled (`pool`). Search, blend, warp, total form and judgement are
those of `sixflow.refine.passes`; so are the settings, and the meaning of the window.

The covariance of a point is that of the pooled responses, whose noise is correlated where operators overlap,

    C = Ñ⁻¹ [Σ_q Σ_δ w_q w_{q+δ} s_q s_{q+δ} D̃_q K_δ D̃_{q+δ}ᵀ] Ñ⁻¹,    K_δ = S(o) S(o − δ)ᵀ,

with s the noise that the bank itself sees in the residual, and Ñ less what noise adds to N.
"""

from __future__ import annotations

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
from sixflow.maps.restriction import inverse, maps_of, unknowns
from sixflow.prepare.frame import Frame, both_valid
from sixflow.refine.passes import Passes
from sixflow.refine.quality import Seen, above_floor, feedback_scale
from sixflow.refine.workspace import Workspace
from sixflow.settings import Settings

_NEIGHBOURS = ((1, 0), (0, 1), (1, 1), (1, -1), (2, 0), (0, 2), (2, 1), (1, 2), (2, -1), (1, -2))
"""One of each pair ±δ of positions whose noise is counted as shared; further ones share too little to matter."""


class EigenfilterPasses(Passes):
    """Passes over one level of one frame pair by the responses of operators.

    Parameters
    ----------
    reference, moved : Frame
    grid : Grid
    settings : Settings
    workspace : Workspace

    Raises
    ------
    InputError
        If the window is smaller than 10 px, in which no array of operators fits.
    """

    minimum_texture = 0.25  # the bank leaves out the noise that no operator shares with the pattern

    def __init__(
        self, reference: Frame, moved: Frame, grid: Grid, settings: Settings, workspace: Workspace
    ) -> None:
        if settings.window < SMALLEST_ARRAY:
            raise InputError(
                f"window={settings.window!r}: method='eigenfilter' needs a window of at least {SMALLEST_ARRAY} px; "
                "widen it, or take method='least_squares'"
            )
        super().__init__(reference, moved, grid, settings, workspace)
        # operators do not see brightness, but its step beside pixels without a partner is a gradient
        self.coefficients = self.coefficients - self.dtype.type(_brightness_change(reference, moved))
        self.array = OperatorArray.of(settings.window, np.dtype(self.dtype))
        lattice = Grid.over(reference.image.shape, self.array.spacing)
        self.pool = Pool(lattice, grid, self.array.width, settings.sigma)
        self._equations: LocalEquations | None = None
        self._normal, self._vector = np.empty((*grid.shape, 6, 6)), np.empty((*grid.shape, 6))

    def _solution(self) -> NDArray[np.float64]:
        counted = self.counted()
        residual = np.where(counted, self.workspace.array("residual", counted.shape, self.dtype), 0)
        mean = np.where(counted, self.still() + residual / 2, 0)
        images = Images(*self._images(), residual, mean, counted)
        equations = local_equations(self.array.projection, self.pool.lattice, images)
        self._equations = equations
        self._normal = self.pool.matrices(equations.normal) / self.array.frame_constant
        self._vector = self.pool.vectors(equations.right) / self.array.frame_constant
        theta = (inverse(self._normal) @ self._vector[..., None])[..., 0]
        return maps_of(theta, self.settings.sigma)

    def _normal_equations(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        return self._normal, self._vector

    def _look(self) -> Seen:
        """As the bank sees it: what a change of light adds is not in the noise, nor is noise out of its band."""
        assert self._equations is not None
        array, pool, equations = self.array, self.pool, self._equations
        weight = self._statistics(self.still(), "statistics")[0]
        power, freedom, contrast = (
            pool.scalars(values) for values in (equations.power, equations.freedom, equations.contrast)
        )
        update = unknowns(self._update, self.settings.sigma)
        explained = np.einsum("...i,...ij,...j->...", update, self._normal, update) * array.frame_constant
        with np.errstate(invalid="ignore", divide="ignore"):
            left = np.clip(1 - explained / power, 0.01, 1)
            noise, floor = np.sqrt(left * power / freedom / 2), self._floor_of_windows()
            added = above_floor(noise, floor * self.rounded)[
                0
            ]  # what a codec left out is not in the gradients
            residual = np.sqrt(left * power / contrast)
            # the mean of two frames has a quarter of the power of their difference
            share = freedom / array.freedom
            gamma = share * added**2 / 2 * array.gradient_noise[[0, 3], [0, 3]].mean() / array.frame_constant
            a, b, c = (
                self._normal[..., 0, 0] - gamma,
                self._normal[..., 0, 3],
                self._normal[..., 3, 3] - gamma,
            )
            weakest = (a + c) / 2 - np.sqrt((a - c) ** 2 / 4 + b**2)
            rho = 2 * gamma / (a + c)
            texture = np.where(weakest > 1e-4 * (a + c), weakest / gamma, 0.0)
        noise, lacking = above_floor(noise, floor)
        return Seen(weight, noise, residual, left, gamma, texture, rho, None, lacking)

    def _covariance(self, seen: Seen, transform: NDArray[np.float64]) -> NDArray[Any]:
        assert self._equations is not None
        array, pool, equations = self.array, self.pool, self._equations
        power, floor = equations.power, 2 * self._floor_of_positions() ** 2
        meat = self._correlated(equations.design, np.sqrt(power / equations.freedom))
        meat *= seen.left[..., None, None]
        if seen.lacking is not None:
            least = np.broadcast_to(np.sqrt(floor), power.shape)
            meat += seen.lacking[..., None, None] * self._correlated(equations.design, least)
            power = np.maximum(power, floor * self.rounded**2 * equations.freedom)
        meat /= array.frame_constant**2
        on_gradient = array.gradient_noise * (power / array.freedom / 4)[..., None, None]
        clean = self._normal - pool.matrices(on_gradient) / array.frame_constant
        if self.settings.group != "affine":
            return self._within(clean, meat, seen, transform)
        bread = feedback_scale(seen.rho)[..., None] * (transform @ inverse(clean))
        return (bread @ meat @ np.swapaxes(bread, -1, -2)).astype(self.dtype)

    def _floor_of_positions(self) -> float | NDArray[Any]:
        """The frames' least noise at each position of the lattice."""
        if isinstance(self.floor, float):
            return self.floor
        lattice = self.pool.lattice
        return np.asarray(self.floor[np.ix_(lattice.y, lattice.x)])

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
