"""Huffman: walking through an entropy-coded scan of a JPEG, to see whether it holds exactly its blocks.

Nothing is decoded but lengths: a code word tells how many bits follow it, so that the bits used by all blocks of a scan
are known (ITU-T T.81, annexes F and G). Scans of a sequential JPEG and the first scans of a progressive one are walked.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.compiler import kernel

WHOLE, ENDS_EARLY, NO_CODE, TOO_MANY, OUT_OF_RANGE = range(5)
"""What a walk meets: nothing wrong, the end of the data, bits that are no code word, a 65th coefficient, a mean grey
value that no picture has."""


@kernel
def walk_scan(
    data: NDArray[np.uint8],
    blocks: NDArray[Any],
    units: int,
    words: NDArray[np.uint16],
    limits: NDArray[np.float64],
    first: int,
    last: int,
    shift: int,
) -> tuple[int, int]:
    """Walk through the blocks of a scan, or of one restart interval.

    Parameters
    ----------
    data : uint8 array
        Entropy-coded bytes, without stuffing, followed by four bytes that do not count.
    blocks : int array, shape (blocks per unit,)
        Component of each block of a minimum coded unit.
    units : int
        Number of minimum coded units.
    words : uint16 array, shape (components, 2, 65536)
        For every 16 bits the code word they begin with: 256 times its length plus its symbol, 0 where there is none;
        of DC and of AC coefficients.
    limits : float array, shape (components,)
        Largest quantised DC coefficient.
    first, last : int
        First and last coefficient that the scan holds, in zigzag order.
    shift : int
        Bits of the DC coefficients that the scan leaves to later ones.

    Returns
    -------
    status : int
        `WHOLE`, or what was met.
    used : int
        Bits used.
    """
    size = 8 * (data.size - 4)
    at, run = 0, 0
    mean = np.zeros(limits.size, np.int64)
    for _ in range(units):
        for number in range(blocks.size):
            component = blocks[number]
            index = first
            if first == 0:
                word = words[component, 0, _bits(data, at, 16)]
                if word == 0:
                    return NO_CODE, at
                at += word >> 8
                length = word & 255
                if length > 16 or at + length > size:
                    return ENDS_EARLY, at
                value = _bits(data, at, length)
                if length > 0 and value < 1 << (length - 1):
                    value += 1 - (1 << length)
                at += length
                mean[component] += value << shift
                if abs(mean[component]) > limits[component]:
                    return OUT_OF_RANGE, at
                index = 1
            if run > 0:
                run -= 1
                continue
            while index <= last:
                word = words[component, 1, _bits(data, at, 16)]
                if word == 0:
                    return NO_CODE, at
                at += word >> 8
                skipped, length = (word >> 4) & 15, word & 15
                if length == 0 and skipped < 15:
                    run = (1 << skipped) - 1 + _bits(data, at, skipped)
                    at += skipped
                    index = 64 + last  # the rest of the block, and of `run` more, is zero
                else:
                    index += skipped + 1
                    at += length
                    if index > last + 1:
                        return TOO_MANY, at
                if at > size:
                    return ENDS_EARLY, at
    return (WHOLE, at) if at <= size else (ENDS_EARLY, at)


@kernel
def _bits(data: NDArray[np.uint8], at: int, count: int) -> int:
    """Return up to 16 bits from bit number `at` on; zeros lie beyond the end."""
    byte, value = at >> 3, 0
    for number in range(3):
        value <<= 8
        if byte + number < data.size:
            value |= data[byte + number]
    return (value >> (24 - (at & 7) - count)) & ((1 << count) - 1)
