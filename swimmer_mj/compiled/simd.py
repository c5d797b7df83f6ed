"""More for SIMD vectors (:mod:`~swimmer_mj.compiled.vectors`): functions of their lanes, conversion of their type."""

# pyright: reportCallIssue=false
# numba gives its intrinsics their first argument, the typing context, itself.

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic

from swimmer_mj.compiled.vectors import FAST, LANES, TWO_OVER_PI, Vector, broadcast, reduce_angle

__all__ = ["OPTIONS", "convert", "cos_sin", "sign", "spread"]

OPTIONS: dict[str, Any] = {"fastmath": FAST, "error_model": "numpy", "nogil": True, "cache": True}
"""For functions of any size of problem: compiled once, kept on disk."""


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
        return broadcast(builder, builder.load(builder.gep(data, [args[1]])))

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


@njit(fastmath=FAST, error_model="numpy")
def cos_sin(x: Any) -> Any:
    """cos(x) and sin(x) of a vector of float64, to 3e-16 for abs(x) < 1e5.

    x = k pi / 2 + r with abs(r) <= pi / 4, then the minimax polynomials of the Cephes library (sin.c) for r.
    Those of :func:`~swimmer_mj.compiled.vectors.cos_sin` differ in the last bits.
    """
    k = _nearest(x * TWO_OVER_PI)
    r = reduce_angle(x, k)
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
