"""Covariance: from the noise of a window to the standard errors of its six numbers.

With H̃ the normal matrix less what noise adds to it, and Σ w² r² J Jᵀ over the pixels, C = H̃⁻¹ (Σ w² r² J Jᵀ) H̃⁻¹
(`sixflow.engine.solve`). Around that stand factors for what the residual does not show: what the last update took out
of it, the noise below the frames' floor, a moved frame that is smaller, a low-pass, the feedback of noise, and pixels
that are neither in nor out.
"""

from __future__ import annotations

import dataclasses
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.lowpass import lowpass_noise
from sixflow.engine.solve import FEEDBACK_STEP, covariance_strip, noise_feedback, normal_matrices
from sixflow.engine.threads import over_strips
from sixflow.engine.weigh import weighing_noise, weight_slope
from sixflow.engine.window import attenuation_period, sharpening_noise
from sixflow.maps.restriction import ABSENT, allowed, projection
from sixflow.plan import Plan
from sixflow.refine.solution import Solution, WindowStatistics
from sixflow.refine.windows import image_sums, squared_window_sums, window_means

if TYPE_CHECKING:
    from sixflow.refine.least_squares import LeastSquares, LeastSquaresPass

GRID_STRIP = 16
MOST_ABSORBED = 0.25
"""Share of the residual's power: beyond, there is no telling how much the fit took out."""

Array = NDArray[Any]


def above_floor(noise: NDArray[Any], floor: float | NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any] | None]:
    """Noise that is not below its floor, and what it lacks of that, [1 − noise²/floor²]₊; None if nowhere anything.

    Parameters
    ----------
    noise : array, shape (rows, columns)
        Standard deviation seen in the residual of each window.
    floor : float or array of the same shape
        Least standard deviation; 0 where there is none.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        below = noise < floor
        if not below.any():
            return noise, None
        return np.where(below, floor, noise), np.where(below, 1 - (noise / floor) ** 2, 0.0)


def feedback_scale(rho: NDArray[Any]) -> NDArray[np.float64]:
    """Factors of the six numbers' standard errors by the noise's feedback (`solve.noise_feedback`); (…, 6)."""
    entry = np.clip(np.nan_to_num(rho) / FEEDBACK_STEP, 0, noise_feedback().shape[1] - 1)
    displacement, gradient = noise_feedback()[:, entry.astype(int)]
    return np.stack([displacement] * 2 + [gradient] * 4, axis=-1)


def shrunk_noise(maps: NDArray[Any]) -> NDArray[np.float64]:
    """Factor on the power of the residual's noise where the moved frame is smaller; shape (rows, columns).

    On the pixels of the reference, the moved frame's noise is as white as its own for det F ≥ 1. For det F < 1 it is
    interpolated between pixels further apart: as strong, but of 1/det F the power at the frequencies that are left.
    """
    area = (1 + maps[2]) * (1 + maps[5]) - maps[3] * maps[4]
    with np.errstate(divide="ignore"):
        return (1 + np.nan_to_num(np.clip(1 / np.abs(area), 1, 16), nan=1.0)) / 2


def six_from_unknowns(sigma: float, sharpened: int) -> NDArray[np.float64]:
    """Matrix from θ = (u, σu_x, σu_y, v, σv_x, σv_y) to the six numbers, with the noise factors of
    sharpening.
    """
    displacement, gradient = sharpening_noise(sharpened) if sharpened else (1.0, 1.0)
    g = gradient / sigma
    return np.array(
        [
            [displacement, 0, 0, 0, 0, 0],
            [0, 0, 0, displacement, 0, 0],
            [0, g, 0, 0, 0, g],
            [0, 0, -g, 0, g, 0],
            [0, g, 0, 0, 0, -g],
            [0, 0, g, 0, g, 0],
        ]
    )


def covariance_of_pass(
    problem: LeastSquares, found: LeastSquaresPass, *, sharpened: bool
) -> tuple[Array, WindowStatistics]:
    """Covariance of the six numbers that a least-squares pass found, and the statistics that belong to it."""
    plan, statistics = problem.plan, found.statistics
    transform = six_from_unknowns(problem.sigma, plan.window.sharpen if sharpened else 0)
    covariance = _sandwich_covariance(problem, found, transform)
    if plan.lowpass:
        absorbed = _absorbed(found, covariance, transform)
        covariance /= (1 - 2 * absorbed)[..., None, None].astype(covariance.dtype)
        statistics = dataclasses.replace(statistics, noise=statistics.noise / np.sqrt(1 - absorbed))
    weights = found.state.weights
    if weights is None or weights.weight is None or weights.raw is None:
        return covariance, statistics
    kept = _share(problem, weights.weight)
    slope = _share(problem, weight_slope(weights.raw, weights.weight))
    with np.errstate(invalid="ignore", divide="ignore"):  # nothing is kept of some windows
        covariance *= weighing_noise(kept, slope).astype(covariance.dtype)
    return covariance, dataclasses.replace(
        statistics,
        partner=weights.partner,
        outlying=1 - kept,
        outlying_centre=1 - _share(problem, weights.weight, problem.sigma / 2),
        matched=_matched(problem, found, weights.partner),
    )


def _share(problem: LeastSquares, image: Array, sigma: float | None = None) -> NDArray[np.float64]:
    """Window means of an image without NaN; shape (rows, columns)."""
    means = window_means((image,), problem.grid, problem.sigma if sigma is None else sigma)
    return np.asarray(means[0])


def _matched(problem: LeastSquares, found: LeastSquaresPass, partner: Array) -> NDArray[np.float64]:
    """Share of Σ w |g|², less noise, that the pixels' weights left; shape (rows, columns)."""
    images, statistics, normal = found.images, found.statistics, found.sums.normal
    assert images is not None
    power = images.gradient_x**2 + images.gradient_y**2
    every = image_sums((power,), problem.grid, problem.sigma)[1]
    left = (normal[..., 0] + normal[..., 12]).astype(np.float64)
    with np.errstate(invalid="ignore", divide="ignore"):
        of_noise = 2 * statistics.noise_gradient / statistics.weight
        return np.asarray((left - of_noise * statistics.weight) / (every - of_noise * partner))


def _sandwich_covariance(
    problem: LeastSquares, found: LeastSquaresPass, transform: NDArray[np.float64]
) -> Array:
    """Covariance of the six numbers, `transform` times the unknowns θ; shape (rows, columns, 6, 6)."""
    plan, statistics, sums = problem.plan, found.statistics, found.sums
    assert sums.sandwich is not None
    dtype = sums.sandwich.dtype
    sandwich = sums.sandwich * np.nan_to_num(statistics.left, nan=1.0)[..., None].astype(dtype)
    if statistics.lacking is not None:  # the residual of white noise at the floor of both frames
        floor = 2 * np.asarray(problem.floor) ** 2 * statistics.lacking
        sandwich += floor[..., None].astype(dtype) * _squares_of_gradients(problem, found)
    sandwich *= (shrunk_noise(found.maps) / lowpass_noise(plan.lowpass))[..., None].astype(dtype)
    normal = found.sums.normal
    if plan.group != "affine":
        clean = normal_matrices(normal) - statistics.noise_gradient[..., None, None] * np.eye(6)
        matrices = clean, normal_matrices(sandwich)
        return covariance_in_group(plan, found.maps, matrices, statistics.rho, transform).astype(dtype)
    covariance, feedback = np.empty((*problem.grid.shape, 6, 6), dtype), noise_feedback()
    over_strips(
        lambda start, stop: covariance_strip(
            normal,
            sandwich,
            statistics.noise_gradient,
            statistics.rho,
            feedback,
            transform,
            start,
            stop,
            covariance,
        ),
        problem.grid.rows,
        GRID_STRIP,
    )
    return covariance


def _squares_of_gradients(problem: LeastSquares, found: LeastSquaresPass) -> Array:
    """Sandwich of a residual that is 1 everywhere; shape (rows, columns, 18)."""
    moments = found.moments
    if problem.plan.lowpass:
        assert found.images is not None
        weights = found.state.weights
        weight = None if weights is None else weights.weight
        moments = problem.sweep.moments_of(problem.sweep.filtered(found.images, weight))
    return squared_window_sums(moments, problem.grid, problem.sigma)[..., :18]


def _absorbed(
    found: LeastSquaresPass, covariance: Array, transform: NDArray[np.float64]
) -> NDArray[np.float64]:
    """φ = tr(H C)/Σ w r²: what the fit took out of the residual's power; shape (rows, columns).

    Six numbers hardly lower the residual of a window's white noise. After a low-pass there are fewer independent
    pixels, and with normal gradients Σ w² r² J Jᵀ lacks 2φ: the fit follows noise where gradients are steep.
    """
    statistics, back = found.statistics, np.linalg.inv(transform)
    normal = normal_matrices(found.sums.normal)
    with np.errstate(invalid="ignore", divide="ignore"):
        taken = (normal * (back @ covariance @ back.T)).sum(axis=(-1, -2))
        absorbed = taken / (2 * statistics.noise**2 * statistics.weight)
    if statistics.lacking is not None:  # nothing was taken out of what is not in the residual
        absorbed *= 1 - statistics.lacking
    return np.clip(np.nan_to_num(absorbed), 0, MOST_ABSORBED)


def covariance_in_group(
    plan: Plan,
    maps: Array,
    matrices: tuple[Array, Array],
    rho: Array,
    transform: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Covariance of the six within the plan's group, of a normal matrix less noise and its right-hand side's noise."""
    clean, noise = matrices
    _, basis = allowed(plan.group, maps, plan.window.sigma)
    bread = feedback_scale(rho)[..., None] * (transform @ projection(clean, basis))
    covariance: NDArray[np.float64] = bread @ noise @ np.swapaxes(bread, -1, -2)
    for k in ABSENT[plan.group]:  # zero by assumption, not by rounding
        covariance[..., k, :] = covariance[..., :, k] = np.where(np.isnan(covariance[..., 0, :]), np.nan, 0)
    return covariance


def solution_of_pass(
    plan: Plan,
    covariance: Array,
    statistics: WindowStatistics,
    maps: Array,
    left: Array,
    borne: NDArray[np.int_] | None,
) -> Solution:
    """Return a field that is not yet judged; each point with noise and period of what it was sharpened.

    `covariance` is that of the plan's window, sharpened as the plan says where there is anything `borne`.
    """
    shape, window = maps.shape[1:], plan.window if borne is not None else plan.window.plain
    period = np.full(shape, window.period)
    for sharpen in () if borne is None else np.unique(borne):
        if sharpen != window.sharpen:
            here = borne == sharpen
            covariance[here] *= order_scale(int(sharpen), window.sharpen).astype(covariance.dtype)
            period[here] = attenuation_period(window.sigma, int(sharpen))
    return Solution(
        maps, covariance, statistics, left, np.full(shape, float(window.size)), period,
        np.zeros(shape, np.uint16), lighting=plan.lighting,
    )  # fmt: skip


@cache
def order_scale(sharpen: int, instead_of: int = 0) -> NDArray[np.float64]:
    """Factors of the covariance of a window that is sharpened so many times instead of others; shape (6, 6)."""
    scale = np.diag(six_from_unknowns(1.0, sharpen) @ np.linalg.inv(six_from_unknowns(1.0, instead_of)))
    return np.outer(scale, scale)
