"""Arithmetic for the SIMD vectors of :mod:`swimmer_mj.lowlevel`, so that compiled code reads like that of one number.

Once this module is imported, ``+ - * /`` and the unary minus work on vectors, and on a vector and a float, in numba
functions, lane by lane. :func:`cos_sin` and :func:`sign` go with them.
"""

# pyright: reportCallIssue=false, reportOptionalCall=false
# numba gives its intrinsics their first argument, the typing context, itself.

from __future__ import annotations

import operator
from typing import Any

from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.core.imputils import lower_builtin
from numba.core.typing.templates import AbstractTemplate, infer_global
from numba.extending import intrinsic

from swimmer_mj.lowlevel import LANES
from swimmer_mj.lowlevel import _Vector as Vector  # pyright: ignore[reportPrivateUsage]

__all__ = ["clamp", "convert", "cos_sin", "sign", "spread"]


def _broadcast(builder: Any, value: Any) -> Any:
    """A vector with ``value``, a float or a vector already, in every lane."""
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


_floor = _unary("floor")
_nearest = _unary("rint")


@intrinsic
def sign(typing_context: Any, a: Any) -> Any:
    """``sign(a)``: 1, -1 or 0, lane by lane."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        vector = args[0].type
        zero, one, minus = (ir.Constant(vector, [x] * LANES) for x in (0.0, 1.0, -1.0))
        below = builder.select(builder.fcmp_ordered("<", args[0], zero), minus, zero)
        return builder.select(builder.fcmp_ordered(">", args[0], zero), one, below)

    return a(a), codegen


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
def clamp(typing_context: Any, a: Any, limit: Any) -> Any:
    """``clamp(a, limit)``: a where it lies in [-limit, limit], else the nearer end, lane by lane."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        a, high = args[0], _broadcast(builder, args[1])
        low = builder.fneg(high)
        a = builder.select(builder.fcmp_ordered(">", a, high), high, a)
        return builder.select(builder.fcmp_ordered("<", a, low), low, a)

    return a(a, limit), codegen


@njit(error_model="numpy", fastmath={"contract", "nsz", "arcp"})
def cos_sin(x: Any) -> Any:
    """cos(x) and sin(x) of a vector of float64, to 3e-16 for abs(x) < 1e5.

    x = k pi / 2 + r with abs(r) <= pi / 4, then the minimax polynomials of the Cephes library (sin.c) for r.
    """
    k = _nearest(x * 0.6366197723675814)  # 2 / pi
    r = (
        (x - k * 1.5707963267341256) - k * 6.077100506303966e-11
    ) - k * 2.0222662487959506e-21  # pi / 2 in three parts
    z = r * r
    p = z * 1.58962301576546568060e-10 - 2.50507477628578072866e-8
    p = z * p + 2.75573136213857245213e-6
    p = z * p - 1.98412698295895385996e-4
    p = z * p + 8.33333333332211858878e-3
    p = z * p - 1.66666666666666307295e-1
    s = r + r * z * p
    p = z * -1.13585365213876817300e-11 + 2.08757008419747316778e-9
    p = z * p - 2.75573141792967388112e-7
    p = z * p + 2.48015872888517045348e-5
    p = z * p - 1.38888888888730564116e-3
    p = z * p + 4.16666666666665929218e-2
    c = 1.0 - 0.5 * z + z * z * p
    # A quarter turn maps (cos, sin) to (-sin, cos), two of them change both signs.
    half_turns = _floor(0.5 * k)
    odd = k - 2.0 * half_turns
    even = 1.0 - odd
    flip = 1.0 - 2.0 * (half_turns - 2.0 * _floor(0.5 * half_turns))
    return flip * (even * c - odd * s), flip * (even * s + odd * c)
