"""What numba does not offer and tight loops need: small arrays on the stack, and explicit SIMD vectors.

A vector has :data:`LANES` numbers of one floating type. LLVM maps it to whatever registers the processor has
(one of AVX-512 in float32, four of NEON), so that code written with vectors has neither remainder loops nor
the run-time alias checks that keep numba's own vectoriser from being useful on short rows. ``+ - * /`` and the unary
minus work on vectors, and on a vector and a float, in numba functions, lane by lane.
"""

# pyright: reportOptionalCall=false
# numba's decorators carry no types.

from __future__ import annotations

import math
import operator
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.imputils import lower_builtin
from numba.core.typing.templates import AbstractTemplate, infer_global
from numba.extending import intrinsic, models, register_model
from numpy.typing import DTypeLike, NDArray

__all__ = [
    "FAST",
    "LANES",
    "OPTIONS",
    "Vector",
    "add_lanes",
    "aligned_zeros",
    "clamp",
    "convert",
    "floor",
    "load",
    "multiply_add",
    "nearest",
    "round_up",
    "sign",
    "splat",
    "spread",
    "stack_buffer",
    "store",
]

LANES = 16
"""Numbers in a vector; rows that vectors walk along are padded to a multiple of it."""

FAST = {"contract", "nsz", "arcp"}
"""Multiply-adds may be fused; nothing may be assumed of NaN or infinity, nor sums reordered."""

OPTIONS: dict[str, Any] = {"fastmath": FAST, "error_model": "numpy", "nogil": True}
"""How functions are compiled that use vectors."""


def round_up(size: int) -> int:
    """The smallest multiple of :data:`LANES` that is at least ``size``."""
    return -(-size // LANES) * LANES


def aligned_zeros(shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    """Zeros that start at a cache line (64 bytes), as vectors do that are not to straddle two."""
    size = math.prod(shape) * np.dtype(dtype).itemsize
    buffer = np.zeros(size + 64, np.uint8)
    start = -buffer.ctypes.data % 64
    return buffer[start : start + size].view(dtype).reshape(shape)


class Vector(types.Type):
    """Numba type of LANES numbers of type ``dtype``."""

    def __init__(self, dtype: types.Float) -> None:
        self.dtype = dtype
        super().__init__(name=f"Vector({dtype}, {LANES})")


@register_model(Vector)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, dmm: Any, fe_type: Vector) -> None:
        lane = dmm.lookup(fe_type.dtype).get_value_type()
        super().__init__(dmm, fe_type, ir.VectorType(lane, LANES))


def _broadcast(builder: Any, value: Any) -> Any:
    """The LLVM value of a vector with ``value``, a float or a vector already, in every lane."""
    if isinstance(value.type, ir.VectorType):
        return value
    vector, index = ir.VectorType(value.type, LANES), ir.IntType(32)
    undefined = ir.Constant(vector, ir.Undefined)
    first = builder.insert_element(undefined, value, ir.Constant(index, 0))
    return builder.shuffle_vector(first, undefined, ir.Constant(ir.VectorType(index, LANES), [0] * LANES))


def _define(function: Any, instruction: str) -> None:
    """Teach numba ``function`` of two vectors, or of a vector and a float of its type."""

    class _Template(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            vectors = [a for a in args if isinstance(a, Vector)]
            if len(args) != 2 or not vectors:
                return None
            vector = vectors[0]
            if all(a in (vector, vector.dtype) for a in args):
                return vector(*args)
            return None

    infer_global(function)(_Template)

    def lower(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return getattr(builder, instruction)(*(_broadcast(builder, value) for value in args))

    for kinds in ((Vector, Vector), (Vector, types.Float), (types.Float, Vector)):
        lower_builtin(function, *kinds)(lower)


_define(operator.add, "fadd")
_define(operator.sub, "fsub")
_define(operator.mul, "fmul")
_define(operator.truediv, "fdiv")


@infer_global(operator.neg)
class _Negation(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        return args[0](args[0]) if len(args) == 1 and isinstance(args[0], Vector) else None


@lower_builtin(operator.neg, Vector)
def _negate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    return builder.fneg(args[0])


def _address(context: Any, builder: Any, array_type: types.Array, array: Any, offset: Any) -> tuple[Any, int]:
    """Pointer to the vector that starts at flat index ``offset`` of a contiguous array, and its alignment."""
    lane = context.get_value_type(array_type.dtype)
    data = context.make_array(array_type)(context, builder, array).data
    pointer = builder.bitcast(builder.gep(data, [offset]), ir.VectorType(lane, LANES).as_pointer())
    return pointer, context.get_abi_sizeof(lane)


@intrinsic
def load(typing_context: Any, array: Any, offset: Any) -> Any:
    """``load(array, offset)``: the vector ``array.flat[offset : offset + LANES]``."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        pointer, alignment = _address(context, builder, signature.args[0], *args)
        return builder.load(pointer, align=alignment)

    return Vector(array.dtype)(array, types.intp), codegen


@intrinsic
def store(typing_context: Any, array: Any, offset: Any, vector: Any) -> Any:
    """``store(array, offset, vector)``: ``array.flat[offset : offset + LANES] = vector``."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        pointer, alignment = _address(context, builder, signature.args[0], args[0], args[1])
        builder.store(args[2], pointer, align=alignment)
        return context.get_dummy_value()

    return types.void(array, types.intp, vector), codegen


@intrinsic
def splat(typing_context: Any, scalar: Any) -> Any:
    """``splat(scalar)``: the vector with ``scalar`` in every lane."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return _broadcast(builder, args[0])

    return Vector(scalar)(scalar), codegen


@intrinsic
def spread(typing_context: Any, array: Any, offset: Any) -> Any:
    """``spread(array, offset)``: ``array.flat[offset]``, ``offset`` not negative, in every lane."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        data = context.make_array(signature.args[0])(context, builder, args[0]).data
        return _broadcast(builder, builder.load(builder.gep(data, [args[1]])))

    return Vector(array.dtype)(array, types.intp), codegen


@intrinsic
def convert(typing_context: Any, vector: Any, like: Any) -> Any:
    """``convert(vector, like)``: the vector with lanes of the type of the float ``like``."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        target = ir.VectorType(context.get_value_type(like), LANES)
        if target == args[0].type:
            return args[0]
        narrower = isinstance(target.element, ir.FloatType)
        return (builder.fptrunc if narrower else builder.fpext)(args[0], target)

    return Vector(like)(vector, like), codegen


@intrinsic
def clamp(typing_context: Any, a: Any, low: Any, high: Any) -> Any:
    """``clamp(a, low, high)``: a, or the bound that it is beyond, lane by lane; bounds are vectors or floats."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        value, low, high = (_broadcast(builder, arg) for arg in args)
        value = builder.select(builder.fcmp_ordered("<", value, low), low, value)
        return builder.select(builder.fcmp_ordered(">", value, high), high, value)

    return a(a, low, high), codegen


@intrinsic
def sign(typing_context: Any, a: Any) -> Any:
    """``sign(a)``: 1, -1 or 0, lane by lane."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        vector = args[0].type
        zero, one, minus = (ir.Constant(vector, [x] * LANES) for x in (0.0, 1.0, -1.0))
        below = builder.select(builder.fcmp_ordered("<", args[0], zero), minus, zero)
        return builder.select(builder.fcmp_ordered(">", args[0], zero), one, below)

    return a(a), codegen


def _unary(name: str) -> Any:
    """An LLVM intrinsic of one vector."""

    @intrinsic
    def call(typing_context: Any, a: Any) -> Any:
        def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            vector = args[0].type
            suffix = "f32" if isinstance(vector.element, ir.FloatType) else "f64"
            kind = ir.FunctionType(vector, [vector])
            function = cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.v{LANES}{suffix}")
            return builder.call(function, args)

        return a(a), codegen

    return call


floor = _unary("floor")
nearest = _unary("rint")


@intrinsic
def multiply_add(typing_context: Any, a: Any, b: Any, c: Any) -> Any:
    """``multiply_add(a, b, c)``: a * b + c, lane by lane, rounded once."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        vector = args[0].type
        suffix = "f32" if isinstance(vector.element, ir.FloatType) else "f64"
        fma = cgutils.get_or_insert_function(
            builder.module, ir.FunctionType(vector, [vector] * 3), f"llvm.fma.v{LANES}{suffix}"
        )
        return builder.call(fma, args)

    return a(a, a, a), codegen


@intrinsic
def add_lanes(typing_context: Any, vector: Any) -> Any:
    """``add_lanes(vector)``: the sum of its lanes, by halves."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        total = args[0]
        index = ir.IntType(32)
        width = LANES
        while width > 1:
            width //= 2
            low, high = (
                builder.shuffle_vector(
                    total,
                    ir.Constant(total.type, ir.Undefined),
                    ir.Constant(ir.VectorType(index, width), list(range(start, start + width))),
                )
                for start in (0, width)
            )
            total = builder.fadd(low, high)
        return builder.extract_element(total, ir.Constant(index, 0))

    return vector.dtype(vector), codegen


@intrinsic
def stack_buffer(typing_context: Any, size: Any) -> Any:
    """``stack_buffer(size)``: pointer to ``size`` (a constant) float64 on the stack, for ``numba.carray``.

    Lives as long as the calling function; not initialised. Once loops over it are unrolled, LLVM keeps its
    numbers in registers.
    """
    if not isinstance(size, types.IntegerLiteral):
        return None

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        with builder.goto_entry_block():
            buffer = builder.alloca(ir.ArrayType(ir.DoubleType(), size.literal_value))
            buffer.align = 64
        return builder.bitcast(buffer, ir.DoubleType().as_pointer())

    return types.CPointer(types.float64)(size), codegen
