"""Edges: do the pixels about a point follow its motion, or that of a neighbour, or neither?

Where two motions share a window it follows one of them, the one with the stronger texture, or lies between both. Its
map is smooth, its residual small, and no neighbour contradicts it. What tells are the pixels about the point itself.
They are asked in discs with weights w = exp(−|x − p|²/2s²), of s = σ/2 and σ/4, at least `LEAST_DISC`, for σ the
standard deviation of the point's window. A pixel costs a motion c(r) = min(r²/2s², C) nats (`engine.evidence`).

*Refuted.* A neighbour one window away in any of eight directions predicts M_n for the point, with a gradient as far as
noise lets it be told. Where that differs from the point's own motion by more than both errors and curvature
(`maps.neighbours`) allow, its motion saves

    L = N ⟨c(r_p) − c(r_n)⟩,     ⟨ ⟩ = Σ w …/Σ w,     N = (Σ w)²/Σ w² = 4πs²

nats. With T = N ⟨(r_p − r_n)²/2s²⟩, which the two tell apart, and N (1 − R)/2 of it noise of the moved frame, whose
correlation between the two places is R, a point that is right has L = −T + N (1 − R)/2 in the mean, and a variance of
2T. So it is refuted where L > 0 and

    L + T − N (1 − R)/2 > z √(2 T φ),

z what chance does to the largest of 16 (`normal_limit`: 8 directions, 2 discs). φ ≥ 1 is the dispersion of the costs:
pixels of one foreign spot are not independent. Two motions that tell T apart and cost alike are both
wrong by a quarter of it at least: points are asked that cost z²φ/2 more than usual. From a window away a smooth field
is mispredicted by more than a window's own fit is wrong by, so that L is negative there.

*Unlike.* Where its pixels have no partner, because something hides them, or belong to a motion that nobody has
measured, no neighbour's motion explains them, and m = ⟨c⟩ stands out of what is usual (`sixflow.judge.usual`). A point
is unlike where it does so by more than chance does (`normal_limit`), and where its pixels are nearer to unrelated ones,
which leave twice their contrast's power, than to equal ones: where the residual's power is more than the contrast's.

What windows are known to leave out (`Solution.bias`) is no evidence of an edge: from c(r_p) is deducted what it costs,
and neighbours differ where the errors with it do not allow for the difference.

*Beside.* A point less than σ away from such a point has the edge well inside its window: 16 % of it lie beyond. Which
of the two motions it follows, and how far the other one draws it, cannot be told from its pixels alone, which follow
both in part. It is beside an edge too; so are the next points of the grid, because the edge may lie between the two.
"""

from __future__ import annotations

import dataclasses
import math
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from sixflow.chance import evidence_limit, normal_limit
from sixflow.convention.flags import FAILING, FLAGS
from sixflow.engine.evidence import (
    DIRECTIONS,
    Compared,
    Cost,
    Other,
    cost_strip,
    differing_strip,
    gain_strip,
    mean_strip,
    out_strip,
)
from sixflow.engine.interpolate import Interpolant
from sixflow.engine.scales import LEAST_MISFIT, OF_CONTRAST, local_contrast
from sixflow.engine.spline import noise_variance
from sixflow.engine.threads import over_strips
from sixflow.engine.window import CUT, window_sigma
from sixflow.judge.contradiction import gradient_variances
from sixflow.judge.usual import Usual, usual_in
from sixflow.maps.grid import Grid
from sixflow.maps.neighbours import curvature, fill_failed
from sixflow.plan import Plan
from sixflow.prepare.frame import Frame
from sixflow.refine.solution import Solution
from sixflow.refine.sweep import Sweep

DISTANCES = (1.0,)
"""Of the neighbours, windows."""
LEAST_DISC = 2.0
"""px: standard deviation of the smallest disc; within 2 px spline and gradient take pixels from one another."""
_QUESTIONS = 2 * len(DIRECTIONS) * len(DISTANCES)
_STRIP, _PIXEL_ROWS = 4, 64

Array = NDArray[Any]


def refuted(still: Frame, moved: Frame, grid: Grid, found: Solution, plan: Plan) -> NDArray[np.bool_]:
    """Find points whose pixels follow another motion than the point's own, and points beside them.

    Parameters
    ----------
    still, moved : Frame
        As they were compared.
    grid : Grid
    found : Solution
        Expressed at the points of the plan's reference. Points that failed are not judged, but those at edges are asked
        for their motion.
    plan : Plan

    Returns
    -------
    bool array, shape (rows, columns)

    Examples
    --------
    `sixflow.measure` flags such points as `edge`. In a smooth field there are none:

    >>> import sixflow
    >>> from sixflow import synth
    >>> from sixflow.convention.flags import FLAGS
    >>> flow = synth.CellularVortices(amplitude=1.0, period=160.0)
    >>> made = synth.pair(synth.Speckle(), flow, (128, 128), sensor=synth.Sensor(noise=2))
    >>> int((sixflow.measure(made.frame0, made.frame1).flag.values & FLAGS["edge"]).sum())
    0
    """
    asked = (found.flag & (FAILING - FLAGS["edge"])) == 0
    judged = (found.flag & FAILING) == 0
    if not judged.any():
        return judged
    told = _told(found)
    differing = _differing(found, told, grid, asked, judged)
    if found.statistics.outlying is None and not differing.any():
        return np.zeros(grid.shape, np.bool_)
    pixels = _Pixels.of(still, moved, grid, found, plan)
    bad = pixels.unlike() | pixels.refuted(differing, told.maps)
    unseen = (found.flag & (FLAGS["masked"] | FLAGS["low_texture"])) != 0
    return _beside(bad & ~unseen, found, grid) & judged


class _Told(NamedTuple):
    """What points tell their neighbours: maps, shape (6, rows, columns), and the variances of their numbers."""

    maps: Array
    variances: Array


def _told(found: Solution) -> _Told:
    """Maps whose gradients G are (1 − Σ var/Σ G²) G, or 0: as much as noise lets be told of them (James and Stein).

    From a window away the error of a gradient makes several times that of the displacement.
    """
    covariance = found.covariance
    if found.bias is not None:
        covariance = covariance + np.nan_to_num(found.bias)[..., None] * np.eye(6)
    maps, variances = found.maps.copy(), gradient_variances(covariance)
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.clip(1 - variances[2:].sum(axis=0) / (maps[2:] ** 2).sum(axis=0), 0, 1)
    maps[2:] *= share
    variances[2:] *= share**2
    return _Told(maps, variances)


def _reach(found: Solution, grid: Grid) -> NDArray[np.int64]:
    """Distance of the neighbours of every point, grid points; shape (rings, rows, columns)."""
    windows = np.nan_to_num(found.window, nan=float(grid.step)) / grid.step
    return np.stack([np.maximum(1, np.rint(part * windows)).astype(np.int64) for part in DISTANCES])


def _differing(
    found: Solution, told: _Told, grid: Grid, asked: NDArray[np.bool_], judged: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Which neighbours predict another motion for a point; shape (8 · rings, rows, columns)."""
    reach, count = _reach(found, grid), len(DIRECTIONS) * len(DISTANCES)
    limit, far = normal_limit(_QUESTIONS), float(np.median(found.window[judged]))
    bend = curvature(np.where(asked, found.maps, np.nan), grid.step, 2 * far)
    out = np.zeros((count, *grid.shape), np.bool_)
    over_strips(
        lambda a, b: differing_strip(
            told.maps, told.variances, bend, asked, judged, reach, grid.step, limit, a, b, out
        ),
        grid.rows,
        4 * _STRIP,
    )
    return out


def _beside(told: NDArray[np.bool_], found: Solution, grid: Grid) -> NDArray[np.bool_]:
    """Points that are told of, and those less than σ away."""
    if not told.any():
        return told
    away = grid.step * np.asarray(scipy.ndimage.distance_transform_edt(~told))
    return np.asarray(away <= np.maximum(grid.step, window_sigma(1.0) * np.nan_to_num(found.window)))


@dataclasses.dataclass(frozen=True)
class _Pixels:
    """The pixels of a pair, and what they cost the motion as it is known.

    Attributes
    ----------
    frames : Compared
    own : Cost
    found : Solution
    grid : Grid
    taps : int
    still : array, shape (height, width)
        Frame 0 as it was compared.
    """

    frames: Compared
    own: Cost
    found: Solution
    grid: Grid
    taps: int
    still: Array

    @classmethod
    def of(cls, still: Frame, moved: Frame, grid: Grid, found: Solution, plan: Plan) -> _Pixels:
        """Compare the frames with the motion as it is known."""
        degree, central = plan.degree, plan.share > 0
        sweep = Sweep(
            still, moved, grid, plan.window.sigma, degree=degree, lowpass=plan.lowpass, central=central,
            of_both=False,
        )  # fmt: skip
        light = None if found.light is None else np.moveaxis(found.light, -1, 0)
        images = sweep.images(fill_failed(found.known, grid.step), light=light)
        counted = still.interpolable() if central else still.counted()
        least = OF_CONTRAST / math.sqrt(2) * local_contrast(still.image, counted, grid.y, grid.x)
        noise = np.maximum(_noise(found), least)
        bias = np.zeros(grid.shape)
        if found.bias is not None:
            bias += np.nan_to_num((found.bias[..., 0] + found.bias[..., 1]) / 2)
        made = [np.empty(still.image.shape, images.residual.dtype) for _ in range(3)]
        cost, slopes = Cost(made[0], made[1], made[2], images.residual, evidence_limit()), images[:2]
        over_strips(
            lambda a, b: cost_strip(
                *slopes, 2 * noise**2, bias, LEAST_MISFIT**2, grid.origin_and_step, a, b, cost
            ),
            still.image.shape[0],
            _PIXEL_ROWS,
        )
        dtype = images.residual.dtype
        none, each = np.empty((0, 0), dtype), noise_variance(degree, plan.lowpass)
        frames = Compared(
            still.image,
            Interpolant(still.coefficients(degree) if central else none, counted, each),
            Interpolant(moved.coefficients(degree), moved.interpolable(), each),
            plan.share,
        )
        return cls(frames, cost, found, grid, degree + 1, images.still)

    @cached_property
    def discs(self) -> tuple[NDArray[np.intp], list[float]]:
        """Which size every point's disc has, and the sizes: s, from small to large by factors of two."""
        half = np.maximum(np.nan_to_num(self.found.window) * window_sigma(1.0) / 2, LEAST_DISC)
        least = float(half.min())
        level = np.rint(np.log2(half / least)).astype(np.intp)
        return level, [least * 2**k for k in range(int(level.max()) + 1)]

    @cached_property
    def usual(self) -> list[Usual]:
        """What is usual in discs of every size."""
        planes = self._planes()
        return [
            usual_in(planes, self.grid, size, max(size / 2, LEAST_DISC), _QUESTIONS) for size in self.discs[1]
        ]

    def unlike(self) -> NDArray[np.bool_]:
        """Points whose pixels are nearer to unrelated ones than to equal ones, and not by chance or foreign spots."""
        out = np.zeros(self.grid.shape, np.bool_)
        for k, one in enumerate(self.usual):
            with np.errstate(invalid="ignore", divide="ignore"):
                stands_out = (one.left - one.middle) / one.deviation > normal_limit()
            out |= (self.discs[0] == k) & stands_out & one.unrelated
        return out

    def _planes(self) -> tuple[Array, ...]:
        """Cost, what of it is explained and 1 where a pixel has a partner; r², I₀ and I₀² there."""
        own = self.own
        counted = (own.power > 0).astype(own.cost.dtype)
        still = (self.still - self.still.mean()) * counted
        return own.cost, own.explained, counted, np.where(counted > 0, own.residual, 0) ** 2, still, still**2

    def refuted(self, differing: NDArray[np.bool_], told: Array) -> NDArray[np.bool_]:
        """Points whose pixels follow the motion of a neighbour that differs."""
        level, sizes = self.discs
        out, reach = np.zeros(self.grid.shape, np.bool_), _reach(self.found, self.grid)
        light = np.empty((0, 0, 2)) if self.found.light is None else np.asarray(self.found.light, np.float64)
        images = np.zeros((2, *self.own.cost.shape), self.own.cost.dtype)
        dear = np.stack([one.dear for one in self.usual])[level, *np.indices(level.shape)]
        around = 2 * math.ceil(2 * sizes[-1] / self.grid.step) + 3
        for n, those in enumerate(differing):
            if not those.any():
                continue
            maps, known = self._told_from(n, told, reach)
            other, tried = Other(maps, light, self.grid.origin_and_step, self.taps), those & known & dear
            over_strips(
                lambda a, b, other=other, tried=tried: out_strip(self.frames, self.own, other, a, b, tried),  # type: ignore[misc]
                self.grid.rows,
                _STRIP,
            )
            if not tried.any():
                continue
            wanted = known & np.asarray(scipy.ndimage.maximum_filter(tried, around))
            images.fill(0)
            over_strips(
                lambda a, b, other=other, wanted=wanted: gain_strip(  # type: ignore[misc]
                    self.frames, self.own, other, wanted, a, b, images[0], images[1]
                ),
                self.grid.rows,
                _STRIP,
            )
            independent = _independent(maps[:2] - self.found.maps[:2])
            for k, one in enumerate(sizes):
                here = tried & (level == k)
                for size in {one, max(one / 2, LEAST_DISC)} if here.any() else ():
                    pixels = 4 * math.pi * size**2
                    saved, apart = pixels * self._means(images, size, here)
                    by_noise = np.minimum(pixels * independent / 2, apart)
                    with np.errstate(invalid="ignore", divide="ignore"):
                        z = (saved + apart - by_noise) / np.sqrt(2 * apart * self.usual[k].dispersion)
                    out |= here & (saved > 0) & (z > normal_limit(_QUESTIONS))
        return out

    def _means(self, images: Array, size: float, points: NDArray[np.bool_]) -> Array:
        """Means of images in the discs of a size about some points; 0 at the others."""
        half = np.exp(-((np.arange(math.ceil(CUT * size) + 1) / size) ** 2) / 2)
        means = np.zeros((len(images), *self.grid.shape))
        place = self.grid.origin_and_step
        over_strips(lambda a, b: mean_strip(images, half, place, points, a, b, means), self.grid.rows, _STRIP)
        return means

    def _told_from(self, n: int, told: Array, reach: NDArray[np.int64]) -> tuple[Array, NDArray[np.bool_]]:
        """The maps that neighbours tell all points, and which are told one."""
        (rows, columns), step = self.grid.shape, self.grid.step
        column, row = DIRECTIONS[n % len(DIRECTIONS)]
        far = reach[n // len(DIRECTIONS)]
        j, i = np.mgrid[:rows, :columns]
        y, x = j + row * far, i + column * far
        inside = (y >= 0) & (x >= 0) & (y < rows) & (x < columns)
        maps = told[:, np.clip(y, 0, rows - 1), np.clip(x, 0, columns - 1)].copy()
        hx, hy = column * far * step, row * far * step
        maps[0] -= hx * maps[2] + hy * maps[3]
        maps[1] -= hx * maps[4] + hy * maps[5]
        return maps, inside & np.isfinite(maps).all(axis=0)


def _noise(found: Solution) -> Array:
    """Noise of one frame about every point; the least of all where it failed."""
    noise = np.where(found.failed, np.nan, found.statistics.noise)
    return np.nan_to_num(noise, nan=np.nanmin(noise))


def _independent(apart: Array) -> Array:
    """1 − R: how far the noise of a frame at two places, so far apart along x and y, is not the same."""
    return np.asarray(1 - np.prod(np.sinc(np.clip(np.nan_to_num(apart), -1, 1)), axis=0))
