"""Continuous TD(lambda) for the cascade network as one compiled loop, on the tensors of the torch module.

The algorithm is that of :mod:`~swimmer_mj.learning.td.continuous_td`, step by step; what differs is when and in which
order its arithmetic is done. One learner is a chain of dependent operations, so what counts is latency:

- forward: when neuron i fires, its output is pushed at once to all later neurons (a row of ``T``, the weights by source
  and neuron). What it adds to neuron i + 1 is added to that neuron's activation apart from the rest, so that from one
  neuron to the next there are a tanh and one multiply-add;
- backward: likewise, when the error of neuron i is known, it is pushed to all earlier ones (a row of ``W``, the weights
  between hidden neurons by neuron and source: they are kept twice, so that both passes read rows);
- update: the Euler step of weights and traces is put off until the next step's forward and backward pass, which do it
  row by row just before they need the row. It depends on nothing in those passes and fills the time in which they wait
  for their tanh. The numbers are those of an update at once.

Rows are padded to whole SIMD vectors. Lanes without a connection hold numbers that nothing reads: neuron j has fired
when a later source is pushed to it.

In float32, tanh is that of :mod:`swimmer_mj.compiled.rational_tanh`; in float64 it is the C library's.
"""

# pyright: reportCallIssue=false
# numba gives its intrinsics their first argument, the typing context, itself.

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import torch
from numba import njit
from numpy.typing import NDArray

from swimmer_mj.compiled.rational_tanh import tanh_of_one
from swimmer_mj.compiled.vectors import (
    FAST,
    LANES,
    add_lanes,
    aligned_zeros,
    load,
    multiply_add,
    round_up,
    splat,
    store,
)
from swimmer_mj.learning.networks.networks import Cascade
from swimmer_mj.learning.problems.forms import CompiledForm, Moment
from swimmer_mj.learning.problems.problem import ControlProblem, as_states, episode_steps, require_euler
from swimmer_mj.learning.td.continuous_td import TDSettings

__all__ = [
    "FusedTD",
    "Rollouts",
    "SampleStatistics",
    "TrialStatistics",
]

Array = NDArray[np.float64]
Real = NDArray[Any]  # the learner's dtype


class Workspace(NamedTuple):
    """Everything that the kernel writes, besides the tensors. Sizes padded to whole vectors: P of n, R of n - 1."""

    T: Real  # weights (m + n, P), by source and neuron
    T_trace: Real
    T_rate: Real  # only if rates differ within a neuron
    W: Real  # weights between hidden neurons again (n, R), by neuron and source
    W_trace: Real
    W_rate: Real
    rate: Real  # learning rate of each neuron's weights (P,)
    gain: Real  # dt H times that (P,)
    z: Real  # inputs and 1 for the bias (2, m + 1), before and now
    y: Real  # outputs of hidden neurons (2, R), before and now
    delta: Real  # dV/d(activation) (2, P), before and now
    activation: Real  # (P,)
    gradient: Real  # dV/dy (R,)
    dVdz: Real  # (m,)
    pending: Array  # the update that is due: dt H, decay of the traces, dt (3,)
    now: NDArray[np.int64]  # which half of z, y and delta is the newer one (1,)
    dVdx: Array  # (p,)
    x: Array  # (p,)
    a: Array  # drift (p,)
    B: Array  # control matrix (p, q)
    u: Array  # control (q,)
    f: Array  # a + B u (p,)


class TrialStatistics(NamedTuple):
    """Means over each trial, shape (trials,)."""

    value: Array
    squared_hamiltonian: Array
    reward: Array


class SampleStatistics(NamedTuple):
    """V and H at given states, shape (states,)."""

    value: Array
    hamiltonian: Array


class Rollouts(NamedTuple):
    """Episodes under the greedy policy, shape (episodes,)."""

    reward: Array
    """Mean reward rate after the first ``skip`` seconds."""
    discounted_return: Array
    """Integral of exp(-s_gamma t) r over the whole episode."""


class _Kernel(NamedTuple):
    train: Callable[..., None]
    forward: Callable[..., float]
    backward: Callable[..., None]
    learn_once: Callable[..., tuple[float, float]]
    load_weights: Callable[..., None]
    store_weights: Callable[..., None]
    sample: Callable[..., None]
    rollout: Callable[..., None]


@njit(inline="always")
def _tanh64(x: float) -> float:
    return math.tanh(x)


@lru_cache(maxsize=16)
def _compile(
    dynamics: Callable[..., None],
    reward: Callable[..., float],
    inputs: Callable[..., None],
    input_pullback: Callable[..., None],
    m: int,
    single_precision: bool,
    rate_each: bool,
    logistic: bool,
) -> _Kernel:
    """Compile the kernel for a problem with ``m`` network inputs; rates are each neuron's, or each weight's."""
    real: Any = np.float32 if single_precision else np.float64
    tanh = tanh_of_one if single_precision else _tanh64
    one = real(1.0)
    half = real(0.5)
    first = m + 1  # index of the first hidden neuron among the sources

    options: dict[str, Any] = {"fastmath": FAST, "error_model": "numpy", "nogil": True}

    @njit(**options)
    def nothing_due(ws: Workspace) -> None:
        ws.pending[0] = 0.0
        ws.pending[1] = 1.0
        ws.pending[2] = 0.0

    @njit(**options)
    def load_weights(weight: Real, trace: Real, rate: Real, ws: Workspace) -> None:
        """From the tensors, shape (n, m + n), to the workspace; no update is due."""
        n = weight.shape[0]
        for array in (ws.T, ws.T_trace, ws.T_rate, ws.W, ws.W_trace, ws.W_rate, ws.z, ws.y, ws.delta):
            array[:] = 0
        for i in range(n):
            ws.rate[i] = rate[i, 0]
            for j in range(first + i):
                ws.T[j, i] = weight[i, j]
                ws.T_trace[j, i] = trace[i, j]
                if rate_each:
                    ws.T_rate[j, i] = rate[i, j]
            for j in range(i):
                ws.W[i, j] = weight[i, first + j]
                ws.W_trace[i, j] = trace[i, first + j]
                if rate_each:
                    ws.W_rate[i, j] = rate[i, first + j]
        nothing_due(ws)

    @njit(inline="always", **options)
    def updated(w: Real, e: Real, rate: Real, gain: Any, decay: Any, d: Any, gradient: Any, o: int) -> Any:
        """The vector of weights at ``o`` after w += dt eta H e, which is stored, as is e += dt (... + dV/dw)."""
        trace = load(e, o)
        if rate_each:
            weight = multiply_add(gain * load(rate, o), trace, load(w, o))
        else:
            weight = multiply_add(gain, trace, load(w, o))
        store(w, o, weight)
        store(e, o, multiply_add(decay, trace, d * gradient))
        return weight

    @njit(**options)
    def update(ws: Workspace) -> None:
        """Do what is due, to ``T`` alone."""
        P = ws.T.shape[1]
        o = ws.now[0]
        dt_H, decay, step = real(ws.pending[0]), splat(real(ws.pending[1])), real(ws.pending[2])
        for k in range(ws.T.shape[0]):
            d = splat(step * (ws.z[o, k] if k < first else ws.y[o, k - first]))
            for j in range(0, P, LANES):
                gain = splat(dt_H) if rate_each else splat(dt_H) * load(ws.rate, j)
                updated(ws.T, ws.T_trace, ws.T_rate, gain, decay, d, load(ws.delta, o * P + j), k * P + j)
        nothing_due(ws)

    @njit(**options)
    def store_weights(weight: Real, trace: Real, ws: Workspace) -> None:
        """From the workspace to the tensors, up to date."""
        update(ws)
        for i in range(weight.shape[0]):
            for j in range(first + i):
                weight[i, j] = ws.T[j, i]
                trace[i, j] = ws.T_trace[j, i]

    @njit(forceinline=True, **options)
    def forward(x: Array, ws: Workspace) -> float:
        """Do the update that is due to ``T``, and return V at ``x``; fills z and y."""
        P = ws.T.shape[1]
        hidden = ws.W.shape[0] - 1
        activation, gain = ws.activation, ws.gain
        old = ws.now[0]
        new = 1 - old
        ws.now[0] = new
        dt_H, decay, step = real(ws.pending[0]), splat(real(ws.pending[1])), real(ws.pending[2])
        for j in range(0, P, LANES):
            store(gain, j, splat(dt_H) if rate_each else splat(dt_H) * load(ws.rate, j))

        z = ws.z[new]
        inputs(x, z)
        z[m] = one
        for j in range(0, P, LANES):
            total = splat(real(0.0))
            g, slope = load(gain, j), load(ws.delta, old * P + j)
            for k in range(first):
                w = updated(
                    ws.T, ws.T_trace, ws.T_rate, g, decay, splat(step * ws.z[old, k]), slope, k * P + j
                )
                total = multiply_add(splat(z[k]), w, total)
            store(activation, j, total)
        activation_i = activation[0]
        for i in range(hidden):
            y_i = half + half * tanh(half * activation_i) if logistic else tanh(activation_i)
            ws.y[new, i] = y_i
            y, d = splat(y_i), splat(step * ws.y[old, i])
            activation_i = activation[i + 1]
            for j in range((i + 1) // LANES * LANES, P, LANES):
                o = (first + i) * P + j
                w = updated(
                    ws.T, ws.T_trace, ws.T_rate, load(gain, j), decay, d, load(ws.delta, old * P + j), o
                )
                store(activation, j, multiply_add(y, w, load(activation, j)))
            activation_i += y_i * ws.T[first + i, i + 1]
        return activation_i

    @njit(forceinline=True, **options)
    def backward(ws: Workspace) -> None:
        """Do the update that is due to ``W``, and fill delta and dVdx."""
        n, R = ws.W.shape
        P = ws.T.shape[1]
        hidden = n - 1
        gradient, gain = ws.gradient, ws.gain
        new = ws.now[0]
        old = 1 - new
        decay, step = splat(real(ws.pending[1])), real(ws.pending[2])
        ws.delta[new, hidden] = one
        d, g = splat(step * ws.delta[old, hidden]), splat(gain[hidden])
        for j in range(0, R, LANES):
            o = hidden * R + j
            store(gradient, j, updated(ws.W, ws.W_trace, ws.W_rate, g, decay, d, load(ws.y, old * R + j), o))
        gradient_i = gradient[hidden - 1]
        for i in range(hidden - 1, -1, -1):
            y_i = ws.y[new, i]
            delta_i = ((y_i if logistic else one) - y_i * y_i) * gradient_i
            d, g = splat(step * ws.delta[old, i]), splat(gain[i])
            ws.delta[new, i] = delta_i
            slope = splat(delta_i)
            gradient_i = gradient[max(i - 1, 0)]
            for j in range(0, i, LANES):
                w = updated(ws.W, ws.W_trace, ws.W_rate, g, decay, d, load(ws.y, old * R + j), i * R + j)
                store(gradient, j, multiply_add(slope, w, load(gradient, j)))
            gradient_i += delta_i * ws.W[i, max(i - 1, 0)]
        for k in range(m):
            total = load(ws.T, k * P) * load(ws.delta, new * P)
            for j in range(LANES, P, LANES):
                total = multiply_add(load(ws.T, k * P + j), load(ws.delta, new * P + j), total)
            ws.dVdz[k] = add_lanes(total)
        input_pullback(ws.z[new], ws.dVdz, ws.dVdx)
        nothing_due(ws)

    @njit(forceinline=True, **options)
    def value_and_gradients(x: Array, ws: Workspace) -> float:
        """Do the update that is due, then V at ``x``; fills dVdx, and z, y and delta, whose product is dV/dW."""
        V = forward(x, ws)
        backward(ws)
        return V

    @njit(forceinline=True, **options)
    def decide(limits: Array, ws: Workspace) -> float:
        """The greedy control u and f = a + B u; returns dV/dx . f."""
        p, q = ws.B.shape
        rate = 0.0
        for i in range(p):
            ws.f[i] = ws.a[i]
            rate += ws.a[i] * ws.dVdx[i]
        for k in range(q):
            slope = 0.0
            for i in range(p):
                slope += ws.B[i, k] * ws.dVdx[i]
            ws.u[k] = limits[k] if slope > 0 else (-limits[k] if slope < 0 else 0.0)
            rate += ws.u[k] * slope
            for i in range(p):
                ws.f[i] += ws.u[k] * ws.B[i, k]
        return rate

    @njit(forceinline=True, **options)
    def learn_once(
        dt: float, s_gamma: float, s_lambda: float, limits: Array, r: float, ws: Workspace
    ) -> tuple[float, float]:
        """One learning step at ``ws.x``, given ``ws.a`` and ``ws.B``; fills ``ws.u`` and ``ws.f``; returns V and H."""
        V = float(value_and_gradients(ws.x, ws))
        H = r - s_gamma * V + decide(limits, ws)
        ws.pending[0] = dt * H
        ws.pending[1] = 1.0 - dt * (s_gamma + s_lambda)
        ws.pending[2] = dt
        return V, H

    @njit(**options)
    def train(
        constants: Any,
        limits: Array,
        initial_states: Array,
        n_steps: int,
        dt: float,
        s_gamma: float,
        s_lambda: float,
        vario: tuple[float, float, float],
        weight: Real,
        trace: Real,
        rate: Real,
        base_rate: Real,
        variance: Real,
        ws: Workspace,
        statistics: Array,
    ) -> None:
        """One trial from each initial state; ``statistics`` (trials, 3) gets the means of V, H^2 and r."""
        n = weight.shape[0]
        eta, beta, epsilon = vario
        for trial in range(initial_states.shape[0]):
            trace[:] = 0
            load_weights(weight, trace, rate, ws)
            for i in range(ws.x.size):
                ws.x[i] = initial_states[trial, i]
            sum_V = sum_H2 = sum_r = 0.0
            for _ in range(n_steps):
                dynamics(constants, ws.x, ws.a, ws.B)
                r = reward(constants, ws.x)
                V, H = learn_once(dt, s_gamma, s_lambda, limits, r, ws)
                for i in range(ws.x.size):
                    ws.x[i] += dt * ws.f[i]
                sum_V += V
                sum_H2 += H * H
                sum_r += r
            update(ws)
            if beta > 0:
                for i in range(n):
                    for j in range(first + i):
                        if base_rate[i, j] == 0:
                            continue
                        change = (ws.T[j, i] - weight[i, j]) / rate[i, j]
                        v = (one - real(beta)) * variance[i, j] + real(beta) * change * change
                        variance[i, j] = v
                        rate[i, j] = base_rate[i, j] * real(eta) / (np.sqrt(v) + real(epsilon))
            store_weights(weight, trace, ws)
            statistics[trial, 0] = sum_V / n_steps
            statistics[trial, 1] = sum_H2 / n_steps
            statistics[trial, 2] = sum_r / n_steps

    @njit(**options)
    def sample(
        constants: Any, limits: Array, states: Array, s_gamma: float, ws: Workspace, out: Array
    ) -> None:
        """V and H at each of ``states``, into ``out`` (states, 2)."""
        for k in range(states.shape[0]):
            for i in range(ws.x.size):
                ws.x[i] = states[k, i]
            dynamics(constants, ws.x, ws.a, ws.B)
            V = float(value_and_gradients(ws.x, ws))
            out[k, 0] = V
            out[k, 1] = reward(constants, ws.x) - s_gamma * V + decide(limits, ws)

    @njit(**options)
    def rollout(
        constants: Any,
        limits: Array,
        initial_states: Array,
        n_steps: int,
        n_skip: int,
        dt: float,
        s_gamma: float,
        ws: Workspace,
        out: Array,
    ) -> None:
        """Greedy episodes by RK4, control held over each step; means and returns into ``out`` (episodes, 2)."""
        p, q = ws.B.shape
        start = np.empty(p)
        increment = np.empty(p)
        for episode in range(initial_states.shape[0]):
            for i in range(p):
                ws.x[i] = initial_states[episode, i]
            gain = 0.0
            discounted = 0.0
            for t in range(n_steps):
                value_and_gradients(ws.x, ws)
                for i in range(p):
                    start[i] = ws.x[i]
                    increment[i] = 0.0
                for stage in range(4):
                    dynamics(constants, ws.x, ws.a, ws.B)
                    r = reward(constants, ws.x)
                    if stage == 0:
                        decide(limits, ws)
                    else:
                        for i in range(p):
                            ws.f[i] = ws.a[i]
                            for k in range(q):
                                ws.f[i] += ws.B[i, k] * ws.u[k]
                    share = (1.0 if stage in (0, 3) else 2.0) / 6.0
                    fraction = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)  # of dt, of this stage
                    following = 1.0 if stage == 2 else 0.5  # of dt, of the next
                    discounted += share * dt * math.exp(-s_gamma * dt * (t + fraction)) * r
                    if t >= n_skip:
                        gain += share * r
                    for i in range(p):
                        increment[i] += share * ws.f[i]
                        ws.x[i] = start[i] + dt * (increment[i] if stage == 3 else following * ws.f[i])
            out[episode, 0] = gain / (n_steps - n_skip)
            out[episode, 1] = discounted

    return _Kernel(train, forward, backward, learn_once, load_weights, store_weights, sample, rollout)


def _workspace(n: int, m: int, p: int, q: int, dtype: Any, rate_each: bool) -> Workspace:
    P, R = round_up(n), round_up(max(n - 1, 1))
    T, W, none = (m + n, P), (n, R), (1, LANES)
    T_rate, W_rate = (T, W) if rate_each else (none, none)
    shapes = (T, T, T_rate, W, W, W_rate, (P,), (P,), (2, m + 1), (2, R), (2, P), (P,), (R,), (m,))
    real = [aligned_zeros(shape, dtype) for shape in shapes]
    state = [np.zeros(shape) for shape in (p, p, p, (p, q), q, p)]
    return Workspace(*real, np.array([0.0, 1.0, 0.0]), np.zeros(1, np.int64), *state)


class FusedTD:
    """The learner of equation 2 for a cascade network, compiled. It changes the network's weights in place.

    Several instances may run in as many threads: the compiled loops hold no lock.

    Parameters
    ----------
    problem : ControlProblem
        What to learn; must have a compiled form.
    network : Cascade
        V_w, in float32 or float64.
    settings : TDSettings
        The algorithm's constants.
    rate_each : bool
        Keep a rate for each weight although neither settings nor network ask for it: then ``rate`` may be set from
        outside, between calls of :meth:`train`. A rate for each neuron is faster.
    """

    def __init__(
        self,
        problem: ControlProblem,
        network: Cascade,
        settings: TDSettings | None = None,
        *,
        rate_each: bool = False,
    ) -> None:
        if not isinstance(network, Cascade):
            raise TypeError(
                f"the fused kernel learns Cascade networks, got {type(network).__name__}; use ContinuousTD"
            )
        compiled = problem.form(CompiledForm)
        if compiled is None:
            raise ValueError(f"problem {problem.name!r} has no compiled form; use ContinuousTD")
        if network.n_inputs != problem.n_inputs:
            raise ValueError(f"{problem.name} has {problem.n_inputs} inputs, the network {network.n_inputs}")
        self.problem = problem
        self.network = network
        self.settings = settings = TDSettings() if settings is None else settings
        dtype = network.weight.dtype
        if dtype not in (torch.float32, torch.float64):
            raise TypeError(f"the network must be float32 or float64, got {dtype}")
        constants, *functions = compiled
        self._constants = constants
        (base,) = network.learning_rates(1.0, settings.output_scaling)
        alike = torch.equal(base, base[:, :1] * network.connected)
        self.rate_each = rate_each = rate_each or settings.vario is not None or not alike
        kind = (dtype == torch.float32, rate_each, network.sigmoid == "logistic")
        self._kernel = _compile(*functions, problem.n_inputs, *kind)
        self.trace = torch.zeros_like(network.weight.data)
        self.base_rate = base
        self.variance = torch.full_like(base, settings.vario.initial_variance if settings.vario else 0.0)
        self.rate = settings.initial_rate * base
        self._limits = np.asarray(problem.control_limits, dtype=np.float64)
        self._ws = _workspace(
            network.n_neurons,
            problem.n_inputs,
            problem.state_size,
            len(self._limits),
            self.trace.numpy().dtype,
            rate_each,
        )

    @property
    def weight(self) -> torch.Tensor:
        """The network's weights."""
        return self.network.weight.data

    def _load(self) -> None:
        weight = self.network.weight.data.numpy()
        self._kernel.load_weights(weight, self.trace.numpy(), self.rate.numpy(), self._ws)

    def train(self, initial_states: Array) -> TrialStatistics:
        """One trial from each of ``initial_states`` (trials, p), one after the other."""
        require_euler(self.problem)
        states = as_states(initial_states, self.problem.state_size)
        settings, vario = self.settings, self.settings.vario
        statistics = np.empty((len(states), 3))
        self._kernel.train(
            self._constants,
            self._limits,
            states,
            settings.steps_per_trial,
            settings.dt,
            self.problem.s_gamma,
            settings.s_lambda,
            (settings.eta, vario.beta, vario.epsilon) if vario else (settings.eta, 0.0, 0.0),
            self.network.weight.data.numpy(),
            self.trace.numpy(),
            self.rate.numpy(),
            self.base_rate.numpy(),
            self.variance.numpy(),
            self._ws,
            statistics,
        )
        return TrialStatistics(*statistics.T)

    def start_trial(self) -> None:
        """Zero traces, for :meth:`learn_at`."""
        if self.settings.vario is not None:
            raise ValueError("vario-eta is not available one step at a time; use train()")
        self.trace.zero_()
        self._load()

    def learn_at(self, x: Array) -> Moment:
        """One learning step at ``x`` (p,) with the dynamics of ``problem`` itself rather than its compiled form.

        For worlds that only Python can step. Call :meth:`start_trial` before the first step of a trial; the network's
        tensors are brought up to date by :meth:`end_trial`.
        """
        ws, settings = self._ws, self.settings
        ws.x[:] = x
        ws.a[:], ws.B[:] = self.problem.drift_and_control_matrix(x)
        V, H = self._kernel.learn_once(
            settings.dt,
            self.problem.s_gamma,
            settings.s_lambda,
            self._limits,
            float(self.problem.reward(x)),
            ws,
        )
        return Moment(ws.u.copy(), V, H)

    def end_trial(self) -> None:
        """Bring weights and traces of the torch module up to date after :meth:`learn_at`."""
        self._kernel.store_weights(self.network.weight.data.numpy(), self.trace.numpy(), self._ws)

    def sample(self, states: Array) -> SampleStatistics:
        """V and H at each of ``states`` (count, p); nothing is learned."""
        states = as_states(states, self.problem.state_size)
        out = np.empty((len(states), 2))
        self._load()
        self._kernel.sample(self._constants, self._limits, states, self.problem.s_gamma, self._ws, out)
        return SampleStatistics(*out.T)

    def rollout(
        self, initial_states: Array, duration: float, skip: float = 0.0, dt: float = 0.01
    ) -> Rollouts:
        """Greedy episodes of ``duration`` seconds by RK4 with the control held for ``dt``; nothing is learned."""
        states = as_states(initial_states, self.problem.state_size)
        n_steps, n_skip = episode_steps(duration, skip, dt)
        out = np.empty((len(states), 2))
        self._load()
        self._kernel.rollout(
            self._constants,
            self._limits,
            states,
            n_steps,
            n_skip,
            dt,
            self.problem.s_gamma,
            self._ws,
            out,
        )
        return Rollouts(*out.T)
