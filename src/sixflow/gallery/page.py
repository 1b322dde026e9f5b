"""One HTML page of the gallery: figures as PNG inside, no script, nothing from a network.

It is well-formed XML too. Figures stand on white cards, so that they can be read on a dark page as on a light one.
"""

from __future__ import annotations

import base64
import struct
from collections.abc import Sequence
from html import escape
from string import Template

from sixflow.gallery.catalogue import Entry
from sixflow.version import __version__

CSS_PIXELS = 0.62
"""Width of a figure on the page, px of the page per px of the PNG: its text is as large as that of the captions."""


def make_page(figures: Sequence[tuple[Entry, bytes]]) -> str:
    """Return the page.

    Parameters
    ----------
    figures : sequence of (Entry, bytes)
        Each figure as PNG, in the order of the page.

    Returns
    -------
    str
        HTML, to be written as UTF-8.
    """
    return _PAGE.substitute(
        style=_STYLE,
        version=escape(__version__),
        contents="\n".join(_CONTENT.substitute(_fields(entry)) for entry, _ in figures),
        figures="\n".join(_figure(entry, picture) for entry, picture in figures),
    )


def _figure(entry: Entry, picture: bytes) -> str:
    width, height = (round(CSS_PIXELS * size) for size in _size(picture))
    note = _NOTE.substitute(note=entry.note) if entry.note else ""
    data = base64.b64encode(picture).decode("ascii")
    return _FIGURE.substitute(_fields(entry), data=data, note=note, width=width, height=height)


def _size(png: bytes) -> tuple[int, int]:
    """Width and height of a PNG, which stand at the beginning of the file."""
    width, height = struct.unpack(">II", png[16:24])
    return width, height


def _fields(entry: Entry) -> dict[str, str]:
    return {
        "name": escape(entry.name),
        "label": escape(entry.label),
        "title": escape(entry.title),
        "formula": entry.formula,
        "caption": entry.caption,
    }


_PAGE = Template("""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8"/>
<meta name="viewport" content="width=device-width, initial-scale=1"/>
<meta name="color-scheme" content="light dark"/>
<title>sixflow: operators of motion-induced image deformations</title>
<style>
$style
</style>
</head>
<body>
<header>
<h1>Operators of motion-induced image deformations</h1>
<p>The figures of R. Eagleson, <cite>Measurement of Motion-Induced Image Deformations: Spatio-Temporal Operators for
Translation, Divergence, Curl, and Shear</cite>, drawn from the code of sixflow. Figure 2, the projection of a scene,
shows no operator and is left out; the hyperbolic maps at the end are not in the paper.</p>
<p>x points to the right and y <strong>down</strong>, as in images; lengths are in pixels. An operator is a pair of
kernels, even and odd, the real and the imaginary part of an eigenfunction of its deformation: the deformation turns the
phase of their response, and nothing else. In kernels blue is negative, white 0 and red positive, in equal steps of
colour for equal steps of value.</p>
</header>
<nav aria-label="Figures">
<ul>
$contents
</ul>
</nav>
<main>
$figures
</main>
<footer><p>Drawn by sixflow $version: <code>sixflow operators</code></p></footer>
</body>
</html>
""")

_CONTENT = Template('<li><a href="#$name"><span>$label</span> $title</a></li>')

_FIGURE = Template("""<figure id="$name">
<h2><span>$label</span> $title</h2>
<p class="formula">$formula</p>
<div class="card">
<img src="data:image/png;base64,$data" width="$width" height="$height" alt="$label: $title" loading="lazy"/>
</div>
<figcaption>
<p>$caption</p>
$note
</figcaption>
</figure>""")

_NOTE = Template('<p class="note"><strong>Against the print.</strong> $note</p>')

_STYLE = """:root { color-scheme: light dark; --ink: #1a1a1a; --faint: #5c5c5c; --line: #d4d4d4; --page: #fafafa;
  --accent: #0b3c6f; --note: #fdf3e3; }
@media (prefers-color-scheme: dark) { :root { --ink: #e6e6e6; --faint: #a8a8a8; --line: #444; --page: #17191c;
  --accent: #8fbdf0; --note: #33291a; } }
* { box-sizing: border-box; }
html { scroll-behavior: smooth; }
@media (prefers-reduced-motion: reduce) { html { scroll-behavior: auto; } }
body { margin: 0 auto; padding: 1.5rem 1rem 3rem; max-width: 62rem; color: var(--ink); background: var(--page);
  font: 1rem/1.55 system-ui, -apple-system, "Segoe UI", Roboto, sans-serif; overflow-wrap: break-word; }
h1 { font-size: 1.7rem; line-height: 1.2; margin: 0 0 0.8rem; }
h2 { font-size: 1.15rem; line-height: 1.3; margin: 0 0 0.3rem; }
h2 span, nav span { color: var(--accent); }
a { color: inherit; }
header p, figcaption p { max-width: 48rem; margin: 0.5rem 0; }
nav ul { list-style: none; margin: 1.2rem 0 0; padding: 0.8rem 0; border-block: 1px solid var(--line);
  columns: 24rem 2; column-gap: 2rem; font-size: 0.92rem; }
nav li { break-inside: avoid; padding: 0.12rem 0; }
nav a { text-decoration: none; }
nav a:hover, nav a:focus-visible { text-decoration: underline; }
figure { margin: 2.6rem 0 0; scroll-margin-top: 1rem; }
.formula { margin: 0 0 0.7rem; font-family: Georgia, "Times New Roman", serif; font-size: 1.08rem; }
.formula sub, .formula sup, figcaption sub, figcaption sup { line-height: 0; }
.card { background: #fff; border: 1px solid var(--line); border-radius: 6px; padding: 0.7rem; overflow-x: auto; }
.card img { display: block; max-width: 100%; height: auto; margin: 0 auto; }
figcaption { font-size: 0.95rem; }
.note { background: var(--note); border-left: 3px solid #c4761b; padding: 0.5rem 0.8rem; }
footer { margin-top: 3rem; color: var(--faint); font-size: 0.9rem; }
@media print { body { max-width: none; } figure { break-inside: avoid; } }"""
