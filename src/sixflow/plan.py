"""Plan: how the frames of a recording are measured, resolved once from the settings and the frames' shape.

`Settings` are the request, in the words of a user. A plan holds what follows from them: windows with their σ, the grid,
the type of the images. What measures sees the plan alone.
"""

from __future__ import annotations

import dataclasses
from functools import cached_property
from typing import Any, Literal

import numpy as np

from sixflow.convention.reference import SHARE
from sixflow.engine.spline import DEGREE
from sixflow.engine.window import attenuation_period, plain_window, window_sigma
from sixflow.errors import InputError
from sixflow.maps.grid import Grid
from sixflow.settings import Group, Method, Reference, Settings

LADDER = (8, 11, 16, 22, 31, 44, 62)
"""px: windows of `window="auto"`, each √2 larger than the one before."""
SEARCHED = 31
"""px: the window that large motion is searched with where `window="auto"`."""
SHARPEN = 2
"""Sharpening of the windows of `window="auto"`, where the settings ask for none; a smaller group than the affine has
none."""
OPERATORS = 31
"""px: the finest window of `window="auto"` for operators, whose kernels have to fit into it."""


@dataclasses.dataclass(frozen=True)
class Window:
    """A Gaussian window, and how far its response is sharpened.

    Parameters
    ----------
    size : float
        Side of the square subset of the same noise, px.
    sharpen : int
        As in `Settings`.

    Examples
    --------
    >>> window = Window(31)
    >>> round(window.sigma, 2), round(window.period, 1)
    (8.74, 119.7)
    """

    size: float
    sharpen: int = 0

    @cached_property
    def sigma(self) -> float:
        """Standard deviation of the weight, px."""
        return window_sigma(self.size)

    @cached_property
    def period(self) -> float:
        """Period of a displacement that is attenuated by 10 %, px."""
        return attenuation_period(self.sigma, self.sharpen)

    @cached_property
    def resolving(self) -> float:
        """Size of the window, px, that resolves without sharpening what this one resolves with it."""
        return plain_window(self.size, self.sharpen)

    @property
    def plain(self) -> Window:
        """The same without sharpening."""
        return Window(self.size)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Plan:
    """What the measurement of a pair follows.

    Attributes
    ----------
    shape : (int, int)
        Of the frames, px.
    grid : Grid
        Points of the field.
    dtype : numpy dtype
        Of images and window sums.
    window : Window
        What points are measured with.
    ladder : tuple of Window
        With `window="auto"`, from fine to coarse: the windows that are chosen from at each point; `window` is then
        that of the search. Empty otherwise.
    degree : int
        Of the B-splines that interpolate the moved frame.
    search : str
        "auto", "pyramid", "spectrum" or "guess".
    method, reference, group, lowpass, lighting, robust, forward_backward, levels, passes, tolerance
        As in `Settings`. What measures has a `lighting` that is not "auto".
    """

    shape: tuple[int, int]
    grid: Grid
    dtype: Any
    window: Window
    ladder: tuple[Window, ...]
    degree: int
    search: str
    method: Method
    reference: Reference
    group: Group
    lowpass: float
    lighting: Literal["auto", "none", "gain+offset", "local"]
    robust: bool
    forward_backward: bool
    levels: int | None
    passes: int
    tolerance: float

    @classmethod
    def of(cls, settings: Settings, shape: tuple[int, int], name: str = "frame0") -> Plan:
        """Resolve settings for frames of a shape (height, width); `name` is that of the first, for messages.

        Raises
        ------
        InputError
            If the frames are smaller than the window.
        """
        sharpen, ladder = settings.sharpen, tuple[Window, ...]()
        if settings.window == "auto":
            sharpen = sharpen or (SHARPEN if settings.group == "affine" else 0)
            finest = LADDER[0] if settings.method == "least_squares" else OPERATORS
            ladder = tuple(
                Window(size, sharpen) for size in LADDER if finest <= size and 2 * size <= min(shape)
            )
            fitting = [size for size in LADDER if size <= min(min(shape), SEARCHED)]
            window = Window(max(fitting, default=LADDER[0]))
            ladder = ladder or (Window(window.size, sharpen),)
        else:
            window = Window(settings.window, sharpen)
        if min(shape) < window.size:
            raise InputError(
                f"{name} has shape {shape}: smaller than window={window.size:g}; take a smaller window or larger frames"
            )
        return cls(
            shape=shape,
            grid=Grid.over(shape, settings.step),
            dtype=np.dtype(np.float64 if settings.float64 else np.float32),
            window=window,
            ladder=ladder,
            degree=DEGREE[settings.interpolation],
            search=settings.search if isinstance(settings.search, str) else "guess",
            method=settings.method,
            reference=settings.reference,
            group=settings.group,
            lowpass=settings.lowpass,
            lighting=settings.lighting,
            robust=settings.robust,
            forward_backward=settings.forward_backward,
            levels=settings.levels,
            passes=settings.passes,
            tolerance=settings.tolerance,
        )

    @property
    def share(self) -> float:
        """Share of the way from frame 0 to frame 1 at which the grid points lie: 0, ½ or 1."""
        return SHARE[self.reference]

    def between(self, step: int) -> int:
        """How many times closer points have to stand than a step for the windows of the ladder; 1 with one window.

        No further apart than the finest window is wide; if no divisor of the step is from half of that to that, they
        stand as far apart as is asked for.
        """
        if not self.ladder or step <= self.ladder[0].size:
            return 1
        fine = [n for n in range(2, step) if step % n == 0 and 1 / 2 <= step / n / self.ladder[0].size <= 1]
        return min(fine, default=1)

    @property
    def is_searched(self) -> bool:
        """Whether the search itself measures what is asked for: from frame 0, with one window, not sharpened."""
        return self == self.of_search

    @property
    def of_search(self) -> Plan:
        """The plan of the search for large motion: from frame 0, with one window that is not sharpened."""
        return self.replace(window=self.window.plain, ladder=(), reference="first")

    def replace(self, **changes: Any) -> Plan:
        """Return the plan with some parts changed."""
        return dataclasses.replace(self, **changes)
