"""Joint measurement: all six numbers at once from the eigenvalues of a whole bank, to the noise limit.

After warping with what is known, the moved frame differs from the reference by a small map, I₁(x) =
I₀(x − e(x)), e = Σ_k τ_k a_k(x − p), a_k the fields of the six generators. A kernel w_j answers the two
frames with g0_j and g1_j, and

    log λ_j = log(g1_j/g0_j) = α + Σ_k τ_k h_jk/g_j + noise,   h_jk = ⟨I, ∇·(a_k w_j)⟩            (eigenvalue)

α is a change of contrast; g and h on the right are of the mean of the two frames, so that noise does
not bias the solution. Multiplied by the logarithmic mean of g0_j and g1_j the left side is g1_j − g0_j:
no logarithm is taken, and a response that happens to be small does no harm. Kernels overlap, and their
noise is correlated: g1 − g0 has the covariance 2σ² W Wᴴ. In a basis in which that is the identity
(`FilterBank.whitening`) generalised least squares is ordinary.

The imaginary part alone is the phase shift,

    |g_j| Im log λ_j = Im(g_j* (g1_j − g0_j))/|g_j|,                                              (phase)

on which a change of light has no effect; half of the information is given up for that.

| symbol | name |
|---|---|
| g0, g1, g | `still`, `moved`, `mean` responses |
| h | `slopes` |
| τ, α | first six and last of `solution` |
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.eigenfilters.bank import FilterBank
from sixflow.eigenfilters.patches import BLOCK_BYTES, patch_blocks
from sixflow.errors import InputError

SIX_FROM_TAU = np.array([1.0, 1.0, 2.0, 2.0, 2.0, 2.0])  # divergence = 2τ_s … to first order


@dataclasses.dataclass(frozen=True)
class JointEstimate:
    """What a bank finds at each point; NaN where nothing can be solved.

    Attributes
    ----------
    six : array, shape (points, 6)
        u, v, divergence, curl, stretch, shear of the map e.
    covariance : array, shape (points, 6, 6)
        Of the six.
    contrast : array, shape (points,)
        α, the logarithm of the change of contrast; NaN from the phase.
    noise : array, shape (points,)
        Standard deviation of one frame's noise, from the residual of the fit, grey.
    """

    six: NDArray[np.float64]
    covariance: NDArray[np.float64]
    contrast: NDArray[np.float64]
    noise: NDArray[np.float64]


class JointOperator:
    """A bank made ready for joint measurement.

    Parameters
    ----------
    bank : FilterBank
    phase_only : bool
        Take the phases alone, rather than the complex eigenvalues.

    Raises
    ------
    InputError
        If the bank has too few independent responses for the unknowns.

    Examples
    --------
    >>> from sixflow import synth
    >>> from sixflow.eigenfilters.kernels import Gabor
    >>> bank = FilterBank(tuple(Gabor(f, k * np.pi / 8, sigma=8) for f in (0.4, 0.6) for k in range(8)), 20)
    >>> made = synth.pair(synth.Texture(), synth.Affine.rotation(0.01, centre=(32, 32)), (65, 65))
    >>> found = JointOperator(bank).estimate(made.frame0, made.frame1, np.array([32]), np.array([32]))
    >>> round(float(found.six[0, 3]), 2)
    0.02
    """

    def __init__(self, bank: FilterBank, *, phase_only: bool = False) -> None:
        self.bank, self.phase_only = bank, phase_only
        unknowns = 6 if phase_only else 7
        available = len(bank) if phase_only else bank.independent
        if available <= unknowns:
            raise InputError(
                f"bank has {available} independent responses: {unknowns} unknowns need more; add orientations or orders"
            )
        self.whitening = bank.whitening()
        self._responses = np.ascontiguousarray(bank.matrix.T.astype(np.complex64))
        h = bank.derivatives
        self._slopes = np.ascontiguousarray(h.reshape(-1, h.shape[-1]).T.astype(np.complex64))

    def estimate(
        self, frame0: NDArray[Any], frame1: NDArray[Any], x: NDArray[Any], y: NDArray[Any]
    ) -> JointEstimate:
        """Measure the small map from frame 0 to frame 1 about each point.

        Parameters
        ----------
        frame0, frame1 : arrays, shape (height, width)
            frame1 is warped with what is known; both finite. Beyond their borders they are continued by
            reflection.
        x, y : int arrays, shape (points,)
            Centres, px, inside the frame.
        """
        out = JointEstimate(*(np.full((len(x), *shape), np.nan) for shape in ((6,), (6, 6), (), ())))
        for chosen, (still, moved) in patch_blocks((frame0, frame1), x, y, self.bank.radius, np.float32):
            self._solve(still, moved, chosen, out)
        return out

    def estimate_patches(self, still: NDArray[Any], moved: NDArray[Any]) -> JointEstimate:
        """Measure the small maps between the patches of two stacks, about their centres.

        Parameters
        ----------
        still, moved : arrays, shape (points, n²)
            Of the bank's size, row by row. Each moved patch may have been warped by a map of its own.

        Raises
        ------
        InputError
            If the stacks differ in shape, or have another size than the bank.
        """
        if still.shape != moved.shape or still.ndim != 2 or still.shape[1] != self.bank.size**2:
            raise InputError(
                f"still and moved of shapes {still.shape} and {moved.shape}: both must be "
                f"(points, {self.bank.size**2}), patches of {self.bank.size} × {self.bank.size} px row by row"
            )
        out = JointEstimate(*(np.full((len(still), *shape), np.nan) for shape in ((6,), (6, 6), (), ())))
        count = max(1, BLOCK_BYTES // (8 * still.shape[1]))
        for start in range(0, len(still), count):
            chosen = slice(start, start + count)
            self._solve(still[chosen], moved[chosen], chosen, out)
        return out

    def _solve(self, still: NDArray[Any], moved: NDArray[Any], chosen: slice, out: JointEstimate) -> None:
        centre = still.mean(axis=1, keepdims=True)  # kernels are free of DC; single precision is not
        still, moved = (np.asarray(part - centre, np.float32) for part in (still, moved))
        difference = (moved - still) @ self._responses
        mean = (moved + still) / 2
        g, slopes = mean @ self._responses, (mean @ self._slopes).reshape(len(mean), -1, 6)
        if self.phase_only:
            design, target, whitener = self._phase(g, slopes, difference)
        else:
            design = _real(np.concatenate([slopes, g[..., None]], axis=-1))
            target, whitener = _real(difference[..., None])[..., 0], self.whitening
        design, target = whitener @ design, (whitener @ target[..., None])[..., 0]
        normal = np.swapaxes(design, -1, -2) @ design
        right = (np.swapaxes(design, -1, -2) @ target[..., None])[..., 0]
        good = np.isfinite(normal).all(axis=(1, 2)) & np.isfinite(right).all(axis=1)
        good[good] &= np.linalg.cond(_scaled(normal[good])) < 1e10
        solution = np.linalg.solve(normal[good], right[good][..., None])[..., 0]
        rest = target[good] - (design[good] @ solution[..., None])[..., 0]
        variance = (rest**2).sum(axis=1) / (
            rest.shape[1] - solution.shape[1]
        )  # of the difference of two frames
        covariance = variance[:, None, None] * np.linalg.inv(normal[good])[:, :6, :6]
        place = np.arange(chosen.start, chosen.start + len(still))[good]
        out.six[place] = solution[:, :6] * SIX_FROM_TAU
        out.covariance[place] = covariance * np.outer(SIX_FROM_TAU, SIX_FROM_TAU)
        out.noise[place] = np.sqrt(variance / 2)
        if not self.phase_only:
            out.contrast[place] = solution[:, 6]

    def _phase(
        self, g: NDArray[Any], slopes: NDArray[Any], difference: NDArray[Any]
    ) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
        """Design, target and whitening of the phases; the noise of a phase depends on the phase of its
        response.
        """
        turn = np.conj(g) / np.maximum(np.abs(g), 1e-30)
        design, target = (turn[..., None] * slopes).imag, (turn * difference).imag
        count = len(self.bank)
        full = self.bank.real_noise_covariance
        rr, ri, ii = full[:count, :count], full[:count, count:], full[count:, count:]
        a, b = turn.imag[:, :, None], turn.real[:, :, None]  # Im(turn·z) = a Re z + b Im z
        at, bt = np.swapaxes(a, 1, 2), np.swapaxes(b, 1, 2)
        covariance = a * at * rr + a * bt * ri + b * at * ri.T + b * bt * ii
        values, vectors = np.linalg.eigh(covariance)
        kept = values > 1e-4 * values[:, -1:]
        scale = np.where(kept, 1 / np.sqrt(np.where(kept, values, 1)), 0)
        return design, target, scale[..., None] * np.swapaxes(vectors, 1, 2)


def _real(responses: NDArray[Any]) -> NDArray[np.float64]:
    """Real parts followed by imaginary parts, along the kernels' axis (1)."""
    return np.concatenate([responses.real, responses.imag], axis=1).astype(np.float64)


def _scaled(normal: NDArray[Any]) -> NDArray[Any]:
    """Normal matrices with unit diagonal, whose condition does not depend on units."""
    size = np.sqrt(np.maximum(np.diagonal(normal, axis1=1, axis2=2), 1e-300))
    return normal / (size[:, :, None] * size[:, None, :])
