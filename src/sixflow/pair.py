"""Pair: what goes into the measurement of one pair of frames, and what comes out."""

from __future__ import annotations

import dataclasses
from concurrent.futures import Future
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.masks import Bodies
from sixflow.normalise import Frame, both_valid
from sixflow.trajectory import Motion, one_frames_share


@dataclasses.dataclass(frozen=True)
class PairResult:
    """What was measured of one pair; arrays (rows, columns, …) as in `sixflow.field.dataset`, NaN at failed points
    that were not replaced.
    """

    six: NDArray[Any]
    covariance: NDArray[Any]
    residual: NDArray[Any]
    noise: NDArray[Any]
    resolution: NDArray[Any]
    flag: NDArray[np.uint16]
    body: NDArray[np.int32] | None
    window: float
    numbers: tuple[int, int]
    digest: str
    notes: tuple[str, ...]
    memory: int
    rho: NDArray[Any]
    moved_covariance: NDArray[Any] | None = None
    measured_from: int | None = None

    @property
    def motion(self) -> Motion:
        """The result as a step of a trajectory."""
        moved = self.moved_covariance
        if moved is None:
            moved = self.covariance * one_frames_share(self.rho)[..., None, None]
        return Motion(
            self.six,
            self.covariance,
            moved.astype(self.six.dtype),
            self.flag,
            self.residual,
            self.noise,
            self.body,
        )


@dataclasses.dataclass
class Prepared:
    """A frame that has been checked and normalised, with what is remembered of the raw one.

    `unlit` is the frame before its local light was divided out; `copied`, of a pair, is True at pixels that a codec
    took over from one frame to the other (`sixflow.copies`).
    """

    frame: Frame
    digesting: Future[bytes]
    mean: float
    spread: float
    notes: tuple[str, ...]
    bodies: Bodies | None = None
    unlit: Frame | None = None
    copied: NDArray[np.bool_] | None = None

    def evidence(self, frame: Frame, part: tuple[slice, slice]) -> Frame:
        """A part of this frame without the pixels that were copied."""
        if self.copied is None:
            return frame
        return frame.within(both_valid((~self.copied[part]).astype(np.uint8), frame.valid))

    @property
    def raw(self) -> Frame:
        """The frame with its local light."""
        return self.frame if self.unlit is None else self.unlit

    @property
    def digest(self) -> bytes:
        """SHA-256 of the raw frame."""
        return self.digesting.result()

    @property
    def mask_content(self) -> bytes:
        """The mask, for digests; empty without one."""
        return b"" if self.bodies is None else self.bodies.content
