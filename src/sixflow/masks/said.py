"""Said: notes on masks that leave out nothing, or nearly everything.

A mask that leaves nothing out may have been saved with two values of which none is 0, or not at all. One that leaves
less than a window holds may be inverted. Both are measured as they are, and noted. Bodies that are numbered from 1 to n
without a gap are taken as they are meant, also where they fill the frame.
"""

from __future__ import annotations

from sixflow.masks.bodies import Bodies


def said_of_mask(bodies: Bodies, window: float) -> tuple[str, ...]:
    """Return notes on a mask that leaves everything, or hardly anything.

    Parameters
    ----------
    bodies : Bodies
        What is left of it.
    window : float
        Side of the window that is measured with, px.

    Examples
    --------
    >>> import numpy as np
    >>> said_of_mask(Bodies.of(np.ones((64, 64), bool), "mask m.png", "its values are 60, 200"), 31)
    ('mask m.png leaves nothing out: its values are 60, 200, and only 0 (False) is outside',)
    """
    notes = []
    mask = bodies.whole or bodies
    numbered = mask.named and len(mask.boxes) > 1
    if mask.labels.all() and not (numbered and list(mask.boxes) == list(range(1, len(mask.boxes) + 1))):
        remark = mask.remark
        if numbered and not remark:
            remark = f"it has {len(mask.boxes)} numbers from {min(mask.boxes)} to {max(mask.boxes)}"
        notes.append(
            f"{mask.name} leaves nothing out: {f'{remark}, and ' if remark else ''}only 0 (False) is outside"
        )
    left = int((bodies.labels != 0).sum())
    if left < window**2:
        notes.append(
            f"{bodies.name} leaves {left} of {bodies.labels.size} pixels, less than one window of {window:g} px has "
            f"({window**2:.0f}); is it inverted, or meant for other frames?"
        )
    return tuple(notes)
