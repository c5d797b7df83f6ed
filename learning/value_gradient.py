"""Learning the value gradient: what greedy control asks for, taught directly.

The greedy control depends on dV/dx, not on V. Along a trajectory x(0), x(dt) .. x(T dt) with its controls held, the
model gives targets for both, backwards in time. With F = d x(t + dt) / d x(t) at held u, and l = exp(-s_lambda dt)::

    G(t) = r dt     + e^{-s_gamma dt}     [(1 - l) V(x(t + dt))     + l G(t + dt)]
    g(t) = dr/dx dt + e^{-s_gamma dt} F^T [(1 - l) dV/dx(x(t + dt)) + l g(t + dt)]

The first is the target of TD(lambda) in its forward view; the second is its gradient, the costate of Pontryagin's
principle, bootstrapped: value-gradient learning, VGL(lambda) (Fairbank and Alonso 2012,
doi:10.1109/IJCNN.2012.6252791); l = 0 is Werbos's dual heuristic programming. That u is held costs nothing when it is
greedy: inside its bounds dH/du = 0, and at a bound du/dx = 0 (for the controls that are affine here: Doya 2000,
doi:10.1162/089976600300015961).

A round moves a batch of trajectories on by some steps, computes their targets, and takes one pass of Adam over
minibatches of the loss (V - G)^2 + w sum_i S_i^2 (dV/dx_i - g_i)^2. S_i = 1 / |dz/dx_i| makes the errors of dV/dx those
of the slope in network inputs z: it is 5 for an angular velocity that enters as 0.2 theta'.

There are two engines with the same results: torch, for every problem and device, with Jacobians by torch.func; and
compiled code for the swimmer on CPUs (:mod:`swimmer_mj.learning.batched_swimmer`,
:mod:`swimmer_mj.learning.batched_network`).
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Generic, Literal, NamedTuple, Protocol, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from swimmer_mj.integrators import rk4_step
from swimmer_mj.learning import batched_swimmer
from swimmer_mj.learning.batched_network import BLOCK, BatchedNetwork, Encoding
from swimmer_mj.learning.differentiable import (
    DifferentiableProblem,
    differentiable,
    transition,
    transition_pullback,
)
from swimmer_mj.learning.networks import ValueNetwork
from swimmer_mj.learning.policy import GreedyPolicy
from swimmer_mj.learning.problem import ControlProblem, episode_steps, require_euler
from swimmer_mj.learning.swimming import RATE_SCALE, Swimming
from swimmer_mj.reduced import reduced_constants

__all__ = [
    "RoundStatistics",
    "ValueGradientLearner",
    "ValueGradientSettings",
    "costate",
    "lookahead",
    "targets",
    "value_and_gradient_loss",
    "value_target",
    "weight_of_round",
]

Array = NDArray[np.float64]
Real = NDArray[Any]  # the network's dtype
Network = TypeVar("Network", bound=ValueNetwork)


# Equations -------------------------------------------------------------------------------------------------------


def lookahead(estimate: Tensor, target: Tensor, s_lambda: float, dt: float) -> Tensor:
    """(1 - l) estimate + l target, l = exp(-s_lambda dt): what is known of time t + dt."""
    l = math.exp(-s_lambda * dt)
    return (1 - l) * estimate + l * target


def value_target(r: Tensor, later: Tensor, s_gamma: float, dt: float) -> Tensor:
    """G(t) = r dt + exp(-s_gamma dt) later, from what :func:`lookahead` says of V; shape (N,)."""
    return r * dt + math.exp(-s_gamma * dt) * later


def costate(drdx: Tensor, pulled_back: Tensor, s_gamma: float, dt: float) -> Tensor:
    """g(t) = dr/dx dt + exp(-s_gamma dt) F^T later, from F^T of what :func:`lookahead` says of dV/dx; shape (N, p)."""
    return drdx * dt + math.exp(-s_gamma * dt) * pulled_back


class Targets(NamedTuple):
    """Of every state of a batch of trajectories but the last."""

    value: Tensor
    """G, shape (T, N)."""
    gradient: Tensor
    """g, shape (T, N, p)."""


def targets(
    r: Tensor,
    drdx: Tensor,
    V: Tensor,
    dVdx: Tensor,
    pullback: Callable[[int, Tensor], Tensor],
    s_gamma: float,
    s_lambda: float,
    dt: float,
) -> Targets:
    """G and g along N trajectories of T steps, backwards from V and dV/dx at their ends.

    Parameters
    ----------
    r, drdx : Tensor, shapes (T, N) and (T, N, p)
        Reward rate and its gradient at the states 0 .. T - 1.
    V, dVdx : Tensor, shapes (T + 1, N) and (T + 1, N, p)
        Estimates at the states 0 .. T.
    pullback : callable
        ``pullback(t, costate)``: F(t)^T costate, shape (N, p).
    """
    G, g = V[-1], dVdx[-1]
    values, gradients = [], []
    for t in range(len(r) - 1, -1, -1):
        G = value_target(r[t], lookahead(V[t + 1], G, s_lambda, dt), s_gamma, dt)
        g = costate(drdx[t], pullback(t, lookahead(dVdx[t + 1], g, s_lambda, dt)), s_gamma, dt)
        values.append(G)
        gradients.append(g)
    return Targets(torch.stack(values[::-1]), torch.stack(gradients[::-1]))


def value_and_gradient_loss(
    V: Tensor, G: Tensor, dVdx: Tensor, g: Tensor, value_weight: float, slope_weights: Tensor
) -> tuple[Tensor, Tensor, Tensor]:
    """Mean of value_weight (V - G)^2 + sum_i slope_weights_i (dV/dx_i - g_i)^2; then of (V - G)^2, then of the sum."""
    value_error = (V - G).square().mean()
    slope_error = (slope_weights * (dVdx - g).square()).sum(-1).mean()
    return value_weight * value_error + slope_error, value_error, slope_error


def weight_of_round(k: int, share: float) -> float:
    """What round k, from 0 on, weighs in the average of the rounds so far: a / (k + a), a = 1 / share.

    Rounds then count in proportion to k^(a - 1): all alike with a share of 1, and with a small one as in a mean over
    the last ``share`` of them. Polynomial-decay averaging, Shamir and Zhang 2013 (arXiv:1212.1824).
    """
    return 1 / (k * share + 1)


# Settings --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class ValueGradientSettings:
    """What defines a learner, besides its problem and its network. What changing a default does: docs/beyond.md."""

    trajectories: int = 512
    """N, in parallel."""
    steps: int = 25
    """T, steps of each of them in a round."""
    dt: float = 0.01
    """Euler step, s."""
    trial_duration: float = 10.0
    """A trajectory starts anew after this long, s."""
    s_lambda: float = 1.0
    """Decay of what is looked ahead, 1/s: 0 trusts the trajectory to its end, infinity the next state's estimate."""
    value_weight: float = 1.0
    """Of (V - G)^2 in the loss."""
    slope_weight: float = 1.0
    """w, of the gradient's error in the loss."""
    flips: float = 0.0
    """Probability that a control has its sign flipped for a step: exploration. None was better than some."""
    minibatch: int = 512
    """States in one step of Adam."""
    passes: int = 1
    """Over the states of a round."""
    learning_rate: float = 2e-3
    """Of Adam, in the first round."""
    half_life: float = 500.0
    """Rounds after which the learning rate is halved."""
    final_rate: float = 1e-5
    """Learning rate below which it does not fall."""
    clip: float = 1.0
    """Largest norm of a gradient step."""
    averaged_share: float = 0.1
    """The averaged weights, which are the result, are those of about this last share of all rounds."""

    def __post_init__(self) -> None:
        for name in ("trajectories", "steps", "minibatch", "passes"):
            value = getattr(self, name)
            if not (isinstance(value, int) and value >= 1):
                raise ValueError(f"{name} must be an integer of at least 1, got {value!r}")
        for name in ("dt", "trial_duration", "learning_rate", "half_life", "final_rate", "clip"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"{name} must be positive and finite, got {value!r}")
        for name in ("value_weight", "slope_weight"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0):
                raise ValueError(f"{name} must be finite and not negative, got {value!r}")
        if not self.s_lambda >= 0:
            raise ValueError(f"s_lambda must not be negative, got {self.s_lambda!r}")
        if not 0 <= self.flips <= 0.5:
            raise ValueError(f"flips must be in [0, 0.5], got {self.flips!r}")
        if not 0 < self.averaged_share <= 1:
            raise ValueError(f"averaged_share must be in (0, 1], got {self.averaged_share!r}")
        if self.value_weight == self.slope_weight == 0:
            raise ValueError("value_weight and slope_weight must not both be 0")
        if self.minibatch > self.trajectories * self.steps:
            raise ValueError(
                "minibatch must be at most trajectories x steps = "
                f"{self.trajectories * self.steps}, got {self.minibatch}"
            )

    @property
    def steps_per_round(self) -> int:
        """Simulation steps in a round."""
        return self.trajectories * self.steps

    def rate(self, round_number: int) -> float:
        """Adam's learning rate in a round, from 0 on."""
        return max(
            min(self.final_rate, self.learning_rate),
            self.learning_rate * 2 ** (-round_number / self.half_life),
        )


class RoundStatistics(NamedTuple):
    """Means over a round."""

    reward: float
    """Reward rate along the trajectories."""
    value: float
    """V along them."""
    value_error: float
    """(V - G)^2."""
    slope_error: float
    """sum_i S_i^2 (dV/dx_i - g_i)^2."""


# Engines ---------------------------------------------------------------------------------------------------------


class _Batch(NamedTuple):
    """A round's states and targets, in an engine's own layout."""

    data: Any
    reward: float
    value: float


class _Engine(Protocol):
    """What a learner needs done fast. States are (N, p), float64, on the CPU."""

    def collect(self, weights: Tensor, x: Array, flips: Array) -> tuple[_Batch, Array]:
        """Trajectories from ``x`` under greedy control times ``flips`` (T, N, q): targets, and their last states."""
        ...

    def shuffle(self, batch: _Batch, order: Tensor) -> _Batch:
        """Its states in another order."""
        ...

    def loss_gradient(self, weights: Tensor, batch: _Batch, start: int, out: Tensor) -> tuple[float, float]:
        """The loss's gradient over the minibatch at ``start`` into ``out``; the two errors."""
        ...

    def control(self, weights: Tensor, x: Array) -> Array:
        """Greedy control, shape (N, q)."""
        ...

    def episodes(self, weights: Tensor, x: Array, shares: Array, dt: float) -> Array:
        """Sums (N,) over greedy episodes of the reward rates times ``shares`` (steps,); RK4, control held for dt."""
        ...


def _slope_weights(problem: ControlProblem, w: float) -> Tensor:
    """w S_i^2, shape (p,): S_i = 1 / |dz/dx_i|, over a fixed sample of initial states; 0 where z has no part of x_i."""
    sample = torch.from_numpy(problem.initial_states(np.random.default_rng(0), 256)).double()
    jacobian = torch.func.vmap(torch.func.jacrev(problem.inputs))(sample)
    squared = jacobian.square().sum(dim=1).mean(dim=0)
    return torch.where(squared > 0, w / squared, 0.0)


class _TorchEngine:
    """Every problem, every device, by automatic differentiation."""

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

    def collect(self, weights: Tensor, x: Array, flips: Array) -> tuple[_Batch, Array]:
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
        return _Batch(data, float(r.mean()), float(torch.stack(values).mean())), state.cpu().numpy()

    def shuffle(self, batch: _Batch, order: Tensor) -> _Batch:
        order = order.to(self.device)
        return batch._replace(data=tuple(y[order] for y in batch.data))

    def loss_gradient(self, weights: Tensor, batch: _Batch, start: int, out: Tensor) -> tuple[float, float]:
        self._load(weights)
        X, G, g = (y[start : start + self.settings.minibatch] for y in batch.data)
        V, dVdx = self._value_and_slope(X, graph=True)
        with torch.enable_grad():
            loss, value_error, slope_error = value_and_gradient_loss(
                V, G, dVdx, g, self.settings.value_weight, self.slope_weights
            )
            gradients = torch.autograd.grad(loss, self.parameters)
        torch.cat([y.flatten() for y in gradients], out=out)
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
    """The inputs of :class:`swimmer_mj.learning.swimming.Swimming` for ``n`` links."""
    i = np.arange(n)
    linear = np.arange(n, 2 * n + 2)
    return Encoding(i, i, n + i, linear, linear + n, np.array([RATE_SCALE] * n + [1.0, 1.0]))


class _CompiledEngine:
    """The swimmer on a CPU: trajectories on the last axis, everything in place."""

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

    def collect(self, weights: Tensor, x: Array, flips: Array) -> tuple[_Batch, Array]:
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
        return _Batch(rows, float(r.mean()), float(V.mean())), X[T].T.copy()

    def shuffle(self, batch: _Batch, order: Tensor) -> _Batch:
        return batch._replace(data=batch.data[:, order])

    def loss_gradient(self, weights: Tensor, batch: _Batch, start: int, out: Tensor) -> tuple[float, float]:
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


# Learner ---------------------------------------------------------------------------------------------------------


class ValueGradientLearner(Generic[Network]):
    """Learns V and dV/dx along trajectories of the greedy policy. It changes the network's weights in place.

    Parameters
    ----------
    problem : ControlProblem
        What to learn: a :class:`DifferentiableProblem`, or a problem of this package.
    network : ValueNetwork
        V_w, in float32 or float64. On a CUDA device, everything but the initial states happens there.
    settings : ValueGradientSettings
        The algorithm's constants.
    seed : int
        Of the initial states, the flips and the minibatches. The network's initial weights are the caller's.
    engine : "auto", "compiled" or "torch"
        "auto" compiles what can be: Cascade and Multilayer networks of the swimmer on a CPU, with a number of
        trajectories and a minibatch that are multiples of 32.
    """

    def __init__(
        self,
        problem: ControlProblem,
        network: Network,
        settings: ValueGradientSettings | None = None,
        *,
        seed: int = 0,
        engine: Literal["auto", "compiled", "torch"] = "auto",
    ) -> None:
        self.problem = problem
        self.network = network
        self.settings = settings = ValueGradientSettings() if settings is None else settings
        if network.n_inputs != problem.n_inputs:
            raise ValueError(f"{problem.name} has {problem.n_inputs} inputs, the network {network.n_inputs}")
        require_euler(problem)
        obstacle = _obstacle(problem, network, settings)
        if engine == "compiled" and obstacle:
            raise ValueError(f"engine 'compiled' {obstacle}; use 'torch'")
        self._engine: _Engine
        if engine == "torch" or obstacle:
            self._engine = _TorchEngine(differentiable(problem), network, settings)
        else:
            assert isinstance(problem, Swimming)
            self._engine = _CompiledEngine(problem, network, settings)
        self.engine = "compiled" if isinstance(self._engine, _CompiledEngine) else "torch"

        parameters = list(network.parameters())
        self._weights = torch.cat([w.detach().flatten() for w in parameters])
        at = 0
        for w in parameters:  # the module's tensors become views, so that they are up to date at all times
            w.data = self._weights[at : at + w.numel()].view(w.shape)
            at += w.numel()
        self._average = self._weights.clone()
        self._moment = torch.zeros_like(self._weights)
        self._second_moment = torch.zeros_like(self._weights)
        self._gradient = torch.zeros_like(self._weights)
        self._rng = np.random.default_rng(seed)
        self._generator = torch.Generator().manual_seed(seed)
        self._states = problem.initial_states(self._rng, settings.trajectories)
        self._rounds_per_trial = max(1, round(settings.trial_duration / (settings.steps * settings.dt)))
        self._age = self._rng.integers(
            0, self._rounds_per_trial, settings.trajectories
        )  # in rounds, out of step
        self._updates = 0
        self.rounds = 0

    @property
    def simulation_steps(self) -> int:
        """Steps of dt that have been simulated."""
        return self.rounds * self.settings.steps_per_round

    @torch.no_grad()
    def step(self) -> RoundStatistics:
        """One round: trajectories, targets, a fit."""
        settings = self.settings
        old = self._age >= self._rounds_per_trial
        if old.any():
            self._states[old] = self.problem.initial_states(self._rng, int(old.sum()))
            self._age[old] = 0
        self._age += 1
        shape = (settings.steps, settings.trajectories, len(self.problem.control_limits))
        flips = np.where(self._rng.random(shape, dtype=np.float32) < settings.flips, -1.0, 1.0)
        batch, self._states = self._engine.collect(self._weights, self._states, flips)

        count = settings.steps_per_round
        rate = settings.rate(self.rounds)
        errors = []
        for _ in range(settings.passes):
            shuffled = self._engine.shuffle(batch, torch.randperm(count, generator=self._generator))
            for start in range(0, count - settings.minibatch + 1, settings.minibatch):
                errors.append(self._engine.loss_gradient(self._weights, shuffled, start, self._gradient))
                self._adam(rate)
        self._average.lerp_(self._weights, weight_of_round(self.rounds, settings.averaged_share))
        self.rounds += 1
        value_error, slope_error = np.mean(errors, axis=0)
        return RoundStatistics(batch.reward, batch.value, float(value_error), float(slope_error))

    def _adam(self, rate: float, beta1: float = 0.9, beta2: float = 0.999, epsilon: float = 1e-8) -> None:
        """One step of Adam (Kingma and Ba 2015, algorithm 1) with the gradient clipped by its norm."""
        gradient = self._gradient
        norm = float(gradient.norm())
        if not math.isfinite(norm):
            raise FloatingPointError(
                f"the loss is no longer finite in round {self.rounds}: "
                f"learning_rate {self.settings.learning_rate} is too large"
            )
        if norm > self.settings.clip:
            gradient *= self.settings.clip / norm
        self._updates += 1
        self._moment.lerp_(gradient, 1 - beta1)
        self._second_moment.mul_(beta2).addcmul_(gradient, gradient, value=1 - beta2)
        spread = (self._second_moment / (1 - beta2**self._updates)).sqrt_().add_(epsilon)
        self._weights.addcdiv_(self._moment, spread, value=-rate / (1 - beta1**self._updates))

    @torch.no_grad()
    def averaged_network(self) -> Network:
        """A copy of the network with the averaged weights, which act better than the last ones."""
        network = copy.deepcopy(self.network)
        torch.nn.utils.vector_to_parameters(self._average.clone(), network.parameters())
        return network

    def policy(self) -> GreedyPolicy[Network]:
        """The greedy policy of the averaged weights."""
        return GreedyPolicy(self.problem, self.averaged_network().cpu())

    @torch.no_grad()
    def control(self, states: Array) -> Array:
        """Greedy control, shape (N, q), by the averaged weights at states (N, p): the policy, without V and H."""
        return self._engine.control(self._average, np.asarray(states, np.float64))

    @torch.no_grad()
    def rollout(
        self,
        initial_states: Array,
        duration: float,
        skip: float = 0.0,
        dt: float = 0.01,
        averaged: bool = True,
    ) -> Array:
        """Mean reward rate of greedy episodes by RK4, control held for ``dt``, after the first ``skip`` seconds.

        Parameters
        ----------
        initial_states : ndarray, shape (N, p)
            Where they start.
        duration, skip, dt : float
            s.
        averaged : bool
            By the averaged weights; otherwise by the last ones.

        Returns
        -------
        ndarray, shape (N,)
        """
        n_steps, n_skip = episode_steps(duration, skip, dt)
        counts = np.arange(n_steps) >= n_skip
        weights = self._average if averaged else self._weights
        return self._engine.episodes(
            weights, np.asarray(initial_states, np.float64), counts / counts.sum(), dt
        )

    @torch.no_grad()
    def discounted_return(self, initial_states: Array, duration: float, dt: float = 0.01) -> Array:
        """Equation 1 up to ``duration`` seconds from each initial state (N, p), by the averaged weights; (N,)."""
        shares = np.exp(-self.problem.s_gamma * dt * np.arange(round(duration / dt))) * dt
        return self._engine.episodes(self._average, np.asarray(initial_states, np.float64), shares, dt)

    def state_dict(self) -> dict[str, Any]:
        """All that resuming exactly needs: ``tensors`` (name -> Tensor) and ``info`` (JSON values)."""
        return {
            "tensors": {
                "weights": self._weights.clone(),
                "average": self._average.clone(),
                "moment": self._moment.clone(),
                "second_moment": self._second_moment.clone(),
                "states": torch.from_numpy(self._states.copy()),
                "age": torch.from_numpy(self._age.copy()),
                "generator": self._generator.get_state(),
            },
            "info": {"rounds": self.rounds, "updates": self._updates, "rng": self._rng.bit_generator.state},
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Go on from what :meth:`state_dict` gave, bit by bit."""
        tensors, info = state["tensors"], state["info"]
        for name in ("weights", "average", "moment", "second_moment"):
            getattr(self, f"_{name}").copy_(tensors[name])
        self._states = tensors["states"].numpy().copy()
        self._age = tensors["age"].numpy().copy()
        self._generator.set_state(tensors["generator"])
        self.rounds, self._updates = info["rounds"], info["updates"]
        self._rng.bit_generator.state = info["rng"]


def _obstacle(problem: ControlProblem, network: ValueNetwork, settings: ValueGradientSettings) -> str | None:
    """Why this cannot be compiled, to be read after "engine 'compiled'"."""
    if not isinstance(problem, Swimming):
        return f"knows Swimming, not {problem.name!r}"
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
