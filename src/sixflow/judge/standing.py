"""Standing: whether part of what a pair of frames shows stands still while the rest moves.

Noise that a sensor adds to every frame in the same way, columns, a colour mosaic, dead pixels, a grid before the lens
or a layer that shines through are seen at their own frequencies, which do not follow the motion. Pixels that were
replaced (`sixflow.prepare.defects`) follow it as their neighbours do. Tiles brought together by the measured motion u
have Z = F₀* F₁ with the phase 0 where a frequency moves with the field, and k·u where it stands
still. So

    q = Σ Im Z sin(k·u) / Σ |Z| sin²(k·u)

over the frequencies of a cell and all tiles is the share of the field's motion that a cell lacks: 0 where it moves with
the field, 1 where it stands still, less than 0 in those that move if others hold the field back.

Cells are taken out, the one furthest above the others' mean first, while one is beyond chance. Those that remain are
what moves, by 1 − q̄ of the field. Something is said to stand still where a cell moves by less than half of that, by
more than chance: 1 − q < (1 − q̄)/2. Of structure finer than the pixels, too, the frequencies that come down from beyond
the pixels' lack motion. At the highest frequencies, those of the lattice of pixels, they always do: these cells count
where they have more than half of the information. Below, they have as much power as what they meet only in pictures of
points, whose motion of less than a pixel is as much in doubt.

| symbol | name in the code |
|---|---|
| Z, u | `Spectra.cross`, `Spectra.shift` |
| q | `lacking` |
"""

from __future__ import annotations

import numpy as np

from sixflow.chance import FALSE_ALARMS
from sixflow.judge.spectra import COUNT, KX, KY, SECTORS, Spectra, in_cells


def stands_still(spectra: Spectra) -> float | None:
    """Return the share of the motion that the field lacks because of what stands still; None where nothing does.

    Parameters
    ----------
    spectra : Spectra
    """
    from scipy.special import stdtrit

    u, v = spectra.shift.T.astype(np.float32)[..., None, None]
    turned = np.sin(KX.astype(np.float32) * u + KY.astype(np.float32) * v)
    cross, tiles = spectra.cross, len(spectra.cross)
    lacks, moves = in_cells(cross.imag * turned), in_cells(np.abs(cross) * turned**2)
    total = moves.sum(axis=0)
    if not (total > 0).all():
        return None
    lacking = lacks.sum(axis=0) / total
    error = np.sqrt(((lacks - lacking * moves) ** 2).sum(axis=0) * tiles / (tiles - 1)) / total
    counts = np.maximum(in_cells(cross.real * (KX**2 + KY**2)).sum(axis=0), 0)
    if not counts.any():
        return None
    limit = -float(stdtrit(tiles - 1, FALSE_ALARMS / COUNT / 2))
    kept, mean, variance = np.ones(COUNT, np.bool_), 0.0, 0.0
    while counts[kept].any():
        weight = counts[kept] / counts[kept].sum()
        mean, variance = float(weight @ lacking[kept]), float(weight**2 @ error[kept] ** 2)
        above = np.where(kept, (lacking - mean) / np.sqrt(error**2 + variance + 1e-12), -np.inf)
        worst = int(above.argmax())
        if above[worst] < limit or kept.sum() == 1:
            break
        kept[worst] = False
    half = (lacking - (1 + mean) / 2) / np.sqrt(error**2 + variance / 4 + 1e-12)
    still, lattice = ~kept & (half > limit), np.arange(COUNT) >= COUNT - SECTORS
    told = (still & ~lattice).any() or 2 * counts[still & lattice].sum() > counts.sum()
    return -mean if told else None
