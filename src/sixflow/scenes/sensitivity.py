"""Calibration the other way round: what errors of depth, slant and time to contact follow from those of the six.

With the measured numbers y (the six at a point, or the eight), their covariance C and their derivative J with
respect to the unknown ones among the nine parameters, the information about these is

    I = Jᵀ C⁻¹ J + diag(1/σ²),      Cov = I⁻¹,

σ the standard errors with which parameters are known beforehand (a velocity from the wheels, an angle from a
gyroscope). A derived quantity of gradient g has the variance gᵀ I⁻¹ g. Where I is singular, some directions are
not seen: a quantity is determined if g has no part along them, and has an infinite standard error otherwise.
This is the least possible to first order (Cramér–Rao); `unknown` says what is not assumed.

| quantity | formula, m the direction of the image point |
|---|---|
| depth | Z = r/(1 − p m_x − q m_y) |
| distance | r/√(1 + p² + q²), from the camera's centre to the plane |
| slant | arctan √(p² + q²) |
| tilt | arctan(q/p) |
| time to contact | −r/(T_Z − p T_X − q T_Y), when the plane would pass through the camera's centre |
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sixflow.array_checks import finite_floats
from sixflow.checks import number, require
from sixflow.errors import InputError
from sixflow.scenes.arguments import Array, require_kind
from sixflow.scenes.calibration import NINE, Calibration
from sixflow.scenes.rotation import skew

DERIVED = ("depth", "distance", "slant", "tilt", "time_to_contact")
"""Names of the quantities that follow from the nine parameters."""

_RANK = 1e-9  # singular values below this share of the largest are 0: a direction that is not seen
_BLIND = 1e-6  # largest share of a gradient along directions not seen that is taken for rounding


@dataclasses.dataclass(frozen=True, eq=False)
class Sensitivity:
    """Standard errors that follow from measured numbers.

    Attributes
    ----------
    values : dict
        Name → value, of the nine parameters and of `DERIVED`.
    standard_errors : dict
        Name → standard error in the same unit; 0 for what is taken as known, infinite for what the
        measurement does not determine.
    unknown : tuple of str
        What was not taken as known.
    """

    values: dict[str, float]
    standard_errors: dict[str, float]
    unknown: tuple[str, ...]

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Names of what the measurement does not determine."""
        return tuple(name for name, error in self.standard_errors.items() if math.isinf(error))

    def __str__(self) -> str:
        lines = [f"{'':>16}{'value':>12}{'standard error':>18}"]
        for name, value in self.values.items():
            error = self.standard_errors[name]
            said = "undetermined" if math.isinf(error) else "known" if error == 0 else f"{error:.3g}"
            lines.append(f"{name:>16}{value + 0.0:>12.4g}{said:>18}")
        return "\n".join(lines)


def sensitivity(
    calibration: Calibration,
    covariance: ArrayLike,
    *,
    unknown: Iterable[str] = ("p", "q", "r"),
    prior: Mapping[str, float] | None = None,
) -> Sensitivity:
    """Standard errors of structure and motion, from the covariance of the six or of the eight.

    Parameters
    ----------
    calibration : Calibration
        The scene, from `calibrate`.
    covariance : array, shape (6, 6) or (8, 8)
        Of the six at the calibration's image point, or of the eight about the principal point; positive
        definite.
    unknown : names
        Which of the nine parameters (`NINE`) the measurement has to find; the others are taken as known
        exactly. By default the plane, for a known motion.
    prior : mapping, optional
        Standard errors, above 0, with which unknown ones are known beforehand, such as {"V_Z": 0.02}.

    Raises
    ------
    InputError
        If the covariance is of another shape or not positive definite, or a name is none of the nine.

    Examples
    --------
    A camera of known speed looks at a wall: depth and slant from one measurement of the six.

    >>> from sixflow.scenes import Camera, Plane, RigidMotion, calibrate
    >>> scene = calibrate(Camera(focal=800), Plane.from_slant(2.0, slant=0.5), RigidMotion((0.1, 0, 0.1)))
    >>> measured = np.diag([0.01, 0.01, 0.001, 0.001, 0.001, 0.001]) ** 2
    >>> found = sensitivity(scene, measured)
    >>> round(found.standard_errors["depth"], 5), round(found.standard_errors["slant"], 5)
    (0.0005, 0.0109)

    With the velocity unknown too, the scale is undetermined, but slant and time to contact are not:

    >>> found = sensitivity(scene, measured, unknown=("V_X", "V_Y", "V_Z", "p", "q", "r"))
    >>> found.undetermined
    ('V_X', 'V_Z', 'r', 'depth', 'distance')
    """
    require_kind("calibration", calibration, Calibration, "calibrate(camera, plane, motion)")
    names = _names("unknown", unknown)
    rows = [_measured_jacobian(calibration, covariance)[:, [NINE.index(name) for name in names]]]
    for name, error in (prior or {}).items():
        require(name in names, "prior", name, f"must be among the unknown, {', '.join(names)}")
        row = np.zeros((1, len(names)))
        row[0, names.index(name)] = 1 / number(f"prior[{name!r}]", error, above=0)
        rows.append(row)
    seen = _inverse_root(np.concatenate(rows))
    columns = [NINE.index(name) for name in names]
    errors = {
        name: seen.standard_error(gradient[..., columns])
        for name, gradient in _gradients(calibration).items()
    }
    values = dict(zip(NINE, calibration.nine.tolist(), strict=True)) | _derived(calibration)
    if math.isnan(values["tilt"]):
        errors["tilt"] = math.inf
    if math.isinf(values["time_to_contact"]):
        errors["time_to_contact"] = math.inf
    return Sensitivity(values, errors, names)


def _names(argument: str, given: Iterable[str]) -> tuple[str, ...]:
    names = tuple(given) if not isinstance(given, str) else (given,)
    wrong = [name for name in names if name not in NINE]
    good = bool(names) and not wrong and len(set(names)) == len(names)
    require(good, argument, given, f"must be different names among {', '.join(NINE)}")
    return names


def _measured_jacobian(calibration: Calibration, covariance: ArrayLike) -> Array:
    """C^(−1/2) J: the derivatives of measured numbers in units of their errors."""
    C = finite_floats("covariance", covariance)
    if C.shape not in ((6, 6), (8, 8)):
        raise InputError(
            f"covariance of shape {C.shape}: must be (6, 6), of the six, or (8, 8), of the eight"
        )
    J = calibration.six_jacobian if len(C) == 6 else calibration.eight_jacobian
    size = np.sqrt(np.abs(np.diagonal(C)))
    try:
        if not (size > 0).all() or not np.allclose(C, C.T, rtol=0, atol=1e-6 * size.max() ** 2):
            raise np.linalg.LinAlgError
        root = np.linalg.cholesky(C / np.outer(size, size))
    except np.linalg.LinAlgError:
        raise InputError(
            "covariance: must be symmetric and positive definite, with variances above 0"
        ) from None
    return np.asarray(np.linalg.solve(root, J / size[:, None]))


class _Seen(NamedTuple):
    """Directions in the space of the parameters, each divided by its scale.

    `factor` (k, ·) W with W Wᵀ the covariance, `unseen` (k, ·) orthonormal directions that nothing tells of.
    """

    scale: Array
    factor: Array
    unseen: Array

    def standard_error(self, gradient: Array) -> float:
        """Standard error of a quantity of this gradient (k,); of several (·, k) the root mean square."""
        g = np.atleast_2d(gradient) / self.scale
        if np.linalg.norm(g @ self.unseen) > _BLIND * np.linalg.norm(g):
            return math.inf
        return float(np.sqrt(np.mean(np.sum((g @ self.factor) ** 2, axis=-1))))


def _inverse_root(A: Array) -> _Seen:
    """What rows of derivatives, in units of their errors, say of the parameters (columns)."""
    size = np.linalg.norm(A, axis=0)
    scale = np.where(size > 0, size, 1.0)
    _, values, rows = np.linalg.svd(A / scale)
    values = np.concatenate([values, np.zeros(A.shape[1] - len(values))])
    seen = values > _RANK * max(float(values[0]), 1.0)
    return _Seen(scale, rows[seen].T / values[seen], rows[~seen].T)


def _gradients(calibration: Calibration) -> dict[str, Array]:
    """Derivatives (9,) of the nine parameters and of `DERIVED`; slant and tilt of slant 0 have none, (2, 9)."""
    p, q, r = calibration.plane.slopes
    m_x, m_y, _ = calibration.camera.direction(*calibration.at)
    near = 1 - p * m_x - q * m_y
    long, steep = math.hypot(p, q, 1), math.hypot(p, q)
    axes = np.eye(9)
    by_p, by_q, by_r = axes[6:]
    gradients = dict(zip(NINE, axes, strict=True))
    gradients["depth"] = (by_r + r / near * (m_x * by_p + m_y * by_q)) / near
    gradients["distance"] = by_r / long - r / long**3 * (p * by_p + q * by_q)
    if steep > 0:
        gradients["slant"] = (p * by_p + q * by_q) / (steep * long**2)
        gradients["tilt"] = (p * by_q - q * by_p) / steep**2
    else:
        gradients["slant"] = gradients["tilt"] = np.stack([by_p, by_q])
    closing, by_closing = _closing_speed(calibration)
    gradients["time_to_contact"] = (r / closing * by_closing - by_r) / closing if closing else np.zeros(9)
    return gradients


def _derived(calibration: Calibration) -> dict[str, float]:
    plane, r = calibration.plane, calibration.plane.slopes[2]
    closing, _ = _closing_speed(calibration)
    depth = float(plane.depth(calibration.camera, *calibration.at))
    values = (depth, plane.distance, plane.slant, plane.tilt, -r / closing if closing else math.inf)
    return dict(zip(DERIVED, values, strict=True))


def _closing_speed(calibration: Calibration) -> tuple[float, Array]:
    """T_Z − p T_X − q T_Y and its derivative (9,); 0 where it is 0 to rounding."""
    T, (p, q, _) = calibration.motion.scene_translation, calibration.plane.slopes
    k = np.array([-p, -q, 1.0])
    sign = 1.0 if calibration.motion.of == "object" else -1.0
    lever = skew(np.array(calibration.motion.point))  # −Ω × P = P × Ω
    closing = float(k @ T)
    rounding = 1e-14 * float(np.abs(k) @ np.abs(T))
    return closing if abs(closing) > rounding else 0.0, np.concatenate(
        [sign * k, sign * k @ lever, [-T[0], -T[1], 0.0]]
    )
