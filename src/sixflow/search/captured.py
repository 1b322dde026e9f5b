"""Captured: one affine map from the maps that single points find by themselves.

Where the spectra tell nothing, the map about a few points near the middle is captured at one scale
(`sixflow.eigenfilters.capture`), and what most of these maps agree upon, one affine map, is a start for all. Where that
is not found at full size the frames are halved.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sixflow.convention.six import GRADIENT_FROM_SIX
from sixflow.normalise import Frame

_LEVELS = 2
_SLACK = 2.0, 0.05  # px, and share of the distance, that agreeing maps may differ by


def captured_plane(reference: Frame, moved: Frame, window: float) -> NDArray[np.float64] | None:
    """Find one affine map that several points of the frame agree upon.

    Parameters
    ----------
    reference, moved : Frame
        At full resolution.
    window : float
        px; frames smaller than it, and windows below 10 or above 400, are not asked.

    Returns
    -------
    float64 array, shape (6,), or None
        u, v, u_x, u_y, v_x, v_y about pixel (0, 0); None if no point finds a map that is to be believed.
    """
    for level in range(_LEVELS):
        plane = _captured(reference.level(level), moved.level(level), window)
        if plane is not None:
            plane[:2] *= 2**level
            return plane
    return None


def _captured(reference: Frame, moved: Frame, window: float) -> NDArray[np.float64] | None:
    """The affine map about pixel (0, 0) that points half a window apart, about the middle, agree upon."""
    from sixflow.eigenfilters.capture import capture

    height, width = reference.image.shape
    if not 10 <= window <= min(400, height, width):
        return None
    apart = np.array([-1, 0, 1]) * round(window / 2)
    points = np.array([(width // 2 + dx, height // 2 + dy) for dy in apart for dx in apart])
    points = points[((points >= 0) & (points < (width, height))).all(axis=1)]
    if reference.valid.size:
        points = points[reference.valid[points[:, 1], points[:, 0]] > 0]
    if not len(points):
        return None
    found = capture(reference.image, moved.image, points[:, 0], points[:, 1], window=window)
    believed = found.converged
    return _agreed(points[believed].astype(float), found.six[believed] @ GRADIENT_FROM_SIX.T)


def _agreed(points: NDArray[np.float64], maps: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """The mean, about pixel (0, 0), of the largest set of maps (points, 6) that predict one another."""
    if not len(points):
        return None
    apart = points[None] - points[:, None]
    G = maps[:, 2:].reshape(-1, 1, 2, 2)
    predicted = maps[:, None, :2] + (G @ apart[..., None])[..., 0]
    off = np.linalg.norm(predicted - maps[None, :, :2], axis=-1)
    agree = off < _SLACK[0] + _SLACK[1] * np.linalg.norm(apart, axis=-1)
    best = agree[agree.sum(axis=1).argmax()]
    plane = maps[best].mean(axis=0)
    plane[:2] -= plane[2:].reshape(2, 2) @ points[best].mean(axis=0)
    return np.asarray(plane)
