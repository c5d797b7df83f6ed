"""Functions and numbers that compiled code knows when it is compiled.

A kernel at module level takes what it is to be compiled for as an argument::

    @njit
    def energy(form, x):
        return form.n * form.potential(x)

    energy(Static(potential=potential, n=5), x)

numba compiles it once for each content. LLVM sees functions, which it can inline, and constants, of whose branches it
keeps the one that is taken: the code is that of a closure over them.
"""

from __future__ import annotations

import weakref
from typing import Any

from numba import typeof, types
from numba.core.imputils import lower_getattr_generic
from numba.core.typing.templates import AttributeTemplate, infer_getattr
from numba.extending import NativeValue, models, register_model, unbox

from swimmer_mj.compiled.fingerprint import Fingerprint, UnknownContentError, fingerprint

__all__ = ["Static", "StaticType"]


class Static:
    """A record of compiled functions, numbers and booleans, all of which are part of its numba type.

    Two records with the same contents have the same type, in every process.
    """

    def __init__(self, **fields: Any) -> None:
        self._numba_type_ = StaticType(fields)

    def __getattr__(self, name: str) -> Any:
        try:
            return self.__dict__["_numba_type_"].fields[name]
        except KeyError:
            raise AttributeError(f"no field {name!r}") from None


class StaticType(types.Type):
    """Numba type of a :class:`Static`."""

    fingerprint: Fingerprint | None
    """Of its fields; None if one of them cannot be told from others of its kind, in another process."""

    def __init__(self, fields: dict[str, Any]) -> None:
        self.fields = fields
        try:
            self.fingerprint = fingerprint(fields)
        except UnknownContentError:
            self.fingerprint = None
        super().__init__(f"Static({self.fingerprint.digest if self.fingerprint else id(fields)})")
        _TYPES.setdefault(self.name, self)

    def __reduce__(self) -> tuple[Any, ...]:
        return _type_of_name, (self.name,)


_TYPES: weakref.WeakValueDictionary[str, StaticType] = weakref.WeakValueDictionary()


def _type_of_name(name: str) -> StaticType:
    """For pickle: whoever reads compiled code has made the types that it asks for."""
    return _TYPES[name]


register_model(StaticType)(models.OpaqueModel)


@unbox(StaticType)
def _unbox(kind: Any, value: Any, c: Any) -> NativeValue:
    return NativeValue(c.context.get_dummy_value())


@infer_getattr
class _FieldTemplate(AttributeTemplate):
    key = StaticType

    def generic_resolve(self, value: StaticType, attr: str) -> Any:
        return typeof(value.fields[attr]) if attr in value.fields else None


@lower_getattr_generic(StaticType)
def _lower_field(context: Any, builder: Any, kind: StaticType, value: Any, attr: str) -> Any:
    field = kind.fields[attr]
    return context.get_constant_generic(builder, typeof(field), field)
