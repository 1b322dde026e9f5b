"""A bank of kernels: the recipe, and the matrices that are applied to patches.

A `FilterBank` is a tuple of kernels and the radius of their patch: immutable, hashable, cheap to make. Its arrays are
computed when first asked for, shared by equal banks, and read-only.

| symbol | name | shape |
|---|---|---|
| W | `matrix` | (K, n²) |
| h_jk | `derivatives` | (K, 6, n²) |
| W Wᴴ | `noise_covariance` | (K, K) |

With I a patch as a vector, rows (y) first, the responses are g = W I, the correlation Σ_o I(p + o) w(o), and their
derivatives along the six generators ∂g_j/∂τ_k = h_jk I. White noise of variance σ² in the image gives the responses
the covariance σ² W Wᴴ; with the real parts stacked on the imaginary parts, σ² R Rᵀ, R = [Re W; Im W], which the
complex covariance alone does not determine. Overlapping kernels make it nearly singular, so that it is inverted in
the space of its larger eigenvalues: the whitened responses T [Re g; Im g] have unit covariance per unit of σ².
"""

from __future__ import annotations

import functools
import os
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from sixflow.convention.six import GENERATOR_NAMES
from sixflow.eigenfilters.geometry import Real, require_radius
from sixflow.eigenfilters.kernel import Complex, Kernel
from sixflow.errors import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

THRESHOLD = 1e-4
"""Eigenvalues of the noise covariance below this part of the largest are dropped."""


@dataclass(frozen=True)
class FilterBank:
    """Kernels on one patch, and the matrices made of them.

    Parameters
    ----------
    kernels : tuple of Kernel
        At least one; no two equal.
    radius : int
        Of the square patch, px, 1 to 512; its side is n = 2 radius + 1.

    Raises
    ------
    InputError
        If a kernel is no kernel, or there are none or equal ones, or the radius cannot be used.

    Examples
    --------
    >>> from sixflow.eigenfilters.kernels import Gabor, Spiral
    >>> bank = FilterBank((Gabor(0.5), Gabor(0.5, 1.57), Spiral(4.0, 0), Spiral(0.0, 4)), radius=20)
    >>> bank.matrix.shape, bank.derivatives.shape
    ((4, 1681), (4, 6, 1681))
    >>> bank == FilterBank(bank.kernels, 20), bank.matrix is FilterBank(bank.kernels, 20).matrix
    (True, True)
    """

    kernels: tuple[Kernel, ...]
    radius: int

    def __post_init__(self) -> None:
        kernels = tuple(self.kernels) if isinstance(self.kernels, Iterable) else ()
        if not kernels:
            raise InputError(f"kernels={self.kernels!r}: must be one or more kernels, such as (Gabor(0.5),)")
        for index, kernel in enumerate(kernels):
            if not isinstance(kernel, Kernel):
                raise InputError(f"kernels[{index}]={kernel!r}: must be a Gabor, Spiral or Hyperbolic kernel")
            if kernel in kernels[:index]:
                raise InputError(f"kernels[{index}]={kernel!r}: is there twice; leave one out")
        object.__setattr__(self, "kernels", kernels)
        object.__setattr__(self, "radius", require_radius(self.radius))

    def __len__(self) -> int:
        """Number of complex kernels."""
        return len(self.kernels)

    @property
    def size(self) -> int:
        """Side n of the patch, px."""
        return 2 * self.radius + 1

    @property
    def matrix(self) -> Complex:
        """W, the kernels as rows: complex128, shape (K, n²), patches row by row (y, then x)."""
        return _matrix(self)

    @property
    def derivatives(self) -> Complex:
        """h, the derivative kernels along L_x, L_y, L_s, L_r, L_b, L_B: complex128, shape (K, 6, n²).

        Per unit of τ_k: times (1, 1, ½, ½, ½, ½) per unit of the six numbers.
        """
        return _derivatives(self)

    @property
    def orders(self) -> Real:
        """Orders (u, v) of the kernels, shape (K, 2)."""
        return np.array([kernel.orders for kernel in self.kernels])

    @property
    def noise_covariance(self) -> Complex:
        """W Wᴴ, covariance of the complex responses to white noise of unit variance, shape (K, K)."""
        return _covariance(self).complex

    @property
    def real_noise_covariance(self) -> Real:
        """R Rᵀ, that of the real parts followed by the imaginary parts, shape (2K, 2K)."""
        return _covariance(self).real

    @property
    def condition_number(self) -> float:
        """Largest over smallest eigenvalue of the real noise covariance; infinite if it is singular."""
        values = _covariance(self).eigenvalues
        return float(values[-1] / values[0]) if values[0] > 0 else float("inf")

    @property
    def independent(self) -> int:
        """Number of independent real responses: eigenvalues not below 1e-4 of the largest, at most 2K."""
        return len(self.whitening())

    def whitening(self, threshold: float = THRESHOLD) -> Real:
        """Matrix T that makes the responses to white noise independent, of unit variance.

        T = Λ^(−½) Qᵀ with the eigenvalues Λ and eigenvectors Q of the real noise covariance C, without those
        below `threshold` times the largest: T C Tᵀ is the identity.

        Parameters
        ----------
        threshold : float
            1e-14 to 1. Smaller keeps more directions, which depend more on errors of the noise model.

        Returns
        -------
        float64 array, shape (m, 2K)
            Acts on the real parts followed by the imaginary parts of the responses; m ≤ 2K, largest eigenvalue first.

        Raises
        ------
        InputError
            If the threshold is outside its range.

        Examples
        --------
        >>> from sixflow.eigenfilters.kernels import Gabor
        >>> bank = FilterBank((Gabor(0.5), Gabor(0.55)), radius=20)
        >>> T = bank.whitening()
        >>> bool(np.allclose(T @ bank.real_noise_covariance @ T.T, np.eye(len(T))))
        True
        """
        if not (isinstance(threshold, int | float | np.floating) and 1e-14 <= threshold < 1):
            raise InputError(
                f"threshold={threshold!r}: must be a number of at least 1e-14 and below 1, such as 1e-4"
            )
        return _whitening(self, float(threshold))

    def responses(self, patches: Any) -> Complex:
        """Complex responses g = W I of patches.

        Parameters
        ----------
        patches : array, shape (..., n²)
            Grey values, each patch row by row.

        Returns
        -------
        complex array, shape (..., K)
            In units of the grey values.

        Raises
        ------
        InputError
            If the patches have another size.
        """
        array = np.asarray(patches)
        if array.ndim == 0 or array.shape[-1] != self.size**2:
            raise InputError(
                f"patches of shape {array.shape}: the last dimension must be {self.size**2}, "
                f"a patch of {self.size} × {self.size} px row by row"
            )
        result: Complex = array @ self.matrix.T
        return result

    def describe(self) -> str:
        """The bank as a table of text: one line per kernel.

        Examples
        --------
        >>> from sixflow.eigenfilters.kernels import Gabor, Spiral
        >>> print(FilterBank((Gabor(0.5, sigma=5), Spiral(4.0, 0, scale=6)), radius=20).describe())
        2 complex kernels on 41 × 41 px, 4 independent real responses, condition number 2.5
          #  kernel                   pair           u       v
          0  Gabor 12.6 px 0°         L_x, L_y   0.500   0.000
          1  spiral u 4, v 0, r 6 px  L_s, L_r   4.000   0.000
        """
        head = (
            f"{len(self)} complex kernel{'s' if len(self) > 1 else ''} on {self.size} × {self.size} px, "
            f"{self.independent} independent real responses, condition number {self.condition_number:.2g}"
        )
        width = max(len(kernel.label) for kernel in self.kernels)
        lines = [head, f"  #  {'kernel':<{width}}  {'pair':<8}  {'u':>6}  {'v':>6}"]
        for index, kernel in enumerate(self.kernels):
            u, v = (order if abs(order) > 5e-4 else 0.0 for order in kernel.orders)
            pair = ", ".join(kernel.generators)
            lines.append(f"{index:3d}  {kernel.label:<{width}}  {pair:<8}  {u:6.3f}  {v:6.3f}")
        return "\n".join(lines)

    def picture(self, path: str | os.PathLike[str] | None = None) -> Figure:
        """Draw the even and the odd operator of every kernel on one sheet.

        Parameters
        ----------
        path : str or path, optional
            Save the sheet here at 300 dpi; the suffix chooses the format: .png, .pdf, .svg.

        Returns
        -------
        Figure
            A matplotlib figure that belongs to no window.

        Raises
        ------
        InputError
            If the suffix of the path is none that can be written.
        FieldFileError
            If the sheet cannot be saved.
        """
        from sixflow.drawing.kernels import (
            draw_kernels,  # matplotlib is loaded only when a picture is asked for
        )

        captions = [_caption(kernel) for kernel in self.kernels]
        return draw_kernels(self.matrix.reshape(-1, self.size, self.size), captions, path)


def _caption(kernel: Kernel) -> str:
    """The two generators of a kernel with its orders, in the notation of the paper."""
    parts = zip(kernel.generators, kernel.orders, strict=True)
    return ", ".join(rf"$\mathcal{{L}}_{name.replace('L_', '')}$ {_short(order)}" for name, order in parts)


def _short(value: float) -> str:
    value = value if abs(value) > 5e-3 else 0.0
    text = f"{value:.2g}" if abs(value) < 9.95 else f"{value:.0f}"
    return text.replace("-", "−")


class _Covariance(NamedTuple):
    complex: Complex
    real: Real
    eigenvalues: Real
    eigenvectors: Real


@functools.lru_cache(maxsize=8)
def _matrix(bank: FilterBank) -> Complex:
    return _frozen(np.stack([kernel.sample(bank.radius).ravel() for kernel in bank.kernels]))


@functools.lru_cache(maxsize=4)
def _derivatives(bank: FilterBank) -> Complex:
    h = np.empty((len(bank), len(GENERATOR_NAMES), bank.size**2), np.complex128)
    for j, kernel in enumerate(bank.kernels):
        for k, name in enumerate(GENERATOR_NAMES):
            h[j, k] = kernel.derivative(name, bank.radius).ravel()
    return _frozen(h)


@functools.lru_cache(maxsize=8)
def _covariance(bank: FilterBank) -> _Covariance:
    W = bank.matrix
    R = np.concatenate([W.real, W.imag])
    real = R @ R.T
    values, vectors = np.linalg.eigh(real)
    return _Covariance(_frozen(W @ W.conj().T), _frozen(real), _frozen(values), _frozen(vectors))


@functools.lru_cache(maxsize=16)
def _whitening(bank: FilterBank, threshold: float) -> Real:
    _, _, values, vectors = _covariance(bank)
    kept = values >= threshold * values[-1]
    return _frozen((vectors[:, kept] / np.sqrt(values[kept])).T[::-1].copy())


def _frozen(array: Any) -> Any:
    array.flags.writeable = False
    return array
