r"""Figure 4: what a quadrature pair answers to a pattern that is shifted (Eagleson, §4.2).

A pattern f(x) that has moved by τ gives the complex response g(τ) = Σ_x f(x − τ) w(x). For the kernel
w = G(x) exp(−iux) under a Gaussian G, and the grating f = mean + a cos(ux), it is

    g(τ) = mean · ŵ(0) + ½ a ŵ(u) exp(−iuτ) + ½ a ŵ(−u) exp(iuτ),   ŵ(k) = Σ_x w(x) exp(ikx)

| symbol | meaning |
|---|---|
| ŵ(u) | response to the kernel's own wave: a circle, passed through at the rate −u per px |
| ŵ(−u) | response to its mirror image: makes the circle an ellipse, a little |
| ŵ(0) | response to a constant: moves the circle's centre away from 0, and bends the phase |

Three pairs are compared: the Gabor pair as printed, cos and sin, of which the even one has ŵ(0) ≠ 0; the pair
cos(ux ∓ π/4), whose two kernels have the same ŵ(0); and the pair free of DC, ŵ(0) = 0. (As corrected here: the print
offers the second as the remedy for the first. It is the first turned by π/4 in the complex plane: the circle's centre
is as far from 0 as before, in another direction.)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sixflow.drawing.look import FONT, INK, new_figure, tidy
from sixflow.eigenfilters.kernel import Complex
from sixflow.eigenfilters.kernels import Gabor
from sixflow.gallery.look import BEFORE, EVEN, ODD, POINTS, WIDTH, Real
from sixflow.synth import Grating, Pattern, Texture

WAVELENGTH, SIGMA, RADIUS = 16.0, 5.6, 28  # px
FREQUENCY = 2 * np.pi / WAVELENGTH
MEAN, AMPLITUDE = 128.0, 40.0
"""Of the grating, grey values."""


@dataclass(frozen=True)
class Pair:
    """A complex kernel of one dimension, whose real and imaginary part are the pair.

    Attributes
    ----------
    title, first, second : str
        Its name, and those of its two kernels.
    weights : array, shape (2 RADIUS + 1,)
        w at whole px.
    """

    title: str
    first: str
    second: str
    weights: Complex

    def response(self, pattern: Pattern, shifts: Real) -> Complex:
        """g(τ) of a pattern that has moved along x by each of the shifts, px."""
        x = np.arange(-RADIUS, RADIUS + 1)
        return np.asarray(pattern(x - shifts[:, None], 0.0) @ self.weights, np.complex128)


def quadrature_pairs() -> tuple[Pair, ...]:
    """Return the pair as printed, the pair of equal DC, and the pair free of DC."""
    equal = _profile(Gabor(FREQUENCY, sigma=SIGMA, shape="equal-dc"))
    free = _profile(Gabor(FREQUENCY, sigma=SIGMA))
    return (
        Pair("Gabor pair", r"$\cos\,ux$", r"$-\sin\,ux$", equal * np.exp(-0.25j * np.pi)),
        Pair("pair of equal DC", r"$\cos(ux - π/4)$", r"$\cos(ux + π/4)$", equal),
        Pair("pair free of DC", r"$\cos\,ux$ − dc", r"$-\sin\,ux$", free),
    )


def _profile(kernel: Gabor) -> Complex:
    """A kernel summed over y, which is what acts on a pattern that does not depend on y."""
    return np.asarray(kernel.sample(RADIUS).sum(axis=0))


def grating() -> Grating:
    """Return the grating of the kernels' own wavelength, on a bright ground."""
    return Grating(wavelength=WAVELENGTH, contrast=AMPLITUDE / np.sqrt(2), mean=MEAN)


TEXTURE = Texture(shortest=8, longest=48, mean=MEAN, seed=1)
"""A pattern of many waves; along a row it is one of one dimension."""

_SHIFTS = np.linspace(0, WAVELENGTH, 161)
_TITLES = ("kernels", "their responses", "$g$ = first + i·second", "phase of $g$")


def draw_quadrature() -> Figure:
    """Figure 4: three pairs; their kernels, their responses against shift, in the complex plane, and the phase."""
    figure = new_figure(WIDTH, 5.55)
    axes: Any = figure.subplots(3, 4)
    pairs = quadrature_pairs()
    for row, pair in zip(axes, pairs, strict=True):
        _draw_row(row, pair)
    _draw_texture(axes[2, 2], axes[2, 3], pairs[2])
    for ax, title in zip(axes[0], _TITLES, strict=True):
        ax.set_title(title, fontsize=FONT + 1, color=INK, pad=4, loc="left")
    for ax in axes[:2].flat:
        ax.set_xlabel("")
        ax.tick_params(labelbottom=False)
    for ax in axes.flat:
        ax.set_box_aspect(1)
    return figure


def _draw_row(row: Any, pair: Pair) -> None:
    kernels, responses, trace, phase = row
    x = np.arange(-RADIUS, RADIUS + 1.0)
    _two_lines(kernels, x, pair.weights / np.abs(pair.weights).max(), pair)
    tidy(kernels, title="", x_label="x (px)", y_label=pair.title)
    kernels.set_ylim(-1.1, 1.9)
    kernels.legend(**_LEGEND)
    own = np.abs(pair.weights @ np.exp(1j * FREQUENCY * x)) * AMPLITUDE / 2
    g = pair.response(grating(), _SHIFTS) / own
    _two_lines(responses, _SHIFTS, g, pair)
    tidy(responses, title="", x_label="shift τ (px)", y_label="")
    responses.set_ylim(-1.9, 1.9)
    _draw_trace(trace, g)
    tidy(trace, title="", x_label="Re $g$", y_label="Im $g$")
    phase.plot(_SHIFTS, np.unwrap(np.angle(g)), color=EVEN, linewidth=1.2, label="grating")
    straight = np.angle(g[0]) - FREQUENCY * _SHIFTS
    phase.plot(_SHIFTS, straight, "--", color=ODD, linewidth=0.9, label="slope $-u$")
    tidy(phase, title="", x_label="shift τ (px)", y_label="arg $g$ (rad)")
    phase.set_ylim(-10, 3.5)
    phase.legend(**_LEGEND | {"loc": "lower left"})


_LEGEND: dict[str, Any] = {
    "fontsize": FONT, "frameon": False, "labelcolor": INK, "loc": "upper right", "borderaxespad": 0.1,
    "handlelength": 1.3, "labelspacing": 0.2,
}  # fmt: skip


def _two_lines(ax: Axes, x: Real, values: Complex, pair: Pair) -> None:
    ax.axhline(0, color=BEFORE, linewidth=0.5)
    ax.plot(x, values.real, color=EVEN, linewidth=1, label=pair.first)
    ax.plot(x, values.imag, color=ODD, linewidth=1, label=pair.second)


def _draw_trace(ax: Axes, g: Complex) -> None:
    """The path of g in the complex plane, with a dot every eighth of a wavelength and an arrow at the start."""
    ax.axhline(0, color=BEFORE, linewidth=0.5)
    ax.axvline(0, color=BEFORE, linewidth=0.5)
    ax.plot(g.real, g.imag, color=EVEN, linewidth=1)
    ax.plot(g.real[:-1:20], g.imag[:-1:20], "o", color=EVEN, markersize=2.5)
    ax.plot(g.real[0], g.imag[0], "o", color=EVEN, markersize=5)
    ax.annotate(
        "", (g.real[14], g.imag[14]), (g.real[9], g.imag[9]), arrowprops={"arrowstyle": "-|>", "color": EVEN}
    )
    ax.set_xlim(-1.9, 1.9)
    ax.set_ylim(-1.9, 1.9)


def _draw_texture(trace: Axes, phase: Axes, pair: Pair) -> None:
    """What a pattern of many waves does: a wobbling trace, and a phase that is only nearly straight."""
    g = pair.response(TEXTURE, _SHIFTS)
    g /= np.abs(g).mean()
    trace.plot(g.real, g.imag, color=POINTS[1], linewidth=0.8, zorder=1)
    phase.plot(_SHIFTS, np.unwrap(np.angle(g)), color=POINTS[1], linewidth=0.8, label="texture", zorder=1)
    phase.legend(**_LEGEND | {"loc": "lower left"})
