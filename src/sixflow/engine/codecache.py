"""Machine code on disk: it is used again only for exactly what it was compiled from.

A kernel contains the code of the kernels that it calls, and the values of the constants that it reads, wherever they
are defined. Numba's own cache looks at the kernel's own file only. Here the names of the stored files hold a digest of

- the byte code, constants and default arguments of the kernel, and of the cells it closes over,
- the same of every kernel or function that it calls,
- the values of every global that it reads,
- the options of the compiler,

so that code made from anything else is never found, not even by processes that run different versions at one time.
Files of earlier versions are removed when there are more than a few. Whatever goes wrong with the files (a folder
that cannot be written, a full disk, a damaged file) leads to a compilation in memory, never to an error.

Code that is found is used without the rest of the compiler. Numba would first load all that it can compile, which
takes longer than the first measurement. What the code really needs are the addresses of a few functions, whose names
are stored with it; only where one of them is not known yet is the rest loaded.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from llvmlite.binding import address_of_symbol
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile
from numba.core.runtime import rtsys

VERSIONS = 4
"""Versions of a kernel that are kept: for programs that run side by side, or that are switched between."""


def kept_on_disk(compiled: Any, options: str) -> None:
    """Let a function that numba compiles keep its machine code on disk.

    Parameters
    ----------
    compiled : dispatcher of numba
        Nothing is done for a plain function, which is what there is when compilation is switched off.
    options : str
        Of the compiler, in words.
    """
    if hasattr(compiled, "enable_caching"):
        compiled._cache = CodeCache(compiled.py_func, options)


class StoredCode(CompileResultCacheImpl):
    """What is stored of a compiled kernel: the names of the functions that its code calls, and the code."""

    def reduce(self, result: Any) -> tuple[tuple[str, ...], Any]:
        """Return what is to be stored."""
        library = result.library
        return tuple(sorted(_called(library._get_module_for_linking()))), super().reduce(result)

    def rebuild(self, context: Any, stored: tuple[tuple[str, ...], Any]) -> Any:
        """Return what was compiled, of what was stored."""
        names, code = stored
        rtsys.initialize(context)  # the functions for memory, of all kernels
        if any(address_of_symbol(name) is None for name in names):
            context.refresh()
        return super().rebuild(context, code)


def _called(module: Any) -> Iterator[str]:
    """Names of the functions that a module of LLVM leaves to be found, other than LLVM's own."""
    for function in module.functions:
        if function.is_declaration and not function.name.startswith("llvm."):
            yield function.name


class CodeCache(FunctionCache):
    """The stored machine code of one kernel. Most kernels are called by others, and never look for theirs."""

    _impl_class = StoredCode

    def __init__(self, function: Any, options: str) -> None:
        self._py_func, self._options, self._settled = function, options, False

    @property
    def cache_path(self) -> str | None:
        """The folder, or None where there is none to write to."""
        with contextlib.suppress(RuntimeError, OSError):
            self._settle()
        return self._cache_path if self._settled else None

    def load_overload(self, signature: Any, context: Any) -> Any:
        """Return the stored code for a signature, or None."""
        try:
            self._settle()
            return self._load_overload(signature, context)
        except Exception:  # whatever a damaged file leads to
            return None

    def save_overload(self, signature: Any, data: Any) -> None:
        """Store the code for a signature, if that is possible."""
        with contextlib.suppress(Exception):  # as above
            self._settle()
            try:
                super().save_overload(signature, data)
            except Exception:
                self._cache_file.flush()  # begins a new index in place of a damaged one
                super().save_overload(signature, data)
            self._remove_earlier()

    def signatures(self) -> list[Any]:
        """Return the signatures for which there is code."""
        try:
            self._settle()
            return [key[0] for key in self._cache_file._load_index()]
        except Exception:  # as above
            return []

    def _settle(self) -> None:
        """Choose the files. When a kernel is first called, all that it refers to has been defined."""
        if not self._settled:
            super().__init__(self._py_func)
            digest = source_digest(self._py_func, self._options)
            base = f"{self._impl.filename_base}-{digest}"
            self._cache_file = IndexDataCacheFile(self._cache_path, base, digest)
            self._settled = True

    def _remove_earlier(self) -> None:
        name, _, version = self._impl.filename_base.rpartition(
            "-"
        )  # which goes on with the line and Python's version
        ours = re.compile(
            re.escape(name) + r"-\d+" + re.escape(version[version.find(".") :]) + r"-([0-9a-f]{16})\..*"
        )
        latest: dict[str, float] = {}
        files = []
        for entry in os.scandir(self._cache_path):
            match = ours.fullmatch(entry.name)
            if match:
                files.append((match[1], entry.path))
                latest[match[1]] = max(latest.get(match[1], 0.0), entry.stat().st_mtime)
        kept = sorted(latest, key=lambda digest: latest[digest])[-VERSIONS:]
        for digest, path in files:
            if digest not in kept:
                Path(path).unlink(missing_ok=True)


def source_digest(function: Any, options: str = "") -> str:
    """Return a digest of everything that the machine code of a function is made from.

    Parameters
    ----------
    function : function
        As it was before compilation.
    options : str
        Of the compiler.

    Examples
    --------
    >>> scale = 2.0
    >>> def twice(x):
    ...     return scale * x
    >>> before = source_digest(twice)
    >>> scale = 3.0
    >>> source_digest(twice) == before
    False
    """
    digest = hashlib.sha256(options.encode())
    for part in _of_function(function, set()):
        digest.update(len(part).to_bytes(8, "little") + part)
    return digest.hexdigest()[:16]


def _of_function(function: types.FunctionType, seen: set[int]) -> Iterator[bytes]:
    if id(function) in seen:
        return
    seen.add(id(function))
    yield from _of_code(function.__code__)
    for default in function.__defaults__ or ():
        yield from _of_value(default, (), seen)
    names = tuple(_names(function.__code__))
    for cell in function.__closure__ or ():
        yield from _of_value(cell.cell_contents, names, seen)
    for name in names:
        if name in function.__globals__:
            yield name.encode()
            yield from _of_value(function.__globals__[name], names, seen)


def _of_code(code: types.CodeType) -> Iterator[bytes]:
    yield code.co_code
    yield repr((code.co_names, code.co_varnames, code.co_freevars, code.co_argcount)).encode()
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            yield from _of_code(constant)
        else:
            yield _plain(constant)


def _names(code: types.CodeType) -> Iterator[str]:
    """Names of globals and attributes in a function and those defined in it."""
    yield from code.co_names
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            yield from _names(constant)


def _of_value(value: Any, names: tuple[str, ...], seen: set[int]) -> Iterator[bytes]:
    """Parts of a value that a kernel reads: code, if it calls it; of a module of ours, what it may take from it."""
    function = getattr(
        value, "py_func", getattr(value, "__wrapped__", value)
    )  # a kernel; vector instructions
    if isinstance(function, types.FunctionType):
        yield from _of_function(function, seen)
    elif isinstance(value, types.ModuleType):
        yield value.__name__.encode()
        if value.__name__.partition(".")[0] == __name__.partition(".")[0] and id(value) not in seen:
            seen.add(id(value))
            for name in names:
                if name in vars(value):
                    yield name.encode()
                    yield from _of_value(vars(value)[name], names, seen)
    elif isinstance(value, np.ndarray):
        yield f"{value.dtype.str} {value.shape}".encode()
        yield np.ascontiguousarray(value).tobytes()
    elif isinstance(value, tuple | list):
        for item in value:
            yield from _of_value(item, names, seen)
    else:
        yield _plain(value)


def _plain(value: Any) -> bytes:
    """A constant as bytes, the same in every process."""
    if isinstance(value, frozenset):
        return repr(sorted(map(repr, value))).encode()
    if isinstance(value, tuple):
        return b"(" + b",".join(map(_plain, value)) + b")"
    if value is None or isinstance(value, bool | int | float | complex | str | bytes | np.generic):
        return repr(value).encode()
    named = value if isinstance(value, type) else type(value)
    return f"{named.__module__}.{getattr(value, '__qualname__', named.__qualname__)}".encode()
