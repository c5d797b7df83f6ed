"""Is the physics right on this machine? A few seconds' checks of the installed package.

Each check measures one error and holds it against a tolerance that says where it comes from.
"""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's bindings carry no types.)
from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from swimmer_mj import state as st
from swimmer_mj.analytic import AnalyticSwimmer
from swimmer_mj.dynamics import MujocoSwimmer, from_qpos_qvel, to_qpos_qvel
from swimmer_mj.mjcf import mjcf
from swimmer_mj.parameters import PAPER, SwimmerParameters
from swimmer_mj.viscous import viscous_friction

__all__ = ["Check", "callback_self_test", "physics_report", "random_parameters", "relative_error"]

Array = NDArray[np.float64]

_FOREIGN_MODEL = """
<mujoco model="pendulum in MuJoCo's own fluid">
  <option density="1000" viscosity="0.1"/>
  <worldbody>
    <body name="upper">
      <joint name="shoulder" axis="0 1 0" damping="0.1" stiffness="0.3"/>
      <geom name="upper" type="capsule" fromto="0 0 0 0.5 0 0" size="0.05"/>
      <body name="lower" pos="0.5 0 0">
        <joint name="elbow" axis="0 1 0"/>
        <geom name="lower" type="capsule" fromto="0 0 0 0.5 0 0" size="0.05"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


@dataclass(frozen=True)
class Check:
    """One comparison of two statements of the physics."""

    name: str
    """What is compared."""
    error: float
    """What was measured."""
    tolerance: float
    """The largest error that passes."""
    reason: str
    """Where the tolerance comes from."""

    @property
    def passed(self) -> bool:
        """Whether the error is finite and within tolerance."""
        return bool(self.error <= self.tolerance)


def relative_error(actual: Array, expected: Array, n_axes: int = 1) -> Array:
    """|actual - expected| / |expected| in the Euclidean norm over the last ``n_axes`` axes."""
    axes = tuple(range(-n_axes, 0))
    difference = np.sqrt(((actual - expected) ** 2).sum(axis=axes))
    return difference / np.sqrt((expected**2).sum(axis=axes))


def random_parameters(rng: np.random.Generator, n_links: int) -> SwimmerParameters:
    """Draw a swimmer: m_i, l_i in [0.5, 2], k in [0, 20], U_i in [1, 10], SI units."""
    return SwimmerParameters(
        n_links=n_links,
        mass=rng.uniform(0.5, 2, n_links).tolist(),
        length=rng.uniform(0.5, 2, n_links).tolist(),
        viscous_friction=rng.uniform(0, 20),
        torque_limit=rng.uniform(1, 10, n_links - 1).tolist(),
    )


def _random_states(rng: np.random.Generator, n_links: int, size: int) -> Array:
    """Full states with angles in [-pi, pi], everything else in [-3, 3] SI units; shape (size, 2n + 4)."""
    x = rng.uniform(-3, 3, (size, st.full_size(n_links)))
    st.split(x, n_links).angles[:] = rng.uniform(-np.pi, np.pi, (size, n_links))
    return x


def _accelerations(rng: np.random.Generator, n_states: int) -> list[Check]:
    """Check the analytic solver against MuJoCo at random states of random swimmers."""
    errors, matrix_errors = [], []
    for n in (1, 2, 3, 5, 8):
        for _ in range(5):
            parameters = random_parameters(rng, n)
            analytic, with_mujoco = AnalyticSwimmer(parameters), MujocoSwimmer(parameters)
            x = _random_states(rng, n, n_states // 25)
            u = rng.uniform(-1, 1, (len(x), n - 1)) * parameters.torque_limits
            expected, actual = analytic.derivative(x, u), with_mujoco.derivative(x, u)
            errors.append(relative_error(actual, expected).max())
            if n > 1:
                expected, actual = analytic.control_matrix(x), with_mujoco.control_matrix(x)
                matrix_errors.append(relative_error(actual, expected, n_axes=2).max())
    reason = "two orders below what any wrong term gives, two above the rounding of an ill-conditioned solve"
    return [
        Check("accelerations: A.3 against MuJoCo, 1 to 8 unequal links", max(errors), 1e-11, reason),
        Check("control matrices: A.3 against MuJoCo", max(matrix_errors), 1e-11, reason),
    ]


def _trajectory(rng: np.random.Generator) -> Check:
    """Check 0.2 s of the paper's swimmer under constant torques, both with Runge-Kutta's method at 0.01 s."""
    dt, n_steps = 0.01, 20
    x = _random_states(rng, PAPER.n_links, 1)[0]
    u = rng.uniform(-1, 1, PAPER.n_links - 1) * PAPER.torque_limits
    model = mujoco.MjModel.from_xml_string(mjcf(PAPER, integrator="RK4", timestep=dt))
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = to_qpos_qvel(x, PAPER.n_links)
    data.ctrl[:] = u / PAPER.torque_limits
    with viscous_friction():
        mujoco.mj_step(model, data, n_steps)
    swimmer = AnalyticSwimmer(PAPER)
    for _ in range(n_steps):
        x = swimmer.rk4_step(x, u, dt)
    error = relative_error(from_qpos_qvel(data.qpos, data.qvel), x).max()
    return Check(
        "trajectory of 0.2 s: A.3 against mj_step, both RK4",
        float(error),
        1e-10,
        "rounding, grown by the motion",
    )


def _momentum(rng: np.random.Generator) -> Check:
    """Check that a swimmer without friction keeps its momentum, whatever its torques, in MuJoCo."""
    parameters = SwimmerParameters(n_links=5, mass=[0.5, 1.0, 1.5, 0.7, 2.0], viscous_friction=0.0)
    x = _random_states(rng, parameters.n_links, 20)
    u = rng.uniform(-5, 5, (len(x), parameters.n_links - 1))
    rate = st.reduce_derivative(parameters, x, MujocoSwimmer(parameters).derivative(x, u))
    acceleration = np.abs(st.split_reduced(rate, parameters.n_links).velocity).max()
    return Check(
        "no friction: acceleration of the centre of mass, m/s²",
        float(acceleration),
        1e-10,
        "rounding of link accelerations of some 100 m/s²",
    )


def _single_rod() -> Check:
    """Check a single rod that glides sideways against v(t) = v(0) exp(-k l t / m), in MuJoCo."""
    parameters = SwimmerParameters(n_links=1, mass=2.0, length=0.5, viscous_friction=10.0)
    rate = parameters.viscous_friction * parameters.lengths[0] / parameters.masses[0]
    dt, n_steps = 0.001, 1000
    model = mujoco.MjModel.from_xml_string(mjcf(parameters, integrator="RK4", timestep=dt))
    data = mujoco.MjData(model)
    data.qvel[1] = 1.0
    with viscous_friction():
        mujoco.mj_step(model, data, n_steps)
    decay = np.exp(-rate * dt * n_steps)
    return Check(
        "a rod sideways: exp(-k l t / m) against mj_step",
        abs(float(data.qvel[1]) - decay) / decay,
        1e-11,
        "RK4 at 0.001 s: (rate dt)^4 / 120 a unit of rate t, 8e-13",
    )


def _foreign_model() -> Check:
    """Check that another model of the process moves as it does without us, to the last bit."""

    def final_state() -> Array:
        model = mujoco.MjModel.from_xml_string(_FOREIGN_MODEL)
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, 200)
        return np.concatenate([data.qpos, data.qvel])

    alone = final_state()
    swimmer = mujoco.MjModel.from_xml_string(mjcf(PAPER))
    swimmer_data = mujoco.MjData(swimmer)
    with viscous_friction():
        mujoco.mj_step(swimmer, swimmer_data, 10)
        beside = final_state()
    return Check(
        "another model beside a swimmer: change of its state",
        float(np.abs(beside - alone).max()),
        0.0,
        "nothing may act on it",
    )


def callback_self_test() -> Check:
    """Check that the friction acts in this installation: the rod that glides sideways."""
    return _single_rod()


def physics_report(seed: int = 0, n_states: int = 250) -> list[Check]:
    """Run all checks, in a few seconds.

    Parameters
    ----------
    seed : int
        Of the random swimmers and states.
    n_states : int
        How many states the two solvers are compared at.

    Returns
    -------
    list of Check
    """
    rng = np.random.default_rng(seed)
    return [
        *_accelerations(rng, n_states),
        _trajectory(rng),
        _momentum(rng),
        _single_rod(),
        _foreign_model(),
    ]
