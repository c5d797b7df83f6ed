"""The compiled swimmer as a differentiable step of torch: what peers that use the model have in common.

The equations and their transposed Jacobian are those that value gradients use, so that algorithms are compared, not
engines. Trajectories are on the last axis; their number is a multiple of LANES.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from swimmer_mj.compiled.vectors import LANES
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.learning.problems.swim.batched_costates import pullback
from swimmer_mj.learning.problems.swim.batched_equations import step, workspace
from swimmer_mj.learning.problems.swim.reduced import reduced_constants

Array = NDArray[np.float64]


class SwimEngine:
    """Steps of N swimmers with torques held, and what their gradients need; counts both."""

    def __init__(self, problem: Swimming, dt: float = 0.01, hold: int = 1) -> None:
        self.problem, self.dt, self.hold = problem, dt, hold
        self.p, self.q = problem.state_size, len(problem.control_limits)
        self.velocity = 2 * problem.parameters.n_links
        self._ws, self._constants = (
            workspace(problem.parameters.n_links),
            reduced_constants(problem.parameters),
        )
        self.simulation_steps = 0
        """Steps of dt so far, of all swimmers."""
        self.gradient_evaluations = 0
        """Steps of dt through which gradients were followed."""

    def forward(self, x: Array, u: Array) -> tuple[Array, Array]:
        """States (hold + 1, p, N) from x (p, N) on under u (q, N), and the mean velocity along x, (N,), m/s."""
        if x.shape[1] % LANES or (x.shape[0], *u.shape) != (self.p, self.q, x.shape[1]):
            raise ValueError(
                f"states must be ({self.p}, N) and torques ({self.q}, N), N a multiple of {LANES}; "
                f"got {x.shape} and {u.shape}"
            )
        states = np.empty((self.hold + 1, *x.shape))
        states[0] = x
        for k in range(self.hold):
            step(self._ws, self._constants, states[k], u, self.dt, states[k + 1])
        self.simulation_steps += self.hold * x.shape[1]
        return states, states[1:, self.velocity].mean(axis=0)

    def backward(self, states: Array, u: Array, d_y: Array, d_reward: Array) -> tuple[Array, Array]:
        """Of the adjoints of the last states and of the mean velocity, those of the first states and of u."""
        costate, earlier = d_y.copy(), np.empty_like(d_y)
        d_u, part = np.zeros_like(u), np.empty_like(u)
        for k in range(self.hold - 1, -1, -1):
            costate[self.velocity] += d_reward / self.hold
            pullback(self._ws, self._constants, states[k], u, self.dt, costate, earlier, part)
            d_u += part
            costate, earlier = earlier, costate
        self.gradient_evaluations += self.hold * u.shape[1]
        return costate, d_u

    def step(self, x: Tensor, u: Tensor) -> tuple[Tensor, Tensor]:
        """States (p, N) after ``hold`` steps from x (p, N) under u (q, N), and the mean velocity (N,)."""
        return _HeldStep.apply(x, u, self)  # pyright: ignore[reportReturnType]


class _HeldStep(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: Tensor, u: Tensor, engine: SwimEngine) -> tuple[Tensor, Tensor]:
        ctx.engine, ctx.u = engine, u.detach().numpy()
        ctx.states, reward = engine.forward(x.detach().numpy(), ctx.u)
        return torch.from_numpy(ctx.states[-1].copy()), torch.from_numpy(reward)

    @staticmethod
    def backward(ctx: Any, *adjoints: Tensor) -> tuple[Tensor, Tensor, None]:
        d_y, d_reward = (adjoint.contiguous().numpy() for adjoint in adjoints)
        d_x, d_u = ctx.engine.backward(ctx.states, ctx.u, d_y, d_reward)
        return torch.from_numpy(d_x.copy()), torch.from_numpy(d_u), None
