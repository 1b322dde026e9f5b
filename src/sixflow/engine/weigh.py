"""Weigh: low weight for pixels whose residual is far beyond what noise and the fit explain.

A pixel's residual r is compared with the typical one around it,

    s² = s₀² + (e |g|)² + (b D)²,      t = |r| / s,      ω = 1 for t ≤ 3.5, 0 for t ≥ 5, (25 − t²)/(25 − 3.5²) between,

and the least weight of the pixel and its eight neighbours counts, because what does not belong there, an unmatched
particle or a glint, is larger than a pixel. Gaussian noise keeps 0.995 of its weight.

| symbol | meaning |
|---|---|
| r, g | residual and gradient of `warp` |
| D | ∣I₀ + r/2 − m∣, brightness above the background m |
| s₀, e, b, m | noise, displacement that the fit leaves, px, share by which brightness changes, background: `scales` |

Of Gaussian noise 6e-7 is beyond 5 s. To leave out all pixels in doubt as well, beyond 3.5 s, would find no more of what
is outlying, and cut into motions that are not resolved. The second term of s is what keeps the fit linear: where
windows do not resolve the motion, steep pixels have large residuals, all of them, and none is an outlier. The third is
what keeps it linear where particles fade and flicker: bright pixels have large residuals then, and to leave them out
would cut particle images into parts, of which each alone tells a motion that the whole does not.

The estimate is an M-estimate with ψ = ω r. Its covariance is the sandwich with Σ w ψ' J Jᵀ for bread, not Σ w ω J Jᵀ,
and where ω falls ψ' is below ω by (2 t²)/(5² − 3.5²): pixels that are neither in nor out add noise. `weighing_noise`
is the factor (mean ω / mean ψ')², which is 1 without outlying pixels.

What is left out lowers the residual in any case. If the information that it takes along is worth more, plain least
squares is the better estimate: `largest_gain` is what weights make of the variance, Σ r²g²/(Σ g²)² over
Σ ω²r²g²/(Σ ω g²)², in blocks of 64 × 64 px. A speck of dust in one of them makes more than `LEAST_GAIN`. Particles of a
pixel, which interpolation does not get right, or 40 % of lost ones beside others that flicker, do not, in any block.

Frames without anything in common keep pixels too: those that are alike by chance. Of two independent Gaussian patterns
of contrast C a pixel is kept with the probability P(|r| < 3.5 s) = erf(3.5 s/2C), r having the variance 2C², and only
where its neighbours are, which count as three independent ones at least. A window tells nothing where no more of its
Σ w |g|² is kept than `by_chance`,

    κ = erf(3.5 ρ/2)³,     ρ: residual over contrast of the pixels that are kept, for s/C.

Where moments are summed (`sweep.moment_strip`), gradient, right-hand side and residual are multiplied by √ω: the normal
equations then have ω, the sandwich ω². A pixel with almost no weight has none, like one without a partner.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.compiler import kernel
from sixflow.engine.scales import NEGLIGIBLE, TILE, scales_of
from sixflow.engine.threads import over_strips

FULL, NONE = 3.5, 5.0
"""Standard deviations up to which a pixel keeps its weight, and where it has lost it: beyond are 5e-4 and 6e-7 of
Gaussian noise.
"""
ALIKE = 3
"""Independent pixels among a pixel and its eight neighbours, at least."""
BLOCK = 64
"""px: side of the blocks in which weights are judged."""
LEAST_GAIN = 2.0
"""Of the variance, in any block: what twice as many pixels would gain. Below, plain least squares stands."""
TYPICAL = 0.98
"""Of the blocks have to stay: pixels in doubt change sides for ever in a few of them."""
_ROUNDS = 2
"""Times that weights are found from one residual: scales without the pixels that the first time left out."""
_STRIP = 64


@kernel
def _between(position: float, count: int) -> tuple[int, int, float]:
    """Tiles before and after a pixel, and its fraction of the way between their centres."""
    place = min(max((position + 0.5) / TILE - 0.5, 0.0), count - 1.0)
    first = int(place)
    return first, min(first + 1, count - 1), place - first


@kernel
def raw_weights_strip(
    residual: NDArray[Any], gradient_x: NDArray[Any], gradient_y: NDArray[Any], still: NDArray[Any],
    scales: NDArray[Any], start: int, stop: int, weight: NDArray[Any],
) -> None:  # fmt: skip
    """ω of every pixel by itself, rows start … stop; 1 where a pixel has no partner.

    `scales` is (4, tile rows, tile columns), from `scales_of`.
    """
    width = residual.shape[1]
    one, zero = residual.dtype.type(1), residual.dtype.type(0)
    line = np.empty((4, scales.shape[2]))
    for y in range(start, stop):
        above, below, f = _between(y, scales.shape[1])
        for k in range(4):
            for i in range(scales.shape[2]):
                line[k, i] = (1 - f) * scales[k, above, i] + f * scales[k, below, i]
        r, gx, gy, grey, out = residual[y], gradient_x[y], gradient_y[y], still[y], weight[y]
        for x in range(width):
            left, right, h = _between(x, scales.shape[2])
            noise = (1 - h) * line[0, left] + h * line[0, right]
            misfit = (1 - h) * line[1, left] + h * line[1, right]
            change = (1 - h) * line[2, left] + h * line[2, right]
            bright = grey[x] + r[x] / 2 - ((1 - h) * line[3, left] + h * line[3, right])
            allowed = noise * noise + misfit * misfit * (gx[x] * gx[x] + gy[x] * gy[x])
            allowed += change * change * bright * bright
            square = r[x] * r[x]
            if not square > FULL * FULL * allowed:
                out[x] = one
            elif square >= NONE * NONE * allowed:
                out[x] = zero
            else:
                out[x] = (NONE * NONE - square / allowed) / (NONE * NONE - FULL * FULL)


@kernel
def spread_strip(raw: NDArray[Any], start: int, stop: int, weight: NDArray[Any]) -> None:
    """Least of the weights of a pixel and its eight neighbours, rows start … stop."""
    height, width = raw.shape
    column = np.empty(width, raw.dtype)
    for y in range(start, stop):
        a, b, c, out = raw[max(y - 1, 0)], raw[y], raw[min(y + 1, height - 1)], weight[y]
        for x in range(width):
            column[x] = min(a[x], min(b[x], c[x]))
        for x in range(1, width - 1):
            out[x] = min(column[x - 1], min(column[x], column[x + 1]))
        out[0] = min(column[0], column[min(1, width - 1)])
        out[width - 1] = min(column[width - 1], column[max(width - 2, 0)])


@kernel
def changes_strip(
    before: NDArray[Any], weight: NDArray[Any], gradient_x: NDArray[Any], gradient_y: NDArray[Any],
    start: int, stop: int, sums: NDArray[Any],
) -> None:  # fmt: skip
    """Σ |change of ω| |g|² and Σ |g|² of the blocks of rows start … stop; `sums` is (2, block rows, block columns)."""
    height, width = weight.shape
    for j in range(start, stop):
        for i in range(sums.shape[2]):
            change, power = 0.0, 0.0
            for y in range(j * BLOCK, min((j + 1) * BLOCK, height)):
                for x in range(i * BLOCK, min((i + 1) * BLOCK, width)):
                    square = gradient_x[y, x] ** 2 + gradient_y[y, x] ** 2
                    if square == square:
                        change += abs(weight[y, x] - before[y, x]) * square
                        power += square
            sums[0, j, i], sums[1, j, i] = change, power


def _typical_change(
    before: NDArray[Any], weight: NDArray[Any], gradient_x: NDArray[Any], gradient_y: NDArray[Any]
) -> float:
    """Share of a block's Σ |g|² that a change of weights moves, which `TYPICAL` of the blocks do not exceed."""
    height, width = weight.shape
    sums = np.empty((2, -(-height // BLOCK), -(-width // BLOCK)))
    over_strips(
        lambda a, b: changes_strip(before, weight, gradient_x, gradient_y, a, b, sums), sums.shape[1], 1
    )
    return float(np.quantile(sums[0] / np.maximum(sums[1], np.finfo(np.float64).tiny), TYPICAL))


@kernel
def gains_strip(
    residual: NDArray[Any], gradient_x: NDArray[Any], gradient_y: NDArray[Any], weight: NDArray[Any],
    start: int, stop: int, gains: NDArray[Any],
) -> None:  # fmt: skip
    """Factor by which weights lower the variance, of the blocks of rows start … stop; the last take what is left."""
    height, width = residual.shape
    rows, columns = gains.shape
    for j in range(start, stop):
        bottom = height if j == rows - 1 else (j + 1) * BLOCK
        for i in range(columns):
            right = width if i == columns - 1 else (i + 1) * BLOCK
            noise, power, noise_left, power_left = 0.0, 0.0, 0.0, 0.0
            for y in range(j * BLOCK, bottom):
                for x in range(i * BLOCK, right):
                    r = residual[y, x]
                    if r == r:
                        square = gradient_x[y, x] ** 2 + gradient_y[y, x] ** 2
                        w = weight[y, x] if weight[y, x] >= NEGLIGIBLE else 0.0
                        noise += r * r * square
                        power += square
                        noise_left += w * w * r * r * square
                        power_left += w * square
            known = noise_left > 0 and power > 0
            gains[j, i] = noise / noise_left * (power_left / power) ** 2 if known else 1.0


def largest_gain(
    residual: NDArray[Any], gradient_x: NDArray[Any], gradient_y: NDArray[Any], weight: NDArray[Any]
) -> float:
    """Factor by which weights lower the variance Σ ω²r²g²/(Σ ω g²)², of the block that gains most."""
    height, width = residual.shape
    gains = np.empty((max(1, height // BLOCK), max(1, width // BLOCK)))
    over_strips(
        lambda a, b: gains_strip(residual, gradient_x, gradient_y, weight, a, b, gains), len(gains), 1
    )
    return float(gains.max())


def weight_slope(raw: NDArray[Any], weight: NDArray[Any]) -> NDArray[Any]:
    """R dω/dr of every pixel: 0 where ω is 0 or 1, or is that of a neighbour."""
    span = NONE**2 - FULL**2
    between = (weight >= NEGLIGIBLE) & (weight < 1) & (weight == raw)
    return np.where(between, 2 * (weight - NONE**2 / span), 0).astype(weight.dtype)


def weighing_noise(kept: NDArray[Any], slope: NDArray[Any]) -> NDArray[Any]:
    """Factor of the covariance from window means of ω and r dω/dr, at most 9; shape (…, 1, 1)."""
    return ((kept / np.maximum(kept + slope, kept / 3)) ** 2)[..., None, None]


def by_chance(residual: NDArray[Any]) -> NDArray[np.float64]:
    """κ of ρ: what patterns without anything in common could keep of their gradients' power.

    Examples
    --------
    >>> by_chance(np.array([0.05, 0.5])).round(3)
    array([0.001, 0.482])
    """
    from scipy.special import erf

    return np.asarray(erf(FULL / 2 * residual) ** ALIKE, dtype=np.float64)


def find_weights(
    residual: NDArray[Any], gradient_x: NDArray[Any], gradient_y: NDArray[Any], still: NDArray[Any],
    raw: NDArray[Any], weight: NDArray[Any], stays: float = 0.0,
) -> float:  # fmt: skip
    """Find ω of every pixel.

    Parameters
    ----------
    residual, gradient_x, gradient_y : arrays, shape (height, width)
        From `warp`; the residual is NaN where a pixel has no partner, and nothing there counts.
    still : array, shape (height, width)
        The reference as it was compared.
    raw : array, shape (height, width)
        Receives the weight of every pixel by itself.
    weight : array, shape (height, width)
        ω as found before, 1 to begin with. Receives ω; 1 where a pixel has no partner.
    stays : float
        Share of the information below which a change of weights is none.

    Returns
    -------
    float
        Share of the information, Σ |g|² of a block of 64 × 64 px, that changed; `TYPICAL` of the blocks changed less.
    """
    height, first = residual.shape[0], weight.copy()
    for _ in range(_ROUNDS):
        before = weight.copy()
        scales = scales_of(residual, gradient_x, gradient_y, still, weight)
        over_strips(
            lambda a, b, scales=scales: raw_weights_strip(  # type: ignore[misc]
                residual, gradient_x, gradient_y, still, scales, a, b, raw
            ),
            height,
            _STRIP,
        )
        over_strips(lambda a, b: spread_strip(raw, a, b, weight), height, _STRIP)
        if _typical_change(before, weight, gradient_x, gradient_y) <= stays:
            break
    return _typical_change(first, weight, gradient_x, gradient_y)
