"""The three families of kernels: Gabor, spiral (log-polar) and hyperbolic.

| family | pair | exp(−i(uη + vξ)) | window | measures |
|---|---|---|---|---|
| `Gabor` | L_x, L_y | plane wave | Gaussian in x, y | translation |
| `Spiral` | L_s, L_r | r^(−iu) exp(−iv atan2(y, x)) | Gaussian in log r | divergence (u), curl (v), spirals |
| `Hyperbolic` | L_b, L_s or L_B, L_s | wave along hyperbolas | Gaussian in log r and in η | stretch or shear |

What they share, normalisation and derivatives, is described in `sixflow.eigenfilters.kernel`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from sixflow.checks import is_whole, number, require
from sixflow.eigenfilters.coordinates import canonical
from sixflow.eigenfilters.geometry import Geometry, Real
from sixflow.eigenfilters.kernel import Kernel
from sixflow.eigenfilters.window import Window, gaussian, log_gaussian
from sixflow.errors import InputError

HYPERBOLIC_PAIRS = {"stretch": ("L_b", "L_s"), "shear": ("L_B", "L_s")}


@dataclass(frozen=True)
class Gabor(Kernel):
    """Gabor pair: a plane wave under a Gaussian, for translation (Eagleson, §4.2).

    w = gain · exp(−(x² + y²)/(2σ²)) [exp(−i(ux + vy)) − dc],  (u, v) = frequency · (cos, sin) of orientation

    Parameters
    ----------
    frequency : float
        |(u, v)|, rad/px, above 0 and at most π; the wavelength is 2π/frequency.
    orientation : float
        Direction of the wave vector, rad, from x (right) towards y (down).
    sigma : float
        Standard deviation σ of the Gaussian, px, at least 0.5.
    shape : {"quadrature", "equal-dc"}
        "quadrature": cosine and sine, of which the cosine is made free of DC. "equal-dc": the pair
        cos(ux + vy − π/4), cos(ux + vy + π/4) of §4.2, mirror images with the same response to a constant
        and the same amplitude spectrum; no DC is removed. (As
        corrected here: equal DC is not none. A uniform patch has the phase π/4, to which the phase of a pattern
        on a bright ground is drawn; that of the quadrature pair, free of DC, is not.)

    Raises
    ------
    InputError
        If a parameter is outside its range.

    Examples
    --------
    >>> import numpy as np
    >>> w = Gabor(0.5, 0.0, sigma=6.0).sample(21)
    >>> w.shape, bool(abs(w.sum()) < 1e-12), round(float((np.abs(w) ** 2).sum()), 12)
    ((43, 43), True, 1.0)
    """

    frequency: float
    orientation: float = 0.0
    sigma: float = 6.0
    shape: Literal["quadrature", "equal-dc"] = "quadrature"

    def __post_init__(self) -> None:
        _number(self, "frequency", least=1e-6, most=math.pi, unit="rad/px")
        _number(self, "orientation", unit="rad")
        _number(self, "sigma", least=0.5, unit="px")
        if self.shape not in ("quadrature", "equal-dc"):
            raise InputError(f"shape={self.shape!r}: must be 'quadrature' or 'equal-dc'")

    @property
    def generators(self) -> tuple[str, str]:
        """(L_x, L_y)."""
        return "L_x", "L_y"

    @property
    def orders(self) -> tuple[float, float]:
        """Wave vector (u, v), rad/px."""
        return self.frequency * math.cos(self.orientation), self.frequency * math.sin(self.orientation)

    @property
    def label(self) -> str:
        """Family, wavelength and orientation."""
        period = f"{2 * math.pi / self.frequency:.3g} px {math.degrees(self.orientation):.0f}°"
        return f"Gabor {period}" + (" equal DC" if self.shape == "equal-dc" else "")

    @property
    def dc_free(self) -> bool:
        """False for the equal-DC pair."""
        return self.shape == "quadrature"

    @property
    def phase(self) -> float:
        """π/4 for the equal-DC pair."""
        return math.pi / 4 if self.shape == "equal-dc" else 0.0

    def _window(self, x: Real, y: Real, geometry: Geometry) -> Window:
        return gaussian(x, y, self.sigma)


@dataclass(frozen=True)
class Spiral(Kernel):
    """Log-polar wave in a ring, for divergence and curl (Eagleson, §4.3 and §4.3.2): the Mellin–Fourier kernel.

    w = gain · A [exp(−i(u log r + v atan2(y, x))) − dc],  A = r⁻² exp(−log²(r/scale)/(2 bandwidth²))

    u alone measures divergence, v alone curl, both together their combination along a spiral. (As corrected
    here: atan2 for tan⁻¹(y/x), which breaks odd v; and a window that vanishes at r = 0, where the print is
    singular.)

    Parameters
    ----------
    radial : float
        Order u: the phase changes by −u per unit of τ_s = divergence/2.
    angular : int
        Order v, whole, so that the kernel is continuous: the phase changes by −v per rad of rotation τ_r = curl/2.
        u and v must not both be 0.
    scale : float
        Radius where the window is largest, px, at least 1. The wave must be resolved: |(u, v)| < π · scale.
    bandwidth : float
        Standard deviation of the window in log r, 0.05 to 2.
    sigma : float or None
        Standard deviation of a Gaussian in x, y that the window is multiplied by, px; None for none.
    jacobian : bool
        Multiply by the Jacobian 1/r². With a Gaussian in log r this is the kernel of
        scale · exp(−2 bandwidth²) without it, since r⁻² is exponential in log r.

    Raises
    ------
    InputError
        If a parameter is outside its range.

    Examples
    --------
    >>> import numpy as np
    >>> w = Spiral(0.0, 4, scale=8.0).sample(24)
    >>> bool(np.allclose(w[::-1], np.conj(w)))  # y → −y reverses the angle
    True
    """

    radial: float
    angular: int
    scale: float = 8.0
    bandwidth: float = 0.4
    sigma: float | None = None
    jacobian: bool = True

    def __post_init__(self) -> None:
        _number(self, "radial")
        remedy = "must be a whole number, so that the kernel is continuous"
        require(is_whole(self.angular), "angular", self.angular, remedy)
        object.__setattr__(self, "angular", int(self.angular))
        _number(self, "scale", least=1.0, unit="px")
        _require_orders(self, ("radial", self.radial), ("angular", self.angular))
        _check_window(self)

    @property
    def generators(self) -> tuple[str, str]:
        """(L_s, L_r)."""
        return "L_s", "L_r"

    @property
    def orders(self) -> tuple[float, float]:
        """(u, v) of divergence and curl."""
        return self.radial, float(self.angular)

    @property
    def label(self) -> str:
        """Family, orders and scale."""
        return f"spiral u {self.radial:.3g}, v {self.angular}, r {self.scale:.3g} px"

    @property
    def with_jacobian(self) -> bool:
        """The option `jacobian`."""
        return self.jacobian

    def _window(self, x: Real, y: Real, geometry: Geometry) -> Window:
        return log_gaussian(x, y, self.scale, self.bandwidth).times(gaussian(x, y, self.sigma))


@dataclass(frozen=True)
class Hyperbolic(Kernel):
    r"""Wave along hyperbolas in four sectors, for the two shears (Eagleson, §4.4).

    w = gain · A [s exp(−i(uη + vξ)) − dc],  A = |J| exp(−log²(r/scale)/(2 bandwidth²) − η²/(2 width²))

    | generator | η | ξ | Jacobian | sectors centred at |
    |---|---|---|---|---|
    | stretch | ½ log\|x/y\| | ½ log\|xy\| | 1/(2\|xy\|) | 45°, 135°, 225°, 315° |
    | shear | ½ log\|(x+y)/(x−y)\| | ½ log\|x²−y²\| | 1/\|x²−y²\| | 0°, 90°, 180°, 270° |

    (As corrected here: the two shears do not commute, so each is paired with the divergence; the print's
    −½ log(y/x) and tanh⁻¹(y/x) exist in a part of the plane only, and grow without limit towards the singular
    axes, where this kernel vanishes faster than any power.)

    Parameters
    ----------
    generator : {"stretch", "shear"}
        Which of the two.
    u : float
        Order of that shear: the phase changes by −u per unit of τ = stretch/2 or shear/2.
    v : float
        Order of the divergence; u and v must not both be 0.
    scale : float
        Radius where the window is largest, px, at least 1.
    bandwidth : float
        Standard deviation of the window in log r, 0.05 to 2.
    width : float
        Standard deviation of the window in η, 0.05 to 1. Up to about 0.3 the pixels resolve the wave; a wider
        window reaches closer to the singular axes, where its phase turns by u/2 per px at 1 px distance and the
        Jacobian grows.
    signs : four of +1, −1
        Sign s of each sector, in the order of the table: each sector is a domain of its own, so that patterns
        of signs give independent kernels with the same law.
    sigma : float or None
        Standard deviation of a Gaussian in x, y that the window is multiplied by, px; None for none.
    jacobian : bool
        Multiply by the Jacobian.

    Raises
    ------
    InputError
        If a parameter is outside its range.

    Examples
    --------
    >>> import numpy as np
    >>> w = Hyperbolic("stretch", 3.0, scale=8.0).sample(24)
    >>> bool(np.allclose(w.T, np.conj(w)))  # x ↔ y reverses η
    True
    """

    generator: Literal["stretch", "shear"]
    u: float
    v: float = 0.0
    scale: float = 8.0
    bandwidth: float = 0.4
    width: float = 0.3
    signs: tuple[int, int, int, int] = (1, 1, 1, 1)
    sigma: float | None = None
    jacobian: bool = True

    def __post_init__(self) -> None:
        if self.generator not in HYPERBOLIC_PAIRS:
            raise InputError(f"generator={self.generator!r}: must be 'stretch' or 'shear'")
        _number(self, "u")
        _number(self, "v")
        _number(self, "scale", least=1.0, unit="px")
        _number(self, "width", least=0.05, most=1.0)
        _require_orders(self, ("u", self.u), ("v", self.v))
        _check_window(self)
        signs = tuple(self.signs) if isinstance(self.signs, Iterable) else ()
        if len(signs) != 4 or any(sign not in (1, -1) for sign in signs):
            raise InputError(f"signs={self.signs!r}: must be four numbers +1 or -1, one for each sector")
        object.__setattr__(self, "signs", tuple(int(sign) for sign in signs))

    @property
    def generators(self) -> tuple[str, str]:
        """(L_b, L_s) for stretch, (L_B, L_s) for shear."""
        return HYPERBOLIC_PAIRS[self.generator]

    @property
    def orders(self) -> tuple[float, float]:
        """(u, v) of the shear and of divergence."""
        return self.u, self.v

    @property
    def label(self) -> str:
        """Family, orders, scale and signs."""
        signs = "".join("+" if sign > 0 else "−" for sign in self.signs)
        return f"{self.generator} u {self.u:.3g}, v {self.v:.3g}, r {self.scale:.3g} px, {signs}"

    @property
    def with_jacobian(self) -> bool:
        """The option `jacobian`."""
        return self.jacobian

    def _window(self, x: Real, y: Real, geometry: Geometry) -> Window:
        eta = geometry.eta
        across = Window(-(eta**2) / (2 * self.width**2), -eta / self.width**2 * geometry.grad_eta)
        ring = log_gaussian(x, y, self.scale, self.bandwidth)
        return ring.times(across).times(gaussian(x, y, self.sigma))

    def _signs(self, x: Real, y: Real) -> Real:
        sector = canonical(*self.generators).sector(x, y)
        return np.where(sector < 0, 0.0, np.array(self.signs, np.float64)[sector])


def _number(kernel: Any, name: str, *, unit: str = "", **limits: float) -> None:
    """Make an attribute a finite float within its range (`sixflow.checks.number`), −0 as 0."""
    object.__setattr__(kernel, name, number(name, getattr(kernel, name), unit=unit, **limits) + 0.0)


def _check_window(kernel: Spiral | Hyperbolic) -> None:
    _number(kernel, "bandwidth", least=0.05, most=2.0)
    if kernel.sigma is not None:
        _number(kernel, "sigma", least=0.5, unit="px")
    if not isinstance(kernel.jacobian, bool | np.bool_):
        raise InputError(f"jacobian={kernel.jacobian!r}: must be True or False")
    object.__setattr__(kernel, "jacobian", bool(kernel.jacobian))


def _require_orders(kernel: Spiral | Hyperbolic, *orders: tuple[str, float]) -> None:
    """At least one order is not 0, and the wave is resolved at the scale."""
    size = math.hypot(*(value for _, value in orders))
    seen = ", ".join(f"{name}={value!r}" for name, value in orders)
    if size == 0:
        raise InputError(f"{seen}: must not both be 0; an order of 0 measures nothing")
    if size >= math.pi * kernel.scale:
        raise InputError(
            f"{seen}: the wave is finer than the pixels at scale={kernel.scale!r}; lower the order below "
            f"{math.pi * kernel.scale:.3g}, or raise the scale"
        )
