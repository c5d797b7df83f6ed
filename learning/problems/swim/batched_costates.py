"""The swimmer's transposed Jacobian for many trajectories at once, compiled, and the targets that it makes.

(df/dx)^T costate at held torques comes by reverse differentiation written out by hand: exact, for about twice the price
of the equations, :mod:`~swimmer_mj.learning.problems.swim.batched_equations`, whose layout of arrays it shares.
"""

# pyright: reportCallIssue=false
# numba gives its intrinsics their first argument, the typing context, itself.

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from swimmer_mj.compiled.cache import entry_point
from swimmer_mj.compiled.vectors import LANES, OPTIONS, load, splat, store
from swimmer_mj.learning.problems.swim.batched_equations import Workspace, derivative, factor, solve
from swimmer_mj.learning.problems.swim.reduced import ReducedConstants

__all__ = ["pullback", "targets"]

Array = NDArray[np.float64]


@njit(forceinline=True, **OPTIONS)
def _through_forces(
    constants: ReducedConstants,
    costate: Array,
    N: int,
    start: int,
    at: Array,
    c: Array,
    s: Array,
    cosine: Array,
    F: Array,
    mu: Array,
    d_normal: Array,
    d_x: Array,
) -> None:
    """Adjoints of the normal velocities, and what they and the frictions, held, leave for d_x.

    Friction F_i moves the centre of mass and turns the links; it comes from the normal velocity of link i.
    """
    C, _, drag, rotational_drag, total_mass = constants
    n = drag.size
    vx, vy = 2 * n * LANES, (2 * n + 1) * LANES
    costate_x = load(costate, 2 * n * N + start) / total_mass
    costate_y = load(costate, (2 * n + 1) * N + start) / total_mass
    v_x, v_y = load(at, vx), load(at, vy)
    d_v_x = d_v_y = splat(0.0)
    for i in range(n):
        cos_i, sin_i, F_i = load(c, i * LANES), load(s, i * LANES), load(F, i * LANES)
        d_F = cos_i * costate_y - sin_i * costate_x
        for j in range(n):
            d_F = d_F + C[i, j] * (load(cosine, (i * n + j) * LANES) * load(mu, j * LANES))
        d_v = -drag[i] * d_F
        store(d_normal, i * LANES, d_v)
        d_sin = -(F_i * costate_x) - v_x * d_v
        d_cos = F_i * costate_y + v_y * d_v
        store(d_x, i * LANES, cos_i * d_sin - sin_i * d_cos)
        turned = load(costate, i * N + start) - rotational_drag[i] * load(mu, i * LANES)
        store(d_x, (n + i) * LANES, turned)
        d_v_x = d_v_x - sin_i * d_v
        d_v_y = d_v_y + cos_i * d_v
    store(d_x, vx, d_v_x)
    store(d_x, vy, d_v_y)


@njit(forceinline=True, **OPTIONS)
def _through_angles(
    constants: ReducedConstants,
    at: Array,
    cosine: Array,
    sine: Array,
    F: Array,
    f: Array,
    mu: Array,
    d_normal: Array,
    d_x: Array,
) -> None:
    """Add to d_x what comes through the angles between links: inertia, centrifugal terms, normal velocities."""
    C, K, _, _, _ = constants
    n = K.shape[0]
    for i in range(n):
        w, F_i = load(at, (n + i) * LANES), load(F, i * LANES)
        mu_i, d_v = load(mu, i * LANES), load(d_normal, i * LANES)
        turn, d_w = splat(0.0), load(d_x, (n + i) * LANES)
        for j in range(n):
            cos_ij, sin_ij = load(cosine, (i * n + j) * LANES), load(sine, (i * n + j) * LANES)
            mu_j, w_j = load(mu, j * LANES), load(at, (n + j) * LANES)
            # -K_ij sin(theta_j - theta_i) theta'_i^2 is part of Q_j.
            pull = K[i, j] * (w * mu_j)
            d_w = d_w + 2.0 * (pull * sin_ij)
            d_cosine = C[i, j] * (F_i * mu_j + d_v * w_j) - K[i, j] * (mu_i * load(f, (n + j) * LANES))
            twist = cos_ij * (pull * w) - sin_ij * d_cosine
            turn = turn + twist
            store(d_x, j * LANES, load(d_x, j * LANES) - twist)
            d_w = d_w + C[j, i] * (cos_ij * load(d_normal, j * LANES))
        store(d_x, (n + i) * LANES, d_w)
        store(d_x, i * LANES, load(d_x, i * LANES) + turn)


@njit(**OPTIONS)
def _pullback(
    ws: Workspace,
    constants: ReducedConstants,
    x: Array,
    u: Array,
    dt: float,
    costate: Array,
    out: Array,
    d_u: Array,
) -> None:
    """As :func:`pullback`. A name with ``d_`` is the adjoint of the quantity behind it, its effect on costate . f."""
    c, s, F, mu, d_normal, cosine, sine, A, at, d_x, _, f, torque = ws
    n, N = constants.K.shape[0], x.shape[1]
    for start in range(0, N, LANES):
        for i in range(x.shape[0]):
            store(at, i * LANES, load(x, i * N + start))
        for k in range(u.shape[0]):
            store(torque, k * LANES, load(u, k * N + start))
        factor(constants.K, at, c, s, cosine, sine, A)
        derivative(constants, at, torque, c, s, cosine, sine, A, F, f)
        # theta'' = A^-1 Q: the adjoint of Q is mu = A^-1 (costate of theta'), that of A is -mu theta''^T.
        for j in range(n):
            store(mu, j * LANES, load(costate, (n + j) * N + start))
        solve(n, A, mu)
        _through_forces(constants, costate, N, start, at, c, s, cosine, F, mu, d_normal, d_x)
        _through_angles(constants, at, cosine, sine, F, f, mu, d_normal, d_x)
        for i in range(x.shape[0]):
            store(out, i * N + start, load(costate, i * N + start) + dt * load(d_x, i * LANES))
        for k in range(d_u.shape[0]):
            store(d_u, k * N + start, dt * (load(mu, (k + 1) * LANES) - load(mu, k * LANES)))


@entry_point(**OPTIONS)
def pullback(
    ws: Workspace,
    constants: ReducedConstants,
    x: Array,
    u: Array,
    dt: float,
    costate: Array,
    out: Array,
    d_u: Array,
) -> None:
    """out (p, N) = (dy/dx)^T costate and d_u (q, N) = (dy/du)^T costate, for an Euler step from x (p, N) to y.

    The torques u (q, N) are held in it. Where nobody asks for d_u, it has shape (0, N).
    """
    _pullback(ws, constants, x, u, dt, costate, out, d_u)


@entry_point(**OPTIONS)
def targets(
    ws: Workspace,
    constants: ReducedConstants,
    x: Array,
    u: Array,
    V: Array,
    dVdx: Array,
    dt: float,
    s_gamma: float,
    s_lambda: float,
    out: NDArray[Any],
) -> None:
    """g and G along trajectories, as :func:`swimmer_mj.learning.value_gradient.equations.targets` has them.

    x (T + 1, p, N), u (T, q, N), V (T + 1, N) and dVdx (T + 1, p, N) are given; ``out`` (T, p + 1, N) is filled with
    g, then G.
    """
    T, p, N = u.shape[0], x.shape[1], x.shape[2]
    velocity = p - 2
    l = math.exp(-s_lambda * dt)
    discount = math.exp(-s_gamma * dt)
    G, g, later, none = V[T].copy(), dVdx[T].copy(), np.empty((p, N)), np.empty((0, N))
    for t in range(T - 1, -1, -1):
        for i in range(p):
            for b in range(N):
                later[i, b] = (1 - l) * dVdx[t + 1, i, b] + l * g[i, b]
        _pullback(ws, constants, x[t], u[t], dt, later, g, none)
        for b in range(N):
            G[b] = x[t, velocity, b] * dt + discount * ((1 - l) * V[t + 1, b] + l * G[b])
            out[t, p, b] = G[b]
        for i in range(p):
            for b in range(N):
                g[i, b] = discount * g[i, b] + (dt if i == velocity else 0.0)
                out[t, i, b] = g[i, b]
