"""What every pattern can do: give its grey value and gradient at any real point, and its moved image."""

from __future__ import annotations

import abc

from numpy.typing import ArrayLike

from sixflow.checks import require, whole
from sixflow.synth.arguments import Array, points
from sixflow.synth.motions.base import Motion, require_motion

CHUNK = 1 << 14
"""Points that one thread evaluates at a time: the working arrays stay in the cache."""


class Pattern(abc.ABC):
    """A pattern of grey values, known analytically over the whole plane.

    A pattern of your own subclasses this and defines `_evaluate(x, y)`, which returns (I, I_x, I_y) for
    one-dimensional float64 arrays.
    """

    @abc.abstractmethod
    def _evaluate(self, x: Array, y: Array) -> tuple[Array, Array, Array]:
        """Grey value and its two derivatives at checked points, shape (n,)."""

    def __call__(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Grey value at any real coordinates.

        Parameters
        ----------
        x, y : array
            Coordinates, px; any shapes that broadcast. Pixel centres are whole numbers.

        Returns
        -------
        float64 array
            Grey values in the broadcast shape; not clipped.

        Raises
        ------
        InputError
            If the coordinates are not real, not finite, or of shapes that do not broadcast.
        """
        x, y = points(x, y)
        return self._evaluate(x.ravel(), y.ravel())[0].reshape(x.shape)

    def gradient(self, x: ArrayLike, y: ArrayLike) -> tuple[Array, Array]:
        """Derivatives (I_x, I_y) of the grey value, grey/px, at any real coordinates.

        Parameters
        ----------
        x, y : array
            Coordinates, px.

        Returns
        -------
        I_x, I_y : float64 arrays
            In the broadcast shape.

        Raises
        ------
        InputError
            If the coordinates cannot be used.
        """
        x, y = points(x, y)
        _, I_x, I_y = self._evaluate(x.ravel(), y.ravel())
        return I_x.reshape(x.shape), I_y.reshape(x.shape)

    def image(
        self, x: ArrayLike, y: ArrayLike, motion: Motion | None = None, number: int | None = None
    ) -> Array:
        """Grey value of a frame at any real coordinates of that frame.

        Brightness is constant along the motion: I(x + u(x)) = pattern(x), by the exact inverse of the motion.

        Parameters
        ----------
        x, y : array
            Coordinates in the frame, px.
        motion : Motion or None
            Motion from frame 0 to this frame; None is frame 0 itself.
        number : int or None
            Number of the frame, at least 0, for what changes from frame to frame. None: 0 without a motion,
            1 with one.

        Returns
        -------
        float64 array
            Grey values in the broadcast shape.

        Raises
        ------
        InputError
            If the coordinates cannot be used, or the motion folds the plane.
        """
        x, y = points(x, y)
        if motion is not None:
            require_motion("motion", motion)
        number = (0 if motion is None else 1) if number is None else whole("number", number, 0)
        return self._image(x.ravel(), y.ravel(), motion, number).reshape(x.shape)

    def _image(self, x: Array, y: Array, motion: Motion | None, number: int) -> Array:
        """Grey values at checked points, shape (n,)."""
        if motion is not None:
            x, y = points(*motion.inverse(x, y))
        return self._evaluate(x, y)[0]


def require_pattern(name: str, pattern: object) -> None:
    """Raise an InputError unless the argument is a pattern."""
    remedy = "must be a pattern of sixflow.synth, such as Speckle(sigma=2)"
    require(isinstance(pattern, Pattern), name, pattern, remedy)
