"""How kernels are compiled: cached on disk, without Python's lock, free to reorder sums but not to
ignore NaN.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

Kernel = TypeVar("Kernel", bound=Callable[..., Any])

_FAST = {"contract", "reassoc", "nsz", "arcp"}
_KERNELS: list[Any] = []


def kernel(function: Kernel) -> Kernel:
    """Compile `function` on first use for the types it meets, and keep the machine code on disk."""
    compiled = numba.njit(nogil=True, cache=True, fastmath=_FAST, error_model="numpy")(function)
    _stamp_with_all_sources(compiled)
    _compile_once_for_constants(compiled)
    _KERNELS.append(compiled)
    return cast(Kernel, compiled)


@cache
def _sources_stamp() -> tuple[float, int]:
    """Latest change and total size of the engine's sources."""
    states = [path.stat() for path in Path(__file__).parent.glob("*.py")]
    return max(state.st_mtime for state in states), sum(state.st_size for state in states)


def _stamp_with_all_sources(compiled: Any) -> None:
    """Let stored machine code expire when any source of the engine changes.

    Numba looks at a kernel's own file only, but a kernel contains the code of those that it calls.
    """
    file = getattr(getattr(compiled, "_cache", None), "_cache_file", None)
    stamp = getattr(file, "_source_stamp", None)
    if file is not None and stamp is not None:
        file._source_stamp = (stamp, _sources_stamp())


def _compile_once_for_constants(compiled: Any) -> None:
    """Let a kernel that calls this one with a constant share the machine code for any value of its type.

    Numba would compile it again for every such constant.
    """
    template = getattr(compiled, "get_call_template", None)
    if template is not None:
        compiled.get_call_template = lambda args, kws: template(
            tuple(numba.types.unliteral(a) for a in args),
            {name: numba.types.unliteral(a) for name, a in kws.items()},
        )


def compiled_now() -> int:
    """Return how many kernels this process had to compile, rather than load from disk."""
    return sum(sum(k.stats.cache_misses.values()) for k in _KERNELS)


def needs_compiling(dtype: str = "float32") -> bool:
    """Tell whether most kernels have no machine code on disk for images of a type: the first
    measurement will take long.

    Parameters
    ----------
    dtype : {"float32", "float64"}
        Type that images are computed in.
    """
    ready = [_is_stored(k, dtype) for k in _KERNELS]
    return 2 * sum(ready) < len(ready)


def _is_stored(compiled: Any, dtype: str) -> bool:
    """Look for a kernel in the index that numba keeps; where there is none to look into, expect no
    compilation.
    """
    load = getattr(getattr(getattr(compiled, "_cache", None), "_cache_file", None), "_load_index", None)
    if load is None:
        return True
    types = [{str(getattr(argument, "dtype", "")) for argument in key[0]} for key in load()]
    single = "float32"
    return any((single in found) == (dtype == single) for found in types if found & {single, "float64"})
