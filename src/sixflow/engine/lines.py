"""Lines: loops over one-dimensional arrays that kernels share.

An assignment of one slice to another would do, but takes the compiler seconds: it must do for any shape.
"""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from sixflow.engine.compiler import inner


@inner
def copy_line(source: NDArray[Any], out: NDArray[Any], n: int) -> None:
    """out[x] = source[x] for x < n."""
    for x in range(n):
        out[x] = source[x]


@inner
def fill_line(out: NDArray[Any], first: int, last: int, value: float) -> None:
    """out[first … last] = value."""
    number = out.dtype.type(value)
    for x in range(first, last):
        out[x] = number


@inner
def add_taps(
    source: NDArray[Any], offsets: NDArray[Any], weights: NDArray[Any], out: NDArray[Any], n: int
) -> None:
    """out[x] += Σ_t weights[t] · source[offsets[t] + x] for x < n; all arrays are lines.

    Four taps at a time, one output and four inputs a loop: with more, the compiler no longer proves that they do not
    overlap, and writes scalar code.
    """
    fours = offsets.size - offsets.size % 4
    s = out[:n]
    for t in range(0, fours, 4):
        a, b, c, d = offsets[t], offsets[t + 1], offsets[t + 2], offsets[t + 3]
        f0, f1, f2, f3 = source[a : a + n], source[b : b + n], source[c : c + n], source[d : d + n]
        w0, w1, w2, w3 = weights[t], weights[t + 1], weights[t + 2], weights[t + 3]
        for x in range(n):
            s[x] += (w0 * f0[x] + w1 * f1[x]) + (w2 * f2[x] + w3 * f3[x])
    for t in range(fours, offsets.size):
        f, w = source[offsets[t] : offsets[t] + n], weights[t]
        for x in range(n):
            s[x] += w * f[x]
