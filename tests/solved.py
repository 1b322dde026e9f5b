"""Solutions and plans made by hand, for what judges them."""

import dataclasses

import numpy as np

from sixflow.plan import Plan
from sixflow.refine.problem import State
from sixflow.refine.solution import Solution, WindowStatistics
from sixflow.settings import Settings


def plan_of(shape, **settings):
    """The plan of a pair of frames; light that is "auto" is steady."""
    return Plan.of(Settings(**({"lighting": "none"} | settings)), shape)


def statistics_of(shape, **changes):
    """Windows with texture and without a fault; `shape` is that of the grid."""
    ordinary = {
        "weight": 1.0,
        "noise": 1.0,
        "residual": 0.1,
        "left": 1.0,
        "noise_gradient": 1.0,
        "texture": 50.0,
        "rho": 0.0,
        "correlation": 0.995,
        "cells": 100.0,
    }
    return WindowStatistics(**{name: np.full(shape, value) for name, value in ordinary.items()} | changes)


def solution_of(maps, *, window=31.0, **changes):
    """A solution of small errors; names of `WindowStatistics` change these."""
    shape = maps.shape[1:]
    names = {field.name for field in dataclasses.fields(WindowStatistics)}
    statistics = {name: changes.pop(name) for name in list(changes) if name in names and name != "left"}
    parts = {
        "maps": maps,
        "covariance": np.broadcast_to(1e-4 * np.eye(6), (*shape, 6, 6)).copy(),
        "statistics": statistics_of(shape, **statistics),
        "left": np.zeros(shape),
        "window": np.full(shape, float(window)),
        "period": np.full(shape, 120.0),
        "flag": np.zeros(shape, np.uint16),
    }
    return Solution(**(parts | changes))


def passes(problem, maps, count, *, total=True):
    """The maps after so many passes."""
    state = State()
    for _ in range(count):
        made = problem.step(maps, state, total=total)
        maps, state = made.maps, made.state
    return maps
