"""Pairs of frames that have nothing in common: whatever is given there is given by chance."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from honesty.scenes import CAMERA, Maker, Scene
from sixflow import synth

SIDE, MEMBERS = 1024, 7
"""Of a frame, and frames of a kind: together 10⁵ points at a step of 8 px."""


def unrelated() -> Iterator[tuple[str, Maker]]:
    """Names of the pairs, and what makes them."""
    for kind in ("noise", "blurred noise", "speckle", "particles"):
        for seed in range(1, MEMBERS + 1):
            yield f"unrelated/{kind}/{seed}", lambda kind=kind, seed=seed: _pair(kind, seed)


def _pair(kind: str, seed: int) -> Scene:
    frames = [_frame(kind, 2 * seed + k) for k in (0, 1)]
    return Scene(f"unrelated/{kind}", (frames[0], frames[1]), lambda x, y: np.full((*x.shape, 6), np.nan))


def _frame(kind: str, seed: int) -> NDArray[Any]:
    camera = synth.Sensor(**CAMERA, seed=seed)
    if kind in ("speckle", "particles"):
        pattern = synth.Speckle(seed=seed) if kind == "speckle" else synth.Particles(seed=seed)
        return camera.expose(synth.render(pattern, (SIDE, SIDE)))
    light = np.random.default_rng([11, seed]).normal(size=(SIDE, SIDE))
    if kind == "blurred noise":
        light = ndimage.gaussian_filter(light, 2.0)
    return camera.expose(128 + 35 * light / light.std())
