"""Mix: the fields of two windows of a ladder blended at every point, as a choice of windows says.

The noise of the coarser of two windows is nearly that part of the finer's which it lets pass: their covariance is that
of the coarser (`sixflow.refine.resolution`),

    C = (1 − t)² C_a + t (2 − t) C_b,       θ = (1 − t) θ_a + t θ_b.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.plan import Window
from sixflow.refine.solution import Solution

Array = NDArray[Any]


@dataclasses.dataclass(frozen=True)
class Mix:
    """(1 − t) of the window `fine`, t of the window `coarse`, at every point."""

    fine: NDArray[np.intp]
    coarse: NDArray[np.intp]
    t: Array

    @classmethod
    def of(cls, chosen: Solution, levels: list[Solution], windows: tuple[Window, ...]) -> Mix:
        """As a choice says by the size of its windows: between the nearest that could be used."""
        sizes = np.log([window.size for window in windows])
        wanted = np.log(np.nan_to_num(chosen.window, nan=float(windows[-1].size)))
        usable = np.stack([~level.failed for level in levels])
        fine = np.full(wanted.shape, -1)
        coarse = fine.copy()
        for k, size in enumerate(sizes):
            fine = np.where(usable[k] & (size <= wanted + 1e-6), k, fine)
        for k in range(len(sizes) - 1, -1, -1):
            coarse = np.where(usable[k] & (sizes[k] >= wanted - 1e-6), k, coarse)
        nearest = np.abs(sizes[:, None, None] - wanted).argmin(axis=0)
        fine = np.where(fine < 0, np.where(coarse < 0, nearest, coarse), fine)
        coarse = np.where(coarse < 0, fine, coarse)
        span = sizes[coarse] - sizes[fine]
        t = np.where(span > 0, np.clip((wanted - sizes[fine]) / np.where(span > 0, span, 1), 0, 1), 0.0)
        return cls(fine, coarse, t)

    @property
    def used(self) -> list[int]:
        """Windows that are blended anywhere."""
        return sorted({*np.unique(self.fine).tolist(), *np.unique(self.coarse[self.t > 0]).tolist()})

    def blend(self, levels: dict[int, Solution]) -> Solution:
        """Blend the fields of the windows that are used."""
        keys = sorted(levels)
        place = np.zeros(max(keys) + 1, np.intp)
        place[keys] = np.arange(len(keys))
        fine = place[self.fine]
        coarse = np.where(self.t > 0, place[np.where(self.t > 0, self.coarse, keys[0])], fine)
        t, ordered = self.t, [levels[k] for k in keys]
        rows, columns = np.indices(t.shape)

        def of(parts: list[Array], weight: Array = t) -> Array:
            stack = np.stack(parts)
            a, b = stack[fine, rows, columns], stack[coarse, rows, columns]
            with np.errstate(invalid="ignore"):  # what one window does not know may be infinite
                return np.where(weight > 0, (1 - weight) * a + weight * b, a).astype(stack.dtype)

        first, weight = ordered[0], t[..., None, None]
        covariances = np.stack([level.covariance for level in ordered])
        a, b = covariances[fine, rows, columns], covariances[coarse, rows, columns]
        with np.errstate(invalid="ignore"):
            covariance = np.where(weight > 0, (1 - weight) ** 2 * a + weight * (2 - weight) * b, a)
        statistics = {}
        for field in dataclasses.fields(first.statistics):
            parts = [getattr(level.statistics, field.name) for level in ordered]
            if any(part is not None for part in parts):
                parts = [np.zeros(t.shape) if part is None else part for part in parts]
                statistics[field.name] = of(parts)
        nearest = np.where(t < 0.5, fine, coarse)
        flags = np.stack([level.flag for level in ordered])
        return first.replace(
            maps=np.stack([of([level.maps[k] for level in ordered]) for k in range(6)]),
            covariance=covariance.astype(covariances.dtype),
            statistics=dataclasses.replace(first.statistics, **statistics),
            left=of([level.left for level in ordered]),
            window=np.exp(of([np.log(level.window) for level in ordered])),
            period=np.exp(of([np.log(level.period) for level in ordered])),
            flag=flags[nearest, rows, columns],
        )
