"""Lighting: whether the light changed between two frames, anywhere, and what is done about it.

Tiles of both frames (`tiles`) tell how contrast and brightness changed from place to place: ln s₁/s₀ and m₁ − m₀, with
mean m and standard deviation s of a tile. A lamp that flickers, a drift, a tilt and vignetting are smooth over the
frame. So both are fitted with polynomials of second degree in x and y, and the change is believed where these explain
more than the tiles' own scatter does by chance (an F test at the rate of `sixflow.chance`), whatever makes the scatter:
noise, particles that are lost, things that enter the frame.

A change ε of the contrast that is not allowed for adds ε (I − m) to the residual. It is alike to the gradient times x,
and biases the gradient of the displacement, in standard errors for noise n of a pixel, by

    √(π/2) ε s ℓ/n,    ℓ² = s²/⟨I_x²⟩,

whatever the window is. A brightness that is off by o biases the displacement by √π o ℓ²/(σ n) of them. A change that
makes half a standard error, which is a tenth of the rms standardised error, is allowed for.

Before the motion is known, the frames are compared at the same places; then the search allows for the light, and what
matched tiles show decides.

| symbol | meaning |
|---|---|
| m, s | mean and contrast of a tile |
| ε, o | change of contrast, as a share of it, and of brightness |
| ℓ | length of the texture |
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.chance import FALSE_ALARMS
from sixflow.prepare.tiles import Tiles
from sixflow.settings import Settings

HALF = 0.5
"""Standard errors of bias from which a change of the light is allowed for."""


@dataclasses.dataclass(frozen=True)
class Change:
    """Change of light from one frame to another, at tiles.

    Attributes
    ----------
    gain, offset : array, shape (tiles,)
        Of the smooth fits: contrast × gain, brightness + offset, grey.
    seen : bool
        Whether it is more than chance.
    """

    gain: NDArray[np.float64]
    offset: NDArray[np.float64]
    seen: bool

    @classmethod
    def between(cls, tiles: Tiles, scale: float = 1.0) -> Change:
        """Compare the tiles of two frames.

        Parameters
        ----------
        tiles : Tiles
        scale : float
            Of the images.
        """
        if not tiles.count:
            return cls(np.ones(0), np.zeros(0), False)
        mean, contrast = tiles.light
        textured = (contrast > 0).all(axis=0)
        x, y = tiles.x[textured].astype(float), tiles.y[textured].astype(float)
        gains, is_gain = _smooth(np.log(contrast[1][textured] / contrast[0][textured]), x, y)
        offsets, is_offset = _smooth((mean[1] - mean[0])[textured], x, y)
        gain, offset = np.ones(tiles.count), np.zeros(tiles.count)
        gain[textured], offset[textured] = np.exp(gains), offsets
        return cls(gain, offset / scale, is_gain or is_offset)

    def matters(self, tiles: Tiles, noise: float, sigma: float, scale: float = 1.0) -> bool:
        """Whether it would bias any tile's numbers by as much as `HALF` a standard error.

        Parameters
        ----------
        tiles : Tiles
            That it was seen in.
        noise : float
            Standard deviation of the noise of a pixel, that the residual without a change of light shows.
        sigma : float
            Of the window, px.
        scale : float
            Of the images.
        """
        power, steepness = tiles.light[1][0] ** 2, tiles.steepness
        shown = (
            np.mean((self.gain - 1) ** 2 * power + (self.offset * scale) ** 2) / 2
        )  # what the change itself made
        noise = math.sqrt(max(0.0, noise**2 - float(shown)))
        with np.errstate(divide="ignore", invalid="ignore"):
            by_gain = math.sqrt(math.pi / 2) * np.abs(self.gain - 1) * power / np.sqrt(steepness)
            by_offset = math.sqrt(math.pi) * np.abs(self.offset * scale) * power / steepness / sigma
        most = np.nanmax(np.maximum(by_gain, by_offset), initial=0.0)
        return self.seen and bool(most > HALF * noise)

    def notes(self, asked: Settings, used: str, numbers: tuple[int, int]) -> tuple[str, ...]:
        """Say what was done about the change, or what could be.

        Parameters
        ----------
        asked : Settings
            As asked for.
        used : str
            `lighting` that was used.
        numbers : (int, int)
            Of the two frames.
        """
        done = {"auto": "gain+offset", "none": "none"}
        if asked.method == "eigenfilter" or done.get(asked.lighting) != used:
            return ()
        said = "each window is allowed its own gain and offset"
        if used == "none":
            said = 'consider lighting="gain+offset"'
        contrast, brightness = (
            _range(values, f) for values, f in ((self.gain, "{:.2f}"), (self.offset, "{:+.3g}"))
        )
        return (
            f"frames {numbers[0]} and {numbers[1]}: the light changed (contrast × {contrast}, "
            f"brightness {brightness} grey); {said}",
        )


def _range(values: NDArray[Any], form: str) -> str:
    """The mean of values that would be written alike, or their range."""
    low, high = (form.format(value) for value in (values.min(), values.max()))
    return low if low == high else f"{low} to {high}"


def _smooth(
    values: NDArray[np.float64], x: NDArray[np.float64], y: NDArray[np.float64]
) -> tuple[NDArray[np.float64], bool]:
    """Values of a smooth fit, of second degree or constant where there are few, and whether chance does not make it."""
    from scipy.special import fdtrc

    u, v = (2 * (at - at.mean()) / max(1.0, float(np.ptp(at))) if at.size else at for at in (x, y))
    terms = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=-1)
    if values.size < 4 * terms.shape[1]:
        terms = terms[:, :1]
    count, free = terms.shape[1], values.size - terms.shape[1]
    if free < 1:
        return np.zeros_like(values), False
    fit = terms @ np.linalg.lstsq(terms, values, rcond=None)[0]
    left, explained = float(((values - fit) ** 2).sum()), float((fit**2).sum())
    if not left > 0:
        return fit, explained > 0
    varies = float(((fit - values.mean()) ** 2).sum())
    chances = [
        float(fdtrc(n, free, made / n / (left / free)))
        for n, made in ((count, explained), (count - 1, varies))
        if n
    ]
    if count > 1 and not chances[1] < FALSE_ALARMS / 2:
        fit = np.full_like(values, values.mean())
    return fit, chances[0] < FALSE_ALARMS / 2
