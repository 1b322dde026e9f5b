"""Interlacing: whether the even and the odd rows of a frame were taken at different times, seen in its content.

In a frame that was taken at once, the statistics of two neighbouring rows do not depend on which of them is the even
one. In an interlaced one they do wherever something moves: the field of the odd rows is shifted against that of the
even ones, forth from an even row to the odd one below, and back from there to the next. So the products of neighbouring
rows,

    r_y(s) = Σ_x I(x, y) I(x + s, y + 1),   s = −8, −6, … 8 px,

hold a line at the highest frequency of y, half a cycle per row. Its power over that of the frequencies below it, summed
over s and averaged over tiles, is T: 1 for frames taken at once, whatever their texture, noise, or offsets of rows;
7 to 130 for fields that moved by one to fifteen pixels. T is accepted as interlacing where

- T > 4, and it is more than 7 of its standard deviations above 1, under the scatter that the lower frequencies show:
  less than one frame in a million by chance;
- it is three times the power at periods of 8/3 and 4 rows: blocks of 8, as JPEG makes them, have these as well;
- the columns do not show the same: enlarged frames and regular patterns do.

Rows that were doubled to fill a frame show it too, and give the same note. So do drawn pictures of nothing
but jagged straight edges whose steps are two rows high.

| symbol | meaning |
|---|---|
| I | frame |
| r_y(s) | product of row y with the next, shifted by s |
| T | power of r at half a cycle per row over that at lower frequencies |
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.prepare.frame import NO_MASK

TILE = 64
"""Side of a tile, px: a multiple of 8, so that the harmonics of blocks fall on single frequencies."""

REACH = 8
"""Largest shift of a row against the next, px."""

LEAST, DEVIATIONS, OVER_HARMONICS, OVER_COLUMNS = 4.0, 7.0, 3.0, 4.0

_TILES = 16
_LOOKS = 4
_NYQUIST = TILE // 2
_HARMONICS = [TILE // 4, 3 * TILE // 8]
_BELOW = [k for k in range(TILE // 4 + 1, _NYQUIST - 1) if abs(k - _HARMONICS[1]) > 1]


def is_interlaced(image: NDArray[Any], valid: NDArray[np.uint8] = NO_MASK) -> bool:
    """Whether the content of a frame shows that its even and odd rows do not belong together.

    Parameters
    ----------
    image : array, shape (h, w)
        Finite grey values. Frames of less than 65 rows or 80 columns are not judged: False.
    valid : uint8 array of the same shape, or `NO_MASK`
        Which pixels count; the others are taken for the mean of their row.

    Examples
    --------
    >>> from sixflow import synth
    >>> frame, later = (synth.render(synth.Speckle(), (128, 160), synth.Affine.translation(x, 0)) for x in (0, 2))
    >>> is_interlaced(frame)
    False
    >>> frame[1::2] = later[1::2]
    >>> is_interlaced(frame)
    True
    """
    found = _line(image, valid)
    if found is None:
        return False
    power, deviations, harmonics = found
    if power < LEAST or deviations < DEVIATIONS or power < OVER_HARMONICS * harmonics:
        return False
    columns = _line(image.T, valid.T)
    return columns is None or power > OVER_COLUMNS * columns[0]


class InterlacingCheck:
    """Looks for interlacing in the first frames of a recording, and says so once."""

    def __init__(self) -> None:
        self._left = _LOOKS

    def notes(self, image: NDArray[Any], name: str, valid: NDArray[np.uint8] = NO_MASK) -> tuple[str, ...]:
        """Return a note where a frame is interlaced; nothing once it was given, or the first frames were not."""
        if self._left <= 0:
            return ()
        self._left -= 1
        if not is_interlaced(image, valid):
            return ()
        self._left = 0
        return (
            f"{name}: even and odd rows do not fit together: the frame is interlaced (its rows were taken at two "
            "times), or its rows were doubled; deinterlace the recording, or measure the even rows alone",
        )


def _line(image: NDArray[Any], valid: NDArray[np.uint8]) -> tuple[float, float, float] | None:
    """Power at half a cycle per row over that below it, its standard deviations above 1, and the power at harmonics."""
    powers = _powers(image, valid)
    level = powers[:, _BELOW].mean(axis=1)
    powers = powers[level > 0] / level[level > 0, None]
    count = len(powers)
    if not count:
        return None
    scatter = float(powers[:, _BELOW].var()) * len(_BELOW) / (len(_BELOW) - 1)
    power = float(powers[:, _NYQUIST].mean())
    # the highest frequency has one real amplitude, the others two: twice the variance
    deviation = np.sqrt(scatter * (2 + 1 / len(_BELOW)) / count)
    return power, (power - 1) / max(float(deviation), 1e-12), float(powers[:, _HARMONICS].mean(axis=0).max())


def _powers(image: NDArray[Any], valid: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Spectra along y of the products of neighbouring rows, summed over their shifts, shape (tiles, TILE/2 + 1)."""
    height, width = image.shape
    corners = [
        (y, x) for y in range(0, height - TILE, TILE) for x in range(REACH, width - TILE - REACH + 1, TILE)
    ]
    spread = np.linspace(0, len(corners) - 1, min(_TILES, len(corners))).astype(int)
    taper = np.hanning(TILE + 2)[1:-1, None]
    places = [corners[corner] for corner in spread]
    if not places:
        return np.zeros((0, _NYQUIST + 1))
    y, x = (np.array(part)[:, None, None] for part in zip(*places, strict=True))
    at = y + np.arange(TILE + 1)[:, None], x + np.arange(-REACH, TILE + REACH)
    parts = image[at].astype(np.float32)
    if valid.size:
        counted = valid[at].astype(np.float32)
        total = np.maximum(counted.sum(axis=2, keepdims=True), 1)
        parts = counted * (parts - (counted * parts).sum(axis=2, keepdims=True) / total)
    else:
        parts -= parts.mean(axis=2, keepdims=True)
    shifted = np.lib.stride_tricks.sliding_window_view(parts[:, 1:], TILE, axis=2)[:, :, ::2]
    products = np.einsum("tyx,tysx->tys", parts[:, :-1, REACH:-REACH], shifted)
    products -= products.mean(axis=1, keepdims=True)
    spectra: NDArray[np.float64] = (np.abs(np.fft.rfft(products * taper, axis=1)) ** 2).sum(axis=2)
    return spectra
