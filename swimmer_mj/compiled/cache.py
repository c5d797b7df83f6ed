"""Compiled functions that are kept on disk, so that only the first process waits for the compiler.

numba's own cache would not do: it sees an edit only of the file that defines a function; its index is broken by
processes that write at the same time; it never finds closures again; and the code that it reads can bind to another
function of the same name in the process that reads it, with a wrong result and no message.

Here a function that Python calls (:func:`entry_point`) has one file for each signature and processor. What it calls is
in it, under names that nothing outside can see. The file starts with a stamp of all that the code was made from: the
sources of the package, the functions and numbers of a :class:`~swimmer_mj.compiled.static.Static`, the versions of
numba and its libraries. A file whose stamp or content is not as it should be is compiled anew and replaced. A file is
written under another name first, so that nobody sees half of it.

Files go to NUMBA_CACHE_DIR if it is set, else to ``__pycache__`` beside this file, else to numba's directory of the
user. If none can be written, nothing is kept.
"""

# pyright: reportAttributeAccessIssue=false
# (numba fills its config when it is imported.)
from __future__ import annotations

import os
import pickle
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cached_property, update_wrapper
from importlib.metadata import version
from pathlib import Path
from typing import Any, Generic, ParamSpec, TypeVar

from llvmlite.binding import parse_assembly
from numba import config, njit
from numba.core.caching import NullCache
from numba.core.compiler import CompileResult
from numba.core.serialize import dumps
from numba.misc.appdirs import AppDirs

from swimmer_mj.compiled.fingerprint import (
    fingerprint,
    package_hash,
    sha256,
    source_hash,
)
from swimmer_mj.compiled.static import StaticType
from swimmer_mj.files import replacing

__all__ = ["EntryPoint", "directory", "entry_point"]

P = ParamSpec("P")
R = TypeVar("R")

CODE_OPTIONS = ("OPT", "LOOP_VECTORIZE", "SLP_VECTORIZE", "BOUNDSCHECK", "DEBUGINFO_DEFAULT", "USING_SVML")
"""Settings of numba that change the code it makes, besides the processor's name and features."""


class EntryPoint(Generic[P, R]):
    """A compiled function that Python calls; compiled code cannot call it."""

    def __init__(self, function: Callable[P, R], options: dict[str, Any]) -> None:
        if config.DISABLE_JIT:
            raise ValueError(
                "NUMBA_DISABLE_JIT is set, and there is no other form of compiled code; unset it"
            )
        update_wrapper(self, function)
        self.dispatcher: Any = njit(**options)(function)
        self.dispatcher._cache = _DiskCache(function)

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> R:
        """Run it, after compiling it or reading it from disk if that was not done for arguments of such types."""
        return self.dispatcher(*args, **kwargs)

    def address(self, *kinds: Any) -> int:
        """Where it is as a C function, for arguments of numba's types ``kinds``; it stays there."""
        self.dispatcher.compile(kinds)
        result = self.dispatcher.overloads[kinds]
        return result.library.get_pointer_to_function(result.fndesc.llvm_cfunc_wrapper_name)


def entry_point(**options: Any) -> Callable[[Callable[P, R]], EntryPoint[P, R]]:
    """As ``numba.njit(**options)``, for a function that Python calls: the result is kept on disk."""
    return lambda function: EntryPoint(function, options)


def directory() -> Path:
    """Where compiled code is kept."""
    if config.CACHE_DIR:
        return Path(config.CACHE_DIR)
    beside = Path(__file__).with_name("__pycache__")
    if os.access(beside if beside.exists() else beside.parent, os.W_OK):
        return beside
    return Path(AppDirs("numba", appauthor=False).user_cache_dir)


class _DiskCache(NullCache):
    """numba's interface of a cache, for one function."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function

    @cached_property
    def _sources(self) -> list[str]:
        of_function = fingerprint(self._function)
        files = sorted(source_hash(file) for file in of_function.files)
        packages = [package_hash(file) for file in (__file__, self._function.__code__.co_filename)]
        return [of_function.digest, *files, *packages]

    def _place(self, signature: Any, codegen: Any) -> tuple[Path, str] | None:
        """The file of a signature and its stamp; None if this cannot be told from others of its kind."""
        function, kinds = self._function, []
        stamp = [
            *self._sources,
            str(signature),
            *(f"{name} {getattr(config, name, '')}" for name in CODE_OPTIONS),
        ]
        stamp += [f"{name} {version(name)}" for name in ("numba", "llvmlite", "numpy")] + [sys.version]
        for kind in signature:
            kinds.append(str(kind))
            if isinstance(kind, StaticType):
                if kind.fingerprint is None:
                    return None
                kinds[-1] = kind.fingerprint.name
                stamp += [source_hash(file) for file in sorted(kind.fingerprint.files)]
            elif " at 0x" in kinds[-1]:
                return None
        key = (
            function.__module__,
            function.__qualname__,
            kinds,
            codegen.magic_tuple(),
            sys.implementation.cache_tag,
        )
        name = f"{function.__name__}-{sha256(repr(key).encode())[:32]}.code"
        return directory() / name, sha256(repr(stamp).encode())

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """numba's result of compiling for arguments of these types, from disk; None if it is not there."""
        target_context.refresh()
        place = self._place(sig, target_context.codegen())
        if place is None:
            return None
        path, stamp = place
        try:
            head, content = path.read_bytes().split(b"\n", 1)
        except (OSError, ValueError):
            return None
        if head.decode(errors="replace") != f"{stamp} {sha256(content)}":
            return None
        try:
            return CompileResult._rebuild(target_context, *pickle.loads(content))
        except ModuleNotFoundError:  # numba below 0.62 looks for the module of a function that it made itself
            return None

    def save_overload(self, sig: Any, cres: Any) -> None:
        """Keep ``cres``, numba's result of compiling for arguments of these types."""
        place = self._place(sig, cres.codegen)
        if place is None or cres.library.has_dynamic_globals or cres.lifted:
            return
        path, stamp = place
        _, *rest = cres._reduce()
        content = dumps(((cres.library.name, "object", _object_code(cres)), *rest))
        with suppress(OSError), replacing(path) as partial:
            partial.write_bytes(f"{stamp} {sha256(content)}\n".encode() + content)


def _object_code(result: Any) -> tuple[bytes, bytes]:
    """Object code of a compiled function and all that it calls, and a module that says which names are seen in it.

    These are its own alone. numba numbers functions of one name by turns, so that closures of different content may
    have one name in two processes, and the linker would take the one that it saw first.
    """
    f = result.fndesc
    seen = {f.llvm_func_name, f.llvm_cpython_wrapper_name, f.llvm_cfunc_wrapper_name}
    module = result.library._final_module.clone()
    for function in module.functions:
        if not function.is_declaration and function.name not in seen:
            function.linkage = "internal"
    names = "".join(f'define void @"{name}"() {{ ret void }}\n' for name in sorted(seen))
    return result.codegen._tm.emit_object(module), parse_assembly(names).as_bitcode()
