"""Bias: kernels that tell from the windows of a ladder what each of them leaves out (`sixflow.refine.bias`).

Planes of a band, the difference d of two windows, at every grid point where both are known:

    1,  d²/V of the six,  1/V of the six,  the sum of 1/V² of u and v,  and of the other four

with V the variance of the finer window's. Points count by 1/V, so that where there is hardly any texture tells little.

| symbol | name |
|---|---|
| d | `difference` |
| K | `smooth_strip` |
| N, E | `noise`, `energy` |
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.compiler import kernel

PLANES = 15
LEAST_SQUARE = 1e-3
"""Of d² over its variance, in logarithms."""
CUT, OUTLINED = 1, 2
"""What cuts a window: a border of the frames, or anything inside."""
LEAST_VARIANCE = 1e-14
"""Of frames without noise: 1/V² stays a number."""


@kernel
def difference_strip(
    fine: tuple[Any, Any, Any], coarse: NDArray[Any], sigma: float, known: NDArray[Any], start: int, stop: int,
    difference: NDArray[Any], planes: NDArray[Any],
) -> None:  # fmt: skip
    """Differences of the six of two windows, and the planes of their band, rows start … stop.

    `fine` is the finer window's maps (6, rows, columns), covariance, and what its passes may have left; `coarse` the
    coarser's maps, `sigma` the finer's σ.
    """
    maps, covariance, left = fine
    for j in range(start, stop):
        for i in range(known.shape[1]):
            d, plane = difference[j, i], planes[j, i]
            if not known[j, i]:
                for k in range(6):
                    d[k] = math.nan
                for k in range(plane.size):
                    plane[k] = 0.0
                continue
            d[0], d[1] = maps[0, j, i] - coarse[0, j, i], maps[1, j, i] - coarse[1, j, i]
            xx, xy = maps[2, j, i] - coarse[2, j, i], maps[3, j, i] - coarse[3, j, i]
            yx, yy = maps[4, j, i] - coarse[4, j, i], maps[5, j, i] - coarse[5, j, i]
            d[2], d[3], d[4], d[5] = xx + yy, yx - xy, xx - yy, xy + yx
            plane[0], plane[13], plane[14] = 1.0, 0.0, 0.0
            rest = left[j, i] * left[j, i] if math.isfinite(left[j, i]) else 0.0
            for k in range(6):
                own = covariance[j, i, k, k] + (rest / 2 if k < 2 else rest / (4 * sigma * sigma))
                weight = 1 / max(own, LEAST_VARIANCE)
                plane[1 + k], plane[7 + k] = d[k] * d[k] * weight, weight
                plane[13 if k < 2 else 14] += weight * weight


@kernel
def smooth_strip(planes: NDArray[Any], half: NDArray[Any], start: int, stop: int, out: NDArray[Any]) -> None:
    """Sum planes (rows, columns, planes) under the same symmetric weights along both axes; 0 beyond the border."""
    rows, columns, count = planes.shape
    reach, n = half.size - 1, columns * count
    flat, into = planes.reshape((rows, n)), out.reshape((rows, n))
    line = np.zeros(n + 2 * reach * count, planes.dtype)
    middle = line[reach * count : reach * count + n]
    for j in range(start, stop):
        here = flat[j]
        for x in range(n):
            middle[x] = half[0] * here[x]
        for k in range(1, reach + 1):
            weight = half[k]
            for y in (j - k, j + k):
                if 0 <= y < rows:
                    row = flat[y]
                    for x in range(n):
                        middle[x] += weight * row[x]
        target = into[j]
        for x in range(n):
            target[x] = half[0] * middle[x]
        for k in range(1, reach + 1):
            weight = half[k]
            before, after = line[(reach - k) * count :], line[(reach + k) * count :]
            for x in range(n):
                target[x] += weight * (before[x] + after[x])


@kernel
def log_strip(planes: NDArray[Any], law: NDArray[Any], start: int, stop: int, out: NDArray[Any]) -> None:
    """Of the planes of a band 1, and ln of the mean of d²/f V of u and v, and of the other four, rows start … stop."""
    for j in range(start, stop):
        for i in range(planes.shape[1]):
            plane = planes[j, i]
            out[j, i, 0] = plane[0]
            translation = (plane[1] + plane[2]) / (2 * law[0, 0])
            gradient = (plane[3] + plane[4] + plane[5] + plane[6]) / (4 * law[1, 0])
            out[j, i, 1] = plane[0] * math.log(max(translation, LEAST_SQUARE))
            out[j, i, 2] = plane[0] * math.log(max(gradient, LEAST_SQUARE))


@kernel
def energy_strip(
    band: tuple[Any, Any, Any, Any], above: NDArray[Any], cut: NDArray[Any], law: NDArray[Any], start: int, stop: int,
    noise: NDArray[Any], energy: NDArray[Any],
) -> None:  # fmt: skip
    """N and E of a band from its planes, the same smoothed, and E of the next coarser band, rows start … stop.

    `band` is the planes, their sums under K, those of `log_strip` under k, and an array for K V; N is the greater of
    f K V and f V. `law` has a row for the displacement and one for the gradient: f, the square of what chance adds to
    1, over z², the share of the coarser band's E that is expected, its factor where the window is cut, z, z there, and
    the most that chance takes from a mean logarithm under k; `above` is 0 for the first band.
    """
    planes, sums, near, mean = band
    for j in range(start, stop):
        for i in range(cut.shape[1]):
            total = sums[j, i, 0]
            known = total > 1e-6
            for kind in range(2):
                first, last = (0, 2) if kind == 0 else (2, 6)
                f, chance, share, z = law[kind, 0], law[kind, 1], law[kind, 2], law[kind, 4]
                if cut[j, i]:
                    share *= law[kind, 3]
                    z = law[kind, 5]
                found, of_noise, coarser, squares = 0.0, 0.0, 0.0, 0.0
                for k in range(first, last):
                    coarser += above[j, i, k]
                    noise[j, i, k] = mean[j, i, k] = math.nan
                    if known:
                        weights = sums[j, i, 7 + k]
                        mean[j, i, k] = total / weights
                        noise[j, i, k] = f * mean[j, i, k]
                        of_noise += noise[j, i, k]
                        found += sums[j, i, 1 + k] / weights - noise[j, i, k] - share * above[j, i, k]
                        squares += weights * weights
                part = 0.0
                if known:
                    varied = max(total * sums[j, i, 13 + kind] / squares - 1, 0.0)
                    doubt = of_noise * of_noise * (chance + varied)
                    if found != 0:
                        part = max(0.0, 1 - z * z * doubt / (found * found))
                    if coarser > 0:
                        part = max(part, coarser * coarser / (coarser * coarser + doubt))
                most = math.inf
                if near[j, i, 0] > 1e-6 and cut[j, i] < OUTLINED:
                    most = math.exp(near[j, i, 1 + kind] / near[j, i, 0] + law[kind, 6]) - 1
                for k in range(first, last):
                    expected = share * above[j, i, k]
                    if known:
                        gap = sums[j, i, 1 + k] / sums[j, i, 7 + k] - noise[j, i, k] - expected
                        expected = max(0.0, expected + part * gap)
                        if planes[j, i, 0] > 0:
                            noise[j, i, k] = max(noise[j, i, k], f / planes[j, i, 7 + k])
                        expected = min(expected, max(share * above[j, i, k], most * noise[j, i, k]))
                    energy[j, i, k] = expected


@kernel
def left_out_strip(
    bands: tuple[Any, Any, Any], correlation: NDArray[Any], beyond: NDArray[Any], start: int, stop: int,
    expected: NDArray[Any], seen: NDArray[Any],
) -> None:  # fmt: skip
    """Expected square of what every level leaves out, and the same given the point's differences; rows start … stop.

    `bands` are E, N and d, each (bands, rows, columns · 6), from fine to coarse. Beyond the finest, each band has the
    share q of the energy of the one before, as the two finest have, but within the two limits of `beyond`.
    """
    energies, noises, differences = bands
    count, _, n = energies.shape
    root, rest = np.empty((count, n), energies.dtype), np.empty((count, n), energies.dtype)
    weight, mean, doubt = np.empty_like(root[0]), np.empty_like(root[0]), np.empty_like(root[0])
    following = correlation[1] if correlation.size > 1 else 0.0
    for j in range(start, stop):
        for b in range(count):
            energy, noise, d = energies[b, j], noises[b, j], differences[b, j]
            for x in range(n):
                part = energy[x] / (energy[x] + noise[x])
                weight[x] = part if part > 0 and d[x] == d[x] else 0.0  # NaN is not
            if b == 0:
                whole, known = expected[0, j], seen[0, j]
                coarser = energies[min(1, count - 1), j]
                for x in range(n):
                    q = energy[x] / coarser[x] if coarser[x] > 0 else beyond[1]
                    q = min(max(q, beyond[0]), beyond[1])
                    a = following * math.sqrt(q)
                    follows = a / (1 - a)
                    whole[x] = energy[x] * q / (1 - q) * (1 + 2 * follows)
                    mean[x] = weight[x] * follows * d[x] if weight[x] > 0 else 0.0
                    doubt[x] = max(whole[x] - follows * follows * energy[x] * weight[x], 0.0)
                    known[x] = mean[x] * mean[x] + doubt[x]
            before, whole, known = expected[b, j], expected[b + 1, j], seen[b + 1, j]
            own, left = root[b], rest[b]
            for x in range(n):
                mean[x] += weight[x] * d[x] if weight[x] > 0 else 0.0
                own[x], left[x] = math.sqrt(energy[x]), math.sqrt(energy[x] * (1 - weight[x]))
                whole[x] = before[x] + energy[x]
                doubt[x] += left[x] * left[x]
            for c in range(b):
                factor, other, other_left = 2 * correlation[b - c], root[c], rest[c]
                for x in range(n):
                    whole[x] += factor * own[x] * other[x]
                    doubt[x] += factor * left[x] * other_left[x]
            for x in range(n):
                known[x] = mean[x] * mean[x] + doubt[x]
