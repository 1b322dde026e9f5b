"""All interpretations of a region that follow from what is known."""

from __future__ import annotations

from typing import Any

import xarray as xr

from sixflow.errors import InputError
from sixflow.interpretation.contact import time_to_contact
from sixflow.interpretation.ego import ego_motion
from sixflow.interpretation.estimate import Interpretation
from sixflow.interpretation.expansion import focus_of_expansion
from sixflow.interpretation.fanning import fanning
from sixflow.interpretation.region import Coefficients, fit_region
from sixflow.interpretation.rotation import axis_rotation
from sixflow.interpretation.slant import slant_and_tilt
from sixflow.interpretation.structure import plane_and_motion
from sixflow.scenes import Camera, Plane
from sixflow.scenes.arguments import Of, require_kind, require_of


def interpret(
    field: xr.Dataset,
    camera: Camera,
    region: Any = None,
    *,
    heading: Any = None,
    rotation: Any = None,
    plane: Plane | None = None,
    distance: float | None = None,
    length_unit: str = "length",
    point: tuple[float, float] | None = None,
    of: Of = "camera",
    coefficients: Coefficients = "eight",
    time: int = 0,
    border: bool = False,
    frame_interval: float | None = None,
) -> tuple[Interpretation, ...]:
    """Fit a region, and return everything that follows from what is given.

    Parameters
    ----------
    field, region, coefficients, time, border, frame_interval
        As for `fit_region`.
    camera : Camera
    heading, rotation, of
        What is known of the motion, as for `slant_and_tilt`.
    plane : Plane, optional
        The plane that the region shows, if its place is known: gives the ego-motion of the camera.
    distance : float, optional
        Perpendicular distance of an unknown plane, above 0; sets the scale.
    length_unit : str
        Of the distance, and of the plane's.
    point : (x, y), optional
        Image point for time to contact and slant, px; the middle of the region's points by default.

    Returns
    -------
    tuple of Interpretation
        The region itself; time to contact; rotation about the optical axis; slant, if heading or rotation is given;
        and from the eight fanning, focus of expansion (of="camera"), plane and motion, and the ego-motion if the
        plane is given.

    Raises
    ------
    InputError
        If an argument cannot be used.
    MeasurementError
        If the region does not move in a way that a plane could.

    Examples
    --------
    >>> import sixflow
    >>> from sixflow import synth
    >>> made = synth.pair(synth.Speckle(), synth.Affine.zoom(1.02, centre=(64, 64)), (128, 128))
    >>> field = sixflow.measure(made.frame0, made.frame1)
    >>> for found in interpret(field, Camera(focal=400, centre=(64, 64)), (32, 32, 96, 96), rotation=(0, 0, 0)):
    ...     print(found.title)
    motion of the region
    time to contact
    rotation about the line of sight
    slant of the surface
    fanning
    focus of expansion
    plane and motion
    """
    require_of(of)
    require_kind("camera", camera, Camera, "Camera(focal=800)")
    if plane is not None and (coefficients != "eight" or of != "camera"):
        raise InputError(
            f"plane={plane!r}: ego-motion needs coefficients='eight' and of='camera'; they are {coefficients!r}, {of!r}"
        )
    fit = fit_region(
        field, region, coefficients=coefficients, time=time, border=border, frame_interval=frame_interval
    )
    known = {"heading": heading, "rotation": rotation, "of": of}
    found: list[Interpretation] = [fit, time_to_contact(fit, camera, point=point, **known)]
    found.append(axis_rotation(fit, camera, heading=heading, of=of))
    if heading is not None or rotation is not None:
        found.append(slant_and_tilt(fit, camera, point=point, **known))
    if coefficients == "eight":
        found.append(fanning(fit))
        if of == "camera":
            found.append(
                focus_of_expansion(fit, camera, rotation=(0, 0, 0) if rotation is None else rotation)
            )
        found += plane_and_motion(fit, camera, distance=distance, length_unit=length_unit, of=of)
    if plane is not None:
        found.append(ego_motion(fit, camera, plane, length_unit=length_unit))
    return tuple(found)
