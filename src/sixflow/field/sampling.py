"""The field between its grid points: at every pixel (`dense`), and anywhere (`sample`).

Every grid point p holds a local affine map d + G (x − p): values of u and v with their gradients.
`HermiteSurface` joins them to one smooth field that agrees with every map at its own point. Beyond the
outermost points the field goes on along straight lines.

Where the field tells several bodies apart (its variable `body`), none is joined to another: places between the
points of two bodies are NaN.

The covariance of the six, and what their windows leave out (`uncertainty`), are interpolated bilinearly. Neighbours
share most of their window, so they err together, and averaging them does not reduce the error; this states that, and
is a little pessimistic for a step as large as the window. Beyond the outermost points it is that of the extended affine
map, which grows with the distance.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from sixflow.convention import gradient, recentre, six_from_gradient
from sixflow.engine.hermite import HermiteSurface, Stencil, make_stencil
from sixflow.errors import InputError
from sixflow.field.dataset import OF_PAIRS, SIX
from sixflow.field.selection import frame_shape, one_pair
from sixflow.field.uncertainty import total_covariance

Array = NDArray[Any]


def dense(field: xr.Dataset) -> xr.Dataset:
    """Interpolate the six numbers at every pixel of the frames, dims (time, y, x) or (y, x)."""
    height, width = frame_shape(field)
    x, y = np.arange(width), np.arange(height)
    count = field.sizes.get("time", 1)
    try:
        result = np.empty((len(SIX), count, height, width), np.result_type(field["u"].dtype, np.float32))
    except (MemoryError, ValueError) as error:
        raise InputError(
            f"{count} pairs of frames of {width}×{height} px do not fit the memory at every pixel: "
            "take fewer, such as field.isel(time=[0]), or `sample`"
        ) from error
    for time in range(count):
        parts = []
        for surface in _surfaces(one_pair(field, time)):
            d, d_x, d_y = (
                surface.on_grid(x, y, along_x=along_x, along_y=along_y)
                for along_x, along_y in ((False, False), (True, False), (False, True))
            )
            parts.append(_six(d, d_x, d_y))
        result[:, time] = np.moveaxis(_known(parts), -1, 0)
    dims: tuple[str, ...] = ("time", "y", "x")
    if "time" not in field.dims:
        dims, result = dims[1:], result[:, 0]
    return xr.Dataset(
        {name: (dims, result[k], field[name].attrs) for k, name in enumerate(SIX)},
        {"y": ("y", y, field["y"].attrs), "x": ("x", x, field["x"].attrs)}
        | {name: field[name] for name in OF_PAIRS if name in field.coords},
        {key: value for key, value in field.attrs.items() if key != "title"}
        | {"title": "six-parameter optical flow field, interpolated at every pixel"},
    )


def sample(field: xr.Dataset, x: ArrayLike, y: ArrayLike, time: int = 0) -> xr.Dataset:
    """Interpolate the six numbers and their standard errors at places of one pair, dims (point) or ()."""
    x, y = _places(x, y)
    pair = one_pair(field, time)
    shape = x.shape
    x, y = x.ravel(), y.ravel()
    surfaces = _surfaces(pair)
    six = _known([_six(s.at(x, y), s.at(x, y, along_x=True), s.at(x, y, along_y=True)) for s in surfaces])
    dims = ("point",) if shape else ()
    variables: dict[str, Any] = {
        name: (dims, six[:, k].reshape(shape), pair[name].attrs) for k, name in enumerate(SIX)
    }
    if "covariance" in pair:
        variance = np.diagonal(_covariance(pair, surfaces[0], x, y), axis1=-2, axis2=-1)
        error = np.where(np.isfinite(six), np.sqrt(variance), np.nan)
        for k, name in enumerate(SIX):
            attributes = {
                "long_name": f"standard error of {name}",
                "units": pair[name].attrs.get("units", "1"),
            }
            variables[f"{name}_standard_error"] = (dims, error[:, k].reshape(shape), attributes)
    return xr.Dataset(
        variables,
        {"x": (dims, x.reshape(shape), pair["x"].attrs), "y": (dims, y.reshape(shape), pair["y"].attrs)}
        | {name: pair[name] for name in OF_PAIRS if name in pair.coords},
    )


def _surfaces(pair: xr.Dataset) -> list[HermiteSurface]:
    """One surface for each body; one in all where the field tells no bodies apart."""
    six = np.stack([pair[name].values for name in SIX], axis=-1)
    if "body" not in pair:
        return [_surface(pair, six)]
    body = pair["body"].values
    numbers = np.unique(body[body != 0])
    return [_surface(pair, np.where((body == k)[..., None], six, np.nan)) for k in numbers] or [
        _surface(pair, six)
    ]


def _known(parts: list[Array]) -> Array:
    """What one of several interpolants tells of a place, shape (..., 6); NaN where none does."""
    known = parts[0]
    for other in parts[1:]:
        known = np.where(np.isnan(known).any(axis=-1, keepdims=True), other, known)
    return known


def _surface(pair: xr.Dataset, six: Array) -> HermiteSurface:
    G = np.moveaxis(gradient(six), (-2, -1), (0, 1))
    return HermiteSurface(
        pair["x"].values.astype(float),
        pair["y"].values.astype(float),
        values=np.moveaxis(six[..., :2], -1, 0),
        slopes_x=G[:, 0],
        slopes_y=G[:, 1],
    )


def _six(d: Array, d_x: Array, d_y: Array) -> Array:
    """The six, shape (..., 6), of (u, v) and its derivatives, each of shape (2, ...)."""
    G = np.stack([np.moveaxis(d_x, 0, -1), np.moveaxis(d_y, 0, -1)], axis=-1)
    return six_from_gradient(np.moveaxis(d, 0, -1), G)


def _covariance(pair: xr.Dataset, surface: HermiteSurface, x: Array, y: Array) -> Array:
    """Covariance at places, shape (n, 6, 6)."""
    # A node of weight 0 may be NaN: it must not spoil the place, which is NaN by its values if it has to be.
    known = np.nan_to_num(total_covariance(pair).transpose("y", "x", "param", "param2").values)
    inside_x, inside_y = np.clip(x, surface.x[0], surface.x[-1]), np.clip(y, surface.y[0], surface.y[-1])
    column, row = make_stencil(surface.x, inside_x), make_stencil(surface.y, inside_y)
    right, below = _fraction(surface.x, inside_x, column), _fraction(surface.y, inside_y, row)
    covariance = (
        (1 - below) * (1 - right) * known[row.low, column.low]
        + (1 - below) * right * known[row.low, column.high]
        + below * (1 - right) * known[row.high, column.low]
        + below * right * known[row.high, column.high]
    )
    beyond = np.stack([x - inside_x, y - inside_y], axis=-1)
    shift = np.swapaxes(recentre(np.eye(len(SIX)), beyond[:, None, :]), -1, -2)
    return shift @ covariance @ np.swapaxes(shift, -1, -2)


def _fraction(nodes: Array, wanted: Array, stencil: Stencil) -> Array:
    length = np.where(stencil.high > stencil.low, nodes[stencil.high] - nodes[stencil.low], 1.0)
    return ((wanted - nodes[stencil.low]) / length)[:, None, None]


def _places(x: ArrayLike, y: ArrayLike) -> tuple[Array, Array]:
    try:
        places = np.broadcast_arrays(np.asarray(x, dtype=float), np.asarray(y, dtype=float))
    except (TypeError, ValueError) as error:
        raise InputError(f"x and y: {error}; give two numbers, or two arrays of one length, in px") from error
    if places[0].ndim > 1:
        raise InputError(f"x and y have the shape {places[0].shape}: give one dimension, such as x.ravel()")
    if not all(np.isfinite(place).all() for place in places):
        raise InputError("x and y hold NaN or infinity: give finite coordinates in px")
    return places[0], places[1]
