"""The six generators of the affine group as operators on images (Eagleson, eqs. (3) and (4)).

A generator is the derivative along a vector field, L = a(x, y)·∇, and its trajectories are x' = exp(τL) x:

| symbol | name | a = (a_x, a_y) | ∇·a | trajectory exp(τL) |
|---|---|---|---|---|
| L_x | u | (1, 0) | 0 | x + τ, y |
| L_y | v | (0, 1) | 0 | x, y + τ |
| L_s | divergence | (x, y) | 2 | x e^τ, y e^τ |
| L_r | curl | (−y, x) | 0 | x cos τ − y sin τ, x sin τ + y cos τ |
| L_b | stretch | (x, −y) | 0 | x e^τ, y e^−τ |
| L_B | shear | (y, x) | 0 | x cosh τ + y sinh τ, x sinh τ + y cosh τ |

(As corrected here: the print of eq. (4) has cos and sin for cosh and sinh in the trajectory of L_B, which
would be a rotation.) Symbol and name are those of `sixflow.convention`: the name is that of the one of the
six numbers that the generator makes, τ for u and v, 2τ for the others. x, y are relative to the centre of
the operator, px; y is down, so that positive curl turns clockwise on the screen.

Where two generators commute, their phases can be measured together; `bracket` says which do. [L_x, L_y] = 0,
and L_s commutes with L_r, L_b and L_B; [L_r, L_b], [L_r, L_B] and [L_b, L_B] are ±2 times the third.

L_t = ∂/∂t stands apart: it is no motion in the plane, commutes with all six, and balances them, because an
image that is carried along obeys (L_t + Σ τ_k L_k) I = 0.
"""

from __future__ import annotations

import types
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from sixflow.array_checks import Array, as_floats, require_broadcast, silent
from sixflow.convention.affine import SIX_PER_COEFFICIENT, six_from_coefficients
from sixflow.convention.six import GENERATOR_NAMES, GENERATORS, SIX, gradient, six_from_algebra
from sixflow.errors import InputError


@dataclass(frozen=True)
class Generator:
    """One of the six generators L = a(x, y)·∇ (Eagleson, eq. (3)).

    Attributes
    ----------
    name : str
        Of the number of the six that it makes: "u", "v", "divergence", "curl", "stretch", "shear".
    symbol : str
        "L_x", "L_y", "L_s", "L_r", "L_b", "L_B".

    Examples
    --------
    >>> L_s.field(3.0, 4.0)
    (np.float64(3.0), np.float64(4.0))
    >>> L_s.divergence
    2.0
    """

    name: str
    symbol: str

    @property
    def index(self) -> int:
        """Place in the order of the six, 0 … 5."""
        return SIX.index(self.name)

    @property
    def matrix(self) -> Array:
        """Matrix X with a = X (x, y, 1), shape (3, 3), from `sixflow.convention.GENERATORS`. Read-only."""
        return GENERATORS[self.index]

    @property
    def divergence(self) -> float:
        """∇·a, the same everywhere: 2 for L_s, 0 for the others."""
        return float(self.matrix[0, 0] + self.matrix[1, 1])

    def field(self, x: ArrayLike, y: ArrayLike) -> tuple[Array, Array]:
        """Vector field (a_x, a_y) of L = a_x ∂/∂x + a_y ∂/∂y (Eagleson, eq. (3)).

        Parameters
        ----------
        x, y : arrays that broadcast together
            Position relative to the centre, px, y down.

        Returns
        -------
        a_x, a_y : arrays of the broadcast shape
            Per unit of τ: px of motion.

        Raises
        ------
        InputError
            If x or y are not real numbers, or do not broadcast.

        Examples
        --------
        >>> L_r.field([1.0, 0.0], [0.0, 1.0])
        (array([ 0., -1.]), array([1., 0.]))
        """
        x, y = positions(x, y)
        (xx, xy, x1), (yx, yy, y1) = self.matrix[:2].tolist()
        return xx * x + xy * y + x1, yx * x + yy * y + y1

    def apply(self, gradient_x: ArrayLike, gradient_y: ArrayLike, x: ArrayLike, y: ArrayLike) -> Array:
        """L I = a·∇I: by how much an image changes, per unit of τ, at the points of its trajectory.

        Parameters
        ----------
        gradient_x, gradient_y : arrays
            ∂I/∂x and ∂I/∂y at the points, image values per px.
        x, y : arrays
            Position relative to the centre, px. All four broadcast together.

        Returns
        -------
        array of the broadcast shape
            Image values.

        Raises
        ------
        InputError
            If an argument does not hold real numbers, or they do not broadcast.

        Examples
        --------
        A zoom of the ramp I = 5x:

        >>> L_s.apply(5.0, 0.0, x=2.0, y=7.0)
        np.float64(10.0)
        """
        gradient_x, gradient_y = (
            as_floats("gradient_x", gradient_x, ()),
            as_floats("gradient_y", gradient_y, ()),
        )
        a_x, a_y = self.field(x, y)
        require_broadcast(gradient_x=gradient_x.shape, gradient_y=gradient_y.shape, position=a_x.shape)
        return a_x * gradient_x + a_y * gradient_y

    @silent
    def flow(self, tau: ArrayLike, x: ArrayLike, y: ArrayLike) -> tuple[Array, Array]:
        """Finite trajectory x' = exp(τL) x (Eagleson, eq. (4); as corrected here: L_B is hyperbolic).

        Parameters
        ----------
        tau : array
            Parameter of the group: px for L_x and L_y, the logarithm of the zoom for L_s, the angle (rad, from
            x towards y) for L_r, a hyperbolic angle for L_b and L_B.
        x, y : arrays
            Start, relative to the centre, px. All three broadcast together.

        Returns
        -------
        x', y' : arrays of the broadcast shape
            px.

        Raises
        ------
        InputError
            If an argument does not hold real numbers, or they do not broadcast.

        Examples
        --------
        >>> import numpy as np
        >>> L_b.flow(np.log(2), 3.0, 4.0)
        (np.float64(6.0), np.float64(2.0))
        """
        tau = as_floats("tau", tau, ())
        x, y = positions(x, y)
        require_broadcast(tau=tau.shape, position=x.shape)
        coefficients = np.zeros((*tau.shape, len(SIX)), dtype=tau.dtype)
        coefficients[..., self.index] = tau
        six = six_from_coefficients(coefficients)
        G = gradient(six)
        return (
            x + six[..., 0] + G[..., 0, 0] * x + G[..., 0, 1] * y,
            y + six[..., 1] + G[..., 1, 0] * x + G[..., 1, 1] * y,
        )


@dataclass(frozen=True)
class TimeGenerator:
    """L_t = ∂/∂t, the first derivative in time (Eagleson, §3.1).

    Its canonical coordinate is t itself, its Jacobian 1 and its eigenfunctions are exp(−iωt). With
    I1(x + u) = I0(x), (L_t + Σ τ_k L_k) I = 0 holds to second order in τ if L_t I is the difference of the
    two frames and L_k I the mean over both.

    Attributes
    ----------
    name : str
        "time".
    symbol : str
        "L_t".
    """

    name: str = "time"
    symbol: str = "L_t"

    def apply(self, frame0: ArrayLike, frame1: ArrayLike) -> Array:
        """L_t I of two frames: their difference, image values per frame interval, half-way between them.

        Parameters
        ----------
        frame0, frame1 : arrays that broadcast together

        Returns
        -------
        array of the broadcast shape

        Raises
        ------
        InputError
            If an argument does not hold real numbers, or they do not broadcast.

        Examples
        --------
        A ramp I = 5x that has moved by 0.2 px: L_t I + τ L_x I = 0.

        >>> L_t.apply(10.0, 9.0) + 0.2 * L_x.apply(5.0, 0.0, 2.0, 0.0)
        np.float64(0.0)
        """
        frame0, frame1 = as_floats("frame0", frame0, ()), as_floats("frame1", frame1, ())
        require_broadcast(frame0=frame0.shape, frame1=frame1.shape)
        return frame1 - frame0

    def flow(self, tau: ArrayLike, t: ArrayLike) -> Array:
        """Trajectory t' = t + τ, in frame intervals."""
        tau, t = as_floats("tau", tau, ()), as_floats("t", t, ())
        require_broadcast(tau=tau.shape, t=t.shape)
        return t + tau


L_x, L_y, L_s, L_r, L_b, L_B = (Generator(*both) for both in zip(SIX, GENERATOR_NAMES, strict=True))
L_t = TimeGenerator()

BY_NAME: Mapping[str, Generator] = types.MappingProxyType(
    {key: g for g in (L_x, L_y, L_s, L_r, L_b, L_B) for key in (g.name, g.symbol)}
)
"""The six generators by their names and by their symbols."""

GeneratorLike: TypeAlias = Generator | str
"""A generator, its name ("stretch") or its symbol ("L_b")."""


def as_generator(generator: GeneratorLike, argument: str = "generator") -> Generator:
    """Return the generator that is meant by an object, a name or a symbol.

    Parameters
    ----------
    generator : Generator or str
        Such as L_b, "stretch" or "L_b".
    argument : str
        What the caller calls it, for the message of the error.

    Raises
    ------
    InputError
        If it is none of the six.

    Examples
    --------
    >>> as_generator("stretch")
    Generator(name='stretch', symbol='L_b')
    """
    found = generator if isinstance(generator, Generator) else None
    if isinstance(generator, str):
        found = BY_NAME.get(generator)
    if found is None:
        aside = (
            "L_t is a derivative in time, not one of the six; " if generator in (L_t, "L_t", "time") else ""
        )
        raise InputError(f"{argument}={generator!r}: {aside}must be one of {', '.join(BY_NAME)}")
    return found


def bracket(first: GeneratorLike, second: GeneratorLike) -> Array:
    """Lie bracket [L₁, L₂] = L₁L₂ − L₂L₁ of the operators, as coefficients of the six generators.

    It is the operator of the matrix X₂X₁ − X₁X₂: the operators (X₁x)·∇ and (X₂x)·∇ act in the opposite order.

    Parameters
    ----------
    first, second : Generator or str

    Returns
    -------
    float64 array, shape (6,)
        c of [L₁, L₂] = Σ c_k L_k, in the order of the six.

    Raises
    ------
    InputError
        If one of them is none of the six.

    Examples
    --------
    The two shears do not commute, [L_b, L_B] = 2 L_r:

    >>> bracket(L_b, L_B)
    array([0., 0., 0., 2., 0., 0.])
    """
    X1, X2 = as_generator(first, "first").matrix, as_generator(second, "second").matrix
    return six_from_algebra(X2 @ X1 - X1 @ X2) / SIX_PER_COEFFICIENT


def commute(first: GeneratorLike | TimeGenerator, second: GeneratorLike | TimeGenerator) -> bool:
    """Whether [L₁, L₂] = 0, so that canonical coordinates of both exist (Eagleson, §4.3.2).

    L_t commutes with all.

    Parameters
    ----------
    first, second : Generator, TimeGenerator or str

    Raises
    ------
    InputError
        If one of them is no generator.

    Examples
    --------
    >>> commute("divergence", "curl"), commute("stretch", "shear")
    (True, False)
    """
    if isinstance(first, TimeGenerator) or isinstance(second, TimeGenerator):
        return True
    return not bracket(first, second).any()


def positions(x: ArrayLike, y: ArrayLike) -> tuple[Array, Array]:
    """Return x and y as real floating-point arrays of one shape; InputError if that cannot be."""
    x, y = as_floats("x", x, ()), as_floats("y", y, ())
    require_broadcast(x=x.shape, y=y.shape)
    return tuple(np.broadcast_arrays(x, y))  # type: ignore[return-value]
