"""The swimmer's equations in reduced variables, compiled: what the fused learner integrates.

A.3 determines n + 2 accelerations by a linear system of that size. With the velocity of the centre of mass
as a variable, translation separates from shape and an n x n symmetric positive definite system remains::

    M_total v'  = sum_i F_i
    sum_k K_jk cos(theta_j - theta_k) theta''_k = Q_j - sum_k K_jk sin(theta_j - theta_k) theta'_k^2

where link centres are G_i = G + sum_j C_ij t_j, K = C^T diag(m) C + diag(m l^2 / 12), and the generalised force
Q_j = sum_i (F_i . n_j) C_ij - k theta'_j l_j^3 / 12 - u_j + u_{j-1}. It follows from Lagrange's equations, not from
A.3's force balance; the tests hold the two equal.
"""

# pyright: reportCallIssue=false
# numba gives its intrinsics their first argument, the typing context, itself.

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numba import njit
from numba.np.numpy_support import carray
from numpy.typing import NDArray

from swimmer_mj.compiled.elementary import cos_sin
from swimmer_mj.compiled.vectors import OPTIONS, stack_buffer
from swimmer_mj.parameters import SwimmerParameters

__all__ = ["ReducedConstants", "compile_reduced_dynamics", "reduced_constants"]

Array = NDArray[np.float64]


class ReducedConstants(NamedTuple):
    """What the equations need of the parameters."""

    C: Array
    """dG_i/dt_j, shape (n, n), m: how far along t_j the centre of link i lies from the centre of mass."""
    K: Array
    """Inertia matrix of the straightened chain, shape (n, n), kg·m²."""
    drag: Array
    """k l_i, shape (n,), N·s/m."""
    rotational_drag: Array
    """k l_i^3 / 12, shape (n,), N·m·s."""
    total_mass: float
    """M_total, kg."""


def reduced_constants(parameters: SwimmerParameters) -> ReducedConstants:
    """The constants of the reduced equations."""
    m, l, k = parameters.masses, parameters.lengths, parameters.viscous_friction
    from_A0 = np.tril(np.ones((len(m), len(m))), -1) + np.eye(len(m)) / 2  # G_i - A0 in units of l_j t_j
    C = (from_A0 - m @ from_A0 / m.sum()) * l
    K = C.T @ (m[:, None] * C) + np.diag(m * l**2 / 12)
    return ReducedConstants(C, K, k * l, k * l**3 / 12, float(m.sum()))


@njit(inline="always", **OPTIONS)
def _turn(K: Array, z: Array, c: Array, s: Array, cosine: Array, inertia: Array, centrifugal: Array) -> None:
    """Cosines and sines of the angles; cos(theta_i - theta_j), and K times it, and K sin(theta_i - theta_j)."""
    n = c.size
    for i in range(n):
        c[i], s[i] = cos_sin(z[i])
    for i in range(n):
        for j in range(n):
            cosine[i, j] = c[i] * c[j] + s[i] * s[j]
            inertia[i, j] = K[i, j] * cosine[i, j]
            centrifugal[i, j] = K[i, j] * (s[i] * c[j] - c[i] * s[j])


@njit(inline="always", **OPTIONS)
def _rub(C: Array, drag: Array, z: Array, c: Array, s: Array, cosine: Array, F: Array) -> tuple[float, float]:
    """Friction F_i along the normal n_i = (-sin theta_i, cos theta_i) of each link; returns the sum of all."""
    n = c.size
    vx, vy = z[2 * n], z[2 * n + 1]
    force_x = force_y = 0.0
    for i in range(n):
        normal_velocity = -vx * s[i] + vy * c[i]
        for j in range(n):
            normal_velocity += C[i, j] * cosine[i, j] * z[n + j]
        F[i] = -drag[i] * normal_velocity
        force_x -= F[i] * s[i]
        force_y += F[i] * c[i]
    return force_x, force_y


@njit(inline="always", **OPTIONS)
def _push(
    C: Array, rotational_drag: Array, z: Array, cosine: Array, centrifugal: Array, F: Array, q: Array
) -> None:
    """Right-hand sides: of the drift in the first column of q, of a unit torque of joint k in column k + 1."""
    n = F.size
    for j in range(n):
        moment = -rotational_drag[j] * z[n + j]
        for i in range(n):
            moment += F[i] * C[i, j] * cosine[i, j] - centrifugal[j, i] * z[n + i] * z[n + i]
        q[j, 0] = moment
        for k in range(n - 1):
            q[j, k + 1] = 0.0
    for k in range(n - 1):
        q[k, k + 1] = -1.0
        q[k + 1, k + 1] = 1.0


@njit(inline="always", **OPTIONS)
def _solve(inertia: Array, reciprocal: Array, q: Array) -> None:
    """q becomes inertia^-1 q: elimination without pivoting (it is positive definite), then back substitution."""
    n = reciprocal.size
    for j in range(n):
        reciprocal[j] = 1.0 / inertia[j, j]
        for i in range(j + 1, n):
            ratio = inertia[i, j] * reciprocal[j]
            for k in range(j + 1, i + 1):
                inertia[i, k] -= ratio * inertia[k, j]
            for k in range(n):
                q[i, k] -= ratio * q[j, k]
    for j in range(n - 1, -1, -1):
        for k in range(n):
            q[j, k] *= reciprocal[j]
        for i in range(j):
            for k in range(n):
                q[i, k] -= inertia[j, i] * q[j, k]


MOST_ON_STACK = 64
"""Links whose matrices, 256 KB then, fit on any thread's stack."""


@lru_cache(maxsize=16)
def compile_reduced_dynamics(n: int) -> Callable[..., None]:
    """Compile a(z) and B(z) of n links.

    Returns
    -------
    function ``(constants, z, a, B) -> None``
        For use in compiled code: reads :class:`ReducedConstants` and the reduced state z (2n + 2,); fills the drift
        a (2n + 2,) and the rows of theta'' in the control matrix B (2n + 2, n - 1), the others staying as they are
        (zero). Nothing is allocated, up to :data:`MOST_ON_STACK` links.
    """
    square, on_stack = n * n, n <= MOST_ON_STACK

    @njit(**OPTIONS)
    def drift_and_control_matrix(
        constants: ReducedConstants, z: Array, a: Array, B: Array
    ) -> None:  # pragma: no cover - compiled
        C, K, drag, rotational_drag, total_mass = constants
        if on_stack:  # decided when it is compiled
            c = carray(stack_buffer(square), n)
            s = carray(stack_buffer(square), n)
            F = carray(stack_buffer(square), n)
            reciprocal = carray(stack_buffer(square), n)  # of the pivots
            cosine = carray(stack_buffer(square), (n, n))
            inertia = carray(stack_buffer(square), (n, n))
            centrifugal = carray(stack_buffer(square), (n, n))
            q = carray(stack_buffer(square), (n, n))  # right-hand sides, then accelerations
        else:
            c, s, F, reciprocal = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
            cosine, inertia, centrifugal = np.empty((n, n)), np.empty((n, n)), np.empty((n, n))
            q = np.empty((n, n))
        _turn(K, z, c, s, cosine, inertia, centrifugal)
        force_x, force_y = _rub(C, drag, z, c, s, cosine, F)
        _push(C, rotational_drag, z, cosine, centrifugal, F, q)
        _solve(inertia, reciprocal, q)
        for i in range(n):
            a[i] = z[n + i]
            a[n + i] = q[i, 0]
            for k in range(n - 1):
                B[n + i, k] = q[i, k + 1]
        a[2 * n] = force_x / total_mass
        a[2 * n + 1] = force_y / total_mass

    return drift_and_control_matrix
