"""Sweep: one pass over the pixels of a pair with the motion as it is known (`sixflow.engine.sweep`)."""

from __future__ import annotations

import copy
import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.blend import twist_of
from sixflow.engine.interpolate import Interpolant
from sixflow.engine.lowpass import smoothed
from sixflow.engine.moments import Cells, cells_of
from sixflow.engine.spline import noise_variance
from sixflow.engine.sweep import (
    NORMAL,
    NORMAL_RANKS,
    OF_REFERENCE,
    ON_GRADIENTS,
    POWER_RANKS,
    SANDWICH,
    SANDWICH_RANKS,
    STATISTICS,
    Form,
    Images,
    Motion,
    Pair,
    image_strip,
    moment_strip,
)
from sixflow.engine.threads import over_strips
from sixflow.engine.weigh import NEGLIGIBLE
from sixflow.errors import InputError
from sixflow.maps.grid import Grid
from sixflow.prepare.frame import NO_MASK, Frame
from sixflow.refine.moments import STRIP, Lattice, Moments, node_spacing, summed


class Sweep:
    """The two frames of a pair, swept with one motion after another. Asking twice gives the same answer.

    Parameters
    ----------
    reference, moved : Frame
        Of one shape and type.
    grid : Grid
        Where motions are given.
    sigma : float
        Of the smallest window that will be made of the moments, px.
    degree : {3, 5}
        Of the spline that interpolates.
    lowpass : float
        That both frames have gone through, px.
    central : bool
        Seen from the middle: both frames are brought there by half.
    of_both : bool
        Sum the statistics of both frames, not of the reference alone: 8, not 5.

    Attributes
    ----------
    masked : bool
        Whether there are pixels that do not count, but for those that leave the frame.
    """

    def __init__(
        self, reference: Frame, moved: Frame, grid: Grid, sigma: float, *, degree: int, lowpass: float = 0.0,
        central: bool = False, of_both: bool = True,
    ) -> None:  # fmt: skip
        self.grid, self.lowpass, self.central, self.degree = grid, lowpass, central, degree
        self.shape, self.dtype = reference.image.shape, reference.image.dtype
        self.lattice = Lattice.over(self.shape, grid, node_spacing(sigma))
        noise, nowhere = noise_variance(degree, lowpass), np.empty((0, 0), self.dtype)
        asked = reference.interpolable() if central else NO_MASK
        still = Interpolant(reference.coefficients(degree) if central else nowhere, asked, noise)
        self._pair = Pair(
            reference.image,
            NO_MASK if central else reference.counted(),
            still,
            Interpolant(moved.coefficients(degree), moved.interpolable(), noise),
        )
        self.masked = bool(self._pair.valid.size or asked.size or self._pair.moved.valid.size)
        self._spare: list[NDArray[Any]] = []
        self._statistics = 0, 0, len(STATISTICS) if of_both else OF_REFERENCE
        b = self.lattice.spacing
        self._recipes = (
            cells_of(b, NORMAL, NORMAL_RANKS, self.dtype),
            cells_of(b, STATISTICS[: self._statistics[2]], self._statistics, self.dtype),
            cells_of(b, SANDWICH, SANDWICH_RANKS, self.dtype),
        )
        self._power = cells_of(b, ON_GRADIENTS, POWER_RANKS, self.dtype)

    def moments(
        self, maps: NDArray[np.float64], *, total: bool = True, light: NDArray[Any] | None = None,
        sandwich: bool = False, power: bool = False, rows: tuple[int, int] | None = None,
    ) -> Moments:  # fmt: skip
        """Moments of all products at the nodes.

        Parameters
        ----------
        maps : float64 array, shape (6, rows, columns)
            u, v, u_x, u_y, v_x, v_y at the grid points, without NaN.
        total : bool
            Right-hand side of the total form, less the maps' mean plane (`mean_plane`), or of the increment form.
        light : array, shape (2, rows, columns), optional
            Gain and offset at the grid points, moved ≈ gain · reference + offset.
        sandwich : bool
            Sum r²g gᵀ as well. After a low-pass this takes images, as its gradients are filtered once more.
        power : bool
            In place of the sandwich, r²g_x² and r²g_y² alone, without X and Y.
        rows : (int, int), optional
            First and last (exclusive) row of the frame that counts; all if not given. The moments of the parts of a
            frame add up to those of the whole.
        """
        if sandwich and self.lowpass:
            if rows is not None:
                raise InputError(
                    f"rows={rows}: the sandwich after a low-pass is summed over whole frames; leave rows out"
                )
            return self.moments_of(self.images(maps, total=total, light=light), sandwich=True)
        motion, form, recipes = self._motion(maps, light), self._form(total), self._recipes_of(power)
        counted, everywhere = (0, self.shape[0]) if rows is None else rows, np.empty((0, 0), self.dtype)

        def task(strip: tuple[int, int], sums: list[NDArray[Any]], edges: list[NDArray[Any]]) -> None:
            part = self.lattice.part(strip, counted)
            top, bottom = part.rows
            if top < bottom:
                try:
                    buffer = self._spare.pop()  # one for each thread, which the next strip finds in the cache
                except IndexError:
                    height = max(STRIP, self.lattice.spacing)
                    buffer = np.empty((6 if self.central else 5, height, self.shape[1]), self.dtype)
                images = self._swept(motion, form, top, bottom, buffer)
                moment_strip(images, everywhere, recipes, part, _three(sums), _three(edges))
                self._spare.append(buffer)

        return self._summed(task, sandwich, power)

    def _swept(self, motion: Motion, form: Form, top: int, bottom: int, buffer: NDArray[Any]) -> Images:
        """Images of some rows, in the first rows of a buffer of shape (6, ≥ rows, width)."""
        lines = buffer[:, : bottom - top]
        still = lines[5] if self.central else self._pair.image[top:bottom]
        images = Images(lines[0], lines[1], lines[2], lines[3], still, lines[4])
        image_strip(self._pair, motion, form, top, bottom, images)
        return images

    def images(
        self, maps: NDArray[np.float64], *, total: bool = True, light: NDArray[Any] | None = None
    ) -> Images:
        """Gradients, right-hand side and residual of every pixel, for pixel weights; parameters as for `moments`.

        Returns
        -------
        Images
            Fresh arrays; `still` is the reference's own image, unless it was brought to the middle.
        """
        motion, form = self._motion(maps, light), self._form(total)
        arrays = [np.empty(self.shape, self.dtype) for _ in range(5)]
        still = np.empty(self.shape, self.dtype) if self.central else self._pair.image
        images = Images(arrays[0], arrays[1], arrays[2], arrays[3], still, arrays[4])
        over_strips(
            lambda top, bottom: image_strip(
                self._pair, motion, form, top, bottom, rows_of(images, top, bottom)
            ),
            self.shape[0],
            STRIP,
        )
        return images

    def moments_of(
        self,
        images: Images,
        weight: NDArray[Any] | None = None,
        *,
        sandwich: bool = False,
        power: bool = False,
    ) -> Moments:
        """Moments of images, each pixel with a weight.

        Parameters
        ----------
        images : Images
            They stay as they are.
        weight : array, shape (height, width), optional
            ω, 0 to 1: the normal equations have ω, the sandwich ω². A pixel of less than `weigh.NEGLIGIBLE` has no
            partner.
        sandwich : bool
            Sum r²g gᵀ as well; after a low-pass with gradients that are filtered once more.
        power : bool
            As for `moments`.
        """
        recipes = self._recipes_of(power)
        weights = np.empty((0, 0), self.dtype) if weight is None else weight
        again = sandwich and self.lowpass > 0

        def task(strip: tuple[int, int], sums: list[NDArray[Any]], edges: list[NDArray[Any]]) -> None:
            part = self.lattice.part(strip, (0, self.shape[0]))
            top, bottom = part.rows
            seen = rows_of(images, top, bottom)
            moment_strip(seen, weights[top:bottom], recipes, part, _three(sums), _three(edges))

        moments = self._summed(task, sandwich and not again, power)
        if not again:
            return moments
        filtered = self.filtered(images, weight)
        return dataclasses.replace(
            moments, sandwich=self._plain().moments_of(filtered, sandwich=True).sandwich
        )

    def filtered(self, images: Images, weight: NDArray[Any] | None = None) -> Images:
        """Images with pixel weights taken into gradients and residual, and gradients after one more low-pass."""
        weighed = [images.gradient_x, images.gradient_y]
        residual = images.residual
        if weight is not None:
            root = np.where(weight >= NEGLIGIBLE, np.sqrt(weight), 0)
            weighed = [image * root for image in weighed]
            residual = np.where(root > 0, residual * root, np.nan)
        smooth = [smoothed(image, self.lowpass) for image in weighed]
        return images._replace(gradient_x=smooth[0], gradient_y=smooth[1], residual=residual)

    def _plain(self) -> Sweep:
        """The same without the low-pass."""
        plain = copy.copy(self)
        plain.lowpass = 0.0
        return plain

    def _recipes_of(self, power: bool) -> tuple[Cells, Cells, Cells]:
        """What is summed of the pixels."""
        normal, statistics, sandwich = self._recipes
        return normal, statistics, self._power if power else sandwich

    def _summed(self, task: Any, sandwich: bool, power: bool) -> Moments:
        third_of = SANDWICH_RANKS if sandwich else POWER_RANKS if power else (0, 0, 0)
        ranks = NORMAL_RANKS, self._statistics, third_of
        normal, statistics, third = summed(self.lattice, ranks, self.dtype, task)
        return Moments(self.lattice, normal, statistics, third if sandwich or power else None)

    def _form(self, total: bool) -> Form:
        return Form(self.degree + 1, total, self.central)

    def _motion(self, maps: NDArray[np.float64], light: NDArray[Any] | None) -> Motion:
        """The maps less their mean plane, in the type of the frames; half of both where seen from the middle."""
        grid, dtype = self.grid, self.dtype
        plane = mean_plane(maps, grid)
        reduced = maps - grid.plane(plane)
        if self.central:
            reduced, plane = reduced / 2, plane / 2
        twist = twist_of(reduced, grid.step)
        return Motion(
            reduced.astype(dtype), twist.astype(dtype), grid.origin_and_step, plane.astype(dtype),
            light_planes(light, grid.step, dtype),
        )  # fmt: skip


def _three(arrays: list[NDArray[Any]]) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    return arrays[0], arrays[1], arrays[2]


def rows_of(images: Images, top: int, bottom: int) -> Images:
    """Some rows of images, which are not copied."""
    return Images(*(image[top:bottom] for image in images))


def mean_plane(maps: NDArray[Any], grid: Grid) -> NDArray[np.float64]:
    """One affine map about pixel (0, 0) close to all maps of a grid: their mean gradient and mean displacement.

    Parameters
    ----------
    maps : array, shape (6, rows, columns)
    grid : Grid
    """
    mean = maps.mean(axis=(1, 2))
    x, y = grid.x.mean(), grid.y.mean()
    mean[0] -= mean[2] * x + mean[3] * y
    mean[1] -= mean[4] * x + mean[5] * y
    return mean


def light_planes(light: NDArray[Any] | None, step: int, dtype: Any) -> NDArray[Any]:
    """Gain and offset with slopes and twists (0), as in `Motion.light`; shape (8, rows, columns), or size 0."""
    if light is None:
        return np.empty((0, 0, 0), dtype)
    planes = np.zeros((8, *light.shape[1:]), dtype)
    planes[:2] = light
    for k, axis in ((2, 1), (3, 0)):
        if light.shape[axis + 1] > 1:
            planes[k], planes[k + 2] = np.gradient(light, step, axis=axis + 1)
    return planes
