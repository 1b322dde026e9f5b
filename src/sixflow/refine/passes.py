"""Passes: one least-squares pass over the whole field at once, and what it says of every window.

One pass blends the grid's local affine maps to a dense displacement U, warps the moved frame once, and
solves at every grid point

    minimise Σ_x w(x − p) [r(x) − g·U(x) + g·(d + G(x − p))]²

for the **total** map (d, G), or in increment form, with r alone, for what U leaves. Six numbers per point
are redundant for a dense field; were each pass to add an increment, errors in the redundant directions
would never be corrected. In the total form the fixed point is the window's own least-squares affine
fit, whatever U was, and noise does not grow with passes.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.blend import twist_of
from sixflow.engine.interpolate import Interpolant
from sixflow.engine.lowpass import lowpass_noise, smoothed
from sixflow.engine.rows import DERIVATIVE
from sixflow.engine.solve import (
    covariance_strip,
    explained_strip,
    noise_feedback,
    normal_matrices,
    solve_strip,
    texture_strip,
)
from sixflow.engine.spline import DEGREE, gradient_noise, noise_variance
from sixflow.engine.sweep import Form, Images, Motion, Pair, image_strip
from sixflow.engine.taps import moments_strip, sandwich_strip, statistics_strip
from sixflow.engine.threads import over_strips
from sixflow.engine.weigh import NEGLIGIBLE, apply_weights, find_weights, weighing_noise, weight_slope
from sixflow.engine.window import moment_weights
from sixflow.judge.flags import MINIMUM_KEPT, MINIMUM_TEXTURE, MINIMUM_WEIGHT
from sixflow.maps.grid import Grid
from sixflow.maps.restriction import ABSENT, allowed, confined, joined, maps_of, projection, unknowns
from sixflow.prepare.frame import NO_MASK, Frame
from sixflow.refine.quality import Quality, Seen, above_floor, feedback_scale, shrunk_noise, six_from_unknowns
from sixflow.refine.sweep import light_planes, rows_of
from sixflow.refine.workspace import Workspace
from sixflow.settings import Settings

STRIP = 64
GRID_STRIP = 16
CONTRACTION = 0.05  # what a pass leaves of the distance to its fixed point, at least (measured: 0.01 to 0.03)
WEIGHED_CONTRACTION = 0.4  # the same where weights change from pass to pass
FREEZE = 10  # weighed passes after which the weights stay: pixels in doubt could change sides for ever
OF_CONTRAST = (
    0.02  # of the frame's contrast: a residual that no pixel is called foreign for is 3.5 times that
)
LONG_TAIL = (
    1.3  # mean square residual over that of a Gaussian of the same mean size: foreign pixels (noise: ± 0.03)
)
MOST_ABSORBED = 0.25  # share of the residual's power: beyond, there is no telling
TRUSTED_RESIDUAL = 0.6  # zero-normalised (correlation 0.82), for a start that finer levels build upon


class Passes:
    """Least-squares passes over one level of one frame pair.

    Parameters
    ----------
    reference, moved : Frame
        Both at the level's resolution.
    grid : Grid
    settings : Settings
    workspace : Workspace
    """

    minimum_texture = MINIMUM_TEXTURE

    def __init__(
        self, reference: Frame, moved: Frame, grid: Grid, settings: Settings, workspace: Workspace
    ) -> None:
        self.reference, self.moved, self.grid, self.settings = reference, moved, grid, settings
        self.workspace = workspace
        self.dtype = reference.image.dtype
        self.degree = DEGREE[settings.interpolation]
        self.coefficients = moved.coefficients(self.degree)
        self.moved_valid = moved.interpolable()
        self.central = settings.reference == "middle"
        self.reference_valid = reference.interpolable() if self.central else reference.counted()
        self.weights = moment_weights(settings.sigma).astype(self.dtype)
        self.floor, self.rounded = _mean_floor(reference, moved), max(reference.rounded, moved.rounded)
        self.by_window = settings.lighting == "gain+offset"
        self.lighting = np.empty((0, 0, 0, 0), self.dtype)
        self._update = self._last = np.zeros((6, *grid.shape))
        self._last_seen: Seen | None = None
        self._partner: NDArray[Any] | None = None
        self._weighings = 0
        self.robust = False
        """Whether foreign pixels have little weight in the next passes."""

    def solve(self, maps: NDArray[Any], *, total: bool = True) -> NDArray[Any]:
        """Return the maps after one pass, NaN where the equations are singular.

        Parameters
        ----------
        maps : float64 array, shape (6, rows, columns)
            u, v, u_x, u_y, v_x, v_y at the grid points, without NaN.
        total : bool
            Total form, or increment form (a sharpening pass).
        """
        grid = self.grid
        plane = _mean_plane(maps, grid)
        shift = grid.plane(plane)
        reduced = maps - shift
        if self.by_window and not self.lighting.size:
            self._warp(reduced, plane, total)
            self._estimate_lighting()
        self._warp(reduced, plane, total)
        if self.robust:
            self._weigh()
        known = shift if total else maps
        if self.settings.group == "affine":
            solution = self._solution() + known
            self._update = solution - maps
        else:
            solution = self._confined(maps, known)
            self._update = joined(solution, grid.step) - maps
        if self.by_window:
            self._estimate_lighting()
        self._last_seen, self._last = None, solution
        return solution

    def _solution(self) -> NDArray[np.float64]:
        """Solve the normal equations of what the warp left in the workspace; shape (6, rows, columns)."""
        moments, solution = self._moments(), np.empty((6, *self.grid.shape))

        def sums_and_solution(start: int, stop: int) -> None:
            place = self.grid.origin_and_step
            moments_strip(*self._images(), self.weights, place, start, stop, moments)
            solve_strip(moments, self.settings.sigma, start, stop, solution)

        over_strips(sums_and_solution, self.grid.rows, GRID_STRIP)
        return solution

    def _confined(self, maps: NDArray[Any], known: NDArray[Any]) -> NDArray[np.float64]:
        """Solve the normal equations for what is left of `known`, within the group; shape (6, rows, columns)."""
        sigma = self.settings.sigma
        self._solution()
        normal, right = self._normal_equations()
        base, basis = allowed(self.settings.group, maps, sigma)
        done = unknowns(known, sigma)
        return maps_of(confined(normal, right, base - done, basis) + done, sigma)

    def _normal_equations(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Normal matrix and right-hand side of θ that the last solution had; (rows, columns, 6, 6) and (…, 6)."""
        moments = self._moments()
        right = np.moveaxis(moments[..., 18:].astype(np.float64), -1, 0)
        return normal_matrices(moments), np.moveaxis(right, 0, -1)

    def _moments(self) -> NDArray[Any]:
        return self.workspace.array("moments", (*self.grid.shape, 24), self.dtype)

    def _images(self) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
        shape, array = self.reference.image.shape, self.workspace.array
        return (
            array("gradient_x", shape, self.dtype),
            array("gradient_y", shape, self.dtype),
            array("right", shape, self.dtype),
        )

    def _warp(self, reduced: NDArray[Any], plane: NDArray[Any], total: bool) -> None:
        """Fill the workspace's gradient, right-hand side and residual (and the warped frame, where the
        light is estimated).
        """
        shape, dtype, grid, array = self.reference.image.shape, self.dtype, self.grid, self.workspace.array
        if self.central:
            reduced, plane = reduced / 2, plane / 2
        noise, nowhere = noise_variance(self.degree, self.settings.lowpass), np.empty((0, 0), dtype)
        coefficients = self.reference.coefficients(self.degree) if self.central else nowhere
        pair = Pair(
            self.reference.image,
            NO_MASK if self.central else self.reference_valid,
            Interpolant(coefficients, self.reference_valid if self.central else NO_MASK, noise),
            Interpolant(self.coefficients, self.moved_valid, noise),
        )
        twist = twist_of(reduced, grid.step).astype(dtype)
        light = light_planes(self.lighting[:, 0] if self.lighting.size else None, grid.step, dtype)
        motion = Motion(reduced.astype(dtype), twist, grid.origin_and_step, plane.astype(dtype), light)
        still = array("still", shape, dtype) if self.central else self.reference.image
        images = Images(
            *self._images(), array("residual", shape, dtype), still, array("warped", shape, dtype)
        )
        form = Form(self.degree + 1, total, self.central)
        over_strips(
            lambda top, bottom: image_strip(pair, motion, form, top, bottom, rows_of(images, top, bottom)),
            shape[0],
            STRIP,
        )

    def still(self) -> NDArray[Any]:
        """Frame 0 as the last pass compared it: at its own pixels, or brought to the middle."""
        if self.central:
            return self.workspace.array("still", self.reference.image.shape, self.dtype)
        return self.reference.image

    def _weigh(self) -> None:
        """Take the weight of foreign pixels out of what the warp left in the workspace."""
        shape, array = self.reference.image.shape, self.workspace.array
        residual, weight = array("residual", shape, self.dtype), array("pixel_weight", shape, self.dtype)
        floor = OF_CONTRAST * float(self.reference.image[::4, ::4].std())
        if not self._weighings:
            weight[:] = 1
        if self._weighings < FREEZE:
            find_weights(residual, *self._images()[:2], array("raw_weight", shape, self.dtype), weight, floor)
        apply_weights(weight, *self._images(), residual, array("gradient_power", shape, self.dtype))
        self._weighings += 1

    def begin(self) -> None:
        """Give all pixels their full weight again, for another start."""
        self.robust, self._partner, self._weighings = False, None, 0

    def distrust(self) -> bool:
        """Begin to weigh pixels if the last residual shows any that do not belong; True if that is new."""
        if self.robust or not self.settings.robust:
            return False
        seen = self._seen()
        if seen.tail is None:
            return False
        # fewer pixels are independent after a low-pass, and chance makes longer tails
        longest = 1 + (LONG_TAIL - 1) * max(1.0, self.settings.lowpass)
        self.robust = bool((seen.tail > longest).any())
        self._partner = seen.weight if self.robust else None
        return self.robust

    def _statistics(self, image: NDArray[Any], name: str) -> NDArray[np.float64]:
        """Window sums of 1, |r|, r², I, I² of an image over the pixels that have a partner; shape (5,
        rows, columns).
        """
        out = self.workspace.array(name, (*self.grid.shape, 5), self.dtype)
        residual = self.workspace.array("residual", image.shape, self.dtype)
        place = self.grid.origin_and_step
        over_strips(
            lambda start, stop: statistics_strip(image, residual, self.weights, place, start, stop, out),
            self.grid.rows,
            GRID_STRIP,
        )
        return np.moveaxis(out, -1, 0).astype(np.float64)

    def _estimate_lighting(self) -> None:
        """Gain and offset of every window from the mean and standard deviation of the two warped windows.

        The ratio of the standard deviations, unlike a regression of one frame on the other, is not
        biased by noise.
        """
        warped = self.workspace.array("warped", self.reference.image.shape, self.dtype)
        weight, _, _, mean0, power0 = self._statistics(self.still(), "statistics")
        _, _, _, mean1, power1 = self._statistics(warped, "statistics_of_moved")
        with np.errstate(invalid="ignore", divide="ignore"):
            mean0, mean1 = mean0 / weight, mean1 / weight
            gain = np.sqrt((power1 / weight - mean1**2) / (power0 / weight - mean0**2))
        gain = np.where(np.isfinite(gain) & (gain > 0.05) & (gain < 20), gain, 1.0)
        offset = np.where(np.isfinite(mean0), mean1 - gain * mean0, 0.0)
        step = self.grid.step
        self.lighting = np.zeros((2, 4, *self.grid.shape), self.dtype)
        for k, plane in enumerate((gain, offset)):
            self.lighting[k, 0] = plane
            for slope, axis in ((1, 1), (2, 0)):
                if plane.shape[axis] > 1:
                    self.lighting[k, slope] = np.gradient(plane, step, axis=axis)

    def dense(self, maps: NDArray[Any]) -> NDArray[Any]:
        """Maps that fit together to a dense field: those of a smaller group take their gradients from their
        neighbours.
        """
        return maps if self.settings.group == "affine" else joined(maps, self.grid.step)

    @property
    def _least_weight(self) -> float:
        return MINIMUM_KEPT if self.robust else MINIMUM_WEIGHT

    def trust(self) -> NDArray[np.bool_]:
        """Where the last pass saw a texture above the noise, in windows that look alike; shape (rows,
        columns).
        """
        seen = self._seen()
        with np.errstate(invalid="ignore"):
            similar = (seen.residual < TRUSTED_RESIDUAL) & (seen.weight > self._least_weight)
        return similar & (seen.texture > self.minimum_texture)

    def measurable(self) -> NDArray[np.bool_]:
        """Where the last pass saw enough of a window, and texture above the noise; shape (rows, columns)."""
        seen = self._seen()
        with np.errstate(invalid="ignore"):
            return np.asarray((seen.weight > self._least_weight) & (seen.texture > self.minimum_texture))

    @property
    def changing(self) -> bool:
        """Whether the next passes may still change the weights of pixels."""
        return self.robust and self._weighings < FREEZE

    def contraction(self) -> NDArray[Any]:
        """What one more pass leaves of the distance to the fixed point, at most; shape (rows, columns)."""
        rho = self._seen().rho
        with np.errstate(invalid="ignore", divide="ignore"):
            noise_share = np.where(rho >= 0, rho / (1 + rho), 1.0)
        rate = np.clip(noise_share, WEIGHED_CONTRACTION if self.changing else CONTRACTION, 0.9)
        return rate / (1 - rate)

    def counted(self) -> NDArray[np.bool_]:
        """Pixels that had a partner in the last pass; shape (height, width)."""
        shape, array = self.reference.image.shape, self.workspace.array
        counted = np.isfinite(array("residual", shape, self.dtype))
        return counted | (array("pixel_weight", shape, self.dtype) < NEGLIGIBLE) if self.robust else counted

    def explained(self) -> float:
        """Share of the residual's power that the last update took out, median over the points."""
        return 1 - float(np.nanmedian(self._seen().left))

    def quality(self, sharpened: int = 0, held: NDArray[np.bool_] | None = None) -> Quality:
        """Covariance and quality of what the last pass found, sharpened so many times but where points were held."""
        quality = self._quality(sharpened)
        if held is not None and held.any():
            scale = np.diag(six_from_unknowns(1.0, 0) @ np.linalg.inv(six_from_unknowns(1.0, sharpened)))
            covariance = quality.covariance
            covariance[held] *= np.outer(scale, scale).astype(covariance.dtype)
            quality = dataclasses.replace(quality, held=held)
        if not self.by_window:
            return quality
        return dataclasses.replace(quality, light=np.moveaxis(self.lighting[:, 0], 0, -1))

    def _quality(self, sharpened: int) -> Quality:
        seen = self._seen()
        transform = six_from_unknowns(self.settings.sigma, sharpened)
        covariance = self._covariance(seen, transform)
        if self.settings.lowpass:
            absorbed = self._absorbed(seen, covariance, transform)
            covariance /= (1 - 2 * absorbed)[..., None, None].astype(self.dtype)
            seen = dataclasses.replace(seen, noise=seen.noise / np.sqrt(1 - absorbed))
        if not self.robust:
            return Quality(
                covariance,
                seen.texture,
                seen.weight,
                seen.residual,
                seen.noise,
                seen.rho,
                self.minimum_texture,
            )
        weight = self.workspace.array("pixel_weight", self.reference.image.shape, self.dtype)
        raw = self.workspace.array("raw_weight", weight.shape, self.dtype)
        kept = self._share(weight, self.weights)
        covariance *= weighing_noise(kept, self._share(weight_slope(raw, weight), self.weights)).astype(
            self.dtype
        )
        centre = moment_weights(self.settings.sigma / 2).astype(self.dtype)
        return Quality(
            covariance, seen.texture, seen.weight, seen.residual, seen.noise, seen.rho, self.minimum_texture,
            self._partner, 1 - kept, 1 - self._share(weight, centre), self._matched(seen),
        )  # fmt: skip

    def _matched(self, seen: Seen) -> NDArray[np.float64]:
        """Share of Σ w |g|², less noise, that the pixels' weights left; shape (rows, columns)."""
        assert self._partner is not None
        power = self.workspace.array("gradient_power", self.reference.image.shape, self.dtype)
        moments, every = self._moments(), self._sums(power, self.weights)[1]
        left = (moments[..., 0] + moments[..., 12]).astype(np.float64)
        with np.errstate(invalid="ignore", divide="ignore"):
            of_noise = 2 * seen.noise_gradient / seen.weight
            return np.asarray((left - of_noise * seen.weight) / (every - of_noise * self._partner))

    def _share(self, image: NDArray[Any], window: NDArray[Any]) -> NDArray[np.float64]:
        """Window means of an image without NaN; `window` as from `moment_weights`; shape (rows, columns)."""
        weight, total = self._sums(image, window)
        return total / weight

    def _sums(self, image: NDArray[Any], window: NDArray[Any]) -> NDArray[np.float64]:
        """Window sums of 1 and of an image without NaN; shape (2, rows, columns)."""
        out = self.workspace.array("statistics", (*self.grid.shape, 5), self.dtype)
        place = self.grid.origin_and_step
        over_strips(
            lambda start, stop: statistics_strip(image, image, window, place, start, stop, out),
            self.grid.rows,
            GRID_STRIP,
        )
        return np.stack([out[..., 0], out[..., 3]]).astype(np.float64)

    def _covariance(self, seen: Seen, transform: NDArray[np.float64]) -> NDArray[Any]:
        """Covariance of the six numbers, `transform` times the unknowns θ; shape (rows, columns, 6, 6)."""
        grid, dtype, sigma = self.grid, self.dtype, self.settings.sigma
        gradient_x, gradient_y, _ = self._images()
        lowpass = self.settings.lowpass
        if lowpass:
            gradient_x, gradient_y = smoothed(gradient_x, lowpass), smoothed(gradient_y, lowpass)
        frame_residual = self.workspace.array("residual", self.reference.image.shape, dtype)
        sandwich = self.workspace.array("sandwich", (*grid.shape, 18), dtype)
        squared = moment_weights(sigma, power=2).astype(dtype)
        place = grid.origin_and_step
        over_strips(
            lambda start, stop: sandwich_strip(
                gradient_x, gradient_y, frame_residual, squared, place, start, stop, sandwich
            ),
            grid.rows,
            GRID_STRIP,
        )
        sandwich *= np.nan_to_num(seen.left, nan=1.0)[..., None].astype(dtype)
        if seen.lacking is not None:
            sandwich += seen.lacking[..., None].astype(dtype) * self._floor_sandwich(gradient_x, gradient_y)
        sandwich *= (shrunk_noise(self._last) / lowpass_noise(lowpass))[..., None].astype(dtype)
        if self.settings.group != "affine":
            clean = self._normal_equations()[0] - seen.noise_gradient[..., None, None] * np.eye(6)
            return self._within(clean, normal_matrices(sandwich), seen, transform)
        covariance = np.empty((*grid.shape, 6, 6), dtype)
        moments, feedback = self._moments(), noise_feedback()
        over_strips(
            lambda start, stop: covariance_strip(
                moments, sandwich, seen.noise_gradient, seen.rho, feedback, transform, start, stop, covariance
            ),
            grid.rows,
            GRID_STRIP,
        )
        return covariance

    def _floor_sandwich(self, gradient_x: NDArray[Any], gradient_y: NDArray[Any]) -> NDArray[Any]:
        """The sandwich of a residual that is white noise at the floor of both frames; shape (rows, columns, 18)."""
        residual = np.empty_like(gradient_x)
        residual[:] = np.sqrt(2) * self.floor
        out = np.empty((*self.grid.shape, 18), self.dtype)
        squared = moment_weights(self.settings.sigma, power=2).astype(self.dtype)
        over_strips(
            lambda start, stop: sandwich_strip(
                gradient_x, gradient_y, residual, squared, self.grid.origin_and_step, start, stop, out
            ),
            self.grid.rows,
            GRID_STRIP,
        )
        return out

    def _floor_of_windows(self) -> float | NDArray[np.float64]:
        """Root mean square of the floor under each window."""
        if isinstance(self.floor, float):
            return self.floor
        weight, _, _, total, _ = self._statistics(self.floor**2, "statistics")
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(np.sqrt(total / weight))

    def _absorbed(
        self, seen: Seen, covariance: NDArray[Any], transform: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """φ = tr(H C)/Σ w r²: what the fit took out of the residual's power; shape (rows, columns).

        Six numbers hardly lower the residual of a window's white noise. After a low-pass there are fewer independent
        pixels, and with normal gradients Σ w² r² J Jᵀ lacks 2φ: the fit follows noise where gradients are steep.
        """
        back = np.linalg.inv(transform)
        normal = normal_matrices(self._moments())
        with np.errstate(invalid="ignore", divide="ignore"):
            taken = (normal * (back @ covariance @ back.T)).sum(axis=(-1, -2))
            absorbed = taken / (2 * seen.noise**2 * seen.weight)
        if seen.lacking is not None:  # nothing was taken out of what is not in the residual
            absorbed *= 1 - seen.lacking
        return np.clip(np.nan_to_num(absorbed), 0, MOST_ABSORBED)

    def _within(
        self, clean: NDArray[Any], noise: NDArray[Any], seen: Seen, transform: NDArray[np.float64]
    ) -> NDArray[Any]:
        """Covariance of the six within the group, of a normal matrix less noise and its right-hand side's noise."""
        _, basis = allowed(self.settings.group, self._last, self.settings.sigma)
        bread = feedback_scale(seen.rho)[..., None] * (transform @ projection(clean, basis))
        covariance = bread @ noise @ np.swapaxes(bread, -1, -2)
        for k in ABSENT[self.settings.group]:  # zero by assumption, not by rounding
            covariance[..., k, :] = covariance[..., :, k] = np.where(
                np.isnan(covariance[..., 0, :]), np.nan, 0
            )
        return covariance.astype(self.dtype)

    def _seen(self) -> Seen:
        """Noise, texture and similarity of every window in the last pass; computed once per pass."""
        if self._last_seen is None:
            self._last_seen = self._look()
        return self._last_seen

    def _look(self) -> Seen:
        weight, absolute, square, mean, power = self._statistics(self.still(), "statistics")
        explained = self._explained_power()
        with np.errstate(invalid="ignore", divide="ignore"):
            left = np.clip(1 - explained / square, 0.01, 1)
            noise = np.sqrt(left) * absolute / weight * np.sqrt(np.pi) / 2  # E|r| = √(2/π)·√2·noise
            contrast = np.sqrt(np.maximum(power / weight - (mean / weight) ** 2, 0))
            residual = np.sqrt(left * square / weight) / contrast
            tail = 2 / np.pi * left * square * weight / absolute**2
        floor = self._floor_of_windows()
        added = above_floor(noise, floor * self.rounded)[0]  # what a codec left out is not in the gradients
        texture = self._texture(added, weight)
        noise, lacking = above_floor(noise, floor)
        return Seen(weight, noise, residual, left, *texture, tail, lacking)

    def _explained_power(self) -> NDArray[np.float64]:
        """What the last update took out of Σ w r²; shape (rows, columns)."""
        moments, explained = self._moments(), np.empty(self.grid.shape)
        over_strips(
            lambda start, stop: explained_strip(
                moments, self._update, self.settings.sigma, start, stop, explained
            ),
            self.grid.rows,
            GRID_STRIP,
        )
        return explained

    def _texture(
        self, noise: NDArray[Any], weight: NDArray[Any]
    ) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
        """What noise adds to Σ w g_x², and texture and rho of `solve.texture_strip`; each (rows, columns)."""
        moments, texture, rho = self._moments(), np.empty(self.grid.shape), np.empty(self.grid.shape)
        interpolated = 2 if self.central else 1
        share = gradient_noise(self.degree, DERIVATIVE, interpolated, self.settings.lowpass)
        noise_gradient = share * noise**2 * weight
        over_strips(
            lambda start, stop: texture_strip(moments, noise_gradient, start, stop, texture, rho),
            self.grid.rows,
            GRID_STRIP,
        )
        return noise_gradient, texture, rho


def _mean_floor(reference: Frame, moved: Frame) -> float | NDArray[Any]:
    """Root mean square of both frames' floors; of the reference's alone where it differs from pixel to pixel."""
    if isinstance(reference.floor, float) and isinstance(moved.floor, float):
        return math.hypot(reference.floor, moved.floor) / math.sqrt(2)
    return reference.floor


def _mean_plane(maps: NDArray[Any], grid: Grid) -> NDArray[np.float64]:
    """One affine map about pixel (0, 0) close to all maps of the grid: their mean gradient and mean
    displacement.
    """
    mean = maps.mean(axis=(1, 2))
    x, y = grid.x.mean(), grid.y.mean()
    mean[0] -= mean[2] * x + mean[3] * y
    mean[1] -= mean[4] * x + mean[5] * y
    return mean
