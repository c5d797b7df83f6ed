"""A gait swum on MuJoCo: its torques, and a feedback that holds it to its orbit.

Gaits are unstable: their torques alone leave them within strokes. The feedback is that of the linear quadratic
regulator along the orbit, periodic in time, with the sum held within the torque limits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swimmer_mj import state as st
from swimmer_mj.analytic import AnalyticSwimmer
from swimmer_mj.dynamics import Dynamics, MujocoSwimmer
from swimmer_mj.integrators import rk4_step
from swimmer_mj.learning.experiments.gaits.gait import Gait, pulled
from swimmer_mj.parameters import SwimmerParameters

__all__ = ["Feedback", "Replay", "periodic_feedback", "replay"]

Array = NDArray[np.float64]

LONGEST_STEP = 0.01
"""s: an interval is cut into equal RK4 steps of at most this."""
DIFFERENCE = 1e-6
"""Of states and of torques, for derivatives by central differences."""
TORQUE_PRICE = 0.01
"""Of the regulator, for each (N·m)²; deviations of the state are weighed with 1."""


@dataclass(frozen=True)
class Feedback:
    """u = u_k - K_k (z - z_k), held for the step k of S."""

    dt: float
    """s."""
    states: Array
    """z_k, shape (S, 2n + 2)."""
    controls: Array
    """u_k, N·m, shape (S, n - 1)."""
    gains: Array
    """K_k, shape (S, n - 1, 2n + 2)."""
    turns: Array
    """Whole turns of each link in a stroke, shape (n,)."""

    def torques(self, step: int, z: Array, limits: Array) -> Array:
        """u within its limits at step ``step`` since the gait began."""
        strokes, k = divmod(step, len(self.states))
        apart = z - self.states[k]
        apart[: len(self.turns)] -= 2 * np.pi * strokes * self.turns
        return np.clip(self.controls[k] - self.gains[k] @ apart, -limits, limits)


@dataclass(frozen=True)
class Replay:
    """What came of it."""

    speeds: Array
    """Mean velocity of the centre of mass along x in each stroke, m/s."""
    distances: Array
    """Of the reduced state from the gait's at the end of each stroke, root of the sum of squares."""


def _step(
    dynamics: Dynamics, parameters: SwimmerParameters, z: Array, u: Array, dt: float, pull: float
) -> tuple[Array, Array]:
    """z and the way of the centre of mass after dt by RK4."""
    back = pulled(parameters, pull)
    x = st.expand(parameters, z)
    x = rk4_step(lambda y: dynamics.derivative(y, u) + back, x, dt)
    return st.reduce(parameters, x), st.center_of_mass(parameters, x)


def _linearised(gait: Gait, states: Array, controls: Array, dt: float) -> tuple[Array, Array]:
    """dz_{k+1}/dz_k, shape (S, 2n + 2, 2n + 2), and dz_{k+1}/du_k, shape (S, 2n + 2, n - 1)."""
    swimmer, e = AnalyticSwimmer(gait.parameters), DIFFERENCE

    def after(z: Array, u: Array) -> Array:
        return _step(swimmer, gait.parameters, z, u, dt, gait.pull)[0]

    z, u = states[:, None], controls[:, None]
    dz, du = e * np.eye(states.shape[1]), e * np.eye(controls.shape[1])
    A = (after(z + dz, u) - after(z - dz, u)) / (2 * e)
    B = (after(z, u + du) - after(z, u - du)) / (2 * e)
    return A.swapaxes(1, 2), B.swapaxes(1, 2)


def periodic_feedback(gait: Gait, torque_price: float = TORQUE_PRICE) -> Feedback:
    """The regulator: the Riccati recursion, backwards along stroke after stroke until its gains repeat."""
    p = gait.parameters
    substeps = math.ceil(gait.duration / gait.n_intervals / LONGEST_STEP - 1e-9)
    dt = gait.duration / gait.n_intervals / substeps
    swimmer = AnalyticSwimmer(p)
    states, controls = [], np.repeat(gait.controls, substeps, axis=0)
    for z, u in zip(gait.states, gait.controls, strict=True):
        for _ in range(substeps):
            states.append(z)
            z = _step(swimmer, p, z, u, dt, gait.pull)[0]
    states = np.array(states)
    A, B = _linearised(gait, states, controls, dt)
    Q, R = dt * np.eye(states.shape[1]), dt * torque_price * np.eye(controls.shape[1])
    P = np.eye(states.shape[1])
    gains = np.zeros((len(states), controls.shape[1], states.shape[1]))
    for _ in range(200):
        before = gains.copy()
        for k in reversed(range(len(states))):
            gains[k] = np.linalg.solve(R + B[k].T @ P @ B[k], B[k].T @ P @ A[k])
            closed = A[k] - B[k] @ gains[k]
            P = Q + gains[k].T @ R @ gains[k] + closed.T @ P @ closed
            P = (P + P.T) / 2
        if np.abs(gains - before).max() < 1e-6 * np.abs(gains).max():
            break
    return Feedback(dt, states, controls, gains, gait.turns)


def replay(gait: Gait, feedback: Feedback, n_strokes: int, disturbance: Array | float = 0.0) -> Replay:
    """Swim ``n_strokes`` on MuJoCo from the gait's first state plus a disturbance."""
    p = gait.parameters
    swimmer = MujocoSwimmer(p)
    z = gait.states[0] + disturbance
    speeds, distances = [], []
    steps = len(feedback.states)
    for stroke in range(n_strokes):
        way = 0.0
        for k in range(steps):
            u = feedback.torques(stroke * steps + k, z, p.torque_limits)
            z, moved = _step(swimmer, p, z, u, feedback.dt, gait.pull)
            way += moved[0]
        speeds.append(way / gait.duration)
        apart = z - gait.states[0]
        apart[: p.n_links] -= 2 * np.pi * (stroke + 1) * gait.turns
        distances.append(np.linalg.norm(apart))
    return Replay(np.array(speeds), np.array(distances))
