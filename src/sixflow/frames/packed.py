"""Packed integers: samples of 9 to 15 bits that lie end to end, most significant bit first (TIFF 6.0).

Cameras write them to save room; each row starts on a byte.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def unpack_rows(data: bytes, rows: int, columns: int, bits: int) -> NDArray[np.uint16]:
    """Return packed rows as uint16, shape (rows, columns).

    Parameters
    ----------
    data : bytes
        At least rows · ⌈columns·bits/8⌉ bytes.
    rows, columns : int
    bits : int
        Bits per sample, 2 to 15.

    Examples
    --------
    >>> unpack_rows(bytes([0x12, 0x3A, 0xBC]), rows=1, columns=2, bits=12).tolist() == [[0x123, 0xABC]]
    True
    """
    stride = -(-columns * bits // 8)
    packed = np.frombuffer(data, dtype=np.uint8, count=rows * stride).reshape(rows, stride)
    samples = np.unpackbits(packed, axis=1, count=columns * bits).reshape(rows, columns, bits)
    words = np.zeros((rows, columns, 16), dtype=np.uint8)
    words[..., 16 - bits :] = samples
    return np.packbits(words, axis=-1).view(">u2")[..., 0].astype(np.uint16)
