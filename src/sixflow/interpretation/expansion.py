"""Focus of expansion: where a camera is heading that does not turn, or whose rotation is known.

Less the rotation ω, the eight coefficients of a plane are those of L = T nᵀ + κI (`scenes.flow`), a matrix of rank one
up to κ: five numbers, the directions of T and n and the rate |T||n|. They are fitted by

    minimise (θ − θ(T, n))ᵀ C⁻¹ (θ − θ(T, n)),     C the covariance of θ = (u₀ … F),

beginning at both solutions of `scenes.planar_structure`, of which that remains that needs no rotation. The camera
is heading to V = −T, and all displacements point away from its image,

    x = c + f (V_X, V_Y)/V_Z.

Three of the eight numbers are left over: the minimum, divided by 3, is 1 ± √(2/3) if the plane moves like this.

Without translation all is undetermined. Where the camera moves parallel to the image, V_Z = 0 within its error, x and y
are: the focus is at infinity, but the heading stands.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from sixflow.interpretation.estimate import Estimate, Interpretation, distinct
from sixflow.interpretation.interval import excess_of_mean
from sixflow.interpretation.least_squares import Agreement, Whitened
from sixflow.interpretation.region import RegionFit, require_fit
from sixflow.interpretation.sight import scene_rotation
from sixflow.scenes import Camera, Eight, planar_structure
from sixflow.scenes.arguments import require_kind
from sixflow.scenes.flow import coefficients_from_matrix
from sixflow.scenes.rotation import skew

Array = NDArray[Any]

_STEPS = 30


@dataclasses.dataclass(frozen=True, eq=False)
class FocusOfExpansion(Interpretation):
    """Where a camera is heading.

    Attributes
    ----------
    x, y : Estimate
        Focus of expansion, px; of contraction if the camera moves backwards.
    angle : Estimate
        Between heading and optical axis, rad.
    misfit : Estimate
        1 if the camera does not turn otherwise than was said.
    heading : array, shape (3,)
        Unit vector (X, Y, Z) of the camera's translation.
    heading_covariance : array, shape (3, 3)
    assumptions : tuple of str
    """

    _title: ClassVar[str] = "focus of expansion"

    x: Estimate
    y: Estimate
    angle: Estimate
    misfit: Estimate
    heading: Array
    heading_covariance: Array


def focus_of_expansion(
    fit: RegionFit, camera: Camera, *, rotation: Any = (0.0, 0.0, 0.0)
) -> FocusOfExpansion:
    """Heading of a camera of known rotation, from the flow of a plane.

    Parameters
    ----------
    fit : RegionFit
        Of the eight.
    camera : Camera
    rotation : (X, Y, Z)
        Of the camera, rad/s if the frame interval is known, else per frame interval; none by default.

    Raises
    ------
    InputError
        If an argument cannot be used.

    Examples
    --------
    >>> import sixflow
    >>> from sixflow import synth
    >>> from sixflow.interpretation import fit_region
    >>> from sixflow.scenes import Plane, RigidMotion
    >>> camera = Camera(focal=400, centre=(64, 64))
    >>> view = synth.PlaneInView(camera, Plane.from_slant(2.0, slant=0.5), RigidMotion((0.004, 0, 0.04)))
    >>> made = synth.pair(synth.Speckle(), view, (128, 128))
    >>> found = focus_of_expansion(fit_region(sixflow.measure(made.frame0, made.frame1)), camera)
    >>> abs(found.x.value - 104) < 1, abs(found.y.value - 64) < 1
    (True, True)
    """
    require_fit(fit, "eight")
    require_kind("camera", camera, Camera, "Camera(focal=800)")
    omega = scene_rotation(rotation, "camera", fit)
    turning = coefficients_from_matrix(skew(omega), camera.focal)
    flow = fit.eight.recentred(camera.centre)
    rest = Eight(flow.coefficients - turning, camera.centre, flow.covariance)
    known = any(rotation) if isinstance(rotation, tuple | list) else True
    assumed = ("the camera turns as was said" if known else "the camera does not turn",)
    starts = planar_structure(rest, camera, visible_at=[fit.centre])
    if starts[0].case == "pure rotation":
        lost = Estimate(math.nan, math.inf, "px")
        angle = Estimate(math.nan, math.inf, "rad")
        unknown = np.full(3, math.nan)
        misfit = Estimate(math.nan, math.inf)
        return FocusOfExpansion(assumed, lost, lost, angle, misfit, unknown, np.full((3, 3), math.inf))
    assert rest.covariance is not None
    problem = Whitened(rest.coefficients, rest.covariance)
    found = [
        _without_rotation(problem, -start.translation, start.normal, omega, camera.focal) for start in starts
    ]
    T, n, spread, square = min(found, key=lambda one: one[3])
    if camera.direction(*fit.centre) @ n < 0:
        T = -T
    agreement = Agreement(square, 3)
    heading, covariance = _unit(-T, agreement.enlargement * spread)
    x, y, angle = _place(camera, heading, covariance)
    return FocusOfExpansion(
        assumptions=(*assumed, *agreement.remark("the camera turns otherwise, or the region is no plane")),
        x=x,
        y=y,
        angle=angle,
        misfit=agreement.misfit,
        heading=heading,
        heading_covariance=covariance,
    )


def _without_rotation(
    problem: Whitened, T: Array, n: Array, omega: Array, focal: float
) -> tuple[Array, Array, Array, float]:
    """T, n, the covariance of T, and the minimum, from a start."""

    def model() -> Array:
        return coefficients_from_matrix(np.outer(T, n), focal) + excess_of_mean(n, T, omega, focal)

    for _ in range(_STEPS):
        J = _derivatives(T, n, focal)
        change = problem.step(model(), J)
        T, n = T + change[:3], n + change[3:]
        size = math.sqrt(float(np.linalg.norm(T) / np.linalg.norm(n)))
        T, n = T / size, n * size
        if np.linalg.norm(change) < 1e-10 * np.linalg.norm(n):
            break
    return T, n, problem.covariance(_derivatives(T, n, focal))[:3, :3], problem.square(model())


def _derivatives(T: Array, n: Array, focal: float) -> Array:
    """Of the eight by T and n, shape (8, 6); T → cT, n → n/c changes nothing."""
    axes = np.eye(3)
    by_T, by_n = axes[:, :, None] * n, T[:, None] * axes[:, None, :]
    return np.asarray(coefficients_from_matrix(np.concatenate([by_T, by_n]), focal).T)


def _unit(vector: Array, covariance: Array) -> tuple[Array, Array]:
    size = float(np.linalg.norm(vector))
    unit = vector / size
    P = (np.eye(3) - np.outer(unit, unit)) / size
    return unit, P @ covariance @ P.T


def _place(camera: Camera, heading: Array, covariance: Array) -> tuple[Estimate, Estimate, Estimate]:
    """The focus, x and y, and the angle from the optical axis."""
    X, Y, Z = heading
    across = math.hypot(X, Y)
    turn = np.array([X * Z, Y * Z, -(across**2)]) / across if across else np.array([1.0, 0.0, 0.0])
    angle = Estimate(math.atan2(across, Z), math.sqrt(float(turn @ covariance @ turn)), "rad")
    finite = distinct(Z, math.sqrt(float(covariance[2, 2])))
    places = []
    for part, centre, axis in ((X, camera.centre[0], 0), (Y, camera.centre[1], 1)):
        if not finite:
            places.append(Estimate(math.nan, math.inf, "px"))
            continue
        by_heading = camera.focal * (np.eye(3)[axis] / Z - np.array([0, 0, part / Z**2]))
        error = math.sqrt(float(by_heading @ covariance @ by_heading))
        places.append(Estimate(centre + camera.focal * part / Z, error, "px"))
    return places[0], places[1], angle
