"""Tally: what was measured, added up pair by pair, for the closing lines."""

from __future__ import annotations

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from sixflow.field.dataset import FAILING, FLAGS, SIX

UNUSED = FLAGS["bad_frame"] | FLAGS["repeated"]
"""Flags of pairs that were not measured."""


class Tally:
    """Points, valid points, flags, standard errors and notes of the pairs measured so far.

    `unusable` counts the pairs with a bad frame, `bad` those with a repeated one too.
    """

    def __init__(self) -> None:
        self.pairs = self.bad = self.unusable = self.points = self.valid = 0
        self.flags = dict.fromkeys(FLAGS, 0)
        self.notes: dict[str, None] = {}
        self._errors: list[NDArray[np.float64]] = []

    def add(self, field: xr.Dataset) -> None:
        """Count the field of one more pair, or of several."""
        # plain arrays: a small pair takes less time to measure than labelled arrays take to be compared
        flag = field["flag"].values.astype(np.int64)
        known = (flag & FAILING) == 0
        for name in SIX:
            known &= np.isfinite(field[name].values)
        self.pairs += field.sizes["time"]
        self.bad += int(((flag & UNUSED) != 0).all(axis=(1, 2)).sum())
        self.unusable += int(((flag & FLAGS["bad_frame"]) != 0).all(axis=(1, 2)).sum())
        self.points += known.size
        self.valid += int(known.sum())
        for name, bit in FLAGS.items():
            self.flags[name] += int(np.count_nonzero(flag & bit))
        self.notes.update(dict.fromkeys(field.attrs["notes"].splitlines()))
        variances = np.diagonal(field["covariance"].values, axis1=-2, axis2=-1)[known]
        if "bias" in field:
            variances = variances + np.nan_to_num(field["bias"].values, posinf=np.inf)[known]
        if variances.size:
            self._errors.append(np.median(np.sqrt(variances), axis=0))

    def describe(self, pairs: int, seconds: float) -> str:
        """Return what was measured in a line, and the median standard errors in another.

        Parameters
        ----------
        pairs : int
            Pairs of the whole recording; those that were not counted here were complete before.
        seconds : float
            Time it took.

        Notes
        -----
        The medians of a recording are those of the pairs' medians.
        """
        text = f"{pairs} pair{'s' * (pairs != 1)}"
        if self.pairs < pairs:
            text += f", {self.pairs} of them now"
        if self.pairs:
            masked, wanted = self.flags["masked"], self.points - self.flags["masked"]
            text += f", {self.points:,} points, " + f"{100 * masked / self.points:.1f} % masked, " * (
                masked > 0
            )
            text += f"{100 * self.valid / max(1, wanted):.1f} % {'of the others ' * (masked > 0)}valid"
        if self.bad:
            text += f", {self.bad} pair{'s' * (self.bad != 1)} with a bad or repeated frame"
        text += f", {seconds:.2f} s"
        if self._errors:
            numbers = zip(SIX, np.median(self._errors, axis=0), strict=True)
            parts = [f"{name} {value:.2g}{' px' * (name in 'uv')}" for name, value in numbers]
            text += f"\nmedian standard errors: {', '.join(parts)}"
        return text

    def main_flag(self) -> str:
        """Return the flag that most points have."""
        return max(self.flags, key=lambda name: self.flags[name])
