r"""Bicubic Hermite interpolation of values and gradients known at the points of a rectangular grid.

Along one axis, between the nodes a and a + h, with s = (x − a)/h in [0, 1],

    f(x) = (2s³−3s²+1) f₀ + (s³−2s²+s) h f₀' + (3s²−2s³) f₁ + (s³−s²) h f₁'.

Applied along y to (f, f_y) and to (f_x, f_xy), then along x to the two results, it matches value and gradient
at every node, is continuous with its gradient everywhere, and its error is O(h⁴). The mixed derivative is not
measured: it is the mean of the central differences of f_x along y and of f_y along x. Beyond the outermost
nodes the interpolant goes on along straight lines, so that an affine field is reproduced everywhere.

| symbol | name |
|---|---|
| f, f_x, f_y, f_xy | `values`, `slopes_x`, `slopes_y`, `twists` |
| weights of f₀, f₁, f₀', f₁' | `Stencil.weights` |
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]


class Stencil(NamedTuple):
    """The two nodes around each wanted coordinate of one axis, and their weights.

    Attributes
    ----------
    low, high : int arrays, shape (n,)
        Index of the node before and after.
    weights : array, shape (4, n)
        Weights of the value at `low`, at `high`, and of the slope at `low`, at `high`.
    needs_low, needs_high : bool arrays, shape (n,)
        False where the wanted coordinate lies exactly on the other node, or beyond the outermost node.
    """

    low: Array
    high: Array
    weights: Array
    needs_low: Array
    needs_high: Array


def make_stencil(nodes: Array, wanted: Array, *, derivative: bool = False) -> Stencil:
    """Find the nodes around `wanted` and the weights of the interpolant, or of its derivative.

    Parameters
    ----------
    nodes : array, shape (m,)
        Increasing coordinates of the grid along one axis, px.
    wanted : array, shape (n,)
        Coordinates to interpolate at, px; they may lie outside the nodes.
    derivative : bool
        Weights of the derivative along this axis, instead of the value.
    """
    nodes, wanted = np.asarray(nodes, float), np.asarray(wanted, float)
    inside = np.clip(wanted, nodes[0], nodes[-1])
    low = np.clip(np.searchsorted(nodes, inside, side="right") - 1, 0, max(len(nodes) - 2, 0))
    high = np.minimum(low + 1, len(nodes) - 1)
    length = np.where(high > low, nodes[high] - nodes[low], 1.0)
    s = (inside - nodes[low]) / length
    beyond = wanted - inside
    # Value and slope of the cubic at the nearest place inside; outside, the straight line through them.
    value = np.stack(
        [2 * s**3 - 3 * s**2 + 1, 3 * s**2 - 2 * s**3, (s**3 - 2 * s**2 + s) * length, (s**3 - s**2) * length]
    )
    slope = np.stack(
        [
            (6 * s**2 - 6 * s) / length,
            (6 * s - 6 * s**2) / length,
            3 * s**2 - 4 * s + 1,
            3 * s**2 - 2 * s,
        ]
    )
    weights = slope if derivative else value + beyond * slope
    return Stencil(low, high, weights, s < 1, s > 0)


def slopes_along(values: Array, nodes: Array, axis: int) -> Array:
    """Differentiate along an axis: to second order, to first beside a NaN, 0 between two NaN.

    Parameters
    ----------
    values : array
        Samples; NaN where unknown.
    nodes : array, shape (values.shape[axis],)
        Increasing coordinates of the samples.
    axis : int
        Axis of `values` that `nodes` belong to.
    """
    values = np.moveaxis(values, axis, -1)
    if len(nodes) < 2:
        return np.zeros_like(np.moveaxis(values, -1, axis))
    secants = np.diff(values, axis=-1) / np.diff(nodes).astype(values.dtype)
    unknown = np.full_like(values[..., :1], np.nan)
    slopes = np.gradient(values, nodes, axis=-1, edge_order=2 if len(nodes) > 2 else 1)
    for fallback in (
        np.concatenate([secants, unknown], axis=-1),
        np.concatenate([unknown, secants], axis=-1),
        np.zeros_like(values),
    ):
        slopes = np.where(np.isfinite(slopes), slopes, fallback)
    return np.moveaxis(slopes, -1, axis)


class HermiteSurface:
    """Interpolant of functions known with their gradients on a grid.

    Parameters
    ----------
    x, y : arrays, shape (nx,), (ny,)
        Increasing coordinates of the grid, px.
    values, slopes_x, slopes_y : arrays, shape (..., ny, nx)
        The functions and their derivatives; NaN where unknown. A node at which any of the functions is
        unknown is unknown for all, and so is every place whose interpolant would need it.

    Examples
    --------
    >>> x, y = np.array([0.0, 4.0, 8.0]), np.array([0.0, 4.0])
    >>> X, Y = np.meshgrid(x, y)
    >>> surface = HermiteSurface(x, y, values=X**2, slopes_x=2 * X, slopes_y=0 * X)
    >>> surface.at(np.array([3.0]), np.array([1.5]))
    array([9.])
    """

    def __init__(self, x: Array, y: Array, *, values: Array, slopes_x: Array, slopes_y: Array) -> None:
        known = np.isfinite(values) & np.isfinite(slopes_x) & np.isfinite(slopes_y)
        self.x, self.y = x, y
        self.known: Array = np.asarray(known.reshape(-1, *known.shape[-2:]).all(axis=0))
        slopes_x, slopes_y = np.where(self.known, slopes_x, np.nan), np.where(self.known, slopes_y, np.nan)
        twists = (slopes_along(slopes_x, y, -2) + slopes_along(slopes_y, x, -1)) / 2
        # NaN × 0 would spoil places that do not need the node: zeros here, NaN put back at the end.
        self.values, self.slopes_x, self.slopes_y, self.twists = (
            np.where(self.known, part, 0) for part in (values, slopes_x, slopes_y, twists)
        )

    def on_grid(self, x: Array, y: Array, *, along_x: bool = False, along_y: bool = False) -> Array:
        """Interpolate at every crossing of columns and rows.

        Parameters
        ----------
        x, y : arrays, shape (columns,), (rows,)
            Coordinates, px.
        along_x, along_y : bool
            Give the derivative along this axis instead of the value.

        Returns
        -------
        array, shape (..., rows, columns)
            NaN where a node that it needs is unknown.
        """
        column = make_stencil(self.x, x, derivative=along_x)
        row = make_stencil(self.y, y, derivative=along_y)
        # First along y: every wanted row at the nodes' columns. Then along x.
        lines, slopes = self._lines(np.s_[..., row.low, :], np.s_[..., row.high, :], row.weights[:, :, None])
        low, high = np.s_[..., column.low], np.s_[..., column.high]
        result = _blend(column.weights, lines[low], lines[high], slopes[low], slopes[high])
        known = self.known[row.low] | ~row.needs_low[:, None]
        known &= self.known[row.high] | ~row.needs_high[:, None]
        known = (known[:, column.low] | ~column.needs_low) & (known[:, column.high] | ~column.needs_high)
        result[..., ~known] = np.nan
        return result

    def at(self, x: Array, y: Array, *, along_x: bool = False, along_y: bool = False) -> Array:
        """Interpolate at scattered places.

        Parameters
        ----------
        x, y : arrays, shape (n,)
            Coordinates of the places, px.
        along_x, along_y : bool
            Give the derivative along this axis instead of the value.

        Returns
        -------
        array, shape (..., n)
            NaN where a node that it needs is unknown.
        """
        column = make_stencil(self.x, x, derivative=along_x)
        row = make_stencil(self.y, y, derivative=along_y)
        (left, left_slope), (right, right_slope) = (
            self._lines(np.s_[..., row.low, i], np.s_[..., row.high, i], row.weights)
            for i in (column.low, column.high)
        )
        result = _blend(column.weights, left, right, left_slope, right_slope)
        known = np.ones(result.shape[-1], bool)
        for i, needs_row in ((row.low, row.needs_low), (row.high, row.needs_high)):
            for j, needs_column in ((column.low, column.needs_low), (column.high, column.needs_high)):
                known &= self.known[i, j] | ~(needs_row & needs_column)
        result[..., ~known] = np.nan
        return result

    def _lines(self, low: Any, high: Any, weights: Array) -> tuple[Array, Array]:
        """Interpolate values and x-slopes along y, between the nodes that the indices low and high pick."""
        return (
            _blend(weights, self.values[low], self.values[high], self.slopes_y[low], self.slopes_y[high]),
            _blend(weights, self.slopes_x[low], self.slopes_x[high], self.twists[low], self.twists[high]),
        )


def _blend(weights: Array, low: Array, high: Array, low_slope: Array, high_slope: Array) -> Array:
    w = weights.astype(low.dtype)
    return w[0] * low + w[1] * high + w[2] * low_slope + w[3] * high_slope
