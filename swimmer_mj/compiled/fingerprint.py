"""What compiled code is made from, as a text that is the same in every process and changes with it.

A function is its byte code, its constants, what it closes over and the global names that it uses, and so are all
functions that it calls, by their names or as attributes of a module. The walk through them ends at :data:`LIBRARIES`,
whose versions stand for them. It notes the source files it comes through, because it misses what numba finds by other
ways than a name (the implementations of an ``overload``, say).
"""

from __future__ import annotations

import hashlib
import sys
import types
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

__all__ = [
    "LIBRARIES",
    "Fingerprint",
    "UnknownContentError",
    "fingerprint",
    "package_hash",
    "sha256",
    "source_hash",
]

LIBRARIES = ("builtins", "llvmlite", "math", "numba", "numpy")


class UnknownContentError(TypeError):
    """Something that compiled code is made from cannot be told from another of its kind."""


class Fingerprint(NamedTuple):
    """Of something that code is compiled from."""

    digest: str
    """SHA-256 of all of it."""
    name: str
    """What stays the same when its source is edited: names of functions, numbers."""
    files: frozenset[str]
    """Where its functions were written, libraries aside."""


def fingerprint(content: Any) -> Fingerprint:
    """The fingerprint of functions, compiled or not, numbers, strings, arrays, dtypes, and containers of them.

    Raises
    ------
    UnknownContentError
        If anything else is among them, or is used by one of the functions.
    """
    walk = _Walk()
    return Fingerprint(sha256(walk.text(content).encode()), _name(content), frozenset(walk.files))


def sha256(data: bytes) -> str:
    """The hash of ``data``, in hexadecimal."""
    return hashlib.sha256(data).hexdigest()


@lru_cache(maxsize=256)
def source_hash(file: str) -> str:
    """Hash of a source file; empty if there is none, as for code from a prompt."""
    path = Path(file)
    return sha256(path.read_bytes()) if path.is_file() else ""


@lru_cache(maxsize=16)
def package_hash(file: str) -> str:
    """Hash of all Python sources of the outermost package around ``file``."""
    root = Path(file).parent
    if not (root / "__init__.py").is_file():
        return source_hash(file)
    while (root.parent / "__init__.py").is_file():
        root = root.parent
    sources = {str(path.relative_to(root)): source_hash(str(path)) for path in root.rglob("*.py")}
    return sha256(repr(sorted(sources.items())).encode())


def _python_function(value: Any) -> types.FunctionType | None:
    """The function that one of numba's objects was made of, or that ``value`` is; None for anything else."""
    function = value if isinstance(value, types.FunctionType) else getattr(value, "__wrapped__", None)
    return function if isinstance(function, types.FunctionType) else None


def _closed_over(function: types.FunctionType) -> list[Any]:
    return [cell.cell_contents for cell in function.__closure__ or ()]


def _name(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{key}={_name(item)}" for key, item in value.items())
    function = _python_function(value)
    if function is None:
        return repr(value)
    numbers = [item for item in _closed_over(function) if isinstance(item, int | float)]
    return f"{function.__module__}.{function.__qualname__}{numbers}"


class _Walk:
    def __init__(self) -> None:
        self.files: set[str] = set()
        self._seen: dict[int, int] = {}  # functions, in the order in which they turn up

    def text(self, value: Any) -> str:
        """``value`` and all that it uses, written down."""
        match value:
            case None | bool() | int() | float() | complex() | str() | bytes():
                return repr(value)
            case np.generic():
                return f"{value.dtype} {value!r}"
            case np.dtype() if not value.hasobject:
                return repr(value)
            case np.ndarray() if not value.dtype.hasobject:
                return f"{value.dtype} {value.shape} {sha256(value.tobytes())}"
            case tuple() | list():
                return f"({', '.join(map(self.text, value))})"
            case slice():  # among a function's constants from Python 3.14 on
                return f"slice{self.text((value.start, value.stop, value.step))}"
            case set() | frozenset():
                return f"{{{', '.join(sorted(map(self.text, value)))}}}"
            case dict():
                return f"{{{', '.join(f'{key}: {self.text(value[key])}' for key in sorted(value))}}}"
            case types.CodeType():
                return f"{value.co_code!r} {value.co_names} {value.co_varnames} {self.text(value.co_consts)}"
            case type() | types.BuiltinFunctionType() | np.ufunc() | types.ModuleType():
                return self._named(value)
        function = _python_function(value)
        if function is None:
            raise UnknownContentError(f"knows numbers, strings, arrays and functions, not {value!r}")
        return f"{self._function(function)} {self.text(getattr(value, 'targetoptions', None))}"

    def _named(self, value: Any) -> str:
        """A class or a module, for which its module's source stands."""
        module = value.__name__ if isinstance(value, types.ModuleType) else value.__class__.__module__
        module = getattr(value, "__module__", None) or module
        if module.split(".")[0] not in LIBRARIES:
            self.files.add(getattr(sys.modules.get(module), "__file__", None) or "")
        return f"{module} {getattr(value, '__qualname__', value.__name__)}"

    def _function(self, function: types.FunctionType) -> str:
        if (function.__module__ or "").split(".")[0] in LIBRARIES:
            return f"{function.__module__} {function.__qualname__}"
        if id(function) in self._seen:
            return f"function {self._seen[id(function)]}"
        self._seen[id(function)] = len(self._seen)
        code = function.__code__
        self.files.add(code.co_filename)
        names, closed_over = _names(code), _closed_over(function)
        uses = {name: function.__globals__[name] for name in names if name in function.__globals__}
        uses |= _of_modules([*uses.values(), *closed_over], names)
        return self.text((code, closed_over, function.__defaults__, uses))


def _names(code: types.CodeType) -> set[str]:
    """Global names, and attributes, of a function and of those within it."""
    inner = [_names(const) for const in code.co_consts if isinstance(const, types.CodeType)]
    return set(code.co_names).union(*inner)


def _of_modules(values: list[Any], names: set[str]) -> dict[str, Any]:
    """What has one of ``names`` in the modules among ``values``, and in modules found there, by its full name."""
    found: dict[str, Any] = {}
    modules = [value for value in values if isinstance(value, types.ModuleType)]
    for module in modules:  # more come in the loop
        if module.__name__.split(".")[0] in LIBRARIES:
            continue
        for name in names & vars(module).keys():
            full = f"{module.__name__}.{name}"
            if full not in found and isinstance(vars(module)[name], types.ModuleType):
                modules.append(vars(module)[name])
            found[full] = vars(module)[name]
    return found
