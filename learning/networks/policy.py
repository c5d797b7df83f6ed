"""The greedy policy of a value network."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, NamedTuple, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from swimmer_mj.learning.networks.actors import Actor, BatchActor, actor_for
from swimmer_mj.learning.networks.networks import ValueNetwork
from swimmer_mj.learning.problems.forms import CostForm, HoldForm, Judgement
from swimmer_mj.learning.problems.held import Slope
from swimmer_mj.learning.problems.problem import ControlProblem, as_states, episode_sums

__all__ = ["Decision", "GreedyPolicy", "decision", "greedy_control", "hamiltonian"]

Array = NDArray[np.float64]
T = TypeVar("T", float, Array, Tensor)
Network = TypeVar("Network", bound=ValueNetwork)


def greedy_control(B: Array, dVdx: Array, limits: Array, cost: Array | None = None) -> Array:
    """argmax_u of dV/dx . (a + B u) - sum_i c_i u_i^2 with |u_i| <= U_i, shape (..., q).

    U_i sign([B^T dV/dx]_i) where a control costs nothing, 0 if either sign is as good; else [B^T dV/dx]_i / 2 c_i,
    clipped.
    """
    advantage = np.einsum("...pq,...p->...q", B, dVdx)
    u = limits * np.sign(advantage)
    if cost is None:
        return u
    linear = np.divide(advantage, 2 * cost, out=np.zeros_like(u), where=cost > 0)
    return np.where(cost > 0, np.clip(linear, -limits, limits), u)


def hamiltonian(r: T, V: T, dVdx: Array, f: Array, s_gamma: float) -> T:
    """H = r - s_gamma V + dV/dx . f, the continuous equivalent of Bellman's residual."""
    return r - s_gamma * V + (dVdx * f).sum(axis=-1)


class Decision(NamedTuple):
    """What greedy control does at states; leading axes are those of the states."""

    control: Array
    """u, shape (..., q)."""
    reward: Array
    """r(x), what u costs taken off, shape (...)."""


def decision(
    problem: ControlProblem,
    x: Array,
    dVdx: Array,
    B: Array,
    slope: Callable[[], Slope],
    duration: float | None = None,
) -> Decision:
    """The greedy control at ``x`` (..., p), and what it earns, as ``problem`` has them.

    It is that of the instant, by dV/dx and B there. Where the problem chooses controls to be held, it is the best for
    ``duration`` in s, by the ``slope`` of V elsewhere; None: for as long as a policy's are.
    """
    priced, hold = problem.form(CostForm), problem.form(HoldForm)
    cost = None if priced is None else priced.coefficients(x)
    limits, r = problem.control_limits, problem.reward(x)
    u = greedy_control(B, dVdx, limits, cost) if hold is None else hold.choose(slope(), x, duration)
    return Decision(u, r if cost is None else r - (cost * u**2).sum(axis=-1))


class GreedyPolicy(Generic[Network]):
    """pi(x) = argmax_u of dV/dx . f(x, u), for one state or a batch."""

    def __init__(self, problem: ControlProblem, network: Network) -> None:
        self.problem = problem
        self.network = network

    def judge(self, x: Array) -> Judgement:
        """Control, value and Hamiltonian at ``x``, shape (..., p)."""
        problem = self.problem
        if np.shape(x)[-1:] != (problem.state_size,):
            raise ValueError(
                f"x must have shape (..., {problem.state_size}) for {problem.name!r}, got {np.shape(x)}"
            )
        V, slope = self._value_and_slope(x)
        dVdx = slope.double().numpy()
        a, B = problem.drift_and_control_matrix(x)
        u, r = decision(problem, x, dVdx, B, self.slope)
        f = a + np.einsum("...pq,...q->...p", B, u)
        value = V.double().numpy()
        return Judgement(u, value, hamiltonian(r, value, dVdx, f, problem.s_gamma))

    def slope(self, actor: Actor | None = None) -> Slope:
        """V's, by the weights as they are: by ``actor``, else by a new one, for others may judge at the same time."""
        actor = actor or actor_for(self.problem, self.network)
        return actor.slope_at(self._weights()) if isinstance(actor, BatchActor) else self._slope_at

    def _slope_at(self, x: Array) -> Array:
        """dV/dx (p, N) at x (p, N)."""
        return self._value_and_slope(x.T)[1].double().numpy().T

    def _value_and_slope(self, x: Array) -> tuple[Tensor, Tensor]:
        """V (...) and dV/dx (..., p) at x (..., p), also for a caller who has turned gradients off."""
        dtype = next(self.network.parameters()).dtype
        with torch.inference_mode(False), torch.enable_grad():
            state = torch.tensor(x, dtype=dtype, requires_grad=True)
            V = self.network(self.problem.inputs(state))
            (slope,) = torch.autograd.grad(V.sum(), state)
            return V.detach(), slope

    def __call__(self, x: Array) -> Array:
        """u, shape (..., q), at ``x``, shape (..., p)."""
        return self.judge(x).control

    def acting(self) -> Callable[[Array], Array]:
        """u (N, q) at x (N, p) by the fastest actor there is, with the weights as they are now."""
        actor = actor_for(self.problem, self.network)
        if actor is None:
            return self
        weights = self._weights()
        return lambda x: actor.control(weights, as_states(x, self.problem.state_size))

    def episodes(self, states: Array, shares: Array, dt: float) -> Array:
        """Sums (N,) of the reward rates times ``shares`` (steps,) over episodes from ``states``, (N, p).

        By RK4, control held for ``dt``; by the fastest actor there is.
        """
        states = as_states(states, self.problem.state_size)
        actor = actor_for(self.problem, self.network)
        if actor is None:
            priced = self.problem.form(CostForm)
            return episode_sums(
                self.problem, self, states, shares, dt, None if priced is None else priced.coefficients
            )
        return actor.episodes(self._weights(), states, shares, dt)

    def _weights(self) -> Tensor:
        """A copy of all weights in a row."""
        return torch.cat([weight.detach().flatten() for weight in self.network.parameters()])
