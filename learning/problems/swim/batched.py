"""The swimmer's equations and their transposed Jacobian for many trajectories at once, compiled.

The equations are those of :mod:`~swimmer_mj.learning.problems.swim.reduced`. With the factors of the inertia
matrix A at hand, two things come cheap that a learner of value gradients asks for at every step:

- the greedy control: B^T dV/dx = T^T A^-1 dV/dtheta', one more pair of substitutions, without B itself (T is how
  torques enter the generalised forces: -u_j + u_{j-1} in row j);
- (df/dx)^T costate at held torques, by reverse differentiation written out by hand: exact, for about twice the price
  of the equations.

Arrays have trajectories on their last axis, so that one SIMD vector holds the same number of LANES trajectories. All
arrays are float64 and C-contiguous, and the number N of trajectories is a multiple of LANES. The functions are
compiled once for any number of links.
"""

# pyright: reportCallIssue=false
# numba gives its intrinsics their first argument, the typing context, itself.

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from swimmer_mj.compiled.cache import entry_point
from swimmer_mj.compiled.elementary import cos_sin_of_lanes
from swimmer_mj.compiled.vectors import LANES, OPTIONS, aligned_zeros, load, sign, splat, store
from swimmer_mj.learning.problems.forms import BatchForm, Encoding, HoldForm
from swimmer_mj.learning.problems.held import Slope, held_control
from swimmer_mj.learning.problems.problem import DT
from swimmer_mj.learning.problems.swim import joints
from swimmer_mj.learning.problems.swim.reduced import ReducedConstants, reduced_constants
from swimmer_mj.learning.problems.swim.swimming import RATE_SCALE, Swimming

__all__ = [
    "Workspace",
    "derivative_of_lanes",
    "greedy_rk4",
    "greedy_step",
    "held",
    "make",
    "pullback",
    "responses",
    "rk4",
    "step",
    "targets",
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
def _factor(K: Array, x: Array, c: Array, s: Array, cosine: Array, sine: Array, A: Array) -> None:
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
def _solve(n: int, A: Array, y: Array) -> None:
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
def _derivative(
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
    """f(x, u) and the frictions F_i along the normals, given what :func:`_factor` made."""
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
    _solve(n, A, theta_ddot)
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
    _solve(n, A, mu)
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
            _factor(constants.K, at, c, s, cosine, sine, A)
            if stage == 0 and greedy:
                _greedy_control(n, A, limits, dVdx, N, start, flips, torque, mu)
            _derivative(constants, at, torque, c, s, cosine, sine, A, F, f)
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
    _factor(constants.K, x, ws.c, ws.s, ws.cosine, ws.sine, ws.A)
    for j in range(n):
        store(ws.mu, j * LANES, load(dVdx, (n + j) * LANES))
    _solve(n, ws.A, ws.mu)
    for k in range(n - 1):
        store(u, k * LANES, limits[k] * sign(load(ws.mu, (k + 1) * LANES) - load(ws.mu, k * LANES)))
    _derivative(constants, x, u, ws.c, ws.s, ws.cosine, ws.sine, ws.A, ws.F, f)


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
        _factor(constants.K, at, c, s, cosine, sine, A)
        _derivative(constants, at, torque, c, s, cosine, sine, A, F, f)
        for i in range(x.shape[0]):
            store(coast, i * N + start, load(at, i * LANES) + dt * load(f, i * LANES))
        for k in range(n - 1):
            for j in range(n):
                store(mu, j * LANES, splat(1.0 if j == k + 1 else (-1.0 if j == k else 0.0)))
            _solve(n, A, mu)
            row = k * x.shape[0]
            for i in range(x.shape[0]):
                reached = n <= i < 2 * n
                store(gain, (row + i) * N + start, dt * load(mu, (i - n) * LANES) if reached else splat(0.0))


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
        _factor(constants.K, at, c, s, cosine, sine, A)
        _derivative(constants, at, torque, c, s, cosine, sine, A, F, f)
        # theta'' = A^-1 Q: the adjoint of Q is mu = A^-1 (costate of theta'), that of A is -mu theta''^T.
        for j in range(n):
            store(mu, j * LANES, load(costate, (n + j) * N + start))
        _solve(n, A, mu)
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


class _Held:
    """Torques that are chosen for where an Euler step leads under them."""

    def __init__(self, problem: Swimming) -> None:
        n = problem.parameters.n_links
        self.ws, self.constants = workspace(n), reduced_constants(problem.parameters)
        self.limits = problem.control_limits

    def control(self, slope_at: Slope, x: Array, duration: float) -> Array:
        """u (q, N) at x (p, N), N a multiple of LANES."""
        coast, gain = np.empty_like(x), np.empty((self.limits.size, *x.shape))
        responses(self.ws, self.constants, x, duration, coast, gain)
        return held_control(slope_at, coast, gain, self.limits, np.zeros((self.limits.size, x.shape[1])))

    def choose(self, slope_at: Slope, x: Array, duration: float | None) -> Array:
        """u (..., q) at x (..., p)."""
        flat = x.reshape(-1, x.shape[-1])
        rows = np.concatenate([flat, np.repeat(flat[-1:], -len(flat) % LANES, axis=0)])
        u = self.control(slope_at, np.ascontiguousarray(rows.T), DT if duration is None else duration)
        return u[:, : len(flat)].T.reshape(*x.shape[:-1], -1)

    def advance(
        self,
        move: Callable[..., None],
        slope_at: Slope,
        x: Array,
        dVdx: Array,
        flips: Array,
        dt: float,
        u: Array,
        y: Array,
    ) -> None:
        """A step by :func:`step` or :func:`rk4`, as a BatchForm's; ``dVdx`` is not asked for."""
        u[:] = flips * self.control(slope_at, x, dt or DT)
        if dt > 0:
            move(self.ws, self.constants, x, u, dt, y)


def held(problem: Swimming) -> HoldForm | None:
    """How torques are chosen that are held; None for the greedy ones of the instant."""
    return HoldForm(_Held(problem).choose) if problem.held else None


def make(problem: Swimming) -> BatchForm | None:
    """The swimmer for batches of trajectories; None with raw angles as inputs, or stepped by RK4."""
    if problem.encoding != "circle" or problem.integrator != "euler":
        return None
    n = problem.parameters.n_links
    angles, linear = np.arange(n), np.arange(n, 2 * n + 2)
    encoding = Encoding(
        angles, angles, n + angles, linear, linear + n, np.array([RATE_SCALE] * n + [1.0, 1.0])
    )
    coordinates = joints.batch_coordinates(problem)
    if coordinates is not None:
        encoding = joints.encoding(n)
    ws, constants = workspace(n), reduced_constants(problem.parameters)
    limits = problem.control_limits
    if problem.held:
        by_hold = _Held(problem)
        euler, exact = partial(by_hold.advance, step), partial(by_hold.advance, rk4)
    else:
        euler = lambda slope_at, *rest: greedy_step(ws, constants, limits, *rest)  # noqa: E731
        exact = lambda slope_at, *rest: greedy_rk4(ws, constants, limits, *rest)  # noqa: E731
    return BatchForm(
        encoding, euler, exact, partial(targets, ws, constants), lambda x, u: x[..., 2 * n, :], coordinates
    )
