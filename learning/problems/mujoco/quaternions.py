"""Unit quaternions in arrays, and their tangent space, compiled.

A quaternion q = (w, x, y, z) begins at ``start`` of an array; a small turn phi about its own axes adds T(q) phi to it,
with T(q) (4, 3) half of q's product with the three imaginary units.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from swimmer_mj.learning.problems.mujoco.library import OPTIONS

__all__ = ["add_from_tangent", "to_tangent", "turned"]

Array = NDArray[np.float64]


@njit(**OPTIONS)
def turned(q: Array, start: int, axis: int, angle: float) -> None:
    """q := q (1, angle/2 e_axis), the unit quaternion at ``start`` turned about its own axis by a small angle."""
    w, x, y, z = q[start], q[start + 1], q[start + 2], q[start + 3]
    h = angle / 2
    if axis == 0:
        q[start], q[start + 1], q[start + 2], q[start + 3] = w - h * x, x + h * w, y + h * z, z - h * y
    elif axis == 1:
        q[start], q[start + 1], q[start + 2], q[start + 3] = w - h * y, x - h * z, y + h * w, z + h * x
    else:
        q[start], q[start + 1], q[start + 2], q[start + 3] = w - h * z, x + h * y, y - h * x, z + h * w


@njit(**OPTIONS)
def to_tangent(q: Array, start: int, g: Array, row: int, axis: int) -> float:
    """Component ``axis`` of T(q)^T g, with g in rows row .. row + 3."""
    w, x, y, z = q[start], q[start + 1], q[start + 2], q[start + 3]
    a, b, c, d = g[row], g[row + 1], g[row + 2], g[row + 3]
    if axis == 0:
        return (-x * a + w * b + z * c - y * d) / 2
    if axis == 1:
        return (-y * a - z * b + w * c + x * d) / 2
    return (-z * a + y * b - x * c + w * d) / 2


@njit(**OPTIONS)
def add_from_tangent(q: Array, start: int, axis: int, h: float, out: Array, row: int) -> None:
    """Add T(q) h e_axis to rows row .. row + 3 of ``out``."""
    w, x, y, z = q[start], q[start + 1], q[start + 2], q[start + 3]
    h = h / 2
    if axis == 0:
        out[row], out[row + 1] = out[row] - h * x, out[row + 1] + h * w
        out[row + 2], out[row + 3] = out[row + 2] + h * z, out[row + 3] - h * y
    elif axis == 1:
        out[row], out[row + 1] = out[row] - h * y, out[row + 1] - h * z
        out[row + 2], out[row + 3] = out[row + 2] + h * w, out[row + 3] + h * x
    else:
        out[row], out[row + 1] = out[row] - h * z, out[row + 1] + h * y
        out[row + 2], out[row + 3] = out[row + 2] - h * x, out[row + 3] + h * w
