"""How kernels are compiled: without Python's lock, free to reorder sums but not to ignore NaN, and kept on disk
(`engine.codecache`).
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from typing import Any, TypeVar, cast

import numba
from numba.core import event

from sixflow.engine.codecache import kept_on_disk

Kernel = TypeVar("Kernel", bound=Callable[..., Any])

_FAST = ("arcp", "contract", "nsz", "reassoc")
_OPTIONS: dict[str, Any] = {
    "nogil": True, "error_model": "numpy", "fastmath": set(_FAST), "no_cfunc_wrapper": True,
}  # fmt: skip
_KERNELS: list[Any] = []


def kernel(function: Kernel) -> Kernel:
    """Compile `function` on first use for the types it meets, and keep the machine code on disk."""
    return _compiled(function, _OPTIONS)


def inner(function: Kernel) -> Kernel:
    """Compile `function` as `kernel` does, for other kernels alone: Python cannot call it.

    What passes arguments and results between Python and machine code takes most of the compilation of a small kernel.
    """
    return _compiled(function, {**_OPTIONS, "no_cpython_wrapper": True})


def _compiled(function: Kernel, options: dict[str, Any]) -> Kernel:
    compiled = numba.njit(**options)(function)
    kept_on_disk(compiled, repr((_FAST, _OPTIONS["nogil"], _OPTIONS["error_model"])))
    _compile_once_for_constants(compiled)
    _KERNELS.append(compiled)
    return cast(Kernel, compiled)


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


class _Finished(event.Listener):
    """Hears of every kernel of ours that has been compiled."""

    def __init__(self, call: Callable[[], None]) -> None:
        self._call = call

    def on_start(self, event: Any) -> None:
        """Nothing is to be done."""

    def on_end(self, event: Any) -> None:
        """Tell whoever wants to know."""
        if any(event.data["dispatcher"] is one for one in _KERNELS):
            self._call()


@contextlib.contextmanager
def watched(call: Callable[[], None]) -> Iterator[None]:
    """Call a function, without arguments, whenever a kernel has been compiled."""
    with event.install_listener("numba:compile", _Finished(call)):
        yield


def folders() -> list[str]:
    """Return the folders that hold the machine code; none where no folder can be written to."""
    paths = (getattr(getattr(k, "_cache", None), "cache_path", None) for k in _KERNELS)
    return sorted({path for path in paths if path})


def missing(dtype: str = "float32") -> int:
    """Return how many kernels have no machine code on disk for images of a type.

    Parameters
    ----------
    dtype : {"float32", "float64"}
        Type that images are computed in.
    """
    return sum(not _is_stored(k, dtype) for k in _KERNELS)


def needs_compiling(dtype: str = "float32") -> bool:
    """Tell whether the kernels of a plain measurement have no machine code on disk for images of a type: the first
    one will take long.

    Parameters
    ----------
    dtype : {"float32", "float64"}
        Type that images are computed in.
    """
    # a plain measurement uses about half of them, some in both types
    return 3 * (len(_KERNELS) - missing(dtype)) < len(_KERNELS)


def _is_stored(compiled: Any, dtype: str) -> bool:
    """Look for a kernel in the index that numba keeps; where there is none to look into, expect no
    compilation.
    """
    signatures = getattr(getattr(compiled, "_cache", None), "signatures", None)
    if signatures is None:
        return True
    types = [_image_types(found) for found in signatures()]
    single = "float32"
    return any((single in found) == (dtype == single) for found in types if found & {single, "float64"})


def _image_types(arguments: tuple[Any, ...]) -> set[str]:
    """Types of the elements of arrays among the types of arguments, also of those in tuples."""
    found = set()
    for argument in arguments:
        inside = getattr(argument, "types", None)
        found |= {str(getattr(argument, "dtype", ""))} if inside is None else _image_types(tuple(inside))
    return found
