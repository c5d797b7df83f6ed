"""Trajectories under the same controls, and the orders of the integrators."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from swimmer_mj import state as st
from swimmer_mj.integrators import euler_step, rk4_step
from swimmer_mj.mjcf import Integrator
from swimmer_mj.parameters import PAPER, SwimmerParameters
from swimmer_mj.validation.cases import ARBITER, STATEMENTS, random_torques, statements
from swimmer_mj.validation.records import Check, Curve, Section
from swimmer_mj.validation.solutions import (
    measured_order,
    mujoco_states,
    reference_states,
    semi_implicit_euler_step,
    states_by,
)

__all__ = ["trajectories"]

Array = NDArray[np.float64]

_ORDERS = {"Euler": 1, "semi-implicit Euler": 1, "RK4": 4}
_STEP_SIZES = (0.02, 0.01, 0.005, 0.0025, 0.00125)  # s


def _step_sizes(name: str, integrator: str) -> tuple[float, ...]:
    """As many as take a second or two."""
    if integrator == "RK4":
        return _STEP_SIZES[:3] if name == "A.3" else _STEP_SIZES
    return _STEP_SIZES[:4]


def _final_states(
    name: str, swimmer: Any, integrator: str, x: Array, controls: Array, interval: float, dt: float
) -> Array:
    """States at the ends of the controls' intervals by one statement's own implementation of an integrator."""
    steps = round(interval / dt)
    if name == "A.3" or integrator == "Euler":
        step = {"Euler": euler_step, "semi-implicit Euler": semi_implicit_euler_step, "RK4": rk4_step}
        return states_by(step[integrator], swimmer, x, controls, steps, dt)
    native: Integrator = "Euler" if integrator == "semi-implicit Euler" else "RK4"
    return mujoco_states(swimmer.parameters, swimmer.friction, native, x, controls, steps, dt)


def trajectories(
    rng: np.random.Generator, parameters: SwimmerParameters = PAPER, duration: float = 5.0
) -> Section:
    """Compare ``duration`` seconds, for each integrator, with a tight solution of the arbiter's equations."""
    swimmers = statements(parameters)
    x = st.expand(parameters, rng.uniform(-1, 1, st.reduced_size(parameters.n_links)))
    controls = random_torques(rng, parameters, 25)
    interval = duration / len(controls)  # s, for which each is held
    reference = reference_states(swimmers[ARBITER], x, controls, interval)
    size = np.linalg.norm(reference, axis=-1).max()
    checks, curves = [], []
    for name in STATEMENTS:
        tight = reference_states(swimmers[name], x, controls, interval)
        checks.append(
            Check(
                f"{duration:g} s by DOP853: {name} and {ARBITER}",
                float(np.linalg.norm(tight - reference, axis=-1).max() / size),
                1e-9,
                "1e-12 a step, some 300 steps, grown at most threefold by the motion",
            )
        )
    for integrator, order in _ORDERS.items():
        for name in STATEMENTS:
            errors, step_sizes = [], _step_sizes(name, integrator)
            for dt in step_sizes:
                found = _final_states(name, swimmers[name], integrator, x, controls, interval, dt)
                errors.append(float(np.linalg.norm(found - reference, axis=-1).max() / size))
            curves.append(Curve(f"{integrator}: {name}", list(step_sizes), errors))
            # of MuJoCo's RK4, finer steps meet the reference's own error
            measured = measured_order(errors[:3] if integrator == "RK4" else errors, 2)
            checks.append(
                Check(
                    f"order of {integrator}: {name}, distance from {order}",
                    abs(measured - order),
                    0.25,
                    "half the distance at which it could be taken for a neighbouring integer",
                    f"order {measured:.2f}",
                )
            )
            if integrator == "RK4":
                checks.append(
                    Check(
                        f"time step to 0: {name} by RK4 at {step_sizes[-1]} s",
                        errors[-1],
                        2 * errors[0] / 16 ** (len(errors) - 1) + 1e-9,
                        "twice what the fourth order leaves of the error at 0.02 s, and the reference's own",
                    )
                )
    for order, start in ((1, curves[0].y[0]), (4, curves[-1].y[0])):
        slope = [1.5 * start * (dt / _STEP_SIZES[0]) ** order for dt in _STEP_SIZES]
        curves.append(Curve(f"slope {order}", list(_STEP_SIZES), slope, guide=True))
    return Section(
        f"Trajectories of {duration:g} s and the orders of the integrators",
        checks,
        ("time step, s", "largest relative error of the state"),
        curves,
        loglog=True,
    )
