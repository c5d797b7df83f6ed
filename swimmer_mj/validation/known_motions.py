"""Motions that are known: of one rod, and in the limits of a vacuum and of one heavy link."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from swimmer_mj import state as st
from swimmer_mj.analytic import AnalyticSwimmer
from swimmer_mj.integrators import rk4_step
from swimmer_mj.parameters import SwimmerParameters
from swimmer_mj.validation.arbiter import LagrangianSwimmer
from swimmer_mj.validation.cases import (
    ARBITER,
    EPS,
    FRICTIONS,
    STATEMENTS,
    random_parameters,
    random_states,
    random_torques,
    statements,
)
from swimmer_mj.validation.records import Check, Curve, Section, Worst
from swimmer_mj.validation.solutions import measured_order, mujoco_states, states_by

__all__ = ["closed_forms", "limits"]

Array = NDArray[np.float64]

_ROD = SwimmerParameters(n_links=1, mass=2.0, length=0.5, viscous_friction=10.0)
_ROD_STEP = 0.005  # s


def _rod_states(name: str, x: Array, duration: float) -> Array:
    """States of :data:`_ROD` every 0.01 s by RK4."""
    controls = np.zeros((round(duration / 0.01), 0))
    steps = round(0.01 / _ROD_STEP)
    if name in FRICTIONS:
        return mujoco_states(_ROD, FRICTIONS[name], "RK4", x, controls, steps, _ROD_STEP)
    swimmer = AnalyticSwimmer(_ROD) if name == "A.3" else LagrangianSwimmer(_ROD)
    return states_by(rk4_step, swimmer, x, controls, steps, _ROD_STEP)


def closed_forms(names: Sequence[str] = (*STATEMENTS, ARBITER), duration: float = 0.5) -> Section:
    """Check single rods against exp(-k l t / m)."""
    k, l, m = _ROD.viscous_friction, _ROD.lengths[0], _ROD.masses[0]
    rate = k * l / m
    z = -rate * _ROD_STEP
    of_a_step = (1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24) / np.exp(z) - 1  # of RK4 on v' = -rate v
    tolerance = duration / _ROD_STEP * (1.001 * abs(of_a_step) + 4 * EPS)
    reason = "that of 1 + z + z²/2 + z³/6 + z⁴/24 for exp(z), z = -rate dt, and 4 eps, in each step of RK4"
    checks, curves = [], []
    slope = 0.3  # rad; no special direction
    along, across = np.array([np.cos(slope), np.sin(slope)]), np.array([-np.sin(slope), np.cos(slope)])
    sideways = Worst("a rod drifting sideways: exp(-k l t / m)", reason)
    glide = Worst("a rod gliding along itself: constant", "4 eps a step")
    spin = Worst("a rod spinning: exp(-k l t / m)", reason)
    times = 0.01 * np.arange(1, round(duration / 0.01) + 1)
    decay = np.exp(-rate * times)
    for name in names:
        velocity = st.split(_rod_states(name, st.join([0, 0], [slope], across, [0]), duration), 1).velocity
        sideways.add(np.abs(velocity @ across / decay - 1).max(), tolerance, name)
        curves.append(Curve(name, times.tolist(), (velocity @ across).tolist()))
        velocity = st.split(_rod_states(name, st.join([0, 0], [slope], along, [0]), duration), 1).velocity
        glide.add(np.abs(velocity @ along - 1).max(), duration / _ROD_STEP * 4 * EPS, name)
        start = st.join(-l / 2 * along, [slope], -l / 2 * across, [1.0])  # about its middle
        angular = st.split(_rod_states(name, start, duration), 1).angular_velocities[:, 0]
        spin.add(np.abs(angular / decay - 1).max(), tolerance, name)
    checks = [sideways.check(), glide.check(), spin.check()]
    curves.append(Curve("exp(-k l t / m)", times.tolist(), decay.tolist(), guide=True))
    return Section("Closed forms: one rod", checks, ("time, s", "velocity sideways, m/s"), curves)


def limits(rng: np.random.Generator) -> Section:
    """Check the ways to k = 0 and to an infinitely heavy link; that to a time step of 0 is in the trajectories."""
    checks, curves = [], []
    n, frictions = 3, (1e-2, 1e-3, 1e-4)
    p = random_parameters(rng, n)
    x = random_states(rng, n, 1)[0] / 2
    u = random_torques(rng, p, 1)
    by_friction: dict[str, list[float]] = {name: [] for name in STATEMENTS}
    for name, errors in by_friction.items():
        ends = []
        for k in (0.0, *frictions):
            swimmer = SwimmerParameters(n, p.mass, p.length, k, p.torque_limit)
            if name == "A.3":
                ends.append(states_by(rk4_step, AnalyticSwimmer(swimmer), x, u, 100, 0.01)[-1])
            else:
                ends.append(mujoco_states(swimmer, FRICTIONS[name], "RK4", x, u, 100, 0.01)[-1])
        errors += [float(np.linalg.norm(end - ends[0])) for end in ends[1:]]
        order = measured_order(errors, 10)
        checks.append(
            Check(
                f"k to 0: {name}, difference from a vacuum after 1 s, distance of its order from 1",
                abs(order - 1),
                0.05,
                "the next term is k times as large, 1e-3, with a factor of 10 s of a second for time",
                f"order {order:.4f}",
            )
        )
        curves.append(Curve(f"k: {name}", list(frictions), errors))

    # A light link on one too heavy to move turns about the joint: m l^2 / 3 w' = u - k l^3 / 3 w
    masses = (1e2, 1e3, 1e4, 1e5)  # kg
    l, m, k, w, torque = 0.8, 0.5, 4.0, 1.5, 0.7
    pinned = (torque - k * l**3 / 3 * w) / (m * l**2 / 3)
    state = st.join([0, 0], [0.4, 1.3], [0, 0], [0.0, w])
    names = [*STATEMENTS, ARBITER]
    by_mass: dict[str, list[float]] = {name: [] for name in names}
    for heavy in masses:
        swimmers = statements(SwimmerParameters(2, [heavy, m], [1.2, l], k, 1.0))
        for name in names:
            found = swimmers[name].derivative(state, np.array([torque]))[-1]
            by_mass[name].append(abs(float(found) - pinned) / abs(pinned))
    for name, errors in by_mass.items():
        order = measured_order(errors, 10)
        checks.append(
            Check(
                f"one heavy link: {name}, distance from the light one pinned, of its order from 1",
                abs(order - 1),
                0.01,
                "the next term is m / M times as large, 5e-5; rounding 1e-10 beside 1e-5",
                f"order {order:.5f}",
            )
        )
        curves.append(Curve(f"1 / M: {name}", [1 / mass for mass in masses], errors))
    return Section(
        "Limits",
        checks,
        ("k, N·s/m², or 1 / M, 1/kg", "distance from the limit"),
        curves,
        loglog=True,
    )
