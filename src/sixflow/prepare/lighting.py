"""Lighting: whether the light changed between two frames, and what is done about it.

Contrast (standard deviation) and brightness (mean) of all pixels that count tell a lamp that flickers or a camera that
drifts. Both also change when something enters or leaves the frame. So `lighting="auto"` takes the zero-normalised
criterion where they changed, and keeps it if the windows that were matched have changed too.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sixflow.prepare.frame import Frame
from sixflow.settings import Settings

CONTRAST, BRIGHTNESS = 0.05, 0.1
"""Changes that are let pass: of the contrast, as a share of it, and of the brightness, in units of it."""
MATCHED = 0.02
"""The same of both, for matched windows: what is let pass is less than noise of a fiftieth of the contrast."""


class Light(NamedTuple):
    """Mean and standard deviation of the pixels of a frame that count, grey."""

    mean: float
    spread: float

    @classmethod
    def of(cls, frame: Frame, scale: float = 1.0) -> Light:
        """That of every fourth pixel of every fourth row that counts, or of all if none of these does.

        Parameters
        ----------
        frame : Frame
        scale : float
            Of its image.
        """
        sample = frame.image[::4, ::4]
        if frame.valid.size:
            counted = frame.valid.astype(np.bool_)
            sample = sample[counted[::4, ::4]]
            sample = sample if sample.size else frame.image[counted]
        if not sample.size:
            return cls(0.0, 0.0)
        return cls(float(sample.mean()) / scale, float(sample.std()) / scale)


@dataclasses.dataclass(frozen=True)
class Change:
    """Change of light from one frame to another: contrast × `gain`, brightness + `offset` grey."""

    gain: float
    offset: float
    seen: bool

    @classmethod
    def between(cls, reference: Light, moved: Light) -> Change:
        """Compare two frames.

        Examples
        --------
        >>> Change.between(Light(mean=100, spread=40), Light(mean=102, spread=41))
        Change(gain=1.025, offset=2, seen=False)
        """
        offset = moved.mean - reference.mean
        if min(reference.spread, moved.spread) == 0:
            return cls(math.nan, offset, False)
        gain = moved.spread / reference.spread
        return cls(gain, offset, abs(gain - 1) > CONTRAST or abs(offset) > BRIGHTNESS * reference.spread)

    def settings(self, settings: Settings) -> Settings:
        """Return the settings with `lighting="auto"` replaced by what this change asks for."""
        if settings.lighting != "auto":
            return settings
        corrected = self.seen and settings.method != "eigenfilter"
        return dataclasses.replace(settings, lighting="gain+offset" if corrected else "none")

    def notes(self, asked: Settings, used: str, numbers: tuple[int, int]) -> tuple[str, ...]:
        """Say what was done about the change, or what could be.

        Parameters
        ----------
        asked : Settings
            As asked for.
        used : str
            `lighting` that was used.
        numbers : (int, int)
            Of the two frames.
        """
        done = {"auto": "gain+offset", "none": "none"}
        if not self.seen or asked.method == "eigenfilter" or done.get(asked.lighting) != used:
            return ()
        said = "each window is allowed its own gain and offset"
        if used == "none":
            said = 'consider lighting="gain+offset"'
        return (
            f"frames {numbers[0]} and {numbers[1]}: the light changed (contrast × {self.gain:.2f}, "
            f"brightness {self.offset:+.3g} grey); {said}",
        )


def confirmed(light: NDArray[Any], measured: NDArray[np.bool_], contrast: float) -> bool:
    """Whether the light of matched windows changed.

    Parameters
    ----------
    light : array, shape (rows, columns, 2)
        Gain and offset of each window.
    measured : bool array, shape (rows, columns)
        Windows that were matched; where none was, the change stands.
    contrast : float
        Standard deviation of the reference frame, grey.
    """
    if not measured.any():
        return True
    gain, offset = np.median(light[measured], axis=0)
    return bool(abs(gain - 1) > MATCHED or abs(offset) > MATCHED * contrast)
