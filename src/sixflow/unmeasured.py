"""Unmeasured: the result of a pair that cannot be measured, since one of its frames cannot be used or is a copy."""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.field.flags import FLAGS
from sixflow.frames.bad import BadFrame
from sixflow.grid import Grid
from sixflow.masks import Bodies
from sixflow.normalise import NO_MASK, both_valid
from sixflow.pair import PairResult, Prepared
from sixflow.placing import masked_points
from sixflow.settings import Settings


def unmeasured(
    frames: tuple[Prepared | BadFrame, Prepared | BadFrame],
    bodies: Bodies | None,
    numbers: tuple[int, int],
    flag: str,
    note: str,
    *,
    grid: Grid,
    dtype: type,
    settings: Settings,
    masks_move: bool,
) -> PairResult:
    """Return NaN at every point, with a flag that says why; masked points are flagged masked too.

    Parameters
    ----------
    frames : (Prepared or BadFrame, Prepared or BadFrame)
    bodies : Bodies or None
        Of the first frame's mask.
    numbers : (int, int)
        Of the two frames.
    flag : str
        One of `FLAGS`.
    note : str
        The reason, in words.
    grid, dtype, settings, masks_move
        As the other pairs of the recording have them.
    """
    reference = frames[0]
    shape = grid.shape

    def nothing(*more: int) -> NDArray[Any]:
        return np.full((*shape, *more), np.nan, dtype)

    valid = NO_MASK if isinstance(reference, BadFrame) else reference.raw.valid
    if bodies is not None:
        valid = both_valid((bodies.labels != 0).astype(np.uint8), valid)
    masked = masked_points(np.full((6, *shape), np.nan), grid, valid, settings.reference)
    flags = np.full(shape, FLAGS[flag], np.uint16)
    flags[masked] |= FLAGS["masked"]
    body = None
    if masks_move or (bodies is not None and len(bodies.boxes) > 1):
        labels = 1 if bodies is None else bodies.labels[np.ix_(grid.y, grid.x)]
        body = np.where(masked, 0, labels).astype(np.int32)
    content = [b"" if isinstance(frame, BadFrame) else frame.digest for frame in frames]
    digest = hashlib.sha256(b"".join(content) + (b"" if bodies is None else bodies.content))
    return PairResult(
        six=nothing(6), covariance=nothing(6, 6), residual=nothing(), noise=nothing(), resolution=nothing(),
        flag=flags, body=body, window=float("nan") if settings.window == "auto" else float(settings.window),
        numbers=numbers, digest=digest.hexdigest()[:16], notes=(note,), memory=0, rho=nothing(),
    )  # fmt: skip
