"""What compiled code needs of C: what stands at an address, functions at addresses, sums that no thread can split.

An address is a 64-bit integer. Where a length is given, NUMBA_BOUNDSCHECK=1 has it kept to.
"""

# pyright: reportAttributeAccessIssue=false, reportPrivateImportUsage=false, reportCallIssue=false
# (numba carries no types.)
from __future__ import annotations

import inspect
from typing import Any

from llvmlite import ir
from numba import config, types
from numba.core import cgutils
from numba.extending import intrinsic

__all__ = [
    "address_of",
    "attempt",
    "call",
    "fetch_add",
    "load",
    "load_symbol",
    "load_vector",
    "pointer",
    "store",
    "store_vector",
]


@intrinsic
def pointer(typing_context: Any, address: Any) -> Any:
    """An address as a pointer, for :func:`numba.carray`."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.inttoptr(args[0], cgutils.voidptr_t)

    return types.voidptr(types.int64), codegen


@intrinsic
def address_of(typing_context: Any, pointer: Any) -> Any:
    """The address that a pointer holds."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.ptrtoint(args[0], ir.IntType(64))

    return types.int64(pointer), codegen


def _place(context: Any, builder: Any, kind: Any, address: Any, i: Any, length: Any) -> Any:
    """The pointer to element ``i`` of an array of numba's type ``kind``."""
    if config.BOUNDSCHECK:
        with cgutils.if_unlikely(builder, builder.icmp_unsigned(">=", i, length)):
            context.call_conv.return_user_exc(builder, IndexError, ("index beyond the array",))
    base = builder.inttoptr(address, context.get_value_type(kind).as_pointer())
    return builder.gep(base, [i], inbounds=True)


@intrinsic
def load(typing_context: Any, dtype: Any, address: Any, i: Any, length: Any) -> Any:
    """Element ``i`` of the array of ``length`` numbers at an address."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.load(_place(context, builder, dtype.dtype, *args[1:]))

    return dtype.dtype(dtype, types.int64, types.int64, types.int64), codegen


@intrinsic
def store(typing_context: Any, dtype: Any, address: Any, i: Any, length: Any, value: Any) -> Any:
    """Set element ``i`` of the array of ``length`` numbers at an address."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        builder.store(args[4], _place(context, builder, dtype.dtype, *args[1:4]))
        return context.get_dummy_value()

    return types.void(dtype, types.int64, types.int64, types.int64, dtype.dtype), codegen


def _vector() -> Any:
    return types.UniTuple(types.float64, 3)


@intrinsic
def load_vector(typing_context: Any, address: Any, i: Any, length: Any) -> Any:
    """Row ``i`` of the array of ``length`` rows of three doubles at an address, as a tuple."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.load(_place(context, builder, _vector(), *args))

    return _vector()(types.int64, types.int64, types.int64), codegen


@intrinsic
def store_vector(typing_context: Any, address: Any, i: Any, length: Any, vector: Any) -> Any:
    """Set row ``i`` of the array of ``length`` rows of three doubles at an address."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        builder.store(args[3], _place(context, builder, _vector(), *args[:3]))
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.int64, _vector()), codegen


@intrinsic
def call(typing_context: Any, result: Any, address: Any, arguments: Any) -> Any:
    """Call a C function at an address with a tuple of pointers, addresses and int32s, which stand for C's ints.

    ``result`` is the type of what it returns, a class of NumPy's, or None if it returns nothing.
    """
    returned = types.void if isinstance(result, types.NoneType) else result.dtype

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        def passed(a: Any) -> Any:
            if isinstance(a.type, ir.IntType):
                return a if a.type.width == 32 else builder.inttoptr(a, cgutils.voidptr_t)
            return builder.bitcast(a, cgutils.voidptr_t)

        values = [passed(a) for a in cgutils.unpack_tuple(builder, args[2])]
        kind = ir.VoidType() if returned == types.void else context.get_value_type(returned)
        function = ir.FunctionType(kind, [value.type for value in values])
        value = builder.call(builder.inttoptr(args[1], function.as_pointer()), values)
        return context.get_dummy_value() if returned == types.void else value

    return returned(result, types.int64, arguments), codegen


@intrinsic
def fetch_add(typing_context: Any, address: Any, increment: Any) -> Any:
    """Add to the 64-bit integer at an address, which no other thread can come between; what it was before."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        place = builder.inttoptr(args[0], ir.IntType(64).as_pointer())
        return builder.atomic_rmw("add", place, args[1], "seq_cst")

    return types.int64(types.int64, types.int64), codegen


@intrinsic(prefer_literal=True)
def load_symbol(typing_context: Any, symbol: Any) -> Any:
    """The 64-bit integer at a symbol, a literal string that ``llvmlite.binding.add_symbol`` gave an address."""
    name = symbol.literal_value

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        known = builder.module.globals
        place = known[name] if name in known else ir.GlobalVariable(builder.module, ir.IntType(64), name)
        return builder.load(place)

    return types.int64(symbol), codegen


@intrinsic
def attempt(typing_context: Any, form: Any, first: Any, address: Any) -> Any:
    """Call ``form.function`` with ``first`` and as many doubles, from an address on, as it takes more.

    Parameters
    ----------
    form : Static
        Its ``function`` is a compiled one.
    first
    address : int

    Returns
    -------
    raised : bool
        Whether it raised an exception, which goes no further.
    value
        What it returned; zeros if it raised.
    """
    function = form.fields["function"]
    n = len(inspect.signature(function.py_func).parameters) - 1
    arguments = (first, *[types.float64] * n)
    function.compile(arguments)
    returned = function.overloads[arguments].signature.return_type

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        compiled = function.overloads[arguments]
        context.active_code_library.add_linking_library(compiled.library)
        place = builder.inttoptr(args[2], ir.DoubleType().as_pointer())
        doubles = [builder.load(cgutils.gep_inbounds(builder, place, i)) for i in range(n)]
        status, value = context.call_internal_no_propagate(
            builder, compiled.fndesc, compiled.signature, [args[1], *doubles]
        )
        return context.make_tuple(builder, signature.return_type, (status.is_error, value))

    return types.Tuple((types.boolean, returned))(form, first, types.int64), codegen
