"""The swimmer's equations for many trajectories at once, compiled.

They are those of :mod:`~swimmer_mj.learning.problems.swim.reduced`. With the factors of the inertia matrix A at hand,
the greedy control comes cheap: B^T dV/dx = T^T A^-1 dV/dtheta', one more pair of substitutions, without B itself (T is
how torques enter the generalised forces: -u_j + u_{j-1} in row j).

Arrays have trajectories on their last axis, so that one SIMD vector holds the same number of LANES trajectories. All
arrays are float64 and C-contiguous, and the number N of trajectories is a multiple of LANES. The functions are
compiled once for any number of links.
"""

# pyright: reportCallIssue=false
# numba gives its intrinsics their first argument, the typing context, itself.

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from swimmer_mj.compiled.cache import entry_point
from swimmer_mj.compiled.elementary import cos_sin_of_lanes
from swimmer_mj.compiled.vectors import LANES, OPTIONS, aligned_zeros, load, sign, splat, store
from swimmer_mj.learning.problems.swim.reduced import ReducedConstants

__all__ = [
    "Workspace",
    "derivative",
    "derivative_of_lanes",
    "factor",
    "greedy_rk4",
    "greedy_step",
    "responses",
    "rk4",
    "solve",
    "step",
    "workspace",
]

Array = NDArray[np.float64]


class Workspace(NamedTuple):
    """Intermediate results for LANES trajectories: number i of each stands at [i LANES, (i + 1) LANES)."""

    c: Array  # cos theta_i (n)
    s: Array  # sin theta_i (n)
    F: Array  # friction along the normal (n)
    mu: Array  # A^-1 costate (n)
    d_normal: Array  # adjoint of the normal velocities (n)
    cosine: Array  # cos(theta_i - theta_j) (n, n)
    sine: Array  # sin(theta_i - theta_j) (n, n)
    A: Array  # inertia, factored (n, n)
    at: Array  # state (p)
    first: Array  # state at the start of a step, or an adjoint (p)
    total: Array  # state at its end (p)
    f: Array  # derivative (p)
    torque: Array  # (q)


def workspace(n: int) -> Workspace:
    """A workspace for ``n`` links. No two threads may use one at the same time."""
    p = 2 * n + 2
    sizes = (n, n, n, n, n, n * n, n * n, n * n, p, p, p, p, n - 1)
    return Workspace(*(aligned_zeros((size * LANES,), np.float64) for size in sizes))


@njit(**OPTIONS)
def factor(K: Array, x: Array, c: Array, s: Array, cosine: Array, sine: Array, A: Array) -> None:
    """Cos and sin of the angles and of their differences theta_i - theta_j, and A = K cos(..) as L D L^T.

    A gets L below its diagonal, 1 / D on it, L D (transposed) above it.
    """
    n = K.shape[0]
    for i in range(n):
        cos_i, sin_i = cos_sin_of_lanes(load(x, i * LANES))
        store(c, i * LANES, cos_i)
        store(s, i * LANES, sin_i)
        for j in range(i + 1):
            cos_j, sin_j = load(c, j * LANES), load(s, j * LANES)
            cos_ij = cos_i * cos_j + sin_i * sin_j
            sin_ij = sin_i * cos_j - cos_i * sin_j
            store(cosine, (i * n + j) * LANES, cos_ij)
            store(cosine, (j * n + i) * LANES, cos_ij)
            store(sine, (i * n + j) * LANES, sin_ij)
            store(sine, (j * n + i) * LANES, -sin_ij)
            store(A, (i * n + j) * LANES, K[i, j] * cos_ij)
    for j in range(n):
        inverse = 1.0 / load(A, (j * n + j) * LANES)
        store(A, (j * n + j) * LANES, inverse)
        for i in range(j + 1, n):
            a = load(A, (i * n + j) * LANES)
            store(A, (j * n + i) * LANES, a)
            store(A, (i * n + j) * LANES, a * inverse)
        for i in range(j + 1, n):
            ratio = load(A, (i * n + j) * LANES)
            for k in range(j + 1, i + 1):
                o = (i * n + k) * LANES
                store(A, o, load(A, o) - ratio * load(A, (j * n + k) * LANES))


@njit(**OPTIONS)
def solve(n: int, A: Array, y: Array) -> None:
    """y becomes A^-1 y."""
    for i in range(1, n):
        total = load(y, i * LANES)
        for j in range(i):
            total = total - load(A, (i * n + j) * LANES) * load(y, j * LANES)
        store(y, i * LANES, total)
    for i in range(n - 1, -1, -1):
        total = load(y, i * LANES) * load(A, (i * n + i) * LANES)
        for j in range(i + 1, n):
            total = total - load(A, (j * n + i) * LANES) * load(y, j * LANES)
        store(y, i * LANES, total)


@njit(**OPTIONS)
def derivative(
    constants: ReducedConstants,
    x: Array,
    u: Array,
    c: Array,
    s: Array,
    cosine: Array,
    sine: Array,
    A: Array,
    F: Array,
    f: Array,
) -> None:
    """f(x, u) and the frictions F_i along the normals, given what :func:`factor` made."""
    C, K, drag, rotational_drag, total_mass = constants
    n = K.shape[0]
    vx, vy = 2 * n * LANES, (2 * n + 1) * LANES
    force_x = force_y = splat(0.0)
    for i in range(n):
        cos_i, sin_i = load(c, i * LANES), load(s, i * LANES)
        normal_velocity = load(x, vy) * cos_i - load(x, vx) * sin_i
        for j in range(n):
            normal_velocity = normal_velocity + C[i, j] * (
                load(cosine, (i * n + j) * LANES) * load(x, (n + j) * LANES)
            )
        F_i = -drag[i] * normal_velocity
        store(F, i * LANES, F_i)
        force_x = force_x - F_i * sin_i
        force_y = force_y + F_i * cos_i
    theta_ddot = f[n * LANES :]
    for j in range(n):
        Q = -rotational_drag[j] * load(x, (n + j) * LANES)
        if j < n - 1:
            Q = Q - load(u, j * LANES)
        if j > 0:
            Q = Q + load(u, (j - 1) * LANES)
        for i in range(n):
            w = load(x, (n + i) * LANES)
            Q = Q + C[i, j] * (load(F, i * LANES) * load(cosine, (i * n + j) * LANES))
            Q = Q - K[j, i] * (load(sine, (j * n + i) * LANES) * w * w)
        store(theta_ddot, j * LANES, Q)
    solve(n, A, theta_ddot)
    for i in range(n):
        store(f, i * LANES, load(x, (n + i) * LANES))
    store(f, vx, force_x / total_mass)
    store(f, vy, force_y / total_mass)


@njit(**OPTIONS)
def _greedy_control(
    n: int, A: Array, limits: Array, dVdx: Array, N: int, start: int, flips: Array, u: Array, mu: Array
) -> None:
    """U sign(B^T dV/dx) times ``flips``, of a block."""
    for j in range(n):
        store(mu, j * LANES, load(dVdx, (n + j) * N + start))
    solve(n, A, mu)
    for k in range(n - 1):
        gain = load(mu, (k + 1) * LANES) - load(mu, k * LANES)
        store(u, k * LANES, limits[k] * (sign(gain) * load(flips, k * N + start)))


@njit(**OPTIONS)
def _step(
    ws: Workspace,
    constants: ReducedConstants,
    limits: Array,
    x: Array,
    dVdx: Array,
    flips: Array,
    dt: float,
    stages: int,
    greedy: bool,
    u: Array,
    y: Array,
) -> None:
    """Euler (1 stage) or Runge-Kutta (4 stages) step under the greedy control, or under u."""
    c, s, F, mu, _, cosine, sine, A, at, first, total, f, torque = ws
    n = constants.K.shape[0]
    p, q = 2 * n + 2, n - 1
    N = x.shape[1]
    for start in range(0, N, LANES):
        for i in range(p):
            value = load(x, i * N + start)
            store(at, i * LANES, value)
            store(first, i * LANES, value)
            store(total, i * LANES, value)
        if not greedy:
            for k in range(q):
                store(torque, k * LANES, load(u, k * N + start))
        for stage in range(stages):
            factor(constants.K, at, c, s, cosine, sine, A)
            if stage == 0 and greedy:
                _greedy_control(n, A, limits, dVdx, N, start, flips, torque, mu)
            derivative(constants, at, torque, c, s, cosine, sine, A, F, f)
            share = dt if stages == 1 else (dt / 6 if stage in (0, 3) else dt / 3)
            following = dt if stage == 2 else dt / 2
            for i in range(p):
                f_i = load(f, i * LANES)
                store(total, i * LANES, load(total, i * LANES) + share * f_i)
                store(at, i * LANES, load(first, i * LANES) + following * f_i)
        for i in range(p):
            store(y, i * N + start, load(total, i * LANES))
        for k in range(q):
            store(u, k * N + start, load(torque, k * LANES))


@njit(**OPTIONS)
def derivative_of_lanes(
    ws: Workspace, constants: ReducedConstants, limits: Array, x: Array, dVdx: Array, u: Array, f: Array
) -> None:
    """Greedy torques and f = a + B u of LANES states, all arrays laid out as the workspace's."""
    n = constants.K.shape[0]
    factor(constants.K, x, ws.c, ws.s, ws.cosine, ws.sine, ws.A)
    for j in range(n):
        store(ws.mu, j * LANES, load(dVdx, (n + j) * LANES))
    solve(n, ws.A, ws.mu)
    for k in range(n - 1):
        store(u, k * LANES, limits[k] * sign(load(ws.mu, (k + 1) * LANES) - load(ws.mu, k * LANES)))
    derivative(constants, x, u, ws.c, ws.s, ws.cosine, ws.sine, ws.A, ws.F, f)


@entry_point(**OPTIONS)
def greedy_step(
    ws: Workspace,
    constants: ReducedConstants,
    limits: Array,
    x: Array,
    dVdx: Array,
    flips: Array,
    dt: float,
    u: Array,
    y: Array,
) -> None:
    """Greedy torques times ``flips``, and an Euler step of ``dt`` under them.

    Parameters
    ----------
    ws : Workspace
        For this number of links.
    constants : ReducedConstants
        The swimmer.
    limits : ndarray, shape (q,)
        U, N·m.
    x, dVdx : ndarray, shape (p, N)
        States, and the slope of V there.
    flips : ndarray, shape (q, N)
        1, or -1 where the torque is to have the other sign.
    dt : float
        s.
    u : ndarray, shape (q, N)
        Filled with the torques.
    y : ndarray, shape (p, N)
        Filled with the states after the step; may be ``x``.
    """
    _step(ws, constants, limits, x, dVdx, flips, dt, 1, True, u, y)


@entry_point(**OPTIONS)
def greedy_rk4(
    ws: Workspace,
    constants: ReducedConstants,
    limits: Array,
    x: Array,
    dVdx: Array,
    flips: Array,
    dt: float,
    u: Array,
    y: Array,
) -> None:
    """As :func:`greedy_step`, by the classical Runge-Kutta method."""
    _step(ws, constants, limits, x, dVdx, flips, dt, 4, True, u, y)


@entry_point(**OPTIONS)
def step(ws: Workspace, constants: ReducedConstants, x: Array, u: Array, dt: float, y: Array) -> None:
    """y (p, N) is where an Euler step of ``dt`` leads from x (p, N) under the torques u (q, N); may be ``x``."""
    _step(ws, constants, u[:, 0], x, x, u, dt, 1, False, u, y)


@entry_point(**OPTIONS)
def rk4(ws: Workspace, constants: ReducedConstants, x: Array, u: Array, dt: float, y: Array) -> None:
    """As :func:`step`, by the classical Runge-Kutta method."""
    _step(ws, constants, u[:, 0], x, x, u, dt, 4, False, u, y)


@entry_point(**OPTIONS)
def responses(
    ws: Workspace, constants: ReducedConstants, x: Array, dt: float, coast: Array, gain: Array
) -> None:
    """Fill coast (p, N) and gain (q, p, N): an Euler step of ``dt`` from x (p, N) leads to coast + sum_k gain_k u_k."""
    c, s, F, mu, _, cosine, sine, A, at, _, _, f, torque = ws
    n, N = constants.K.shape[0], x.shape[1]
    for start in range(0, N, LANES):
        for i in range(x.shape[0]):
            store(at, i * LANES, load(x, i * N + start))
        for k in range(n - 1):
            store(torque, k * LANES, splat(0.0))
        factor(constants.K, at, c, s, cosine, sine, A)
        derivative(constants, at, torque, c, s, cosine, sine, A, F, f)
        for i in range(x.shape[0]):
            store(coast, i * N + start, load(at, i * LANES) + dt * load(f, i * LANES))
        for k in range(n - 1):
            for j in range(n):
                store(mu, j * LANES, splat(1.0 if j == k + 1 else (-1.0 if j == k else 0.0)))
            solve(n, A, mu)
            row = k * x.shape[0]
            for i in range(x.shape[0]):
                reached = n <= i < 2 * n
                store(gain, (row + i) * N + start, dt * load(mu, (i - n) * LANES) if reached else splat(0.0))
