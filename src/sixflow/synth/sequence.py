"""Pairs and sequences of frames that know the truth about themselves."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence as Series
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sixflow.checks import require, whole
from sixflow.errors import InputError
from sixflow.synth.arguments import Array
from sixflow.synth.motions.base import Motion, require_motion
from sixflow.synth.motions.relative import relative
from sixflow.synth.patterns.base import Pattern
from sixflow.synth.render import render
from sixflow.synth.sensor import Sensor


@dataclasses.dataclass(frozen=True, eq=False)
class Pair:
    """Two frames and the exact motion between them.

    Parameters
    ----------
    frame0, frame1 : array, shape (rows, columns)
        Reference and moved frame: frame1(x + u(x)) = frame0(x) before the cameras' defects.
    motion : Motion
        The motion from frame 0 to frame 1.
    pattern : Pattern
        What the frames show.
    sensors : (Sensor, Sensor)
        What recorded them.
    """

    frame0: NDArray[Any] = dataclasses.field(repr=False)
    frame1: NDArray[Any] = dataclasses.field(repr=False)
    motion: Motion
    pattern: Pattern
    sensors: tuple[Sensor, Sensor]

    def truth(self, x: ArrayLike, y: ArrayLike) -> Array:
        """The six numbers (u, v, divergence, curl, stretch, shear) at points of frame 0.

        Parameters
        ----------
        x, y : array
            Columns and rows, px, any real values; shapes that broadcast.

        Returns
        -------
        float64 array, shape (..., 6)
            u and v in px, the others without unit.

        Raises
        ------
        InputError
            If the coordinates cannot be used.
        """
        return self.motion.six(x, y)


@dataclasses.dataclass(frozen=True, eq=False)
class FrameSequence:
    """Frames over time and the exact motion between any two of them.

    Parameters
    ----------
    frames : array, shape (count, rows, columns)
        Frame k is the pattern moved by `motion.at(k)`.
    motion : Motion
        The motion from frame 0 to frame 1.
    pattern : Pattern
        What the frames show.
    sensors : tuple of Sensor
        What recorded each frame.
    """

    frames: NDArray[Any] = dataclasses.field(repr=False)
    motion: Motion
    pattern: Pattern
    sensors: tuple[Sensor, ...]

    def __len__(self) -> int:
        return len(self.frames)

    def motion_between(self, first: int, second: int) -> Motion:
        """The exact motion from the coordinates of frame `first` to those of frame `second`.

        Raises
        ------
        InputError
            If a frame number is below 0 or not in the sequence.
        """
        first = whole("first", first, 0, len(self) - 1)
        second = whole("second", second, 0, len(self) - 1)
        if first == 0:
            return self.motion.at(second)
        return relative(self.motion.at(first), self.motion.at(second))

    def truth(self, x: ArrayLike, y: ArrayLike, first: int = 0, second: int = 1) -> Array:
        """The six numbers of the motion from frame `first` to frame `second`, at points of frame `first`.

        Parameters
        ----------
        x, y : array
            Columns and rows in frame `first`, px.
        first, second : int
            Numbers of the frames: (k, k+1) for successive frames, (0, k) for all frames against the first.

        Returns
        -------
        float64 array, shape (..., 6)
            u and v in px, divergence, curl, stretch and shear without unit.

        Raises
        ------
        InputError
            If the coordinates or frame numbers cannot be used.
        """
        return self.motion_between(first, second).six(x, y)


def pair(
    pattern: Pattern,
    motion: Motion,
    shape: tuple[int, int],
    *,
    sensor: Sensor | Series[Sensor] = Sensor(),  # noqa: B008  frozen
    pixel_integration: int = 0,
) -> Pair:
    """Render a reference frame and a moved frame.

    Parameters
    ----------
    pattern : Pattern
        What is seen.
    motion : Motion
        Motion from frame 0 to frame 1.
    shape : (int, int)
        Rows and columns.
    sensor : Sensor or two of them
        The camera of both frames (its noise differs between them), or one for each; ideal by default.
    pixel_integration : int
        0 for grey values of the pixels' centres, n for means over the pixels; see `render`.

    Returns
    -------
    Pair
        The frames, and `truth(x, y)`.

    Raises
    ------
    InputError
        If an argument is of the wrong kind or outside its range, or the motion folds the plane.

    Examples
    --------
    >>> from sixflow.synth import Affine, Sensor, Speckle
    >>> motion = Affine.translation(0.3, 0.0)
    >>> made = pair(Speckle(sigma=2.0), motion, (32, 48), sensor=Sensor(noise=2.0, bits=8))
    >>> made.frame1.shape, made.frame1.dtype.name
    ((32, 48), 'uint8')
    >>> made.truth(10, 20).tolist()
    [0.3, 0.0, 0.0, 0.0, 0.0, 0.0]
    """
    require_motion("motion", motion)
    first, second = _sensors(sensor, 2)
    frame0 = render(pattern, shape, number=0, pixel_integration=pixel_integration)
    frame1 = render(pattern, shape, motion, number=1, pixel_integration=pixel_integration)
    return Pair(first.expose(frame0, 0), second.expose(frame1, 1), motion, pattern, (first, second))


def sequence(
    pattern: Pattern,
    motion: Motion,
    shape: tuple[int, int],
    count: int,
    *,
    sensor: Sensor | Series[Sensor] = Sensor(),  # noqa: B008  frozen
    pixel_integration: int = 0,
) -> FrameSequence:
    """Render frames over time: frame k is the pattern moved by `motion.at(k)`.

    Parameters
    ----------
    pattern : Pattern
        What is seen.
    motion : Motion
        Motion from frame 0 to frame 1.
    shape : (int, int)
        Rows and columns.
    count : int
        Number of frames, at least 2.
    sensor : Sensor or a series of `count` of them
        The camera of all frames, or one for each frame; ideal by default.
    pixel_integration : int
        0 for grey values of the pixels' centres, n for means over the pixels; see `render`.

    Returns
    -------
    FrameSequence
        The frames, and `truth(x, y, first, second)`.

    Raises
    ------
    InputError
        If an argument is of the wrong kind or outside its range, or the motion folds the plane at one of the
        times.

    Examples
    --------
    >>> from sixflow.synth import Affine, Texture
    >>> made = sequence(Texture(), Affine.rotation(0.02, centre=(16.0, 16.0)), (32, 32), 4)
    >>> made.frames.shape
    (4, 32, 32)
    >>> made.truth(16.0, 26.0, 2, 3).round(4).tolist()
    [-0.2, -0.002, -0.0004, 0.04, 0.0, 0.0]
    """
    require_motion("motion", motion)
    count = whole("count", count, 2)
    sensors = _sensors(sensor, count)
    frames = []
    for k, camera in enumerate(sensors):
        moved = motion.at(k) if k else None
        light = render(pattern, shape, moved, number=k, pixel_integration=pixel_integration)
        frames.append(camera.expose(light, k))
    if len({frame.dtype for frame in frames}) > 1:
        raise InputError("sensor: the sensors of a sequence must agree in bits; give all the same depth")
    return FrameSequence(np.stack(frames), motion, pattern, sensors)


def _sensors(sensor: Any, count: int) -> tuple[Sensor, ...]:
    if isinstance(sensor, Sensor):
        return (sensor,) * count
    several = isinstance(sensor, Series) and not isinstance(sensor, str)
    good = several and len(sensor) == count and all(isinstance(one, Sensor) for one in sensor)
    require(good, "sensor", sensor, f"must be a Sensor, or a series of {count} Sensors, one for each frame")
    return tuple(sensor)
