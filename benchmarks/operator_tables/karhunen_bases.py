"""Bases of windowed patches, and how well n of their vectors do: the mathematics of the table `karhunen`.

Covariances of patches and of the differences that motion makes, from the correlation of a texture; orthonormal bases;
residual energy, coding gain, information, angular orders. Symbols are those of `karhunen`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct, dctn, idctn
from scipy.linalg import eigh
from scipy.ndimage import map_coordinates
from scipy.special import j0, j1, jn

from sixflow.convention import SIX
from sixflow.eigenfilters import FilterBank, Gabor, default_bank
from sixflow.eigenfilters.generators import as_generator
from sixflow.eigenfilters.kernel import Kernel
from sixflow.engine.window import window_sigma

Array: TypeAlias = NDArray[np.float64]

WINDOW, RADIUS, RMS = 31, 27, 0.1
SIGMA, SIDE = window_sigma(WINDOW), 2 * RADIUS + 1
SIZE = SIDE**2
COUNTS = (8, 16, 32, 64, 108)
FAMILIES = ("gabor", "spiral", "hyperbolic")


class Window(NamedTuple):
    """Points of the square patch, row by row, and how they are weighted; arrays of shape (N,).

    `power` is that of w in the amplitude a = w^power. ½ is the weight of the least-squares fit. 1 is the envelope
    of the kernels, which are then taken as vectors b = K as they are.
    """

    x: Array
    y: Array
    amplitude: Array
    power: float

    @property
    def brightness(self) -> Array:
        """Unit vector along which a change of brightness moves a windowed patch."""
        return self.amplitude / np.linalg.norm(self.amplitude)

    def see(self, images: Array) -> Array:
        """Weight images (..., N) and take the brightness out."""
        return self.without_brightness(self.amplitude * images)

    def without_brightness(self, seen: Array) -> Array:
        """Windowed patches (..., N) without what is along `brightness`."""
        along = self.brightness
        return seen - (seen @ along)[..., None] * along


class Correlation(NamedTuple):
    """Correlation of an isotropic texture and its derivatives at the differences of two points, (2 SIDE − 1)²."""

    value: Array
    slope: Array
    bend: Array


def make_window(power: float = 0.5) -> Window:
    """The square patch with the amplitude w^power."""
    offsets = np.arange(-RADIUS, RADIUS + 1.0)
    y, x = (part.ravel() for part in np.meshgrid(offsets, offsets, indexing="ij"))
    return Window(x, y, np.exp(-power * (x * x + y * y) / (2 * SIGMA**2)), power)


def lattice() -> tuple[Array, Array]:
    """All differences δ of two points of the patch."""
    steps = np.arange(1.0 - SIDE, SIDE)
    dy, dx = np.meshgrid(steps, steps, indexing="ij")
    return dx, dy


def blob_correlation(sigma: float) -> Correlation:
    """Gaussian blobs of radius σ: ρ = exp(−r²/(4σ²))."""
    dx, dy = lattice()
    value = np.exp(-(dx * dx + dy * dy) / (4 * sigma**2))
    return Correlation(value, -value / (2 * sigma**2), value / (4 * sigma**4))


def band_correlation(shortest: float, longest: float) -> Correlation:
    """Spectrum that is flat in a ring of wave numbers k: ρ is the mean of J₀(kr) over k²."""
    r = np.hypot(*lattice())
    safe = np.where(r > 0, r, 1.0)
    low, high = (2 * np.pi / longest) ** 2, (2 * np.pi / shortest) ** 2
    nodes, weights = np.polynomial.legendre.leggauss(64)
    value, slope, bend = np.zeros((3, *r.shape))
    for k2, part in zip(low + (high - low) * (nodes + 1) / 2, weights / 2, strict=True):
        k = np.sqrt(k2)
        value += part * j0(k * r)
        slope += part * np.where(r > 0, -k * j1(k * r) / safe, -k2 / 2)
        bend += part * np.where(r > 0, k2 * jn(2, k * r) / safe**2, k2 * k2 / 8)
    return Correlation(value, slope, bend)


def pairwise(function: Array) -> Array:
    """Matrix f(o' − o), (N, N), of a function of the difference."""
    step = np.arange(SIDE) - np.arange(SIDE)[:, None] + SIDE - 1
    return function[step[:, None, :, None], step[None, :, None, :]].reshape(SIZE, SIZE)


def patch_covariance(window: Window, correlation: Correlation) -> Array:
    """E x xᵀ, (N, N), for grey values of unit variance."""
    return window.see(window.see(pairwise(correlation.value)).T)


def difference_covariance(window: Window, correlation: Correlation, numbers: Sequence[str] = SIX) -> Array:
    """E d dᵀ, (N, N), for random deformations by some of the six, to first order."""
    fields = [as_generator(name).field(window.x, window.y) for name in numbers]
    s = np.array([RMS if name in "uv" else RMS / SIGMA for name in numbers])
    a_x, a_y = (s * np.stack([field[axis] for field in fields], axis=1) for axis in (0, 1))
    (dx, dy), slope, bend = lattice(), correlation.slope, correlation.bend
    covariance = (a_x @ a_x.T) * pairwise(slope + bend * dx * dx)
    covariance += (a_y @ a_y.T) * pairwise(slope + bend * dy * dy)
    covariance += (a_x @ a_y.T + a_y @ a_x.T) * pairwise(bend * dx * dy)
    return -window.see(window.see(covariance).T)


def variances(covariance: Array, vectors: Array) -> Array:
    """Variance of the coefficient of each column."""
    return np.einsum("ij,ij->j", vectors, covariance @ vectors)


def descending(values: Array) -> NDArray[np.intp]:
    """Order from the largest on; values that are equal but for rounding keep theirs."""
    return np.argsort(-np.round(values / values.max(), 9), kind="stable")


def in_cosines(matrix: Array) -> Array:
    """A symmetric matrix (N, N) between the vectors of the two-dimensional DCT."""
    once = dctn(matrix.reshape(-1, SIDE, SIDE), axes=(1, 2), norm="ortho").reshape(SIZE, SIZE)
    return dctn(once.T.reshape(-1, SIDE, SIDE), axes=(1, 2), norm="ortho").reshape(SIZE, SIZE)


def from_cosines(coefficients: Array) -> Array:
    """Vectors of the patch from columns of DCT coefficients."""
    square = coefficients.T.reshape(-1, SIDE, SIDE)
    return idctn(square, axes=(1, 2), norm="ortho").reshape(-1, SIZE).T


def cosine_vectors(order: NDArray[np.intp]) -> Array:
    """Vectors of the DCT with these flat indices."""
    return from_cosines((np.arange(SIZE)[:, None] == order).astype(float))


def karhunen_loeve(cosines: Array, count: int) -> tuple[Array, Array]:
    """Largest eigenvalues and their eigenvectors, of a covariance given `in_cosines`.

    Reflecting x or y must leave it as it is. Cosines of different parity are then uncorrelated, and the four
    parities are solved one by one.
    """
    row, column = np.divmod(np.arange(SIZE), SIDE)
    values, coefficients = np.empty(4 * count), np.zeros((SIZE, 4 * count))
    for parity in range(4):
        same = np.flatnonzero(2 * (row % 2) + column % 2 == parity)
        part, largest = slice(parity * count, (parity + 1) * count), (len(same) - count, len(same) - 1)
        values[part], coefficients[same, part] = eigh(cosines[np.ix_(same, same)], subset_by_index=largest)
    order = descending(values)[:count]
    return values[order], from_cosines(coefficients[:, order])


def learned(samples: Array, count: int) -> Array:
    """KL basis of the sample covariance of (m, N) samples, by the m × m matrix of their products."""
    values, vectors = eigh(samples @ samples.T, subset_by_index=(len(samples) - count, len(samples) - 1))
    return (samples.T @ (vectors / np.sqrt(values)))[:, ::-1]


def greedy(covariance: Array, vectors: Array, count: int) -> tuple[Array, list[int]]:
    """Columns made orthonormal one after the other, each time the one that captures most; which ones."""
    unit = vectors / np.linalg.norm(vectors, axis=0)
    energy, overlap = unit.T @ covariance @ unit, unit.T @ unit
    chosen: list[int] = []
    while len(chosen) < min(count, unit.shape[1]):
        square = np.diagonal(overlap)
        free = square > 1e-6
        free[chosen] = False
        if not free.any():
            break
        best = int(descending(np.where(free, np.diagonal(energy) / np.where(free, square, 1.0), 0.0))[0])
        along = overlap[best] / square[best]
        cross = np.outer(along, energy[best])
        energy = energy - cross - cross.T + energy[best, best] * np.outer(along, along)
        overlap = overlap - square[best] * np.outer(along, along)
        chosen.append(best)
    return np.linalg.qr(unit[:, chosen])[0], chosen


def by_variance(covariance: Array, vectors: Array) -> Array:
    """Columns in the order of their variance, then made orthonormal one after the other."""
    unit = vectors / np.linalg.norm(vectors, axis=0)
    return np.linalg.qr(unit[:, descending(variances(covariance, unit))])[0]


def symmetric(covariance: Array, vectors: Array) -> Array:
    """The orthonormal vectors nearest to the columns (Löwdin), in the order of their variance."""
    left, _, right = np.linalg.svd(vectors / np.linalg.norm(vectors, axis=0), full_matrices=False)
    nearest = left @ right
    return nearest[:, descending(variances(covariance, nearest))]


def kernel_vectors(window: Window, kernels: Sequence[Kernel]) -> Array:
    """Real, then imaginary parts of kernels as vectors b = K/w^(1 − power), free of brightness."""
    matrix = FilterBank(tuple(kernels), RADIUS).matrix
    divisor = window.amplitude ** (1 / window.power - 1)
    return window.without_brightness(np.concatenate([matrix.real, matrix.imag]) / divisor).T


def bank_vectors(window: Window, families: Sequence[Any] = FAMILIES) -> Array:
    """Vectors of the default bank, or of some of its families."""
    return kernel_vectors(window, default_bank(WINDOW, families).kernels)


def gabor_vectors(window: Window) -> Array:
    """Vectors of as many Gabors as the bank has kernels, evenly over its wave numbers and all directions."""
    numbers = np.linspace(2 * np.pi / 21, 2 * np.pi / 7, 6)
    return kernel_vectors(
        window,
        [
            Gabor(float(number), np.pi * (k + 0.5 * (row % 2)) / 9, sigma=SIGMA)
            for row, number in enumerate(numbers)
            for k in range(9)
        ],
    )


def zigzag() -> NDArray[np.intp]:
    """Flat indices of the DCT along its antidiagonals, without the constant."""
    row, column = np.indices((SIDE, SIDE))
    diagonal = row + column
    return np.argsort(diagonal * SIDE + np.where(diagonal % 2, row, column), axis=None, kind="stable")[1:]


def windowed_cosines(covariance: Array, window: Window, count: int) -> Array:
    """Cosines times a, of which the 400 of largest variance are candidates of `greedy`."""
    a = window.amplitude
    square = np.square(dct(np.eye(SIDE), axis=0, norm="ortho")) @ np.square(a.reshape(SIDE, SIDE)[RADIUS])
    energy = np.diagonal(in_cosines(a[:, None] * covariance * a)) / np.outer(square, square).ravel()
    candidates = cosine_vectors(descending(energy)[:400])
    return greedy(covariance, window.see(candidates.T).T, count)[0]


def all_bases(covariance: Array, window: Window, samples: Array) -> dict[str, Array]:
    """Every basis that is compared, by name."""
    most, bank, cosines = COUNTS[-1], bank_vectors(window), in_cosines(covariance)
    return {
        "KL": karhunen_loeve(cosines, most)[1],
        f"KL learned from {len(samples)}": learned(samples, most),
        "bank": greedy(covariance, bank, most)[0],
        "bank, by variance": by_variance(covariance, bank),
        "bank, Löwdin": symmetric(covariance, bank),
        **{f"{name} alone": greedy(covariance, bank_vectors(window, [name]), most)[0] for name in FAMILIES},
        "54 Gabors": greedy(covariance, gabor_vectors(window), most)[0],
        "DCT, best": cosine_vectors(descending(np.diagonal(cosines))[:most]),
        "DCT, zig-zag": cosine_vectors(zigzag()[:most]),
        "windowed cosines": windowed_cosines(covariance, window, most),
        "random": np.linalg.qr(np.random.default_rng(0).normal(size=(SIZE, most)))[0],
    }


def residual_energy(vectors: Array, samples: Array) -> Array:
    """Share of the energy of (m, N) samples that the first 1, 2, … vectors leave."""
    return 1 - np.cumsum(np.square(samples @ vectors).sum(axis=0)) / np.square(samples).sum()


def coding_gain(vectors: Array, samples: Array, noise: float) -> Array:
    """Coding gain of the first 1, 2, … vectors, dB; `noise` is the variance ν² of each coefficient."""
    total = np.square(samples).sum(axis=1).mean()
    power = np.square(samples @ vectors).mean(axis=0)
    others = SIZE - np.arange(1, len(power) + 1)
    rest = (total - np.cumsum(power)) / others
    logs = np.cumsum(np.log10(power + noise)) + others * np.log10(rest + noise)
    return 10 * (np.log10(total / SIZE + noise) - logs / SIZE)


def cramer_rao_variances(slopes: Array) -> Array:
    """[F⁻¹]_kk of slopes (m, 6, n): variances of the six at unit white noise, (m, 6)."""
    return np.diagonal(np.linalg.inv(slopes @ np.swapaxes(slopes, 1, 2)), axis1=1, axis2=2)


def seen_variances(vectors: Array, slopes: Array, counts: Sequence[int]) -> list[Array]:
    """`cramer_rao_variances` of what the first n vectors see, for each n."""
    seen = (slopes.reshape(-1, SIZE) @ vectors).reshape(len(slopes), 6, -1)
    return [cramer_rao_variances(seen[..., :n]) for n in counts]


def information(vectors: Array, slopes: Array, counts: Sequence[int]) -> list[float]:
    """Share of the information that the first n vectors see, mean of patches and of the six, for each n."""
    whole = cramer_rao_variances(slopes)
    return [float((whole / part).mean()) for part in seen_variances(vectors, slopes, counts)]


def one_order_each(values: Array, vectors: Array, window: Window) -> Array:
    """Vectors of the same eigenvalue, to 0.5 %, combined so that the mean of r⁴ sets them apart.

    Any combination of them is a KL basis too; r⁴, which is isotropic, separates angular orders that share a value.
    """
    quartic = (window.x**2 + window.y**2) ** 2
    result, start = vectors.copy(), 0
    for end in range(1, len(values) + 1):
        if end == len(values) or values[end] < 0.995 * values[start]:
            level = vectors[:, start:end]
            result[:, start:end] = level @ np.linalg.eigh(level.T @ (quartic[:, None] * level))[1]
            start = end
    return result


def angular_orders(vectors: Array) -> tuple[NDArray[np.intp], Array]:
    """Angular order |v| that holds most of the energy of each column, and its share: 1 if it is e^(±ivθ) f(r)."""
    angle, r = 2 * np.pi * np.arange(128) / 128, np.arange(0.5, RADIUS + 0.1, 0.5)[:, None]
    place = [RADIUS + r * np.sin(angle), RADIUS + r * np.cos(angle)]
    energy = []
    for column in vectors.T:
        rings = np.abs(np.fft.rfft(map_coordinates(column.reshape(SIDE, SIDE), place, order=3))) ** 2
        rings[:, 1:-1] *= 2
        energy.append((r * rings).sum(axis=0))
    share = np.array(energy) / np.sum(energy, axis=1, keepdims=True)
    return share.argmax(axis=1), share.max(axis=1)
