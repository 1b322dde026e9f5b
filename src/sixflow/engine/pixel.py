"""Pixel: the B-spline sum of one pixel, all taps of a row side by side.

The taps of neighbouring pixels begin at whatever place the displacement says, so that a loop over pixels cannot be
made vector code. The taps of one pixel do lie side by side, but the compiler unrolls so short a loop. Here the vector
instructions are written out, in LLVM's terms: each row of taps is one load of eight values (four for cubic), and the
weights along x are polynomials of the fraction, evaluated for all taps at once.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

_FLAGS = ("contract", "reassoc", "nsz", "arcp")
Table = NDArray[np.float64]
LANES = {4: 4, 6: 8}
"""Values that are loaded for so many taps. Of eight, the first and the last have the weight 0."""


def _polynomials(taps: int) -> Table:
    """Coefficients of the weights as polynomials of the fraction; shape (powers, lanes)."""
    f = Polynomial([0.0, 1.0])
    e = 1 - f
    if taps == 4:
        cubic = [e**3, 4 - 6 * f**2 + 3 * f**3, 4 - 6 * e**2 + 3 * e**3, f**3]
        return _table(cubic, 6)

    def near(t: Polynomial) -> Polynomial:
        return 66 - 60 * t**2 + 30 * t**4 - 10 * t**5

    def far(t: Polynomial) -> Polynomial:
        return 26 - 50 * t + 20 * t**2 + 20 * t**3 - 20 * t**4 + 5 * t**5

    nothing = Polynomial([0.0])
    quintic = [nothing, e**5, far(f), near(f), near(e), far(e), f**5, nothing]
    return _table(quintic, 120)


def _table(polynomials: list[Polynomial], divisor: float) -> Table:
    size = max(p.coef.size for p in polynomials)
    return (
        np.stack([np.pad(np.asarray(p.coef, float), (0, size - p.coef.size)) for p in polynomials], axis=1)
        / divisor
    )


def _spline_sum(
    typing: Any, coefficients: Any, start: Any, stride: Any, fraction: Any, weights: Any
) -> tuple[Any, Any]:
    """Σ_j weights[j] Σ_k w_k(fraction) coefficients[start + j·stride + k].

    Parameters
    ----------
    coefficients : array, one-dimensional
    start, stride : int
        The first value that is loaded, and how far rows are apart.
    fraction : float
        Of the position between pixels along x, 0 to 1.
    weights : tuple of 4 or 6 floats
        Of the rows.
    """
    kind, taps = coefficients.dtype, len(weights)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        scalar, lanes = context.get_value_type(kind), LANES[taps]
        vector = ir.VectorType(scalar, lanes)

        def splat(value: Any) -> Any:
            one = builder.insert_element(
                ir.Constant(vector, ir.Undefined), value, ir.Constant(ir.IntType(32), 0)
            )
            return builder.shuffle_vector(
                one, one, ir.Constant(ir.VectorType(ir.IntType(32), lanes), [0] * lanes)
            )

        def multiply_add(a: Any, b: Any, c: Any) -> Any:
            return builder.fadd(builder.fmul(a, b, flags=_FLAGS), c, flags=_FLAGS)

        rows = []
        for j in range(taps):
            index = builder.add(arguments[1], builder.mul(arguments[2], ir.Constant(arguments[2].type, j)))
            place = builder.bitcast(builder.gep(array.data, [index]), vector.as_pointer())
            row = builder.load(place)
            row.align = context.get_abi_sizeof(scalar)
            rows.append((row, splat(builder.extract_value(arguments[4], j))))
        total = builder.fmul(*rows[0], flags=_FLAGS)
        for row, weight in rows[1:]:
            total = multiply_add(row, weight, total)
        table, f = _polynomials(taps), splat(arguments[3])
        share = ir.Constant(vector, [float(c) for c in table[-1]])
        for powers in table[-2::-1]:
            share = multiply_add(share, f, ir.Constant(vector, [float(c) for c in powers]))
        total = builder.fmul(total, share, flags=_FLAGS)
        while lanes > 1:
            lanes //= 2
            mask = ir.VectorType(ir.IntType(32), lanes)
            low = builder.shuffle_vector(total, total, ir.Constant(mask, list(range(lanes))))
            high = builder.shuffle_vector(total, total, ir.Constant(mask, list(range(lanes, 2 * lanes))))
            total = builder.fadd(low, high, flags=_FLAGS)
        return builder.extract_element(total, ir.Constant(ir.IntType(32), 0))

    return kind(coefficients, types.int64, types.int64, kind, types.UniTuple(kind, taps)), generate


spline_sum: Any = intrinsic(_spline_sum)
"""`_spline_sum`, for kernels."""
