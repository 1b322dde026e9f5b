"""Which frame: the same motion expressed at a point of frame 0, of the middle between the frames, or of frame 1.

u and v always point from frame 0 to frame 1. With X the place in frame 0, a field may hang on the place

    x = X + s U(X):   s = 0 "first", ½ "middle", 1 "second"

For an affine map about a fixed place, going from s to t with a = t − s,

    G_t = G_s (I + a G_s)⁻¹,   d_t = (I + a G_s)⁻¹ d_s,   F = (I + (1 − s) G_s)(I − s G_s)⁻¹

| symbol | name |
|---|---|
| s, t | `SHARE[source]`, `SHARE[target]` |
| d, G | the six |
| F | deformation gradient of frame 1 with respect to frame 0 |

So I + G_first = (I − G_second)⁻¹, and I + G_first = (I + G_middle/2)(I − G_middle/2)⁻¹.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sixflow.array_checks import Array, as_floats, silent
from sixflow.convention._closed_form import apply_pair, determinants
from sixflow.errors import InputError

SHARE = {"first": 0.0, "middle": 0.5, "second": 1.0}
"""Share of the displacement that lies behind at the place where the field hangs."""


@silent
def change_reference(six: ArrayLike, source: str, target: str = "first") -> Array:
    """Tell a motion about the same place of another frame, to first order of the field about it.

    Parameters
    ----------
    six : array, shape (..., 6)
    source, target : {"first", "middle", "second"}
        Frame that the six refer to, and frame that they are wanted for.

    Returns
    -------
    array, shape (..., 6)
        NaN where the map between the two frames folds.

    Raises
    ------
    InputError
        If the six have another shape, or there is no such reference.

    Examples
    --------
    A zoom by 2: of the size in frame 1 it adds only half.

    >>> change_reference([0, 0, 2.0, 0, 0, 0], "first", "second")
    array([0., 0., 1., 0., 0., 0.])
    >>> change_reference([0, 0, 1.0, 0, 0, 0], "second")
    array([0., 0., 2., 0., 0., 0.])
    """
    six = as_floats("six", six, (6,))
    for name, value in (("source", source), ("target", target)):
        if value not in SHARE:
            raise InputError(f"{name}={value!r}: must be one of {', '.join(map(repr, SHARE))}")
    share = SHARE[target] - SHARE[source]
    if share == 0:
        return six
    d, four = six[..., :2], six[..., 2:]
    det_part, det = determinants(share * four)
    folded = ~(det > 0)
    # (I + aG)⁻¹ = I + B, and G_t = −B/a; in the six of B: −(trace + 2 det, curl, stretch, shear)/det of aG
    back = -share * four / det[..., None]
    back[..., 0] -= 2 * det_part / det
    moved = d + apply_pair(back[..., 0] / 2, np.ones_like(det), back, d)
    result = np.concatenate([moved, -back / share], axis=-1)
    return np.where(folded[..., None], np.nan, result) + 0.0
