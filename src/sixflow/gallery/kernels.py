r"""Figures 5, 6 and 8 to 11: the even and the odd operator of every family, in three forms.

| form | formula | where |
|---|---|---|
| as printed | exp(−i(uη + vξ)) | no window; figures 10 and 11 in two of the four sectors only |
| with the Jacobian | J exp(−i(uη + vξ)) | §4.3.2; every sector, but still no window |
| localised | gain · J · window · (exp(−i(uη + vξ)) − dc) | `sample` of a kernel of the library, pixel by pixel |

The even operator is the real part, cos(uη + vξ), the odd one the imaginary part, −sin(uη + vξ). The first two forms are
functions of real x and y, the third is what is correlated with images.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import AsinhNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from sixflow.drawing.look import FONT, INK, MASKED_EDGE, MASKED_FACE, REFERENCE, new_figure, nice_below
from sixflow.eigenfilters.coordinates import canonical
from sixflow.eigenfilters.kernel import Complex, Kernel
from sixflow.eigenfilters.kernels import Gabor, Hyperbolic, Spiral
from sixflow.gallery.look import WIDTH, Real, plane, signed_map

CELLS = (478, 480)
"""Points along the height and the width of a panel where a function of real x and y is evaluated. Both numbers are even
and they differ, so that no point is on a singular line, x = 0, y = 0 or y = ±x."""


@dataclass(frozen=True)
class Operator:
    """One figure of the paper.

    Attributes
    ----------
    kernel : Kernel
        Localised, as the library uses it; its pair and orders are those of all three forms.
    radius : int
        Of the patch, px.
    coordinate : str
        The phase u η as it is written in titles, in mathematical notation.
    jacobian : str
        J, likewise; empty where it is 1.
    printed : tuple of int
        Sectors in which the formula of the print has a value.
    singular : tuple of float
        Directions of the singular lines, degrees.
    """

    kernel: Kernel
    radius: int
    coordinate: str
    jacobian: str = ""
    printed: tuple[int, ...] = (0,)
    singular: tuple[float, ...] = ()


X_TRANSLATION = Operator(Gabor(1.5, 0.0, sigma=4.0), 12, "ux")
Y_TRANSLATION = Operator(Gabor(1.0, np.pi / 2, sigma=4.0), 12, "vy")
DIVERGENCE = Operator(Spiral(6.0, 0, scale=9.0), 24, r"u\,\log\,r", "1/r^2")
CURL = Operator(Spiral(0.0, 6, scale=9.0), 24, r"v\ \mathrm{atan2}(y, x)", "1/r^2")
STRETCH = Operator(Hyperbolic("stretch", 3.0, scale=11.0), 24, r"u\,η_b", "1/(2|xy|)", (0, 2), (0.0, 90.0))
SHEAR = Operator(Hyperbolic("shear", 3.0, scale=11.0), 24, r"u\,η_B", "1/|x^2-y^2|", (0, 2), (45.0, 135.0))


def eigenfunction(
    kernel: Kernel, x: Any, y: Any, *, jacobian: bool = False, sectors: tuple[int, ...] | None = None
) -> Complex:
    """The eigenfunction of a kernel's pair and orders, without window, DC term and gain (Eagleson, §4.3.2).

    Parameters
    ----------
    kernel : Kernel
        Whose pair (L₁, L₂) and orders (u, v) are taken.
    x, y : arrays that broadcast together
        Position relative to the centre, px, off the singular lines.
    jacobian : bool
        Whether the result is multiplied by J = |∂(η, ξ)/∂(x, y)|.
    sectors : tuple of int, optional
        Sectors in which it is wanted; NaN elsewhere.

    Returns
    -------
    complex128 array of the broadcast shape
        exp(−i(uη + vξ)), or J exp(−i(uη + vξ)).

    Examples
    --------
    Moved along its generator by τ, the phase changes by −uτ:

    >>> from sixflow.eigenfilters.generators import L_b
    >>> before, after = (eigenfunction(STRETCH.kernel, *L_b.flow(tau, 5.0, 3.0)) for tau in (0.0, 0.2))
    >>> print(f"{np.angle(after / before):.3f}")
    -0.600
    """
    coordinates = canonical(*kernel.generators)
    u, v = kernel.orders
    sector = coordinates.sector(x, y)
    with np.errstate(invalid="ignore"):
        w = np.exp(-1j * (u * coordinates.eta(x, y) + v * coordinates.xi(x, y)))
        if jacobian:
            w = w * coordinates.jacobian(x, y)
    wanted = sector >= 0 if sectors is None else np.isin(sector, sectors)
    return np.where(wanted, w, complex(np.nan, np.nan))


class Form(NamedTuple):
    """One column of a figure: values, their scale, and what stands above and below them."""

    title: str
    values: Complex
    norm: Normalize
    unit: str
    ticks: tuple[float, ...]


_PANEL = (WIDTH - 0.64) / 3  # inches


def draw_operator(operator: Operator) -> Figure:
    """Draw the even (above) and the odd operator (below) of a family in its forms, side by side."""
    forms = _forms(operator)
    figure = new_figure(_PANEL * len(forms) + 0.64, 2 * _PANEL + 0.82)
    layout: Any = figure.get_layout_engine()
    layout.set(w_pad=0.03, h_pad=0.03, wspace=0.01, hspace=0.01)
    axes: Any = figure.subplots(2, len(forms), sharex=True, sharey=True)
    half = operator.radius + 0.5
    for column, form in zip(axes.T, forms, strict=True):
        for ax, part in zip(column, (form.values.real, form.values.imag), strict=True):
            plane(ax, half)
            _draw_part(ax, part, form.norm, half)
            _draw_singular(ax, operator.singular, half)
        column[0].set_title(form.title, fontsize=FONT + 1, color=INK, pad=4)
        _draw_bar(figure, column, form)
    for row, name in zip(axes, _names(operator), strict=True):
        row[0].set_ylabel(f"{name}\ny (px)", linespacing=1.6)
    for ax in axes.flat:
        ax.label_outer()
    return figure


def _forms(operator: Operator) -> list[Form]:
    kernel, radius = operator.kernel, operator.radius
    x, y = _points(radius + 0.5)
    printed = eigenfunction(kernel, x, y, sectors=operator.printed)
    forms = [Form("as printed", printed, Normalize(-1, 1), "$w$", (-1, 0, 1))]
    if operator.jacobian:
        whole = eigenfunction(kernel, x, y, jacobian=True)
        limit = 10.0 ** round(math.log10(np.quantile(np.abs(whole), 0.97)))
        scale = AsinhNorm(linear_width=limit / 30, vmin=-limit, vmax=limit)
        ticks = (-limit, -limit / 10, 0.0, limit / 10, limit)
        forms.append(Form(f"with the Jacobian $J = {operator.jacobian}$", whole, scale, "$w$ (px⁻²)", ticks))
    sampled = kernel.sample(radius)
    largest = float(np.abs(sampled.view(np.float64)).max())
    tick = nice_below(largest)
    norm = Normalize(-largest, largest)
    forms.append(Form("localised, in pixels", sampled, norm, "$w$, of unit noise gain", (-tick, 0.0, tick)))
    return forms


def _names(operator: Operator) -> tuple[str, str]:
    return rf"even: $\cos({operator.coordinate})$", rf"odd: $-\sin({operator.coordinate})$"


def _points(half: float) -> tuple[Real, Real]:
    """Middles of the cells of a panel: x as a row, y as a column."""
    y, x = ((np.arange(n) + 0.5) / n * 2 * half - half for n in CELLS)
    return x[None, :], y[:, None]


def _draw_part(ax: Axes, part: Real, norm: Normalize, half: float) -> None:
    """A kernel, and hatches where it has no value."""
    extent = (-half, half, half, -half)
    ax.imshow(part, cmap=signed_map(), norm=norm, extent=extent, interpolation="nearest", aspect="equal")
    if np.isnan(part).any():
        nowhere = Rectangle((-half, -half), 2 * half, 2 * half, zorder=-1, **_NOWHERE)
        ax.add_patch(nowhere)


def _draw_singular(ax: Axes, directions: tuple[float, ...], half: float) -> None:
    for angle in np.radians(directions):
        along = np.array([-2.0, 2.0]) * half
        ax.plot(along * np.cos(angle), along * np.sin(angle), color=REFERENCE, linewidth=0.8)


_NOWHERE: dict[str, Any] = {
    "facecolor": MASKED_FACE, "edgecolor": MASKED_EDGE, "hatch": "////", "linewidth": 0.0
}  # fmt: skip


def _draw_bar(figure: Figure, column: Any, form: Form) -> None:
    limit = form.norm.vmax or np.inf
    beyond = max(np.nanmax(np.abs(part)) for part in (form.values.real, form.values.imag)) > 1.001 * limit
    bar = figure.colorbar(
        column[0].images[0], ax=list(column), location="bottom", shrink=0.8, aspect=26, pad=0.02,
        extend="both" if beyond else "neither", ticks=list(form.ticks),
    )  # fmt: skip
    bar.ax.minorticks_off()
    bar.ax.set_xticklabels([f"{tick:g}".replace("-", "−") for tick in form.ticks])
    bar.set_label(form.unit, fontsize=FONT, color=INK, labelpad=2)
    bar.outline.set_linewidth(0.5)
    bar.ax.tick_params(labelsize=FONT, width=0.5, length=2, color=INK, labelcolor=INK)
