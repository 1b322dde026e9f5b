"""Scenes with motion edges: errors away from the edges, and what is said near them.

*Away* from an edge is a point more than 16 px from every pixel next to which the true motion jumps by 0.3 px, or is
unknown (occluded); *at* an edge, one within 8 px of it. A peer is compared on the points that ours gives: it must
not pay for points that we leave out.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from public_cases.case import Case
from public_cases.scores import Comparison

AWAY, AT = 16, 8  # px

Array = NDArray[Any]


@dataclasses.dataclass(frozen=True)
class EdgeScores:
    """Mean end-point error away from edges (px) and share given there; share of points at edges wrong and given."""

    away_error: float
    away_given: float
    wrong_at: float


def edge_scores(case: Case, comparison: Comparison) -> EdgeScores | None:
    """Score a field by its distance from motion edges; None for a case without any."""
    distance = _distance(case, comparison)
    if distance is None:
        return None
    given = comparison.measured.given & comparison.known
    away, at = (distance > AWAY) & comparison.known, (distance <= AT) & comparison.known
    error = comparison.distance[given & away]
    return EdgeScores(
        float(error.mean()) if error.size else np.nan,
        float((given & away).sum() / away.sum()),
        float((comparison.wrong & at).sum() / at.sum()),
    )


def error_on_our_points(case: Case, ours: Comparison, peer: Comparison) -> float:
    """Mean end-point error of a peer, px, away from edges at the points that ours gives."""
    distance = _distance(case, ours)
    if distance is None:
        return np.nan
    use = ours.measured.given & (distance > AWAY) & np.isfinite(peer.distance)
    return float(peer.distance[use].mean()) if use.any() else np.nan


def _distance(case: Case, comparison: Comparison) -> Array | None:
    """Distance of every point from the next motion edge, px."""
    edges = case.truth.edges()
    if not edges.any() or edges.all():
        return None
    far: Array = ndimage.distance_transform_edt(~edges)
    x, y = comparison.measured.x, comparison.measured.y
    return far[y[:, None], x[None, :]]
