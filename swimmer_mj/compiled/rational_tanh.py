"""tanh in float32 by a rational function, x P(x^2) / Q(x^2), with an absolute error below 5e-7.

Coefficients: ``ptanh_float`` of Eigen 3.4 (MathFunctionsImpl.h). The three functions here are one, but for the order of
operations, and so for the last bits:

- :func:`tanh_of_one` is for a chain of neurons, each of which waits for the one before: its polynomials are summed by
  pairs (Estrin's scheme), so that few operations wait for each other;
- :func:`tanh_of_lanes` is the same for such a chain in each lane of a vector;
- :func:`tanh_of_many` is for vectors that do not wait for each other: term after term (Horner's scheme), which takes
  the fewest operations.
"""

# pyright: reportCallIssue=false
# numba gives its intrinsics their first argument, the typing context, itself.

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from swimmer_mj.compiled.vectors import FAST, clamp

__all__ = ["tanh_of_lanes", "tanh_of_many", "tanh_of_one"]

LIMIT = np.float32(7.90531110763549805)
"""From here on, tanh is 1 in float32."""

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
