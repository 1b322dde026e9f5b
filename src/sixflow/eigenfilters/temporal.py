"""Operators in time: a weighted value and the temporal derivative L_t of n frames (Eagleson, §3.1).

A spatio-temporal operator is a kernel times weights over frames. Both weights are those of a straight line fitted to
n equally spaced frames by least squares, evaluated at t = 0:

    value: a_i = 1/n − t̄ (t_i − t̄)/S,   L_t: b_i = (t_i − t̄)/S,   S = Σ (t_i − t̄)² = n (n² − 1)/12

| kind | t_i | t = 0 is |
|---|---|---|
| centred | −(n−1)/2 … (n−1)/2 | the middle of the frames |
| causal | −(n−1) … 0 | the last frame: nothing of the future is needed |

Of all weights that are exact on straight lines these have the least noise: Σb² = 1/S falls like n⁻³. They are
applied to responses, or to the frames before the kernels, which is the same: both are linear.

(As corrected here: L_t is listed with the six generators but is none of the affine group; it stands apart.)
"""

from __future__ import annotations

from typing import Literal, NamedTuple, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from sixflow.checks import is_whole, require
from sixflow.errors import InputError

TemporalKind: TypeAlias = Literal["centred", "causal"]


class TemporalWeights(NamedTuple):
    """Weights over frames, float64, shape (frames,) each.

    Attributes
    ----------
    times : array
        Times of the frames, frame intervals.
    value : array
        Weights of the value at t = 0; they sum to 1.
    derivative : array
        Weights of L_t at t = 0, per frame interval; they sum to 0.
    """

    times: NDArray[np.float64]
    value: NDArray[np.float64]
    derivative: NDArray[np.float64]


def temporal_weights(frames: int, kind: TemporalKind = "centred") -> TemporalWeights:
    """Weights of value and temporal derivative over n frames.

    Parameters
    ----------
    frames : int
        Number n of frames, 2 to 1024.
    kind : {"centred", "causal"}
        Where t = 0 is: in the middle of the frames, or at the last.

    Returns
    -------
    TemporalWeights
        (times, value, derivative).

    Raises
    ------
    InputError
        If the number of frames or the kind cannot be used.

    Notes
    -----
    A response that turns by ω rad per frame is no straight line: with ω n below about 1 the derivative is right to
    a few percent.

    Examples
    --------
    >>> temporal_weights(2).derivative, temporal_weights(3, "causal").value.round(3)
    (array([-1.,  1.]), array([-0.167,  0.333,  0.833]))
    """
    require(
        is_whole(frames, 2, 1024),
        "frames",
        frames,
        "must be a whole number from 2 to 1024; a derivative needs two",
    )
    if kind not in get_args(TemporalKind):
        raise InputError(f"kind={kind!r}: must be 'centred' or 'causal'")
    times = np.arange(frames, dtype=np.float64)
    times -= times[-1] / 2 if kind == "centred" else times[-1]
    mean = times.mean()
    slope = (times - mean) / ((times - mean) ** 2).sum()
    return TemporalWeights(times, 1 / frames - mean * slope, slope)
