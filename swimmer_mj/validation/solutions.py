"""Solutions of the equations of motion: by MuJoCo, by the integrators here, and by a tight one to judge them by."""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's bindings carry no types.)
from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from swimmer_mj.dynamics import from_qpos_qvel, to_qpos_qvel
from swimmer_mj.mjcf import Friction, Integrator, mjcf
from swimmer_mj.parameters import SwimmerParameters
from swimmer_mj.viscous import viscous_friction

__all__ = ["measured_order", "mujoco_states", "reference_states", "semi_implicit_euler_step", "states_by"]

Array = NDArray[np.float64]

_MAX_EVALUATIONS = 20_000  # of a swimmer's derivative for one reference; some 5,000 are usual


def _in_force(friction: Friction) -> AbstractContextManager[None]:
    return viscous_friction() if friction == "callback" else nullcontext()


def mujoco_states(
    parameters: SwimmerParameters,
    friction: Friction,
    integrator: Integrator,
    x: Array,
    controls: Iterable[Array],
    steps: int,
    dt: float,
) -> Array:
    """States after each of ``controls`` (torques, N·m, held for ``steps`` steps), by ``mj_step``."""
    n = parameters.n_links
    model = mujoco.MjModel.from_xml_string(
        mjcf(parameters, friction=friction, integrator=integrator, timestep=dt)
    )
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = to_qpos_qvel(x, n)
    states = []
    with _in_force(friction):
        for u in controls:
            data.ctrl[: n - 1] = u / parameters.torque_limits
            mujoco.mj_step(model, data, steps)
            states.append(from_qpos_qvel(data.qpos, data.qvel))
    return np.array(states)


def states_by(
    step: Callable[[Callable[[Array], Array], Array, float], Array],
    swimmer: Any,
    x: Array,
    controls: Iterable[Array],
    steps: int,
    dt: float,
) -> Array:
    """The same by ``step`` from the integrators here, for any statement."""
    states = []
    for u in controls:
        for _ in range(steps):
            x = step(lambda y, u=u: swimmer.derivative(y, u), x, dt)
        states.append(x)
    return np.array(states)


def semi_implicit_euler_step(f: Callable[[Array], Array], x: Array, dt: float) -> Array:
    """x(t + dt) with the new velocities in the positions: what MuJoCo calls Euler."""
    half = len(x) // 2
    velocities = x[half:] + dt * f(x)[half:]
    return np.concatenate([x[:half] + dt * velocities, velocities])


def reference_states(swimmer: Any, x: Array, controls: Iterable[Array], duration: float) -> Array:
    """States after each of ``controls``, held for ``duration``, by DOP853 at a relative tolerance of 1e-12.

    They are NaN from where the motion overflows, or takes so many evaluations that something must be wrong.
    """
    evaluations = itertools.count()
    states = []
    for u in controls:

        def f(_: float, y: Array, u: Array = u) -> Array:
            if next(evaluations) > _MAX_EVALUATIONS or not np.isfinite(y).all():
                raise FloatingPointError
            return swimmer.derivative(y, u)

        lost = np.full_like(x, np.nan)
        try:
            if np.isfinite(x).all():
                solution = solve_ivp(f, (0, duration), x, method="DOP853", rtol=1e-12, atol=1e-13)
                x = solution.y[:, -1] if solution.success else lost
        except FloatingPointError:
            x = lost
        states.append(x)
    return np.array(states)


def measured_order(errors: Sequence[float], ratio: float) -> float:
    """The order by which the last of ``errors`` is smaller than the one before, in steps of ``ratio``."""
    coarse, fine = np.array(errors[-2:])
    return float(np.log(coarse / fine) / np.log(ratio))
