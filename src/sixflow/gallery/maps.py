r"""Figure 7 and its hyperbolic counterparts: axes on which deformations are translations.

With I1(exp(τ₁L₁ + τ₂L₂) x) = I0(x) the maps obey M1(η + τ₁, ξ + τ₂) = M0(η, ξ):

| map | η | ξ | L₁, L₂ |
|---|---|---|---|
| log-polar (figure 7) | log r | atan2(y, x) | divergence, curl |
| hyperbolic, stretch | ½ log abs(x/y) | ½ log abs(xy) | stretch, divergence |
| hyperbolic, shear | ½ log abs((x+y)/(x−y)) | ½ log abs(x²−y²) | shear, divergence |

The frames are rendered from a pattern by the exact inverse of the motion; the maps, the correlation and its peak are
those of `sixflow.eigenfilters`. Points of the pattern are followed through every panel. (As corrected here:
the print puts both shears on one pair of axes, which cannot be, since [L_b, L_B] = 2 L_r. Each has axes of its own,
together with the divergence, in four sectors that the flow does not leave.)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from sixflow.convention.affine import six_from_coefficients
from sixflow.drawing.look import FONT, INK, new_figure, tidy
from sixflow.eigenfilters import (
    CanonicalCoordinates,
    Correlation,
    canonical,
    correlation_surface,
    hyperbolic_map,
    log_polar_map,
)
from sixflow.eigenfilters.generators import as_generator
from sixflow.gallery.look import POINTS, WIDTH, Real, plane
from sixflow.synth import Affine, Speckle, pair

HALF = 48  # px: frames of 97 × 97
R_MIN, R_MAX = 4.0, 28.0
"""Radii of the maps, px."""
PATTERN = Speckle(sigma=2.0, density=0.35, seed=4)

Point: TypeAlias = tuple[float, float, int]
"""η, ξ and sector of a point."""
Frames: TypeAlias = tuple[NDArray[Any], NDArray[Any]]
Maps: TypeAlias = tuple[xr.DataArray, xr.DataArray]


@dataclass(frozen=True)
class Case:
    """A deformation by two commuting generators, seen on their canonical axes.

    Attributes
    ----------
    first, second : str
        Symbols of L₁ and L₂.
    tau_eta, tau_xi : float
        τ₁ and τ₂ of the deformation.
    followed : tuple of (float, float, int)
        η, ξ and sector of the points that are followed.
    """

    first: str
    second: str
    tau_eta: float
    tau_xi: float
    followed: tuple[Point, ...]

    @property
    def coordinates(self) -> CanonicalCoordinates:
        """Canonical coordinates of the pair."""
        return canonical(self.first, self.second)

    def motion(self) -> Affine:
        """The map exp(τ₁L₁ + τ₂L₂) about the middle of the frame."""
        tau = np.zeros(6)
        tau[as_generator(self.first).index], tau[as_generator(self.second).index] = self.tau_eta, self.tau_xi
        return Affine.from_six(six_from_coefficients(tau), centre=(HALF, HALF))

    def frames(self) -> Frames:
        """The pattern before and after, 97 × 97 px."""
        made = pair(PATTERN, self.motion(), (2 * HALF + 1, 2 * HALF + 1))
        return made.frame0, made.frame1

    def map(self, frame: NDArray[Any]) -> xr.DataArray:
        """The neighbourhood of the middle of a frame on canonical axes."""
        if self.first == "L_s":
            return log_polar_map(frame, HALF, HALF, r_min=R_MIN, r_max=R_MAX, shape=(96, 192))
        return hyperbolic_map(
            frame, HALF, HALF, generator=self.first, r_min=R_MIN, r_max=R_MAX, eta_max=0.8, shape=(96, 96)
        )


ZOOM_AND_ROTATION = Case(
    "L_s",
    "L_r",
    float(np.log(1.25)),
    float(np.radians(30)),
    ((2.62, 0.52, 0), (2.77, -1.52, 0), (2.77, -2.40, 0)),
)
STRETCH_AND_ZOOM = Case(
    "L_b", "L_s", 0.25, 0.15, ((0.27, 2.17, 0), (0.12, 2.72, 1), (0.02, 2.45, 2), (-0.14, 2.68, 3))
)
SHEAR_AND_ZOOM = Case(
    "L_B", "L_s", 0.25, 0.15, ((-0.1, 2.72, 0), (-0.02, 2.08, 1), (0.08, 2.15, 2), (-0.03, 2.78, 3))
)


def draw_log_polar() -> Figure:
    """Figure 7: a zoom and a rotation, in the frame, on log-polar axes, and the correlation of the maps."""
    case = ZOOM_AND_ROTATION
    figure = new_figure(WIDTH, 4.45)
    grid: Any = figure.add_gridspec(2, 1, height_ratios=(1.5, 1))
    first, second, right = grid[0].subgridspec(1, 3).subplots()
    frames = case.frames()
    maps = case.map(frames[0]), case.map(frames[1])
    _draw_frames(first, second, case, frames)
    angle = np.linspace(0, 2 * np.pi, 121)
    for ax in (first, second):
        for radius in (R_MIN, R_MAX):
            ax.plot(HALF + radius * np.cos(angle), HALF + radius * np.sin(angle), "w--", linewidth=0.8)
    found = _draw_correlation(right, case, maps, "rotation, $τ_ξ$ (°)", "log of the zoom, $τ_η$")
    _title(right, f"zoom {np.exp(found.tau_eta):.4f}, rotation {np.degrees(found.tau_xi):.2f}°")
    lower = grid[1].subgridspec(1, 2, wspace=0.06).subplots()
    for ax, values, when in zip(lower, maps, ("before", "after"), strict=True):
        _draw_map(ax, case, values, dict(zip(POINTS, case.followed, strict=False)), moved=when == "after")
        tidy(ax, title=f"log-polar map, {when}", x_label="ξ = atan2(y, x) (°)", y_label="η = log(r / px)")
        ax.set_xticks([-180, -90, 0, 90])
    lower[1].label_outer()
    return figure


def draw_hyperbolic(case: Case) -> Figure:
    """A shear and a zoom, in the frame, on hyperbolic axes in four sectors, and the correlation of the maps."""
    figure = new_figure(WIDTH, 6.3)
    grid: Any = figure.add_gridspec(2, 1, height_ratios=(1, 1.45))
    first, second, right = grid[0].subgridspec(1, 3).subplots()
    frames = case.frames()
    maps = case.map(frames[0]), case.map(frames[1])
    eta, xi = maps[0]["eta"].values, maps[0]["xi"].values
    _draw_frames(first, second, case, frames)
    for ax in (first, second):
        _draw_sectors(ax, case, eta, xi)
    name = as_generator(case.first).name
    found = _draw_correlation(right, case, maps, "log of the zoom, $τ_ξ$", f"{name}, $τ_η$")
    _title(right, f"$τ_η$ = {found.tau_eta:.4f}, $τ_ξ$ = {found.tau_xi:.4f}")
    lower = grid[1].subgridspec(2, 4, wspace=0.02, hspace=0.02).subplots(sharex=True, sharey=True)
    coordinates = case.coordinates
    labels = f"ξ = {coordinates.xi_name}", f"η = {coordinates.eta_name}"
    for row, values, when in zip(lower, maps, ("before", "after"), strict=True):
        for sector, ax in enumerate(row):
            shown = {POINTS[sector]: case.followed[sector]}
            _draw_map(ax, case, values[sector], shown, moved=when == "after")
            tidy(ax, title=f"sector {sector}, {when}", x_label=labels[0], y_label=labels[1])
            ax.label_outer()
    return figure


def _draw_frames(before: Axes, after: Axes, case: Case, frames: Frames) -> None:
    """Both frames, with the points, and in the second the way that they came."""
    for ax, frame, title in zip((before, after), frames, ("before", "after"), strict=True):
        ax.imshow(frame, cmap="gray", vmin=_DARK, vmax=_BRIGHT, interpolation="nearest")
        plane(ax, HALF + 0.5, title, centre=HALF)
    after.label_outer()
    part = np.linspace(0, 1, 41)
    for colour, (eta, xi, sector) in zip(POINTS, case.followed, strict=False):
        way = case.coordinates.inverse(eta + part * case.tau_eta, xi + part * case.tau_xi, sector)
        x, y = (HALF + coordinate for coordinate in way)
        _mark(before, x[:1], y[:1], colour)
        _mark(after, x, y, colour)


_DARK, _BRIGHT = 48, 208


def _mark(ax: Axes, x: Real, y: Real, colour: str) -> None:
    """A ring around the place of a point at the end of its way, and the way."""
    ring: dict[str, Any] = {"marker": "o", "markersize": 9, "markerfacecolor": "none"}
    for shade, width in (("white", 3.2), (colour, 1.6)):
        ax.plot(x, y, color=shade, linewidth=width, solid_capstyle="round")
        ax.plot(x[-1], y[-1], markeredgecolor=shade, markeredgewidth=width, **ring)


def _draw_map(ax: Axes, case: Case, values: xr.DataArray, points: dict[str, Point], *, moved: bool) -> None:
    """A map, with points by their colours."""
    unit, eta = _xi_unit(case), values["eta"].values
    xi = unit * values["xi"].values
    d_eta, d_xi = (eta[1] - eta[0]) / 2, (xi[1] - xi[0]) / 2
    extent = (xi[0] - d_xi, xi[-1] + d_xi, eta[-1] + d_eta, eta[0] - d_eta)
    ax.imshow(
        values, cmap="gray", vmin=_DARK, vmax=_BRIGHT, extent=extent, interpolation="nearest", aspect="auto"
    )
    way = np.array([0.0, 1.0]) if moved else np.zeros(1)
    for colour, (at_eta, at_xi, _) in points.items():
        _mark(ax, unit * (at_xi + way * case.tau_xi), at_eta + way * case.tau_eta, colour)
    ax.set_xlim(extent[:2])
    ax.set_ylim(extent[2:])


def _xi_unit(case: Case) -> float:
    """What ξ is multiplied by where it is drawn: angles are in degrees."""
    return 180 / np.pi if np.isfinite(case.coordinates.xi_period) else 1.0


def _draw_sectors(ax: Axes, case: Case, eta: Real, xi: Real) -> None:
    """Outlines of what the maps show, in the colours of the sectors' points."""
    e, x = (np.linspace(values[0], values[-1], 41) for values in (eta, xi))
    around = (
        np.concatenate([e, np.full(41, e[-1]), e[::-1], np.full(41, e[0])]),
        np.concatenate([np.full(41, x[0]), x, np.full(41, x[-1]), x[::-1]]),
    )
    for sector, colour in enumerate(POINTS):
        X, Y = case.coordinates.inverse(*around, sector)
        for shade, width in (("white", 1.8), (colour, 0.9)):
            ax.plot(HALF + X, HALF + Y, color=shade, linewidth=width)


def _draw_correlation(ax: Axes, case: Case, maps: Maps, xi_label: str, eta_label: str) -> Correlation:
    """The correlation surface, with a ring around its peak."""
    found, unit = correlation_surface(*maps), _xi_unit(case)
    eta, xi = found.surface["eta"].values, unit * found.surface["xi"].values
    extent = (xi[0], xi[-1], eta[-1], eta[0])
    ax.imshow(found.surface, cmap="magma", vmin=0, extent=extent, interpolation="nearest", aspect="auto")
    for line in (ax.axhline, ax.axvline):
        line(0, color="white", linewidth=0.5, linestyle=":")
    ax.plot(unit * found.tau_xi, found.tau_eta, "wo", markersize=8, markerfacecolor="none")
    tidy(ax, title="", x_label=xi_label, y_label=eta_label)
    ax.set_box_aspect(1)
    return found


def _title(ax: Axes, text: str) -> None:
    ax.set_title(f"correlation of the maps:\n{text}", fontsize=FONT + 1, color=INK, pad=4, loc="left")
