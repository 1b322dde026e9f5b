"""The eight coefficients of the flow of a plane, and the six numbers at any image point.

The image of a plane in rigid motion flows as (Eagleson, eq. (2), after Kanatani)

    u = u₀ + A x + B y + (E x + F y) x
    v = v₀ + C x + D y + (E x + F y) y,

x and y in px from a `centre`. Differentiated at (x, y),

    u_x = A + 2E x + F y     u_y = B + F x
    v_x = C + E y            v_y = D + E x + 2F y,

so that the six are linear in the eight, and at the centre they are

    u₀, v₀, divergence = A + D, curl = C − B, stretch = A − D, shear = B + C.

Away from it E and F, Kanatani's "fanning", change them: divergence by 3(E x + F y), curl by E y − F x, stretch by
E x − F y, shear by F x + E y. The same numbers with another centre are a linear change (`recentring_matrix`), in
which E and F stay.

As a velocity of homographies the flow is x' = x + ε L x with

    L = [[A, B, u₀], [C, D, v₀], [−E, −F, 0]]                                            (up to κ I).

| symbol | unit |
|---|---|
| u₀, v₀ | px per frame interval |
| A, B, C, D | 1 per frame interval |
| E, F | 1/px per frame interval |
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike

from sixflow.array_checks import as_floats, broadcast, image_points
from sixflow.convention import SIX_FROM_GRADIENT
from sixflow.errors import InputError
from sixflow.scenes.arguments import Array, pair

EIGHT = ("u0", "v0", "A", "B", "C", "D", "E", "F")
"""Names of the eight coefficients, in the order used everywhere."""


def recentring_matrix(x: ArrayLike, y: ArrayLike) -> Array:
    """Matrix that takes the eight about a centre to the eight about another.

    Its first six rows give u, v, u_x, u_y, v_x, v_y at that point.

    Parameters
    ----------
    x, y : arrays
        The new centre from the old one, px; shapes that broadcast.

    Returns
    -------
    float64 array, shape (..., 8, 8)

    Raises
    ------
    InputError
        If the points are not real, not finite, or of shapes that do not broadcast.

    Examples
    --------
    >>> recentring_matrix(10, 0)[0]
    array([  1.,   0.,  10.,   0.,   0.,   0., 100.,   0.])
    """
    x, y = image_points(x, y)
    N = np.zeros((*x.shape, 8, 8))
    N[..., range(8), range(8)] = 1
    N[..., 0, 2], N[..., 0, 3], N[..., 0, 6], N[..., 0, 7] = x, y, x * x, x * y
    N[..., 1, 4], N[..., 1, 5], N[..., 1, 6], N[..., 1, 7] = x, y, x * y, y * y
    N[..., 2, 6], N[..., 2, 7] = 2 * x, y
    N[..., 3, 7] = x
    N[..., 4, 6] = y
    N[..., 5, 6], N[..., 5, 7] = x, 2 * y
    return N


def six_matrix(x: ArrayLike, y: ArrayLike) -> Array:
    """Matrix that takes the eight to the six numbers at a point: the design matrix of a fit of the eight.

    Parameters
    ----------
    x, y : arrays
        The point from the centre of the eight, px; shapes that broadcast.

    Returns
    -------
    float64 array, shape (..., 6, 8)
        Rows in the order of the six, columns in that of `EIGHT`.

    Raises
    ------
    InputError
        If the points are not real, not finite, or of shapes that do not broadcast.

    Examples
    --------
    The divergence, 10 px to the right of the centre: A + D + 30 E.

    >>> six_matrix(10, 0)[2] + 0.0
    array([ 0.,  0.,  1.,  0.,  0.,  1., 30.,  0.])
    """
    return np.asarray(SIX_FROM_GRADIENT @ recentring_matrix(x, y)[..., :6, :])


@dataclasses.dataclass(frozen=True, eq=False)
class Eight:
    """The flow of a plane, u₀ … F, with their covariance where it is known.

    Parameters
    ----------
    coefficients : array, shape (..., 8)
        u0, v0, A, B, C, D, E, F. NaN marks a flow that is not known.
    centre : (float, float)
        The image point from which x and y count, px.
    covariance : array, shape (..., 8, 8), optional
        Of the coefficients; symmetric.

    Raises
    ------
    InputError
        If the shapes do not fit or do not hold real numbers.

    Examples
    --------
    >>> flow = Eight([1, 0, 0.02, 0, 0, 0.01, 1e-4, 0], centre=(320, 240))
    >>> flow.six_at(320, 240).round(4)
    array([1.  , 0.  , 0.03, 0.  , 0.01, 0.  ])
    >>> flow.six_at(420, 240).round(4)
    array([4.  , 0.  , 0.06, 0.  , 0.02, 0.  ])
    """

    coefficients: Array
    centre: tuple[float, float] = (0.0, 0.0)
    covariance: Array | None = None

    def __post_init__(self) -> None:
        coefficients = as_floats("coefficients", self.coefficients, (8,)).astype(np.float64)
        object.__setattr__(self, "coefficients", coefficients)
        object.__setattr__(self, "centre", pair("centre", self.centre, "(x, y) in px"))
        if self.covariance is not None:
            covariance = require_covariance(self.covariance, coefficients)
            object.__setattr__(self, "covariance", covariance)

    def at(self, x: ArrayLike, y: ArrayLike) -> tuple[Array, Array]:
        """Velocity (u, v) at image points, px per frame interval; see `six_at`."""
        six = self.six_at(x, y)
        return six[..., 0], six[..., 1]

    def six_at(self, x: ArrayLike, y: ArrayLike) -> Array:
        """The six numbers at image points.

        Parameters
        ----------
        x, y : arrays
            Image points, px (not from the centre); their shape broadcasts with the leading shape of the
            coefficients.

        Returns
        -------
        float64 array, shape (..., 6)

        Raises
        ------
        InputError
            If the points are not real, not finite, or of a shape that does not fit.
        """
        M = self._six_matrix(x, y)
        return np.asarray(np.einsum("...ij,...j->...i", M, self.coefficients))

    def six_covariance_at(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Covariance of the six at image points, shape (..., 6, 6).

        Raises
        ------
        InputError
            If the eight have no covariance, or the points cannot be used.
        """
        if self.covariance is None:
            raise InputError(
                "covariance=None: these eight coefficients have none; give it when you make them"
            )
        M = self._six_matrix(x, y)
        return np.asarray(M @ self.covariance @ np.swapaxes(M, -1, -2))

    def recentred(self, centre: tuple[float, float]) -> Eight:
        """The same flow about another centre (x, y), px, with its covariance.

        Raises
        ------
        InputError
            If the centre is not two finite numbers.
        """
        x, y = pair("centre", centre, "(x, y) in px")
        N = recentring_matrix(x - self.centre[0], y - self.centre[1])
        covariance = None if self.covariance is None else N @ self.covariance @ N.T
        return Eight(self.coefficients @ N.T, (x, y), covariance)

    def _six_matrix(self, x: ArrayLike, y: ArrayLike) -> Array:
        x, y = image_points(x, y)
        broadcast(points=x, coefficients=self.coefficients[..., 0])
        return six_matrix(x - self.centre[0], y - self.centre[1])


def require_covariance(covariance: ArrayLike, coefficients: Array) -> Array:
    """Return the covariance (..., 8, 8) of eight coefficients; InputError if it cannot be one."""
    covariance = as_floats("covariance", covariance, (8, 8)).astype(np.float64)
    leading = coefficients.shape[:-1]
    if covariance.shape not in ((*leading, 8, 8), (8, 8)):
        raise InputError(
            f"covariance of shape {covariance.shape} for coefficients of shape {coefficients.shape}: must be "
            f"{(*leading, 8, 8)}"
        )
    known = np.isfinite(covariance).all(axis=(-1, -2), keepdims=True)
    checked = np.where(known, covariance, 0.0)
    scale = np.sqrt(np.abs(np.diagonal(checked, axis1=-2, axis2=-1)))
    asymmetry = np.abs(checked - np.swapaxes(checked, -1, -2))
    if (asymmetry > 1e-6 * scale[..., :, None] * scale[..., None, :]).any() or (
        np.diagonal(checked, axis1=-2, axis2=-1) < 0
    ).any():
        raise InputError("covariance: must be symmetric, with variances of at least 0 on its diagonal")
    return np.broadcast_to(covariance, (*leading, 8, 8))


def require_eight(eight: object) -> Eight:
    """Return the eight coefficients; InputError if they are none."""
    if not isinstance(eight, Eight):
        raise InputError(
            f"eight={eight!r}: must be an Eight, such as Eight([u0, v0, A, B, C, D, E, F], centre=(320, 240))"
        )
    return eight
