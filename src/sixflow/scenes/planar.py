"""Structure and motion of a plane from the eight coefficients of its flow, in closed form: both solutions.

With n̂ the normal, d the distance, T and ω the velocities of the scene relative to the camera (`motion`), and
T̃ = T/d, the eight coefficients are the matrix L = [ω]× + T̃ n̂ᵀ up to κI (`flow`). Its symmetric part, less the
middle one of its eigenvalues λ₁ ≥ λ₂ ≥ λ₃ (which is κ), is

    S = ½ (T̃ n̂ᵀ + n̂ T̃ᵀ),   of the eigenvalues ½ (T̃·n̂ + |T̃|), 0, ½ (T̃·n̂ − |T̃|)

and of the eigenvectors e₁ ∥ T̂ + n̂, e₃ ∥ T̂ − n̂. So

    |T̃| = ρ = λ₁ − λ₃,   a = √((λ₁ − λ₂)/ρ),   b = √((λ₂ − λ₃)/ρ),   a² + b² = 1
    T̂ = a e₁ + b e₃,   n̂ = a e₁ − b e₃        and        T̂ = a e₁ − b e₃,   n̂ = a e₁ + b e₃:

two solutions, in which direction of motion and normal are exchanged (Longuet-Higgins's "visual ambiguity of a
moving plane"), each with the sign for which the camera sees the plane. In both

    ω = vector of the antisymmetric part of L − ½ n̂ × T̃,
    time to contact = −1/(T̃·n̂) = −1/(λ₁ + λ₃ − 2λ₂),   the same for both.

The scale is undetermined: T̃ is a velocity over a distance. Where the eigenvalues coincide, less is determined:

| case | eigenvalues | what follows |
|---|---|---|
| "general" | λ₁ > λ₂ > λ₃ | two solutions |
| "along normal" | λ₁ = λ₂ or λ₂ = λ₃ | the motion is along the normal; the solutions meet |
| "pure rotation" | λ₁ = λ₂ = λ₃ | no translation, or the plane is very far: no normal, no time to contact |
| "unknown" | | a coefficient or variance is NaN |

A plane is moreover `fronto_parallel` when its slant is 0: then it has no tilt.

With a covariance C of the coefficients, equal means: not contradicted by them. A combination z of them that
vanishes in the special case has zᵀ (∂z C ∂zᵀ)⁻¹ z ~ χ² (5 components of S for "pure rotation", 2 of its block for
"along normal" and of the normal for `fronto_parallel`); the case is taken unless that exceeds the quantile of
`level`. Without a covariance, equal means equal to rounding.

| symbol | name | unit |
|---|---|---|
| n̂ | `normal` | 1 |
| T̃, ω of the scene; V/d, Ω of the camera | `translation`, `rotation` | 1, rad per frame interval |
| ρ | `speed` | 1 per frame interval |
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sixflow.array_checks import finite_floats
from sixflow.checks import number, require
from sixflow.scenes.arguments import Array, Of, require_kind, require_of
from sixflow.scenes.camera import Camera
from sixflow.scenes.eight import Eight, require_covariance, require_eight
from sixflow.scenes.flow import matrix_from_coefficients
from sixflow.scenes.planar_closed_form import both_solutions
from sixflow.scenes.planar_solution import PlanarSolution
from sixflow.scenes.spectrum import spectrum_of


def planar_structure(
    eight: Eight,
    camera: Camera,
    *,
    covariance: ArrayLike | None = None,
    of: Of = "camera",
    visible_at: Iterable[tuple[float, float]] | None = None,
    level: float = 0.01,
) -> tuple[PlanarSolution, PlanarSolution]:
    """Structure and motion of a plane from the eight coefficients of its flow: both solutions.

    Assumed: one rigid plane, a calibrated camera, and a flow of small motions (velocities, not displacements).
    Nothing in the flow of one instant tells which solution is true; a second instant, another plane in the same
    motion, or a plane known to be seen where one solution has none, does.

    Parameters
    ----------
    eight : Eight
        The coefficients, about any centre, of any leading shape; with their covariance or without.
    camera : Camera
    covariance : array, shape (..., 8, 8), optional
        Covariance of the coefficients about their own centre, in place of that of `eight`.
    of : "camera" or "object"
        Whose motion is returned.
    visible_at : (x, y) pairs, optional
        Image points, px, that show the plane; they settle the sign of the normal, and a solution that cannot be
        seen at all of them is marked. By default the centre of the coefficients.
    level : float
        Level of significance, above 0 and below 1, of the tests for special cases: small values see more of them.

    Returns
    -------
    first, second : PlanarSolution
        The one of less slant first; one that is not visible last. In special cases they are the same to rounding or
        within their errors.

    Raises
    ------
    InputError
        If an argument cannot be used.

    Examples
    --------
    >>> from sixflow.scenes import Plane, RigidMotion, planar_flow
    >>> camera = Camera(focal=800, centre=(320, 240))
    >>> plane = Plane.from_slant(distance=2.0, slant=0.6, tilt=0.3)
    >>> flow = planar_flow(camera, plane, RigidMotion(translation=(0.02, 0.01, 0.1), rotation=(0, 0.01, 0)))
    >>> for solution in planar_structure(flow, camera):
    ...     print(f"slant {solution.slant:.3f} tilt {solution.tilt:.3f} contact {solution.time_to_contact:.2f}")
    slant 0.220 tilt -2.678 contact 23.56
    slant 0.600 tilt 0.300 contact 23.56
    """
    require_kind("camera", camera, Camera, "Camera(focal=800)")
    require_of(of)
    level = number("level", level, above=0)
    require(level < 1, "level", level, "must be below 1")
    if covariance is not None:
        flow = require_eight(eight)
        eight = Eight(flow.coefficients, flow.centre, require_covariance(covariance, flow.coefficients))
    sight = _sight(camera, [require_eight(eight).centre] if visible_at is None else visible_at)
    flow = eight.recentred(camera.centre)
    known = np.asarray(np.isfinite(flow.coefficients).all(axis=-1))
    if flow.covariance is not None:
        known = known & np.asarray(np.isfinite(flow.covariance).all(axis=(-1, -2)))
    theta = np.where(known[..., None], flow.coefficients, 0.0)
    C = None if flow.covariance is None else np.where(known[..., None, None], flow.covariance, np.eye(8))
    spectrum = spectrum_of(
        matrix_from_coefficients(theta, camera.focal),
        np.moveaxis(matrix_from_coefficients(np.eye(8), camera.focal), 0, -1),
        C,
    )
    first, second = both_solutions(spectrum, known, sight, of, level)
    if C is None:
        nothing: dict[str, Any] = {"covariance": None, "approach_variance": None}
        return dataclasses.replace(first, **nothing), dataclasses.replace(second, **nothing)
    return first, second


def _sight(camera: Camera, visible_at: Any) -> Array:
    """Unit vectors, shape (k, 3), of the image points that show the plane."""
    points = finite_floats("visible_at", list(visible_at))
    good = points.ndim == 2 and points.shape[1] == 2 and len(points) > 0
    require(good, "visible_at", visible_at, "must be image points [(x, y), …] in px, at least one")
    m = camera.direction(points[:, 0], points[:, 1])
    return np.asarray(m / np.linalg.norm(m, axis=-1, keepdims=True))
