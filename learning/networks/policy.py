"""The greedy policy of a value network, as a function of states and as a dm_control agent."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Generic, NamedTuple, TypeVar

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray

from swimmer_mj import state as st
from swimmer_mj.learning.networks.networks import ValueNetwork
from swimmer_mj.learning.problems.problem import ControlProblem
from swimmer_mj.learning.td.continuous_td import greedy_control, hamiltonian

__all__ = ["GreedyPolicy", "Judgement", "SwimmingPolicy", "observed_state"]

Array = NDArray[np.float64]
Network = TypeVar("Network", bound=ValueNetwork)


class Judgement(NamedTuple):
    """What a value network makes of states; leading axes are those of the states."""

    control: Array
    """Greedy control u, shape (..., q)."""
    value: Array
    """V(x), shape (...)."""
    hamiltonian: Array
    """H(x), shape (...)."""


class GreedyPolicy(Generic[Network]):
    """pi(x) = argmax_u of dV/dx . f(x, u), for one state or a batch."""

    def __init__(self, problem: ControlProblem, network: Network) -> None:
        self.problem = problem
        self.network = network

    def judge(self, x: Array) -> Judgement:
        """Control, value and Hamiltonian at ``x``, shape (..., p)."""
        problem = self.problem
        dtype = next(self.network.parameters()).dtype
        state = torch.tensor(x, dtype=dtype, requires_grad=True)
        V = self.network(problem.inputs(state))
        (slope,) = torch.autograd.grad(V.sum(), state)
        dVdx = slope.double().numpy()
        a, B = problem.drift_and_control_matrix(x)
        u = greedy_control(B, dVdx, problem.control_limits)
        f = a + np.einsum("...pq,...q->...p", B, u)
        value = V.detach().double().numpy()
        return Judgement(u, value, hamiltonian(problem.reward(x), value, dVdx, f, problem.s_gamma))

    def __call__(self, x: Array) -> Array:
        """u, shape (..., q), at ``x``, shape (..., p)."""
        return self.judge(x).control


def observed_state(observation: Mapping[str, ArrayLike]) -> Array:
    """The reduced state, in the target's frame, that a swim or steer task observes."""
    return st.join_reduced(observation["angles"], observation["angular_velocities"], observation["velocity"])


class SwimmingPolicy:
    """A greedy policy as an agent: observation of a swim or steer task -> action in [-1, 1]."""

    def __init__(self, policy: GreedyPolicy) -> None:
        self.policy = policy

    def __call__(self, observation: Mapping[str, ArrayLike]) -> Array:
        """Action, shape (..., n - 1)."""
        return self.policy(observed_state(observation)) / self.policy.problem.control_limits
