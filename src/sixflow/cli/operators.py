"""`sixflow operators`: the figures of the paper, drawn from the code, as files and as one page."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from sixflow.cli.errors import say
from sixflow.cli.flags import Output, Switch
from sixflow.cli.progress import is_shown


def operators(
    *,
    output: Output = Path("sixflow-operators"),
    format: Literal["png", "svg", "pdf"] = "png",
    overwrite: Switch = False,
) -> None:
    """Draw the operators of the paper: deformations, quadrature pairs, kernels, log-polar and hyperbolic maps.

    One file per figure, and a page with captions, operators.html, that holds them all.

    Parameters
    ----------
    output
        Folder for the figures and the page; it is made if need be.
    format
        Of the figures: .png, .svg or .pdf. The page holds PNG in any case.
    overwrite
        Replace what was drawn there before.
    """
    from sixflow.gallery import write_gallery

    if is_shown(quiet=False):
        say("drawing, which takes some seconds …")
    for path, title in write_gallery(output, format=format, overwrite=overwrite).items():
        print(f"{path}: {title}")
