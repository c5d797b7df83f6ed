"""What a learner of value gradients needs done fast, twice and with the same results.

One engine is torch, for every problem and device, with Jacobians by torch.func. The other is compiled code for the
swimmer on CPUs (:mod:`swimmer_mj.learning.problems.swim.batched`, :mod:`swimmer_mj.learning.networks.batched`).
"""

from __future__ import annotations

import copy
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from swimmer_mj.analytic import AnalyticSwimmer
from swimmer_mj.dynamics import MujocoSwimmer
from swimmer_mj.integrators import rk4_step
from swimmer_mj.learning.networks.batched import BLOCK, BatchedNetwork, Encoding
from swimmer_mj.learning.networks.networks import Cascade, ValueNetwork
from swimmer_mj.learning.problems.differentiable import (
    DifferentiableProblem,
    differentiable,
    transition,
    transition_pullback,
)
from swimmer_mj.learning.problems.problem import ControlProblem
from swimmer_mj.learning.problems.swim import batched as batched_swimmer
from swimmer_mj.learning.problems.swim.reduced import reduced_constants
from swimmer_mj.learning.problems.swim.swimming import RATE_SCALE, Swimming
from swimmer_mj.learning.value_gradient.equations import (
    ValueGradientSettings,
    targets,
    value_and_gradient_loss,
)

__all__ = ["Batch", "Engine", "engine_for", "swimming_encoding"]

Array = NDArray[np.float64]
Real = NDArray[Any]  # the network's dtype


class Batch(NamedTuple):
    """A round's states and targets, in an engine's own layout."""

    data: Any
    reward: float
    value: float


class Engine(Protocol):
    """What a learner needs done fast. States are (N, p), float64, on the CPU."""

    name: str
    """"torch" or "compiled"."""

    def collect(self, weights: Tensor, x: Array, flips: Array) -> tuple[Batch, Array]:
        """Trajectories from ``x`` under greedy control times ``flips`` (T, N, q): targets, and their last states."""
        ...

    def shuffle(self, batch: Batch, order: Tensor) -> Batch:
        """Its states in another order."""
        ...

    def loss_gradient(self, weights: Tensor, batch: Batch, start: int, out: Tensor) -> tuple[float, float]:
        """The loss's gradient over the minibatch at ``start`` into ``out``; the two errors."""
        ...

    def control(self, weights: Tensor, x: Array) -> Array:
        """Greedy control, shape (N, q)."""
        ...

    def episodes(self, weights: Tensor, x: Array, shares: Array, dt: float) -> Array:
        """Sums (N,) over greedy episodes of the reward rates times ``shares`` (steps,); RK4, control held for dt."""
        ...


def _slope_weights(problem: ControlProblem, w: float) -> Tensor:
    """w S_i^2, shape (p,): S_i = 1 / |dz/dx_i|, over a sample of initial states; 0 where x_i does not move z there."""
    sample = torch.from_numpy(problem.initial_states(np.random.default_rng(0), 256)).double()
    jacobian = torch.func.vmap(torch.func.jacrev(problem.inputs))(sample)
    squared = jacobian.square().sum(dim=1).mean(dim=0)
    if not bool(torch.isfinite(squared).all()):
        raise ValueError(
            f"{problem.name}: the derivatives of the network's inputs are not finite at some initial state"
        )
    return torch.where(squared > 0, w / squared, 0.0)


class _TorchEngine:
    """Every problem, every device, by automatic differentiation."""

    name = "torch"

    def __init__(
        self, problem: DifferentiableProblem, network: ValueNetwork, settings: ValueGradientSettings
    ) -> None:
        self.problem = problem
        self.settings = settings
        self.network = copy.deepcopy(network)
        self.parameters = list(self.network.parameters())
        like = self.parameters[0]
        self.dtype, self.device = like.dtype, like.device
        self.limits = torch.tensor(problem.control_limits, dtype=torch.float64, device=self.device)
        self.slope_weights = _slope_weights(problem, settings.slope_weight).to(like)

    def _load(self, weights: Tensor) -> None:
        torch.nn.utils.vector_to_parameters(weights, self.parameters)

    def _value_and_slope(self, x: Tensor, graph: bool = False) -> tuple[Tensor, Tensor]:
        with torch.enable_grad():
            x = x.detach().to(self.dtype).requires_grad_()
            V = self.network(self.problem.inputs(x))
            (dVdx,) = torch.autograd.grad(V.sum(), x, create_graph=graph)
        return V, dVdx

    def _greedy(self, x: Tensor, dVdx: Tensor) -> Tensor:
        gain = torch.einsum("npq,np->nq", self.problem.control_matrix(x), dVdx)
        return self.limits * torch.sign(gain)

    def collect(self, weights: Tensor, x: Array, flips: Array) -> tuple[Batch, Array]:
        problem, settings, dt = self.problem, self.settings, self.settings.dt
        self._load(weights)
        state = torch.tensor(x, device=self.device)
        flip = torch.tensor(flips, device=self.device)
        states, controls, values, slopes = [], [], [], []
        for t in range(len(flip) + 1):
            V, dVdx = self._value_and_slope(state)
            states.append(state)
            values.append(V.detach().double())
            slopes.append(dVdx.double())
            if t < len(flip):
                controls.append(self._greedy(state, slopes[-1]) * flip[t])
                state = transition(problem, state, controls[-1], dt)
        X = torch.stack(states[:-1])
        drdx, r = torch.func.vmap(torch.func.grad_and_value(lambda y: problem.reward_rate(y[None])[0]))(
            X.flatten(0, 1)
        )
        G, g = targets(
            r.view(X.shape[:2]),
            drdx.view(X.shape),
            torch.stack(values),
            torch.stack(slopes),
            lambda t, later: transition_pullback(problem, states[t], controls[t], dt, later),
            problem.s_gamma,
            settings.s_lambda,
            dt,
        )
        data = tuple(y.flatten(0, 1).to(self.dtype) for y in (X, G, g))
        return Batch(data, float(r.mean()), float(torch.stack(values).mean())), state.cpu().numpy()

    def shuffle(self, batch: Batch, order: Tensor) -> Batch:
        order = order.to(self.device)
        return batch._replace(data=tuple(y[order] for y in batch.data))

    def loss_gradient(self, weights: Tensor, batch: Batch, start: int, out: Tensor) -> tuple[float, float]:
        self._load(weights)
        X, G, g = (y[start : start + self.settings.minibatch] for y in batch.data)
        V, dVdx = self._value_and_slope(X, graph=True)
        with torch.enable_grad():
            loss, value_error, slope_error = value_and_gradient_loss(
                V, G, dVdx, g, self.settings.value_weight, self.slope_weights
            )
            gradients = torch.autograd.grad(loss, self.parameters)
        torch.cat([y.flatten() for y in gradients], out=out)
        if isinstance(self.network, Cascade):  # a missing connection stays missing
            out *= self.network.connected.flatten().to(out)
        return float(value_error.detach()), float(slope_error.detach())

    def control(self, weights: Tensor, x: Array) -> Array:
        self._load(weights)
        state = torch.tensor(x, device=self.device)
        _, dVdx = self._value_and_slope(state)
        return self._greedy(state, dVdx.double()).cpu().numpy()

    def episodes(self, weights: Tensor, x: Array, shares: Array, dt: float) -> Array:
        problem = self.problem
        self._load(weights)
        state = torch.tensor(x, device=self.device)
        total = torch.zeros(len(x), dtype=torch.float64, device=self.device)
        for share in shares:
            _, dVdx = self._value_and_slope(state)
            u = self._greedy(state, dVdx.double())

            def f(y: Tensor, u: Tensor = u) -> Tensor:
                return problem.drift(y) + torch.einsum("npq,nq->np", problem.control_matrix(y), u)

            total += share * problem.reward_rate(state)
            state = rk4_step(f, state, dt)
        return total.cpu().numpy()


def swimming_encoding(n: int) -> Encoding:
    """The inputs of :class:`swimmer_mj.learning.problems.swim.swimming.Swimming` for ``n`` links."""
    i = np.arange(n)
    linear = np.arange(n, 2 * n + 2)
    return Encoding(i, i, n + i, linear, linear + n, np.array([RATE_SCALE] * n + [1.0, 1.0]))


class _CompiledEngine:
    """The swimmer on a CPU: trajectories on the last axis, everything in place."""

    name = "compiled"

    def __init__(self, problem: Swimming, network: ValueNetwork, settings: ValueGradientSettings) -> None:
        n = problem.parameters.n_links
        self.problem = problem
        self.settings = settings
        self.p, self.q, self.m = problem.state_size, n - 1, problem.n_inputs
        self.constants = reduced_constants(problem.parameters)
        self.limits = problem.control_limits
        self.network = BatchedNetwork(network, swimming_encoding(n), self.p)
        self.ws = batched_swimmer.workspace(n)
        self.real: Any = np.float32 if self.network.dtype == torch.float32 else np.float64
        self.slope_weights = _slope_weights(problem, settings.slope_weight).numpy().astype(self.real)

    def collect(self, weights: Tensor, x: Array, flips: Array) -> tuple[Batch, Array]:
        settings, p, q, m = self.settings, self.p, self.q, self.m
        T, N = len(flips), settings.trajectories
        flip = np.ascontiguousarray(flips.transpose(0, 2, 1))
        X, U = np.empty((T + 1, p, N)), np.empty((T, q, N))
        z, V, dVdx = np.empty((T + 1, m, N), self.real), np.empty((T + 1, N)), np.empty((T + 1, p, N))
        X[0] = x.T
        for t in range(T + 1):
            self.network.judge(weights, X[t], z[t], V[t], dVdx[t])
            if t < T:
                batched_swimmer.greedy_step(
                    self.ws, self.constants, self.limits, X[t], dVdx[t], flip[t], settings.dt, U[t], X[t + 1]
                )
        data = np.empty((T, m + p + 1, N), self.real)
        data[:, :m] = z[:T]
        batched_swimmer.targets(
            self.ws,
            self.constants,
            X,
            U,
            V,
            dVdx,
            settings.dt,
            self.problem.s_gamma,
            settings.s_lambda,
            data[:, m:],
        )
        r = X[:T, p - 2]
        rows = torch.from_numpy(data).transpose(0, 1).reshape(m + p + 1, T * N)
        return Batch(rows, float(r.mean()), float(V.mean())), X[T].T.copy()

    def shuffle(self, batch: Batch, order: Tensor) -> Batch:
        return batch._replace(data=batch.data[:, order])

    def loss_gradient(self, weights: Tensor, batch: Batch, start: int, out: Tensor) -> tuple[float, float]:
        settings = self.settings
        return self.network.loss_gradient(
            weights,
            batch.data.numpy(),
            start,
            settings.minibatch,
            settings.value_weight,
            self.slope_weights,
            out,
        )

    def _padded(self, x: Array) -> tuple[Array, Real, Array, Array, Array, Array]:
        """The states as columns, in whole blocks; room for z, V, dV/dx and u; flips of 1."""
        rows = np.concatenate([x, np.repeat(x[-1:], -len(x) % BLOCK, axis=0)])
        N = len(rows)
        z, V, dVdx = np.empty((self.m, N), self.real), np.empty(N), np.empty((self.p, N))
        return np.ascontiguousarray(rows.T), z, V, dVdx, np.empty((self.q, N)), np.ones((self.q, N))

    def control(self, weights: Tensor, x: Array) -> Array:
        state, z, V, dVdx, u, flips = self._padded(x)
        self.network.judge(weights, state, z, V, dVdx)
        batched_swimmer.greedy_step(self.ws, self.constants, self.limits, state, dVdx, flips, 0.0, u, state)
        return u[:, : len(x)].T.copy()

    def episodes(self, weights: Tensor, x: Array, shares: Array, dt: float) -> Array:
        state, z, V, dVdx, u, flips = self._padded(x)
        total = np.zeros(state.shape[1])
        for share in shares:
            self.network.judge(weights, state, z, V, dVdx)
            total += share * state[self.p - 2]
            batched_swimmer.greedy_rk4(self.ws, self.constants, self.limits, state, dVdx, flips, dt, u, state)
        return total[: len(x)]


def engine_for(
    problem: ControlProblem,
    network: ValueNetwork,
    settings: ValueGradientSettings,
    engine: Literal["auto", "compiled", "torch"] = "auto",
) -> Engine:
    """The engine of that name; "auto" compiles what can be."""
    if engine not in ("auto", "compiled", "torch"):
        raise ValueError(f"engine must be 'auto', 'compiled' or 'torch', got {engine!r}")
    if isinstance(problem, Swimming) and not isinstance(problem.dynamics, AnalyticSwimmer | MujocoSwimmer):
        raise ValueError(
            f"{type(problem.dynamics).__name__} has no derivatives; describe it as a DifferentiableProblem"
        )
    obstacle = _obstacle(problem, network, settings)
    if engine == "compiled" and obstacle:
        raise ValueError(f"engine 'compiled' {obstacle}; use 'torch'")
    if engine == "torch" or obstacle:
        return _TorchEngine(differentiable(problem), network, settings)
    assert isinstance(problem, Swimming)
    return _CompiledEngine(problem, network, settings)


def _obstacle(problem: ControlProblem, network: ValueNetwork, settings: ValueGradientSettings) -> str | None:
    """Why this cannot be compiled, to be read after "engine 'compiled'"."""
    if type(problem) is not Swimming:  # a subclass may have equations or a reward of its own
        return f"knows Swimming, not {type(problem).__name__} ({problem.name!r})"
    if problem.encoding != "circle":
        return f"encodes angles as 'circle', not as {problem.encoding!r}"
    if next(network.parameters()).device.type != "cpu":
        return "runs on the CPU"
    try:
        BatchedNetwork.check(network)
    except TypeError as error:
        return str(error)
    for name in ("trajectories", "minibatch"):
        if getattr(settings, name) % BLOCK:
            return f"needs {name} to be a multiple of {BLOCK}, not {getattr(settings, name)}"
    return None
