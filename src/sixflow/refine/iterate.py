"""Iterate: passes at full resolution until the points stay, to the noise limit."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.maps.grid import Grid
from sixflow.maps.neighbours import TYPICAL_SHARE, settle, typical
from sixflow.maps.restriction import with_shared_gradients
from sixflow.plan import Plan
from sixflow.refine.beside import with_bias
from sixflow.refine.least_squares import LeastSquares, LeastSquaresPass
from sixflow.refine.problem import Pass, PixelWeights, Problem, State
from sixflow.refine.sharpen import sharpen
from sixflow.refine.solution import Solution

NEAR = 0.2
"""px: residuals of points so close to where they end tell outlying pixels."""
WEIGHED_PASSES = 2
"""Weighed passes over the limit of ordinary ones: they converge more slowly."""
WEIGHED_SHARE = 0.995
"""Of the points that have to stay where pixels are weighed: the last ones are those in doubt."""
EXPLAINED = 0.01
"""Share of the residual's power that a last pass may still take out."""
LONG_TAIL = 1.3
"""Mean square residual over that of a Gaussian of the same mean size: outlying pixels (noise: ± 0.03)."""

Array = NDArray[Any]


def refine(problem: Problem, start: Array, *, sharpened: bool = False, bias: bool = False) -> Solution:
    """Passes in total form until the points stay, then sharpening passes.

    A pass brings a point close to its fixed point at once; `Pass.left` is what remains. The passes end when this is
    below the tolerance and the last update no longer changed the residual, from which the covariance is taken. If the
    residual then shows outlying pixels, further passes down-weight them.

    Parameters
    ----------
    problem : Problem
    start : float64 array, shape (6, rows, columns)
        Without NaN.
    sharpened : bool
        The start was measured with sharpening by another window: sharpening passes alone.
    bias : bool
        Ask what the window leaves out as well, where the method can tell (`beside`).

    Returns
    -------
    Solution
        Not yet judged.
    """
    plan = problem.plan
    if sharpened:
        found = problem.step(start, State(), total=False)
        state = with_pixel_weights(plan, found) or found.state
        found, solution = sharpen(problem, start, state, found.measurable, sharpened=True)
    else:
        found = settled(problem, start)
        if plan.window.sharpen:
            found, solution = sharpen(problem, found.maps, found.state, found.measurable)
        else:
            solution = problem.solution(found, found.maps, found.left)
    if bias and isinstance(problem, LeastSquares) and isinstance(found, LeastSquaresPass):
        return with_bias(problem, found, solution)
    return solution


def settled(problem: Problem, start: Array) -> Pass:
    """Return the last of the passes in total form, with what the covariance needs."""
    plan, state, maps = problem.plan, State(), start
    done, most = 0, plan.passes
    while True:
        found = problem.step(maps, state, last=True)  # any may be: the pyramid often leaves nothing to do
        done += 1
        weighed = with_pixel_weights(plan, found) if done > 1 or typical(found.moved) < NEAR else None
        if weighed is not None:
            state, done, most = weighed, 0, plan.passes * WEIGHED_PASSES
        elif done >= most or _stays(plan, found):
            return found
        else:
            state = found.state
        maps = _filled(problem, found, weighed=state.weights is not None and not state.weights.resting)
        del found  # what it holds of the pixels need not stand beside that of the next


def _stays(plan: Plan, found: Pass) -> bool:
    """Whether more passes would change nothing that matters."""
    known = np.where(found.measurable, found.left, np.nan)
    most = typical(known, WEIGHED_SHARE if found.weighed else TYPICAL_SHARE)
    if most >= plan.tolerance or found.explained >= EXPLAINED:
        return False
    # what is in doubt stays once the weights do
    return not (found.changing and bool((known > 2 * plan.tolerance).any()))


def _filled(problem: Problem, found: Pass, *, weighed: bool) -> Array:
    """What the next pass begins with: no NaN, and no point that contradicts its neighbours."""
    maps = dense(found.maps, problem.plan, problem.grid)
    if weighed:  # what outlying pixels leave without texture wanders, and would take its neighbours along
        maps = np.where(found.measurable, maps, np.nan)
    return settle(maps, problem.grid.step, problem.plan.window.size, curved=weighed)


def with_pixel_weights(plan: Plan, found: Pass) -> State | None:
    """The state in which outlying pixels are down-weighted, if a pass shows the first of them."""
    tail = found.statistics.tail
    if found.state.weights is not None or not plan.robust or tail is None:
        return None
    # fewer pixels are independent after a low-pass, and chance makes longer tails
    longest = 1 + (LONG_TAIL - 1) * max(1.0, plan.lowpass)
    if not (tail > longest).any():
        return None
    return dataclasses.replace(found.state, weights=PixelWeights(None, None, 0, found.statistics.weight))


def dense(maps: Array, plan: Plan, grid: Grid) -> Array:
    """Maps that fit together to a dense field: those of a smaller group share the gradients of their displacements."""
    return maps if plan.group == "affine" else with_shared_gradients(maps, grid.step)
