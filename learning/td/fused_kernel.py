"""Equation 2 for one cascade network, step by step, compiled: see :mod:`~swimmer_mj.learning.td.fused`.

One learner is a chain of dependent operations, so what counts is latency:

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

``form`` is what :func:`form_of` makes of a problem; entry points for Python stand at the end.
"""

# pyright: reportCallIssue=false
# numba gives its intrinsics their first argument, the typing context, itself.

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import DTypeLike, NDArray

from swimmer_mj.compiled.cache import entry_point
from swimmer_mj.compiled.elementary import tanh_of_one
from swimmer_mj.compiled.static import Static
from swimmer_mj.compiled.vectors import (
    LANES,
    OPTIONS,
    add_lanes,
    aligned_zeros,
    load,
    multiply_add,
    round_up,
    splat,
    store,
)
from swimmer_mj.learning.problems.forms import CompiledForm
from swimmer_mj.learning.td.greedy import decide, hold_for_a_step

__all__ = [
    "Workspace",
    "backward",
    "form_of",
    "forward",
    "learn_once",
    "load_weights",
    "rollout",
    "sample",
    "store_weights",
    "train",
    "workspace",
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


def workspace(n: int, m: int, p: int, q: int, dtype: DTypeLike, rate_each: bool) -> Workspace:
    """A workspace for n neurons, m inputs, p state variables and q controls."""
    P, R = round_up(n), round_up(max(n - 1, 1))
    T, W, none = (m + n, P), (n, R), (1, LANES)
    T_rate, W_rate = (T, W) if rate_each else (none, none)
    shapes = (T, T, T_rate, W, W, W_rate, (P,), (P,), (2, m + 1), (2, R), (2, P), (P,), (R,), (m,))
    real = [aligned_zeros(shape, dtype) for shape in shapes]
    state = [np.zeros(shape) for shape in (p, p, p, (p, q), q, p)]
    return Workspace(*real, np.array([0.0, 1.0, 0.0]), np.zeros(1, np.int64), *state)


@njit(forceinline=True, **OPTIONS)
def _tanh_of_double(x: float) -> float:
    return math.tanh(x)


def form_of(problem: CompiledForm, m: int, dtype: DTypeLike, rate_each: bool, logistic: bool) -> Static:
    """What the kernel is compiled for: a problem with m inputs; a rate for each weight or for each neuron."""
    return Static(
        **dict(zip(problem._fields[1:], problem[1:], strict=True)),
        m=m,
        tanh=tanh_of_one if dtype == np.float32 else _tanh_of_double,
        rate_each=rate_each,
        logistic=logistic,
    )


@njit(**OPTIONS)
def _nothing_due(ws: Workspace) -> None:
    ws.pending[0] = 0.0
    ws.pending[1] = 1.0
    ws.pending[2] = 0.0


@njit(forceinline=True, **OPTIONS)
def _updated(
    form: Any, w: Real, e: Real, rate: Real, gain: Any, decay: Any, d: Any, gradient: Any, o: int
) -> Any:
    """The vector of weights at ``o`` after w += dt eta H e, which is stored, as is e += dt (... + dV/dw)."""
    trace = load(e, o)
    if form.rate_each:
        weight = multiply_add(gain * load(rate, o), trace, load(w, o))
    else:
        weight = multiply_add(gain, trace, load(w, o))
    store(w, o, weight)
    store(e, o, multiply_add(decay, trace, d * gradient))
    return weight


@njit(forceinline=True, **OPTIONS)
def _set_gains(form: Any, ws: Workspace) -> None:
    """The factors of the traces in the update that is due: dt H, times the rate if it is one for all of a neuron."""
    dt_H = splat(ws.gain.dtype.type(ws.pending[0]))
    for j in range(0, ws.gain.size, LANES):
        store(ws.gain, j, dt_H if form.rate_each else dt_H * load(ws.rate, j))


@njit(**OPTIONS)
def _update(form: Any, ws: Workspace) -> None:
    """Do what is due, to ``T`` alone."""
    P, first, o = ws.T.shape[1], form.m + 1, ws.now[0]
    real = ws.T.dtype.type
    decay, step = splat(real(ws.pending[1])), real(ws.pending[2])
    _set_gains(form, ws)
    for k in range(ws.T.shape[0]):
        d = splat(step * (ws.z[o, k] if k < first else ws.y[o, k - first]))
        for j in range(0, P, LANES):
            slope = load(ws.delta, o * P + j)
            _updated(form, ws.T, ws.T_trace, ws.T_rate, load(ws.gain, j), decay, d, slope, k * P + j)
    _nothing_due(ws)


@njit(forceinline=True, **OPTIONS)
def _hear_inputs(form: Any, old: int, new: int, ws: Workspace) -> None:
    """The activations as far as they come from inputs and bias: a_j = sum_k w_jk z_k."""
    P = ws.T.shape[1]
    real = ws.T.dtype.type
    decay, step = splat(real(ws.pending[1])), real(ws.pending[2])
    for j in range(0, P, LANES):
        total = splat(real(0.0))
        gain, slope = load(ws.gain, j), load(ws.delta, old * P + j)
        for k in range(form.m + 1):
            d = splat(step * ws.z[old, k])
            w = _updated(form, ws.T, ws.T_trace, ws.T_rate, gain, decay, d, slope, k * P + j)
            total = multiply_add(splat(ws.z[new, k]), w, total)
        store(ws.activation, j, total)


@njit(forceinline=True, **OPTIONS)
def _fire(form: Any, old: int, new: int, ws: Workspace) -> Any:
    """One hidden neuron after the other: y_i = tanh(a_i), then a_j += w_ji y_i for all j > i; returns V = a_n."""
    P, first, hidden = ws.T.shape[1], form.m + 1, ws.W.shape[0] - 1
    real = ws.T.dtype.type
    half = real(0.5)
    decay, step = splat(real(ws.pending[1])), real(ws.pending[2])
    activation_i = ws.activation[0]
    for i in range(hidden):
        y_i = half + half * form.tanh(half * activation_i) if form.logistic else form.tanh(activation_i)
        ws.y[new, i] = y_i
        y, d = splat(y_i), splat(step * ws.y[old, i])
        activation_i = ws.activation[i + 1]
        for j in range((i + 1) // LANES * LANES, P, LANES):
            o, slope = (first + i) * P + j, load(ws.delta, old * P + j)
            w = _updated(form, ws.T, ws.T_trace, ws.T_rate, load(ws.gain, j), decay, d, slope, o)
            store(ws.activation, j, multiply_add(y, w, load(ws.activation, j)))
        activation_i += y_i * ws.T[first + i, i + 1]
    return activation_i


@njit(forceinline=True, **OPTIONS)
def forward(form: Any, x: Array, ws: Workspace) -> Any:
    """Do the update that is due to ``T``, and return V at ``x``; fills z and y."""
    old = ws.now[0]
    new = 1 - old
    ws.now[0] = new
    _set_gains(form, ws)
    form.inputs(x, ws.z[new])
    ws.z[new, form.m] = 1.0
    _hear_inputs(form, old, new, ws)
    return _fire(form, old, new, ws)


@njit(forceinline=True, **OPTIONS)
def _return_errors(form: Any, old: int, new: int, ws: Workspace) -> None:
    """From the output to the first neuron: delta_i = y'_i dV/dy_i, then dV/dy_j += w_ij delta_i for all j < i."""
    n, R = ws.W.shape
    hidden = n - 1
    real = ws.W.dtype.type
    one = real(1.0)
    decay, step = splat(real(ws.pending[1])), real(ws.pending[2])
    ws.delta[new, hidden] = one
    d, gain = splat(step * ws.delta[old, hidden]), splat(ws.gain[hidden])
    for j in range(0, R, LANES):
        y, o = load(ws.y, old * R + j), hidden * R + j
        store(ws.gradient, j, _updated(form, ws.W, ws.W_trace, ws.W_rate, gain, decay, d, y, o))
    gradient_i = ws.gradient[hidden - 1]
    for i in range(hidden - 1, -1, -1):
        y_i = ws.y[new, i]
        delta_i = ((y_i if form.logistic else one) - y_i * y_i) * gradient_i
        d, gain = splat(step * ws.delta[old, i]), splat(ws.gain[i])
        ws.delta[new, i] = delta_i
        slope = splat(delta_i)
        gradient_i = ws.gradient[max(i - 1, 0)]
        for j in range(0, i, LANES):
            y, o = load(ws.y, old * R + j), i * R + j
            w = _updated(form, ws.W, ws.W_trace, ws.W_rate, gain, decay, d, y, o)
            store(ws.gradient, j, multiply_add(slope, w, load(ws.gradient, j)))
        gradient_i += delta_i * ws.W[i, max(i - 1, 0)]


@njit(forceinline=True, **OPTIONS)
def _slope_in_inputs(form: Any, new: int, ws: Workspace) -> None:
    """DV/dz_k = sum_j w_jk delta_j, and dV/dx = (dz/dx)^T dV/dz."""
    P = ws.T.shape[1]
    for k in range(form.m):
        total = load(ws.T, k * P) * load(ws.delta, new * P)
        for j in range(LANES, P, LANES):
            total = multiply_add(load(ws.T, k * P + j), load(ws.delta, new * P + j), total)
        ws.dVdz[k] = add_lanes(total)
    form.input_pullback(ws.z[new], ws.dVdz, ws.dVdx)


@njit(forceinline=True, **OPTIONS)
def backward(form: Any, ws: Workspace) -> None:
    """Do the update that is due to ``W``, and fill delta and dVdx."""
    new = ws.now[0]
    _return_errors(form, 1 - new, new, ws)
    _slope_in_inputs(form, new, ws)
    _nothing_due(ws)


@njit(forceinline=True, **OPTIONS)
def _value_and_gradients(form: Any, ws: Workspace) -> float:
    """Do the update that is due, then V at ``ws.x``; fills dVdx, and z, y and delta, whose product is dV/dW."""
    V = forward(form, ws.x, ws)
    backward(form, ws)
    return float(V)


@njit(forceinline=True, **OPTIONS)
def _learn(
    form: Any, dt: float, s_gamma: float, s_lambda: float, limits: Array, r: float, ws: Workspace
) -> tuple[float, float]:
    """One learning step at ``ws.x``, given ``ws.a`` and ``ws.B``; fills ``ws.u`` and ``ws.f``; returns V and H.

    What is due then: w += dt eta H e, e += dt (-(s_gamma + s_lambda) e + dV/dw).
    """
    V = _value_and_gradients(form, ws)
    H = r - s_gamma * V + decide(limits, ws.dVdx, ws.a, ws.B, ws.u, ws.f)
    ws.pending[0] = dt * H
    ws.pending[1] = 1.0 - dt * (s_gamma + s_lambda)
    ws.pending[2] = dt
    return V, H


@njit(**OPTIONS)
def _load(form: Any, weight: Real, trace: Real, rate: Real, ws: Workspace) -> None:
    """From the tensors, shape (n, m + n), to the workspace; no update is due."""
    first = form.m + 1
    for array in (ws.T, ws.T_trace, ws.T_rate, ws.W, ws.W_trace, ws.W_rate, ws.z, ws.y, ws.delta):
        array[:] = 0
    for i in range(weight.shape[0]):
        ws.rate[i] = rate[i, 0]
        for j in range(first + i):
            ws.T[j, i] = weight[i, j]
            ws.T_trace[j, i] = trace[i, j]
            if form.rate_each:
                ws.T_rate[j, i] = rate[i, j]
        for j in range(i):
            ws.W[i, j] = weight[i, first + j]
            ws.W_trace[i, j] = trace[i, first + j]
            if form.rate_each:
                ws.W_rate[i, j] = rate[i, first + j]
    _nothing_due(ws)


@njit(**OPTIONS)
def _store(form: Any, weight: Real, trace: Real, ws: Workspace) -> None:
    """From the workspace to the tensors, up to date."""
    _update(form, ws)
    for i in range(weight.shape[0]):
        for j in range(form.m + 1 + i):
            weight[i, j] = ws.T[j, i]
            trace[i, j] = ws.T_trace[j, i]


@njit(**OPTIONS)
def _adapt_rates(
    form: Any,
    vario: tuple[float, float, float],
    weight: Real,
    rate: Real,
    base_rate: Real,
    variance: Real,
    ws: Workspace,
) -> None:
    """Vario-eta after a trial: v += beta ((dw / eta_w)^2 - v), eta_w = base eta / (sqrt(v) + epsilon)."""
    real = weight.dtype.type
    eta, beta, epsilon = real(vario[0]), real(vario[1]), real(vario[2])
    for i in range(weight.shape[0]):
        for j in range(form.m + 1 + i):
            if base_rate[i, j] == 0:
                continue
            change = (ws.T[j, i] - weight[i, j]) / rate[i, j]
            v = (real(1.0) - beta) * variance[i, j] + beta * change * change
            variance[i, j] = v
            rate[i, j] = base_rate[i, j] * eta / (np.sqrt(v) + epsilon)


@entry_point(**OPTIONS)
def train(
    form: Any,
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
    for trial in range(initial_states.shape[0]):
        trace[:] = 0
        _load(form, weight, trace, rate, ws)
        for i in range(ws.x.size):
            ws.x[i] = initial_states[trial, i]
        sum_V = sum_H2 = sum_r = 0.0
        for _ in range(n_steps):
            form.dynamics(constants, ws.x, ws.a, ws.B)
            r = form.reward(constants, ws.x)
            V, H = _learn(form, dt, s_gamma, s_lambda, limits, r, ws)
            for i in range(ws.x.size):
                ws.x[i] += dt * ws.f[i]
            sum_V += V
            sum_H2 += H * H
            sum_r += r
        _update(form, ws)
        if vario[1] > 0:
            _adapt_rates(form, vario, weight, rate, base_rate, variance, ws)
        _store(form, weight, trace, ws)
        statistics[trial, 0] = sum_V / n_steps
        statistics[trial, 1] = sum_H2 / n_steps
        statistics[trial, 2] = sum_r / n_steps


@entry_point(**OPTIONS)
def learn_once(
    form: Any, dt: float, s_gamma: float, s_lambda: float, limits: Array, r: float, ws: Workspace
) -> tuple[float, float]:
    """One learning step at ``ws.x``, given ``ws.a`` and ``ws.B``; fills ``ws.u`` and ``ws.f``; returns V and H."""
    return _learn(form, dt, s_gamma, s_lambda, limits, r, ws)


@entry_point(**OPTIONS)
def load_weights(form: Any, weight: Real, trace: Real, rate: Real, ws: Workspace) -> None:
    """From the tensors, shape (n, m + n), to the workspace; no update is due."""
    _load(form, weight, trace, rate, ws)


@entry_point(**OPTIONS)
def store_weights(form: Any, weight: Real, trace: Real, ws: Workspace) -> None:
    """From the workspace to the tensors, up to date."""
    _store(form, weight, trace, ws)


@entry_point(**OPTIONS)
def sample(
    form: Any, constants: Any, limits: Array, states: Array, s_gamma: float, ws: Workspace, out: Array
) -> None:
    """V and H at each of ``states``, into ``out`` (states, 2)."""
    for k in range(states.shape[0]):
        for i in range(ws.x.size):
            ws.x[i] = states[k, i]
        form.dynamics(constants, ws.x, ws.a, ws.B)
        V = _value_and_gradients(form, ws)
        out[k, 0] = V
        out[k, 1] = (
            form.reward(constants, ws.x) - s_gamma * V + decide(limits, ws.dVdx, ws.a, ws.B, ws.u, ws.f)
        )


@entry_point(**OPTIONS)
def rollout(
    form: Any,
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
    """Greedy episodes, control held over each step; means of r and returns into ``out`` (episodes, 2)."""
    for episode in range(initial_states.shape[0]):
        for i in range(ws.x.size):
            ws.x[i] = initial_states[episode, i]
        gain = discounted = 0.0
        for t in range(n_steps):
            _value_and_gradients(form, ws)
            mean, share = hold_for_a_step(
                form, constants, limits, ws.dVdx, ws.x, ws.a, ws.B, ws.u, ws.f, t * dt, dt, s_gamma
            )
            if t >= n_skip:
                gain += mean
            discounted += share
        out[episode, 0] = gain / (n_steps - n_skip)
        out[episode, 1] = discounted
