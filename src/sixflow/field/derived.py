"""Quantities that follow from the six numbers, each under its own name, with the covariance carried through.

Each is a chain of functions of `sixflow.convention`, applied to the six of every point:

| names | chain | unit |
|---|---|---|
| displacement_gradient | gradient | 1 |
| lie_algebra_element | log_six | px, px, 1 … |
| green_lagrange, almansi, hencky, biot, small_strain | gradient → measure | 1 |
| …_principal_values, …_principal_angle, …_max_shear of each | → principal | 1, rad |
| rotation_angle, small_rotation, area_ratio | gradient → measure | rad, 1 |
| divergence_rate, vorticity, stretch_rate, shear_rate | one number of log_six, / interval of the pair | 1/s |
| strain_rate | log_six → gradient → small_strain, / interval of the pair | 1/s |

The finite ones (all but displacement_gradient, small_strain and small_rotation, which are of the gradient as it
stands) are functions of the deformation of frame 1 relative to frame 0. Where the points of the field lie in the
middle or in frame 1, the six are expressed at frame 0 first (`convention.change_reference`).

A rate is divided by the time between the two frames of its own pair (`interval`); it is per frame ("1/frame") as long
as that is unknown. A quantity that does not exist at a
point, such as the logarithm of a map that folds, is NaN there.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from sixflow import convention
from sixflow.errors import InputError
from sixflow.field.dataset import SIX
from sixflow.field.interval import elapsed
from sixflow.field.selection import reference_of, whole_flags
from sixflow.field.uncertainty import total_covariance

Array = NDArray[Any]

MEASURES = ("green_lagrange", "almansi", "hencky", "biot", "small_strain", "strain_rate")
"""Symmetric tensors, which have principal values and axes."""

AXES = {"i": ("x", "y"), "j": ("x", "y"), "principal": ("major", "minor"), "param": SIX}
"""Labels along the dims of derived quantities: T.sel(i="x", j="y") is T_xy; major is the larger value."""

_PARTIAL = (
    convention.log_six, convention.almansi, convention.hencky, convention.biot, convention.rotation_angle
)  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Derived:
    """How a quantity follows from the six.

    Attributes
    ----------
    steps : tuple of functions of `sixflow.convention`
        Applied to the six one after the other.
    dims : tuple of str
        Dims that it has besides those of the grid, keys of `AXES`.
    unit, long_name : str
        For its attributes.
    component : int or None
        Keep this number of the six only.
    rate : bool
        Divide by the interval of the pair.
    signed : bool
        False if it is never negative.
    finite : bool
        False if it is of the gradient in the frame that the field refers to, as it stands.
    """

    steps: tuple[Callable[..., Any], ...]
    dims: tuple[str, ...]
    unit: str
    long_name: str
    component: int | None = None
    rate: bool = False
    signed: bool = True
    finite: bool = True


def _table() -> dict[str, Derived]:
    gradient, log = convention.gradient, convention.log_six
    tensor = ("i", "j")
    table = {
        "displacement_gradient": Derived((gradient,), tensor, "1", "displacement gradient G", finite=False),
        "lie_algebra_element": Derived((log,), ("param",), "px or 1", "the six of log(I + G)"),
        "green_lagrange": Derived(
            (gradient, convention.green_lagrange), tensor, "1", "Green-Lagrange tensor"
        ),
        "almansi": Derived((gradient, convention.almansi), tensor, "1", "Euler-Almansi tensor"),
        "hencky": Derived((gradient, convention.hencky), tensor, "1", "Hencky (logarithmic) tensor"),
        "biot": Derived((gradient, convention.biot), tensor, "1", "Biot (nominal) tensor"),
        "small_strain": Derived(
            (gradient, convention.small_strain), tensor, "1", "infinitesimal tensor", finite=False
        ),
        "strain_rate": Derived(
            (log, gradient, convention.small_strain), tensor, "1", "rate of deformation tensor", rate=True
        ),
        "rotation_angle": Derived(
            (gradient, convention.rotation_angle), (), "rad", "angle of the rotation of F = RU"
        ),
        "small_rotation": Derived(
            (gradient, convention.small_rotation),
            (),
            "rad",
            "infinitesimal rotation, half the curl",
            finite=False,
        ),
        "area_ratio": Derived(
            (gradient, convention.area_ratio),
            (),
            "1",
            "area in the moved frame / in the reference",
            signed=False,
        ),
    }
    for k, name in enumerate(("divergence_rate", "vorticity", "stretch_rate", "shear_rate"), start=2):
        long_name = f"{name.replace('_', ' ')}, {SIX[k]} of log(I + G) per time"
        table[name] = Derived((log,), (), "1", long_name, component=k, rate=True)
    for measure in MEASURES:
        of = table[measure]
        for function, dims, unit, text in (
            (convention.principal_values, ("principal",), of.unit, "principal values"),
            (convention.principal_angle, (), "rad", "angle from x towards y of the major axis"),
            (convention.max_shear, (), of.unit, "maximum engineering shear"),
        ):
            angle = function is convention.principal_angle
            table[f"{measure}_{function.__name__}"] = Derived(
                (*of.steps, function), dims, unit, f"{text} of the {of.long_name}",
                rate=of.rate and not angle, signed=function is not convention.max_shear, finite=of.finite,
            )  # fmt: skip
    return table


DERIVED = _table()
"""Every derived quantity by its name."""


def six(field: xr.Dataset) -> xr.DataArray:
    """Return the six numbers in one array, dims (..., param)."""
    stacked = field[list(SIX)].to_dataarray("param", name="six").transpose(..., "param")
    return stacked.assign_attrs(long_name="the six numbers of the motion", units="px, px, 1, 1, 1, 1")


def derive(field: xr.Dataset, name: str) -> xr.DataArray:
    """Compute a derived quantity, dims (..., *its own dims); NaN where it does not exist.

    Raises InputError if there is no such quantity, or the field has lost the interval that a rate is divided by.

    Parameters
    ----------
    field : Dataset
        With the six numbers.
    name : str
        A key of `DERIVED`.
    """
    recipe = _recipe(name)
    numbers = six(field)
    values = numbers.values
    if recipe.finite:
        values = convention.change_reference(values, reference_of(field))
    for step in recipe.steps:
        values = step(values, **_options(step))
    values = np.asarray(values if recipe.component is None else values[..., recipe.component])
    values, unit = _per_time(field, recipe, values, numbers.dims[:-1])
    return _wrap(numbers, values, recipe, name, recipe.long_name, unit)


def derived_error(field: xr.Dataset, name: str, *, noise_only: bool = False) -> xr.DataArray:
    """Compute the standard error of one of the six or of a derived quantity, to first order in the errors.

    Parameters
    ----------
    field, name
        As in `derive`; `name` may also be one of the six.
    noise_only : bool
        Leave out what the window does not resolve.

    Raises
    ------
    InputError
        As `derive`, and if the field has no covariance.
    """
    covariance = total_covariance(field, noise_only=noise_only)
    if "flag" in field:
        whole_flags(field)  # where they are averages, so is the covariance, and is none of the mean
    if name in SIX:
        k = SIX.index(name)
        variance = covariance.isel(param=k, param2=k, drop=True)
        units = field[name].attrs.get("units", "1")
        return (
            (variance.where(variance >= 0) ** 0.5)
            .rename(f"{name}_standard_error")
            .assign_attrs(long_name=f"standard error of {name}", units=units)
        )
    recipe = _recipe(name)
    numbers = six(field)
    leading = numbers.dims[:-1]
    value, spread = numbers.values, covariance.transpose(*leading, "param", "param2").values
    if recipe.finite:
        value, spread = on_first_frame(value, spread, reference_of(field))
    for step in recipe.steps:
        value, spread = convention.propagate(step, value, spread, **_options(step))
    if recipe.component is not None:
        value, spread = value[..., recipe.component], spread[..., recipe.component, recipe.component]
    size = int(np.prod(value.shape[len(leading) :]))
    matrices = np.reshape(spread, (*value.shape[: len(leading)], size, size))
    variances = np.diagonal(matrices, axis1=-2, axis2=-1).reshape(value.shape)
    errors = np.sqrt(np.where(np.isfinite(value) & (variances >= 0), variances, np.nan))
    errors, unit = _per_time(field, recipe, errors, leading)
    return _wrap(
        numbers, errors, recipe, f"{name}_standard_error", f"standard error of {recipe.long_name}", unit
    )


def on_first_frame(value: Array, covariance: Array, reference: str) -> tuple[Array, Array]:
    """The six (..., 6) and their covariance (..., 6, 6), expressed at frame 0."""
    if reference == "first":
        return value, covariance
    return convention.propagate(convention.change_reference, value, covariance, source=reference)


def _recipe(name: str) -> Derived:
    if name not in DERIVED:
        raise InputError(
            f"{name!r}: there is no such quantity; there are {', '.join(SIX)}, {', '.join(DERIVED)}"
        )
    return DERIVED[name]


def _options(step: Callable[..., Any]) -> dict[str, Any]:
    return {"invalid": "nan"} if step in _PARTIAL else {}


def _per_time(field: xr.Dataset, recipe: Derived, values: Array, dims: tuple[Any, ...]) -> tuple[Array, str]:
    """Divide what is a rate by the interval of its pair; values over `dims` and further ones, and their unit."""
    if not recipe.rate:
        return values, recipe.unit
    known = elapsed(field)
    interval = known.over(dims)
    return values / interval.reshape(*interval.shape, *[1] * (values.ndim - interval.ndim)), f"1/{known.unit}"


def _wrap(
    numbers: xr.DataArray, values: Array, recipe: Derived, name: str, long_name: str, unit: str
) -> xr.DataArray:
    coordinates = {key: c for key, c in numbers.coords.items() if key != "param"}
    coordinates |= {dim: xr.DataArray(list(AXES[dim]), dims=dim) for dim in recipe.dims}
    dims = (*numbers.dims[:-1], *recipe.dims)
    return xr.DataArray(values, coordinates, dims, name, {"long_name": long_name, "units": unit})
