"""Swimming as a control problem: section 4, in the swimmer's 12 reduced variables.

The target direction is the x axis; by symmetry a policy for it swims in any direction, given the state in a frame
that is turned. The reward is the velocity of the centre of mass along x (A.4).
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, Literal

import numpy as np
import torch
from numba import njit
from numpy.typing import NDArray

from swimmer_mj import state as st
from swimmer_mj.analytic import AnalyticSwimmer
from swimmer_mj.compiled.elementary import cos_sin
from swimmer_mj.dynamics import Dynamics
from swimmer_mj.initial_states import InitialLaw, random_initial_state
from swimmer_mj.integrators import euler_step, rk4_step
from swimmer_mj.learning.problems.problem import CompiledProblem
from swimmer_mj.learning.problems.swim.reduced import compile_reduced_dynamics, reduced_constants
from swimmer_mj.parameters import PAPER, SwimmerParameters

__all__ = ["Swimming"]

Array = NDArray[np.float64]

RATE_SCALE = 0.2
"""theta' is scaled by this as a network input, so that it is of order one (chosen)."""


TURN = 2 * math.pi
"""rad."""


class Swimming:
    """Swim along x as fast as possible. State z as in :mod:`swimmer_mj.state`, control: torques, N·m.

    Parameters
    ----------
    parameters : SwimmerParameters
        The swimmer.
    s_gamma : float
        Shortness factor, 1/s (left open by the paper; 1 was seen to learn).
    dynamics : Dynamics, optional
        Who computes drift and control matrix; :class:`AnalyticSwimmer` by default.
    integrator : "euler" or "rk4"
        "euler" steps the reduced variables (section 4); "rk4" steps the full state, as MuJoCo's RK4 does.
    encoding : {"circle", "angle"}
        Inputs for each angle: its cosine and sine (chosen), or the angle itself in [-pi, pi].
    initial_law : InitialLaw
        See :func:`swimmer_mj.initial_states.random_initial_state`.
    """

    def __init__(
        self,
        parameters: SwimmerParameters = PAPER,
        s_gamma: float = 1.0,
        dynamics: Dynamics | None = None,
        integrator: Literal["euler", "rk4"] = "euler",
        *,
        encoding: Literal["circle", "angle"] = "circle",
        initial_law: InitialLaw = "moderate",
    ) -> None:
        if parameters.n_links < 2:
            raise ValueError(
                f"a swimmer needs at least 2 links to have a joint to move, got {parameters.n_links}"
            )
        if not (math.isfinite(s_gamma) and s_gamma > 0):
            raise ValueError(f"s_gamma must be positive and finite, got {s_gamma!r}")
        if integrator not in ("euler", "rk4"):
            raise ValueError(f"integrator must be 'euler' or 'rk4', got {integrator!r}")
        if encoding not in ("circle", "angle"):
            raise ValueError(f"encoding must be 'circle' or 'angle', got {encoding!r}")
        self.encoding = encoding
        self.initial_law: InitialLaw = initial_law
        self.parameters = parameters
        self.s_gamma = s_gamma
        self.dynamics: Dynamics = AnalyticSwimmer(parameters) if dynamics is None else dynamics
        self.integrator = integrator

    @property
    def name(self) -> str:
        """swim5 for 5 links, and so on."""
        return f"swim{self.parameters.n_links}"

    @property
    def state_size(self) -> int:
        """2n + 2."""
        return st.reduced_size(self.parameters.n_links)

    @property
    def n_inputs(self) -> int:
        """3n + 2: cos and sin of each angle, each angular velocity, the velocity; 2n + 2 with raw angles."""
        return (3 if self.encoding == "circle" else 2) * self.parameters.n_links + 2

    @property
    def control_limits(self) -> Array:
        """U, shape (n - 1,), N·m."""
        return self.parameters.torque_limits

    def drift_and_control_matrix(self, x: Array) -> tuple[Array, Array]:
        """a, shape (..., 2n + 2), and B, shape (..., 2n + 2, n - 1), of the reduced state."""
        p = self.parameters
        full = st.expand(p, x)
        drift, control_matrix = self.dynamics.drift_and_control_matrix(full)
        # dx/du has no kinematic part, so that reduce_derivative is linear in its columns.
        columns = np.moveaxis(control_matrix, -1, 0)
        B = np.moveaxis(st.reduce_derivative(p, full, columns), 0, -1)
        return st.reduce_derivative(p, full, drift), B

    def reward(self, x: Array) -> Array:
        """Velocity of the centre of mass along x, m/s."""
        return st.split_reduced(x, self.parameters.n_links).velocity[..., 0]

    def step(self, x: Array, u: Array, dt: float) -> Array:
        """x(t + dt) with the torques u held."""
        p = self.parameters
        if self.integrator == "rk4":
            full = rk4_step(lambda y: self.dynamics.derivative(y, u), st.expand(p, x), dt)
            return st.reduce(p, full)

        def f(y: Array) -> Array:
            full = st.expand(p, y)
            return st.reduce_derivative(p, full, self.dynamics.derivative(full, u))

        return euler_step(f, x, dt)

    def initial_states(self, rng: np.random.Generator, count: int) -> Array:
        """Random initial states, shape (count, 2n + 2); see :mod:`swimmer_mj.initial_states`."""
        return random_initial_state(rng, self.parameters.n_links, size=count, law=self.initial_law)

    def inputs(self, x: torch.Tensor) -> torch.Tensor:
        """cos theta, sin theta (or theta), theta' scaled, dG; shape (..., 3n + 2)."""
        n = self.parameters.n_links
        theta, theta_dot, velocity = x[..., :n], x[..., n : 2 * n], x[..., 2 * n :]
        if self.encoding == "angle":
            wrapped = theta - TURN * torch.round(theta / TURN)
            return torch.cat([wrapped, RATE_SCALE * theta_dot, velocity], dim=-1)
        return torch.cat([torch.cos(theta), torch.sin(theta), RATE_SCALE * theta_dot, velocity], dim=-1)

    def compile(self) -> CompiledProblem:
        """The swimmer for the fused kernel, with the reduced equations."""
        n = self.parameters.n_links
        functions = _compiled_functions(n, self.encoding == "circle")
        return CompiledProblem(reduced_constants(self.parameters), compile_reduced_dynamics(n), *functions)


@lru_cache(maxsize=16)
def _compiled_functions(n: int, circle: bool) -> tuple[Any, Any, Any]:
    @njit(error_model="numpy")
    def reward(constants: Any, x: Array) -> float:
        return x[2 * n]

    @njit(error_model="numpy")
    def inputs(x: Array, z: NDArray[Any]) -> None:
        for i in range(n):
            z[i], z[n + i] = cos_sin(x[i])
            z[2 * n + i] = RATE_SCALE * x[n + i]
        z[3 * n] = x[2 * n]
        z[3 * n + 1] = x[2 * n + 1]

    @njit(error_model="numpy")
    def input_pullback(z: NDArray[Any], dVdz: NDArray[Any], dVdx: Array) -> None:
        for i in range(n):
            dVdx[i] = z[i] * dVdz[n + i] - z[n + i] * dVdz[i]
            dVdx[n + i] = RATE_SCALE * dVdz[2 * n + i]
        dVdx[2 * n] = dVdz[3 * n]
        dVdx[2 * n + 1] = dVdz[3 * n + 1]

    @njit(error_model="numpy")
    def angle_inputs(x: Array, z: NDArray[Any]) -> None:
        for i in range(n):
            z[i] = x[i] - TURN * np.rint(x[i] / TURN)
            z[n + i] = RATE_SCALE * x[n + i]
        z[2 * n] = x[2 * n]
        z[2 * n + 1] = x[2 * n + 1]

    @njit(error_model="numpy")
    def angle_pullback(z: NDArray[Any], dVdz: NDArray[Any], dVdx: Array) -> None:
        for i in range(n):
            dVdx[i] = dVdz[i]
            dVdx[n + i] = RATE_SCALE * dVdz[n + i]
        dVdx[2 * n] = dVdz[2 * n]
        dVdx[2 * n + 1] = dVdz[2 * n + 1]

    return (reward, inputs, input_pullback) if circle else (reward, angle_inputs, angle_pullback)
