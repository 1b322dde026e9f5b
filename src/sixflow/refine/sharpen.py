"""Sharpen: finer resolution of the same window, without the bias of the pattern.

A window's affine fit answers a displacement of wave number k with M = exp(−k²σ²/2). Sharpening raises
this to T = Q M, polynomials in M that `engine.response` chooses. But the fit weighs the
displacement with the texture that happens to lie in the window: its operator is M̃ = M + P, and P U,
the pattern-induced bias, is different at every point and does not vanish with sharpening. In the
gradients, it would even stay for ever: a gradient that contradicts the displacements around it leaves
no trace in a dense field that the windows see.

M itself, the same fit with a uniform texture, can be computed on the field. So each pass here takes the
dense displacement U, fits what it leaves in the frames, Δ = M̃(U* − U), and forms

    U ← T U + Q Δ = Q (M U + Δ).

The fixed point is T U* + Q P (1 − T) U*: the response is T whatever the texture, and the pattern acts
on what T misses alone. Noise is Q M̃ n, as in theory (`engine.window.sharpening_noise`), and the number
of passes does not depend on n. Windows that are cut by a border or a mask are cut in M too.

*What a point bears.* Between two passes U moves by δ, and the aim of a window sharpened n times by Q_n P δ. Where that
is more than δ itself, the root of their mean squares under the window, passes would diverge, and the pattern acts on
what T misses with more than its whole: where the texture fills a part of the window alone, P is as large as M. The
point then takes the next lower n of `orders_of`, down to 0. All of them come from the same recurrence.

| symbol | name |
|---|---|
| M | `UniformWindow.fit` |
| Q | `UniformWindow.deconvolve` |
| U | maps, blended |
| Δ | `Problem.step(maps, …, total=False).maps − maps` |
| n | `Borne.order`, an index of `orders_of` |
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from sixflow.maps.neighbours import fill_failed, settle, typical
from sixflow.refine.problem import Pass, Problem, State
from sixflow.refine.solution import Solution
from sixflow.refine.sweep import mean_plane

SHARPEN_PASSES = 8
SHARPENED = 0.3
"""What a pass leaves of its update where nothing is known of it yet, at most (measured: 0.1 to 0.3)."""
MOST_LEFT = 0.9
"""Rate of passes that do not come nearer: beyond, nothing is known of where they end."""

Array = NDArray[Any]


def orders_of(sharpen: int) -> tuple[int, ...]:
    """How far a window may be sharpened where the texture does not bear all: half as much, and half again, to not at
    all.

    Examples
    --------
    >>> orders_of(4), orders_of(0)
    ((4, 2, 1, 0), (0,))
    """
    return (sharpen, *orders_of(sharpen // 2)) if sharpen else (0,)


@dataclasses.dataclass(frozen=True)
class Borne:
    """What points bear.

    Attributes
    ----------
    order : int array, shape (rows, columns)
        Index of `orders_of`; their number where not even the last.
    left : array, shape (rows, columns)
        How far further passes may move the point, px.
    """

    order: NDArray[np.intp]
    left: Array

    @classmethod
    def of(cls, aims: list[Array], before: list[Array], moved: Array, reach: float, least: float) -> Borne:
        """See what the last change of the motion made of the aims.

        An aim sums the change under its window; seen under one of σ itself, the change counts under one of √2 σ
        (Cauchy and Schwarz).

        Parameters
        ----------
        aims, before : list of arrays, shape (6, rows, columns)
            By order, of this pass and of the one before.
        moved : array, shape (6, rows, columns)
            How the motion changed between them.
        reach : float
            σ in grid points.
        least : float
            A change of the motion that is of no account, px.
        """
        cause = np.maximum(_power(moved, math.sqrt(2) * reach), least**2)
        order = np.full(moved.shape[1:], len(aims))
        effect = np.zeros(moved.shape[1:])
        for k in range(len(aims) - 1, -1, -1):
            power = _power(aims[k] - before[k], reach)
            borne = power <= cause
            effect = np.where(borne | (order == len(aims)), power, effect)
            order = np.where(borne, k, order)
        rates = np.sqrt(
            effect / cause
        )  # of a point alone it is rough; of all points it is that of any that stay away
        rate = np.where(order == len(aims), MOST_LEFT, np.minimum(rates, np.median(rates)).clip(0, MOST_LEFT))
        # the point's own change, not that of anything unsteady at the end of its window
        change = _power(at_order(aims, order) - at_order(before, order), reach / 2)
        return cls(order, np.sqrt(change) * rate / (1 - rate))


def at_order(aims: list[Array], order: NDArray[np.intp]) -> Array:
    """The aim of each point's order; of the last one where it bears none."""
    out = aims[0]
    for k in range(1, len(aims)):
        here = order >= k
        if here.any():
            out = np.where(here, aims[k], out)
    return out


def _power(planes: Array, reach: float) -> Array:
    """Mean square of a displacement under a window of σ = reach grid points."""
    square = np.nan_to_num(planes[0] ** 2 + planes[1] ** 2)
    return np.asarray(scipy.ndimage.gaussian_filter(square, reach, mode="nearest", truncate=2.5))


def sharpen(
    problem: Problem, maps: Array, state: State, measurable: NDArray[np.bool_], *, sharpened: bool = False
) -> tuple[Pass, Solution]:
    """Sharpening passes until the points stay, each as sharp as it bears.

    Parameters
    ----------
    problem : Problem
    maps : float64 array, shape (6, rows, columns)
        What a pass in total form found, or a field.
    state : State
        After that pass.
    measurable : bool array, shape (rows, columns)
        Points that it found texture at; the others take no part, and are filled from their neighbours.
    sharpened : bool
        `maps` is a field, which another window measured with sharpening.

    Returns
    -------
    Pass
        The last one.
    Solution
        Not yet judged; NaN where the last pass failed.
    """
    plan, step, window = problem.plan, problem.grid.step, problem.plan.window
    orders, reach = orders_of(window.sharpen), window.sigma / step
    uniform = problem.uniform(fill_failed(maps, step), state)
    maps = settle(np.where(measurable, maps, np.nan), step, window.size)
    if not sharpened:
        maps = uniform.deconvolve(maps, window.sharpen)
    before: list[Array] | None = None
    moved, order = np.zeros_like(maps), np.zeros(problem.grid.shape, np.intp)
    for left_over in range(SHARPEN_PASSES - 1, -1, -1):
        found = problem.step(maps, state, total=False, last=True)
        state, increment = found.state, found.maps - maps
        failed = np.isnan(increment).any(axis=0) | ~measurable
        plane = problem.grid.plane(mean_plane(maps, problem.grid))
        seen = uniform.fit(maps - plane) + np.where(failed, 0, increment)
        aims = [aim + plane for aim in uniform.deconvolved(seen, orders)]
        borne = None if before is None else Borne.of(aims, before, moved, reach, plan.tolerance)
        if borne is not None:
            order = np.maximum(order, borne.order)  # what failed once is not tried again
        aim = np.where(failed, np.nan, at_order(aims, order))
        distance = np.hypot(aim[0] - maps[0], aim[1] - maps[1])
        left = SHARPENED * distance if borne is None else np.where(failed, np.nan, borne.left)
        if not left_over or (borne is not None and typical(left) < plan.tolerance):
            break
        following = settle(aim, step, window.resolving)
        before, moved, maps = aims, following - maps, following
    taken = np.array(orders)[np.minimum(order, len(orders) - 1)]
    return found, problem.solution(found, aim, left, borne=taken)
