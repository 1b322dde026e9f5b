r"""Trajectory: motions from frame to frame joined to the displacement of the points of the first frame.

With D_r known from frame 0 to frame r, and u measured from frame r to frame n, a point of frame 0 goes to

    D_n(X) = D_r(X) + u(X + D_r(X)),   F_n = (I + G_u) F_r.

u is taken between its grid points from the bicubic interpolant of its maps, and its covariance from the four points
around. Where a corner of the cell was not measured, the map of the nearest one that was is extended, with the
covariance of the extended map. A point that is lost stays lost: it gets no number again.

*Covariance.* To first order δD_n = J₁ δD_r + J₂ δu. The two errors are not independent: both contain the noise of
frame r, which ended one step and begins the next, with opposite sign. An error of a step is to first order linear in
the noise of its two frames, equally in both; a share ρ/(1 + ρ) of its variance is from the noise of one in the gradient
times the noise of the other (ρ of `engine.solve`), and is of that step alone. So each frame has the part

    S = C / (2 (1 + ρ))

of a step's covariance C to itself. With Y the part of Cov D_r that is from frame r,

    Cov D_n = J₁ (Cov D_r − Y) J₁ᵀ + E Eᵀ + J₂ (C − S) J₂ᵀ,   E = J₁ √Y − J₂ √S,   Y' = J₂ S J₂ᵀ

(√ the Cholesky factor): what the two steps see of frame r's noise cancels but for the change of the windows. The error
of a long chain grows by ρ/(1 + ρ) of a step's variance with each step, not by all of it.

*Bias.* What the windows leave out of a steady flow is alike in all steps, and adds up. With β = √b,

    β_n = |J₁| β_r + |J₂| β_u,

which is at least what any signs would give.

| symbol | name |
|---|---|
| b | `bias` |
| D_r, F_r | `base.six` |
| u, C | `step.six`, `step.covariance` |
| J₁, J₂ | `by_first`, `by_second` |
| S, Y | `moved_covariance` of the step, of the base |
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.convention import (
    GRADIENT_FROM_SIX,
    compose_six,
    composition_jacobians,
    gradient,
    recentre,
    six_from_gradient,
)
from sixflow.convention.flags import FAILING, FLAGS
from sixflow.engine.hermite import HermiteSurface
from sixflow.maps.grid import Grid
from sixflow.maps.motion import Motion
from sixflow.maps.neighbours import fill_failed
from sixflow.maps.placing import placed, surface_of
from sixflow.masks import Bodies

Array = NDArray[Any]
Real = NDArray[np.float64]


def composed(base: Motion, step: Motion, grid: Grid, shape: tuple[int, int], *, named: bool = True) -> Motion:
    """The motion `step` after `base`, both on the same grid of their own frame.

    Parameters
    ----------
    base, step : Motion
    grid : Grid
    shape : (int, int)
        Of the frames.
    named : bool
        Whether the numbers of bodies mean the same in both.
    """
    rows, columns = grid.shape
    six = np.full((rows, columns, 6), np.nan)
    covariance, moved = np.full((rows, columns, 6, 6), np.nan), np.full((rows, columns, 6, 6), np.nan)
    bias = np.full((rows, columns, 6), np.nan)
    residual, noise = np.full(grid.shape, np.nan), np.full(grid.shape, np.nan)
    flag = base.flag.copy()
    alive = np.nonzero(base.valid)
    first = base.six[alive].astype(np.float64)
    x, y = grid.x[alive[1]] + first[:, 0], grid.y[alive[0]] + first[:, 1]
    own = None if base.body is None else base.body[alive]
    there = _along(step, grid, x, y, own, named)
    inside = (x >= 0) & (x <= shape[1] - 1) & (y >= 0) & (y <= shape[0] - 1)
    found = there.found & inside
    flag[alive] |= np.where(inside, there.flag, FLAGS["unmatched"]).astype(np.uint16)
    flag[alive] |= np.where(found | ((flag[alive] & FAILING) != 0), 0, FLAGS["unmatched"]).astype(np.uint16)
    kept = tuple(places[found] for places in alive)
    first, second = first[found], there.six[found]
    spread, own_share = there.covariance[found], there.moved_covariance[found]
    still = first.copy()
    still[:, :2] = 0  # the step was taken at the point's new place already
    by_second, by_first = composition_jacobians(second, still)
    six[kept] = compose_six(second, still) + np.pad(first[:, :2], ((0, 0), (0, 4)))
    before, shared = base.covariance[kept].astype(np.float64), base.moved_covariance[kept].astype(np.float64)
    change = by_first @ _root(shared) - by_second @ _root(own_share)
    covariance[kept] = (
        _spread(by_first, before - shared)
        + change @ np.swapaxes(change, -1, -2)
        + _spread(by_second, spread - own_share)
    )
    moved[kept] = _spread(by_second, own_share)
    bias[kept] = _added(by_first, base.bias[kept].astype(np.float64), by_second, there.bias[found])
    residual[kept], noise[kept] = there.residual[found], there.noise[found]
    dtype = base.six.dtype
    return Motion(
        six.astype(dtype), covariance.astype(dtype), moved.astype(dtype), flag, residual.astype(dtype),
        noise.astype(base.noise.dtype), base.body, bias.astype(dtype),
    )  # fmt: skip


@dataclasses.dataclass(frozen=True)
class _There:
    """A motion at places; arrays of shape (n, …). `flag` tells why where it was not found."""

    found: NDArray[np.bool_]
    six: Real
    covariance: Real
    moved_covariance: Real
    bias: Real
    residual: Real
    noise: Real
    flag: NDArray[np.uint16]


def _along(step: Motion, grid: Grid, x: Real, y: Real, own: Array | None, named: bool) -> _There:
    """Interpolate a motion at places, each within its own body."""
    cell_x = np.clip((x - grid.x0) // grid.step, 0, max(grid.columns - 2, 0)).astype(np.intp)
    cell_y = np.clip((y - grid.y0) // grid.step, 0, max(grid.rows - 2, 0)).astype(np.intp)
    corner_x = np.stack([cell_x, np.minimum(cell_x + 1, grid.columns - 1)] * 2)
    corner_y = np.repeat(np.stack([cell_y, np.minimum(cell_y + 1, grid.rows - 1)]), 2, axis=0)
    offset = np.stack([x - grid.x[corner_x], y - grid.y[corner_y]], axis=-1)
    distance = np.abs(offset).max(axis=-1)
    known = step.valid[corner_y, corner_x]
    if step.body is not None:
        body = step.body[corner_y, corner_x]
        if own is None or not named:
            own = np.take_along_axis(body, distance.argmin(axis=0)[None], axis=0)[0]
        known &= body == own
    nearest = np.where(known, distance, np.inf).argmin(axis=0)[None]
    far = np.take_along_axis(np.where(known, distance, np.inf), nearest, axis=0)[0]
    j, i = (np.take_along_axis(corner, nearest, axis=0)[0] for corner in (corner_y, corner_x))
    away = np.take_along_axis(offset, nearest[..., None], axis=0)[0]
    six = recentre(step.six[j, i].astype(np.float64), away)
    shift = np.swapaxes(recentre(np.eye(6), away[:, None, :]), -1, -2)
    covariance, moved = (
        _spread(shift, spread[j, i].astype(np.float64)) for spread in (step.covariance, step.moved_covariance)
    )
    bias = np.diagonal(
        _spread(shift, step.bias[j, i].astype(np.float64)[..., None] * np.eye(6)), axis1=1, axis2=2
    ).copy()
    whole = known.all(axis=0) & (distance.max(axis=0) <= grid.step)
    if whole.any():
        six[whole] = _interpolated(step, grid, x[whole], y[whole])
        weight = (1 - np.abs(offset[:, whole]) / grid.step).prod(axis=-1)
        weight /= weight.sum(axis=0)
        for spread, there in (
            (step.covariance, covariance),
            (step.moved_covariance, moved),
            (step.bias, bias),
        ):
            corners = spread[corner_y[:, whole], corner_x[:, whole]].astype(np.float64)
            there[whole] = np.einsum("cn,cn...->n...", weight, corners)
    reason = np.bitwise_or.reduce(step.flag[corner_y, corner_x], axis=0)
    found = (far <= grid.step) & np.isfinite(six).all(axis=-1)
    border = (step.flag[j, i] & FLAGS["border"]).astype(np.uint16)
    return _There(
        found, six, covariance, moved, bias,
        step.residual[j, i].astype(np.float64), step.noise[j, i].astype(np.float64),
        np.where(found, border, reason & ~np.uint16(FLAGS["masked"])).astype(np.uint16),
    )  # fmt: skip


def _interpolated(step: Motion, grid: Grid, x: Real, y: Real) -> Real:
    """The six of the bicubic interpolant at places all of whose corners are known."""
    six = np.where(step.valid[..., None], step.six, np.nan).astype(np.float64)
    G = gradient(six)
    surface = HermiteSurface(
        grid.x.astype(float), grid.y.astype(float), values=np.moveaxis(six[..., :2], -1, 0),
        slopes_x=np.moveaxis(G[..., 0], -1, 0), slopes_y=np.moveaxis(G[..., 1], -1, 0),
    )  # fmt: skip
    d, d_x, d_y = surface.at(x, y), surface.at(x, y, along_x=True), surface.at(x, y, along_y=True)
    return six_from_gradient(d.T, np.stack([d_x.T, d_y.T], axis=-1))


def _spread(J: Real, covariance: Real) -> Real:
    spread = J @ covariance @ np.swapaxes(J, -1, -2)
    return (spread + np.swapaxes(spread, -1, -2)) / 2


def _added(by_first: Real, first: Real, by_second: Real, second: Real) -> Real:
    """Bias of a joined motion, shape (n, 6): of what is known of either; NaN where neither is."""
    parts = [
        (np.abs(J) @ np.sqrt(np.nan_to_num(one))[..., None])[..., 0]
        for J, one in ((by_first, first), (by_second, second))
    ]
    unknown = np.isnan(first) & np.isnan(second)
    return np.where(unknown, np.nan, (parts[0] + parts[1]) ** 2)


def _root(covariance: Real) -> Real:
    """Cholesky factors of covariances (n, 6, 6), which single precision may have left a little indefinite."""
    size = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    scale = np.where(size > 0, size, 1)
    unit = covariance / (scale[:, :, None] * scale[:, None, :]) + 1e-5 * np.eye(6)
    return size[:, :, None] * np.linalg.cholesky(unit)


def carried(bodies: Bodies, motion: Motion, grid: Grid) -> Bodies | None:
    """Where the bodies of frame 0 are in the frame that a motion leads to; None if all points are lost."""
    maps = np.moveaxis(motion.six.astype(np.float64) @ GRADIENT_FROM_SIX.T, -1, 0)
    maps = np.where(motion.valid, maps, np.nan)
    height, width = bodies.labels.shape
    labels = np.zeros_like(bodies.labels)
    for number in bodies.boxes:
        own = motion.valid if motion.body is None else motion.valid & (motion.body == number)
        if not own.any():
            continue
        there = placed(fill_failed(np.where(own, maps, np.nan), grid.step), grid, 1.0)
        surface = surface_of(there, grid)
        x, y = np.arange(width), np.arange(height)
        u, v = surface.on_grid(x.astype(float), y.astype(float))
        i, j = np.rint(x - u).astype(np.intp), np.rint(y[:, None] - v).astype(np.intp)
        inside = (i >= 0) & (i < width) & (j >= 0) & (j < height)
        from_here = bodies.labels[j.clip(0, height - 1), i.clip(0, width - 1)] == number
        labels[inside & from_here] = number
    if not labels.any():
        return None
    return Bodies.of(labels)
