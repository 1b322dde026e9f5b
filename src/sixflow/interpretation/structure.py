"""Plane and motion from the eight coefficients: both solutions, with errors.

The closed form is that of `scenes.planar_structure`, for the middle of the frame interval (`interval`): plane and
velocities are those. The time to contact is that of the plane, along its normal, and counts from the reference frame,
t_c = 1/(1 − e^(−ρ)) with ρ = V·n̂/d (`contact`).

Where the motion cannot be distinguished from one along the normal, one of the two solutions is given. The other is as
likely, so its covariance gets ½ δ δᵀ, δ the difference of both in normal, translation and rotation: errors reach to
the other.
"""

from __future__ import annotations

import dataclasses
import math
from typing import ClassVar

import numpy as np

from sixflow.checks import number
from sixflow.interpretation.contact import contact_time
from sixflow.interpretation.estimate import Estimate, Interpretation
from sixflow.interpretation.interval import excess_of_mean
from sixflow.interpretation.region import RegionFit, require_fit
from sixflow.scenes import Camera, Eight, PlanarSolution, planar_structure
from sixflow.scenes.arguments import Of, require_kind

_ROUNDS = 2  # each is of two orders higher in the displacement gradient


@dataclasses.dataclass(frozen=True, eq=False)
class PlaneAndMotion(Interpretation):
    """A plane and the motion relative to it: one of the solutions.

    Attributes
    ----------
    slant, tilt : Estimate
        rad, as in `SurfaceSlant`, in the middle of the frame interval.
    time_to_contact : Estimate
        From the reference frame until the plane passes through the camera; negative if it recedes.
    V_X, V_Y, V_Z : Estimate
        Translation; in distances of the plane per unit of time, or in units of length where the distance is given.
    Omega_X, Omega_Y, Omega_Z : Estimate
        Rotation, rad per unit of time.
    solution : PlanarSolution
        What it was taken from, per frame interval, with the full covariance.
    number, count : int
        Which solution this is, of how many.
    assumptions : tuple of str
    """

    slant: Estimate
    tilt: Estimate
    time_to_contact: Estimate
    V_X: Estimate
    V_Y: Estimate
    V_Z: Estimate
    Omega_X: Estimate
    Omega_Y: Estimate
    Omega_Z: Estimate
    solution: PlanarSolution
    number: int
    count: int

    _title: ClassVar[str] = "plane and motion"

    @property
    def title(self) -> str:
        """What it is, in a few words."""
        return self._title if self.count == 1 else f"{self._title}, solution {self.number} of {self.count}"


def plane_and_motion(
    fit: RegionFit,
    camera: Camera,
    *,
    distance: float | None = None,
    length_unit: str = "length",
    of: Of = "camera",
) -> tuple[PlaneAndMotion, ...]:
    """Plane and motion from a region's eight coefficients.

    Parameters
    ----------
    fit : RegionFit
        Of the eight.
    camera : Camera
    distance : float, optional
        Perpendicular distance of the plane from the camera, above 0. Without it, the scale is undetermined and
        translations are in distances.
    length_unit : str
        Of the distance.
    of : "camera" or "object"
        Whose motion is wanted: that of the camera's centre, or of the object at that place.

    Returns
    -------
    tuple of PlaneAndMotion
        Two, of which one is true; one where both are the same, or cannot be distinguished.

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
    >>> view = synth.PlaneInView(camera, Plane.from_slant(2.0, slant=0.6), RigidMotion((0.08, 0, 0.04)))
    >>> made = synth.pair(synth.Speckle(), view, (128, 128))
    >>> for found in plane_and_motion(fit_region(sixflow.measure(made.frame0, made.frame1)), camera):
    ...     print(f"{found.number} of {found.count}: slant {found.slant.value:.2f}")
    1 of 2: slant 0.60
    2 of 2: slant 1.11
    """
    require_fit(fit, "eight")
    require_kind("camera", camera, Camera, "Camera(focal=800)")
    scale, unit = (
        (1.0, "distance") if distance is None else (number("distance", distance, above=0), length_unit)
    )
    solutions = planar_structure(fit.eight, camera, of=of, visible_at=[fit.centre])
    refined = [_refined(fit, camera, solution) for solution in solutions if bool(solution.visible)]
    offered = _offered(refined or [_refined(fit, camera, solutions[0])])
    return tuple(
        _of_solution(fit, solution, scale, unit, k, len(offered))
        for k, solution in enumerate(offered, start=1)
    )


def _offered(solutions: list[PlanarSolution]) -> list[PlanarSolution]:
    """The solutions that can be distinguished; one that stands for both otherwise."""
    first = solutions[0]
    if len(solutions) == 1 or first.covariance is None or str(first.case) in ("pure rotation", "unknown"):
        return [first]
    if str(first.case) == "general":
        return solutions
    there, here = (np.concatenate([one.normal, one.translation, one.rotation]) for one in solutions)
    apart = there - here
    return [dataclasses.replace(first, covariance=first.covariance + np.outer(apart, apart) / 2)]


def _refined(fit: RegionFit, camera: Camera, solution: PlanarSolution) -> PlanarSolution:
    """The solution for the middle of the interval, from that for its mean."""
    sign = 1.0 if solution.of == "object" else -1.0
    flow = fit.eight.recentred(camera.centre)
    for _ in range(_ROUNDS):
        if str(solution.case) in ("pure rotation", "unknown"):
            return solution
        excess = excess_of_mean(
            solution.normal, sign * solution.translation, sign * solution.rotation, camera.focal
        )
        middle = Eight(flow.coefficients - excess, camera.centre, flow.covariance)
        again = planar_structure(middle, camera, of=solution.of, visible_at=[fit.centre])
        solution = max(again, key=lambda one: float(one.normal @ solution.normal))
    return solution


def _of_solution(
    fit: RegionFit, solution: PlanarSolution, scale: float, unit: str, k: int, count: int
) -> PlaneAndMotion:
    errors, clock = solution.standard_errors, fit.clock
    contact = float(solution.time_to_contact)
    rate = 0.0 if math.isinf(contact) else 1 / contact
    rate_error = math.inf if rate == 0 else float(errors.time_to_contact) * rate**2
    moving, turning = (
        [
            clock.rate(factor * float(value), factor * float(error), quantity)
            for value, error in zip(values, spreads, strict=True)
        ]
        for values, spreads, factor, quantity in (
            (solution.translation, errors.translation, scale, unit),
            (solution.rotation, errors.rotation, 1.0, "rad"),
        )
    )
    of_scale = (
        "translation is in distances of the plane: the scale is undetermined"
        if unit == "distance"
        else "the distance of the plane is as given"
    )
    return PlaneAndMotion(
        assumptions=(str(solution.reason), of_scale),
        slant=Estimate(float(solution.slant), float(errors.slant), "rad"),
        tilt=Estimate(float(solution.tilt), float(errors.tilt), "rad"),
        time_to_contact=contact_time(rate, rate_error, clock),
        **dict(zip(("V_X", "V_Y", "V_Z"), moving, strict=True)),
        **dict(zip(("Omega_X", "Omega_Y", "Omega_Z"), turning, strict=True)),
        solution=solution,
        number=k,
        count=count,
    )
