"""Projection: an orthonormal basis of what a bank sees, and its inner products with patches.

White noise gives overlapping kernels correlated responses. In an orthonormal basis S of the span of their real and
imaginary parts R = [Re W; Im W] it does not, and generalised least squares with the bank's covariance is ordinary
least squares on the responses s = S I.

The kernels are free of DC. Before the basis is taken they are made free of all of 1, x, y, x², xy, y², so that
brightness is not seen, nor its slope, nor its curvature.

A kernel's point reflection splits it into an even and an odd part, and the basis is made of pure ones.
An even row sees the even part of a patch alone: the patch is folded about its centre, p(o) ± p(−o), and half of the
multiplications are saved.

| symbol | name | shape |
|---|---|---|
| S | `rows`, even ones first | (m, n²) |
| o | offset from the centre of the patch | |
| X, Y | offset from the centre over the length unit | (n²,) |
"""

from __future__ import annotations

import functools
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.eigenfilters.bank import THRESHOLD, FilterBank
from sixflow.eigenfilters.geometry import Real

_PERIOD = 128


class Projection:
    """Orthonormal rows that span a bank, ready for patches.

    Parameters
    ----------
    bank : FilterBank
    length : float
        Unit of X and Y, px.
    dtype : float32 or float64
        In which patches are multiplied.

    Attributes
    ----------
    rows : float64 array, shape (m, n²)
        S; S Sᵀ is the identity. Directions in which the kernels' noise has less than 1e-4 of its largest variance
        are left out.
    even : int
        How many of them, the first ones, are even.

    Examples
    --------
    >>> from sixflow.eigenfilters import default_bank
    >>> projection = Projection(default_bank(15), length=10.0)
    >>> bool(np.allclose(projection.rows @ projection.rows.T, np.eye(len(projection.rows))))
    True
    """

    def __init__(self, bank: FilterBank, length: float, dtype: Any = np.float32) -> None:
        self.bank, self.length, self.dtype = bank, length, dtype
        self.rows, self.even = _basis(bank)
        side = np.arange(-bank.radius, bank.radius + 1) / length
        y, x = (c.ravel() for c in np.meshgrid(side, side, indexing="ij"))
        half = self.rows.shape[1] // 2 + 1
        weight = np.ones(half)
        weight[-1] = 0.5  # the centre pixel is folded on itself
        even, odd = self.rows[: self.even], self.rows[self.even :]
        self._power = (self.rows**2).sum(axis=0)[:half] * weight
        self._plain = [self._table(part[:, :half] * weight) for part in (even, odd)]
        self._moments = [
            self._table(
                np.concatenate([own[:, :half], (other * x)[:, :half], (other * y)[:, :half]]) * weight
            )
            for own, other in ((even, odd), (odd, even))
        ]

    def _table(self, rows: Real) -> NDArray[Any]:
        return np.ascontiguousarray(rows.T.astype(self.dtype))

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def radius(self) -> int:
        """Of the patch, px; its side is n = 2 radius + 1."""
        return self.bank.radius

    @property
    def extent(self) -> float:
        """Standard deviation, along one axis, of where the rows look for motion, px (`extent_of`)."""
        return extent_of(self.rows)

    def responses(self, folded: tuple[NDArray[Any], NDArray[Any]]) -> NDArray[Any]:
        """S I of folded patches (p(o) + p(−o) and p(o) − p(−o), each (points, n²//2 + 1)); shape (points, m)."""
        plus, minus = folded
        return np.concatenate([plus @ self._plain[0], minus @ self._plain[1]], axis=1)

    def moments(self, folded: tuple[NDArray[Any], NDArray[Any]]) -> NDArray[Any]:
        """S I, S (X I) and S (Y I) of folded patches; shape (points, 3, m)."""
        plus, minus = (
            part @ table for part, table in zip(folded, self._moments, strict=True)
        )  # even sums of I; odd ones
        e, o = self.even, len(self) - self.even
        out = np.empty((len(plus), 3, e + o), self.dtype)
        out[:, 0, :e], out[:, 0, e:] = plus[:, :e], minus[:, :o]
        for k in (1, 2):  # X and Y turn odd rows into even ones, and even ones into odd ones
            out[:, k, e:] = plus[:, e + (k - 1) * o : e + k * o]
            out[:, k, :e] = minus[:, o + (k - 1) * e : o + k * e]
        return out

    def seen(self, folded: tuple[NDArray[Any], NDArray[Any]]) -> NDArray[np.float64]:
        """Σ_o |S(o)|² over the pixels that count, of folded patches that are 1 there and 0 elsewhere; shape (points,).

        The power of the responses to white noise of unit variance: m for a whole patch.
        """
        result: NDArray[np.float64] = folded[0] @ self._power
        return result

    def overlap(self, dx: int, dy: int) -> Real:
        """S(o) S(o − (dx, dy))ᵀ: covariance of the responses to unit white noise at p with those at p + (dx, dy) px;
        shape (m, m).
        """
        n = 2 * self.radius + 1
        if max(abs(dx), abs(dy)) >= n:
            return np.zeros((len(self), len(self)))
        images = self.rows.reshape(-1, n, n)
        here = images[:, max(dy, 0) : n + min(dy, 0), max(dx, 0) : n + min(dx, 0)]
        there = images[:, max(-dy, 0) : n + min(-dy, 0), max(-dx, 0) : n + min(-dx, 0)]
        result: Real = here.reshape(len(self), -1) @ there.reshape(len(self), -1).T
        return result

    def frame_constant(self, spacing: int) -> float:
        """Σ_q |S f|² over |f|² for patterns f in the bank's band, with positions q `spacing` px apart.

        With P(k) = Σ_j |Ŝ_j(k)|²/spacing² the positions see P |f̂|² of a spectrum |f̂|². This is P averaged over
        itself, ∫P²/∫P: the ratio for a pattern whose own spectrum is P.
        """
        n = 2 * self.radius + 1
        spectra = np.fft.fft2(self.rows.reshape(-1, n, n), (max(_PERIOD, n),) * 2)
        power = (np.abs(spectra) ** 2).sum(axis=0) / spacing**2
        return float((power**2).sum() / power.sum())

    def gradient_noise(self, derivative: tuple[float, ...]) -> Real:
        """What white noise of unit variance in an image adds to Dᵀ D, shape (6, 6), with the design D =
        S (g_x, g_x X, g_x Y, g_y, g_y X, g_y Y) of its gradient.

        Parameters
        ----------
        derivative : tuple of floats
            Half-weights of the antisymmetric difference that takes the gradient.
        """
        n, reach = 2 * self.radius + 1, len(derivative)
        images = np.pad(self.rows.reshape(-1, n, n), ((0, 0), (reach, reach), (reach, reach)))
        side = np.arange(-self.radius - reach, self.radius + reach + 1) / self.length
        y, x = np.meshgrid(side, side, indexing="ij")
        columns = []
        for axis in (2, 1):
            for factor in (np.ones_like(x), x, y):
                weighted = images * factor
                columns.append(
                    sum(
                        d * (np.roll(weighted, k + 1, axis) - np.roll(weighted, -k - 1, axis))
                        for k, d in enumerate(derivative)
                    )
                )
        stacked = np.stack(columns).reshape(6, -1)
        result: Real = stacked @ stacked.T
        return result


def extent_of(rows: Real) -> float:
    """Standard deviation, along one axis, of where orthonormal rows (m, n²) look for motion, px.

    A displacement e(x) of a pattern with the gradient g is seen as Σ_j ⟨S_j, g⟩⟨S_j, g e⟩: with the weight
    Σ_j S_j(x) (C ∗ S_j)(x) at x, C the autocorrelation of the gradient. C is taken of blobs of σ = 1 px, whose gradient
    has the power k² exp(−k²): of coarser patterns the operators look a little further, of finer ones less far.
    """
    n = math.isqrt(rows.shape[1])
    size = max(_PERIOD, 2 * n)
    k = 2 * np.pi * np.fft.fftfreq(size)
    power = k[:, None] ** 2 + k[None, :] ** 2
    images = rows.reshape(-1, n, n)
    spectra = np.fft.fft2(images, (size, size)) * (power * np.exp(-power))
    correlated = np.fft.ifft2(spectra).real[:, :n, :n]
    weight = (images * correlated).sum(axis=0)
    side = np.arange(n) - n // 2
    squared = side[:, None] ** 2 + side[None, :] ** 2
    return float(np.sqrt((weight * squared).sum() / weight.sum() / 2))


@functools.lru_cache(maxsize=8)
def _basis(bank: FilterBank) -> tuple[Real, int]:
    R = np.concatenate([bank.matrix.real, bank.matrix.imag])
    parts = [(R + sign * R[:, ::-1]) / 2 for sign in (1, -1)]
    side = np.arange(-bank.radius, bank.radius + 1.0)
    x, y = (c.ravel() for c in np.meshgrid(side, side))
    for k, surfaces in enumerate(((np.ones_like(x), x * x, x * y, y * y), (x, y))):
        smooth, _ = np.linalg.qr(np.stack(surfaces, axis=1))
        parts[k] = parts[k] - (parts[k] @ smooth) @ smooth.T
    split = [np.linalg.eigh(part @ part.T) for part in parts]
    floor = THRESHOLD * max(values[-1] for values, _ in split)
    rows = []
    for part, (values, vectors) in zip(parts, split, strict=True):
        kept = values > floor
        rows.append((vectors[:, kept] / np.sqrt(values[kept])).T[::-1] @ part)
    basis = np.concatenate(rows)
    basis.flags.writeable = False
    return basis, len(rows[0])
