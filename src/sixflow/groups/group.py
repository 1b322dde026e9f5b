"""The vocabulary of a group of maps of the plane, on top of that of its algebra.

| symbol | name |
|---|---|
| M = exp(Σ τ_k X_k) | `exp(τ)`, and back `log(M)`, the principal logarithm |
| M₂ M₁, M⁻¹ | `compose(M₂, M₁)`, `inverse(M)` |
| Ad_M X = M X M⁻¹ | `adjoint(M)`, a matrix that acts on coefficients |
| M·(x, y) | `act(M, points)` |

A map is a 3×3 matrix M that acts on columns (x, y, 1), coordinates in px, y down.

*Images.* A map carries an image along to M·I = I ∘ M⁻¹: frame 1 from frame 0, I₁(Mx) = I₀(x). To first order
exp(εX)·I = I − ε L_X I, and the operator, carried along too, is another one of the group:

    M·(L_X (M⁻¹·I)) = L_Y I,   Y = Ad_M X

Leading dimensions are broadcast, everything is calculated in float64, and NaN stays NaN.
"""

from __future__ import annotations

import abc
from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike

from sixflow.array_checks import Array, Invalid, refuse, require_broadcast, require_invalid, silent
from sixflow.errors import InputError
from sixflow.groups.algebra import TOLERANCE, Algebra, as_points, matrices, place
from sixflow.groups.generators import constant, eight_coefficients

_AT_INFINITY = 4 * np.finfo(np.float64).eps


class Group(Algebra, abc.ABC):
    """A Lie group of the plane.

    Attributes
    ----------
    name, dimension, names, symbols, generators
        As of its algebra.
    identity : float64 array, shape (3, 3)
        The map that moves nothing. Read-only.
    """

    identity = constant(np.eye(3))

    @abc.abstractmethod
    def exp(self, coefficients: ArrayLike) -> Array:
        """The map exp(Σ τ_k X_k): where a steady motion leads in unit time (Eagleson, eq. (4)).

        Parameters
        ----------
        coefficients : array, shape (..., n)
            px for L_x and L_y; the logarithm of a zoom for L_s, an angle in rad for L_r, hyperbolic angles for L_b
            and L_B; px⁻¹ for L_E and L_F.

        Returns
        -------
        float64 array, shape (..., 3, 3)
            inf or NaN where it is beyond the range of floating-point numbers.

        Raises
        ------
        InputError
            If the shape or dtype is wrong.

        Examples
        --------
        >>> import numpy as np
        >>> from sixflow.groups import EUCLIDEAN
        >>> EUCLIDEAN.exp([0, 0, np.pi / 2]).round(12) + 0.0
        array([[ 0., -1.,  0.],
               [ 1.,  0.,  0.],
               [ 0.,  0.,  1.]])
        """

    @abc.abstractmethod
    def log(self, matrix: ArrayLike, *, invalid: Invalid = "raise") -> Array:
        """Coefficients of the steady motion that leads to a map in unit time: the principal logarithm.

        Its rotation lies within (−π, π]. Of a half turn, whose logarithms are many, it is one with the angle π.

        Parameters
        ----------
        matrix : array, shape (..., 3, 3)
        invalid : {"raise", "nan"}
            What to do with a matrix that is not in the group, or has no real logarithm.

        Returns
        -------
        float64 array, shape (..., n)

        Raises
        ------
        InputError
            If `invalid` is "raise" and a matrix is not in the group, or has negative eigenvalues other than those of
            a half turn: no steady motion leads there.

        Examples
        --------
        >>> from sixflow.groups import SIMILARITY
        >>> SIMILARITY.log([[0, -2, 0], [2, 0, 0], [0, 0, 1]]).round(6)
        array([0.      , 0.      , 0.693147, 1.570796])
        """

    @abc.abstractmethod
    def _inverse(self, matrix: Array) -> Array:
        """Inverses of elements."""

    @abc.abstractmethod
    def _defects(self, matrix: Array, tolerance: float) -> Iterator[tuple[Array, str]]:
        """What keeps finite matrices out of the group: masks of shape (...), each with its reason."""

    @silent
    def compose(self, second: ArrayLike, first: ArrayLike) -> Array:
        """The map `second` after `first`: the product of their matrices.

        Parameters
        ----------
        second, first : array, shape (..., 3, 3)

        Returns
        -------
        float64 array, shape (..., 3, 3)

        Raises
        ------
        InputError
            If a matrix is not in the group.

        Examples
        --------
        >>> from sixflow.groups import TRANSLATION
        >>> TRANSLATION.compose(TRANSLATION.exp([1, 0]), TRANSLATION.exp([2, 5]))[:2, 2]
        array([3., 5.])
        """
        second, first = self.elements("second", second), self.elements("first", first)
        require_broadcast(second=second.shape[:-2], first=first.shape[:-2])
        return self._normalised(np.matmul(second, first))

    @silent
    def inverse(self, matrix: ArrayLike) -> Array:
        """The inverse map.

        Parameters
        ----------
        matrix : array, shape (..., 3, 3)

        Returns
        -------
        float64 array, shape (..., 3, 3)

        Raises
        ------
        InputError
            If a matrix is not in the group.

        Examples
        --------
        >>> from sixflow.groups import AFFINE
        >>> AFFINE.inverse([[2, 0, 2], [0, 2, 0], [0, 0, 1]])
        array([[ 0.5,  0. , -1. ],
               [ 0. ,  0.5,  0. ],
               [ 0. ,  0. ,  1. ]])
        """
        return self._normalised(self._inverse(self.elements("matrix", matrix)))

    @silent
    def adjoint(self, matrix: ArrayLike) -> Array:
        """How a map changes the coefficients of motions: Ad_M X = M X M⁻¹.

        Two readings: the motion X, seen after everything has been mapped by M; or, with M the change from old
        coordinates to new ones, the same motion in the new coordinates.

        Parameters
        ----------
        matrix : array, shape (..., 3, 3)

        Returns
        -------
        float64 array, shape (..., n, n)
            Acts on columns of coefficients.

        Raises
        ------
        InputError
            If a matrix is not in the group.

        Examples
        --------
        A turn about the origin, seen from a point 10 px to its right, is a turn and a shift downwards. (The new
        coordinates of a point are the old ones less 10.)

        >>> from sixflow.groups import EUCLIDEAN
        >>> EUCLIDEAN.adjoint(EUCLIDEAN.exp([-10, 0, 0])) @ [0, 0, 0.1]
        array([0. , 1. , 0.1])
        """
        M = self.elements("matrix", matrix)
        carried = np.einsum("...ab,kbc,...cd->...kad", M, self.generators, self._inverse(M))
        return eight_coefficients(carried)[..., self._indices].swapaxes(-1, -2) + 0.0

    @silent
    def act(self, matrix: ArrayLike, points: ArrayLike, *, invalid: Invalid = "raise") -> Array:
        """Where a map takes points.

        Parameters
        ----------
        matrix : array, shape (..., 3, 3)
        points : array, shape (..., 2)
            (x, y), px. Leading dimensions are broadcast.
        invalid : {"raise", "nan"}
            What to do with a point that a projective map takes to infinity.

        Returns
        -------
        float64 array, shape (..., 2)
            px.

        Raises
        ------
        InputError
            If a matrix is not in the group, or `invalid` is "raise" and a point goes to infinity.

        Examples
        --------
        >>> from sixflow.groups import SIMILARITY
        >>> SIMILARITY.act([[2, 0, 1], [0, 2, 0], [0, 0, 1]], [[0.0, 0.0], [10.0, 5.0]])
        array([[ 1.,  0.],
               [21., 10.]])
        """
        M, points = self.elements("matrix", matrix), as_points(points)
        require_invalid(invalid)
        require_broadcast(matrix=M.shape[:-2], points=points.shape[:-1])
        terms = np.stack(
            np.broadcast_arrays(M[..., 0] * points[..., :1], M[..., 1] * points[..., 1:], M[..., 2])
        )
        moved = terms.sum(axis=0)
        w = moved[..., 2]
        infinite = np.abs(w) <= _AT_INFINITY * np.abs(terms[..., 2]).sum(axis=0)
        refuse("points", infinite, "taken to infinity by the map", invalid)
        return moved[..., :2] / np.where(infinite, np.nan, w)[..., None]

    @silent
    def contains(self, matrix: ArrayLike, *, tolerance: float = TOLERANCE) -> Array:
        """Whether matrices are elements of the group.

        Parameters
        ----------
        matrix : array, shape (..., 3, 3)
        tolerance : float
            Greatest deviation relative to the size of the linear part, above 0.

        Returns
        -------
        bool array, shape (...)
            False also where a matrix is not finite.

        Raises
        ------
        InputError
            If the shape or dtype is wrong, or the tolerance is not above 0.

        Examples
        --------
        >>> from sixflow.groups import AFFINE, EUCLIDEAN
        >>> zoom = [[2, 0, 0], [0, 2, 0], [0, 0, 1]]
        >>> bool(EUCLIDEAN.contains(zoom)), bool(AFFINE.contains(zoom))
        (False, True)
        """
        if not tolerance > 0:
            raise InputError(f"tolerance={tolerance!r}: must be above 0, such as 1e-10")
        M = matrices("matrix", matrix)
        finite = np.asarray(np.isfinite(M).all(axis=(-1, -2)))
        inside = finite.copy()
        for bad, _ in self._defects(np.where(finite[..., None, None], M, self.identity), tolerance):
            inside &= ~bad
        return inside

    @silent
    def elements(self, name: str, value: ArrayLike, invalid: Invalid = "raise") -> Array:
        """Return `value` as float64 elements of the group.

        Parameters
        ----------
        name : str
            What the caller calls it, for the message.
        value : array, shape (..., 3, 3)
        invalid : {"raise", "nan"}
            What to do with matrices that are not in the group. Matrices that are not finite become NaN.

        Raises
        ------
        InputError
            If the shape or dtype is wrong, or `invalid` is "raise" and a matrix is not in the group.
        """
        require_invalid(invalid)
        M = matrices(name, value)
        finite = np.asarray(np.isfinite(M).all(axis=(-1, -2)))
        M = np.where(finite[..., None, None], M, np.nan)
        for bad, reason in self._defects(np.where(finite[..., None, None], M, self.identity), TOLERANCE):
            if bad.any() and invalid == "raise":
                first = tuple(int(k) for k in np.argwhere(bad)[0])
                raise InputError(
                    f"{name}{place(first)}={M[first].tolist()}: not in the {self.name} group, {reason}; take a larger "
                    "group, or leave it out"
                )
            M = np.where(bad[..., None, None], np.nan, M)
        return M

    def _normalised(self, matrix: Array) -> Array:
        """One matrix for each map, where several would mean the same."""
        return matrix
