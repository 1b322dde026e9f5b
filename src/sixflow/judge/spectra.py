"""Spectra of matched tiles, in cells of frequency: do all frequencies move alike, and are both frames as sharp?

With F₀ and F₁ of a tile's two frames, brought together by the measured motion (`sixflow.prepare.tiles`), Z = F₀* F₁ has
the phase 0 at every frequency that moves as it was measured. The frequencies are put together in cells of an octave and
22.5°. What a cell says is a ratio of sums over tiles; its error follows from the scatter of the tiles, whatever makes
it.

Where frame 1 is blurred by the matrix B [px²] more than frame 0, gain g, and the noise of both is white,

    (|F₁|² − |F₀|²)/2 = Z sinh(ln g − ½ kᵀ B k) + ν + ½ kᵀ G ∇Z,

the last term by the deformation G alone, which changes spectra as well. B is fitted to the frequencies at which Z is
more than chance. It is told where it is more than chance, and where it adds more to the residual's power than the noise
does, which the other frequencies show: with D = Z sinh(½ kᵀ B k) it adds |F₀|² + |F₁|² − 2Z = 2 (√(Z² + D²) − Z).

| symbol | name in the code |
|---|---|
| Z | `cross` |
| B | `blur` |
| k | `KX`, `KY`, radians per pixel |
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sixflow.chance import FALSE_ALARMS, normal_limit
from sixflow.prepare.tiles import SIDE, Tiles

KX, KY = np.meshgrid(2 * np.pi * np.fft.rfftfreq(SIDE), 2 * np.pi * np.fft.fftfreq(SIDE))
TWICE = np.where((KX == 0) | (np.arange(SIDE // 2 + 1) == SIDE // 2), 1.0, 2.0)
"""How often a frequency of the half plane stands in the whole."""
OCTAVES, SECTORS = 4, 8
_TERMS = 5
_ITERATIONS, _STEEPEST = 4, 3.0
"""Of the fit of the blur, and the largest logarithm of a transfer that it follows."""
LEAST = 8
"""Tiles: fewer tell no scatter."""


def _cells() -> NDArray[np.int64]:
    """Number of every frequency's cell, −1 below the lowest octave; what is beyond the circle is an octave too."""
    radius = np.hypot(KX, KY) * SIDE / (2 * np.pi)
    octave = np.floor(np.log2(np.maximum(radius, 0.5) / 2) + 1e-9).astype(int)
    angle = np.arctan2(KY, KX) + np.pi / 2 + np.pi / (2 * SECTORS)
    sector = np.floor(angle / (np.pi / SECTORS)).astype(int) % SECTORS
    return np.where(octave < 0, -1, octave * SECTORS + sector)


CELL = _cells()
COUNT = OCTAVES * SECTORS
_ORDER = np.argsort(CELL.ravel(), kind="stable")[np.count_nonzero(CELL < 0) :]
_STARTS = np.searchsorted(CELL.ravel()[_ORDER], np.arange(COUNT))
_WEIGHT = TWICE.ravel()[_ORDER]


class Blur(NamedTuple):
    """Which frame is less sharp, by how much, px, and along which direction, degrees from x to y."""

    frame: int
    width: float
    angle: float


@dataclasses.dataclass(frozen=True)
class Spectra:
    """Spectra of matched tiles.

    Attributes
    ----------
    shift : float64 array, shape (tiles, 2)
    gradient : float64 array, shape (2, 2)
        Mean of the displacement gradients.
    cross : complex64 array, shape (tiles, SIDE, SIDE/2 + 1)
    power : float32 array, shape (2, tiles, SIDE, SIDE/2 + 1)
        |F|² of both frames.
    """

    shift: NDArray[np.float64]
    gradient: NDArray[np.float64]
    cross: NDArray[np.complex64]
    power: NDArray[np.float32]

    @classmethod
    def of(cls, tiles: Tiles) -> Spectra | None:
        """Transform tiles; None of too few."""
        if tiles.count < LEAST:
            return None
        from scipy.fft import rfft2

        across, down = tiles.tapers
        mean = tiles.light[0][..., None, None].astype(np.float32)
        first, second = rfft2((tiles.pixels - mean) * down[..., :, None] * across[..., None, :])
        along_x = np.exp(1j * tiles.rest[:, :1] * KX[0]).astype(np.complex64)
        along_y = np.exp(1j * tiles.rest[:, 1:] * KY[:, 0]).astype(np.complex64)
        cross = first.conj() * second * along_y[:, :, None] * along_x[:, None, :]
        power = np.abs(np.stack([first, second])) ** 2
        return cls(tiles.shift, tiles.maps[2:].mean(axis=1).reshape(2, 2), cross, power)

    def blur(self) -> Blur | None:
        """Which frame is less sharp, if that is more than chance and rules the residual."""
        from scipy.special import fdtrc

        tiles, real = len(self.cross), self.cross.real.sum(axis=0)
        spread = np.sqrt(np.maximum((self.cross.real**2).sum(axis=0) - real**2 / tiles, 0))
        coherent = (real > normal_limit(real.size) * spread) & (CELL >= 0)
        each = in_cells(coherent * ((self.power[1] - self.power[0]) / 2 - self._deformed()))
        alike, total = in_cells(coherent * self.cross.real), each.sum(axis=0)
        with np.errstate(divide="ignore", invalid="ignore"):
            scatter = each - alike * (total / alike.sum(axis=0))
        error = np.sqrt((scatter**2).sum(axis=0) * tiles / (tiles - 1))
        some, real = error > 0, TWICE * coherent * real
        if some.sum() <= _TERMS:
            return None
        found, inverse = np.zeros(_TERMS), np.eye(_TERMS)
        for _ in range(_ITERATIONS):
            like = found[1] - (found[2] * KX**2 + 2 * found[3] * KX * KY + found[4] * KY**2) / 2
            like = np.clip(like, -_STEEPEST, _STEEPEST)
            at, slope = real * np.sinh(like), real * np.cosh(like)
            terms = [
                tiles * TWICE * coherent,
                slope,
                slope * KX**2 / -2,
                -slope * KX * KY,
                slope * KY**2 / -2,
            ]
            *sums, known = (
                in_cells(term[None], weighed=True)[0][some] / error[some] for term in (*terms, at)
            )
            design = np.stack(sums, axis=-1)
            inverse = np.linalg.pinv(design.T @ design)
            found += inverse @ design.T @ (total[some] / error[some] - known - design[:, 0] * found[0])
        statistic = float(found[2:] @ np.linalg.pinv(inverse[2:, 2:]) @ found[2:])
        if not fdtrc(3, tiles - 3, statistic / 3) < FALSE_ALARMS:
            return None
        values, vectors = np.linalg.eigh([[found[2], found[3]], [found[3], found[4]]])
        largest = int(np.abs(values).argmax())
        blurred = (found[2] * KX**2 + 2 * found[3] * KX * KY + found[4] * KY**2) / 2
        unlike = real * np.sinh(np.clip(blurred, -_STEEPEST, _STEEPEST))
        made = float(2 * (np.hypot(real, unlike) - real).sum())
        left = TWICE * (self.power.sum(axis=0) - 2 * self.cross.real).sum(axis=0)
        rest = (CELL >= 0) & ~coherent
        noise = float(left[rest].sum() / TWICE[rest].sum() * TWICE.sum()) if rest.any() else left.sum() - made
        if made < noise:
            return None
        angle = math.degrees(math.atan2(vectors[1, largest], vectors[0, largest])) % 180
        return Blur(int(values[largest] > 0), math.sqrt(abs(values[largest])), angle)

    def _deformed(self) -> NDArray[np.float64]:
        """What the mean deformation changes in the power, of every tile alike."""
        mean = np.fft.fftshift(self.power.mean(axis=(0, 1)), axes=0)
        # of the logarithm: spectra of blobs fall by powers of e from one frequency to the next
        down, across = mean * np.gradient(np.log(np.maximum(mean, 1e-30)), 2 * np.pi / SIDE)
        slopes = np.fft.ifftshift(across, axes=0), np.fft.ifftshift(down, axes=0)
        out: NDArray[np.float64] = sum(
            k * self.gradient[j, i] * slopes[i] / 2 for j, k in enumerate((KX, KY)) for i in range(2)
        )
        return out


def in_cells(values: NDArray[Any], *, weighed: bool = False) -> NDArray[np.float64]:
    """Sums over the frequencies of each cell, those of the other half plane too; shape (tiles, COUNT).

    Parameters
    ----------
    values : array, shape (tiles, SIDE, SIDE/2 + 1)
    weighed : bool
        They are counted twice already where they stand twice.
    """
    flat = values.reshape(len(values), -1).astype(np.float64)[:, _ORDER]
    return np.asarray(np.add.reduceat(flat if weighed else flat * _WEIGHT, _STARTS, axis=1))
