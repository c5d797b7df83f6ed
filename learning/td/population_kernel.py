"""Equation 2 for a pack of learners, one in each lane, compiled: see :mod:`~swimmer_mj.learning.td.population`.

A weight of all learners is one vector; rows of weights are stored one after the other without the places where nothing
is connected. As in the fused kernel, the update of weights and traces waits for the next step's forward pass, which
needs each weight anyway.

``form`` is what :func:`form_of` makes of a problem: of its functions for LANES states at once, if it has them, or of
those for one state, called for one lane after the other. The entry point for Python stands at the end.
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
from swimmer_mj.compiled.elementary import tanh_of_lanes
from swimmer_mj.compiled.static import Static
from swimmer_mj.compiled.vectors import LANES, OPTIONS, aligned_zeros, load, multiply_add, splat, store
from swimmer_mj.learning.problems.forms import CompiledForm, LanesForm
from swimmer_mj.learning.td.greedy import decide

__all__ = ["Workspace", "backward", "form_of", "forward", "train", "workspace"]

Array = NDArray[np.float64]
Real = NDArray[Any]  # the learners' dtype


class Lanes(NamedTuple):
    """States of all learners and what belongs to them: number i of each stands at [i LANES, (i + 1) LANES)."""

    x: Array  # (p)
    f: Array  # dx/dt (p)
    u: Array  # (q)
    dVdx: Array  # (p)
    V: Array  # (1)
    H: Array  # (1)
    r: Array  # (1)


class One(NamedTuple):
    """The same of one learner, for problems that are asked for one state after the other."""

    z: Real  # inputs (m + 1,)
    dVdz: Real  # (m,)
    x: Array  # (p,)
    dVdx: Array  # (p,)
    a: Array  # drift (p,)
    B: Array  # control matrix (p, q)
    u: Array  # (q,)
    f: Array  # a + B u (p,)


class Workspace(NamedTuple):
    """What the kernel writes. The last axis is the learner's lane."""

    weight: Real  # (n_weights, LANES)
    trace: Real  # (n_weights, LANES)
    rate: Real  # of each weight, or of each neuron (n_weights or n, LANES)
    source: Real  # inputs, 1 for the bias, outputs of hidden neurons; before and now (2, m + n, LANES)
    delta: Real  # dV/d(activation), before and now (2, n, LANES)
    gradient: Real  # dV/d(source) (m + n, LANES)
    gain: Real  # dt H of the update that is due (LANES,)
    decay: Real  # of the traces in that update (LANES,)
    step: Real  # dt in that update (LANES,)
    lanes: Lanes
    one: One


def workspace(n_weights: int, n: int, m: int, p: int, q: int, dtype: DTypeLike, rate_each: bool) -> Workspace:
    """A workspace for networks of n neurons and m inputs, p state variables and q controls."""
    weights, rates = (n_weights, LANES), (n_weights if rate_each else n, LANES)
    shapes = (weights, weights, rates, (2, m + n, LANES), (2, n, LANES), (m + n, LANES), *[(LANES,)] * 3)
    lanes = (aligned_zeros((size * LANES,), np.float64) for size in (p, p, q, p, 1, 1, 1))
    one = (np.zeros(shape) for shape in ((p,), (p,), (p,), (p, q), (q,), (p,)))
    return Workspace(
        *(aligned_zeros(shape, dtype) for shape in shapes),
        Lanes(*lanes),
        One(np.zeros(m + 1, dtype), np.zeros(m, dtype), *one),
    )


@njit(forceinline=True, **OPTIONS)
def _tanh_of_singles(total: Any, source: Real, new: int, j: int) -> None:
    """``source[new, j]`` becomes tanh of the vector ``total``."""
    store(source, (new * source.shape[1] + j) * LANES, tanh_of_lanes(total))


@njit(forceinline=True, **OPTIONS)
def _tanh_of_doubles(total: Any, source: Real, new: int, j: int) -> None:
    store(source, (new * source.shape[1] + j) * LANES, total)
    for lane in range(LANES):
        source[new, j, lane] = math.tanh(source[new, j, lane])


@njit(**OPTIONS)
def forward(form: Any, old: int, new: int, ws: Workspace) -> None:
    """Do the update that is due, and compute the outputs of all neurons; V is left in ``gradient[0]``."""
    weight, trace, source = ws.weight, ws.trace, ws.source
    n, first, S = ws.delta.shape[1], form.m + 1, ws.source.shape[1] * LANES
    gain, decay, step = load(ws.gain, 0), load(ws.decay, 0), load(ws.step, 0)
    half = splat(weight.dtype.type(0.5))
    o = 0
    for i in range(n):
        d = step * load(ws.delta, (old * n + i) * LANES)
        g = gain if form.rate_each else gain * load(ws.rate, i * LANES)
        even = odd = splat(weight.dtype.type(0.0))
        # Two sums, so that additions need not wait for each other; the newest source comes last.
        for j in range(first + i):
            e = load(trace, o)
            if form.rate_each:
                w = multiply_add(g * load(ws.rate, o), e, load(weight, o))
            else:
                w = multiply_add(g, e, load(weight, o))
            store(weight, o, w)
            s = j * LANES
            store(trace, o, multiply_add(decay, e, d * load(source, old * S + s)))
            even, odd = odd, multiply_add(load(source, new * S + s), w, even)
            o += LANES
        total = even + odd
        if i == n - 1:
            store(ws.gradient, 0, total)
        elif form.logistic:
            s = new * S + (first + i) * LANES
            form.tanh(half * total, source, new, first + i)
            store(source, s, multiply_add(half, load(source, s), half))
        else:
            form.tanh(total, source, new, first + i)


@njit(**OPTIONS)
def backward(form: Any, new: int, ws: Workspace) -> None:
    """``delta`` of all neurons and ``gradient`` of all sources."""
    weight, source, gradient = ws.weight, ws.source, ws.gradient
    n, first, sources = ws.delta.shape[1], form.m + 1, ws.source.shape[1]
    one = splat(weight.dtype.type(1.0))
    o = weight.size - sources * LANES
    for j in range(sources):
        store(gradient, j * LANES, load(weight, o + j * LANES))
    store(ws.delta, (new * n + n - 1) * LANES, one)
    for i in range(n - 2, -1, -1):
        o -= (first + i) * LANES
        y = load(source, (new * sources + first + i) * LANES)
        slope = multiply_add(-y, y, y if form.logistic else one)
        d = slope * load(gradient, (first + i) * LANES)
        store(ws.delta, (new * n + i) * LANES, d)
        for j in range(first + i):
            s = j * LANES
            store(gradient, s, multiply_add(d, load(weight, o + s), load(gradient, s)))


@njit(**OPTIONS)
def _encode_one_by_one(form: Any, constants: Any, x: Array, source: Real, new: int, one: One) -> None:
    """The inputs of all learners."""
    for lane in range(LANES):
        for i in range(one.x.size):
            one.x[i] = x[i * LANES + lane]
        form.inputs(one.x, one.z)
        for j in range(form.m):
            source[new, j, lane] = one.z[j]


@njit(**OPTIONS)
def _decide_one_by_one(
    form: Any,
    constants: Any,
    limits: Array,
    source: Real,
    new: int,
    gradient: Real,
    x: Array,
    dVdx: Array,
    u: Array,
    f: Array,
    r: Array,
    one: One,
) -> None:
    """DV/dx of all learners, greedy control, f = a + B u and the reward."""
    for lane in range(LANES):
        for j in range(form.m):
            one.z[j] = source[new, j, lane]
            one.dVdz[j] = gradient[j, lane]
        for i in range(one.x.size):
            one.x[i] = x[i * LANES + lane]
        form.input_pullback(one.z, one.dVdz, one.dVdx)
        form.dynamics(constants, one.x, one.a, one.B)
        r[lane] = form.reward(constants, one.x)
        decide(limits, one.dVdx, one.a, one.B, one.u, one.f)
        for i in range(one.x.size):
            dVdx[i * LANES + lane] = one.dVdx[i]
            f[i * LANES + lane] = one.f[i]


@njit(forceinline=True, **OPTIONS)
def _encode_lanes(form: Any, constants: Any, x: Array, source: Real, new: int, one: One) -> None:
    form.encode(constants, x, source, new * source.shape[1] * LANES)


@njit(forceinline=True, **OPTIONS)
def _decide_lanes(
    form: Any,
    constants: Any,
    limits: Array,
    source: Real,
    new: int,
    gradient: Real,
    x: Array,
    dVdx: Array,
    u: Array,
    f: Array,
    r: Array,
    one: One,
) -> None:
    form.pull_back(constants, source, new * source.shape[1] * LANES, gradient, dVdx)
    form.greedy(constants, limits, x, dVdx, u, f, r)


def form_of(
    problem: CompiledForm | LanesForm, m: int, dtype: DTypeLike, rate_each: bool, logistic: bool
) -> Static:
    """What the kernel is compiled for: a problem with m inputs; a rate for each weight or for each neuron."""
    lanes = isinstance(problem, LanesForm)
    return Static(
        **dict(zip(problem._fields[1:], problem[1:], strict=True)),
        encode_all=_encode_lanes if lanes else _encode_one_by_one,
        decide_all=_decide_lanes if lanes else _decide_one_by_one,
        m=m,
        tanh=_tanh_of_singles if dtype == np.float32 else _tanh_of_doubles,
        rate_each=rate_each,
        logistic=logistic,
    )


@njit(**OPTIONS)
def _trial(
    form: Any,
    constants: Any,
    limits: Array,
    n_steps: int,
    dt: float,
    s_gamma: float,
    s_lambda: Array,
    ws: Workspace,
    statistics: Array,
) -> None:
    """``n_steps`` learning steps of all learners; adds V, H^2 and r of each step to ``statistics`` (LANES, 3).

    What is due after a step: w += dt eta H e, e += dt (-(s_gamma + s_lambda) e + dV/dw).
    """
    # Arrays are taken from the workspace here, once: counting references costs more than a step.
    source, gradient, gain, decay, one = ws.source, ws.gradient, ws.gain, ws.decay, ws.one
    x, f, u, dVdx, V, H, r = ws.lanes
    real = source.dtype.type
    new = 0
    for _ in range(n_steps):
        new = 1 - new
        form.encode_all(form, constants, x, source, new, one)
        store(source, (new * source.shape[1] + form.m) * LANES, splat(real(1.0)))
        forward(form, 1 - new, new, ws)
        for lane in range(LANES):
            V[lane] = gradient[0, lane]
        backward(form, new, ws)
        form.decide_all(form, constants, limits, source, new, gradient, x, dVdx, u, f, r, one)
        total = multiply_add(splat(-s_gamma), load(V, 0), load(r, 0))
        for i in range(0, x.size, LANES):
            total = multiply_add(load(dVdx, i), load(f, i), total)
            store(x, i, multiply_add(splat(dt), load(f, i), load(x, i)))
        store(H, 0, total)
        store(ws.step, 0, splat(real(dt)))
        for lane in range(LANES):
            gain[lane] = real(dt * H[lane])
            decay[lane] = real(1.0 - dt * (s_gamma + s_lambda[lane]))
            statistics[lane, 0] += V[lane]
            statistics[lane, 1] += H[lane] * H[lane]
            statistics[lane, 2] += r[lane]
    forward(form, new, 1 - new, ws)


@entry_point(**OPTIONS)
def train(
    form: Any,
    constants: Any,
    limits: Array,
    initial_states: Array,
    n_steps: int,
    dt: float,
    s_gamma: float,
    s_lambda: Array,
    ws: Workspace,
    statistics: Array,
) -> None:
    """Trials of all learners from ``initial_states`` (trials, LANES, p); means go to ``statistics`` (.., LANES, 3).

    Traces and what is due must be zero at first; at the end of each trial the update that is due is done.
    """
    for trial in range(initial_states.shape[0]):
        for lane in range(LANES):
            for i in range(initial_states.shape[2]):
                ws.lanes.x[i * LANES + lane] = initial_states[trial, lane, i]
        statistics[trial] = 0.0
        _trial(form, constants, limits, n_steps, dt, s_gamma, s_lambda, ws, statistics[trial])
        statistics[trial] /= n_steps
        ws.trace[:] = 0
        ws.gain[:] = 0
        ws.step[:] = 0
