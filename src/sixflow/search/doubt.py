"""Doubt: points that have settled on what is foreign, tried again from what the others predict.

Where foreign pixels are many and stand still, dust, dead pixels, reflections, a window may settle on what they and a
part of its own pixels have in common. It does not fail, but the pixels that count for it are `NOISY` times as noisy as
usual, or make less than `MINIMUM_WEIGHT` of a window. Such points are begun again from what the others predict. What
was right comes back the same, and a field is taken for another only if fewer of its points have failed or are in
doubt.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sixflow.search.growth import Judged, Scene
from sixflow.validate import MINIMUM_WEIGHT, fill_failed

NOISY = 2.0  # times the usual noise
ROUNDS = 4
MOST = 0.3  # share of the points in doubt beyond which nothing is usual


def reconsidered(found: Judged, scene: Scene) -> Judged:
    """Try points that are in doubt from what the others predict, where some pixels are foreign."""
    found = _settled(found, scene)
    for _ in range(ROUNDS):
        thin = _thin(found)
        if not _may_be_tried(thin):
            break
        again = _settled(_tried_without(thin, found, scene), scene)
        if (again.failed | _thin(again)).sum() >= (found.failed | thin).sum():
            break
        found = again
    return found


def _settled(found: Judged, scene: Scene) -> Judged:
    """Try noisy points as long as they become fewer; the field with the fewest failed and noisy points."""
    best, now, noisy = found, found, _noisy(found)
    for _ in range(ROUNDS):
        if not _may_be_tried(noisy):
            break
        now, before = _tried_without(noisy, now, scene), noisy
        noisy = _noisy(now)
        if noisy.sum() >= before.sum():
            break
        if (now.failed | noisy).sum() < (best.failed | _noisy(best)).sum():
            best = now
    return best


def _may_be_tried(doubtful: NDArray[np.bool_]) -> bool:
    return bool(doubtful.any()) and float(doubtful.mean()) <= MOST


def _tried_without(doubtful: NDArray[np.bool_], found: Judged, scene: Scene) -> Judged:
    """Begin again from what is not in doubt."""
    known = np.where(doubtful | found.failed, np.nan, found.maps)
    return scene.judge(fill_failed(known, scene.grid.step))


def _noisy(found: Judged) -> NDArray[np.bool_]:
    """Points that were measured, with more than `NOISY` times the usual noise; none without foreign pixels."""
    noise, measured = found.quality.noise, ~found.failed
    if found.quality.foreign is None or not measured.any():
        return np.zeros_like(measured)
    with np.errstate(invalid="ignore"):
        noisy: NDArray[np.bool_] = measured & (noise > NOISY * np.median(noise[measured]))
    return noisy


def _thin(found: Judged) -> NDArray[np.bool_]:
    """Points that were measured from less than `MINIMUM_WEIGHT` of a window; none without foreign pixels."""
    if found.quality.foreign is None:
        return np.zeros_like(found.failed)
    with np.errstate(invalid="ignore"):
        thin: NDArray[np.bool_] = ~found.failed & (found.quality.weight < MINIMUM_WEIGHT)
    return thin
