"""Beside: what a window leaves out, told by its neighbours on the ladder, for a measurement with one window.

The moments of the last pass serve windows of other sizes too (`ladder`): one half an octave finer and one coarser are
made of them. The finer may be smaller than the spacing of the nodes allows for a measurement, down to b = √2 σ: its
shape is less of a Gaussian, its second moment is right. The points where they are compared stand half a window apart:
what a window leaves out does not change faster.

| symbol | name |
|---|---|
| E|β|² | `Solution.bias` (`sixflow.refine.bias`) |
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.convention.flags import FLAGS
from sixflow.maps.grid import Grid
from sixflow.plan import Window
from sixflow.refine.bias import bias_of
from sixflow.refine.cut import uniform_windows
from sixflow.refine.least_squares import LeastSquares, LeastSquaresPass, Swept
from sixflow.refine.problem import State
from sixflow.refine.solution import Solution

Array = NDArray[Any]


def with_bias(problem: LeastSquares, found: LeastSquaresPass, solution: Solution) -> Solution:
    """Return a solution with what its window leaves out.

    Parameters
    ----------
    problem : LeastSquares
    found : LeastSquaresPass
        Its last pass.
    solution : Solution
        Of that pass.
    """
    window, grid = problem.plan.window, problem.grid
    every = 1 if window.sharpen else max(1, round(window.size / 2 / grid.step))  # M and Q need all of them
    some = slice(None, None, every)
    part = Grid(
        grid.x0,
        grid.y0,
        grid.step * every,
        len(range(0, grid.columns, every)),
        len(range(0, grid.rows, every)),
    )
    windows = tuple(Window(window.size * 2 ** (k / 2), window.sharpen) for k in (-1, 0, 1))
    levels = [
        _own(solution, some) if one.size == window.size else _neighbour(problem, found, one, part, some)
        for one in windows
    ]
    bias = bias_of(levels, windows, part)[1]
    return solution.replace(bias=_between(bias, every, grid.shape))


def _own(solution: Solution, some: slice) -> Solution:
    """Every so manieth point of a solution."""
    part = solution.sampled(some, some)
    unknown = np.isnan(part.maps).any(axis=0)
    return part.replace(flag=np.where(unknown, FLAGS["low_texture"], 0).astype(np.uint16))


def _neighbour(
    problem: LeastSquares, found: LeastSquaresPass, window: Window, part: Grid, some: slice
) -> Solution:
    """What another window makes of a pass, at every so manieth point."""
    plan, total = problem.plan.replace(window=window), found.total
    other = LeastSquares(problem.still, problem.moved, part, plan, problem.sweep)
    maps = np.ascontiguousarray(found.start[:, some, some])
    light = None if found.state.light is None else found.state.light[:, some, some]
    swept = Swept(maps, total, found.plane, State(light), found.moments, found.images)
    seen = other.solved(swept)
    aim, borne = seen.maps, None
    if window.sharpen:
        (uniform,) = uniform_windows(problem.sweep, (window.sigma,), maps, light)
        plane = part.plane(found.plane)
        increment = np.where(np.isnan(seen.maps).any(axis=0) | ~seen.measurable, 0, seen.maps - maps)
        aim = uniform.deconvolve(uniform.fit(maps - plane) + increment, window.sharpen) + plane
        borne = np.full(part.shape, window.sharpen)
    unusable = ~np.isfinite(aim).all(axis=0) | ~seen.measurable
    level = other.solution(seen, np.where(unusable, np.nan, aim), np.zeros(part.shape), borne=borne)
    return level.replace(flag=np.where(unusable, FLAGS["low_texture"], 0).astype(np.uint16))


def _between(values: Array, every: int, shape: tuple[int, int]) -> Array:
    """Values at every so manieth point, along straight lines in between; shape (rows, columns, 6)."""
    if every == 1:
        return values
    for axis, size in enumerate(shape):
        place = np.minimum(np.arange(size) / every, values.shape[axis] - 1)
        low = np.minimum(place.astype(int), max(values.shape[axis] - 2, 0))
        high = np.minimum(low + 1, values.shape[axis] - 1)
        t = np.expand_dims(place - low, tuple(k for k in range(values.ndim) if k != axis)).astype(
            values.dtype
        )
        values = (1 - t) * np.take(values, low, axis=axis) + t * np.take(values, high, axis=axis)
    return values
