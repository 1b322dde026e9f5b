"""What a camera does to the light: gain, uneven light, glare, shot noise, read noise, offset, rounding, dead pixels.

    grey = offset + light + N(0, noise²),  light = Poisson(electrons · gain · s(x) · I) / electrons,

s(x) = 1 + shading (X + Y)/2 with X, Y running from −1 to 1 across the frame; then rounded and clipped to
`bits`. Glare adds spots of light, `glare_grey` exp(−½ (2|x − c|/glare_diameter)⁴) each: bright, flat within
and steep at the edge. Glare and dead pixels stay where they are while the pattern moves.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.checks import is_whole, number, require, whole
from sixflow.errors import InputError
from sixflow.synth.arguments import Array

_BITS = (8, 10, 12, 14, 16)
_FIXED = 2**40  # numbers of random streams that belong to no frame


@dataclasses.dataclass(frozen=True, kw_only=True)
class Sensor:
    """A camera; by default an ideal one, which changes nothing.

    Parameters
    ----------
    gain : float
        Factor on the light, above 0.
    offset : float
        Grey value of darkness, added after the shot noise.
    shading : float
        Change of the light across the frame relative to its centre, −1 to 1: the light is 1 + shading at the
        lower right corner and 1 − shading at the upper left one. It stays in place while the pattern moves.
    noise : float
        Standard deviation of the Gaussian noise, grey, at least 0.
    electrons : float or None
        Electrons per grey level, above 0: shot noise of variance light/electrons. None: no shot noise.
    bits : {8, 10, 12, 14, 16} or None
        Depth: grey values are rounded and clipped to 0 … 2^bits − 1, as uint8 or uint16. None: float64, as
        they are. Grey values are not rescaled: raise `gain` to make use of more bits.
    dead : float
        Share of dead and hot pixels, 0 to 0.5: half of them show 0, half 255 (or the most that `bits` can hold),
        whatever the light.
    glare : float
        Mean number of spots of glare in 100 × 100 px, at least 0, at random places.
    glare_diameter : float
        Of a spot, px, above 0.
    glare_grey : float
        Light of a spot, grey.
    seed : int
        Chooses the noise, the dead pixels and the glare; frames of different number have independent noise and
        the same dead pixels and glare.

    Raises
    ------
    InputError
        If a value is outside its range.

    Examples
    --------
    >>> Sensor(gain=0.5, offset=10.0, bits=8).expose([[100.0, 1000.0]]).tolist()
    [[60, 255]]
    """

    gain: float = 1.0
    offset: float = 0.0
    shading: float = 0.0
    noise: float = 0.0
    electrons: float | None = None
    bits: int | None = None
    dead: float = 0.0
    glare: float = 0.0
    glare_diameter: float = 12.0
    glare_grey: float = 255.0
    seed: int = 0

    def __post_init__(self) -> None:
        object.__setattr__(self, "gain", number("gain", self.gain, above=0))
        object.__setattr__(self, "offset", number("offset", self.offset))
        object.__setattr__(self, "shading", number("shading", self.shading, least=-1, most=1))
        object.__setattr__(self, "noise", number("noise", self.noise, least=0, unit="grey levels"))
        if self.electrons is not None:
            electrons = number("electrons", self.electrons, above=0, unit="electrons per grey level")
            object.__setattr__(self, "electrons", electrons)
        whole_bits = self.bits is None or is_whole(self.bits)
        remedy = f"must be one of {', '.join(map(str, _BITS))}, or None for float64 frames"
        require(whole_bits and self.bits in (*_BITS, None), "bits", self.bits, remedy)
        object.__setattr__(self, "dead", number("dead", self.dead, least=0, most=0.5))
        object.__setattr__(self, "glare", number("glare", self.glare, least=0, unit="spots in 100 × 100 px"))
        object.__setattr__(self, "glare_diameter", number("glare_diameter", self.glare_diameter, above=0))
        object.__setattr__(self, "glare_grey", number("glare_grey", self.glare_grey))
        object.__setattr__(self, "seed", whole("seed", self.seed, 0))

    def expose(self, light: Any, number: int = 0) -> NDArray[Any]:
        """Return the frame that the camera records of the light.

        Parameters
        ----------
        light : array, shape (rows, columns)
            Grey values of an ideal frame; with `electrons` at least 0 (negative light counts as none).
        number : int
            Number of the frame, at least 0: it chooses the noise together with `seed`.

        Returns
        -------
        array, shape (rows, columns)
            uint8 for 8 bits, uint16 for more, float64 for `bits=None`.

        Raises
        ------
        InputError
            If the light is no two-dimensional array of finite numbers, the number is below 0, or a pixel
        would count 1e15 electrons or more.
        """
        grey = _light(light)
        rng = np.random.default_rng([self.seed, whole("number", number, 0)])
        grey = self.gain * grey
        if self.shading:
            rows, columns = grey.shape
            Y, X = np.meshgrid(np.linspace(-1, 1, rows), np.linspace(-1, 1, columns), indexing="ij")
            grey = grey * (1 + self.shading * (X + Y) / 2)
        if self.glare:
            grey = grey + self._glare(grey.shape)
        if self.electrons is not None:
            counted = self.electrons * np.maximum(grey, 0)
            most = float(counted.max(initial=0))
            require(
                most < 1e15, "electrons", self.electrons, f"{most:.3g} electrons in a pixel; must be < 1e15"
            )
            grey = rng.poisson(counted) / self.electrons
        grey = grey + self.offset
        if self.noise:
            grey = grey + rng.normal(0.0, self.noise, grey.shape)
        if self.dead:
            most_grey = 255 if self.bits is None else 2**self.bits - 1
            place = self._fixed(0).random(grey.shape)
            grey = np.where(place < self.dead, np.where(place < self.dead / 2, 0, most_grey), grey)
        if self.bits is None:
            return grey
        whole_grey = np.clip(np.rint(grey), 0, 2**self.bits - 1)
        return whole_grey.astype(np.uint8 if self.bits == 8 else np.uint16)

    def _fixed(self, layer: int) -> np.random.Generator:
        """Random numbers that are the same for every frame."""
        return np.random.default_rng([self.seed, _FIXED + layer])

    def _glare(self, shape: tuple[int, ...]) -> Array:
        """Light of all spots of glare."""
        rng = self._fixed(1)
        rows, columns = shape
        centres = rng.random((rng.poisson(self.glare * rows * columns / 1e4), 2)) * (rows, columns) - 0.5
        y, x = np.arange(rows)[:, None], np.arange(columns)
        total = np.zeros((rows, columns))
        for cy, cx in centres:
            near = 2 * np.hypot(y - cy, x - cx) / self.glare_diameter
            total += self.glare_grey * np.exp(-(near**4) / 2)
        return total


def _light(light: Any) -> Array:
    try:
        grey = np.asarray(light, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError("light: must be an array of grey values, shape (rows, columns)") from error
    if grey.ndim != 2 or not np.isfinite(grey).all():
        raise InputError(
            f"light: has shape {grey.shape}; give finite grey values of one frame, shape (rows, columns)"
        )
    return grey
