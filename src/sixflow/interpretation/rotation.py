"""Rotation about the line of sight, from the curl.

    curl = 2ω_Z + Im(a h̄)                                                                  (`sight`)

The second part comes from a slanted surface that moves across the line of sight. It is 0 if the surface faces the line
of sight or moves along it; where the direction φ of the motion across is known, the shear tells it,

    ω_Z = ½ [curl + Im(S e^(−2iφ))] = ½ [curl + shear cos 2φ − stretch sin 2φ],

and in any case ½ (curl − |S|) ≤ ω_Z ≤ ½ (curl + |S|). At the principal point the line of sight is the optical axis.

ω_Z is an angle per unit of time, positive clockwise on the screen for what is seen, and right at any size: the six are
rates here, not displacements, whose curl is twice the sine of the angle.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any, ClassVar

import numpy as np

from sixflow.interpretation.contact import know
from sixflow.interpretation.estimate import Estimate, Interpretation
from sixflow.interpretation.region import RegionFit, require_fit
from sixflow.interpretation.sight import look_at
from sixflow.scenes import Camera
from sixflow.scenes.arguments import Of, require_kind, require_of


@dataclasses.dataclass(frozen=True, eq=False)
class AxisRotation(Interpretation):
    """Rotation about a line of sight.

    Attributes
    ----------
    rate : Estimate
        rad per unit of time, right-handed about the direction of sight: of an object, positive is clockwise on the
        screen; of a camera, the picture then turns anticlockwise.
    least, most : Estimate
        Bounds, for any slant and any direction of motion.
    point : (float, float)
        Image point on whose line of sight it is, px; the optical axis if that is the principal point.
    corrected : bool
        Whether the rate is corrected by the shear.
    assumptions : tuple of str
    """

    _title: ClassVar[str] = "rotation about the line of sight"

    rate: Estimate
    least: Estimate
    most: Estimate
    point: tuple[float, float]
    corrected: bool


def axis_rotation(
    fit: RegionFit,
    camera: Camera,
    *,
    point: tuple[float, float] | None = None,
    heading: Any = None,
    of: Of = "camera",
) -> AxisRotation:
    """Rate of rotation about the optical axis, or about the line of sight of another point.

    Parameters
    ----------
    fit : RegionFit
        Of the six or the eight.
    camera : Camera
    point : (x, y), optional
        px; the principal point by default.
    heading : (X, Y, Z), optional
        Direction of the translation in the camera's axes, of any length above 0: corrects for the slant.
    of : "camera" or "object"
        Whose rotation it is, and whose heading.

    Raises
    ------
    InputError
        If an argument cannot be used.

    Examples
    --------
    >>> import sixflow
    >>> from sixflow import synth
    >>> from sixflow.interpretation import fit_region
    >>> turning = synth.Affine.rotation(0.05, centre=(64, 64))
    >>> made = synth.pair(synth.Speckle(), turning, (128, 128))
    >>> fit = fit_region(sixflow.measure(made.frame0, made.frame1))
    >>> found = axis_rotation(fit, Camera(focal=800, centre=(64, 64)), of="object")
    >>> print(f"{found.rate.value:.4f} {found.rate.unit}")
    0.0500 rad/frame
    """
    require_of(of)
    require_kind("camera", camera, Camera, "Camera(focal=800)")
    sight = look_at(require_fit(fit), camera, camera.centre if point is None else point)
    known = know(sight, fit, heading, None, of)
    S, size = sight.shearing, abs(sight.shearing)
    gradient = np.array([0, 0, 0, 0.5, 0, 0])
    value = sight.curl / 2
    if known is None:
        statement = "the surface faces the line of sight or moves along it; if neither, the rate is from least to most"
    else:
        statement = known.statement
        if not known.along_sight:
            angle, _, _ = known.direction(sight)  # of a heading that is given: without error
            cos, sin = math.cos(2 * angle), math.sin(2 * angle)
            value += (S.imag * cos - S.real * sin) / 2
            gradient = gradient + np.array([0, 0, 0, 0, -sin, cos]) / 2
    along = np.array([S.real, S.imag]) / size if size else np.array([1.0, 0.0])
    sign = 1.0 if of == "object" else -1.0
    clock = fit.clock
    least, most = (
        clock.rate(
            sign * sight.curl / 2 + side * size / 2,
            sight.error(np.array([0, 0, 0, 0.5, *(side * sign * along / 2)])),
            "rad",
        )
        for side in (-1, 1)
    )
    return AxisRotation(
        assumptions=(statement,),
        rate=clock.rate(sign * value, sight.error(gradient), "rad"),
        least=least,
        most=most,
        point=sight.point,
        corrected=known is not None,
    )
