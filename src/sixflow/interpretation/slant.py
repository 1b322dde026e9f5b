"""Slant and tilt of a surface, from the deformation, for a known motion.

A surface that moves across the line of sight is deformed by its slant (`sight`, Koenderink and van Doorn),

    S = stretch + i shear = a h,    h = S/a,    normal n ∝ Qᵀ (h_x, h_y, 1),

with h the gradient of log(1/Z), and a the motion across the line of sight, which `across` finds from the heading or
from the rotation. Undetermined are

- slant and tilt, where nothing moves across the line of sight, or it is not known how fast: a heading at right angles
  to the line of sight does not tell;
- the tilt, where the slant is 0 within its error.

The slant is the angle between normal and optical axis; the tilt is the direction in the image in which the depth grows
fastest, from x towards y.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from sixflow.errors import InputError
from sixflow.interpretation.contact import know
from sixflow.interpretation.estimate import Estimate, Interpretation, distinct
from sixflow.interpretation.region import RegionFit, require_fit
from sixflow.interpretation.sight import Sight, look_at
from sixflow.scenes import Camera
from sixflow.scenes.arguments import Of, require_of

Array = NDArray[Any]

_UNKNOWN = Estimate(math.nan, math.inf, "rad")


@dataclasses.dataclass(frozen=True, eq=False)
class SurfaceSlant(Interpretation):
    """How a surface is inclined.

    Attributes
    ----------
    slant : Estimate
        Angle between normal and optical axis, rad; 0 if it faces the camera.
    tilt : Estimate
        Direction in which the depth grows fastest, rad, from x towards y.
    normal : array, shape (3,)
        Unit vector from the camera towards the surface; NaN where undetermined.
    point : (float, float)
        Image point on whose line of sight it is, px.
    assumptions : tuple of str
    """

    _title: ClassVar[str] = "slant of the surface"

    slant: Estimate
    tilt: Estimate
    normal: Array
    point: tuple[float, float]


def slant_and_tilt(
    fit: RegionFit,
    camera: Camera,
    *,
    heading: Any = None,
    rotation: Any = None,
    point: tuple[float, float] | None = None,
    of: Of = "camera",
) -> SurfaceSlant:
    """Slant and tilt of a surface from the deformation of its image, for a known motion.

    Parameters
    ----------
    fit : RegionFit
        Of the six or the eight.
    camera : Camera
    heading : (X, Y, Z), optional
        Direction of the translation in the camera's axes, of any length above 0.
    rotation : (X, Y, Z), optional
        Known rotation, rad/s if the frame interval is known, else per frame interval; (0, 0, 0) for none. At
        least one of heading and rotation is needed.
    point : (x, y), optional
        px; the middle of the region's points by default.
    of : "camera" or "object"
        Whose heading and rotation they are.

    Raises
    ------
    InputError
        If neither heading nor rotation is given, or an argument cannot be used.

    Examples
    --------
    A camera moves to the right past a slanted wall, without turning:

    >>> import sixflow
    >>> from sixflow import synth
    >>> from sixflow.interpretation import fit_region
    >>> from sixflow.scenes import Plane, RigidMotion
    >>> camera = Camera(focal=400, centre=(64, 64))
    >>> view = synth.PlaneInView(camera, Plane.from_slant(2.0, slant=0.6, tilt=0.0), RigidMotion((0.02, 0, 0)))
    >>> made = synth.pair(synth.Speckle(), view, (128, 128))
    >>> fit = fit_region(sixflow.measure(made.frame0, made.frame1))
    >>> found = slant_and_tilt(fit, camera, rotation=(0, 0, 0))
    >>> print(f"{found.slant.value:.2f} {abs(found.tilt.value):.2f}")
    0.60 0.00
    """
    require_of(of)
    if heading is None and rotation is None:
        raise InputError(
            "heading=None, rotation=None: slant needs a known motion; give the heading, such as (0, 0, 1) for "
            "forwards, or the rotation, such as (0, 0, 0) for none"
        )
    sight = look_at(require_fit(fit), camera, point)
    known = know(sight, fit, heading, rotation, of)
    assert known is not None
    a, J = known.motion(sight)
    size = abs(a)
    seen = size > 0 and distinct(size, sight.error(np.array([a.real, a.imag]) @ J / size))
    if not seen:
        return SurfaceSlant((known.statement,), _UNKNOWN, _UNKNOWN, np.full(3, math.nan), sight.point)
    h = sight.shearing / a
    by_S, by_a = 1 / a, -sight.shearing / a**2
    dh = np.stack([_complex_row(by_S, part) for part in (0, 1)])
    dh = dh @ np.eye(6)[4:] + np.stack([_complex_row(by_a, part) for part in (0, 1)]) @ J
    n = sight.turn.T @ np.array([h.real, h.imag, 1.0])
    slant, tilt = _angles(n, sight.turn.T[:, :2] @ dh, sight)
    return SurfaceSlant((known.statement,), slant, tilt, n / np.linalg.norm(n), sight.point)


def _complex_row(factor: complex, part: int) -> Array:
    """Row of the matrix by which a complex factor multiplies (real, imaginary) parts."""
    return np.array([factor.real, -factor.imag] if part == 0 else [factor.imag, factor.real])


def _angles(n: Array, dn: Array, sight: Sight) -> tuple[Estimate, Estimate]:
    """Slant and tilt of a normal of any length, with derivative (3, 6)."""
    steep = math.hypot(n[0], n[1])
    slant = math.atan2(steep, n[2])
    if steep == 0:
        error = max(sight.error(dn[0]), sight.error(dn[1])) / float(n[2])
        return Estimate(slant, error, "rad"), _UNKNOWN
    square = steep**2 + n[2] ** 2
    by_n = np.array([n[0] * n[2] / steep, n[1] * n[2] / steep, -steep]) / square
    error = sight.error(by_n @ dn)
    across = np.array([-n[1], n[0], 0.0]) / steep**2
    tilt = math.atan2(-n[1], -n[0])
    known = distinct(slant, error)
    return Estimate(slant, error, "rad"), Estimate(
        tilt, sight.error(across @ dn) if known else math.inf, "rad"
    )
