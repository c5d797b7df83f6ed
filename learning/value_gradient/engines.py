"""What a learner of value gradients needs done fast, twice and with the same results.

One engine is torch, for every problem in torch and every device, with Jacobians by torch.func. The other is compiled
code on CPUs, for problems that are compiled for batches of trajectories.
"""

from __future__ import annotations

from typing import Any, Literal, NamedTuple, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from swimmer_mj.learning.networks.actors import Actor, BatchActor, TorchActor, batch_obstacle
from swimmer_mj.learning.networks.batched import BLOCK
from swimmer_mj.learning.networks.networks import Cascade, ValueNetwork
from swimmer_mj.learning.problems.differentiable import transition, transition_pullback
from swimmer_mj.learning.problems.forms import CoordinatesForm, CostForm, TorchForm
from swimmer_mj.learning.problems.held import Memory
from swimmer_mj.learning.problems.problem import ControlProblem
from swimmer_mj.learning.value_gradient.equations import huber, targets, value_and_gradient_loss
from swimmer_mj.learning.value_gradient.settings import ValueGradientSettings

__all__ = ["Batch", "Engine", "engine_for"]

Array = NDArray[np.float64]


WILD = 10.0
"""Times 1, or what an input is at initial states if that is more: beyond it there is nothing to learn from."""


def _sample(problem: ControlProblem) -> Tensor:
    """256 initial states, always the same, (256, p)."""
    return torch.from_numpy(problem.initial_states(np.random.default_rng(0), 256)).double()


def input_bounds(problem: ControlProblem) -> Array:
    """How large each input of the network, (m,), may be on a trajectory that is learned from."""
    return WILD * problem.inputs(_sample(problem)).square().mean(dim=0).sqrt().clamp(min=1.0).numpy()


def stand_ins(z: Array, bounds: Array) -> NDArray[np.int64]:
    """Of N trajectories, which one is learned from in each one's place: itself, but where it has become wild.

    ``z`` (T + 1, m, N) are the network's inputs on them, ``bounds`` (m,) those of :func:`input_bounds`. With less than
    a quarter tame nothing helps, and all stay.
    """
    own = np.arange(z.shape[-1])
    tame = own[(np.abs(z) < bounds[:, None]).all(axis=(0, 1))]  # which NaN is not
    if tame.size == own.size or 4 * tame.size < own.size:
        return own
    instead = tame[own % tame.size]
    instead[tame] = tame
    return instead


class Batch(NamedTuple):
    """A round's states and targets, in an engine's own layout."""

    data: Any
    reward: float
    value: float


class Engine(Actor, Protocol):
    """What a learner needs done fast. States are (N, p), float64, on the CPU."""

    name: str
    """"torch" or "compiled"."""

    def collect(self, weights: Tensor, x: Array, flips: Array) -> tuple[Batch, Array]:
        """Trajectories from ``x`` under greedy control times ``flips`` (T, N, q): targets, and their last states.

        A trajectory that becomes wild (:func:`stand_ins`) is learned from no more, and its last state is NaN.
        """
        ...

    def shuffle(self, batch: Batch, order: Tensor) -> Batch:
        """Its states in another order."""
        ...

    def loss_gradient(self, weights: Tensor, batch: Batch, start: int, out: Tensor) -> tuple[float, float]:
        """The loss's gradient over the minibatch at ``start`` into ``out``; the two errors."""
        ...


def _slope_weights(problem: ControlProblem, w: float) -> Tensor:
    """w S_i^2, shape (p,): S_i = 1 / |dz/dx_i|, over a sample of initial states; 0 where x_i does not move z there.

    In place of x stand the coordinates in which V is learned, if they are others.
    """
    sample, inputs = _sample(problem), problem.inputs
    coordinates = problem.form(CoordinatesForm)
    if coordinates is not None:
        sample, inputs = coordinates.enter(sample), coordinates.encode
    with torch.enable_grad():  # not torch.func.jacrev, whose first call takes seconds of imports
        z = inputs(sample.requires_grad_())
        slopes = [torch.autograd.grad(one.sum(), sample, retain_graph=True)[0] for one in z.unbind(dim=1)]
    squared = torch.stack(slopes).square().sum(dim=0).mean(dim=0)
    if not bool(torch.isfinite(squared).all()):
        raise ValueError(
            f"{problem.name}: the derivatives of the network's inputs are not finite at some initial state"
        )
    return torch.where(squared > 0, w / squared, 0.0)


def _reward_and_slope(form: TorchForm, x: Tensor) -> tuple[Tensor, Tensor]:
    """dr/dx (N, p) and r (N,) at x (N, p)."""
    return torch.func.vmap(torch.func.grad_and_value(lambda y: form.reward_rate(y[None])[0]))(x)


def _require_derivatives(problem: ControlProblem, form: TorchForm) -> None:
    """Refuse functions that cannot be differentiated as a round needs it, and a reward without a slope."""
    x = _sample(problem)[:2]
    try:
        transition_pullback(form, x, x.new_zeros(2, len(problem.control_limits)), 1.0, x)
        r = form.reward_rate(x.requires_grad_())
        _reward_and_slope(form, x.detach())
    except (RuntimeError, TypeError) as error:
        said = (str(error).strip() or type(error).__name__).splitlines()[0]
        raise ValueError(
            f"{problem.name}: torch.func cannot differentiate drift, control matrix or reward rate, which value "
            f"gradients ask for: {said}; in them, avoid NumPy, .item(), branches on values and changes in place, or "
            f"learn with --method td"
        ) from error
    if not r.requires_grad:
        raise ValueError(
            f"{problem.name}: the reward has no slope, which value gradients follow (constant, a comparison, or "
            f"detached): give a smooth one, or learn with --method td"
        )


class _TorchEngine(TorchActor):
    """By automatic differentiation."""

    name = "torch"

    def __init__(
        self, problem: ControlProblem, network: ValueNetwork, settings: ValueGradientSettings
    ) -> None:
        super().__init__(problem, network)
        _require_derivatives(problem, self.form)
        self.settings, self.bounds = settings, input_bounds(problem)
        self.coordinates = problem.form(CoordinatesForm)
        self.slope_weights = _slope_weights(problem, settings.slope_weight).to(self.parameters[0])

    def collect(self, weights: Tensor, x: Array, flips: Array) -> tuple[Batch, Array]:
        form, settings, dt = self.form, self.settings, self.settings.dt
        self.load(weights)
        state = torch.tensor(x, device=self.device)
        flip = torch.tensor(flips, device=self.device)
        states, controls, values, slopes, memory = [], [], [], [], Memory()
        for t in range(len(flip) + 1):
            V, dVdx = self.value_and_slope(state)
            states.append(state)
            values.append(V.detach().double())
            slopes.append(dVdx.double())
            if t < len(flip):
                controls.append(self.greedy(state, slopes[-1], dt, memory) * flip[t])
                state = transition(form, state, controls[-1], dt)
        z = torch.stack([self.problem.inputs(x) for x in states]).transpose(1, 2).cpu().numpy()
        instead = stand_ins(z, self.bounds)
        wild = torch.from_numpy(instead != np.arange(len(instead))).to(self.device)
        if bool(wild.any()):
            order = torch.from_numpy(instead).to(self.device)
            states, controls, values, slopes = (
                [y[order] for y in several] for several in (states, controls, values, slopes)
            )
        X = torch.stack(states[:-1])
        drdx, r = _reward_and_slope(form, X.flatten(0, 1))
        G, g = targets(
            r.view(X.shape[:2]),
            drdx.view(X.shape),
            torch.stack(values),
            torch.stack(slopes),
            lambda t, later: transition_pullback(form, states[t], controls[t], dt, later),
            self.problem.s_gamma,
            settings.s_lambda,
            dt,
        )
        coordinates, pull = self.coordinates, None
        if coordinates is not None:  # V and its slope are of them
            X = coordinates.enter(X)
            pull = torch.func.vjp(coordinates.leave, X)[1]
            g = pull(g)[0]
        if settings.huber is not None:
            estimate = torch.stack(slopes[:-1])
            estimate = estimate if pull is None else pull(estimate)[0]
            g = huber(estimate, g, self.slope_weights.double(), settings.huber)
        data = tuple(y.flatten(0, 1).to(self.dtype) for y in (X, G, g))
        last = torch.where(wild[:, None], torch.nan, states[-1])
        return Batch(data, float(r.mean()), float(torch.stack(values).mean())), last.cpu().numpy()

    def shuffle(self, batch: Batch, order: Tensor) -> Batch:
        order = order.to(self.device)
        return batch._replace(data=tuple(y[order] for y in batch.data))

    def loss_gradient(self, weights: Tensor, batch: Batch, start: int, out: Tensor) -> tuple[float, float]:
        self.load(weights)
        X, G, g = (y[start : start + self.settings.minibatch] for y in batch.data)
        inputs = None if self.coordinates is None else self.coordinates.encode
        V, dVdx = self.value_and_slope(X, graph=True, inputs=inputs)
        with torch.enable_grad():
            loss, value_error, slope_error = value_and_gradient_loss(
                V, G, dVdx, g, self.settings.value_weight, self.slope_weights
            )
            gradients = torch.autograd.grad(loss, self.parameters)
        torch.cat([y.flatten() for y in gradients], out=out)
        if isinstance(self.network, Cascade):  # a missing connection stays missing
            out *= self.network.connected.flatten().to(out)
        return float(value_error.detach()), float(slope_error.detach())


class _CompiledEngine(BatchActor):
    """Trajectories on the last axis, everything in place."""

    name = "compiled"

    def __init__(
        self, problem: ControlProblem, network: ValueNetwork, settings: ValueGradientSettings
    ) -> None:
        super().__init__(problem, network)
        self.settings, self.bounds = settings, input_bounds(problem)
        self.s_gamma = problem.s_gamma
        self.slope_weights = _slope_weights(problem, settings.slope_weight).numpy().astype(self.real)

    def collect(self, weights: Tensor, x: Array, flips: Array) -> tuple[Batch, Array]:
        settings, p, q, m = self.settings, self.p, self.q, self.m
        T, N = len(flips), settings.trajectories
        flip = np.ascontiguousarray(flips.transpose(0, 2, 1))
        X, U = np.empty((T + 1, p, N)), np.empty((T, q, N))
        z, V, dVdx = np.empty((T + 1, m, N), self.real), np.empty((T + 1, N)), np.empty((T + 1, p, N))
        X[0], slope_at, memory = x.T, self.slope_at(weights), Memory()
        for t in range(T + 1):
            self.judge(weights, X[t], z[t], V[t], dVdx[t])
            if t < T:
                self.form.greedy_step(
                    slope_at, X[t], dVdx[t], flip[t], settings.dt, U[t], X[t + 1], memory=memory
                )
        instead = stand_ins(z, self.bounds)
        wild = instead != np.arange(N)
        if wild.any():
            X, U, z, V, dVdx = (np.ascontiguousarray(y[..., instead]) for y in (X, U, z, V, dVdx))
        data = np.empty((T, m + p + 1, N), self.real)
        data[:, :m] = z[:T]
        s_gamma, s_lambda = self.s_gamma, settings.s_lambda
        self.form.targets(X, U, V, dVdx, settings.dt, s_gamma, s_lambda, data[:, m:])
        self._from_state(X[:T], data[:, m : m + p])
        if settings.huber is not None:
            estimate, g = dVdx[:T].astype(self.real), data[:, m : m + p]
            self._from_state(X[:T], estimate)
            errors = torch.from_numpy(estimate), torch.from_numpy(g), torch.from_numpy(self.slope_weights)
            g[:] = huber(*errors, settings.huber, dim=1).numpy()
        r = self.form.reward(X[:T], U)
        rows = torch.from_numpy(data).transpose(0, 1).reshape(m + p + 1, T * N)
        last = np.where(wild, np.nan, X[T])
        return Batch(rows, float(r.mean()), float(V.mean())), np.ascontiguousarray(last.T)

    def _from_state(self, X: Array, slopes: NDArray[Any]) -> None:
        """Slopes (T, p, N) in the state become those in the coordinates in which V is learned."""
        if self.form.coordinates is not None:
            self.form.coordinates.from_state(X, slopes)

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


def engine_for(
    problem: ControlProblem,
    network: ValueNetwork,
    settings: ValueGradientSettings,
    engine: Literal["auto", "compiled", "torch"] = "auto",
) -> Engine:
    """The engine of that name; "auto" compiles what can be."""
    if engine not in ("auto", "compiled", "torch"):
        raise ValueError(f"engine must be 'auto', 'compiled' or 'torch', got {engine!r}")
    obstacle, in_torch = batch_obstacle(problem, network) or _obstacle(settings), _torch_obstacle(problem)
    if obstacle and in_torch:
        raise ValueError(f"engine 'compiled' {obstacle}; change that, for engine 'torch' {in_torch}")
    if engine == "compiled" and obstacle:
        raise ValueError(f"engine 'compiled' {obstacle}; use 'torch'")
    if engine == "torch" and in_torch:
        raise ValueError(f"engine 'torch' {in_torch}; use 'compiled'")
    if engine == "torch" or obstacle:
        return _TorchEngine(problem, network, settings)
    return _CompiledEngine(problem, network, settings)


def _torch_obstacle(problem: ControlProblem) -> str | None:
    """Why torch cannot do it, to be read after "engine 'torch'"."""
    if problem.form(TorchForm) is None:
        return f"needs a problem in torch, as a DifferentiableProblem is, and {problem.name!r} is not"
    if problem.form(CostForm) is not None:
        return f"does not know what the controls of {problem.name!r} cost"
    return None


def _obstacle(settings: ValueGradientSettings) -> str | None:
    """Why this cannot be compiled, to be read after "engine 'compiled'"."""
    for name in ("trajectories", "minibatch"):
        if getattr(settings, name) % BLOCK:
            return f"needs {name} to be a multiple of {BLOCK}, not {getattr(settings, name)}"
    return None
