"""Loops over states that call MuJoCo's own functions, compiled, without the GIL.

A step of the learner's is MuJoCo's: semi-implicit Euler with joint damping taken implicitly, or one of the implicit
integrators. The state, the actuators and what a reward reads are tables of indices and addresses, so that one compiled
function serves all models.

Derivatives are finite differences of that step, of one scalar: with ``later`` the costate after the step and ``rho``
the slope of the reward in what it reads, the gradient in x of later . y(x, u) + rho . readings(x) at held u. A velocity
is moved without computing positions anew, an activation without computing velocities anew, and where a step is implicit
in a fluid, one factor serves for all of them (:mod:`~swimmer_mj.learning.problems.mujoco.implicit`).
"""

# pyright: reportCallIssue=false, reportArgumentType=false
# numba gives its intrinsics their first argument, the typing context, itself.

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from swimmer_mj.compiled.cache import entry_point
from swimmer_mj.compiled.pointers import call, load
from swimmer_mj.learning.problems.mujoco.coordinates import Coordinates
from swimmer_mj.learning.problems.mujoco.implicit import Implicit, bilinear, solve
from swimmer_mj.learning.problems.mujoco.library import Functions

__all__ = [
    "Actuation",
    "Readings",
    "Simulation",
    "choose",
    "drift_and_control_matrix",
    "pull_back",
    "read",
    "respond",
    "step",
]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

NONE, POSITION, VELOCITY = 0, 1, 2
"""What forward_skip leaves out: nothing, what depends on positions, what depends on velocities too."""
PUSH = 1e-3
"""Of a control's limit, how much its response is measured with."""
OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy"}


class Simulation(NamedTuple):
    """One mjData: the addresses of it and of its model, and views of its arrays."""

    model: int
    data: int
    qpos: Array
    qvel: Array
    act: Array
    ctrl: Array
    qacc: Array
    act_dot: Array
    moment: Array
    moment_rownnz: NDArray[np.int32]
    moment_rowadr: NDArray[np.int32]
    moment_colind: NDArray[np.int32]
    length: Array
    """Of actuators."""
    velocity: Array
    """Of actuators."""
    home: Array
    """qpos where a state says nothing."""
    implicit: Implicit


class Actuation(NamedTuple):
    """What the q controls do: ctrl[actuator] = middle + u. Actuators without gain, as of friction, are no controls."""

    actuator: Indices
    middle: Array
    limits: Array
    gain: Array
    """Force per unit of ctrl: gain . (1, length, velocity), (q, 3)."""
    activation: Indices
    """Number of the activation that ctrl drives, or -1."""
    rate: Array
    """d act_dot / d ctrl of it."""


class Readings(NamedTuple):
    """Numbers of mjData besides the state that a reward reads."""

    address: Indices
    """Of each, (r,)."""
    skip_sensors: int
    """1 if no sensor is among them."""


@njit(**OPTIONS)
def _set(sim: Simulation, co: Coordinates, x: Array) -> None:
    """The state x (p,)."""
    sim.qpos[:] = sim.home
    for k in range(co.scalar_row.size):
        sim.qpos[co.scalar_qpos[k]] = x[co.scalar_row[k]]
    for k in range(co.quaternion_row.size):
        for c in range(4):
            sim.qpos[co.quaternion_qpos[k] + c] = x[co.quaternion_row[k] + c]
    for k in range(co.velocity_row.size):
        sim.qvel[co.velocity_dof[k]] = x[co.velocity_row[k]]
    for k in range(co.activation_row.size):
        sim.act[k] = x[co.activation_row[k]]


@njit(**OPTIONS)
def _get(sim: Simulation, co: Coordinates, x: Array) -> None:
    """Fill x (p,); the goal stays."""
    for k in range(co.scalar_row.size):
        x[co.scalar_row[k]] = sim.qpos[co.scalar_qpos[k]]
    for k in range(co.quaternion_row.size):
        for c in range(4):
            x[co.quaternion_row[k] + c] = sim.qpos[co.quaternion_qpos[k] + c]
    for k in range(co.velocity_row.size):
        x[co.velocity_row[k]] = sim.qvel[co.velocity_dof[k]]
    for k in range(co.activation_row.size):
        x[co.activation_row[k]] = sim.act[k]


@njit(**OPTIONS)
def _turned(q: Array, start: int, axis: int, angle: float) -> None:
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
def _to_tangent(q: Array, start: int, g: Array, row: int, axis: int) -> float:
    """Component ``axis`` of T(q)^T g, with g in rows row .. row + 3."""
    w, x, y, z = q[start], q[start + 1], q[start + 2], q[start + 3]
    a, b, c, d = g[row], g[row + 1], g[row + 2], g[row + 3]
    if axis == 0:
        return (-x * a + w * b + z * c - y * d) / 2
    if axis == 1:
        return (-y * a - z * b + w * c + x * d) / 2
    return (-z * a + y * b - x * c + w * d) / 2


@njit(**OPTIONS)
def _add_from_tangent(q: Array, start: int, axis: int, h: float, out: Array, row: int) -> None:
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


@njit(**OPTIONS)
def _hold(sim: Simulation, ac: Actuation, k: int, u: float) -> None:
    """Set control k to u."""
    sim.ctrl[ac.actuator[k]] = ac.middle[k] + u


@njit(**OPTIONS)
def _rest(sim: Simulation, ac: Actuation) -> None:
    """Set all controls to 0."""
    for k in range(ac.middle.size):
        _hold(sim, ac, k, 0.0)


@njit(**OPTIONS)
def _forward(fn: Functions, sim: Simulation, skip: int, skip_sensors: int) -> None:
    call(None, fn.forward_skip, (sim.model, sim.data, np.int32(skip), np.int32(skip_sensors)))


@njit(**OPTIONS)
def _integrate(fn: Functions, sim: Simulation, factored: bool) -> None:
    """A step from the forces of the last forward pass; if ``factored``, by the factor of the step before."""
    call(None, fn.integrate, (sim.model, sim.data, np.int32(factored)))


@njit(**OPTIONS)
def _solve(fn: Functions, sim: Simulation, y: Array, x: Array, count: int) -> None:
    """Rows of x := M^-1 rows of y."""
    call(None, fn.solve_m, (sim.model, sim.data, x.ctypes.data, y.ctypes.data, np.int32(count)))


@njit(**OPTIONS)
def _gain(sim: Simulation, ac: Actuation, k: int) -> float:
    """Force of control k per unit."""
    i = ac.actuator[k]
    return ac.gain[k, 0] + ac.gain[k, 1] * sim.length[i] + ac.gain[k, 2] * sim.velocity[i]


@njit(**OPTIONS)
def _choose(
    fn: Functions,
    sim: Simulation,
    co: Coordinates,
    ac: Actuation,
    slope: Array,
    cost: Array,
    force: Array,
    solved: Array,
    u: Array,
) -> None:
    """Fill u (q,) with the greedy control for dV/dx = ``slope`` (p,): argmax of slope . B u - sum cost u^2."""
    for k in range(co.velocity_row.size):
        force[co.velocity_dof[k]] = slope[co.velocity_row[k]]
    _solve(fn, sim, force, solved, 1)
    for k in range(u.size):
        advantage = 0.0
        if ac.activation[k] >= 0:
            advantage = slope[co.activation_row[ac.activation[k]]] * ac.rate[k]
        else:
            start = sim.moment_rowadr[ac.actuator[k]]
            for j in range(start, start + sim.moment_rownnz[ac.actuator[k]]):
                advantage += sim.moment[j] * solved[sim.moment_colind[j]]
            advantage *= _gain(sim, ac, k)
        if cost[k] > 0:
            u[k] = min(ac.limits[k], max(-ac.limits[k], advantage / (2 * cost[k])))
        else:
            u[k] = ac.limits[k] * np.sign(advantage)


@njit(**OPTIONS)
def _move(fn: Functions, sim: Simulation, steps: int) -> None:
    """Move on by a learner's step if ``steps`` is 0, else by so many of the model's own; sim.ctrl is held."""
    if steps == 0:
        _forward(fn, sim, NONE, 1)
        _integrate(fn, sim, False)
    for _ in range(steps):
        call(None, fn.step, (sim.model, sim.data))


@entry_point(**OPTIONS)
def step(
    fn: Functions,
    sim: Simulation,
    co: Coordinates,
    ac: Actuation,
    x: Array,
    u: Array,
    steps: int,
    first: int,
    last: int,
    y: Array,
) -> None:
    """Columns first .. last of y (p, N), which may be x: x (p, N) after ``steps`` (see _move) with u (q, N) held."""
    now = np.empty(x.shape[0])
    for n in range(first, last):
        now[:] = x[:, n]
        _set(sim, co, now)
        for k in range(u.shape[0]):
            _hold(sim, ac, k, u[k, n])
        _move(fn, sim, steps)
        _get(sim, co, now)
        y[:, n] = now


@entry_point(**OPTIONS)
def choose(
    fn: Functions,
    sim: Simulation,
    co: Coordinates,
    ac: Actuation,
    x: Array,
    slope: Array,
    cost: Array,
    first: int,
    last: int,
    u: Array,
) -> None:
    """Columns first .. last of u (q, N): the greedy control of the instant, for dV/dx = ``slope`` (p, N) at x (p, N).

    ``cost`` (q, N) are the coefficients of u^2.
    """
    p, q = x.shape[0], u.shape[0]
    now, g, c, chosen = np.empty(p), np.empty(p), np.empty(q), np.empty(q)
    force, solved = np.zeros(sim.qvel.size), np.zeros(sim.qvel.size)
    for n in range(first, last):
        now[:], g[:], c[:] = x[:, n], slope[:, n], cost[:, n]
        _set(sim, co, now)
        _rest(sim, ac)
        _forward(fn, sim, NONE, 1)
        _choose(fn, sim, co, ac, g, c, force, solved, chosen)
        u[:, n] = chosen


@entry_point(**OPTIONS)
def respond(
    fn: Functions,
    sim: Simulation,
    co: Coordinates,
    ac: Actuation,
    x: Array,
    first: int,
    last: int,
    coast: Array,
    gain: Array,
) -> None:
    """Columns first .. last: where x (p, N) comes to after a step, by what is held meanwhile.

    ``coast`` (p, N) is filled with the state after controls of 0, ``gain`` (q, p, N) with what a unit of each control
    adds to it. One step is affine in the controls but for quaternions, so that a difference of any size would do.
    """
    now = np.empty(x.shape[0])
    once = sim.implicit.mass.size > 0
    for n in range(first, last):
        now[:] = x[:, n]
        _set(sim, co, now)
        _rest(sim, ac)
        _move(fn, sim, 0)
        _get(sim, co, now)
        coast[:, n] = now
        for k in range(gain.shape[0]):
            now[:] = x[:, n]
            _set(sim, co, now)
            small = PUSH * ac.limits[k]
            _hold(sim, ac, k, small)
            _forward(fn, sim, VELOCITY, 1)  # positions and velocities are as they were
            _integrate(fn, sim, once)
            _hold(sim, ac, k, 0.0)
            _get(sim, co, now)
            gain[k, :, n] = (now - coast[:, n]) / small


@entry_point(**OPTIONS)
def read(
    fn: Functions,
    sim: Simulation,
    co: Coordinates,
    readings: Readings,
    x: Array,
    first: int,
    last: int,
    out: Array,
) -> None:
    """Columns first .. last of ``out`` (r, N): the readings at x (p, N)."""
    now = np.empty(x.shape[0])
    for n in range(first, last):
        now[:] = x[:, n]
        _set(sim, co, now)
        _forward(fn, sim, NONE, readings.skip_sensors)
        for k in range(readings.address.size):
            out[k, n] = load(np.float64, readings.address[k], 0, 1)


@entry_point(**OPTIONS)
def drift_and_control_matrix(
    fn: Functions,
    sim: Simulation,
    co: Coordinates,
    ac: Actuation,
    x: Array,
    first: int,
    last: int,
    a: Array,
    B: Array,
) -> None:
    """Rows first .. last of a (N, p) and B (N, p, q), which start as zeros, at x (N, p)."""
    nv, q = sim.qvel.size, ac.middle.size
    force, solved = np.zeros((q, nv)), np.zeros((q, nv))
    for n in range(first, last):
        _set(sim, co, x[n])
        _rest(sim, ac)
        _forward(fn, sim, NONE, 1)
        for k in range(co.scalar_row.size):
            a[n, co.scalar_row[k]] = sim.qvel[co.scalar_dof[k]]
        for k in range(co.quaternion_row.size):
            for axis in range(3):
                w = sim.qvel[co.quaternion_dof[k] + axis]
                _add_from_tangent(sim.qpos, co.quaternion_qpos[k], axis, w, a[n], co.quaternion_row[k])
        for k in range(co.velocity_row.size):
            a[n, co.velocity_row[k]] = sim.qacc[co.velocity_dof[k]]
        for k in range(co.activation_row.size):
            a[n, co.activation_row[k]] = sim.act_dot[k]
        force[:] = 0
        for i in range(q):
            if ac.activation[i] >= 0:
                B[n, co.activation_row[ac.activation[i]], i] = ac.rate[i]
                continue
            start = sim.moment_rowadr[ac.actuator[i]]
            for j in range(start, start + sim.moment_rownnz[ac.actuator[i]]):
                force[i, sim.moment_colind[j]] += sim.moment[j] * _gain(sim, ac, i)
        _solve(fn, sim, force, solved, q)
        for k in range(co.velocity_row.size):
            for i in range(q):
                if ac.activation[i] < 0:
                    B[n, co.velocity_row[k], i] = solved[i, co.velocity_dof[k]]


class _Base(NamedTuple):
    """Where a step from the state ends, what is read there, and the costate after it in the tangent space."""

    qpos: Array
    qvel: Array
    act: Array
    readings: Array
    of_scalar: Array
    of_quaternion: Array
    of_velocity: Array
    of_activation: Array
    mu: Array
    """A^-1 (costate of the velocity + h times that of the position), where one factor serves for all."""
    a: Array
    """(velocity after the step - velocity) / h."""


@njit(**OPTIONS)
def _begin(fn: Functions, sim: Simulation, readings: Readings, base: _Base) -> None:
    """A step from where the state is: what is read before it, and where it ends."""
    _forward(fn, sim, NONE, readings.skip_sensors)
    for k in range(readings.address.size):
        base.readings[k] = load(np.float64, readings.address[k], 0, 1)
    base.a[:] = sim.qvel
    _integrate(fn, sim, False)
    base.qpos[:], base.qvel[:], base.act[:] = sim.qpos, sim.qvel, sim.act


@njit(**OPTIONS)
def _change(
    fn: Functions,
    sim: Simulation,
    co: Coordinates,
    readings: Readings,
    skip: int,
    base: _Base,
    rho: Array,
    h: float,
    stiff: float,
) -> float:
    """How later . y + rho . readings differs from the base's, from a state that has been moved.

    ``stiff`` is mu . A a of the base, where one factor serves for all.
    """
    _forward(fn, sim, skip, readings.skip_sensors)
    total = 0.0
    for k in range(readings.address.size):
        total += rho[k] * (load(np.float64, readings.address[k], 0, 1) - base.readings[k])
    once = sim.implicit.mass.size > 0
    _integrate(fn, sim, once)
    if once and skip != VELOCITY:
        total -= h * (bilinear(sim.implicit, h, base.mu, base.a) - stiff)
    for k in range(co.scalar_row.size):
        j = co.scalar_qpos[k]
        total += base.of_scalar[k] * (sim.qpos[j] - base.qpos[j])
    for k in range(co.quaternion_row.size):
        j = co.quaternion_qpos[k]
        for axis in range(3):  # 2 q0* q is the small turn between them: 4 T(q0)^T q
            total += base.of_quaternion[3 * k + axis] * 4 * _to_tangent(base.qpos, j, sim.qpos, j, axis)
    for k in range(co.velocity_row.size):
        j = co.velocity_dof[k]
        total += base.of_velocity[k] * (sim.qvel[j] - base.qvel[j])
    for k in range(co.activation_row.size):
        total += base.of_activation[k] * (sim.act[k] - base.act[k])
    return total


@njit(**OPTIONS)
def _gradient(
    fn: Functions,
    sim: Simulation,
    co: Coordinates,
    readings: Readings,
    x: Array,
    later: Array,
    rho: Array,
    h: float,
    epsilon: float,
    centred: bool,
    base: _Base,
    out: Array,
) -> None:
    """Fill out (p,) with the gradient at x of later . y + rho . readings; sim.ctrl is the control, h the step."""
    _set(sim, co, x)
    _begin(fn, sim, readings, base)
    for k in range(co.scalar_row.size):
        base.of_scalar[k] = later[co.scalar_row[k]]
    for k in range(co.quaternion_row.size):
        for axis in range(3):
            base.of_quaternion[3 * k + axis] = _to_tangent(
                sim.qpos, co.quaternion_qpos[k], later, co.quaternion_row[k], axis
            )
    for k in range(co.velocity_row.size):
        base.of_velocity[k] = later[co.velocity_row[k]]
    for k in range(co.activation_row.size):
        base.of_activation[k] = later[co.activation_row[k]]
    stiff = 0.0
    if sim.implicit.mass.size > 0:
        base.mu[:] = 0
        for k in range(co.scalar_row.size):
            base.mu[co.scalar_dof[k]] = h * base.of_scalar[k]
        for k in range(co.velocity_row.size):
            base.mu[co.velocity_dof[k]] += base.of_velocity[k]
        solve(sim.implicit, base.mu)
        base.a[:] = (base.qvel - base.a) / h
        stiff = bilinear(sim.implicit, h, base.mu, base.a)
    scale = 1 / (2 * epsilon) if centred else 1 / epsilon
    sides = 2 if centred else 1
    out[:] = 0
    for k in range(co.goal_row.size):
        out[co.goal_row[k]] = later[co.goal_row[k]]
    for k in range(co.velocity_row.size):
        for side in range(sides):
            sign = 1.0 - 2.0 * side
            _set(sim, co, x)
            sim.qvel[co.velocity_dof[k]] += sign * epsilon
            moved = _change(fn, sim, co, readings, POSITION, base, rho, h, stiff)
            out[co.velocity_row[k]] += scale * sign * moved
    for k in range(co.activation_row.size):
        for side in range(sides):
            sign = 1.0 - 2.0 * side
            _set(sim, co, x)
            if k == 0 and side == 0 and co.velocity_row.size > 0:
                _forward(fn, sim, POSITION, readings.skip_sensors)  # velocities as they were
            sim.act[k] += sign * epsilon
            moved = _change(fn, sim, co, readings, VELOCITY, base, rho, h, stiff)
            out[co.activation_row[k]] += scale * sign * moved
    for k in range(co.scalar_row.size):
        for side in range(sides):
            sign = 1.0 - 2.0 * side
            _set(sim, co, x)
            sim.qpos[co.scalar_qpos[k]] += sign * epsilon
            moved = _change(fn, sim, co, readings, NONE, base, rho, h, stiff)
            out[co.scalar_row[k]] += scale * sign * moved
    for k in range(co.quaternion_row.size):
        for axis in range(3):
            slope = 0.0
            for side in range(sides):
                sign = 1.0 - 2.0 * side
                _set(sim, co, x)
                _turned(sim.qpos, co.quaternion_qpos[k], axis, sign * epsilon)
                moved = _change(fn, sim, co, readings, NONE, base, rho, h, stiff)
                slope += scale * sign * moved
            _set(sim, co, x)
            _add_from_tangent(sim.qpos, co.quaternion_qpos[k], axis, 4 * slope, out, co.quaternion_row[k])


@entry_point(**OPTIONS)
def pull_back(
    fn: Functions,
    sim: Simulation,
    co: Coordinates,
    ac: Actuation,
    readings: Readings,
    x: Array,
    u: Array,
    dVdx: Array,
    drdx: Array,
    rho: Array,
    l: float,
    discount: float,
    h: float,
    epsilon: float,
    centred: bool,
    first: int,
    last: int,
    out: Array,
) -> None:
    """Trajectories first .. last, backwards in time: the costates g of value gradients' equations.

    x (T + 1, p, N), u (T, q, N), dVdx (T + 1, p, N); drdx (T, p, N), the slope of the reward of a step in x itself, and
    rho (T, r, N), in its readings. ``out`` (T, p, N) is filled with
    g(t) = drdx + readings' part + discount F^T [(1 - l) dVdx(t + 1) + l g(t + 1)]. ``h`` is the model's time step.
    """
    T, q, p = u.shape[0], u.shape[1], x.shape[1]
    now, later, g, weight = np.empty(p), np.empty(p), np.empty(p), np.empty(rho.shape[1])
    nq, nv, na = sim.qpos.size, sim.qvel.size, sim.act.size
    base = _Base(
        np.empty(nq),
        np.empty(nv),
        np.empty(na),
        np.empty(rho.shape[1]),
        np.empty(co.scalar_row.size),
        np.empty(3 * co.quaternion_row.size),
        np.empty(co.velocity_row.size),
        np.empty(co.activation_row.size),
        np.empty(nv),
        np.empty(nv),
    )
    for n in range(first, last):
        g[:] = dVdx[T, :, n]
        for t in range(T - 1, -1, -1):
            for i in range(p):
                later[i] = discount * ((1 - l) * dVdx[t + 1, i, n] + l * g[i])
            now[:], weight[:] = x[t, :, n], rho[t, :, n]
            for k in range(q):
                _hold(sim, ac, k, u[t, k, n])
            _gradient(fn, sim, co, readings, now, later, weight, h, epsilon, centred, base, g)
            for i in range(p):
                g[i] += drdx[t, i, n]
                out[t, i, n] = g[i]
