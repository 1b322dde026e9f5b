"""The motion of a region: the six or eight coefficients of its flow, by weighted least squares over its points.

With the six numbers y_p of every point, their weights W_p, and the model f_p(θ) of `model` with its derivative A_p,

    minimise Σ_p (y_p − f_p)ᵀ W_p (y_p − f_p),     Cov θ = N⁻¹ [Σ_pq B_pᵀ K_pq B_q] N⁻¹,
    B_p = W_p^½ A_p,   N = Σ_p B_pᵀ B_p,   K_pq = W_p^½ (C_p^½ R_pq C_q^½ + b_p^½ R'_pq b_q^½) W_q^½,

by Gauss–Newton steps. The weights follow C_p + b_p, the covariances of the noise and what the windows leave out, but
not their noise (`weights`). They are those of independent points; the covariance counts that points are not: neighbours
share pixels, and R_pq is the correlation of their errors (`correlation`). A grid twice as dense has four times the
points and nearly the same standard errors. What windows leave out averages down less than noise does (`scatter`).

Two numbers measure how reliable the result is:

- *independent points*: n²/Σ_pq R_pq of u. So many points of separate windows would determine the mean displacement
  as well.
- *misfit*: Q/E[Q] with Q the minimum above; E[Q] = tr K − tr(N⁻¹ Σ BᵀKB), Var Q = 2 tr (PKP)², P = I − B N⁻¹ Bᵀ. It is
  1 if the region moves as the model says and the errors are as stated; then its standard error is √Var Q/E[Q].

Where the residuals hold more than K explains, by their power or by their power in slow waves, the rest is what the
model leaves out, as large and as far-reaching as the residuals show it to be (`scatter.unexplained`), and its part is
added to the covariance. Where that is more than chance makes, the assumptions say so.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any, ClassVar, Literal

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from sixflow.checks import number, require
from sixflow.errors import InputError, MeasurementError
from sixflow.field.calibration import calibrate
from sixflow.field.selection import require_field
from sixflow.interpretation.correlation import Correlation, noise_share, unknowns_from_six
from sixflow.interpretation.estimate import Clock, Estimate, Interpretation
from sixflow.interpretation.model import plane_in_window
from sixflow.interpretation.points import Points, Region, select_points
from sixflow.interpretation.scatter import Part, Scatter, power_of, unexplained
from sixflow.interpretation.weights import precision_around, symmetric_power, weights
from sixflow.scenes import Eight

Array = NDArray[Any]
Coefficients = Literal["six", "eight"]

LEAST = {"six": 1, "eight": 4}
"""Smallest number of points for a fit."""

_STEPS = 30
_CONVERGED = 1e-3  # in units of the errors
_ROUNDING = 1e-12


@dataclasses.dataclass(frozen=True, eq=False)
class RegionFit(Interpretation):
    """The motion of a region.

    Attributes
    ----------
    eight : Eight
        Coefficients of the steady flow that makes the displacement, per frame interval, about the middle of the
        points, with their covariance, which holds what the model leaves out where residuals show that. With
        coefficients="six", E and F are 0.
    coefficients : "six" or "eight"
        What was fitted.
    region : (x0, y0, x1, y1)
        px.
    points : int
        How many points were used.
    independent_points : float
        How many independent ones they stand for.
    misfit : Estimate
        1 if the region moves as assumed.
    interval : float or None
        Time between the two frames of the pair, s; None if no times are known.
    frames : float
        The same in frame intervals of the recording, where no times are known; 1 otherwise.
    assumptions : tuple of str
    """

    _title: ClassVar[str] = "motion of the region"

    eight: Eight
    coefficients: Coefficients
    region: Region
    points: int
    independent_points: float
    misfit: Estimate
    interval: float | None
    frames: float = 1.0

    @property
    def clock(self) -> Clock:
        """Units of time of what follows from the fit."""
        return Clock(self.interval, self.frames)

    @property
    def centre(self) -> tuple[float, float]:
        """Middle of the points, px: the origin of the coefficients."""
        return self.eight.centre

    def six_at(self, point: tuple[float, float] | None = None) -> tuple[Array, Array]:
        """The six rates at an image point, per frame interval, and their covariance.

        Parameters
        ----------
        point : (x, y), optional
            px; the middle of the points by default.

        Returns
        -------
        six : array, shape (6,)
        covariance : array, shape (6, 6)

        Raises
        ------
        InputError
            If the point is not two finite numbers.
        """
        x, y = self.centre if point is None else point
        return self.eight.six_at(x, y), self.eight.six_covariance_at(x, y)


def fit_region(
    field: xr.Dataset,
    region: ArrayLike | None = None,
    *,
    coefficients: Coefficients = "eight",
    time: int = 0,
    border: bool = False,
    frame_interval: float | None = None,
) -> RegionFit:
    """Fit the flow of a plane to a region of a field, with the covariances and the correlation of its points.

    Parameters
    ----------
    field : Dataset
        As measured or read, with its covariance.
    region : (x0, y0, x1, y1), optional
        px, borders included; the whole frame by default.
    coefficients : "eight" or "six"
        The flow of a plane (Eagleson, eq. (2)), or an affine one, E = F = 0: less noise in a small region, wrong
        by what E and F add in a large one.
    time : int
        Position of the pair along time.
    border : bool
        Use points whose window is cut by the border of the frame or mask, too. What a cut window sees of a curved
        flow is not the same; in a strongly curved flow they mislead.
    frame_interval : float, optional
        Time between successive frames of the recording, s, above 0, as `field.sixflow.calibrate` takes it; the times of
        the field, if they are known, by default. Unknown, all times are in frame intervals of the recording.

    Raises
    ------
    InputError
        If an argument cannot be used, or the region has too few points.
    MeasurementError
        If the region does not move in a way that a plane could.

    Examples
    --------
    >>> import sixflow
    >>> from sixflow import synth
    >>> made = synth.pair(synth.Speckle(), synth.Affine.zoom(1.02, centre=(64, 64)), (128, 128))
    >>> fit = fit_region(sixflow.measure(made.frame0, made.frame1), (40, 40, 88, 88))
    >>> six, covariance = fit.six_at((64.0, 64.0))
    >>> print(f"{six[2]:.4f}")                  # 2 log 1.02
    0.0396
    """
    require(coefficients in LEAST, "coefficients", coefficients, "must be 'eight' or 'six'")
    if frame_interval is not None:
        value = number("frame_interval", frame_interval, above=0, unit="s")
        field = calibrate(require_field(field), frame_interval=value)
    points = select_points(field, region, time, border)
    least = LEAST[coefficients]
    if points.count < least:
        raise InputError(
            f"region={tuple(float(part) for part in points.region)!r}: {points.tally}; a fit of {coefficients} "
            f"coefficients needs at least {least}. Enlarge the region, measure with a smaller step or window, or add "
            "border=True"
        )
    rows, columns = np.nonzero(points.used)
    centre = float(points.x[columns].mean()), float(points.y[rows].mean())
    solution = _Solver(points, centre, 6 if coefficients == "six" else 8).solve()
    return RegionFit(
        assumptions=_assumptions(coefficients, solution),
        eight=Eight(solution.theta, centre, solution.covariance),
        coefficients=coefficients,
        region=points.region,
        points=points.count,
        independent_points=solution.independent,
        misfit=solution.misfit,
        interval=points.interval,
        frames=points.frames,
    )


def require_fit(fit: object, coefficients: Coefficients | None = None) -> RegionFit:
    """Return the fit; InputError if it is none, or not of the coefficients that are needed."""
    if not isinstance(fit, RegionFit):
        raise InputError(f"fit={fit!r}: must be a RegionFit, from fit_region(field, region)")
    if coefficients is not None and fit.coefficients != coefficients:
        raise InputError(
            f"fit.coefficients={fit.coefficients!r}: the {coefficients} are needed here; fit the region with "
            f"coefficients={coefficients!r}"
        )
    return fit


def _assumptions(coefficients: Coefficients, solution: _Solution) -> tuple[str, ...]:
    shape = "the region shows one rigid plane"
    if coefficients == "six":
        shape = "the flow of the region is affine: a plane so small or so nearly facing that E = F = 0"
    statements = [shape, "velocities are constant over the frame interval"]
    misfit = solution.misfit
    if not solution.borne_out:
        statements.append(
            f"NOT BORNE OUT: the misfit is {misfit.value:.3g}, where 1 ± {misfit.standard_error:.2g} is expected; the "
            "region does not move quite like this, and what is left of its motion makes standard errors up to "
            f"{solution.enlarged:.3g} times as large"
        )
    return tuple(statements)


@dataclasses.dataclass(frozen=True)
class _Solution:
    theta: Array
    covariance: Array
    independent: float
    misfit: Estimate
    enlarged: float
    borne_out: bool


class _Solver:
    """The least-squares problem of one region, about its centre, with `k` of the eight coefficients free."""

    def __init__(self, points: Points, centre: tuple[float, float], k: int) -> None:
        self.points, self.k = points, k
        self.blur = points.sigma**2 if points.sharpen == 0 else 0.0
        self.place = points.used.nonzero()
        rows, columns = self.place
        self.x, self.y = points.x[columns] - centre[0], points.y[rows] - centre[1]
        to_unknowns = unknowns_from_six(points.sigma)
        spread, bias = (
            to_unknowns @ one[self.place] @ to_unknowns.T for one in (points.covariance, points.bias)
        )
        if not (np.linalg.eigvalsh(spread) > 0).all():
            raise InputError(
                "covariance: must be positive definite at every valid point; measure the frames again"
            )
        at = points.used, points.x, points.y, points.sigma
        around = precision_around(spread, *at)
        share = noise_share(around, points.sigma, points.gradient_noise)
        correlation = Correlation(points.x, points.y, points.sigma, points.sharpen, share)
        resolved = not bias.any()
        total = spread if resolved else spread + bias
        root = symmetric_power(weights(total, around if resolved else precision_around(total, *at)), 0.5)
        self.root, self.whiten = root, root @ to_unknowns
        self.noise = Part(root @ symmetric_power(spread, 0.5), correlation)
        parts = [self.noise]
        if not resolved:
            length = max(points.sigma, points.period / (2 * math.pi))
            parts.append(Part(root @ symmetric_power(bias, 0.5), Correlation(points.x, points.y, length, 0)))
        self.scatter = Scatter(points.used, parts)

    def solve(self) -> _Solution:
        theta = np.zeros(8)
        for _ in range(_STEPS):
            try:
                r, B, scale = self._linearised(theta)
            except InputError:  # the plane is behind the camera
                break
            change = np.linalg.solve(B.T @ B, B.T @ r)
            theta[: self.k] += change / scale
            rounding = _ROUNDING * float(np.abs(theta[: self.k] * scale).max())
            if np.abs(change).max() < max(_CONVERGED, rounding):
                return self._judge(theta)
        raise MeasurementError(
            f"region={self.points.region!r}: does not move as a plane could, no homography fits; take a smaller one"
        )

    def _linearised(self, theta: Array) -> tuple[Array, Array, Array]:
        """Whitened residuals (6n,), derivatives (6n, k) of unit norm, and the norms (k,)."""
        six, A = plane_in_window(theta, self.x, self.y, self.blur)
        r = np.einsum("nij,nj->ni", self.whiten, self.points.six[self.place] - six)
        B = (self.whiten @ A[..., : self.k]).reshape(-1, self.k)
        scale = np.linalg.norm(B, axis=0)
        return r.reshape(-1), B / scale, scale

    def _judge(self, theta: Array) -> _Solution:
        """Covariance, number of independent points and misfit of the solution."""
        r, B, scale = self._linearised(theta)
        inverse = np.linalg.inv(np.linalg.cholesky(B.T @ B)).T
        Q = B @ inverse
        inverse /= scale[:, None]
        meat, left = self.scatter.meat(Q), r - Q @ (Q.T @ r)
        power = power_of(self.scatter, left, Q)
        misfit = Estimate(power.found / power.expected, power.spread / power.expected)
        excess = unexplained(self.scatter, left, Q, power, self._slower())
        enlarged, whole = 1.0, meat
        if excess is not None:
            whole = meat + excess.size * excess.scatter.meat(Q)
            enlarged = math.sqrt(float(np.linalg.eigvalsh(np.linalg.solve(meat, whole)).max()))
        borne_out = excess is None or excess.by_chance
        covariance = np.zeros((8, 8))
        covariance[: self.k, : self.k] = inverse @ whole @ inverse.T
        return _Solution(theta, covariance, self._independent(), misfit, enlarged, borne_out)

    def _slower(self) -> list[Scatter]:
        """What the model may leave out, from a window's length to the longest wave that fits into the region."""
        points = self.points
        longest = max(np.ptp(points.x), np.ptp(points.y)) / (2 * math.pi)
        lengths = [points.sigma]
        while 2 * lengths[-1] < longest:
            lengths.append(2 * lengths[-1])
        lengths += [float(longest)] if longest > lengths[-1] else []
        found = []
        for length in lengths:
            slope = points.sigma / (math.sqrt(2) * length)
            part = Part(
                self.root * np.array([1, slope, slope] * 2), Correlation(points.x, points.y, length, 0)
            )
            found.append(Scatter(points.used, [part]))
        return found

    def _independent(self) -> float:
        ones = np.zeros((self.points.count, 6, 1))
        ones[:, 0] = 1
        return float(self.points.count**2 / (ones * self.scatter.correlate(ones, self.noise)).sum())
