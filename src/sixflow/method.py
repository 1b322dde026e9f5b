"""Method: how two frames are compared, as a plan asks for it."""

from __future__ import annotations

from sixflow.maps.grid import Grid
from sixflow.plan import Plan
from sixflow.prepare.frame import Frame
from sixflow.refine.least_squares import LeastSquares
from sixflow.refine.problem import Problem


def problem_of(still: Frame, moved: Frame, grid: Grid, plan: Plan) -> Problem:
    """Return the problem of a plan's method; operators are loaded when they are asked for.

    Parameters
    ----------
    still, moved : Frame
        Frame 0 and frame 1, or the other way round.
    grid : Grid
    plan : Plan
    """
    if plan.method == "eigenfilter":
        from sixflow.eigenfilters.problem import EigenfilterProblem

        return EigenfilterProblem(still, moved, grid, plan)
    return LeastSquares(still, moved, grid, plan)
