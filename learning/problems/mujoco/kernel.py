"""Loops over states that call MuJoCo's own functions, compiled, without the GIL.

A step of the learner's is MuJoCo's: semi-implicit Euler with joint damping taken implicitly, or one of the implicit
integrators. The state, the actuators and what a reward reads are tables of indices and addresses, so that one compiled
function serves all models.
Derivatives of it are in :mod:`~swimmer_mj.learning.problems.mujoco.costates`.
"""

# pyright: reportCallIssue=false, reportArgumentType=false
# numba gives its intrinsics their first argument, the typing context, itself.

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from swimmer_mj.compiled.cache import entry_point
from swimmer_mj.compiled.pointers import call, load
from swimmer_mj.learning.problems.mujoco.coordinates import Coordinates
from swimmer_mj.learning.problems.mujoco.implicit import Implicit
from swimmer_mj.learning.problems.mujoco.library import OPTIONS, Functions
from swimmer_mj.learning.problems.mujoco.quaternions import add_from_tangent

__all__ = [
    "Actuation",
    "Readings",
    "Simulation",
    "choose",
    "drift_and_control_matrix",
    "forward",
    "hold",
    "integrate",
    "read",
    "respond",
    "set_state",
    "step",
]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

NONE, POSITION, VELOCITY = 0, 1, 2
"""What forward_skip leaves out: nothing, what depends on positions, what depends on velocities too."""
PUSH = 1e-3
"""Of a control's limit, how much its response is measured with."""


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
def set_state(sim: Simulation, co: Coordinates, x: Array) -> None:
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
def hold(sim: Simulation, ac: Actuation, k: int, u: float) -> None:
    """Set control k to u."""
    sim.ctrl[ac.actuator[k]] = ac.middle[k] + u


@njit(**OPTIONS)
def _rest(sim: Simulation, ac: Actuation) -> None:
    """Set all controls to 0."""
    for k in range(ac.middle.size):
        hold(sim, ac, k, 0.0)


@njit(**OPTIONS)
def forward(fn: Functions, sim: Simulation, skip: int, skip_sensors: int) -> None:
    """What follows from the state, but for what ``skip`` and ``skip_sensors`` leave out."""
    call(None, fn.forward_skip, (sim.model, sim.data, np.int32(skip), np.int32(skip_sensors)))


@njit(**OPTIONS)
def integrate(fn: Functions, sim: Simulation, factored: bool) -> None:
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
        forward(fn, sim, NONE, 1)
        integrate(fn, sim, False)
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
        set_state(sim, co, now)
        for k in range(u.shape[0]):
            hold(sim, ac, k, u[k, n])
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
        set_state(sim, co, now)
        _rest(sim, ac)
        forward(fn, sim, NONE, 1)
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
        set_state(sim, co, now)
        _rest(sim, ac)
        _move(fn, sim, 0)
        _get(sim, co, now)
        coast[:, n] = now
        for k in range(gain.shape[0]):
            now[:] = x[:, n]
            set_state(sim, co, now)
            small = PUSH * ac.limits[k]
            hold(sim, ac, k, small)
            forward(fn, sim, VELOCITY, 1)  # positions and velocities are as they were
            integrate(fn, sim, once)
            hold(sim, ac, k, 0.0)
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
        set_state(sim, co, now)
        forward(fn, sim, NONE, readings.skip_sensors)
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
        set_state(sim, co, x[n])
        _rest(sim, ac)
        forward(fn, sim, NONE, 1)
        for k in range(co.scalar_row.size):
            a[n, co.scalar_row[k]] = sim.qvel[co.scalar_dof[k]]
        for k in range(co.quaternion_row.size):
            for axis in range(3):
                w = sim.qvel[co.quaternion_dof[k] + axis]
                add_from_tangent(sim.qpos, co.quaternion_qpos[k], axis, w, a[n], co.quaternion_row[k])
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
