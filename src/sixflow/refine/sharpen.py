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

| symbol | name |
|---|---|
| M | `UniformWindow.fit` |
| Q | `UniformWindow.deconvolve` |
| U | maps, blended |
| Δ | `Problem.step(maps, …, total=False).maps − maps` |
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.maps.neighbours import fill_failed, settle, typical
from sixflow.refine.problem import Problem, State
from sixflow.refine.solution import Solution

SHARPEN_PASSES = 8
_HELD = 1 / 8  # of a whole stride
_STANDS = 0.005  # px: passes that stop coming nearer than this have not diverged, whatever the tolerance
SHARPENED = 0.3  # what a sharpening pass leaves of its update, at most (measured: 0.1 to 0.3)


def sharpen(
    problem: Problem,
    maps: NDArray[Any],
    left: NDArray[Any],
    state: State,
    measurable: NDArray[np.bool_],
    *,
    sharpened: bool = False,
) -> Solution:
    """Sharpening passes until the points stay, with shorter strides for those that do not come nearer.

    Where the texture fills a part of the window alone, P is as large as M, and Q P may make passes diverge. A point
    whose stride is down to an eighth, or that has not settled at the end, is held: it keeps the plain fit.

    Parameters
    ----------
    problem : Problem
    maps : float64 array, shape (6, rows, columns)
        What a pass in total form found, or a field.
    left : float64 array, shape (rows, columns)
        How far those may be from their fixed points, px.
    state : State
        After that pass.
    measurable : bool array, shape (rows, columns)
        Points that it found texture at; the others take no part, and are filled from their neighbours.
    sharpened : bool
        `maps` is a field, which another window measured with sharpening. Then nothing is known to hold points at,
        and those that do not settle stay with what they have left.

    Returns
    -------
    Solution
        Not yet judged; NaN where the last pass failed.
    """
    plan, step, window = problem.plan, problem.grid.step, problem.plan.window
    uniform = problem.uniform(fill_failed(maps, step), state)
    maps = plain = settle(np.where(measurable, maps, np.nan), step, window.size)
    if not sharpened:
        maps = uniform.deconvolve(maps, window.sharpen)
    far = max(plan.tolerance, _STANDS)
    known, held = left, np.zeros(problem.grid.shape, np.bool_)
    stride, before = np.ones(problem.grid.shape), np.full(problem.grid.shape, np.inf)
    for left_over in range(SHARPEN_PASSES - 1, -1, -1):
        found = problem.step(maps, state, total=False, last=True)
        state, increment = found.state, found.maps - maps
        failed = np.isnan(increment).any(axis=0) | ~measurable
        aim = uniform.deconvolve(uniform.fit(maps) + np.where(failed, 0, increment), window.sharpen)
        distance = np.where(failed, np.nan, np.hypot(aim[0] - maps[0], aim[1] - maps[1]))
        with np.errstate(invalid="ignore"):
            stride[(distance > 0.7 * before) & (distance > far)] /= 2
        if not sharpened:
            held |= stride <= _HELD
        moved = settle(np.where(measurable, maps + stride * (aim - maps), np.nan), step, window.resolving)
        maps = np.where(held, plain, moved)
        left, before = distance * np.where(stride == 1, SHARPENED, 1.0), distance
        if not left_over or typical(np.where(held, np.nan, left)) < plan.tolerance:
            break
        del found  # what it holds of the pixels need not stand beside that of the next
    if not sharpened:
        with np.errstate(invalid="ignore"):
            held |= left > 2 * far
    left = np.where(held & ~np.isnan(left), known, left)
    maps = np.where(np.isnan(left), np.nan, np.where(held, plain, maps))
    return problem.solution(found, maps, left, sharpened=True, held=held)  # noqa: F821 - of the last turn
