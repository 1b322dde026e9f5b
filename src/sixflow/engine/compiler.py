"""How kernels are compiled: cached on disk, without Python's lock, free to reorder sums but not to ignore NaN."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

Kernel = TypeVar("Kernel", bound=Callable[..., Any])

_FAST = {"contract", "reassoc", "nsz", "arcp"}
_KERNELS: list[Any] = []


def kernel(function: Kernel) -> Kernel:
    """Compile `function` on first use for the types it meets, and keep the machine code on disk."""
    compiled = numba.njit(nogil=True, cache=True, fastmath=_FAST, error_model="numpy")(function)
    _KERNELS.append(compiled)
    return cast(Kernel, compiled)


def compiled_now() -> int:
    """Return how many kernels this process had to compile, rather than load from disk."""
    return sum(sum(k.stats.cache_misses.values()) for k in _KERNELS)
