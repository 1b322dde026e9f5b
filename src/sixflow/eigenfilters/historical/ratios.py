"""Ratios of spatio-temporal gradients, each generator alone (after Narathong et al.).

A pattern that moves along one generator, u = τ a, obeys τ a·∇I + I_t = 0 to first order. At every point of the
grid, a = a_k(x − x_p), k one of the six of Eagleson, eq. (3):

    "least-squares"   τ_k = −Σ w (a_k·∇I) I_t / Σ w (a_k·∇I)²
    "pointwise"       τ_k = −Σ w I_t / (a_k·∇I) / Σ w        the mean of the plain ratios

| symbol | name |
|---|---|
| ∇I | mean over both frames of the central differences (I(x+1) − I(x−1))/2 |
| I_t | I1 − I0 |
| w | Gaussian weight, σ = window/3.545 |

Narathong et al. took translation, divergence and curl this way; the two shears follow suit.

What it can claim: the motion of *one* generator, small against the size of the texture. Other generators leak
in, by the correlation of a_k·∇I with a_l·∇I in the window, whose mean is zero on a random texture but which
scatters. Central differences see a wave of wave number k with the slope sin k in place of k, so that τ comes
out too large by about k²/6. White noise of standard deviation s in each frame adds s²/4 to both ⟨I_x²⟩ and
⟨I_y²⟩ and nothing to the numerator: τ comes out too small by the factor 1/(1 + s²/(4⟨I_x²⟩)), which no window,
however large, removes. The plain ratio is worse: wherever a_k·∇I passes through zero it is unbounded, and under
noise it has neither mean nor variance. This is the instability for which Eagleson leaves gradients behind.
"""

from __future__ import annotations

from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sixflow.checks import require
from sixflow.convention import GENERATORS
from sixflow.convention.affine import SIX_PER_COEFFICIENT
from sixflow.eigenfilters.historical._frames import FLAT, Problem, away_from_gaps, central_differences
from sixflow.eigenfilters.historical.moments import WindowSums, in_pixels
from sixflow.eigenfilters.historical.result import HistoricalField
from sixflow.engine.window import CUT

Array = NDArray[Any]
Ratio = Literal["least-squares", "pointwise"]

_COVERED = 0.5  # least part of the window's weight on pixels that count


def gradient_ratio(
    frame0: ArrayLike,
    frame1: ArrayLike,
    *,
    grid_step: int = 8,
    window: float = 31.0,
    ratio: Ratio = "least-squares",
) -> HistoricalField:
    """Measure each of the six alone, as a ratio of spatio-temporal gradients.

    The formulas are those of the module, after Narathong et al.; the six follow from the coefficients to first
    order, which is the order of the method: u = τ_x, v = τ_y, divergence = 2τ_s, curl = 2τ_r, stretch = 2τ_b,
    shear = 2τ_B.

    Parameters
    ----------
    frame0, frame1 : array, shape (height, width)
        Reference and moved frame, real grey values; NaN and ±Inf mark pixels without a value.
    grid_step : int
        Distance of the grid points, px, 1 to the smaller side of the frames.
    window : float
        Side of the square subset of the same noise, px, 5 to the smaller side of the frames.
    ratio : {"least-squares", "pointwise"}
        Least squares over the window, or the mean of the plain ratios of its pixels.

    Returns
    -------
    HistoricalField
        Not valid where less than half of the window's weight lies on pixels whose differences are known in both
        frames, or where one of the a_k·∇I has an rms below 0.001 of that of ∇I in the frame.

    Raises
    ------
    InputError
        If a frame is not two-dimensional and real, the shapes differ, or an argument is outside its range.

    Examples
    --------
    >>> from sixflow.synth import Affine, Speckle, pair
    >>> made = pair(Speckle(sigma=4.0), Affine.translation(0.1, 0.0), (64, 64))
    >>> field = gradient_ratio(made.frame0, made.frame1)
    >>> round(float(field.six[4, 4, 0]), 2)
    0.1
    """
    problem = Problem.of(frame0, frame1, grid_step, window)
    require(ratio in get_args(Ratio), "ratio", ratio, "must be 'least-squares' or 'pointwise'")

    slopes = zip(central_differences(problem.frame0), central_differences(problem.frame1), strict=True)
    I_x, I_y = ((first + second) / 2 for first, second in slopes)
    I_t = problem.frame1 - problem.frame0
    known = away_from_gaps(problem.valid0 & problem.valid1, 1)
    I_x, I_y, I_t = (np.where(known, plane, 0.0) for plane in (I_x, I_y, I_t))

    sums = WindowSums(I_t.shape, problem.grid, problem.sigma)
    A, b = sums.normal_equations((I_x * I_x, I_x * I_y, I_y * I_y), (I_x * I_t, I_y * I_t))
    power = np.diagonal(A, axis1=-2, axis2=-1)  # Σ w (a_k·∇I)²
    covered = sums.total(known.astype(np.float64))
    floor = FLAT**2 * float((I_x**2 + I_y**2).sum()) / max(int(known.sum()), 1)
    valid = (covered >= _COVERED) & (power > floor * covered[..., None]).all(axis=-1)

    if ratio == "least-squares":
        tau = -b / np.where(valid[..., None], power, 1.0)
    else:
        tau = _mean_of_ratios(problem, I_x, I_y, I_t, known, valid)
    six = np.where(valid[..., None], in_pixels(tau, problem.sigma) * SIX_PER_COEFFICIENT, np.nan)
    return HistoricalField(six, problem.grid.x, problem.grid.y, valid, f"gradient ratio, {ratio}")


def _mean_of_ratios(
    problem: Problem, I_x: Array, I_y: Array, I_t: Array, known: Array, valid: Array
) -> Array:
    """Weighted mean over each window of −I_t/(a_k·∇I), lengths in units of σ; shape (rows, columns, 6)."""
    sigma, grid = problem.sigma, problem.grid
    reach = int(CUT * sigma)
    height, width = I_t.shape
    tau = np.full((*grid.shape, 6), np.nan)
    for j, i in np.argwhere(valid):
        y, x = int(grid.y[j]), int(grid.x[i])
        rows = np.arange(max(y - reach, 0), min(y + reach + 1, height))
        columns = np.arange(max(x - reach, 0), min(x + reach + 1, width))
        at = np.ix_(rows, columns)
        X, Y = np.meshgrid((columns - x) / sigma, (rows - y) / sigma)
        fields = np.einsum("kcm,myx->kcyx", GENERATORS[:, :2], np.stack([X, Y, np.ones_like(X)]))
        along = fields[:, 0] * I_x[at] + fields[:, 1] * I_y[at]
        weight = np.exp(-(X * X + Y * Y) / 2) * known[at] * (along != 0)
        plain = -I_t[at] / np.where(along != 0, along, 1.0)
        tau[j, i] = (weight * plain).sum(axis=(1, 2)) / weight.sum(axis=(1, 2))
    return tau
