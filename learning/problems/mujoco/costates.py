"""Costates of trajectories of a MuJoCo model, compiled.

Derivatives are finite differences of the learner's step, of one scalar: with ``later`` the costate after the step and
``rho`` the slope of the reward in what it reads, the gradient in x of later . y(x, u) + rho . readings(x) at held u. A
velocity is moved without computing positions anew, an activation without computing velocities anew, and where a step is
implicit in a fluid, one factor serves for all of them (:mod:`~swimmer_mj.learning.problems.mujoco.implicit`).
"""

# pyright: reportCallIssue=false, reportArgumentType=false
# numba gives its intrinsics their first argument, the typing context, itself.

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from swimmer_mj.compiled.cache import entry_point
from swimmer_mj.compiled.pointers import load
from swimmer_mj.learning.problems.mujoco.coordinates import Coordinates
from swimmer_mj.learning.problems.mujoco.implicit import bilinear, solve
from swimmer_mj.learning.problems.mujoco.kernel import (
    NONE,
    POSITION,
    VELOCITY,
    Actuation,
    Readings,
    Simulation,
    forward,
    hold,
    integrate,
    set_state,
)
from swimmer_mj.learning.problems.mujoco.library import OPTIONS, Functions
from swimmer_mj.learning.problems.mujoco.quaternions import add_from_tangent, to_tangent, turned

__all__ = ["pull_back"]

Array = NDArray[np.float64]


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
    forward(fn, sim, NONE, readings.skip_sensors)
    for k in range(readings.address.size):
        base.readings[k] = load(np.float64, readings.address[k], 0, 1)
    base.a[:] = sim.qvel
    integrate(fn, sim, False)
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
    forward(fn, sim, skip, readings.skip_sensors)
    total = 0.0
    for k in range(readings.address.size):
        total += rho[k] * (load(np.float64, readings.address[k], 0, 1) - base.readings[k])
    once = sim.implicit.mass.size > 0
    integrate(fn, sim, once)
    if once and skip != VELOCITY:
        total -= h * (bilinear(sim.implicit, h, base.mu, base.a) - stiff)
    for k in range(co.scalar_row.size):
        j = co.scalar_qpos[k]
        total += base.of_scalar[k] * (sim.qpos[j] - base.qpos[j])
    for k in range(co.quaternion_row.size):
        j = co.quaternion_qpos[k]
        for axis in range(3):  # 2 q0* q is the small turn between them: 4 T(q0)^T q
            total += base.of_quaternion[3 * k + axis] * 4 * to_tangent(base.qpos, j, sim.qpos, j, axis)
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
    set_state(sim, co, x)
    _begin(fn, sim, readings, base)
    for k in range(co.scalar_row.size):
        base.of_scalar[k] = later[co.scalar_row[k]]
    for k in range(co.quaternion_row.size):
        for axis in range(3):
            base.of_quaternion[3 * k + axis] = to_tangent(
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
            set_state(sim, co, x)
            sim.qvel[co.velocity_dof[k]] += sign * epsilon
            moved = _change(fn, sim, co, readings, POSITION, base, rho, h, stiff)
            out[co.velocity_row[k]] += scale * sign * moved
    for k in range(co.activation_row.size):
        for side in range(sides):
            sign = 1.0 - 2.0 * side
            set_state(sim, co, x)
            if k == 0 and side == 0 and co.velocity_row.size > 0:
                forward(fn, sim, POSITION, readings.skip_sensors)  # velocities as they were
            sim.act[k] += sign * epsilon
            moved = _change(fn, sim, co, readings, VELOCITY, base, rho, h, stiff)
            out[co.activation_row[k]] += scale * sign * moved
    for k in range(co.scalar_row.size):
        for side in range(sides):
            sign = 1.0 - 2.0 * side
            set_state(sim, co, x)
            sim.qpos[co.scalar_qpos[k]] += sign * epsilon
            moved = _change(fn, sim, co, readings, NONE, base, rho, h, stiff)
            out[co.scalar_row[k]] += scale * sign * moved
    for k in range(co.quaternion_row.size):
        for axis in range(3):
            slope = 0.0
            for side in range(sides):
                sign = 1.0 - 2.0 * side
                set_state(sim, co, x)
                turned(sim.qpos, co.quaternion_qpos[k], axis, sign * epsilon)
                moved = _change(fn, sim, co, readings, NONE, base, rho, h, stiff)
                slope += scale * sign * moved
            set_state(sim, co, x)
            add_from_tangent(sim.qpos, co.quaternion_qpos[k], axis, 4 * slope, out, co.quaternion_row[k])


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
                hold(sim, ac, k, u[t, k, n])
            _gradient(fn, sim, co, readings, now, later, weight, h, epsilon, centred, base, g)
            for i in range(p):
                g[i] += drdx[t, i, n]
                out[t, i, n] = g[i]
