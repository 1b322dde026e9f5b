"""Responses of a bank over a frame: at points, at every pixel, and over the levels of a pyramid.

The response of kernel w_j at the pixel p is the correlation

    g_j(p) = Σ_o I(p + o) w_j(o)                                                        o over the patch

of the frame I, continued by reflection beyond its borders.

| function | way | gives |
|---|---|---|
| `respond` | matrix product of patches and kernels | (points, K) at any pixels |
| `respond_dense` | Fourier transform: spectrum of I times Σ_o w_j(o) exp(+ik·o) | (K, rows, columns) |
| `response_pyramid` | the same on the frame smoothed and halved, again and again | one array per level |

Both ways give the same numbers to rounding. The product costs n² operations per point, the transform the same for all
pixels together, whatever the patch: with patches of 35 and 71 px they took equally long for points 5 and 7 px apart.

A pyramid is coarse and wide where it is halved: the bank on level l is, for the frame, a bank of 2^l times the
wavelengths and the window. Levels have grids of different sizes, which is why it is a tuple of
`ResponseLevel` and not one array.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import fft

from sixflow.checks import whole
from sixflow.eigenfilters.bank import FilterBank
from sixflow.eigenfilters.kernel import Complex
from sixflow.eigenfilters.patches import finite_frame, patch_blocks, reflected, require_patch
from sixflow.engine.threads import worker_count
from sixflow.errors import InputError
from sixflow.maps.grid import Grid
from sixflow.prepare.frame import NO_MASK, Frame


def respond(bank: FilterBank, frame: ArrayLike, x: ArrayLike, y: ArrayLike) -> Complex:
    """Complex responses of a bank at pixels of a frame.

    Parameters
    ----------
    bank : FilterBank
        Of K kernels.
    frame : array of real numbers, shape (height, width)
        Grey values, all finite; at least as large as the bank's patch.
    x, y : arrays of whole numbers, shape (points,)
        Columns and rows, px, inside the frame.

    Returns
    -------
    complex128 array, shape (points, K)
        g, in units of the grey values.

    Raises
    ------
    InputError
        If the frame is none, is not finite or smaller than the patch, or a point is no pixel of it.

    Examples
    --------
    >>> from sixflow import synth
    >>> from sixflow.eigenfilters.kernels import Gabor
    >>> bank = FilterBank((Gabor(2 * np.pi / 12, 0.0), Gabor(2 * np.pi / 12, np.pi / 2)), radius=18)
    >>> frame = synth.render(synth.Grating(wavelength=12.0), (64, 64))     # a wave along x
    >>> abs(respond(bank, frame, [32], [32])).round(1)
    array([[524.6,   0. ]])
    """
    image = finite_frame(frame)
    blocks = patch_blocks((image,), x, y, bank.radius)
    out = np.empty((np.size(x), len(bank)), np.complex128)
    for chosen, (patches,) in blocks:
        out[chosen] = bank.responses(patches)
    return out


def respond_dense(bank: FilterBank, frame: ArrayLike, *, step: int = 1) -> Complex:
    """Complex responses of a bank at every pixel of a frame, or on a grid of pixels.

    Parameters
    ----------
    bank : FilterBank
        Of K kernels.
    frame : array of real numbers, shape (height, width)
        Grey values, all finite; at least as large as the bank's patch.
    step : int
        Distance of the points, px, at least 1. They are those of `sixflow.maps.grid.Grid.over(frame.shape, step)`,
        centred in the frame; 1 is every pixel.

    Returns
    -------
    complex128 array, shape (K, rows, columns)
        g, in units of the grey values: 16 K bytes per point.

    Raises
    ------
    InputError
        If the frame is none, is not finite or smaller than the patch, or the step is no whole number.

    Examples
    --------
    >>> from sixflow import synth
    >>> from sixflow.eigenfilters.kernels import Gabor
    >>> bank = FilterBank((Gabor(0.5), Gabor(0.5, 1.57)), radius=18)
    >>> frame = synth.render(synth.Speckle(), (64, 96))
    >>> dense = respond_dense(bank, frame)
    >>> dense.shape, respond_dense(bank, frame, step=8).shape
    ((2, 64, 96), (2, 8, 12))
    >>> bool(np.allclose(dense[:, 7, 20], respond(bank, frame, [20], [7])[0]))
    True
    """
    image = finite_frame(frame)
    grid = Grid.over(image.shape, whole("step", step, 1))
    padded = reflected(image, bank.radius)
    shape = [fft.next_fast_len(size) for size in padded.shape]
    spectrum = fft.fft2(padded, shape, workers=worker_count())
    rows, columns = np.ix_(grid.y, grid.x)
    out = np.empty((len(bank), *grid.shape), np.complex128)
    for j, kernel in enumerate(bank.matrix.reshape(-1, bank.size, bank.size)):
        transfer = fft.ifft2(kernel, shape, norm="forward", workers=worker_count())  # Σ w(o) exp(+ik·o)
        transfer *= spectrum
        out[j] = fft.ifft2(transfer, overwrite_x=True, workers=worker_count())[rows, columns]
    return out


@dataclasses.dataclass(frozen=True, eq=False)
class ResponseLevel:
    """Responses of a bank on one level of a pyramid.

    Attributes
    ----------
    level : int
        How often the frame was halved; 0 is the frame itself.
    x, y : int arrays, shape (columns,) and (rows,)
        Where the responses stand, px of the frame at full resolution.
    values : complex128 array, shape (K, rows, columns)
        g, in units of the grey values.
    """

    level: int
    x: NDArray[np.int64]
    y: NDArray[np.int64]
    values: Complex


def response_pyramid(
    bank: FilterBank, frame: ArrayLike, levels: int = 2, step: int = 4
) -> tuple[ResponseLevel, ...]:
    """Responses of a bank on a frame and on its halved copies.

    The frame is halved as for the search for large motion (`sixflow.prepare.frame.Frame.level`): smoothed by a
    Gaussian of 1.5 px, then every second row and column kept, the first included. Pixel (j, i) of a level lies on pixel
    (2j, 2i) of the level before, without an offset of half a pixel: x = 2^level times the column of the level.

    Parameters
    ----------
    bank : FilterBank
        Of K kernels, the same on every level.
    frame : array of real numbers, shape (height, width)
        Grey values, all finite.
    levels : int
        How often to halve, at least 0; the coarsest level must still be as large as the bank's patch.
    step : int
        Distance of the points in pixels of their level, at least 1: they stand 2^level · step px apart in the frame.

    Returns
    -------
    tuple of ResponseLevel
        Level 0 (the frame itself) first; levels + 1 of them.

    Raises
    ------
    InputError
        If the frame is none or not finite, a number is out of range, or a level is smaller than the patch.

    Examples
    --------
    A wave of 24 px is one of 6 px after two halvings, where the bank is tuned to it:

    >>> from sixflow import synth
    >>> from sixflow.eigenfilters.kernels import Gabor
    >>> bank = FilterBank((Gabor(2 * np.pi / 6, sigma=4.0),), radius=12)
    >>> frame = synth.render(synth.Grating(wavelength=24.0), (128, 128))
    >>> pyramid = response_pyramid(bank, frame, levels=2, step=8)
    >>> [(part.level, part.values.shape, int(part.x[1] - part.x[0])) for part in pyramid]
    [(0, (1, 16, 16), 8), (1, (1, 8, 8), 16), (2, (1, 4, 4), 32)]
    >>> strengths = [float(abs(part.values).mean()) for part in pyramid]
    >>> strengths[2] > 20 * strengths[0]
    True
    """
    image = finite_frame(frame)
    levels, step = whole("levels", levels, 0), whole("step", step, 1)
    coarsest = tuple(-(-size // 2**levels) for size in image.shape)
    if min(coarsest) < bank.size <= min(image.shape):
        raise InputError(
            f"levels={levels}: the coarsest level is {coarsest[0]} × {coarsest[1]} px, smaller than the patch of "
            f"{bank.size} × {bank.size} px; halve less often"
        )
    require_patch(image.shape, bank.radius)
    whole_frame = Frame(image, NO_MASK)
    found = []
    for level in range(levels + 1):
        small = whole_frame.level(level).image
        grid = Grid.over(small.shape, step)
        values = respond_dense(bank, small, step=step)
        found.append(ResponseLevel(level, 2**level * grid.x, 2**level * grid.y, values))
    return tuple(found)
