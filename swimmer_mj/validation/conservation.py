"""Energy and momentum: what friction, torques and their absence may do to them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swimmer_mj import state as st
from swimmer_mj.integrators import rk4_step
from swimmer_mj.parameters import PAPER, SwimmerParameters
from swimmer_mj.validation.arbiter import LagrangianSwimmer, Motion
from swimmer_mj.validation.cases import (
    ARBITER,
    EPS,
    random_parameters,
    random_states,
    random_torques,
    statements,
)
from swimmer_mj.validation.records import Check, Curve, Section, Worst
from swimmer_mj.validation.solutions import mujoco_states, reference_states, states_by

__all__ = ["invariants", "measure_motion"]

Array = NDArray[np.float64]


def measure_motion(parameters: SwimmerParameters, x: Array, u: Array) -> tuple[dict[str, Motion], Array]:
    """Energy, momenta, powers and their rates along f(x, u), as the arbiter measures them, for each statement.

    Returns
    -------
    motions : dict
        By statement, the arbiter among them.
    tolerance : ndarray, shape (b,)
        N eps c for the rates, in units of their sizes.
    """
    swimmers = statements(parameters)
    arbiter: LagrangianSwimmer = swimmers[ARBITER]
    condition, size = arbiter.conditioning(x, u)
    motions = {name: arbiter.motion(x, s.derivative(x, u), u, size) for name, s in swimmers.items()}
    return motions, (parameters.n_links + 2) * EPS * condition


def invariants(
    rng: np.random.Generator, links: Iterable[int] = (1, 2, 3, 5), n_states: int = 20, duration: float = 5.0
) -> Section:
    """Check what the friction, the torques and their absence may do to energy and momentum."""
    reason = "N eps c of the sum of the absolute values of its terms: the accelerations' rounding"
    names = {
        "still momentum": "no friction, no torques: rate of the momentum",
        "still angular": "no friction, no torques: rate of the angular momentum",
        "still energy": "no friction, no torques: rate of the energy",
        "driven momentum": "no friction, any torques: rate of the momentum",
        "driven angular": "no friction, any torques: rate of the angular momentum",
        "balance": "power balance: energy rate less powers of torques and friction",
        "loss": "friction, no torques: rise of the energy",
    }
    worst = {key: Worst(name, reason) for key, name in names.items()}

    def note(key: str, value: Array, size: Array, tolerance: Array, where: str) -> None:
        for v, s, t in zip(value, size, tolerance, strict=True):
            worst[key].add(v / s if s > 0 else abs(v), t, where)

    for n in links:
        x = random_states(rng, n, n_states)
        for kind, k in (("vacuum", 0.0), ("fluid", None)):
            parameters = random_parameters(rng, n, k)
            for driven in (False, True):
                u = random_torques(rng, parameters, n_states) * driven
                motions, tolerance = measure_motion(parameters, x, u)
                for name, m in motions.items():
                    where = f"{name}, {n} links"
                    if kind == "vacuum":
                        key = "driven" if driven else "still"
                        rate = np.abs(m.momentum_rate).max(-1)
                        note(f"{key} momentum", rate, m.momentum_rate_size, tolerance, where)
                        rate = np.abs(m.angular_momentum_rate)
                        note(f"{key} angular", rate, m.angular_momentum_rate_size, tolerance, where)
                        if not driven:
                            note("still energy", np.abs(m.energy_rate), m.energy_rate_size, tolerance, where)
                    elif driven:
                        balance = np.abs(m.energy_rate - m.friction_power - m.torque_power)
                        size = m.energy_rate_size - m.friction_power + np.abs(m.torque_power)
                        note("balance", balance, size, tolerance, where)
                    else:
                        note("loss", m.energy_rate, m.energy_rate_size, tolerance, where)
    checks = [w.check() for w in worst.values()]
    checks += _vacuum_checks(rng, duration)
    section_checks, curves = _driven_power(rng)
    return Section(
        "Energy and momentum",
        [*checks, *section_checks],
        ("time, s", "power, W"),
        curves,
    )


def _vacuum_checks(rng: np.random.Generator, duration: float) -> list[Check]:
    """Check ``duration`` seconds without friction, and 5 s of friction without torques."""
    n = 3
    reason = "1e-12 a step of DOP853, some 500 steps"
    free = random_parameters(rng, n, 0.0)
    x = random_states(rng, n, 1)[0] / 3
    kept = {
        key: Worst(f"{duration:g} s without friction{and_more}: change of the {what}", reason)
        for key, and_more, what in (
            ("E", " and torques", "energy"),
            ("P", " and torques", "momentum"),
            ("L", " and torques", "angular momentum"),
            ("driven P", ", torques on", "momentum"),
            ("driven L", ", torques on", "angular momentum"),
        )
    }
    arbiter = LagrangianSwimmer(free)
    u = random_torques(rng, free, 1)[0] / 5
    for name, swimmer in statements(free).items():
        if name == ARBITER:  # the judge here
            continue
        for torques, prefix in ((0 * u, ""), (u, "driven ")):
            states = _vacuum_swim(swimmer, x, torques, duration)
            m = arbiter.motion(states, np.zeros_like(states), np.tile(torques, (2, 1)))
            scale = np.sqrt(2 * m.energy.max() * free.masses.sum())  # of a momentum: sqrt(2 E M)
            reach = free.lengths.sum()
            if not prefix:
                kept["E"].add(abs(np.diff(m.energy)[0]) / m.energy.max(), 5e-10, name)
            kept[prefix + "P"].add(np.abs(np.diff(m.momentum, axis=0)).max() / scale, 5e-10, name)
            kept[prefix + "L"].add(abs(np.diff(m.angular_momentum)[0]) / (scale * reach), 5e-10, name)

    fluid = random_parameters(rng, n)
    arbiter = LagrangianSwimmer(fluid)
    rises = Worst(
        "5 s of friction without torques: largest rise of the energy in a step of 0.01 s",
        "rounding of the energy, 2 N eps of what it was at the start",
    )
    still = np.zeros((500, n - 1))
    for name, swimmer in statements(fluid).items():
        if name == ARBITER:
            continue
        if name == "A.3":
            states = states_by(rk4_step, swimmer, x, still, 1, 0.01)
        else:
            states = mujoco_states(fluid, swimmer.friction, "RK4", x, still, 1, 0.01)
        states = np.concatenate([x[None], states])
        energy = arbiter.motion(states, np.zeros_like(states), np.zeros((len(states), n - 1))).energy
        rises.add(max(0.0, float(np.diff(energy).max() / energy[0])), 2 * (n + 2) * EPS, name)
    return [*(w.check() for w in kept.values()), rises.check()]


def _vacuum_swim(swimmer: Any, x: Array, u: Array, duration: float) -> Array:
    """States at the start and after ``duration`` seconds, shape (2, 2n + 4)."""
    return np.concatenate([x[None], reference_states(swimmer, x, [u], duration)])


def _driven_power(rng: np.random.Generator) -> tuple[list[Check], list[Curve]]:
    """Check the power balance along 5 s of the paper's swimmer, driven by a travelling wave, on MuJoCo."""
    n = PAPER.n_links
    times = np.arange(500) * 0.01
    phases = 2 * np.pi * (times[:, None] - np.arange(n - 1) / 4)
    controls = np.sin(phases) * PAPER.torque_limits
    x = st.expand(PAPER, rng.uniform(-0.5, 0.5, st.reduced_size(n)))
    states = mujoco_states(PAPER, "callback", "RK4", x, controls, 1, 0.01)
    x, u = states[:-1], controls[1:]
    motions, tolerance = measure_motion(PAPER, x, u)
    worst = Worst(
        "power balance along 5 s of swimming", "N eps c of the sum of the absolute values of its terms"
    )
    for name, m in motions.items():
        balance = np.abs(m.energy_rate - m.friction_power - m.torque_power)
        size = m.energy_rate_size - m.friction_power + np.abs(m.torque_power)
        for b, s, t in zip(balance, size, tolerance, strict=True):
            worst.add(b / s, t, name)
    m = motions["MuJoCo + callback"]
    curves = [
        Curve(label, times[1:].tolist(), values.tolist())
        for label, values in (
            ("dE/dt", m.energy_rate),
            ("torques", m.torque_power),
            ("friction", m.friction_power),
            ("dE/dt - torques - friction", m.energy_rate - m.torque_power - m.friction_power),
        )
    ]
    return [worst.check()], curves
