"""Ego-motion of a camera over a known plane: all six velocities, from the eight coefficients.

With the plane n·X = 1 known, the flow is linear in the camera's velocities (`scenes.flow`),

    L = −[Ω]× − V nᵀ + κI,    θ = J(n) (V, Ω),

eight numbers for six unknowns, found by generalised least squares with the covariance of θ. Two are left over: their χ²
tells whether the region is that plane.

The plane is taken as it is in the reference frame, and brought to the middle of the frame interval, to which the
velocities belong, by the motion itself (`interval`).
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from sixflow.interpretation.contact import contact_time
from sixflow.interpretation.estimate import Estimate, Interpretation
from sixflow.interpretation.interval import excess_of_mean
from sixflow.interpretation.least_squares import Agreement, Whitened
from sixflow.interpretation.region import RegionFit, require_fit
from sixflow.scenes import Camera, Plane, RigidMotion
from sixflow.scenes.arguments import require_kind
from sixflow.scenes.flow import coefficients_from_matrix
from sixflow.scenes.rotation import skew

Array = NDArray[Any]

_ROUNDS = 4  # each is of one order higher in the displacement


@dataclasses.dataclass(frozen=True, eq=False)
class EgoMotion(Interpretation):
    """Velocities of a camera over a plane, in the camera's axes.

    Attributes
    ----------
    V_X, V_Y, V_Z : Estimate
        Translation, units of length per unit of time.
    Omega_X, Omega_Y, Omega_Z : Estimate
        Rotation, rad per unit of time.
    speed : Estimate
        |V|.
    closing_speed : Estimate
        V·n̂, towards the plane.
    time_to_contact : Estimate
        From the reference frame until the camera would reach the plane.
    misfit : Estimate
        1 if the region is the plane that was given.
    motion : RigidMotion
        The velocities, per frame interval.
    covariance : array, shape (6, 6)
        Of V and Ω, per frame interval.
    assumptions : tuple of str
    """

    _title: ClassVar[str] = "ego-motion over the plane"

    V_X: Estimate
    V_Y: Estimate
    V_Z: Estimate
    Omega_X: Estimate
    Omega_Y: Estimate
    Omega_Z: Estimate
    speed: Estimate
    closing_speed: Estimate
    time_to_contact: Estimate
    misfit: Estimate
    motion: RigidMotion
    covariance: Array


def ego_motion(fit: RegionFit, camera: Camera, plane: Plane, *, length_unit: str = "length") -> EgoMotion:
    """Velocities of a camera from the flow of a plane whose place is known.

    Parameters
    ----------
    fit : RegionFit
        Of the eight.
    camera : Camera
    plane : Plane
        In the camera's axes, in the reference frame; such as Plane.ground(height=30, pitch=math.radians(90)). If its
        distance is not known, take 1: translations are then in distances.
    length_unit : str
        Of the plane's distance.

    Raises
    ------
    InputError
        If an argument cannot be used, or the camera would pass through the plane.

    Examples
    --------
    A drone 20 m above the ground, looking down, moves forward (up in the image) by 0.2 m per frame:

    >>> import math, sixflow
    >>> from sixflow import synth
    >>> from sixflow.interpretation import fit_region
    >>> camera, ground = Camera(focal=400, centre=(64, 64)), Plane.ground(20.0, pitch=math.radians(90))
    >>> made = synth.pair(synth.Speckle(), synth.PlaneInView(camera, ground, RigidMotion((0, -0.2, 0))), (128, 128))
    >>> found = ego_motion(fit_region(sixflow.measure(made.frame0, made.frame1)), camera, ground, length_unit="m")
    >>> print(f"{found.V_Y.value:.3f} {found.V_Y.unit}")
    -0.200 m/frame
    """
    require_fit(fit, "eight")
    require_kind("camera", camera, Camera, "Camera(focal=800)")
    require_kind("plane", plane, Plane, "Plane.ground(height=30, pitch=1.57)")
    flow = fit.eight.recentred(camera.centre)
    assert flow.covariance is not None
    problem = Whitened(flow.coefficients, flow.covariance)
    now, excess = plane, np.zeros(8)
    for _ in range(_ROUNDS):
        J = _derivatives(now.scaled_normal, camera.focal)
        motion = problem.step(excess, J)
        excess = excess_of_mean(now.scaled_normal, -motion[:3], -motion[3:], camera.focal)
        rigid = RigidMotion(tuple(motion[:3].tolist()), tuple(motion[3:].tolist()))
        now = plane.moved(rigid.displacement(0.5))
    agreement = Agreement(problem.square(J @ motion + excess), 2)
    covariance = agreement.enlargement * problem.covariance(J)
    return EgoMotion(
        assumptions=(
            "the plane is where it was said to be",
            *agreement.remark("the region is not that plane, or does not move rigidly"),
        ),
        **_estimates(fit, now, motion, covariance, length_unit),
        misfit=agreement.misfit,
        motion=rigid,
        covariance=covariance,
    )


def _derivatives(n: Array, focal: float) -> Array:
    """Of the eight by the camera's V and Ω, shape (8, 6)."""
    axes = np.eye(3)
    return np.asarray(-coefficients_from_matrix(np.concatenate([axes[:, :, None] * n, skew(axes)]), focal).T)


def _estimates(
    fit: RegionFit, plane: Plane, motion: Array, covariance: Array, unit: str
) -> dict[str, Estimate]:
    clock = fit.clock

    def along(direction: Array) -> tuple[float, float]:
        spread = covariance[:3, :3]
        return float(direction @ motion[:3]), math.sqrt(float(direction @ spread @ direction))

    errors = np.sqrt(np.diagonal(covariance))
    names = (
        ("V_X", unit),
        ("V_Y", unit),
        ("V_Z", unit),
        ("Omega_X", "rad"),
        ("Omega_Y", "rad"),
        ("Omega_Z", "rad"),
    )
    found = {
        name: clock.rate(float(value), float(error), quantity)
        for value, error, (name, quantity) in zip(motion, errors, names, strict=True)
    }
    size = float(np.linalg.norm(motion[:3]))
    closing = along(np.array(plane.normal))
    return found | {
        "speed": clock.rate(*(along(motion[:3] / size) if size else (0.0, float(errors[:3].max()))), unit),
        "closing_speed": clock.rate(*closing, unit),
        "time_to_contact": contact_time(closing[0] / plane.distance, closing[1] / plane.distance, clock),
    }
