"""Measures of deformation, finite and infinitesimal, each under its own name.

With the displacement gradient G, F = I + G, and the polar decomposition F = R U (R a rotation, U symmetric):

| name | formula | axes | kind |
|---|---|---|---|
| `deformation_gradient` | F = I + G | | finite |
| `green_lagrange` | ½ (Fᵀ F − I) | reference | finite |
| `almansi` | ½ (I − F⁻ᵀ F⁻¹) | moved | finite |
| `hencky` | log U = ½ log(Fᵀ F), the logarithmic one | reference | finite |
| `biot` | U − I, the nominal (engineering) one | reference | finite |
| `small_strain` | ½ (G + Gᵀ) | | first order in G |
| `rotation_angle` | angle of R | | finite |
| `small_rotation` | ½ curl = ½ (v_x − u_y) | | first order in G |
| `area_ratio` | det F | | finite |

All of them agree to first order in G; the infinitesimal two are wrong by about ½θ² and θ³/6 after a rotation
by θ. Tensors are symmetric, shape (..., 2, 2), with the *tensor* shear off the diagonal: half the engineering
shear γ.

In the plane all of it follows from two complex numbers. With z = x + iy, F z = a z + b z̄:

    a = 1 + ½ (divergence + i curl),   b = ½ (stretch + i shear),   det F = |a|² − |b|²
    R z = (a/|a|) z,                   U z = |a| z + (b ā/|a|) z̄
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sixflow.array_checks import Array, Invalid, as_floats, refuse, require_invalid, silent
from sixflow.convention._closed_form import determinants, half_log_determinant, log_factor
from sixflow.convention.affine import inverse_six
from sixflow.convention.six import gradient as gradient_of
from sixflow.convention.six import six_from_gradient

_FOLDED = "folded or flattened (det F ≤ 0), no deformation of a surface"


@silent
def deformation_gradient(gradient: ArrayLike) -> Array:
    """Deformation gradient F = I + G.

    Parameters
    ----------
    gradient : array, shape (..., 2, 2)
        Displacement gradient G.

    Returns
    -------
    array, shape (..., 2, 2)

    Examples
    --------
    >>> deformation_gradient([[0.5, 0.0], [0.25, 0.0]])
    array([[1.5 , 0.  ],
           [0.25, 1.  ]])
    """
    G = as_floats("gradient", gradient, (2, 2))
    return G + np.eye(2, dtype=G.dtype)


@silent
def green_lagrange(gradient: ArrayLike) -> Array:
    """Green–Lagrange tensor ½ (Fᵀ F − I) = ½ (G + Gᵀ + Gᵀ G), in the axes of the reference frame.

    Half the relative change of squared lengths. Not changed by any rotation after the deformation.

    Parameters
    ----------
    gradient : array, shape (..., 2, 2)
        Displacement gradient G.

    Returns
    -------
    array, shape (..., 2, 2)
        Symmetric; off the diagonal the tensor shear, half the engineering shear.

    Examples
    --------
    >>> green_lagrange([[0.5, 0.0], [0.0, 0.0]])
    array([[0.625, 0.   ],
           [0.   , 0.   ]])
    """
    G = as_floats("gradient", gradient, (2, 2))
    transposed = np.swapaxes(G, -1, -2)
    return (G + transposed + np.matmul(transposed, G)) / 2


def almansi(gradient: ArrayLike, *, invalid: Invalid = "raise") -> Array:
    """Euler–Almansi tensor ½ (I − F⁻ᵀ F⁻¹), in the axes of the moved frame.

    Half the change of squared lengths relative to the moved frame: the Green–Lagrange tensor of the inverse
    map, negative.

    Parameters
    ----------
    gradient : array, shape (..., 2, 2)
        Displacement gradient G, in the coordinates of the reference frame.
    invalid : {"raise", "nan"}
        What to do where det F ≤ 0. NaN elements always stay NaN.

    Returns
    -------
    array, shape (..., 2, 2)
        Symmetric; off the diagonal the tensor shear, half the engineering shear.

    Raises
    ------
    InputError
        If det F ≤ 0 somewhere and `invalid` is "raise".

    Examples
    --------
    >>> almansi([[1.0, 0.0], [0.0, 0.0]])
    array([[0.375, 0.   ],
           [0.   , 0.   ]])
    """
    four, folded = _four(gradient, invalid)
    six = np.concatenate([np.zeros_like(four[..., :2]), four], axis=-1)
    back = gradient_of(inverse_six(np.where(folded[..., None], np.nan, six), invalid="nan"))
    return 0.0 - green_lagrange(back)


@silent
def hencky(gradient: ArrayLike, *, invalid: Invalid = "raise") -> Array:
    """Hencky (logarithmic, right) tensor log U = ½ log(Fᵀ F), in the axes of the reference frame.

    Its trace is the logarithm of the area ratio; for deformations along fixed axes it adds up over frames.

    Parameters
    ----------
    gradient : array, shape (..., 2, 2)
        Displacement gradient G.
    invalid : {"raise", "nan"}
        What to do where det F ≤ 0. NaN elements always stay NaN.

    Returns
    -------
    array, shape (..., 2, 2)
        Symmetric; off the diagonal the tensor shear, half the engineering shear.

    Raises
    ------
    InputError
        If det F ≤ 0 somewhere and `invalid` is "raise".

    Examples
    --------
    >>> hencky([[1.0, 0.0], [0.0, 0.0]]).round(6)
    array([[0.693147, 0.      ],
           [0.      , 0.      ]])
    """
    four, folded = _four(gradient, invalid)
    size, xx, xy = stretch_tensor(four)
    half_log_det = half_log_determinant(four)
    factor = log_factor(size, xx * xx + xy * xy, half_log_det)
    return _symmetric(half_log_det, factor * xx, factor * xy, folded)


@silent
def biot(gradient: ArrayLike, *, invalid: Invalid = "raise") -> Array:
    """Biot (nominal) tensor U − I of the polar decomposition F = R U, in the axes of the reference frame.

    Its principal values are the relative changes of length along the principal axes.

    Parameters
    ----------
    gradient : array, shape (..., 2, 2)
        Displacement gradient G.
    invalid : {"raise", "nan"}
        What to do where det F ≤ 0. NaN elements always stay NaN.

    Returns
    -------
    array, shape (..., 2, 2)
        Symmetric; off the diagonal the tensor shear, half the engineering shear.

    Raises
    ------
    InputError
        If det F ≤ 0 somewhere and `invalid` is "raise".

    Examples
    --------
    >>> biot([[0.5, 0.0], [0.0, 0.0]])
    array([[0.5, 0. ],
           [0. , 0. ]])
    """
    four, folded = _four(gradient, invalid)
    divergence, curl = four[..., 0], four[..., 1]
    size, xx, xy = stretch_tensor(four)
    growth = (divergence + (divergence * divergence + curl * curl) / 4) / (size + 1)  # |a| − 1
    return _symmetric(growth, xx, xy, folded)


@silent
def small_strain(gradient: ArrayLike) -> Array:
    """Infinitesimal tensor ½ (G + Gᵀ): first order in G, wrong by about ½θ² after a rotation by θ.

    Parameters
    ----------
    gradient : array, shape (..., 2, 2)
        Displacement gradient G.

    Returns
    -------
    array, shape (..., 2, 2)
        Symmetric; off the diagonal the tensor shear, half of the `shear` u_y + v_x of the six.

    Examples
    --------
    >>> small_strain([[0.5, 0.25], [0.0, 0.0]])
    array([[0.5  , 0.125],
           [0.125, 0.   ]])
    """
    G = as_floats("gradient", gradient, (2, 2))
    return (G + np.swapaxes(G, -1, -2)) / 2


@silent
def rotation_angle(gradient: ArrayLike, *, invalid: Invalid = "raise") -> Array:
    """Angle of the rotation R of the polar decomposition F = R U: atan2(curl, 2 + divergence).

    Parameters
    ----------
    gradient : array, shape (..., 2, 2)
        Displacement gradient G.
    invalid : {"raise", "nan"}
        What to do where det F ≤ 0. NaN elements always stay NaN.

    Returns
    -------
    array, shape (...)
        rad, within (−π, π]; from x towards y, which is clockwise on the screen.

    Raises
    ------
    InputError
        If det F ≤ 0 somewhere and `invalid` is "raise".

    Examples
    --------
    >>> import numpy as np
    >>> np.degrees(rotation_angle([[-1.0, -1.0], [1.0, -1.0]])).round(9)
    np.float64(90.0)
    """
    four, folded = _four(gradient, invalid)
    angle = np.where(folded, np.nan, np.arctan2(four[..., 1], 2 + four[..., 0]))
    return angle[()]


@silent
def small_rotation(gradient: ArrayLike) -> Array:
    """Infinitesimal rotation ½ curl = ½ (v_x − u_y), rad: first order in G, sin θ for a rotation by θ.

    Parameters
    ----------
    gradient : array, shape (..., 2, 2)
        Displacement gradient G.

    Returns
    -------
    array, shape (...)
        rad; from x towards y, which is clockwise on the screen.

    Examples
    --------
    >>> small_rotation([[0.0, -0.25], [0.25, 0.0]])
    np.float64(0.25)
    """
    G = as_floats("gradient", gradient, (2, 2))
    return (G[..., 1, 0] - G[..., 0, 1]) / 2


@silent
def area_ratio(gradient: ArrayLike) -> Array:
    """Area in the moved frame over area in the reference frame: det F = 1 + divergence + det G.

    Parameters
    ----------
    gradient : array, shape (..., 2, 2)
        Displacement gradient G.

    Returns
    -------
    array, shape (...)
        Dimensionless; negative where the map folds.

    Examples
    --------
    >>> area_ratio([[0.5, 0.0], [0.0, 1.0]])
    np.float64(3.0)
    """
    G = as_floats("gradient", gradient, (2, 2))
    return (1 + G[..., 0, 0]) * (1 + G[..., 1, 1]) - G[..., 0, 1] * G[..., 1, 0]


def stretch_tensor(four: Array) -> tuple[Array, Array, Array]:
    """U as |a| and the components (xx, xy) of its traceless part, from (divergence, curl, stretch, shear)."""
    real, imaginary = 1 + four[..., 0] / 2, four[..., 1] / 2
    size = np.hypot(real, imaginary)
    cos, sin, stretch, shear = real / size, imaginary / size, four[..., 2] / 2, four[..., 3] / 2
    return size, cos * stretch + sin * shear, cos * shear - sin * stretch


def _four(gradient: ArrayLike, invalid: str) -> tuple[Array, Array]:
    """The last four of the six, and where the map folds."""
    G = as_floats("gradient", gradient, (2, 2))
    require_invalid(invalid)
    four = six_from_gradient(np.zeros(2, dtype=G.dtype), G)[..., 2:]
    folded = np.asarray(determinants(four)[1] <= 0)
    refuse("gradient", folded, _FOLDED, invalid)
    return four, folded


def _symmetric(half_trace: Array, xx: Array, xy: Array, folded: Array) -> Array:
    tensor = np.stack([half_trace + xx, xy, xy, half_trace - xx], axis=-1)
    return np.where(folded[..., None], np.nan, tensor).reshape(*folded.shape, 2, 2) + 0.0
