"""A flow of two components, differentiated (the route of Longuet-Higgins & Prazdny 1980 and Kanatani 1985).

Both start from the optical flow (u, v) and its derivatives at a point, from which structure and motion follow.
Here the flow is the translation of each window, in the least-squares sense, and the derivatives are central
differences on the grid:

    d(x_p) = argmin Σ_x w(x − x_p) [I1(x + U) − I0(x) + ∇I·(d − U(x))]²
    u_x = (u(x + step) − u(x − step))/(2 step), and so on; one-sided at the edge of the grid

| symbol | name |
|---|---|
| U | the flow of the pass before, at every pixel, by which frame 1 is warped |
| ∇I | mean of the central differences of frame 0 and of the warped frame 1 |
| w | Gaussian weight, σ = window/3.545 |

Solved for all of d rather than for a correction, so that the noise does not grow with the passes; coarse to
fine over halved frames. u_x + v_y is the divergence T = A + D of Kanatani, v_x − u_y his R = C − B, and u_x −
v_y and u_y + v_x the two parts of S (Eagleson, eq. (2)). The differences are those of the finite displacement:
to first order divergence = 2τ_s, curl = 2τ_r, stretch = 2τ_b, shear = 2τ_B.

What it can claim: the translation of a window that moves as a whole is exact up to interpolation. In a window
that deforms, the motion left in it acts as noise: d is the mean of the motion, weighted by w I_x², off its
value at the centre by about |G| σ/√N, N the number of independent patches of texture in the window (on speckle
of blob radius s, 0.6 |G| s). Differences turn an error e of d, uncorrelated between points 2 step apart, into
e/(√2 step): they amplify whatever errors the flow has, the more so on a finer grid, until neighbouring windows
overlap so much that their errors cancel.

References
----------
H. C. Longuet-Higgins and K. Prazdny, "The interpretation of a moving retinal image", Proceedings of the Royal
Society of London B 208, 385–397 (1980). K. Kanatani (1985), whose equations of flow and invariants Eagleson quotes
in §2.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from sixflow.checks import require, whole
from sixflow.convention import six_from_gradient
from sixflow.eigenfilters.historical._frames import FLAT, Problem, away_from_gaps, central_differences
from sixflow.eigenfilters.historical.result import HistoricalField
from sixflow.engine.window import CUT

Array = NDArray[Any]

_SMALLEST = 16  # px, least side of a halved frame
_COVERED = 0.5  # least part of the window's weight on pixels that count
_LONGEST_STEP = 2.0  # px, by which a pass may change the flow
_BEFORE_HALVING = 1.0  # px, σ of the Gaussian


def differentiated_flow(
    frame0: ArrayLike,
    frame1: ArrayLike,
    *,
    grid_step: int = 8,
    window: float = 31.0,
    levels: int = 3,
    passes: int = 5,
) -> HistoricalField:
    """Measure a flow of two components, window by window, and differentiate it on the grid.

    The formulas are those of the module (Longuet-Higgins & Prazdny 1980; Kanatani 1985).

    Parameters
    ----------
    frame0, frame1 : array, shape (height, width)
        Reference and moved frame, real grey values; NaN and ±Inf mark pixels without a value.
    grid_step : int
        Distance of the grid points, px, 1 to the smaller side of the frames, leaving two or more rows and
        columns of points.
    window : float
        Side of the square subset of the same noise, px, 5 to the smaller side of the frames.
    levels : int
        Frames in the pyramid, 1 to 8, each half the size; fewer are used where the smallest would fall below 16
        px. Each level doubles the displacement that is found, which is about a quarter of the texture's period
        at one level.
    passes : int
        Passes at each level, 1 to 100.

    Returns
    -------
    HistoricalField
        Not valid where the window lies less than half on pixels known in both frames, where it has no structure
        in some direction (rms slope below 0.001 of the frame's), or where a neighbour on the grid needed for a
        difference is not valid.

    Raises
    ------
    InputError
        If a frame is not two-dimensional and real, the shapes differ, an argument is outside its range, or the
        grid has a single row or column.

    Examples
    --------
    >>> from sixflow.synth import Affine, Speckle, pair
    >>> made = pair(Speckle(sigma=2.0), Affine.translation(3.2, -1.4), (96, 96))
    >>> differentiated_flow(made.frame0, made.frame1).six[6, 6, :2].round(2).tolist()
    [3.2, -1.4]
    """
    problem = Problem.of(frame0, frame1, grid_step, window)
    whole("levels", levels, 1, 8)
    whole("passes", passes, 1, 100)
    grid = problem.grid
    require(
        min(grid.shape) > 1,
        "grid_step",
        grid_step,
        f"the grid is {grid.rows}×{grid.columns} and differences need two rows and columns; choose a smaller step",
    )

    first, second = (problem.frame0, problem.valid0), (problem.frame1, problem.valid1)
    pyramid = [(first, second)]
    while len(pyramid) < levels and min(pyramid[-1][0][0].shape) >= 2 * _SMALLEST:
        first, second = (_halve(*frame) for frame in pyramid[-1])
        pyramid.append((first, second))
    flow, known = np.zeros((2, *pyramid[-1][0][0].shape)), np.empty(0)
    for first, second in reversed(pyramid):
        flow = _enlarge(flow, first[0].shape)
        for _ in range(passes):
            flow, known = _translate(first, second, flow, problem.sigma)

    at = np.ix_(grid.y, grid.x)
    u, v = (np.where(known[at], component[at], np.nan) for component in flow)
    (u_y, u_x), (v_y, v_x) = np.gradient(u, grid.step), np.gradient(v, grid.step)
    G = np.stack([np.stack([u_x, u_y], axis=-1), np.stack([v_x, v_y], axis=-1)], axis=-2)
    six = six_from_gradient(np.stack([u, v], axis=-1), G)
    valid: NDArray[np.bool_] = np.all(np.isfinite(six), axis=-1)
    return HistoricalField(
        np.where(valid[..., None], six, np.nan), grid.x, grid.y, valid, "differentiated flow"
    )


def _translate(
    first: tuple[Array, Array], second: tuple[Array, Array], flow: Array, sigma: float
) -> tuple[Array, Array]:
    """One pass at one level: the translation of the window about every pixel, and where it is known."""
    (image0, valid0), (image1, valid1) = first, second
    rows, columns = np.indices(image0.shape)
    at = (rows + flow[1], columns + flow[0])
    warped = ndimage.map_coordinates(image1, at, order=3, mode="nearest")
    inside = ndimage.map_coordinates(valid1.astype(np.float64), at, order=1, mode="constant") > 0.999
    slopes = zip(central_differences(image0), central_differences(warped), strict=True)
    known = away_from_gaps(valid0 & inside, 1)
    I_x, I_y = (np.where(known, (one + other) / 2, 0.0) for one, other in slopes)
    r = warped - image0 - I_x * flow[0] - I_y * flow[1]

    xx, xy, yy = (_window_mean(plane, sigma) for plane in (I_x * I_x, I_x * I_y, I_y * I_y))
    b_x, b_y = _window_mean(I_x * r, sigma), _window_mean(I_y * r, sigma)
    least = (xx + yy) / 2 - np.hypot((xx - yy) / 2, xy)
    covered = _window_mean(known.astype(np.float64), sigma)
    floor = FLAT**2 * float((I_x**2 + I_y**2).sum()) / max(int(known.sum()), 1)
    solved = (covered >= _COVERED) & (least > floor * covered)
    det = np.where(solved, xx * yy - xy * xy, 1.0)
    total = np.stack([xy * b_y - yy * b_x, xy * b_x - xx * b_y]) / det
    change = np.where(solved, total - flow, 0.0)
    return flow + change.clip(-_LONGEST_STEP, _LONGEST_STEP), solved


def _window_mean(plane: Array, sigma: float) -> Array:
    return np.asarray(ndimage.gaussian_filter(plane, sigma, mode="constant", truncate=CUT))


def _halve(image: Array, valid: Array) -> tuple[Array, Array]:
    """The frame at half the size; pixel (j, i) lies on pixel (2j, 2i)."""
    weight = ndimage.gaussian_filter(valid.astype(np.float64), _BEFORE_HALVING, mode="nearest")[::2, ::2]
    smooth = ndimage.gaussian_filter(image, _BEFORE_HALVING, mode="nearest")[::2, ::2]
    half_valid = weight > 0.5
    return np.where(half_valid, smooth / np.maximum(weight, 0.5), 0.0), half_valid


def _enlarge(flow: Array, shape: tuple[int, int]) -> Array:
    """The flow of the halved frames at the full size."""
    if flow.shape[1:] == shape:
        return flow
    at = np.indices(shape) / 2
    return np.stack([2 * ndimage.map_coordinates(part, at, order=1, mode="nearest") for part in flow])
