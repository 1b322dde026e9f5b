"""Doubt: points that rest on few pixels of their window, tried again from what the others predict.

Where outlying pixels are many and stand still, dust, dead pixels, reflections, a window may settle on what they have in
common with a few of its own pixels. It does not fail, but less than `MINIMUM_WEIGHT` of a window is left to it. Such
points are begun again from what the others predict. What was right comes back the same, and a field is taken for
another only if fewer of its points have failed or are in doubt.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sixflow.maps.neighbours import fill_failed
from sixflow.refine.problem import MINIMUM_WEIGHT
from sixflow.refine.solution import Solution
from sixflow.search.growth import Scene

ROUNDS = 4
MOST = 0.3  # share of the points in doubt beyond which the others are too few to predict


def reconsidered(found: Solution, scene: Scene) -> Solution:
    """Try points that are in doubt from what the others predict."""
    for _ in range(ROUNDS):
        doubtful = _doubtful(found)
        if not doubtful.any() or doubtful.mean() > MOST:
            break
        known = np.where(doubtful | found.failed, np.nan, found.maps)
        again = scene.judge(fill_failed(known, scene.grid.step))
        if (again.failed | _doubtful(again)).sum() >= (found.failed | doubtful).sum():
            break
        found = again
    return found


def _doubtful(found: Solution) -> NDArray[np.bool_]:
    """Points that were measured from little of their window; none where no pixel is outlying."""
    if found.statistics.outlying is None:
        return np.zeros_like(found.failed)
    with np.errstate(invalid="ignore"):
        doubtful: NDArray[np.bool_] = ~found.failed & (found.statistics.weight < MINIMUM_WEIGHT)
    return doubtful
