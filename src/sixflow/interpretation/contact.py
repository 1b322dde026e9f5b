"""Time to contact, from the divergence.

The distance R along the line of sight shrinks at the rate ρ = −Ṙ/R, and the flow diverges by (`sight`)

    divergence = 2ρ + Re(a h̄),

where the second part comes from a slant h that moves across the line of sight at a. It is 0 if the surface faces the
line of sight, or moves along it. Otherwise, with the deformation S = a h:

*corrected by the shear*: where the direction φ of the motion across is known,

    ρ = ½ [divergence − Re(S e^(−2iφ))] = ½ [divergence − stretch cos 2φ − shear sin 2φ];

*bounds*: whatever slant and direction are, |Re(a h̄)| ≤ |S|, so that

    ½ (divergence − |S|) ≤ ρ ≤ ½ (divergence + |S|)

(Subbarao; Cipolla and Blake).

*Time.* ρ is the mean over the frame interval. At constant speed R = R₀ (1 − t/t_c), and ∫ρ = −log(1 − 1/t_c), hence
t_c = 1/(1 − e^(−ρ)) frame intervals **from the reference frame**: 1/ρ + ½ while that is many. Negative: the surface
recedes. The time is undetermined where ρ is 0 within its error.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any, ClassVar

import numpy as np

from sixflow.interpretation.across import Knowledge
from sixflow.interpretation.estimate import Clock, Estimate, Interpretation, distinct
from sixflow.interpretation.region import RegionFit, require_fit
from sixflow.interpretation.sight import Sight, look_at, scene_direction, scene_rotation
from sixflow.scenes import Camera
from sixflow.scenes.arguments import Of, require_of


@dataclasses.dataclass(frozen=True, eq=False)
class TimeToContact(Interpretation):
    """When the distance to a surface would be used up, at its present speed.

    Attributes
    ----------
    time : Estimate
        From the reference frame; negative if the surface recedes.
    approach_rate : Estimate
        ρ: share of the distance that is used up per unit of time.
    earliest, latest : Estimate
        Bounds of the time, for any slant and any direction of motion; `latest` is infinite if a slant could account
        for all of the divergence.
    point : (float, float)
        Image point on whose line of sight it is, px.
    corrected : bool
        Whether the time is corrected by the shear.
    assumptions : tuple of str
    """

    _title: ClassVar[str] = "time to contact"

    time: Estimate
    approach_rate: Estimate
    earliest: Estimate
    latest: Estimate
    point: tuple[float, float]
    corrected: bool


def time_to_contact(
    fit: RegionFit,
    camera: Camera,
    *,
    point: tuple[float, float] | None = None,
    heading: Any = None,
    rotation: Any = None,
    of: Of = "camera",
) -> TimeToContact:
    """Time to contact along the line of sight of a point, and its bounds.

    Parameters
    ----------
    fit : RegionFit
        Of the six or the eight.
    camera : Camera
    point : (x, y), optional
        px; the middle of the region's points by default.
    heading : (X, Y, Z), optional
        Direction of the translation in the camera's axes, of any length above 0: corrects for the slant.
    rotation : (X, Y, Z), optional
        Known rotation, rad/s if the frame interval is known, else per frame interval; (0, 0, 0) for none.
        Corrects for the slant too, by the direction of the displacement that is left.
    of : "camera" or "object"
        Whose heading and rotation they are.

    Raises
    ------
    InputError
        If an argument cannot be used.

    Examples
    --------
    >>> import sixflow
    >>> from sixflow import synth
    >>> from sixflow.interpretation import fit_region
    >>> made = synth.pair(synth.Speckle(), synth.Affine.zoom(50 / 49, centre=(64, 64)), (128, 128))
    >>> fit = fit_region(sixflow.measure(made.frame0, made.frame1), (32, 32, 96, 96))
    >>> found = time_to_contact(fit, Camera(focal=800, centre=(64, 64)))
    >>> print(f"{found.time.value:.1f} frames")
    50.0 frames
    """
    require_of(of)
    sight = look_at(require_fit(fit), camera, point)
    known = know(sight, fit, heading, rotation, of)
    clock = fit.clock
    gradient = np.array([0, 0, 0.5, 0, 0, 0])
    bounds = _bounds(sight, clock)
    if known is None:
        rate, statement, determined = (
            sight.divergence / 2,
            "the surface faces the line of sight or moves along it; if neither, the time is from earliest to latest",
            True,
        )
    else:
        rate, gradient, determined = _corrected(sight, known)
        statement = known.statement
    error = sight.error(gradient)
    return TimeToContact(
        assumptions=(statement, "the speed stays as it is"),
        time=contact_time(rate, error if determined else math.inf, clock),
        approach_rate=clock.rate(rate, error if determined else math.inf),
        earliest=bounds[0],
        latest=bounds[1],
        point=sight.point,
        corrected=known is not None,
    )


def know(sight: Sight, fit: RegionFit, heading: Any, rotation: Any, of: Of) -> Knowledge | None:
    """What is given of the motion, in the frame of the line of sight; None if it is nothing."""
    if heading is None and rotation is None:
        return None
    return Knowledge(
        None if heading is None else sight.turn @ scene_direction(heading, of),
        None if rotation is None else sight.turn @ scene_rotation(rotation, of, fit),
    )


def _corrected(sight: Sight, known: Knowledge) -> tuple[float, np.ndarray, bool]:
    """ρ with its derivative by the six, and whether it is determined."""
    gradient = np.array([0, 0, 0.5, 0, 0, 0])
    if known.along_sight:
        return sight.divergence / 2, gradient, True
    angle, by_six, determined = known.direction(sight)
    cos, sin = math.cos(2 * angle), math.sin(2 * angle)
    S = sight.shearing
    gradient = gradient - np.array([0, 0, 0, 0, cos, sin]) / 2
    gradient -= (S.imag * cos - S.real * sin) * by_six
    return (sight.divergence - S.real * cos - S.imag * sin) / 2, gradient, determined


def _bounds(sight: Sight, clock: Clock) -> tuple[Estimate, Estimate]:
    size = abs(sight.shearing)
    along = np.array([sight.shearing.real, sight.shearing.imag]) / size if size else np.array([1.0, 0.0])
    estimates = []
    for sign in (1, -1):
        gradient = np.array([0, 0, 0.5, 0, *(sign * along / 2)])
        rate = (sight.divergence + sign * size) / 2
        approaches = rate > 0 or sight.divergence <= 0
        estimates.append(contact_time(rate if approaches else 0.0, sight.error(gradient), clock))
    return estimates[0], estimates[1]


def contact_time(rate: float, error: float, clock: Clock) -> Estimate:
    """t_c from the reference frame for the rate ρ per frame interval, in the clock's unit."""
    if rate == 0:
        return clock.time(math.inf, math.inf)
    gone = -math.expm1(-rate)
    if not distinct(rate, error):
        return clock.time(1 / gone, math.inf)
    return clock.time(1 / gone, math.exp(-rate) / gone**2 * error)
