"""Pyramid: coarse to fine, from a start that may be far off to one that refinement can finish.

From the shift that the frames have in common, or from a start that is given, the frames are halved until the window
covers what is left. At each level a few total-form passes are made with the same window in that level's pixels, points
that contradict their neighbours are replaced by what these predict, and the maps go on to the next level:
displacements doubled, gradients as they are.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.blend import resample_strip, twist_of
from sixflow.engine.threads import over_strips
from sixflow.maps.grid import Grid
from sixflow.maps.neighbours import settle, typical
from sixflow.method import problem_of
from sixflow.plan import Plan
from sixflow.prepare.frame import Frame
from sixflow.refine.problem import State
from sixflow.search.shift import common_shift

LEVEL_PASSES = 4
SETTLED = 0.1  # px of the level: the next level corrects what is left


def level_count(shape: tuple[int, int], plan: Plan) -> int:
    """Return how many halvings the search starts from: until the window spans the shorter side."""
    if plan.levels is not None:
        return plan.levels
    return max(0, math.floor(math.log2(min(shape) / plan.window.size)))


def pyramid(
    reference: Frame,
    moved: Frame,
    grid: Grid,
    plan: Plan,
    start: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """Find the motion roughly, from coarse to fine.

    Parameters
    ----------
    reference, moved : Frame
        At full resolution.
    grid : Grid
        Where the start is wanted.
    plan : Plan
    start : array, shape (6, rows, columns), optional
        u, v, u_x, u_y, v_x, v_y at the grid points to begin with; the frames' common shift if not given.

    Returns
    -------
    float64 array, shape (6, rows, columns)
        u, v, u_x, u_y, v_x, v_y at the grid points, without NaN.
    """
    coarse = plan.replace(degree=3, group="affine", reference="first", window=plan.window.plain)
    height, width = reference.image.shape
    top = level_count((height, width), plan)
    if start is None:
        start = grid.plane(np.array([*common_shift(reference, moved), 0, 0, 0, 0]))
    maps, found, finest = start, grid, 0
    for level in range(top, 0, -1):
        small, small_moved = reference.level(level), moved.level(level)
        here = Grid.over(small.image.shape, max(2, round(plan.window.size / 4)))
        maps = finer(maps, found, here, 2.0 ** (finest - level))
        problem, state, known = problem_of(small, small_moved, here, coarse), State(), maps
        for _ in range(LEVEL_PASSES):
            made = problem.step(maps, state)
            state, maps = made.state, settle(made.maps, here.step, plan.window.size)
            if typical(made.moved) < SETTLED:
                break
        # where halving has left no texture, what the level found is noise: keep what was known before
        maps = np.where(made.trusted, maps, known)
        found, finest = here, level
    return finer(maps, found, grid, 2.0**finest) if finest else maps


def finer(maps: NDArray[Any], grid: Grid, target: Grid, factor: float) -> NDArray[np.float64]:
    """Take maps from one level's grid to a grid on a level `factor` times as fine."""
    out = np.empty((6, *target.shape))
    twist = twist_of(maps, grid.step)
    place = (target.x0 / factor, target.y0 / factor, target.step / factor)
    over_strips(
        lambda a, b: resample_strip(maps, twist, grid.origin_and_step, place, a, b, out), target.rows, 16
    )
    out[:2] *= factor
    return out
