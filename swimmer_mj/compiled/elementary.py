"""Elementary functions of numbers and vectors that LLVM inlines: cosine and sine in float64, tanh in float32.

tanh is a rational function, x P(x^2) / Q(x^2), with an absolute error below 5e-7. Coefficients: ``ptanh_float`` of
Eigen 3.4 (MathFunctionsImpl.h). The three functions here are one, but for the order of operations, and so for the last
bits:

- :func:`tanh_of_one` is for a chain of neurons, each of which waits for the one before: its polynomials are summed by
  pairs (Estrin's scheme), so that few operations wait for each other;
- :func:`tanh_of_lanes` is the same for such a chain in each lane of a vector;
- :func:`tanh_of_many` is for vectors that do not wait for each other: term after term (Horner's scheme), which takes
  the fewest operations.
"""

# pyright: reportCallIssue=false
# numba gives its intrinsics their first argument, the typing context, itself.

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from swimmer_mj.compiled.vectors import FAST, clamp, floor, nearest

__all__ = ["cos_sin", "cos_sin_of_lanes", "tanh_of_lanes", "tanh_of_many", "tanh_of_one"]

TWO_OVER_PI = 2 / math.pi

LIMIT = np.float32(7.90531110763549805)
"""From here on, tanh is taken for constant: 1 less 2.4e-7."""

P = (
    np.float32(4.89352455891786e-03),
    np.float32(6.37261928875436e-04),
    np.float32(1.48572235717979e-05),
    np.float32(5.12229709037114e-08),
    np.float32(-8.60467152213735e-11),
    np.float32(2.00018790482477e-13),
    np.float32(-2.76076847742355e-16),
)
Q = (
    np.float32(4.89352518554385e-03),
    np.float32(2.26843463243900e-03),
    np.float32(1.18534705686654e-04),
    np.float32(1.19825839466702e-06),
)


@njit(fastmath=FAST, error_model="numpy", inline="always")
def _reduce_angle(x: Any, k: Any) -> Any:
    """x - k pi / 2, of a number or a vector, with pi / 2 in three parts (Cody and Waite)."""
    return ((x - k * 1.5707963267341256) - k * 6.077100506303966e-11) - k * 2.0222662487959506e-21


@njit(fastmath=FAST, error_model="numpy", inline="always")
def cos_sin(x: float) -> tuple[float, float]:
    """Cosine and sine of ``x`` (float64), each within 1e-15 for abs(x) < 1e5; no branch, so that loops vectorise.

    Reduction by multiples of pi / 2, then the polynomials of degrees 14 and 13 on [-pi/4, pi/4] whose coefficients are
    those of fdlibm (k_cos.c, k_sin.c).
    """
    k = np.rint(x * TWO_OVER_PI)
    r = _reduce_angle(x, k)
    w = r * r
    cosine = 1.0 - (
        0.5 * w
        - w
        * w
        * (
            4.16666666666666019037e-02
            + w
            * (
                -1.38888888888741095749e-03
                + w
                * (
                    2.48015872894767294178e-05
                    + w
                    * (
                        -2.75573143513906633035e-07
                        + w * (2.08757232129817482790e-09 - w * 1.13596475577881948265e-11)
                    )
                )
            )
        )
    )
    sine = r + r * w * (
        -1.66666666666666324348e-01
        + w
        * (
            8.33333333332248946124e-03
            + w
            * (
                -1.98412698298579493134e-04
                + w
                * (
                    2.75573137070700676789e-06
                    + w * (-2.50507602534068634195e-08 + w * 1.58969099521155010221e-10)
                )
            )
        )
    )
    quadrant = int(k) & 3
    swapped = (quadrant & 1) != 0
    c = sine if swapped else cosine
    s = cosine if swapped else sine
    return (-c if quadrant == 1 or quadrant == 2 else c), (-s if quadrant >= 2 else s)


@njit(fastmath=FAST, error_model="numpy")
def cos_sin_of_lanes(x: Any) -> Any:
    """cos(x) and sin(x) of a vector of float64, to 3e-16 for abs(x) < 1e5.

    x = k pi / 2 + r with abs(r) <= pi / 4, then the minimax polynomials of the Cephes library (sin.c) for r.
    Those of :func:`cos_sin` differ in the last bits.
    """
    k = nearest(x * TWO_OVER_PI)
    r = _reduce_angle(x, k)
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
    half_turns = floor(0.5 * k)
    odd = k - 2.0 * half_turns
    even = 1.0 - odd
    flip = 1.0 - 2.0 * (half_turns - 2.0 * floor(0.5 * half_turns))
    return flip * (even * c - odd * s), flip * (even * s + odd * c)


@njit(fastmath=FAST, error_model="numpy", inline="always")
def _by_pairs(s: Any) -> Any:
    """P(s) and Q(s), of a number or a vector."""
    s2 = s * s
    p = (P[0] + s * P[1]) + s2 * (P[2] + s * P[3]) + (s2 * s2) * (P[4] + s * P[5] + s2 * P[6])
    q = (Q[0] + s * Q[1]) + s2 * (Q[2] + s * Q[3])
    return p, q


@njit(fastmath=FAST, error_model="numpy", inline="always")
def tanh_of_one(x: np.float32) -> np.float32:
    """tanh of a number."""
    p, q = _by_pairs(min(x * x, LIMIT * LIMIT))
    x = min(max(x, -LIMIT), LIMIT)
    return (x * p) * (np.float32(1.0) / q)


@njit(fastmath=FAST, error_model="numpy", forceinline=True)
def tanh_of_lanes(x: Any) -> Any:
    """tanh of each lane, soon."""
    p, q = _by_pairs(clamp(x * x, np.float32(0.0), LIMIT * LIMIT))
    return clamp(x, -LIMIT, LIMIT) * p / q


@njit(fastmath=FAST, error_model="numpy")
def tanh_of_many(x: Any) -> Any:
    """tanh of each lane, by few operations."""
    x = clamp(x, -LIMIT, LIMIT)
    s = x * x
    p = P[0] + s * (P[1] + s * (P[2] + s * (P[3] + s * (P[4] + s * (P[5] + s * P[6])))))
    q = Q[0] + s * (Q[1] + s * (Q[2] + s * Q[3]))
    return x * p / q
