"""Candidates: large maps on trial at points, found by group correlation, pruned, and measured again.

No pair holds a shift and a turn together, since L_x and L_y do not commute with the linear generators. The first
candidates (`of_pairs`) are therefore motions of one pair each; where they do not do, the shift is looked for
again after every turn and zoom of a coarse lattice (`of_lattice`), near enough for what follows: frame 1 is
warped by the candidate, and what is left is measured by a bank, again and again (`approached`).

The size of a map, and the distance of two, is the root mean square displacement under the window,

    |e|² = u² + v² + σ²(u_x² + u_y² + v_x² + v_y²).
"""

from __future__ import annotations

import itertools
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from large_motion.group_correlation import GroupCorrelation
from large_motion.warped import Neighbourhoods
from sixflow.convention import compose_six, gradient, six_from_coefficients
from sixflow.eigenfilters.geometry import Real
from sixflow.eigenfilters.joint import JointOperator

SETTLED = 0.01
"""Size of a last step, px."""

_TURNS = (-0.52, -0.26, 0.0, 0.26, 0.52)  # rad
_ZOOMS = (-0.2, 0.0, 0.2)  # logarithms
_LONGEST_STEP = 1 / 3  # of σ: the answer of one linear step to more than that is a direction
_SAME = 1 / 4  # of σ: maps closer than this are one
_LEAST_AREA = 0.1  # of det F


class Candidates(NamedTuple):
    """Maps of points.

    Attributes
    ----------
    point : int array, shape (maps,)
        Number of the point.
    six : array, shape (maps, 6)
    origin : int array, shape (maps,)
        −1 if it began with no motion, else the number of the pair in `PAIRS`, or 4 from the lattice.
    correlation : array, shape (maps,)
        ρ; −1 if it is not yet known.
    steps : int array, shape (maps,)
        How often it was measured again.
    """

    point: NDArray[np.int64]
    six: Real
    origin: NDArray[np.int64]
    correlation: Real
    steps: NDArray[np.int64]

    def chosen(self, which: Any) -> Candidates:
        """Some of them, by an index of NumPy."""
        return Candidates(*(part[which] for part in self))

    def best(self, sigma: float, count: int) -> Candidates:
        """The best of each point, no two of which are the same."""
        rows: list[int] = []
        order = np.lexsort((-self.correlation, self.point))
        for _, group in itertools.groupby(order, key=lambda k: int(self.point[k])):
            kept: list[int] = []
            for k in group:
                if len(kept) < count and not self.same(k, kept, sigma).any():
                    kept.append(k)
            rows += kept
        return self.chosen(rows)

    def same(self, k: int, others: Any, sigma: float) -> NDArray[np.bool_]:
        """Whether others are the same map as the k-th."""
        return size_of(self.six[others] - self.six[k], sigma) <= _SAME * sigma


def new_candidates(point: NDArray[np.int64], six: Real, origin: int) -> Candidates:
    """Maps of which nothing is known yet."""
    count = len(point)
    return Candidates(
        point, six, np.full(count, origin), np.full(count, -1.0), np.zeros(count, dtype=np.int64)
    )


def joined(*parts: Candidates) -> Candidates:
    """All of several."""
    return Candidates(*(np.concatenate(part) for part in zip(*parts, strict=True)))


def size_of(six: Real, sigma: float) -> Real:
    """Root mean square displacement of maps, shape (..., 6), under the window, px."""
    result: Real = np.sqrt(
        (six[..., :2] ** 2).sum(axis=-1) + sigma**2 * (gradient(six) ** 2).sum(axis=(-2, -1))
    )
    return result


def of_pairs(near: Neighbourhoods, correlations: tuple[GroupCorrelation, ...], count: int) -> Candidates:
    """No motion, and the `count` highest summits of each pair."""
    rest = np.zeros((len(near.x), 6))
    points = np.arange(len(rest))
    found = [new_candidates(points, rest, -1)]
    for origin, pair in enumerate(correlations):
        six = pair.summits(pair.surface(near, rest), count)
        found += [new_candidates(points, six[:, k], origin) for k in range(count)]
    return joined(*found)


def of_lattice(near: Neighbourhoods, shifts: GroupCorrelation, origin: int, count: int) -> Candidates:
    """The `count` highest summits of the shift after each turn and zoom of the lattice."""
    points = np.arange(len(near.x))
    found = []
    for turn, zoom in itertools.product(_TURNS, _ZOOMS):
        first = np.broadcast_to(six_from_coefficients([0, 0, zoom, turn, 0, 0]), (len(points), 6))
        six = shifts.summits(shifts.surface(near, first), count)
        found += [new_candidates(points, compose_six(first, six[:, k]), origin) for k in range(count)]
    return joined(*found)


def compared(near: Neighbourhoods, candidates: Candidates, radius: int, degree: int) -> Candidates:
    """The candidates with their correlations."""
    found = near.warped(candidates.point, candidates.six, radius, degree)
    return candidates._replace(correlation=found.correlation)


def approached(
    near: Neighbourhoods, candidates: Candidates, operator: JointOperator, steps: int, degree: int
) -> Candidates:
    """Every candidate after up to `steps` steps of warping and measuring what is left, by an operator.

    What is kept is the best map that was met on the way. A step is shortened to a third of σ.
    """
    six, counts = candidates.six.copy(), candidates.steps.copy()
    best, correlation = six.copy(), np.full(len(six), -1.0)
    active = np.arange(len(six))
    for step in range(steps + 1):
        found = near.warped(candidates.point[active], six[active], operator.bank.radius, degree)
        better = found.correlation > correlation[active]
        best[active[better]] = six[active[better]]
        correlation[active[better]] = found.correlation[better]
        if step == steps:
            break
        left = np.nan_to_num(operator.estimate_patches(found.still, found.moved).six)
        size = size_of(left, near.sigma)
        left *= np.minimum(1, _LONGEST_STEP * near.sigma / np.maximum(size, SETTLED))[:, None]
        six[active] = compose_six(six[active], left)
        counts[active] += 1
        area = np.linalg.det(np.eye(2) + gradient(six[active]))
        active = active[(area > _LEAST_AREA) & (size > SETTLED)]
        if not active.size:
            break
    return candidates._replace(six=best, correlation=correlation, steps=counts)
