"""Pooled measurement at points: an array of operators under a window, from their eigenvalues or their phases alone.

`JointOperator` solves for the six numbers with one bank about a point. Here copies of a bank smaller than the window
stand on a lattice of positions q about the point, each gives equations for the map about p, and all are solved
together under the Gaussian weights w_q (`pool`). With S = T R the whitened kernels and Ī the mean frame,

    D_q = −S (a·∇Ī),   t_q = T (g1 − g0),   A_q = D̃_q M(q − p),   τ = (Σ w A_qᵀ A_q − Γ)⁻¹ Σ w A_qᵀ t̃_q,

∇ the central difference of the frames, which here acts on the kernels: by parts, these are derivative kernels that
hold for whatever waves the pixels resolve. (The analytic ones of `FilterBank` differ from them where a kernel's own
waves are finer than pixels: near the singular axes of hyperbolic kernels. Whitening brings that forward.) The tilde
takes out what is not motion: brightness up to its curvature, contrast and its slope; or, if `phase_only`, the
amplitude of every kernel, which leaves the phases. Where the contrast changed, D is multiplied by κ (`array`). Γ is
what the noise of Ī adds to the sum; left in, it would shrink τ in noisy frames. The covariance counts that the noise of
overlapping operators is correlated.

| symbol | name |
|---|---|
| t, D | `target`, `design` |
| M(d): the τ about q = p + d from those about p | `moved_six` |
| Γ | `of_noise` |
| K_δ = S(o) S(o − δ)ᵀ | `overlap` |
"""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.checks import is_whole, require
from sixflow.convention.six import GENERATORS
from sixflow.eigenfilters.array import excess_share, gradient_factor
from sixflow.eigenfilters.bank import FilterBank
from sixflow.eigenfilters.default import array_bank, array_spacing
from sixflow.eigenfilters.geometry import Real
from sixflow.eigenfilters.joint import SIX_FROM_TAU, JointEstimate
from sixflow.eigenfilters.patches import finite_frame, patch_blocks
from sixflow.eigenfilters.projection import extent_of
from sixflow.engine.rows import DERIVATIVE
from sixflow.engine.window import window_sigma
from sixflow.errors import InputError

_WORST = 1e-10  # least eigenvalue of a normal matrix, over the largest
_LEAST = 0.05  # of a normal matrix that is left without its noise
_REACH = 3.0  # positions within so many σ_w of the point


class PooledOperator:
    """An array of operators pooled under a window, made ready for points.

    Parameters
    ----------
    window : float
        Side of the square subset of the same noise, px, at least 10.
    bank : FilterBank, optional
        Of each position; `array_bank(window)` if not given.
    spacing : int, optional
        Distance between positions, px, at least 1; `array_spacing(window)` if not given.
    phase_only : bool
        Take the phases alone: nothing that changes amplitudes disturbs, for more noise.

    Raises
    ------
    InputError
        If the window is too small, the spacing is no whole number of pixels, or the bank is as large as the window or
        has too few independent responses.

    Examples
    --------
    >>> from sixflow import synth
    >>> motion = synth.Affine.rotation(0.002, centre=(64, 64))
    >>> made = synth.pair(synth.Speckle(), motion, (129, 129), sensor=synth.Sensor(noise=1))
    >>> found = PooledOperator(31).estimate(made.frame0, made.frame1, [64], [64])
    >>> curl, error = found.six[0, 3], found.covariance[0, 3, 3] ** 0.5
    >>> bool(abs(curl - 0.004) < 4 * error < 0.002)
    True
    """

    def __init__(
        self,
        window: float = 31,
        bank: FilterBank | None = None,
        *,
        spacing: int | None = None,
        phase_only: bool = False,
    ) -> None:
        self.bank = array_bank(window) if bank is None else bank
        default = array_spacing(window)
        self.spacing = default if spacing is None else _require_spacing(spacing, default)
        self.sigma, self.phase_only = window_sigma(window), phase_only
        self.radius = self.bank.radius + len(DERIVATIVE)  # derivatives reach further than their kernels
        n = 2 * self.radius + 1
        side = np.arange(-self.radius, self.radius + 1.0)
        x, y = (c.ravel() for c in np.meshgrid(side, side))
        W = np.pad(
            self.bank.matrix.reshape(len(self.bank), self.bank.size, -1),
            ((0, 0), *[(len(DERIVATIVE),) * 2] * 2),
        )
        W = W.reshape(len(self.bank), -1)
        T = self.bank.whitening()
        S = T @ np.concatenate([W.real, W.imag])
        self._brightness = S @ _smooth_surfaces(x, y, constant=np.abs(S.sum(axis=1)).max() > 1e-6)
        removed = self._brightness.shape[1] + (len(self.bank) + 2 if phase_only else 3)
        self.freedom = len(S) - removed
        if self.freedom <= 6:
            raise InputError(
                f"bank has {len(S)} independent responses: {removed + 6} unknowns need more; add orientations or orders"
            )
        extent = extent_of(S)
        if extent >= self.sigma:
            raise InputError(
                f"bank: its operators reach {extent:.3g} px from their centre, the window of {window:g} px only "
                f"{self.sigma:.3g} px (one standard deviation); take smaller kernels or a larger window"
            )
        self.width = math.sqrt(self.sigma**2 - extent**2)
        self._whitening, self._kernels = T, np.ascontiguousarray(W.T)
        self._slopes = np.concatenate([_derivative(S, a, x, y) for a in GENERATORS]).T.copy()
        of_each = self._slopes.reshape(len(self._slopes), len(GENERATORS), -1)
        self._gradient_noise = np.einsum("pkm,plm->kl", of_each, of_each) * self.freedom / len(S)
        self._lighting = np.concatenate([S, S * (x / self.sigma), S * (y / self.sigma)]).T.copy()
        self._offsets = self._lattice()
        self._overlaps = _overlaps(S.reshape(-1, n, n), self.spacing)

    def _lattice(self) -> NDArray[np.int64]:
        """Offsets (dx, dy) of the positions from a point, px; shape (positions, 2)."""
        reach = math.ceil(_REACH * self.width / self.spacing)
        steps = np.arange(-reach, reach + 1) * self.spacing
        return np.array([(dx, dy) for dy in steps for dx in steps])

    def estimate(self, frame0: Any, frame1: Any, x: Any, y: Any) -> JointEstimate:
        """Measure the small map from frame 0 to frame 1 about each point.

        Parameters
        ----------
        frame0, frame1 : arrays, shape (height, width)
            Of one shape; frame1 is warped with what is known; both finite.
        x, y : arrays of whole numbers, shape (points,)
            Centres, px, inside the frame. Positions whose patch reaches beyond the border are left out; a point is NaN
            if that leaves less than half of its window's weight.

        Returns
        -------
        JointEstimate
            `contrast` is NaN: each position has its own.

        Raises
        ------
        InputError
            If a frame cannot be used, the frames differ in shape, or a point is no pixel of them.
        """
        frames = [finite_frame(frame, f"frame{k}") for k, frame in enumerate((frame0, frame1))]
        patch_blocks(frames, x, y, self.radius)  # refuses frames and points that cannot be used
        x, y = np.asarray(x), np.asarray(y)
        out = JointEstimate(*(np.full((len(x), *shape), np.nan) for shape in ((6,), (6, 6), (), ())))
        for k, (px, py) in enumerate(zip(x, y, strict=True)):
            found = self._point(frames, int(px), int(py))
            if found is not None:
                out.six[k], out.covariance[k], out.noise[k] = found
        return out

    @property
    def reach(self) -> int:
        """How far from a point its operators look, px."""
        return int(self._offsets.max()) + self.radius

    def estimate_patches(self, still: Any, moved: Any, counted: Any) -> JointEstimate:
        """Measure the small maps between the patches of two stacks, about their centres.

        Parameters
        ----------
        still, moved : arrays, shape (points, n²)
            Finite, n = 2 reach + 1, row by row. Each moved patch may have been warped by a map of its own.
        counted : bool array of the same shape
            Positions whose operator sees a pixel where it is False are left out.

        Raises
        ------
        InputError
            If the stacks differ in shape, or have another size.
        """
        side = 2 * self.reach + 1
        shapes = {np.shape(stack) for stack in (still, moved, counted)}
        if shapes != {(len(still), side**2)}:
            raise InputError(
                f"still, moved, counted of shapes {', '.join(map(str, shapes))}: all must be (points, {side**2}), "
                f"patches of {side} × {side} px row by row"
            )
        out = JointEstimate(*(np.full((len(still), *shape), np.nan) for shape in ((6,), (6, 6), (), ())))
        for k, images in enumerate(zip(still, moved, counted, strict=True)):
            frame0, frame1, usable = (image.reshape(side, side) for image in images)
            found = self._point([frame0, frame1], self.reach, self.reach, usable)
            if found is not None:
                out.six[k], out.covariance[k], out.noise[k] = found
        return out

    def _point(
        self, frames: list[NDArray[Any]], px: int, py: int, usable: NDArray[np.bool_] | None = None
    ) -> tuple[Real, Real, float] | None:
        height, width = frames[0].shape
        at, radius = self._offsets + np.array([px, py]), self.radius
        inside = (at >= radius).all(axis=1) & (at[:, 0] < width - radius) & (at[:, 1] < height - radius)
        if usable is not None:
            seen = [
                usable[y - radius : y + radius + 1, x - radius : x + radius + 1].all() for x, y in at[inside]
            ]
            inside[inside] = seen
        weight = np.exp(-((self._offsets / self.width) ** 2).sum(axis=1) / 2)
        if weight[inside].sum() < 0.5 * weight.sum():
            return None
        kept = np.flatnonzero(inside)
        blocks = patch_blocks(frames, at[kept, 0], at[kept, 1], radius)
        parts = [self._equations(still, moved) for _, (still, moved) in blocks]
        design, target, lost = (np.concatenate(part) for part in zip(*parts, strict=True))
        M = np.stack([moved_six(*offset) for offset in self._offsets[kept]])
        A, w = design @ M, weight[kept]
        normal, right = np.einsum("q,qmi,qmj->ij", w, A, A), np.einsum("q,qmi,qm->i", w, A, target)
        if not _solvable(normal):
            return None
        rest = target - A @ np.linalg.solve(normal, right)
        noise = np.sqrt(((rest**2).sum(axis=1) + lost) / self.freedom)
        # the mean of two frames has a quarter of the noise of their difference
        of_noise = np.einsum("q,qki,kl,qlj->ij", w * noise**2 / 4, M, self._gradient_noise, M)
        inverse = _inverse_without(normal, of_noise)
        meat = self._correlated(A * (w * noise)[:, None, None], kept)
        covariance = inverse @ meat @ inverse * np.outer(SIX_FROM_TAU, SIX_FROM_TAU)
        return (
            inverse @ right * SIX_FROM_TAU,
            covariance,
            float(np.sqrt(np.average(noise**2, weights=w) / 2)),
        )

    def _equations(self, still: NDArray[Any], moved: NDArray[Any]) -> tuple[Real, Real, Real]:
        """Design (positions, m, 6) and target (positions, m), without what is not motion; and what of the change of
        contrast is too much for that, in power (positions,).
        """
        mean, difference = (moved + still) / 2, (moved - still) @ self._kernels
        mean = mean - mean.mean(axis=1, keepdims=True)
        target = np.concatenate([difference.real, difference.imag], axis=1) @ self._whitening.T
        count, m = target.shape
        design = np.swapaxes((mean @ self._slopes).reshape(count, 6, m), 1, 2)
        light = np.swapaxes((mean @ self._lighting).reshape(count, 3, m), 1, 2)
        contrast = light[..., 0]
        design *= gradient_factor(contrast, target)[:, None, None]
        lost = excess_share(contrast, target) ** 2 * (contrast**2).sum(axis=1)
        bright = np.broadcast_to(self._brightness, (count, *self._brightness.shape))
        if self.phase_only:
            g = (mean @ self._kernels)[:, None, :]
            real, imaginary = np.split(self._whitening, 2, axis=1)
            light = np.concatenate([light[..., 1:], real * g.real + imaginary * g.imag], axis=2)
        q, _ = np.linalg.qr(np.concatenate([light, bright], axis=2))
        columns = np.concatenate([design, target[..., None]], axis=2)
        columns = columns - q @ (np.swapaxes(q, 1, 2) @ columns)
        return columns[..., :6], columns[..., 6], lost

    def _correlated(self, A: Real, kept: NDArray[np.intp]) -> Real:
        """Σ A_qᵀ K_δ A_{q+δ} over all pairs of positions; A holds weights and noise."""
        total: Real = np.einsum("qmi,qmj->ij", A, A)
        place = {tuple(self._offsets[q]): k for k, q in enumerate(kept)}
        for (dx, dy), overlap in self._overlaps.items():
            pairs = [
                (k, place[near])
                for (x, y), k in place.items()
                if (near := (x + dx * self.spacing, y + dy * self.spacing)) in place
            ]
            if pairs:
                here, there = np.array(pairs).T
                one_way = np.einsum("qmi,qmj->ij", np.swapaxes(overlap, 0, 1) @ A[here], A[there])
                total = total + one_way + one_way.T
        return total


def _require_spacing(spacing: Any, default: int) -> int:
    wanted = f"must be a whole number of px, at least 1; {default} suits the window"
    require(is_whole(spacing, 1), "spacing", spacing, wanted)
    return int(spacing)


def _smooth_surfaces(x: Real, y: Real, *, constant: bool) -> Real:
    """Orthonormal slopes and curvatures of brightness, shape (n², 5); 6 with brightness itself, which only kernels
    that are not free of DC see.
    """
    surfaces = [np.ones_like(x), x, y, x * x, x * y, y * y]
    q, _ = np.linalg.qr(np.stack(surfaces, axis=1))
    result: Real = q if constant else q[:, 1:]
    return result


def _solvable(normal: Real) -> bool:
    """Whether a normal matrix is safely positive definite, in units in which its diagonal is 1."""
    diagonal = np.diagonal(normal)
    if not (np.isfinite(normal).all() and (diagonal > 1e-300).all()):
        return False
    values = np.linalg.eigvalsh(normal / np.sqrt(np.outer(diagonal, diagonal)))
    return bool(values[0] > _WORST * values[-1])


def _inverse_without(normal: Real, of_noise: Real) -> Real:
    """(N − Γ)⁻¹, of which at least `_LEAST` of N is kept in every direction."""
    lower = np.linalg.inv(np.linalg.cholesky(normal))
    shares, directions = np.linalg.eigh(lower @ of_noise @ lower.T)
    root = lower.T @ directions / np.sqrt(1 - np.minimum(shares, 1 - _LEAST))
    result: Real = root @ root.T
    return result


def _derivative(S: Real, generator: Real, x: Real, y: Real) -> Real:
    """−∇*(a S): the kernels whose responses to a frame are those of S to −a·∇I, ∇ the central difference."""
    n = math.isqrt(len(x))
    fields = (generator @ np.stack([x, y, np.ones_like(x)]))[:2].reshape(2, n, n)
    images = S.reshape(-1, n, n)
    total = np.zeros_like(images)
    for field, axis in zip(fields, (2, 1), strict=True):
        weighted = images * field
        for k, d in enumerate(DERIVATIVE, start=1):
            total += d * (np.roll(weighted, -k, axis) - np.roll(weighted, k, axis))
    return total.reshape(S.shape)


def moved_six(dx: float, dy: float) -> Real:
    """M(d): the τ about q = p + d of a map whose τ about p are known; shape (6, 6)."""
    matrix = np.eye(6)
    for k in range(2, 6):
        matrix[:2, k] = GENERATORS[k][:2, :2] @ (dx, dy)
    return matrix


def _overlaps(images: Real, spacing: int) -> dict[tuple[int, int], Real]:
    """K_δ by δ in spacings, one of each pair ±δ, as far as patches overlap by more than a hundredth."""
    n, m = images.shape[1], len(images)
    found = {}
    reach = (n - 1) // spacing
    for dx, dy in itertools.product(range(-reach, reach + 1), range(reach + 1)):
        if dy == 0 and dx <= 0:
            continue
        a, b = dx * spacing, dy * spacing
        here = images[:, max(b, 0) : n + min(b, 0), max(a, 0) : n + min(a, 0)].reshape(m, -1)
        there = images[:, max(-b, 0) : n + min(-b, 0), max(-a, 0) : n + min(-a, 0)].reshape(m, -1)
        overlap = here @ there.T
        if np.abs(overlap).max() > 0.01:
            found[dx, dy] = overlap
    return found
