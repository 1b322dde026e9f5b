"""Functions of a 2×2 matrix in closed form, without cancellation near the identity.

In a matrix s I + B with B traceless, B² = q I, q = (stretch² + shear² − curl²)/4. So every function of it is
α I + β B: in terms of the six, the divergence becomes 2α and (curl, stretch, shear) are all multiplied by β.
These matrices calculate like the numbers a + b j with j² = q, which are the complex numbers if q < 0.

| function | α | β | where q < 0 |
|---|---|---|---|
| exp(s I + B) | eˢ cosh √q | eˢ sinh √q / √q | cos √−q, sin √−q / √−q |
| log(p I + B) | ½ log det, det = p² − q | artanh(√q/p) / √q | atan2(√−q, p) / √−q |
| φ(A) = ∫₀¹ exp(τA) dτ = Σ Aᵏ/(k+1)! | by series | by series | the same |

φ is what a constant velocity makes of a translation: d = φ(A) b.
"""

from __future__ import annotations

import numpy as np

from sixflow.array_checks import Array

_TERMS = 16  # of the series of φ: at radius ½ the next term is below 1e-17
_RADIUS = 0.5


def square(four: Array) -> Array:
    """Return q of B² = q I, B the traceless part of the gradient (divergence, curl, stretch, shear)."""
    curl, stretch, shear = four[..., 1], four[..., 2], four[..., 3]
    return (stretch * stretch + shear * shear - curl * curl) / 4


def determinants(four: Array) -> tuple[Array, Array]:
    """Determinants of G and I + G, the gradient having the numbers (divergence, curl, stretch, shear)."""
    divergence, curl, stretch, shear = (four[..., k] for k in range(4))
    g_xx, g_yy = (divergence + stretch) / 2, (divergence - stretch) / 2
    g_xy_g_yx = (shear - curl) * (shear + curl) / 4
    return g_xx * g_yy - g_xy_g_yx, (1 + g_xx) * (1 + g_yy) - g_xy_g_yx


def half_log_determinant(four: Array) -> Array:
    """½ log det(I + G), exact to rounding also where det is close to 1; NaN or −inf where det ≤ 0."""
    det_G, det_F = determinants(four)
    change = four[..., 0] + det_G
    return np.where(np.abs(change) < 0.5, np.log1p(change), np.log(det_F)) / 2


def log_factor(p: Array, q: Array, half_log_det: Array) -> Array:
    """β of the logarithm of p I + B, B² = q I: artanh(√q/p)/√q, and atan2(√−q, p)/√−q where q < 0."""
    root = np.sqrt(np.abs(q))
    near = np.arctanh(root / p)
    far = np.log(p + root) - half_log_det
    angle = np.where(q < 0, np.arctan2(root, p), np.where(root < p / 2, near, far))
    return np.where(root == 0, 1 / p, angle / root)


def expm1_pair(s: Array, q: Array) -> tuple[Array, Array]:
    """(α, β) of exp(s I + B) − I, B² = q I."""
    root = np.sqrt(np.abs(q))
    cosh_minus_one = np.where(q < 0, -2 * np.sin(root / 2) ** 2, 2 * np.sinh(root / 2) ** 2)
    sinh_over_root = np.where(root == 0, 1, np.where(q < 0, np.sin(root), np.sinh(root)) / root)
    growth = np.expm1(s)
    return growth + cosh_minus_one + growth * cosh_minus_one, (1 + growth) * sinh_over_root


def phi_pair(s: Array, q: Array) -> tuple[Array, Array]:
    """(α, β) of φ(s I + B): the series within a radius, and φ(2A) = ½ (I + exp A) φ(A) beyond it."""
    radius = np.abs(s) + np.sqrt(np.abs(q))
    doublings = np.frexp(np.where(np.isfinite(radius), radius, 0) / _RADIUS)[1].clip(0)
    scale = np.ldexp(np.ones_like(s), -doublings)
    s, q = s * scale, q * scale * scale
    a, b = np.ones_like(s), np.zeros_like(s)
    for k in range(_TERMS, 0, -1):
        a, b = 1 + (s * a + q * b) / (k + 1), (a + s * b) / (k + 1)
    for k in range(int(doublings.max(initial=0))):
        e, f = expm1_pair(s, q)
        e, f = 1 + e / 2, f / 2
        again = doublings > k
        # b multiplies B, and the doubled matrix has 2B: hence the half
        a, b = np.where(again, e * a + q * f * b, a), np.where(again, (e * b + f * a) / 2, b)
        s, q = np.where(again, 2 * s, s), np.where(again, 4 * q, q)
    return a, b


def inverse_phi_pair(s: Array, q: Array) -> tuple[Array, Array]:
    """(α, β) of φ(s I + B)⁻¹; φ is singular only where an eigenvalue is a multiple of 2πi other than 0."""
    a, b = phi_pair(s, q)
    root = np.sqrt(np.abs(q))
    det = np.where(q > 0, _phi_scalar(s + root) * _phi_scalar(s - root), a * a - q * b * b)
    return a / det, -b / det


def apply_pair(a: Array, b: Array, four: Array, vectors: Array) -> Array:
    """(a I + b B) times vectors, B the traceless part of the gradient with the four numbers."""
    curl, stretch, shear = four[..., 1] / 2, four[..., 2] / 2, four[..., 3] / 2
    x, y = vectors[..., 0], vectors[..., 1]
    return np.stack(
        [
            a * x + b * (stretch * x + (shear - curl) * y),
            a * y + b * ((shear + curl) * x - stretch * y),
        ],
        axis=-1,
    )


def _phi_scalar(z: Array) -> Array:
    return np.where(z == 0, 1, np.expm1(z) / z)
