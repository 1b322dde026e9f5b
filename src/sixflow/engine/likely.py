"""Likely: the covariance of a solution from what its window sums, where texture and noise fill the window evenly.

It takes the place of the sandwich (`solve`) where windows are compared with each other: no square of one is summed.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.compiler import kernel
from sixflow.engine.solve import LANES, assemble, cholesky, cholesky_solve


@kernel
def likely_strip(
    moments: NDArray[Any], noise_gradient: NDArray[Any], power: NDArray[Any], sigma: float, start: int, stop: int,
    out: NDArray[Any],
) -> None:  # fmt: skip
    """Covariance of the six numbers if noise and texture are the same everywhere in a window, grid rows start … stop.

    The square of the window is one of σ/√2 times 1/(4πσ²). Where the texture fills the window evenly its moments are
    those of the window itself, halved by X² or Y², and the covariance becomes p/(4πσ²) H̃⁻¹, p the residual's power,
    with half of that for the gradients.

    Parameters
    ----------
    moments, noise_gradient
        As for `covariance_strip`.
    power : array, shape (rows, columns)
        p, Σ w r²|g|² / Σ w |g|².
    sigma : float
    out : array, shape (rows, columns, 6, 6)
    """
    full, unit = np.empty((6, 6, LANES)), np.empty((6, LANES))
    inverse = np.empty((6, 6, LANES))
    columns = moments.shape[1]
    for j in range(start, stop):
        for first in range(0, columns, LANES):
            assemble(moments, j, first, full)
            for lane in range(LANES):
                gamma = noise_gradient[j, min(first + lane, columns - 1)]
                for k in range(6):
                    full[k, k, lane] -= gamma
            cholesky(full)
            for k in range(6):
                for n in range(6):
                    for lane in range(LANES):
                        unit[n, lane] = 1.0 if n == k else 0.0
                cholesky_solve(full, unit)
                for n in range(6):
                    for lane in range(LANES):
                        inverse[k, n, lane] = unit[n, lane]
            for lane in range(min(LANES, columns - first)):
                i = first + lane
                share = power[j, i] / (4 * math.pi * sigma * sigma)
                slope = share / (2 * sigma * sigma)
                target = out[j, i]
                for k in range(6):
                    for n in range(6):
                        target[k, n] = 0
                target[0, 0], target[1, 1] = share * inverse[0, 0, lane], share * inverse[3, 3, lane]
                target[0, 1] = target[1, 0] = share * inverse[0, 3, lane]
                xx, yy = inverse[1, 1, lane], inverse[5, 5, lane]
                xy, yx = inverse[2, 2, lane], inverse[4, 4, lane]
                target[2, 2] = slope * (xx + yy + 2 * inverse[1, 5, lane])
                target[4, 4] = slope * (xx + yy - 2 * inverse[1, 5, lane])
                target[3, 3] = slope * (xy + yx - 2 * inverse[2, 4, lane])
                target[5, 5] = slope * (xy + yx + 2 * inverse[2, 4, lane])
