"""Search: coarse to fine, from no motion to a start that refinement can finish.

The shift that the frames have in common is read off the correlation of the whole frames, where that has
a clear peak. From there, the frames are halved until the window covers what is left. At each level a
few total-form passes are made with the same window in that level's pixels, points that contradict their
neighbours are replaced by what these predict, and the maps go on to the next level: displacements
doubled, gradients as they are.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.blend import resample_strip, twist_of
from sixflow.engine.threads import over_strips
from sixflow.grid import Grid
from sixflow.method import passes_of
from sixflow.normalise import Frame
from sixflow.passes import Workspace
from sixflow.settings import Settings
from sixflow.validate import settle, typical

LEVEL_PASSES = 4
SETTLED = 0.1  # px of the level: the next level corrects what is left
CORRELATION_SIDE = 256
CLEAR_PEAK = 8.0


def level_count(shape: tuple[int, int], settings: Settings) -> int:
    """Return how many halvings the search starts from: until the window spans the shorter side."""
    if settings.levels is not None:
        return settings.levels
    return max(0, math.floor(math.log2(min(shape) / settings.window)))


def search(
    reference: Frame, moved: Frame, grid: Grid, settings: Settings, workspace: Workspace
) -> NDArray[np.float64]:
    """Find the motion roughly.

    Parameters
    ----------
    reference, moved : Frame
        At full resolution.
    grid : Grid
        Where the start is wanted.

    Returns
    -------
    float64 array, shape (6, rows, columns)
        u, v, u_x, u_y, v_x, v_y at the grid points, without NaN.
    """
    coarse = dataclasses.replace(settings, interpolation="cubic", group="affine")
    top = level_count(reference.image.shape, settings)
    shift = common_shift(reference, moved)
    maps: NDArray[Any] | None = None
    found = grid
    for level in range(top, 0, -1):
        small, small_moved = reference.level(level), moved.level(level)
        here = Grid.over(small.image.shape, max(2, round(settings.window / 4)))
        maps = _shifted(here, shift / 2**level) if maps is None else finer(maps, found, here, 2.0)
        passes = passes_of(settings)(small, small_moved, here, coarse, workspace)
        start = maps
        for _ in range(LEVEL_PASSES):
            solution = passes.solve(maps)
            update = np.hypot(solution[0] - maps[0], solution[1] - maps[1])
            maps = settle(solution, here.step, settings.window)
            if typical(update) < SETTLED:
                break
        # where halving has left no texture, what the level found is noise: keep what was known before
        maps = np.where(passes.trust(), maps, start)
        found = here
    if maps is None:
        return _shifted(grid, shift)
    return finer(maps, found, grid, 2.0)


def _shifted(grid: Grid, shift: NDArray[Any]) -> NDArray[np.float64]:
    return grid.plane(np.array([*shift, 0, 0, 0, 0]))


def common_shift(reference: Frame, moved: Frame) -> NDArray[np.float64]:
    """Shift (u, v) between the frames, px, to the pixels of a halved frame; (0, 0) if the correlation
    has no clear peak.

    Cross-correlation under a Hann window with the spectrum's magnitude under a square root, half way to
    phase correlation: a peak as narrow as the texture allows, without raising empty frequencies to full
    height. A peak is clear if it rises `CLEAR_PEAK` standard deviations above the correlation surface.
    """
    level = max(0, math.ceil(0.75 * math.log2(min(reference.image.shape) / CORRELATION_SIDE)))
    small, small_moved = reference.level(level), moved.level(level)
    window = np.outer(*(np.hanning(size + 2)[1:-1] for size in small.image.shape)).astype(small.image.dtype)
    spectra = [np.fft.rfft2(_centred(frame) * window) for frame in (small, small_moved)]
    product = np.conj(spectra[0]) * spectra[1]
    magnitude = np.abs(product)
    if not magnitude.any():
        return np.zeros(2)
    product /= np.sqrt(magnitude + 1e-12 * magnitude.max())
    surface = np.fft.irfft2(product, small.image.shape)
    peak = np.unravel_index(int(surface.argmax()), surface.shape)
    if surface[peak] < CLEAR_PEAK * surface.std():
        return np.zeros(2)
    v, u = (
        int(at) - size if at > size // 2 else int(at) for at, size in zip(peak, surface.shape, strict=True)
    )
    return 2.0**level * np.array([u, v])


def _centred(frame: Frame) -> NDArray[Any]:
    """Image less its mean, 0 where masked."""
    if not frame.valid.size:
        return frame.image - frame.image.mean()
    valid = frame.valid.astype(bool)
    return (
        np.where(valid, frame.image - frame.image[valid].mean(), 0)
        if valid.any()
        else np.zeros_like(frame.image)
    )


def finer(maps: NDArray[Any], grid: Grid, target: Grid, factor: float) -> NDArray[np.float64]:
    """Take maps from a coarse level's grid to a grid on a level `factor` times as fine."""
    out = np.empty((6, *target.shape))
    twist = twist_of(maps, grid.step)
    place = (target.x0 / factor, target.y0 / factor, target.step / factor)
    over_strips(
        lambda a, b: resample_strip(maps, twist, grid.origin_and_step, place, a, b, out), target.rows, 16
    )
    out[:2] *= factor
    return out
