"""Refute: does a motion from beyond the window fit the pixels beside a point better than the point's own?

Beside a motion edge a window follows the side with the stronger texture, or the edge's own contrast, also where its
point lies on the other side. The map is then smooth, its residual small, and no neighbour contradicts it: only the
pixels between the point and the other side do, which are few and faint. Here they are asked alone.

A neighbour n in one of eight directions e, one window or one and a half away, predicts the motion about the point p,
M_n(x) = d_n + G_n (x − n). Its window sees other pixels than that of p. Where it says something else than M_p, both are
tried on the pixels on its side of p, with weights w = exp(−|x − p|²/2s²) · [((x − p)·e − a)/2a] cut to 0 … 1:

    R_k = Σ w min(r_k², 100 ν²)/Σ w,    r_k = I₁(x + M_k) − I₀(x),    ν² = 2 noise²

    L = N/2 · (R_p − R_n)/max(min(R_p, R_n), ν₀²),     N = (Σ w)²/Σ w²

L is the logarithm of the likelihood ratio of n's motion to p's, with what the better of both leaves for noise: the
residual of the whole window, with the edge in it, would hide what the few pixels say. ν₀ is what rounding and
interpolation leave. Where there is noise alone, r_p and r_n share that of frame 0, so that r_p² − r_n² has a variance
of 3 ν⁴, and L one of 3 N/4. The point is refuted where L exceeds 3.5 of its standard deviations, L > 3.5 √(3N)/2, with
s = σ/2 or s = σ/4: with 16 neighbours and two sizes chance does it in about a percent of the points that are asked.
Where n's motion does not explain the pixels either, R_n > ν² (1 + 3 √(2/N)), something else is there, and L says
nothing.

*Smooth motion.* From a window away a curved field is mispredicted by much more than a window's own fit is wrong by:
for the shortest period that is resolved, by up to 1.2 of the amplitude, and by a tenth. So L is negative whatever the
noise. Chance is left where the two maps happen to agree. Therefore n is asked only if, in u or in v,

    |M_n(p) − M_p(p)| > 5 standard errors + 0.3 px + what half a window of curvature makes (`curvature`),

the last being three times what the window's own fit is wrong by.

*Sequence.* The pixels are asked row by row, from p outwards, until L < −8 in the larger disc and L < 0 in the smaller:
then n's motion is out (Wald's sequential test). In smooth motion one or two rows are enough.

| symbol | name |
|---|---|
| M | `maps` |
| σ | `sigma`, of the window about p |
| a | `GAP` windows: pixels nearer to p belong to the edge of either side |
| noise | `noise`, of one frame; not less than ν₀/√2 |
| ν₀ | `OF_CONTRAST` of frame 0's contrast around p |
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from sixflow.convention.flags import FAILING, FLAGS
from sixflow.engine.evidence import Compared, Points, refuted_strip, suspects_strip
from sixflow.engine.interpolate import Interpolant
from sixflow.engine.scales import OF_CONTRAST, local_contrast
from sixflow.engine.threads import over_strips
from sixflow.judge.contradiction import gradient_variances
from sixflow.maps.grid import Grid
from sixflow.maps.neighbours import curvature
from sixflow.plan import Plan
from sixflow.prepare.frame import Frame
from sixflow.refine.solution import Solution

DISTANCES = (1.0, 1.5)
"""Of the neighbours, windows."""
_STRIP = 4

Array = NDArray[np.float64]


def _near(marked: NDArray[np.bool_], window: NDArray[Any], step: int) -> NDArray[np.bool_]:
    """Points within half a window of the marked ones."""
    if not marked.any():
        return marked
    reach = max(1, round(float(np.median(window[marked])) / 2 / step))
    return np.asarray(scipy.ndimage.maximum_filter(marked, 2 * reach + 1), dtype=np.bool_)


def refuted(still: Frame, moved: Frame, grid: Grid, found: Solution, plan: Plan) -> NDArray[np.bool_]:
    """Find points whose neighbours' motion fits the pixels on their side better than the point's own.

    Parameters
    ----------
    still, moved : Frame
        As they were compared.
    grid : Grid
    found : Solution
        Expressed at the points of the plan's reference. Points that failed are not judged, nor those within half a
        window of what is flagged unresolved: there the fit is known to be wrong. Points at edges are asked for their
        motion, others that failed are not.
    plan : Plan

    Returns
    -------
    bool array, shape (rows, columns)

    Examples
    --------
    `sixflow.measure` flags such points as `edge`. In a smooth field there are none:

    >>> import sixflow
    >>> from sixflow import synth
    >>> from sixflow.convention.flags import FLAGS
    >>> flow = synth.CellularVortices(amplitude=1.0, period=160.0)
    >>> made = synth.pair(synth.Speckle(), flow, (128, 128), sensor=synth.Sensor(noise=2))
    >>> int((sixflow.measure(made.frame0, made.frame1).flag.values & FLAGS["edge"]).sum())
    0
    """
    maps, flag, window, light = found.maps, found.flag, found.window, found.light
    out = np.zeros(grid.shape, np.bool_)
    judged = ((flag & FAILING) == 0) & ~_near(flag & FLAGS["unresolved"] != 0, window, grid.step)
    asked = (flag & (FAILING - FLAGS["edge"])) == 0
    windows = np.nan_to_num(window, nan=float(grid.step)) / grid.step
    reach = np.stack([np.maximum(1, np.rint(part * windows)).astype(np.int64) for part in DISTANCES])
    suspects = np.zeros(grid.shape, np.bool_)
    over_strips(
        lambda a, b: suspects_strip(maps, asked, judged, reach, grid.step, a, b, suspects),
        grid.rows,
        4 * _STRIP,
    )
    if not suspects.any():
        return out
    variances = gradient_variances(found.covariance)
    bend = curvature(np.where(asked, maps, np.nan), grid.step, float(np.median(window[suspects])))
    degree, share = plan.degree, plan.share
    none, valid = np.empty((0, 0), still.image.dtype), still.interpolable() if share else still.valid
    noiseless = 0.0, 0.0, 0.0
    frames = Compared(
        still.image,
        Interpolant(still.coefficients(degree) if share else none, valid, noiseless),
        Interpolant(moved.coefficients(degree), moved.interpolable(), noiseless),
        share,
    )
    least = OF_CONTRAST / math.sqrt(2) * local_contrast(still.image, valid, grid.y, grid.x)
    points = Points(
        maps, variances, bend, np.maximum(found.statistics.noise, least), 2 * least**2,
        np.empty((0, 0, 2)) if light is None else np.asarray(light, np.float64), asked, suspects, reach, window,
        grid.origin_and_step,
    )  # fmt: skip
    over_strips(lambda a, b: refuted_strip(frames, points, degree + 1, a, b, out), grid.rows, _STRIP)
    return out
