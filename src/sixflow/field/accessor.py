"""The accessor `field.sixflow`: everything that follows from the six numbers and their covariance.

It works on the dataset that a measurement returns, on one read back from a file, and on any selection of it
that keeps the dims y and x. Nothing is stored: every quantity is computed when it is asked for.
"""

from __future__ import annotations

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from sixflow.errors import InputError
from sixflow.field import average, calibration, sampling, selection, summary
from sixflow.field.dataset import SIX
from sixflow.field.derived import DERIVED, MEASURES, derive, derived_error, six
from sixflow.field.physical import to_physical


@xr.register_dataset_accessor("sixflow")
class SixflowAccessor:
    """Derived quantities, standard errors, interpolation and units of a field.

    Tensors have the dims (..., i, j) labelled "x", "y": `field.sixflow.hencky.sel(i="x", j="y")`. What does not exist,
    or is of a point without numbers, is NaN.

    Raises
    ------
    InputError
        If the dataset is no field of six numbers.

    Examples
    --------
    >>> import sixflow.field.accessor
    >>> field = xr.Dataset(
    ...     {name: (("y", "x"), np.full((2, 3), value)) for name, value in
    ...      dict(u=1.0, v=0.0, divergence=0.02, curl=0.0, stretch=0.0, shear=0.0).items()},
    ...     {"y": [8, 16], "x": [8, 16, 24]}, {"frame_shape": [24, 32]},
    ... )
    >>> field.sixflow.area_ratio.values[0, 0].round(6)
    np.float64(1.0201)
    >>> field.sixflow.dense().sizes
    Frozen({'y': 24, 'x': 32})
    """

    def __init__(self, field: xr.Dataset) -> None:
        self._field = selection.require_field(field)

    # The numbers

    @property
    def six(self) -> xr.DataArray:
        """The six numbers in one array, dims (..., param); px and 1."""
        return six(self._field)

    @property
    def displacement_gradient(self) -> xr.DataArray:
        """G = [[u_x, u_y], [v_x, v_y]], dims (..., i, j): component i, derivative along j."""
        return derive(self._field, "displacement_gradient")

    @property
    def lie_algebra_element(self) -> xr.DataArray:
        """The six numbers of the steady flow that makes the motion of a pair in the time it took, dims (..., param).

        The logarithm of the affine map about the grid point; NaN where it folds, or turns by half a turn.
        """
        return derive(self._field, "lie_algebra_element")

    def derive(self, name: str) -> xr.DataArray:
        """Any derived quantity by its name, such as "hencky_max_shear", "small_rotation" or "shear_rate".

        Raises InputError if there is no such quantity; the message lists them all.
        """
        return derive(self._field, name)

    # Measures of deformation

    @property
    def green_lagrange(self) -> xr.DataArray:
        """Green–Lagrange tensor ½ (FᵀF − I), dims (..., i, j)."""
        return derive(self._field, "green_lagrange")

    @property
    def almansi(self) -> xr.DataArray:
        """Euler–Almansi tensor ½ (I − F⁻ᵀF⁻¹), dims (..., i, j); NaN where det F ≤ 0."""
        return derive(self._field, "almansi")

    @property
    def hencky(self) -> xr.DataArray:
        """Hencky (logarithmic) tensor log U, dims (..., i, j); NaN where det F ≤ 0."""
        return derive(self._field, "hencky")

    @property
    def biot(self) -> xr.DataArray:
        """Biot (nominal) tensor U − I, dims (..., i, j); NaN where det F ≤ 0."""
        return derive(self._field, "biot")

    @property
    def small_strain(self) -> xr.DataArray:
        """Infinitesimal tensor ½ (G + Gᵀ), dims (..., i, j): wrong by about ½θ² after a rotation by θ."""
        return derive(self._field, "small_strain")

    @property
    def rotation_angle(self) -> xr.DataArray:
        """Angle of the rotation R of F = RU, rad, from x towards y (clockwise on the screen)."""
        return derive(self._field, "rotation_angle")

    @property
    def area_ratio(self) -> xr.DataArray:
        """Area in the moved frame over area in the reference frame, det F."""
        return derive(self._field, "area_ratio")

    def principal_values(self, measure: str) -> xr.DataArray:
        """Principal values of a measure, dims (..., principal): "major" (the larger) and "minor".

        The measures are "green_lagrange", "almansi", "hencky", "biot", "small_strain" and "strain_rate"; InputError
        if there is no such measure.
        """
        return derive(self._field, f"{_measure(measure)}_principal_values")

    def principal_axes(self, measure: str) -> xr.DataArray:
        """Unit vectors along the axes of `principal_values`, dims (..., i, principal)."""
        angle = self.principal_angle(measure)
        cos, sin = np.cos(angle.values), np.sin(angle.values)
        axes = np.stack([np.stack([cos, -sin], axis=-1), np.stack([sin, cos], axis=-1)], axis=-2)
        return xr.DataArray(
            axes,
            {**angle.coords, "i": ["x", "y"], "principal": ["major", "minor"]},
            (*angle.dims, "i", "principal"),
            f"{measure}_principal_axes",
            {"long_name": f"principal axes of {measure}", "units": "1"},
        )

    def principal_angle(self, measure: str) -> xr.DataArray:
        """Angle from x towards y of the major axis of `principal_values`, rad, within (−π/2, π/2]."""
        return derive(self._field, f"{_measure(measure)}_principal_angle")

    def max_shear(self, measure: str) -> xr.DataArray:
        """Maximum engineering shear of a measure: the difference of its `principal_values`."""
        return derive(self._field, f"{_measure(measure)}_max_shear")

    # Rates

    @property
    def vorticity(self) -> xr.DataArray:
        """Curl of log(I + G) over the interval of the pair, 1/s (1/frame while the times are unknown)."""
        return derive(self._field, "vorticity")

    @property
    def divergence_rate(self) -> xr.DataArray:
        """Divergence of log(I + G) over the interval of the pair, 1/s (1/frame while the times are unknown)."""
        return derive(self._field, "divergence_rate")

    @property
    def strain_rate(self) -> xr.DataArray:
        """Symmetric part of log(I + G) over the interval of the pair, dims (..., i, j), 1/s (or 1/frame)."""
        return derive(self._field, "strain_rate")

    # Errors

    def standard_error(self, name: str, *, noise_only: bool = False) -> xr.DataArray:
        """Standard error of one of the six or of a derived quantity, to first order: of noise and bias together.

        Parameters
        ----------
        name : str
            One of the six, the name of a property of this accessor, or a measure with "_principal_values",
            "_principal_angle" or "_max_shear" appended, such as "hencky_max_shear".
        noise_only : bool
            From `covariance` alone, without `bias`: what repeating the measurement shows.

        Returns
        -------
        DataArray
            Dims and unit of the quantity. NaN where it has no derivative, as the angle of an isotropic tensor.

        Raises
        ------
        InputError
            If there is no such quantity, or the field has no covariance (a dense field has none).
        """
        return derived_error(self._field, name, noise_only=noise_only)

    @property
    def standard_errors(self) -> xr.Dataset:
        """Standard errors, of noise and bias, of the six and of every derived quantity, under their names."""
        return xr.Dataset({name: derived_error(self._field, name) for name in (*SIX, *DERIVED)})

    # Points

    @property
    def valid(self) -> xr.DataArray:
        """True where all six numbers were measured."""
        return selection.valid(self._field)

    def flagged(self, name: str) -> xr.DataArray:
        """Where a flag is set, such as "masked" or "outlier"; InputError if there is no such flag."""
        return selection.flagged(self._field, name)

    @property
    def guess(self) -> xr.Dataset:
        """The first guess that the field was measured with, as a field: for `search` of another measurement.

        A guess in numbers stands in the settings instead. InputError if the field holds none.
        """
        return selection.first_guess(self._field)

    # Between the grid points

    def dense(self) -> xr.Dataset:
        """Interpolate the six numbers at every pixel of the frames.

        Bicubic Hermite interpolation of the local affine maps: values and gradients at grid points are kept,
        affine fields are reproduced exactly, smooth ones to O(step⁴). Beyond the outermost grid points the
        field goes on along straight lines. NaN where a grid point that is needed is NaN.

        Returns
        -------
        Dataset
            The six over y = 0 … height−1 and x = 0 … width−1, without covariance. InputError if frame_shape is missing.
        """
        return sampling.dense(self._field)

    def sample(self, x: ArrayLike, y: ArrayLike, time: int = 0) -> xr.Dataset:
        """Interpolate the six numbers and their standard errors at any places of one pair, as `dense` does.

        Parameters
        ----------
        x, y : float or array, shape (n,)
            Places, px; broadcast together.
        time : int
            Position of the pair along time.

        Returns
        -------
        Dataset
            u, v, divergence, curl, stretch, shear and u_standard_error …, over the dim point (none for one place).

        Raises
        ------
        InputError
            If the places are not finite numbers of at most one dimension, or there is no such pair.
        """
        return sampling.sample(self._field, x, y, time)

    # Units

    def calibrate(
        self,
        *,
        pixel_size: float | None = None,
        length_unit: str | None = None,
        frame_interval: float | None = None,
    ) -> xr.Dataset:
        """Return the field with a calibration in its settings; what is not given stays as it is.

        Parameters
        ----------
        pixel_size : float, optional
            Length of one pixel in the object, in `length_unit`, greater than 0.
        length_unit : str, optional
            Such as "mm" (the default of the settings).
        frame_interval : float, optional
            Time between successive frames of the recording, s, greater than 0: a pair of frames k apart gets k times
            that as its `interval`. With pairs="double", the time between the two frames of a pair.

        Raises
        ------
        InputError
            If a value cannot be used, or `frame_interval` contradicts the times that the frames have.
        """
        return calibration.calibrate(
            self._field, pixel_size=pixel_size, length_unit=length_unit, frame_interval=frame_interval
        )

    def physical(
        self,
        pixel_size: float | None = None,
        length_unit: str | None = None,
        frame_interval: float | None = None,
        y_up: bool = False,
    ) -> xr.Dataset:
        """Return velocities and rates with standard errors in physical units.

        Parameters
        ----------
        pixel_size, length_unit, frame_interval : optional
            As in `calibrate`; the calibration of the field where not given.
        y_up : bool
            Let y grow upwards: the y coordinates, v, curl and shear change sign; the order of the rows does
            not.

        Returns
        -------
        Dataset
            velocity_x, velocity_y in length/s; divergence_rate, vorticity, stretch_rate, shear_rate in 1/s;
            each with …_standard_error; flag; x and y in units of length.

        Raises
        ------
        InputError
            If the calibration is neither given nor known, or cannot be used (`calibrate`).
        """
        field = calibration.calibrate(
            self._field, pixel_size=pixel_size, length_unit=length_unit, frame_interval=frame_interval
        )
        return to_physical(field, calibration.Calibration.of(field), y_up=y_up)

    # Over time

    def mean(self, dim: str = "time") -> xr.Dataset:
        """Average the six numbers over the pairs of a recording, with the covariance of the mean.

        At every point the mean is of the pairs that are valid there; `pairs` tells how many. Flags are those of these
        pairs together, or of all where none is valid. Errors of a frame that several pairs share as their reference, or
        as their moved frame, do not average out. That noise cancels between consecutive pairs is left out, so that the
        standard errors of their mean are rather too large (`sixflow.field.average`).

        `field.mean("time")` of xarray averages flags and covariances as if they were values; what it returns is
        refused here and by `write_field`.

        Parameters
        ----------
        dim : {"time"}
            What to average over.

        Returns
        -------
        Dataset
            Dims (y, x): the six, covariance, residual, noise (root of the mean square), resolution, flag, pairs; `time`
            is the mean of the times. `interval`, `frame0` and `frame1` stand where all pairs have the same.

        Raises
        ------
        InputError
            If the field has no pairs along `dim`.
        """
        return average.mean_over_time(self._field, dim)

    # In words

    def summary(self) -> str:
        """Points, share of every flag, medians of the six and their standard errors, settings, as text."""
        return summary.summarise(self._field)


def _measure(name: str) -> str:
    if name not in MEASURES:
        raise InputError(f"measure={name!r}: there is no such measure; there are {', '.join(MEASURES)}")
    return name
