"""C functions and numbers in memory, by their addresses, for compiled code.

An address is an ``int64`` that is passed as an argument, so that what is compiled can be kept on disk.
"""

# pyright: reportCallIssue=false
# numba gives its intrinsics their first argument, the typing context, itself.

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

__all__ = ["call", "peek"]


@intrinsic
def call(typing_context: Any, address: Any, arguments: Any) -> Any:
    """``call(address, (x, y))``: call the C function ``void f(x, y)`` at ``address``.

    An int64 may stand for a pointer, an int32 for an int, a float64 for a double. The GIL need not be held.
    """

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        values = cgutils.unpack_tuple(builder, args[1])
        function = ir.FunctionType(ir.VoidType(), [value.type for value in values])
        builder.call(builder.inttoptr(args[0], function.as_pointer()), values)
        return context.get_dummy_value()

    return types.void(types.int64, arguments), codegen


@intrinsic
def peek(typing_context: Any, address: Any) -> Any:
    """The float64 at ``address``."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.load(builder.inttoptr(args[0], ir.DoubleType().as_pointer()))

    return types.float64(types.int64), codegen
