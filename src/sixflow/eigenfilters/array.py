"""Operator array: the same bank at every position of a lattice, and the normal equations that each finds.

At a position the orthonormal rows S of the bank (`projection`) see of the residual r, the right-hand side q of the
pass and the gradient (g_x, g_y) of the mean frame Ī

    s = S r,   z = S q,   D = S (g_x, g_x X, g_x Y, g_y, g_y X, g_y Y),   C = S (Ī, X Ī, Y Ī).

A change of contrast and its slope add to the residual what C spans. They are a nuisance of every position, taken out
by projection, D̃ = D − C(CᵀC)⁻¹CᵀD. Brightness and its slope are not seen, but by patches of which a part is missing
(beyond the border, or without a partner): there they are taken out likewise. Each position then has

    N_q = D̃ᵀ D̃,   b_q = D̃ᵀ z,

the generalised least squares of its complex eigenvalues. D is the derivative kernels' h = ∇·(a w) applied to the
frame, by parts: ⟨I, h⟩ = −⟨a·∇I, w⟩. In this form pixels without a partner can be left out on both sides.

Where the contrast changed by the factor a, the moved frame's part of Ī takes some of the motion with it when it is
projected out: what is left answers a displacement with κ times the gradient of Ī,

    κ = 4a/(1 + a)² = 1 − (share/2)²,   share = 2(a − 1)/(a + 1),

and share is that of Ī in r. So D is multiplied by κ, and so is what z has of the gradient. κ is 8/9 for a contrast
doubled or halved, and taken as 3/4 where it is more than tripled or less than a third. Beyond that the change is ever
less a change of light: texture that vanished from one frame altogether would be a contrast of a = 0, its residual
r = ∓2 Ī all contrast, and nothing would be left to tell it from a perfect match. So what exceeds |share| = 1 counts,
doubled, in the residual's power.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.eigenfilters.projection import Projection
from sixflow.engine.array import fold_strip, product_strip
from sixflow.engine.threads import over_strips
from sixflow.maps.grid import Grid

_BLOCK_BYTES = 8 * 2**20
_LARGEST_SHARE = 1.0  # of the mean frame in the residual: contrast tripled, or a third of it


@dataclasses.dataclass(frozen=True)
class LocalEquations:
    """What the operators at all positions find.

    Attributes
    ----------
    design : array, shape (positions, 6, m)
        D̃ᵀ.
    normal : float64 array, shape (rows, columns, 6, 6)
        N_q, for (u, ℓu_x, ℓu_y, v, ℓv_x, ℓv_y) about the position.
    right : float64 array, shape (rows, columns, 6)
        b_q.
    power : float64 array, shape (rows, columns)
        |s̃|² of the residual, less its changes of contrast.
    freedom : float64 array, shape (rows, columns)
        What |s̃|² would be of white noise of unit variance: the number of responses, less where a part of the patch
        is missing, and less those taken out; at least 1.
    contrast : float64 array, shape (rows, columns)
        |S Ī|².
    """

    design: NDArray[Any]
    normal: NDArray[np.float64]
    right: NDArray[np.float64]
    power: NDArray[np.float64]
    freedom: NDArray[np.float64]
    contrast: NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Images:
    """What the operators look at, each (height, width): 0 at pixels without a partner, where `counted` is 0 too."""

    gradient_x: NDArray[Any]
    gradient_y: NDArray[Any]
    right: NDArray[Any]
    residual: NDArray[Any]
    mean: NDArray[Any]
    counted: NDArray[Any]


def local_equations(projection: Projection, lattice: Grid, images: Images) -> LocalEquations:
    """Normal equations of every position."""
    count, m = lattice.rows * lattice.columns, len(projection)
    design = np.empty((count, 6, m), projection.dtype)
    right, power, contrast, freedom = np.empty((count, 6)), np.empty(count), np.empty(count), np.empty(count)
    folders = {
        field.name: _Folder(getattr(images, field.name), lattice, projection)
        for field in dataclasses.fields(images)
    }
    full = (2 * projection.radius + 1) ** 2 - 0.5 + 1  # the centre counts twice
    for at in _blocks(lattice, projection):
        folded = {name: folder.rows(at) for name, folder in folders.items()}
        here = slice(at.start * lattice.columns, at.stop * lattice.columns)
        D = design[here]
        D[:, :3], D[:, 3:] = (projection.moments(folded[name]) for name in ("gradient_x", "gradient_y"))
        z, s = projection.responses(folded["right"]), projection.responses(folded["residual"])
        C = projection.moments(folded["mean"])
        freedom[here] = projection.seen(folded["counted"]) - C.shape[1]
        cut = folded["counted"][0].sum(axis=1) < full
        if cut.any():  # brightness is seen where a part of the patch is missing
            B = projection.moments(tuple(part[cut] for part in folded["counted"]))
            D[cut], C[cut], s[cut] = _project_out(B, D[cut], C[cut], s[cut])
            freedom[here] -= B.shape[1] * cut
        contrast[here] = _power(C[:, 0])
        excess, kappa = excess_share(C[:, 0], s), gradient_factor(C[:, 0], s)[:, None]
        D *= kappa[:, None]
        z = kappa * z + (kappa - 1) * s
        _project_out(C, D, s)
        right[here] = (D @ z[:, :, None])[..., 0]
        power[here] = _power(s) + excess**2 * contrast[here]
    return LocalEquations(
        design,
        products(design, design, lattice),
        right.reshape(*lattice.shape, 6),
        power.reshape(lattice.shape),
        np.maximum(freedom, 1).reshape(lattice.shape),
        contrast.reshape(lattice.shape),
    )


def gradient_factor(mean: NDArray[Any], residual: NDArray[Any]) -> NDArray[Any]:
    """κ of every position, at least 3/4, from the responses to mean frame and residual; each (positions, m)."""
    share = np.clip(_contrast_share(mean, residual), -_LARGEST_SHARE, _LARGEST_SHARE)
    result: NDArray[Any] = 1 - (share / 2) ** 2
    return result


def excess_share(mean: NDArray[Any], residual: NDArray[Any]) -> NDArray[Any]:
    """What of the share is too much for a change of light: 0 up to ±1, rising to all of ±2, where texture vanished."""
    result: NDArray[Any] = 2 * np.maximum(np.abs(_contrast_share(mean, residual)) - _LARGEST_SHARE, 0)
    return result


def _contrast_share(mean: NDArray[Any], residual: NDArray[Any]) -> NDArray[Any]:
    power = _power(mean)
    result: NDArray[Any] = np.einsum("pm,pm->p", mean, residual) / np.where(power > 0, power, 1)
    return result


def _project_out(C: NDArray[Any], *seen: NDArray[Any]) -> tuple[NDArray[Any], ...]:
    """Take what the rows of C (positions, k, m) span out of all that was seen, (positions, m) or (positions, …, m),
    in place; Gram and Schmidt. What is left of a row after the rows before it counts if it is not less than 1e-3 of the
    largest row.
    """
    basis: list[NDArray[Any]] = []
    least = 1e-3 * np.sqrt(np.max([_power(C[:, k]) for k in range(C.shape[1])], axis=0))
    for k in range(C.shape[1]):
        rest = C[:, k].copy()
        for known in basis:
            rest -= np.einsum("pm,pm->p", rest, known)[:, None] * known
        size = np.sqrt(_power(rest))
        scale = np.where(size > least, 1 / np.where(size > 0, size, 1), 0)
        rest *= scale[:, None].astype(rest.dtype)
        basis.append(rest)
        for part in seen:
            rows = part.reshape(len(part), -1, part.shape[-1])
            rows -= (rows @ rest[:, :, None]) * rest[:, None, :]
    return seen


def _power(responses: NDArray[Any]) -> NDArray[Any]:
    """|s|² of every position; from shape (positions, m)."""
    result: NDArray[Any] = np.einsum("pm,pm->p", responses, responses)
    return result


def products(
    a: NDArray[Any], b: NDArray[Any], lattice: Grid, delta: tuple[int, int] = (0, 0)
) -> NDArray[np.float64]:
    """A_q B_{q+δ}ᵀ of all positions; a and b (positions, 6, m), result (rows, columns, 6, 6), 0 where q + δ is
    not on the lattice.
    """
    out = np.empty((*lattice.shape, 6, 6))
    over_strips(
        lambda start, stop: product_strip(a, b, lattice.shape, delta, start, stop, out), lattice.rows, 8
    )
    return out


class _Folder:
    """Folded patches of an image, for some lattice rows at a time."""

    def __init__(self, image: NDArray[Any], lattice: Grid, projection: Projection) -> None:
        self.lattice, self.projection = lattice, projection
        self.image = np.pad(image.astype(projection.dtype, copy=False), projection.radius)

    def rows(self, at: slice) -> tuple[NDArray[Any], NDArray[Any]]:
        """p(o) + p(−o) and p(o) − p(−o); each (positions, n²//2 + 1)."""
        radius, columns = self.projection.radius, self.lattice.columns
        shape = ((at.stop - at.start) * columns, (2 * radius + 1) ** 2 // 2 + 1)
        plus, minus = np.empty(shape, self.image.dtype), np.empty(shape, self.image.dtype)
        place = self.lattice.origin_and_step
        over_strips(
            lambda a, b: fold_strip(
                self.image, place, columns, radius, at.start + a, at.start + b,
                plus[a * columns : b * columns], minus[a * columns : b * columns],
            ),
            at.stop - at.start,
            1,
        )  # fmt: skip
        return plus, minus


def _blocks(lattice: Grid, projection: Projection) -> Iterator[slice]:
    """Runs of lattice rows whose patches fit the processor's cache."""
    bytes_per_row = 4 * lattice.columns * (2 * projection.radius + 1) ** 2
    rows = max(1, _BLOCK_BYTES // bytes_per_row)
    for start in range(0, lattice.rows, rows):
        yield slice(start, min(start + rows, lattice.rows))
