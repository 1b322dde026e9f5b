"""One-parameter groups: the points exp(τX)·x along a steady motion (Eagleson, eq. (4)).

| generator | trajectory through (x, y) |
|---|---|
| L_x, L_y | (x + τ, y), (x, y + τ) |
| L_s | (x e^τ, y e^τ) |
| L_r | (x cos τ − y sin τ, x sin τ + y cos τ) |
| L_b | (x e^τ, y e^−τ) |
| L_B | (x cosh τ + y sinh τ, x sinh τ + y cosh τ) |
| L_E | (x, y)/(1 − τx) |
| L_F | (x, y)/(1 − τy) |

(As corrected here: the print of eq. (4) has cos and sin in the trajectory of L_B, which would be a rotation.) L_E and
L_F, of eq. (2), move points on rays from the origin, and keep every point of the y axis, of the x axis.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from sixflow.array_checks import Array, Invalid, as_floats, require_broadcast
from sixflow.errors import InputError
from sixflow.groups.algebra import as_points
from sixflow.groups.group import Group

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_GRID = np.linspace(-0.75, 0.75, 7)
_DISTANCE = 0.22  # median length of the blue paths, in half sides of the square


def trajectory(
    group: Group,
    coefficients: ArrayLike,
    points: ArrayLike,
    parameters: ArrayLike,
    *,
    invalid: Invalid = "raise",
) -> Array:
    """Points along a steady motion: x(τ) = exp(τX)·x (Eagleson, eq. (4)).

    Parameters
    ----------
    group : Group
        One of the five of `sixflow.groups`.
    coefficients : array, shape (..., n)
        Of X in the group's generators.
    points : array, shape (..., 2)
        Where the trajectories pass at τ = 0, px. Leading dimensions are broadcast with those of the coefficients.
    parameters : array, shape (T,)
        Values of τ, in the unit of time of the coefficients.
    invalid : {"raise", "nan"}
        What to do with points that are at infinity at one of the parameters. A projective trajectory may pass
        through infinity between two of them; it comes back from the other side.

    Returns
    -------
    float64 array, shape (..., T, 2)
        px.

    Raises
    ------
    InputError
        If an argument cannot be used, or `invalid` is "raise" and a point goes to infinity.

    Examples
    --------
    >>> import numpy as np
    >>> from sixflow.groups import SIMILARITY
    >>> spiral = trajectory(SIMILARITY, [0, 0, np.log(2), np.pi / 2], [1.0, 0.0], [0, 1, 2])
    >>> spiral.round(9) + 0.0
    array([[ 1.,  0.],
           [ 0.,  2.],
           [-4.,  0.]])
    """
    if not isinstance(group, Group):
        raise InputError(f"group={group!r}: must be a group, such as sixflow.groups.get('affine')")
    tau = group.vector("coefficients", coefficients)
    points = as_points(points)
    steps = as_floats("parameters", parameters, ()).astype(np.float64)
    if steps.ndim != 1:
        raise InputError(
            f"parameters of shape {steps.shape}: must have one dimension; put others into coefficients"
        )
    require_broadcast(coefficients=tau.shape[:-1], points=points.shape[:-1])
    maps = group.exp(tau[..., None, :] * steps[:, None])
    return group.act(maps, points[..., None, :], invalid=invalid)


def draw_trajectories(
    group: Group, coefficients: ArrayLike | None = None, *, path: str | os.PathLike[str] | None = None
) -> Figure:
    """Draw the trajectories of steady motions, one panel for each.

    Grey: whole trajectories within the square |x|, |y| ≤ 1. Blue: the way of the points of a grid (dots) over a short
    interval of τ, stated above the panel. y points down.

    Parameters
    ----------
    group : Group
        One of the five of `sixflow.groups`.
    coefficients : array, shape (n,) or (panels, n), optional
        Of the motions, in the unit of length that is half the side of the square; by default the generators of the
        group, one after the other.
    path : str or path, optional
        Save the picture here at 300 dpi; the suffix chooses the format: .png, .pdf, .svg.

    Returns
    -------
    Figure
        A matplotlib figure that belongs to no window.

    Raises
    ------
    InputError
        If an argument cannot be used.
    FieldFileError
        If the picture cannot be saved.
    """
    if not isinstance(group, Group):
        raise InputError(f"group={group!r}: must be a group, such as sixflow.groups.get('affine')")
    motions = np.eye(group.dimension) if coefficients is None else group.vector("coefficients", coefficients)
    motions = np.atleast_2d(motions)
    if (
        motions.ndim > 2
        or not len(motions)
        or not (np.isfinite(motions).all() and motions.any(axis=-1).all())
    ):
        raise InputError(
            f"coefficients of shape {motions.shape}: must be one or more rows of {group.dimension} finite numbers, not "
            "all zero"
        )
    # matplotlib is loaded only when a picture is asked for
    from sixflow.drawing.trajectories import Panel, draw_panels

    return draw_panels([Panel(*_panel(group, motion)) for motion in motions], path)


def _panel(group: Group, motion: Array) -> tuple[Array, Array, Array, str]:
    """Points, their whole trajectories, their displacement over a short time τ, and the title with that time."""
    points = np.stack(np.meshgrid(_GRID, _GRID), axis=-1).reshape(-1, 2)
    speed = np.hypot(*group.field(motion, points).T)
    moving = speed > 1e-9 * speed.max()
    points, median = points[moving], float(np.median(speed[moving]))
    time = float(f"{_DISTANCE / median:.1g}")
    orbits = trajectory(group, motion, points, np.linspace(-4, 4, 801) / median, invalid="nan")
    paths = trajectory(group, motion, points, np.linspace(0, time, 25), invalid="nan")
    return points, orbits, paths, f"{_formula(group, motion)}, τ = {time:g}"


def _formula(group: Group, motion: Array) -> str:
    """Write a motion as a sum of generators; a single one with its name."""
    terms = [(value, symbol[2:]) for value, symbol in zip(motion, group.symbols, strict=True) if value]
    if len(terms) == 1 and terms[0][0] == 1:
        name = group.names[int(motion.argmax())].replace("_", " ")
        return rf"$\mathcal{{L}}_{{{terms[0][1]}}}$ {name}"
    signed = [rf"{value:+.2g}\,\mathcal{{L}}_{{{index}}}" for value, index in terms]
    return f"${''.join(signed).removeprefix('+')}$"
