"""Camera: what the matched tiles of a pair show of the camera, in words.

Light and sharpness are seen in tiles about points that are resolved: deformation finer than a window changes spectra as
a blur does. What stands still is seen about all points that have a value. It holds them back, in unlike windows by
unlike amounts, and a whole field may be unresolved by that alone.
"""

from __future__ import annotations

import numpy as np

from sixflow.convention.flags import FLAGS
from sixflow.judge.spectra import Spectra
from sixflow.judge.standing import stands_still
from sixflow.maps.six import six_of_maps
from sixflow.plan import Plan
from sixflow.prepare.lighting import Change
from sixflow.prepare.prepare import PreparedPair
from sixflow.prepare.tiles import Tiles
from sixflow.refine.solution import Solution
from sixflow.settings import Settings


def seen_of_camera(
    pair: PreparedPair, found: Solution, plan: Plan, asked: Settings, numbers: tuple[int, int], scale: float
) -> tuple[Solution, tuple[str, ...]]:
    """Notes on light, sharpness, and what stands still; what this takes of the motion is in the bias.

    Parameters
    ----------
    pair : PreparedPair
        What was measured.
    found : Solution
        The finished field.
    plan : Plan
    asked : Settings
        As asked for.
    numbers : (int, int)
        Of the two frames.
    scale : float
        Of the images.
    """
    frames = pair.reference.frame, pair.moved.frame
    given = (found.flag & ~np.uint16(FLAGS["border"])) == 0
    tiles, every = (
        Tiles.matched(*frames, plan.grid, np.where(points, found.maps, np.nan), plan.share)
        for points in (given, ~found.failed)
    )
    notes: tuple[str, ...] = ()
    if found.lighting == "gain+offset" or asked.lighting == "none":
        change = Change.between(tiles, scale) if tiles.count else pair.change
        shown = found.lighting == "gain+offset"
        if not shown and tiles.count:
            noise = float(np.median(found.statistics.noise[given]))
            shown = change.matters(tiles, noise, plan.window.sigma, scale)
        elif not shown:
            shown = change.seen
        notes = change.notes(asked, found.lighting, numbers) if shown else ()
    spectra, of_every = Spectra.of(tiles), Spectra.of(every)
    pair_of_frames = f"frames {numbers[0]} and {numbers[1]}"
    blur = None if spectra is None else spectra.blur()
    if blur is not None:
        notes += (
            f"frame {numbers[blur.frame]} is less sharp than frame {numbers[1 - blur.frame]}: blurred by a standard "
            f"deviation of {blur.width:.1f} px more along {blur.angle:.0f}°; strain along it may be biased",
        )
    share = None if of_every is None else stands_still(of_every)
    if share is not None:
        notes += (
            f"{pair_of_frames}: part of the picture stands still while the rest moves: a fixed pattern of the camera, "
            "dead pixels that were not found, reflections or a static layer, or particles finer than the pixels; "
            "motion may be pulled towards it; "
            "of a recording, fixed_pattern=True takes out what all frames have in common",
        )
        found = held_back(found, share)
    return found, notes


def held_back(found: Solution, share: float) -> Solution:
    """The field with a bias that contains a share of the motion itself; unchanged where the share is not positive."""
    if share <= 0:
        return found
    lacking = np.square(share * six_of_maps(found.maps))
    return found.replace(bias=lacking if found.bias is None else found.bias + lacking)
