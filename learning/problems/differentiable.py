"""Control problems as torch functions, so that their Jacobians come from automatic differentiation.

A problem of one's own needs no more than :class:`DifferentiableProblem` asks for; docs/own-problem.md has one. The
problems of this package are given in the same form by :func:`differentiable`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from swimmer_mj.learning.problems.pendulum.pendulum import Pendulum
from swimmer_mj.learning.problems.problem import ControlProblem, step_by_euler
from swimmer_mj.learning.problems.swim.reduced import reduced_constants
from swimmer_mj.learning.problems.swim.swimming import Swimming
from swimmer_mj.parameters import SwimmerParameters

__all__ = ["DifferentiableProblem", "differentiable", "transition", "transition_pullback"]

Array = NDArray[np.float64]
Field = Callable[[Tensor], Tensor]


def _itself(x: Tensor) -> Tensor:
    return x


@dataclass(frozen=True)
class DifferentiableProblem:
    """dx/dt = a(x) + B(x) u with |u_i| <= U_i and reward rate r(x), all of them torch functions of batches of states.

    It is a :class:`swimmer_mj.learning.problems.problem.ControlProblem`, for which the same functions serve in float64.
    """

    name: str
    """What to call it in a table."""
    drift: Field
    """a: (N, p) -> (N, p), differentiable."""
    control_matrix: Field
    """B: (N, p) -> (N, p, q), differentiable."""
    reward_rate: Field
    """r: (N, p) -> (N,), differentiable."""
    limits: tuple[float, ...]
    """U, one per control."""
    draw: Callable[[np.random.Generator, int], Array]
    """The law of initial states: (generator, count) -> (count, p). p is read from it."""
    s_gamma: float = 1.0
    """Shortness factor, 1/s."""
    encode: Field = field(default=_itself)
    """Network inputs of a state, (N, p) -> (N, m), differentiable: for instance cos and sin in place of an angle.

    V does not depend on a state variable that is left out: its slope is 0 and is not learned."""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.s_gamma) and self.s_gamma > 0):
            raise ValueError(f"s_gamma must be positive and finite, got {self.s_gamma!r}")
        if not self.limits or not all(math.isfinite(U) and U > 0 for U in self.limits):
            raise ValueError(f"limits must be positive and finite, one per control; got {self.limits!r}")
        drawn = np.shape(self.draw(np.random.default_rng(0), 3))
        if len(drawn) != 2 or drawn[0] != 3:
            raise ValueError(f"draw must return shape (count, p), got {drawn} for a count of 3")
        p, q = drawn[1], len(self.limits)
        n = p + q + 1  # states: neither p nor q
        x = self._sample.expand(n, p)
        for name, value, shape in (
            ("drift", self.drift(x), (n, p)),
            ("control_matrix", self.control_matrix(x), (n, p, q)),
            ("reward_rate", self.reward_rate(x), (n,)),
        ):
            if value.shape != shape:
                raise ValueError(
                    f"{name} must return shape {shape} for states ({n}, {p}), got {tuple(value.shape)}"
                )
            if not bool(torch.isfinite(value).all()):
                raise ValueError(f"{name} is not finite at {self._sample[0].tolist()}")
        z = self.encode(x)
        if z.ndim != 2 or len(z) != n:
            raise ValueError(f"encode must return shape ({n}, m) for states ({n}, {p}), got {tuple(z.shape)}")

    @cached_property
    def _sample(self) -> Tensor:
        return torch.from_numpy(np.asarray(self.draw(np.random.default_rng(0), 1), dtype=np.float64))

    @property
    def state_size(self) -> int:
        """p."""
        return self._sample.shape[1]

    @property
    def n_inputs(self) -> int:
        """m."""
        return self.encode(self._sample).shape[-1]

    @property
    def control_limits(self) -> Array:
        """U, shape (q,)."""
        return np.array(self.limits, dtype=np.float64)

    def _numpy(self, function: Field, x: Array) -> Array:
        x = np.asarray(x, dtype=np.float64)
        flat = torch.from_numpy(x.reshape(-1, x.shape[-1]))
        with torch.no_grad():
            result = function(flat).numpy()
        return result.reshape(*x.shape[:-1], *result.shape[1:])

    def drift_and_control_matrix(self, x: Array) -> tuple[Array, Array]:
        """a(x), shape (..., p), and B(x), shape (..., p, q)."""
        return self._numpy(self.drift, x), self._numpy(self.control_matrix, x)

    def reward(self, x: Array) -> Array:
        """r(x), shape (...)."""
        return self._numpy(self.reward_rate, x)

    def step(self, x: Array, u: Array, dt: float) -> Array:
        """x(t + dt) by Euler's method, u held."""
        return step_by_euler(self, x, u, dt)

    def initial_states(self, rng: np.random.Generator, count: int) -> Array:
        """``count`` draws from the law of initial states, shape (count, p)."""
        return np.asarray(self.draw(rng, count), dtype=np.float64)

    def inputs(self, x: Tensor) -> Tensor:
        """The network's inputs, shape (..., m)."""
        z = self.encode(x.reshape(-1, x.shape[-1]))
        return z.reshape(*x.shape[:-1], z.shape[-1])

    def compile(self) -> None:
        """There is no compiled form."""
        return


def transition(problem: DifferentiableProblem, x: Tensor, u: Tensor, dt: float) -> Tensor:
    """x(t + dt) by Euler's method with u (N, q) held, shape (N, p)."""
    return x + dt * (problem.drift(x) + torch.einsum("npq,nq->np", problem.control_matrix(x), u))


def transition_pullback(
    problem: DifferentiableProblem, x: Tensor, u: Tensor, dt: float, costate: Tensor
) -> Tensor:
    """F^T costate with F = d x(t + dt) / d x at held u, shape (N, p); exact, by torch.func.vjp."""
    pullback = torch.func.vjp(lambda y: transition(problem, y, u, dt), x)[1]
    return pullback(costate)[0]


def differentiable(problem: ControlProblem) -> DifferentiableProblem:
    """``problem`` as torch functions."""
    if isinstance(problem, DifferentiableProblem):
        return problem
    if type(problem) is Swimming:  # not a subclass, which may have equations or a reward of its own
        return _swimming(problem)
    if type(problem) is Pendulum:
        return _pendulum(problem)
    raise TypeError(f"problem {problem.name!r} has no torch form; describe it as a DifferentiableProblem")


def _pendulum(problem: Pendulum) -> DifferentiableProblem:
    inertia = problem.mass * problem.length**2
    weight_moment = problem.mass * problem.gravity * problem.length

    def drift(x: Tensor) -> Tensor:
        theta, theta_dot = x[..., 0], x[..., 1]
        moment = weight_moment * torch.sin(theta) - problem.damping * theta_dot
        return torch.stack([theta_dot, moment / inertia], dim=-1)

    def control_matrix(x: Tensor) -> Tensor:
        return x.new_tensor([[0.0], [1.0 / inertia]]).expand(*x.shape, 1)

    return DifferentiableProblem(
        problem.name,
        drift,
        control_matrix,
        lambda x: torch.cos(x[..., 0]),
        (problem.torque_limit,),
        problem.initial_states,
        problem.s_gamma,
        problem.inputs,
    )


def _swimming(problem: Swimming) -> DifferentiableProblem:
    equations = _ReducedEquations(problem.parameters)
    n = problem.parameters.n_links
    return DifferentiableProblem(
        problem.name,
        equations.drift,
        equations.control_matrix,
        lambda x: x[..., 2 * n],
        tuple(problem.control_limits.tolist()),
        problem.initial_states,
        problem.s_gamma,
        problem.inputs,
    )


class _ReducedEquations:
    """The equations of :mod:`swimmer_mj.learning.problems.swim.reduced` in torch, for any number of links."""

    def __init__(self, parameters: SwimmerParameters) -> None:
        self.n = parameters.n_links
        self.constants = reduced_constants(parameters)

    def _inertia(self, x: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """cos and sin of theta_i - theta_j, and the inertia matrix, each (N, n, n)."""
        theta = x[..., : self.n]
        difference = theta[..., :, None] - theta[..., None, :]
        cosine = torch.cos(difference)
        return cosine, torch.sin(difference), x.new_tensor(self.constants.K) * cosine

    def drift(self, x: Tensor) -> Tensor:
        n, constants = self.n, self.constants
        C, K = x.new_tensor(constants.C), x.new_tensor(constants.K)
        cosine, sine, inertia = self._inertia(x)
        c, s = torch.cos(x[..., :n]), torch.sin(x[..., :n])
        omega, velocity = x[..., n : 2 * n], x[..., 2 * n :]
        lever = C * cosine
        normal_velocity = velocity[..., 1:] * c - velocity[..., :1] * s + (lever @ omega[..., None])[..., 0]
        F = -x.new_tensor(constants.drag) * normal_velocity
        Q = (
            (lever.mT @ F[..., None])[..., 0]
            - x.new_tensor(constants.rotational_drag) * omega
            - ((K * sine) @ (omega**2)[..., None])[..., 0]
        )
        acceleration = torch.linalg.solve(inertia, Q)
        force = torch.stack([-(F * s).sum(-1), (F * c).sum(-1)], dim=-1)
        return torch.cat([omega, acceleration, force / constants.total_mass], dim=-1)

    def control_matrix(self, x: Tensor) -> Tensor:
        n = self.n
        joints = np.arange(n - 1)
        T = np.zeros((n, n - 1))
        T[joints, joints], T[joints + 1, joints] = -1.0, 1.0
        _, _, inertia = self._inertia(x)
        acceleration = torch.linalg.solve(inertia, x.new_tensor(T).expand(*x.shape[:-1], n, n - 1))
        zeros = x.new_zeros(*x.shape[:-1], n, n - 1)
        return torch.cat([zeros, acceleration, zeros[..., :2, :]], dim=-2)
