"""What the benchmarks share: pairs with exact truth, errors at grid points, the Cramér–Rao value, tables.

Inner modules of sixflow are imported where they are used: `agreement.py` measures with other versions of the package.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Console
from rich.table import Table

from sixflow import synth
from sixflow.convention import SIX

if TYPE_CHECKING:
    from sixflow.maps.grid import Grid

console = Console(width=150)


def make_pair(pattern: Any, six: Sequence[float], side: int, noise: float, seed: int) -> Any:
    """Render a pair of side² frames moved by the six numbers about the centre, with grey noise, not quantised."""
    centre = ((side - 1) / 2, (side - 1) / 2)
    motion = synth.Affine.from_six(tuple(six), centre=centre)
    return synth.pair(pattern, motion, (side, side), sensor=synth.Sensor(noise=noise, seed=seed))


def errors_at_points(field: Any, made: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Error of the six and predicted standard error (rows, columns, 6), and flag."""
    x, y = np.meshgrid(field.x.values.astype(float), field.y.values.astype(float))
    measured = np.stack([field[name].values[0] for name in SIX], axis=-1).astype(float)
    predicted = np.sqrt(np.diagonal(field.covariance.values[0], axis1=-2, axis2=-1)).astype(float)
    return measured - made.truth(x, y), predicted, field.flag.values[0]


def cramer_rao(pattern: Any, side: int, grid: Grid, window: float, noise: float) -> np.ndarray:
    """Standard errors of the six of the window's least-squares fit with the *true* gradient; (rows, columns, 6).

    H⁻¹ (Σ w² 2σ² J Jᵀ) H⁻¹ with the pattern's analytic gradient and the true noise σ in both frames.
    """
    from sixflow.engine.window import moment_weights

    x, y = np.meshgrid(np.arange(side, dtype=float), np.arange(side, dtype=float))
    gradient_x, gradient_y = pattern.gradient(x, y)
    products = gradient_x * gradient_x, gradient_x * gradient_y, gradient_y * gradient_y
    sigma = window / np.sqrt(4 * np.pi)
    normal, meat = (
        np.concatenate(
            [_window_moments(product, grid, moment_weights(sigma, power=power)) for product in products], -1
        )
        for power in (1, 2)
    )
    meat *= 2 * noise**2
    bread = np.linalg.inv(_matrix(normal))
    covariance = bread @ _matrix(meat) @ bread
    g = 1 / sigma  # unknowns are u, σu_x, σu_y, v, σv_x, σv_y
    to_six = np.array(
        [
            [1, 0, 0, 0, 0, 0],
            [0, 0, 0, 1, 0, 0],
            [0, g, 0, 0, 0, g],
            [0, 0, -g, 0, g, 0],
            [0, g, 0, 0, 0, -g],
            [0, 0, g, 0, g, 0],
        ]
    )
    return np.sqrt(np.diagonal(to_six @ covariance @ to_six.T, axis1=-2, axis2=-1))


def _window_moments(plane: np.ndarray, grid: Grid, weights: np.ndarray) -> np.ndarray:
    """Σ w (1, X, Y, X², XY, Y²) plane at the grid points; a window sums what lies within the plane."""
    down, across = (_weight_tables(points, plane.shape[0], weights) for points in (grid.y, grid.x))
    powers = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))  # of X and Y
    return np.stack([down[of_y] @ plane @ across[of_x].T for of_x, of_y in powers], axis=-1)


def _weight_tables(points: np.ndarray, size: int, weights: np.ndarray) -> np.ndarray:
    """The weights w, wX, wX² of every grid point at every pixel of an axis, shape (3, points, size)."""
    reach = weights.shape[1] // 2
    at = np.arange(size) - np.asarray(points)[:, None] + reach
    return np.where((at >= 0) & (at <= 2 * reach), weights[:, np.clip(at, 0, 2 * reach)], 0.0)


def _matrix(moments: np.ndarray) -> np.ndarray:
    order = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])
    a, b, c = (moments[..., 6 * k + order] for k in range(3))
    return np.concatenate([np.concatenate([a, b], axis=-1), np.concatenate([b, c], axis=-1)], axis=-2)


def rms(values: np.ndarray, axis: Any = None) -> Any:
    return np.sqrt(np.mean(np.square(values), axis=axis))


def show(title: str, header: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Print one table."""
    table = Table(title=title, title_justify="left", title_style="bold")
    for k, name in enumerate(header):
        table.add_column(name, justify="left" if k == 0 else "right")
    for row in rows:
        table.add_row(*(cell if isinstance(cell, str) else f"{cell:.4g}" for cell in row))
    console.print(table)
    console.print()


def verdict(good: bool) -> str:
    return "met" if good else "NOT MET"
