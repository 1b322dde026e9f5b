"""Least squares for models of the eight coefficients, with their covariance.

    minimise χ² = (θ − f)ᵀ C⁻¹ (θ − f),   Cov = (Jᵀ C⁻¹ J)⁺

χ² has, if the model is right, the mean k and the variance 2k, k the number of coefficients less that of the parameters.
Where it is far larger, covariances are multiplied by χ²/k, as in `region`.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.interpretation.estimate import Estimate

Array = NDArray[Any]

_RANK = 1e-9  # singular values below this share of the largest are 0
_CONTRADICTED = 1e-3


class Whitened:
    """Coefficients in units of their errors."""

    def __init__(self, theta: Array, covariance: Array) -> None:
        size = np.sqrt(np.diagonal(covariance))
        root = np.linalg.cholesky(covariance / np.outer(size, size))
        self._theta, self._root, self._size = theta, root, size

    def _units(self, values: Array) -> Array:
        return np.asarray(np.linalg.solve(self._root, (values.T / self._size).T))

    def step(self, model: Array, J: Array) -> Array:
        """The change of the parameters by a Gauss–Newton step; the least one that does it."""
        return np.asarray(np.linalg.pinv(self._units(J), rcond=_RANK) @ self._units(self._theta - model))

    def square(self, model: Array) -> float:
        """χ² of a model."""
        return float((self._units(self._theta - model) ** 2).sum())

    def covariance(self, J: Array) -> Array:
        """Of the parameters; directions that change nothing have none."""
        inverse = np.linalg.pinv(self._units(J), rcond=_RANK)
        return np.asarray(inverse @ inverse.T)


@dataclasses.dataclass(frozen=True)
class Agreement:
    """How well a model agrees with the coefficients.

    Attributes
    ----------
    square : float
        χ².
    freedom : int
        Its mean, if the model is right.
    """

    square: float
    freedom: int

    @property
    def misfit(self) -> Estimate:
        """χ² over its mean: 1 if the model is right."""
        return Estimate(self.square / self.freedom, math.sqrt(2 / self.freedom))

    @property
    def contradicted(self) -> bool:
        """Whether χ² would be as large by chance once in a thousand times or less."""
        from scipy.special import chdtrc

        return float(chdtrc(self.freedom, self.square)) < _CONTRADICTED

    @property
    def enlargement(self) -> float:
        """Factor on covariances: the misfit where the model is contradicted, else 1."""
        return self.misfit.value if self.contradicted else 1.0

    def remark(self, why: str) -> tuple[str, ...]:
        """A statement where the model is contradicted; none otherwise."""
        if not self.contradicted:
            return ()
        found, spread, factor = self.misfit.value, self.misfit.standard_error, math.sqrt(self.enlargement)
        return (
            f"NOT BORNE OUT: the misfit is {found:.3g}, where 1 ± {spread:.2g} is expected; {why}, and standard errors "
            f"are multiplied by {factor:.3g}",
        )
