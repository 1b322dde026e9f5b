"""The Lie algebra of a group: coefficients, brackets, velocity fields, operators on images.

| symbol | name |
|---|---|
| X_k | `generators` |
| τ | coefficients of X = Σ τ_k X_k: `algebra(τ)`, and back `coefficients(X)` |
| [X, Y] = XY − YX | `bracket`, of coefficients |
| f_ijk | `structure_constants`: [X_i, X_j] = Σ_k f_ijk X_k |
| ad_τ | `ad(τ)`: ad_τ σ = [τ, σ] |
| a(x, y) | `field`: velocity |
| L I = a·∇I | `apply`: the operator on images |

The bracket is that of matrices. Operators have the opposite sign, [L_X, L_Y] = −L_[X, Y], because (Xp)·∇ and (Yp)·∇
act in the opposite order; `sixflow.eigenfilters.bracket` is that of operators.
"""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import ArrayLike

from sixflow.array_checks import Array, as_floats, require_broadcast, silent
from sixflow.errors import InputError
from sixflow.groups.generators import NAMES, SYMBOLS, constant, eight_coefficients

TOLERANCE = 1e-10
"""How far a matrix may be from a group or its algebra, relative to its size, and still be taken as an element."""

LAST_ROW = 8 * np.finfo(np.float64).eps
"""How far the last row of an affine map may be from (0, 0, 1)."""


_NOISE = 64 * np.finfo(np.float64).eps


class Algebra:
    """A Lie algebra of plane motions, spanned by some of the eight generators.

    Attributes
    ----------
    name : str
        "translation", "euclidean", "similarity", "affine" or "projective".
    dimension : int
        Number of generators, n: 2, 3, 4, 6 or 8.
    names : tuple of str
        Of the numbers that the generators make, in the order used everywhere, such as ("u", "v", "curl").
    symbols : tuple of str
        Of the generators (Eagleson, eq. (3)), such as ("L_x", "L_y", "L_r").
    generators : float64 array, shape (n, 3, 3)
        Their matrices. Read-only.
    """

    def __init__(self, name: str, indices: tuple[int, ...], generators: Array) -> None:
        self.name = name
        self.dimension = len(indices)
        self.names = tuple(NAMES[k] for k in indices)
        self.symbols = tuple(SYMBOLS[k] for k in indices)
        self.generators = constant(generators)
        self._indices = list(indices)

    def __repr__(self) -> str:
        return f"<the {self.name} group: {', '.join(self.symbols)}>"

    @functools.cached_property
    def structure_constants(self) -> Array:
        """The f_ijk of [X_i, X_j] = Σ_k f_ijk X_k, float64, shape (n, n, n), [i, j, k]. Read-only."""
        X = self.generators
        products = np.einsum("iab,jbc->ijac", X, X)
        return constant(eight_coefficients(products - products.swapaxes(0, 1))[..., self._indices])

    def algebra(self, coefficients: ArrayLike) -> Array:
        """Matrix X = Σ τ_k X_k of a motion.

        Parameters
        ----------
        coefficients : array, shape (..., n)

        Returns
        -------
        float64 array, shape (..., 3, 3)

        Raises
        ------
        InputError
            If the shape or dtype is wrong.

        Examples
        --------
        >>> from sixflow.groups import EUCLIDEAN
        >>> EUCLIDEAN.algebra([5.0, 0.0, 0.1])
        array([[ 0. , -0.1,  5. ],
               [ 0.1,  0. ,  0. ],
               [ 0. ,  0. ,  0. ]])
        """
        tau = self.vector("coefficients", coefficients)
        return np.einsum("...k,kij->...ij", tau, self.generators) + 0.0

    @silent
    def coefficients(self, algebra: ArrayLike) -> Array:
        """Coefficients τ of a matrix X = Σ τ_k X_k + λI, the inverse of `algebra`.

        A motion of one group is taken to a larger one by `larger.coefficients(smaller.algebra(tau))`.

        Parameters
        ----------
        algebra : array, shape (..., 3, 3)
            A multiple λ of the identity moves no point and is ignored.

        Returns
        -------
        float64 array, shape (..., n)

        Raises
        ------
        InputError
            If a matrix needs generators that the group does not have.

        Examples
        --------
        >>> from sixflow.groups import EUCLIDEAN, PROJECTIVE
        >>> PROJECTIVE.coefficients(EUCLIDEAN.algebra([5.0, 0.0, 0.1]))
        array([5. , 0. , 0. , 0.1, 0. , 0. , 0. , 0. ])
        """
        X = matrices("algebra", algebra)
        eight = eight_coefficients(X)
        allowed = np.full(eight.shape, _NOISE)
        allowed[..., :6] += TOLERANCE * np.abs(eight[..., 2:6]).max(axis=-1, keepdims=True)
        foreign = np.abs(eight) > allowed
        foreign[..., self._indices] = False
        if foreign.any():
            first = tuple(int(k) for k in np.argwhere(foreign.any(axis=-1))[0])
            needed = ", ".join(symbol for symbol, far in zip(SYMBOLS, foreign[first], strict=True) if far)
            raise InputError(
                f"algebra{place(first)} needs {needed} too: the {self.name} group has {', '.join(self.symbols)}; "
                "take a larger group"
            )
        return eight[..., self._indices] + 0.0

    @silent
    def bracket(self, first: ArrayLike, second: ArrayLike) -> Array:
        """Lie bracket [X, Y] = XY − YX of two motions; that of their operators on images is its negative.

        Parameters
        ----------
        first, second : array, shape (..., n)
            Coefficients of X and Y.

        Returns
        -------
        float64 array, shape (..., n)

        Raises
        ------
        InputError
            If a shape or dtype is wrong.

        Examples
        --------
        A turn and a shift do not commute, X_r X_x − X_x X_r = X_y:

        >>> from sixflow.groups import EUCLIDEAN
        >>> EUCLIDEAN.bracket([0, 0, 1], [1, 0, 0])
        array([0., 1., 0.])
        """
        first, second = self.vector("first", first), self.vector("second", second)
        require_broadcast(first=first.shape[:-1], second=second.shape[:-1])
        return np.einsum("...i,...j,ijk->...k", first, second, self.structure_constants) + 0.0

    @silent
    def ad(self, coefficients: ArrayLike) -> Array:
        """Matrix of the bracket with a motion: ad_τ σ = [τ, σ]. exp(ad_τ) = Ad(exp τ).

        Parameters
        ----------
        coefficients : array, shape (..., n)

        Returns
        -------
        float64 array, shape (..., n, n)
            Acts on columns of coefficients.

        Raises
        ------
        InputError
            If the shape or dtype is wrong.
        """
        tau = self.vector("coefficients", coefficients)
        return np.einsum("...i,ijk->...kj", tau, self.structure_constants) + 0.0

    @silent
    def field(self, coefficients: ArrayLike, points: ArrayLike) -> Array:
        """Velocity a(x, y) = Σ τ_k a_k(x, y) of a motion at points (Eagleson, eqs. (2) and (3)).

        Parameters
        ----------
        coefficients : array, shape (..., n)
        points : array, shape (..., 2)
            (x, y), px.

        Returns
        -------
        float64 array, shape (..., 2)
            px per unit of time.

        Raises
        ------
        InputError
            If a shape or dtype is wrong.

        Examples
        --------
        >>> from sixflow.groups import SIMILARITY
        >>> SIMILARITY.field([0, 0, 0.5, 0], [[2.0, 0.0], [0.0, -4.0]])
        array([[ 1.,  0.],
               [ 0., -2.]])
        """
        X, points = self.algebra(coefficients), as_points(points)
        require_broadcast(coefficients=X.shape[:-2], points=points.shape[:-1])
        moved = X[..., :, 0] * points[..., :1] + X[..., :, 1] * points[..., 1:] + X[..., :, 2]
        return moved[..., :2] - moved[..., 2:] * points

    @silent
    def apply(self, coefficients: ArrayLike, gradient: ArrayLike, points: ArrayLike) -> Array:
        """L I = a·∇I: the change of an image, per unit of time, met on the way along the motion.

        Parameters
        ----------
        coefficients : array, shape (..., n)
        gradient : array, shape (..., 2)
            (∂I/∂x, ∂I/∂y) at the points, image values per px.
        points : array, shape (..., 2)
            (x, y), px.

        Returns
        -------
        float64 array, shape (...)
            Image values per unit of time. An image that is itself carried along changes by the negative.

        Raises
        ------
        InputError
            If a shape or dtype is wrong.

        Examples
        --------
        A zoom of the ramp I = 5x:

        >>> from sixflow.groups import SIMILARITY
        >>> SIMILARITY.apply([0, 0, 1, 0], [5.0, 0.0], [2.0, 7.0])
        np.float64(10.0)
        """
        gradient = as_floats("gradient", gradient, (2,)).astype(np.float64)
        velocity = self.field(coefficients, points)
        require_broadcast(gradient=gradient.shape[:-1], velocity=velocity.shape[:-1])
        return (gradient * velocity).sum(axis=-1)

    def vector(self, name: str, value: ArrayLike) -> Array:
        """Return `value` as float64 coefficients of the group's generators; InputError if it cannot be."""
        array = as_floats(name, value, ()).astype(np.float64)
        if array.shape[-1:] != (self.dimension,):
            raise InputError(
                f"{name} of shape {array.shape}: the last dimension must be {self.dimension}, the coefficients of "
                f"{', '.join(self.symbols)}"
            )
        return array


def matrices(name: str, value: ArrayLike) -> Array:
    """Return `value` as float64 3×3 matrices; InputError if it cannot be."""
    return as_floats(name, value, (3, 3)).astype(np.float64)


def as_points(value: ArrayLike) -> Array:
    """Return `value` as float64 points (x, y); InputError if it cannot be."""
    return as_floats("points", value, (2,)).astype(np.float64)


def place(index: tuple[int, ...]) -> str:
    """Say which element of a batch is meant; nothing for a single one."""
    return f" at index {index}" if index else ""
