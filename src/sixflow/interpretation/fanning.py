"""Fanning, the second-order part of the flow: Kanatani's K = E + iF, with its size and direction.

    u = … + (E x + F y) x,    v = … + (E x + F y) y                                            (Eagleson, eq. (2))

It is what tells perspective from an affine flow: lines fan out, and the foreshortening changes. At the principal point,
with ω and T of the scene and the plane's normal n (n·X = 1),

    E = (ω_Y − T_Z n_x)/f,    F = (−ω_X − T_Z n_y)/f,

so that K is 0 for a surface that faces the camera and does not turn towards or away from it. A point's own six do not
contain K; a region's do, by the change of its divergence, curl and shears from place to place.
"""

from __future__ import annotations

import dataclasses
import math
from typing import ClassVar

import numpy as np

from sixflow.interpretation.estimate import Estimate, Interpretation, distinct
from sixflow.interpretation.region import RegionFit, require_fit
from sixflow.invariants import numbers_from_eight, size_and_direction


@dataclasses.dataclass(frozen=True, eq=False)
class Fanning(Interpretation):
    """The second-order part of a flow.

    Attributes
    ----------
    E, F : Estimate
        1/px per unit of time.
    size : Estimate
        |K|, 1/px per unit of time.
    direction : Estimate
        arg K, rad from x towards y: where the divergence grows fastest.
    assumptions : tuple of str
    """

    _title: ClassVar[str] = "fanning"

    E: Estimate
    F: Estimate
    size: Estimate
    direction: Estimate


def fanning(fit: RegionFit) -> Fanning:
    """K = E + iF of a region's flow.

    Parameters
    ----------
    fit : RegionFit
        Of the eight.

    Raises
    ------
    InputError
        If the fit is none, or of the six.

    Examples
    --------
    >>> import sixflow
    >>> from sixflow import synth
    >>> from sixflow.interpretation import fit_region
    >>> motion = synth.Homography(((1, 0, 0), (0, 1, 0), (-1e-4, 0, 1)))
    >>> made = synth.pair(synth.Speckle(), motion, (128, 128))
    >>> found = fanning(fit_region(sixflow.measure(made.frame0, made.frame1)))
    >>> print(f"{found.E.value:.1e} {found.E.unit}")
    1.0e-04 1/px/frame
    """
    require_fit(fit, "eight")
    numbers, spread = numbers_from_eight(fit.eight.coefficients, fit.eight.covariance)
    polar = size_and_direction("K", numbers, spread)
    E, F = numbers[6:]
    errors = np.sqrt(np.diagonal(spread))[6:]
    assert polar.standard_errors is not None
    size_error, direction_error = (float(part) for part in polar.standard_errors)
    known = distinct(float(polar.size), size_error)
    clock = fit.clock
    return Fanning(
        assumptions=("none beyond those of the region",),
        E=clock.rate(float(E), float(errors[0]), "1/px"),
        F=clock.rate(float(F), float(errors[1]), "1/px"),
        size=clock.rate(float(polar.size), size_error, "1/px"),
        direction=Estimate(float(polar.direction), direction_error if known else math.inf, "rad"),
    )
