"""What is in the gallery: for each figure how it is drawn, and what is said about it.

The texts are fragments of HTML that are well-formed XML too. Where the paper's print is wrong, a note says so, and
what is drawn instead.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass

from matplotlib.figure import Figure

from sixflow.gallery.deformations import draw_derivatives, draw_generators
from sixflow.gallery.kernels import (
    CURL,
    DIVERGENCE,
    SHEAR,
    STRETCH,
    X_TRANSLATION,
    Y_TRANSLATION,
    draw_operator,
)
from sixflow.gallery.maps import SHEAR_AND_ZOOM, STRETCH_AND_ZOOM, draw_hyperbolic, draw_log_polar
from sixflow.gallery.quadrature import draw_quadrature


@dataclass(frozen=True)
class Entry:
    """One figure of the gallery.

    Attributes
    ----------
    name : str
        Of its file, without suffix, and of its place on the page.
    label : str
        "Figure 1" as in the paper, or "Beyond the paper".
    title : str
        What it shows, in plain text.
    draw : callable
        Returns the figure.
    formula, caption : str
        HTML.
    note : str
        HTML: where the print is wrong, and what is drawn instead; may be empty.
    """

    name: str
    label: str
    title: str
    draw: Callable[[], Figure]
    formula: str
    caption: str
    note: str = ""


_FORMS = (
    "Left, as printed. Middle, with the Jacobian, which makes the measure invariant (§4.3.2): without it a zoom would "
    "change the size of the response as well. It grows without limit where the coordinates are singular, so that the "
    "colour scale is linear about 0, logarithmic further out, and ends at ±0.1 px<sup>−2</sup>. Right, localised, free "
    "of DC, and sampled in pixels, as the library correlates it with images."
)
_NO_JACOBIAN = (
    "The print draws the kernel without the Jacobian that its §4.3.2 derives, and without a window: the middle and the "
    "right column are added. "
)

CATALOGUE: tuple[Entry, ...] = (
    Entry(
        name="figure-01-derivatives",
        label="Figure 1",
        title="Combinations of spatial derivatives of optical flow",
        draw=draw_derivatives,
        formula="divergence = <i>u<sub>x</sub></i> + <i>v<sub>y</sub></i>, curl = <i>v<sub>x</sub></i> − "
        "<i>u<sub>y</sub></i>, stretch = <i>u<sub>x</sub></i> − <i>v<sub>y</sub></i>, shear = "
        "<i>u<sub>y</sub></i> + <i>v<sub>x</sub></i>",
        caption="Dilation, vorticity and the two components of shear. Above, the vector fields: arrows lead from a "
        "point to where it goes, true to scale, and a dashed square goes over into the filled shape. Below, a square "
        "grid (grey) and its image (blue). Each deformation is exp(<i>τL</i>) with <i>τ</i> = 0.25: the velocity field "
        "has that one number, 2<i>τ</i> = 0.5, and none of the others. As y points down, positive curl turns clockwise "
        "on the screen, and positive shear lengthens the diagonal that falls to the right. Divergence and curl stay "
        "the same when the image axes are turned; stretch and shear are one oriented quantity, <i>ρ</i> cos "
        "2<i>θ</i> + <i>σ</i> sin 2<i>θ</i>: turned by 45°, one becomes the other.",
    ),
    Entry(
        name="figure-03-trajectories",
        label="Figure 3",
        title="Trajectories of the six one-parameter groups",
        draw=draw_generators,
        formula="<i>x</i>′ = exp(<i>τL</i>) <i>x</i> (4)",
        caption="The ways of points as <i>τ</i> grows, for the pairs {<i>L<sub>x</sub></i>, <i>L<sub>y</sub></i>}, "
        "{<i>L<sub>s</sub></i>, <i>L<sub>r</sub></i>}, {<i>L<sub>b</sub></i>, <i>L<sub>B</sub></i>}. Arrowheads stand "
        "at equal steps of <i>τ</i> (2.5 px for the translations, π/6 for the rotation, 0.5 for the others), so that "
        "their distance shows the speed. The trajectories of the two shears are the congruent families of hyperbolae "
        "<i>xy</i> = const. and <i>x</i>² − <i>y</i>² = const., turned by 45° against each other. Lines that are "
        "their own image, such as the axes under <i>L<sub>b</sub></i>, are never crossed: they bound the sectors of "
        "the hyperbolic operators.",
        note="Eq. (4) prints cos and sin for <i>L<sub>B</sub></i>: <i>x</i>′ = <i>x</i> cos <i>τ</i> − <i>y</i> sin "
        "<i>τ</i>, <i>y</i>′ = <i>x</i> sin(−<i>τ</i>) + <i>y</i> cos(−<i>τ</i>). Its curves (dashed, through the two "
        "dots) are circles and ellipses, and it is no one-parameter group: it changes areas by cos 2<i>τ</i>. Drawn "
        "is exp(<i>τL<sub>B</sub></i>): <i>x</i>′ = <i>x</i> cosh <i>τ</i> + <i>y</i> sinh <i>τ</i>, <i>y</i>′ = "
        "<i>x</i> sinh <i>τ</i> + <i>y</i> cosh <i>τ</i>.",
    ),
    Entry(
        name="figure-04-quadrature",
        label="Figure 4",
        title="Translation as phase shift of a complex quadrature pair's response",
        draw=draw_quadrature,
        formula="<i>g</i>(<i>τ</i>) = Σ <i>f</i>(<i>x</i> − <i>τ</i>) <i>w</i>(<i>x</i>) ∝ exp(−<i>iuτ</i>)",
        caption="A grating of the kernels' own wavelength (16 px, grey values 128 ± 40) is shifted by <i>τ</i>. The "
        "responses of the two kernels are the coordinates of a point (third column; large dot: <i>τ</i> = 0, small "
        "ones: every 2 px) that runs along a circle; its angle is the phase, ideally straight in <i>τ</i> with the "
        "slope −<i>u</i>. First row: the even Gabor kernel answers to the mean grey value as well, which moves the "
        "centre of the circle by 57 % of its radius and bends the phase by up to 0.61 rad, a shift of 1.5 px. Second "
        "row: the pair cos(<i>ux</i> ∓ π/4), mirror images with the same DC response. Third row: with the DC taken "
        "out of the even kernel the phase of the grating is straight to 0.01 rad; that of a texture of many waves "
        "(8 to 48 px, green) remains bent, by its own changes of amplitude and frequency.",
        note="The print offers the pair of equal DC as the remedy for the DC response of the even kernel. It is the "
        "first pair, turned by 45° in the complex plane: the circle is as far off, and the phase as bent, as before. "
        "Only a kernel without DC response (third row) is a remedy.",
    ),
    Entry(
        name="figure-05-x-translation",
        label="Figure 5",
        title="Even and odd x-translation operators",
        draw=functools.partial(draw_operator, X_TRANSLATION),
        formula="exp(−<i>iux</i>), <i>u</i> = 1.5 rad/px",
        caption="Even (cosine) operator above, odd (sine) below; blue is negative, red positive. Left, the "
        "eigenfunction of <i>L<sub>x</sub></i> as printed: a pattern that moves by <i>τ</i> changes the phase of the "
        "response by −<i>uτ</i>. Its Jacobian is 1. Right, the Gabor kernel of the library in its pixels: under a "
        "Gaussian of 4 px, free of DC, and of unit noise gain (Σ|<i>w</i>|² = 1). The wavelength is 4.2 px. The print "
        "gives no unit of length; ours is the pixel.",
    ),
    Entry(
        name="figure-06-y-translation",
        label="Figure 6",
        title="Even and odd y-translation operators",
        draw=functools.partial(draw_operator, Y_TRANSLATION),
        formula="exp(−<i>ivy</i>), <i>v</i> = 1.0 rad/px",
        caption="As figure 5, for <i>L<sub>y</sub></i>; the wavelength is 6.3 px. As y points down, a pattern that "
        "moves down by <i>τ</i> changes the phase by −<i>vτ</i>.",
    ),
    Entry(
        name="figure-07-log-polar",
        label="Figure 7",
        title="Mapping to log-polar coordinates: divergence and curl become orthogonal translations",
        draw=draw_log_polar,
        formula="<i>η</i> = log <i>r</i>, <i>ξ</i> = atan2(<i>y</i>, <i>x</i>); <i>M</i><sub>1</sub>(<i>η</i> + "
        "<i>τ<sub>s</sub></i>, <i>ξ</i> + <i>τ<sub>r</sub></i>) = <i>M</i><sub>0</sub>(<i>η</i>, <i>ξ</i>)",
        caption="Above, a speckle texture before and after a zoom by 1.25 and a rotation by 30°; rings go with the "
        "pattern, and their tails show the way, along spirals. Below, the neighbourhood between the dashed circles "
        "(4 and 28 px) on log-polar axes: every point moves by the same vector, down by log 1.25 and to the right by "
        "30°, and only what enters and leaves at the edge of η is new. Above right, the phase correlation of the two "
        "maps, with the numbers that its peak (ring) gives: it is the sum over the phase shifts of all divergence and "
        "curl operators at once.",
    ),
    Entry(
        name="figure-08-divergence",
        label="Figure 8",
        title="Even and odd divergence operators",
        draw=functools.partial(draw_operator, DIVERGENCE),
        formula="exp(−<i>iu</i> log (<i>x</i>² + <i>y</i>²)<sup>1/2</sup>), <i>u</i> = 6; <i>J</i> = 1/<i>r</i>²",
        caption="Rings whose radii grow in geometric progression, by exp(2π/6) = 2.85 from one ring to the next of its "
        "kind: a zoom by exp(<i>τ</i>) changes the phase of the response by −6<i>τ</i>. " + _FORMS,
        note=_NO_JACOBIAN
        + "At <i>r</i> = 0 the print is singular: the window of the localised kernel, a Gaussian in "
        "log <i>r</i>, vanishes there. Distances are in px; another unit adds a constant phase only.",
    ),
    Entry(
        name="figure-09-curl",
        label="Figure 9",
        title="Even and odd curl operators",
        draw=functools.partial(draw_operator, CURL),
        formula="exp(−<i>iv</i> atan2(<i>y</i>, <i>x</i>)), <i>v</i> = 6; <i>J</i> = 1/<i>r</i>²",
        caption="Six pairs of spokes: a rotation by <i>τ</i> changes the phase of the response by −6<i>τ</i>, and "
        "one by 60° not at all, so that this operator alone can tell rotations of up to 30° either way. "
        + _FORMS,
        note=_NO_JACOBIAN
        + "The print has tan<sup>−1</sup>(<i>y</i>/<i>x</i>), which jumps by π at <i>x</i> = 0: "
        "for <i>v</i> = 6, or any even order, that changes nothing; an odd one would be cut in two. Drawn with "
        "atan2(<i>y</i>, <i>x</i>).",
    ),
    Entry(
        name="figure-10-stretch",
        label="Figure 10",
        title="Even and odd shear operators: stretch along x and y",
        draw=functools.partial(draw_operator, STRETCH),
        formula="exp(−<i>iuη<sub>b</sub></i>), <i>η<sub>b</sub></i> = ½ log |<i>x</i>/<i>y</i>|, <i>u</i> = 3; "
        "<i>J</i> = 1/(2|<i>xy</i>|)",
        caption="Constant on rays, which stretching in x and compressing in y turns towards the x axis: stretch by "
        "2<i>τ</i> changes the phase of the response by −3<i>τ</i>. Grey lines are singular: there is no end of "
        "oscillations towards them. " + _FORMS,
        note=_NO_JACOBIAN
        + "The print's exp{<i>iu</i> · ½ log(<i>y</i>/<i>x</i>)} is exp(−<i>iuη<sub>b</sub></i>), but has a value "
        "only where <i>xy</i> &gt; 0; elsewhere (hatched) it asks for the logarithm of a negative number. "
        "With |<i>x</i>/<i>y</i>| it holds in all four sectors.",
    ),
    Entry(
        name="figure-11-shear",
        label="Figure 11",
        title="Even and odd shear operators: shear along the diagonals",
        draw=functools.partial(draw_operator, SHEAR),
        formula="exp(−<i>iuη<sub>B</sub></i>), <i>η<sub>B</sub></i> = ½ log |(<i>x</i> + <i>y</i>)/(<i>x</i> − "
        "<i>y</i>)|, <i>u</i> = 3; <i>J</i> = 1/|<i>x</i>² − <i>y</i>²|",
        caption="Figure 10 turned by 45°, for the shear whose axes are the diagonals: shear by 2<i>τ</i> changes the "
        "phase of the response by −3<i>τ</i>. " + _FORMS,
        note=_NO_JACOBIAN + "The print's tanh<sup>−1</sup>(<i>y</i>/<i>x</i>) is <i>η<sub>B</sub></i> where "
        "|<i>y</i>| &lt; |<i>x</i>| and has no value elsewhere (hatched). With the absolute value it holds in all "
        "four sectors.",
    ),
    Entry(
        name="beyond-stretch-map",
        label="Beyond the paper",
        title="Mapping to hyperbolic coordinates: stretch and divergence become orthogonal translations",
        draw=functools.partial(draw_hyperbolic, STRETCH_AND_ZOOM),
        formula="<i>η</i> = ½ log |<i>x</i>/<i>y</i>|, <i>ξ</i> = ½ log |<i>xy</i>|; <i>M</i><sub>1</sub>(<i>η</i> + "
        "<i>τ<sub>b</sub></i>, <i>ξ</i> + <i>τ<sub>s</sub></i>) = <i>M</i><sub>0</sub>(<i>η</i>, <i>ξ</i>)",
        caption="What figure 7 shows for divergence and curl, for a stretch <i>τ<sub>b</sub></i> = 0.25 and a zoom "
        "<i>τ<sub>s</sub></i> = 0.15. The axes x and y cut the neighbourhood into four sectors (coloured outlines), "
        "which the deformation does not leave. In each of them, and in all by the same vector, the map is translated; "
        "a ring in every sector goes with the pattern. The correlations of the four are added up, and the peak (ring) "
        "gives the two numbers.",
        note="The print (§4.4) looks for coordinates in which both shears together are translations. There are none: "
        "[<i>L<sub>b</sub></i>, <i>L<sub>B</sub></i>] = 2<i>L<sub>r</sub></i>, stretch and shear do not commute. Each "
        "commutes with <i>L<sub>s</sub></i>, so that it has axes together with the divergence.",
    ),
    Entry(
        name="beyond-shear-map",
        label="Beyond the paper",
        title="Mapping to hyperbolic coordinates: shear and divergence become orthogonal translations",
        draw=functools.partial(draw_hyperbolic, SHEAR_AND_ZOOM),
        formula="<i>η</i> = ½ log |(<i>x</i> + <i>y</i>)/(<i>x</i> − <i>y</i>)|, <i>ξ</i> = ½ log |<i>x</i>² − "
        "<i>y</i>²|; <i>M</i><sub>1</sub>(<i>η</i> + <i>τ<sub>B</sub></i>, <i>ξ</i> + <i>τ<sub>s</sub></i>) = "
        "<i>M</i><sub>0</sub>(<i>η</i>, <i>ξ</i>)",
        caption="The same for the other shear, <i>τ<sub>B</sub></i> = 0.25, and a zoom <i>τ<sub>s</sub></i> = 0.15: "
        "the sectors are bounded by the diagonals.",
    ),
)
"""The figures, in the order of the paper."""
