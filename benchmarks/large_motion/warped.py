"""Neighbourhoods of points: frame 1 warped back onto frame 0 by a map for each point, and how well they match.

About the point p the map is x' = p + d + F(x − p), F = I + G. At the offset o from the point I₁(p + d + F o) belongs to
I₀(p + o). Under the window's Gaussian w their match is the zero-normalised correlation

    ρ = Σ w (I₀ − Ī₀)(I₁ − Ī₁) / √(Σ w (I₀ − Ī₀)² Σ w (I₁ − Ī₁)²).

A pixel without a partner, outside one of the frames, is not counted in ρ. In the warped patch the grey value of
frame 0, in the light of frame 1 (the regression of I₁ on I₀), stands in for it: it says nothing against the map.

| symbol | name |
|---|---|
| I₀, I₁ | `still`, `moved` |
| ρ | `correlation` |
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from sixflow.convention import gradient
from sixflow.eigenfilters.geometry import Real, patch
from sixflow.engine.spline import PAD, spline_coefficients

_ROUNDING = 1e-10


class Spline:
    """A frame between its pixels.

    Parameters
    ----------
    frame : array, shape (height, width)
        Finite.
    """

    def __init__(self, frame: Real) -> None:
        self.shape = frame.shape
        self._coefficients = {degree: spline_coefficients(frame, degree) for degree in (3, 5)}

    def at(
        self, x: Real, y: Real, six: Real, offsets: tuple[Real, Real], degree: int
    ) -> tuple[Real, NDArray[np.bool_]]:
        """Grey values at the places to which the maps of points take offsets from them.

        Parameters
        ----------
        x, y : arrays, shape (points,)
            px.
        six : array, shape (points, 6)
            Their maps.
        offsets : two arrays, shape (n,)
            x and y from the point, px.
        degree : {3, 5}
            Of the spline.

        Returns
        -------
        values : array, shape (points, n)
        inside : bool array, shape (points, n)
            Whether the place is in the frame; elsewhere the frame's nearest pixel stands.
        """
        (height, width), (dx, dy) = self.shape, offsets
        G = gradient(six)[..., None]
        at_x = (x + six[:, 0])[:, None] + dx + G[:, 0, 0] * dx + G[:, 0, 1] * dy
        at_y = (y + six[:, 1])[:, None] + dy + G[:, 1, 0] * dx + G[:, 1, 1] * dy
        inside = (at_x >= 0) & (at_x <= width - 1) & (at_y >= 0) & (at_y <= height - 1)
        place = np.stack([np.clip(at_y, 0, height - 1), np.clip(at_x, 0, width - 1)]) + PAD
        values = map_coordinates(
            self._coefficients[degree], place, order=degree, prefilter=False, mode="nearest"
        )
        return values, inside


class Warped(NamedTuple):
    """Patches of both frames on the pixels of frame 0, shape (maps, n²) row by row, and what they say.

    Attributes
    ----------
    still, moved : arrays
        Grey values.
    counted : bool array
        Which pixels have a partner.
    correlation : array, shape (maps,)
        ρ; −1 where there is no contrast.
    weight : array, shape (maps,)
        Part of the window's weight on pixels that are counted.
    """

    still: Real
    moved: Real
    counted: NDArray[np.bool_]
    correlation: Real
    weight: Real


class Neighbourhoods:
    """Windows about points of frame 0, onto which frame 1 is warped.

    Parameters
    ----------
    frame0, frame1 : Spline
    x, y : arrays, shape (points,)
        px.
    sigma : float
        Of the window, px.
    """

    def __init__(self, frame0: Spline, frame1: Spline, x: Real, y: Real, sigma: float) -> None:
        self.frame0, self.frame1, self.x, self.y, self.sigma = frame0, frame1, x, y, sigma
        self._still: dict[tuple[int, int], tuple[Real, NDArray[np.bool_]]] = {}

    def part(self, points: NDArray[np.int64]) -> Neighbourhoods:
        """Those of some of the points."""
        return Neighbourhoods(self.frame0, self.frame1, self.x[points], self.y[points], self.sigma)

    def window(self, radius: int) -> Real:
        """The Gaussian w on a patch of a radius, normalised; shape (n²,)."""
        dx, dy = patch(radius)
        w: Real = np.exp(-(dx * dx + dy * dy) / (2 * self.sigma**2))
        return w / w.sum()

    def still(self, radius: int, degree: int) -> tuple[Real, NDArray[np.bool_]]:
        """Patches of frame 0 about all points, and which of their pixels are in the frame."""
        if (radius, degree) not in self._still:
            rest = np.zeros((len(self.x), 6))
            self._still[radius, degree] = self.frame0.at(self.x, self.y, rest, patch(radius), degree)
        return self._still[radius, degree]

    def warped(self, point: NDArray[np.int64], six: Real, radius: int, degree: int) -> Warped:
        """Patches under the maps `six`, shape (maps, 6), of the points with the numbers `point`."""
        all_still, all_within = self.still(radius, degree)
        still, within = all_still[point], all_within[point]
        moved, inside = self.frame1.at(self.x[point], self.y[point], six, patch(radius), degree)
        counted = within & inside
        w = self.window(radius) * counted
        weight = w.sum(axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            mean0, mean1 = ((w * part).sum(axis=1) / weight for part in (still, moved))
            a, b = still - mean0[:, None], moved - mean1[:, None]
            aa, bb, ab = ((w * p * q).sum(axis=1) for p, q in ((a, a), (b, b), (a, b)))
            seen = (aa > _contrastless(still)) & (bb > _contrastless(moved))
            correlation = np.where(seen, ab / np.sqrt(aa * bb), -1.0)
            gain = np.where(seen, ab / aa, 0.0)
        lit = np.nan_to_num(mean1)[:, None] + gain[:, None] * np.nan_to_num(a)
        return Warped(still, np.where(counted, moved, lit), counted, correlation, weight)

    def details(self, radius: int) -> Real:
        """Number N of independent details under the window about each point.

        window² times the part of the spectrum that the pattern fills, 2 (ΣS)²/(n ΣS²) with the power S of the
        windowed patch at n frequencies (2, since a sample of a spectrum varies as much as it is large), less where
        few bright details outweigh the others: times 3 over the kurtosis. Unrelated patterns have correlations
        of about 1/√N.
        """
        still, _ = self.still(radius, 5)
        w, floor = self.window(radius), _contrastless(still)
        still = still - (w * still).sum(axis=1, keepdims=True)
        side = 2 * radius + 1
        S = np.abs(np.fft.fft2((w * still).reshape(-1, side, side), (2 * side, 2 * side))) ** 2
        with np.errstate(invalid="ignore", divide="ignore"):
            filled = 2 * S.mean(axis=(1, 2)) ** 2 / (S**2).mean(axis=(1, 2))
            kurtosis = (w * still**4).sum(axis=1) / (w * still**2).sum(axis=1) ** 2
            count = 4 * np.pi * self.sigma**2 * filled * 3 / kurtosis
        return np.where((w * still**2).sum(axis=1) > floor, count, 0.0)


def _contrastless(patches: Real) -> Real:
    """Variance that rounding may leave of patches without contrast."""
    result: Real = (_ROUNDING * np.abs(patches).max(axis=1, initial=0.0)) ** 2
    return result
