"""Greedy control and greedy episodes of a network at given weights, done fast: compiled, or in torch.

:class:`BatchActor` is compiled code, on CPUs, for problems with a
:class:`~swimmer_mj.learning.problems.forms.BatchForm` and networks that
:class:`~swimmer_mj.learning.networks.batched.BatchedNetwork` knows. :class:`TorchActor` is for every problem with a
:class:`~swimmer_mj.learning.problems.forms.TorchForm` and every device. What both compute is the same.
"""

from __future__ import annotations

import copy
from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from swimmer_mj.integrators import rk4_step
from swimmer_mj.learning.networks.batched import BLOCK, BatchedNetwork
from swimmer_mj.learning.networks.networks import ValueNetwork
from swimmer_mj.learning.problems.differentiable import require_torch
from swimmer_mj.learning.problems.forms import BatchForm, CostForm, Field, HoldForm, TorchForm
from swimmer_mj.learning.problems.held import Memory, Slope
from swimmer_mj.learning.problems.problem import ControlProblem

__all__ = ["Actor", "BatchActor", "TorchActor", "actor_for", "batch_obstacle"]

Array = NDArray[np.float64]
Real = NDArray[Any]  # the network's dtype


class Actor(Protocol):
    """Of flat weights; states are (N, p), float64, on the CPU."""

    def control(self, weights: Tensor, x: Array) -> Array:
        """Greedy control, shape (N, q)."""
        ...

    def episodes(self, weights: Tensor, x: Array, shares: Array, dt: float) -> Array:
        """Sums (N,) over greedy episodes of the reward rates times ``shares`` (steps,); RK4, control held for dt."""
        ...


class TorchActor:
    """Every problem in torch, every device, by automatic differentiation."""

    def __init__(self, problem: ControlProblem, network: ValueNetwork) -> None:
        self.problem = problem
        self.form: TorchForm = require_torch(problem)
        self.hold = problem.form(HoldForm)
        self.network = copy.deepcopy(network)
        self.parameters = list(self.network.parameters())
        like = self.parameters[0]
        self.dtype, self.device = like.dtype, like.device
        self.limits = torch.tensor(problem.control_limits, dtype=torch.float64, device=self.device)

    def load(self, weights: Tensor) -> None:
        """Set the network's parameters."""
        torch.nn.utils.vector_to_parameters(weights, self.parameters)

    def value_and_slope(
        self, x: Tensor, graph: bool = False, inputs: Field | None = None
    ) -> tuple[Tensor, Tensor]:
        """V (N,) and dV/dx (N, p) at x (N, p), in the network's dtype; with ``inputs`` of x, if not the problem's."""
        with torch.enable_grad():
            x = x.detach().to(self.dtype).requires_grad_()
            V = self.network((self.problem.inputs if inputs is None else inputs)(x))
            (dVdx,) = torch.autograd.grad(V.sum(), x, create_graph=graph)
        return V, dVdx

    def _slope_at(self, x: Array) -> Array:
        """dV/dx (p, N) of x (p, N)."""
        return self.value_and_slope(torch.tensor(x.T, device=self.device))[1].double().cpu().numpy().T

    def greedy(
        self, x: Tensor, dVdx: Tensor, duration: float | None = None, memory: Memory | None = None
    ) -> Tensor:
        """U sign(B^T dV/dx), or what is best held for ``duration``, by default a policy's; shape (N, q)."""
        if self.hold is not None:
            u = self.hold.choose(self._slope_at, x.cpu().numpy(), duration, memory)
            return torch.from_numpy(u).to(self.device)
        gain = torch.einsum("npq,np->nq", self.form.control_matrix(x), dVdx)
        return self.limits * torch.sign(gain)

    def control(self, weights: Tensor, x: Array) -> Array:
        """As in :class:`Actor`."""
        self.load(weights)
        state = torch.tensor(x, device=self.device)
        _, dVdx = self.value_and_slope(state)
        return self.greedy(state, dVdx.double()).cpu().numpy()

    def episodes(self, weights: Tensor, x: Array, shares: Array, dt: float) -> Array:
        """As in :class:`Actor`."""
        form = self.form
        self.load(weights)
        state = torch.tensor(x, device=self.device)
        total = torch.zeros(len(x), dtype=torch.float64, device=self.device)
        for share in shares:
            _, dVdx = self.value_and_slope(state)
            u = self.greedy(state, dVdx.double(), dt)

            def f(y: Tensor, u: Tensor = u) -> Tensor:
                return form.drift(y) + torch.einsum("npq,nq->np", form.control_matrix(y), u)

            total += share * form.reward_rate(state)
            state = rk4_step(f, state, dt)
        return total.cpu().numpy()


class BatchActor:
    """Compiled, on a CPU: trajectories on the last axis, everything in place."""

    def __init__(self, problem: ControlProblem, network: ValueNetwork) -> None:
        form = problem.form(BatchForm)
        if form is None:
            raise TypeError(f"problem {problem.name!r} is not compiled for batches of trajectories")
        self.form, self.hold = form, problem.form(HoldForm)
        self.p, self.q, self.m = problem.state_size, len(problem.control_limits), problem.n_inputs
        self.network = BatchedNetwork(network, form.encoding, self.p)
        self.real: Any = np.float32 if self.network.dtype == torch.float32 else np.float64

    def _padded(self, x: Array) -> tuple[Array, Real, Array, Array, Array, Array]:
        """The states as columns, in whole blocks; room for z, V, dV/dx and u; flips of 1."""
        rows = np.concatenate([x, np.repeat(x[-1:], -len(x) % BLOCK, axis=0)])
        N = len(rows)
        z, V, dVdx = np.empty((self.m, N), self.real), np.empty(N), np.empty((self.p, N))
        return np.ascontiguousarray(rows.T), z, V, dVdx, np.empty((self.q, N)), np.ones((self.q, N))

    def judge(self, weights: Tensor, x: Array, z: Real, V: Array, dVdx: Array) -> None:
        """Fill inputs z (m, N), V (N,) and dVdx (p, N) at x (p, N); N must be a multiple of BLOCK."""
        coordinates = self.form.coordinates
        if coordinates is None:
            self.network.judge(weights, x, z, V, dVdx)
            return
        y = np.empty_like(x)
        coordinates.enter(x, y)
        self.network.judge(weights, y, z, V, dVdx)
        coordinates.to_state(x, dVdx)

    def slope_at(self, weights: Tensor) -> Slope:
        """dV/dx (p, N) of x (p, N)."""

        def slope(x: Array) -> Array:
            state, z, V, dVdx, _, _ = self._padded(x.T)
            self.judge(weights, state, z, V, dVdx)
            return dVdx[:, : x.shape[1]]

        return slope

    def control(self, weights: Tensor, x: Array) -> Array:
        """As in :class:`Actor`."""
        if self.hold is not None:  # its steps are dear: none for padding
            return self.hold.choose(self.slope_at(weights), x, None)
        state, z, V, dVdx, u, flips = self._padded(x)
        self.judge(weights, state, z, V, dVdx)
        self.form.greedy_step(self.slope_at(weights), state, dVdx, flips, 0.0, u, state)
        return u[:, : len(x)].T.copy()

    def episodes(self, weights: Tensor, x: Array, shares: Array, dt: float) -> Array:
        """As in :class:`Actor`."""
        state, z, V, dVdx, u, flips = self._padded(x)
        total, later = np.zeros(state.shape[1]), np.empty_like(state)
        slope_at = self.slope_at(weights)
        for share in shares:
            self.judge(weights, state, z, V, dVdx)
            self.form.greedy_rk4(slope_at, state, dVdx, flips, dt, u, later)
            total += share * self.form.reward(state, u)
            state, later = later, state
        return total[: len(x)]


def batch_obstacle(problem: ControlProblem, network: ValueNetwork) -> str | None:
    """Why there can be no :class:`BatchActor`; None if there can."""
    if problem.form(BatchForm) is None:
        return f"needs a problem that is compiled for batches of trajectories, and {problem.name!r} is not"
    if next(network.parameters()).device.type != "cpu":
        return "runs on the CPU"
    try:
        BatchedNetwork.check(network)
    except TypeError as error:
        return str(error)
    return None


def actor_for(problem: ControlProblem, network: ValueNetwork) -> Actor | None:
    """The fastest there is; None for a problem that is neither compiled for batches nor stated in torch.

    In torch nobody has said what controls cost.
    """
    if batch_obstacle(problem, network) is None:
        return BatchActor(problem, network)
    in_torch = problem.form(TorchForm) is not None and problem.form(CostForm) is None
    return TorchActor(problem, network) if in_torch else None
