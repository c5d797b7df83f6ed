"""Many independent learners at once, one in each lane of a SIMD vector: equation 2, sixteen times side by side.

Each learner has its own network, traces and trajectory, and is the sequential algorithm of
:mod:`~swimmer_mj.learning.td.continuous_td`; nothing passes from lane to lane, so that what a learner does depends
neither on its lane nor on its companions. Where :mod:`~swimmer_mj.learning.td.fused` waits for one tanh after the
other, a pack of learners waits once for all: its time goes into moving weights and traces through the cache.

A weight of all learners is one vector; rows of weights are stored one after the other without the places where nothing
is connected. As in the fused kernel, the update of weights and traces waits for the next step's forward pass, which
needs each weight anyway.
"""

# pyright: reportCallIssue=false
# numba gives its intrinsics their first argument, the typing context, itself.

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from swimmer_mj.compiled.rational_tanh import tanh_of_lanes
from swimmer_mj.compiled.vectors import (
    FAST,
    LANES,
    aligned_zeros,
    load,
    multiply_add,
    splat,
    store,
)
from swimmer_mj.learning.problems.forms import CompiledForm, LanesForm
from swimmer_mj.learning.problems.problem import ControlProblem, require_euler
from swimmer_mj.learning.td import vario_eta
from swimmer_mj.learning.td.fused import FusedTD, TrialStatistics

__all__ = ["LANES", "PopulationTD"]

Array = NDArray[np.float64]
Real = NDArray[Any]  # the learners' dtype


class LanesWorkspace(NamedTuple):
    """For problems that are compiled for lanes: number i of each array stands at [i LANES, (i + 1) LANES)."""

    x: Array  # (p)
    f: Array  # (p)
    u: Array  # (q)
    dVdx: Array  # (p)
    V: Array  # (1)
    H: Array  # (1)
    r: Array  # (1)


class Workspace(NamedTuple):
    """What the kernel writes. The last axis is the learner's lane, unless said otherwise."""

    weight: Real  # (n_weights, LANES)
    trace: Real  # (n_weights, LANES)
    rate: Real  # of each weight, or of each neuron (n_weights or n, LANES)
    source: Real  # inputs, 1 for the bias, outputs of hidden neurons; before and now (2, m + n, LANES)
    delta: Real  # dV/d(activation), before and now (2, n, LANES)
    gradient: Real  # dV/d(source) (m + n, LANES)
    gain: Real  # dt H of the update that is due (LANES,)
    decay: Real  # of the traces in that update (LANES,)
    step: Real  # dt in that update (LANES,)
    z: Real  # inputs of one learner (m + 1,)
    dVdz: Real  # of one learner (m,)
    dVdx: Array  # of one learner (p,)
    x: Array  # lane first: (LANES, p)
    a: Array  # (LANES, p)
    B: Array  # (LANES, p, q)
    lanes: LanesWorkspace


class _Kernel(NamedTuple):
    train: Callable[..., None]
    train_lanes: Callable[..., None]
    forward: Callable[..., None]
    backward: Callable[..., None]


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
    first = m + 1  # index of the first hidden neuron among the sources
    options: dict[str, Any] = {"fastmath": FAST, "error_model": "numpy", "nogil": True}

    @njit(**options)
    def forward(n: int, old: int, new: int, ws: Workspace) -> None:
        """Do the update that is due, and compute the outputs of all neurons; V is left in ``gradient[0]``."""
        weight, trace, rate, source, delta = ws.weight, ws.trace, ws.rate, ws.source, ws.delta
        S = (m + n) * LANES  # of one half of source
        gain, decay, step = load(ws.gain, 0), load(ws.decay, 0), load(ws.step, 0)
        o = 0
        for i in range(n):
            d = step * load(delta, (old * n + i) * LANES)
            g = gain if rate_each else gain * load(rate, i * LANES)
            even = odd = splat(real(0.0))
            # Two sums, so that additions need not wait for each other; the newest source comes last.
            for j in range(first + i):
                e = load(trace, o)
                if rate_each:
                    w = multiply_add(g * load(rate, o), e, load(weight, o))
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
                continue
            s = new * S + (first + i) * LANES
            half = splat(real(0.5))
            if logistic:
                total = half * total
            if single_precision:
                store(source, s, tanh_of_lanes(total))
            else:
                store(source, s, total)
                for lane in range(LANES):
                    source[new, first + i, lane] = math.tanh(source[new, first + i, lane])
            if logistic:
                store(source, s, multiply_add(half, load(source, s), half))

    @njit(**options)
    def backward(n: int, new: int, ws: Workspace) -> None:
        """``delta`` of all neurons and ``gradient`` of all sources."""
        weight, source, gradient = ws.weight, ws.source, ws.gradient
        S = (m + n) * LANES
        one = splat(real(1.0))
        o = weight.size - (m + n) * LANES
        for j in range(m + n):
            store(gradient, j * LANES, load(weight, o + j * LANES))
        store(ws.delta, (new * n + n - 1) * LANES, one)
        for i in range(n - 2, -1, -1):
            o -= (first + i) * LANES
            y = load(source, new * S + (first + i) * LANES)
            slope = multiply_add(-y, y, y if logistic else one)
            d = slope * load(gradient, (first + i) * LANES)
            store(ws.delta, (new * n + i) * LANES, d)
            for j in range(first + i):
                s = j * LANES
                store(gradient, s, multiply_add(d, load(weight, o + s), load(gradient, s)))

    @njit(**options)
    def train(
        constants: Any,
        limits: Array,
        initial_states: Array,
        n_steps: int,
        dt: float,
        s_gamma: float,
        s_lambda: Array,
        n: int,
        ws: Workspace,
        statistics: Array,
    ) -> None:
        """Trials of all learners from ``initial_states`` (trials, LANES, p); means go to ``statistics`` (.., LANES, 3).

        Traces and what is due must be zero at first; at the end of each trial the update that is due is done.
        """
        p, q = ws.B.shape[1:]
        x, a, B, dVdx = ws.x, ws.a, ws.B, ws.dVdx
        for trial in range(initial_states.shape[0]):
            new = 0
            for lane in range(LANES):
                for i in range(p):
                    x[lane, i] = initial_states[trial, lane, i]
                for i in range(3):
                    statistics[trial, lane, i] = 0.0
            for _ in range(n_steps):
                old, new = new, 1 - new
                for lane in range(LANES):
                    inputs(x[lane], ws.z)
                    for j in range(m):
                        ws.source[new, j, lane] = ws.z[j]
                    ws.source[new, m, lane] = real(1.0)
                forward(n, old, new, ws)
                for lane in range(LANES):
                    statistics[trial, lane, 0] += ws.gradient[0, lane]
                    ws.decay[lane] = ws.gradient[0, lane]  # V, until the decay is known
                backward(n, new, ws)
                for lane in range(LANES):
                    for j in range(m):
                        ws.z[j] = ws.source[new, j, lane]
                        ws.dVdz[j] = ws.gradient[j, lane]
                    input_pullback(ws.z, ws.dVdz, dVdx)
                    dynamics(constants, x[lane], a[lane], B[lane])
                    r = reward(constants, x[lane])
                    H = r - s_gamma * float(ws.decay[lane])
                    for i in range(p):
                        H += a[lane, i] * dVdx[i]
                    for k in range(q):
                        slope = 0.0
                        for i in range(p):
                            slope += B[lane, i, k] * dVdx[i]
                        u = limits[k] if slope > 0 else (-limits[k] if slope < 0 else 0.0)
                        H += u * slope
                        for i in range(p):
                            a[lane, i] += u * B[lane, i, k]
                    for i in range(p):
                        x[lane, i] += dt * a[lane, i]
                    statistics[trial, lane, 1] += H * H
                    statistics[trial, lane, 2] += r
                    ws.gain[lane] = real(dt * H)
                    ws.decay[lane] = real(1.0 - dt * (s_gamma + s_lambda[lane]))
                    ws.step[lane] = real(dt)
            forward(n, new, 1 - new, ws)
            ws.trace[:] = 0
            ws.gain[:] = 0
            ws.step[:] = 0
            for lane in range(LANES):
                for i in range(3):
                    statistics[trial, lane, i] /= n_steps

    @njit(**options)
    def train_lanes(
        constants: Any,
        greedy: Any,
        encode: Any,
        pull_back: Any,
        limits: Array,
        initial_states: Array,
        n_steps: int,
        dt: float,
        s_gamma: float,
        s_lambda: Array,
        n: int,
        ws: Workspace,
        statistics: Array,
    ) -> None:
        """As ``train``, for a problem that is compiled for lanes."""
        p = ws.lanes.x.size // LANES
        x, f, u, dVdx, V, H, r = ws.lanes
        S = (m + n) * LANES
        for trial in range(initial_states.shape[0]):
            new = 0
            for lane in range(LANES):
                for i in range(p):
                    x[i * LANES + lane] = initial_states[trial, lane, i]
                for i in range(3):
                    statistics[trial, lane, i] = 0.0
            for _ in range(n_steps):
                old, new = new, 1 - new
                encode(constants, x, ws.source, new * S)
                store(ws.source, new * S + m * LANES, splat(real(1.0)))
                forward(n, old, new, ws)
                for lane in range(LANES):
                    V[lane] = ws.gradient[0, lane]
                backward(n, new, ws)
                pull_back(constants, ws.source, new * S, ws.gradient, dVdx)
                greedy(constants, limits, x, dVdx, u, f, r)
                step = splat(dt)
                total = multiply_add(splat(-s_gamma), load(V, 0), load(r, 0))
                for i in range(0, p * LANES, LANES):
                    total = multiply_add(load(dVdx, i), load(f, i), total)
                    store(x, i, multiply_add(step, load(f, i), load(x, i)))
                store(H, 0, total)
                for lane in range(LANES):
                    statistics[trial, lane, 0] += V[lane]
                    statistics[trial, lane, 1] += H[lane] * H[lane]
                    statistics[trial, lane, 2] += r[lane]
                    ws.gain[lane] = real(dt * H[lane])
                    ws.decay[lane] = real(1.0 - dt * (s_gamma + s_lambda[lane]))
                    ws.step[lane] = real(dt)
            forward(n, new, 1 - new, ws)
            ws.trace[:] = 0
            ws.gain[:] = 0
            ws.step[:] = 0
            for lane in range(LANES):
                for i in range(3):
                    statistics[trial, lane, i] /= n_steps

    return _Kernel(train, train_lanes, forward, backward)


def _same_problem(a: ControlProblem, b: ControlProblem) -> bool:
    one, other = a.form(CompiledForm), b.form(CompiledForm)
    assert one is not None  # or there would be no FusedTD of it
    assert other is not None
    return (
        (*one[1:], a.s_gamma) == (*other[1:], b.s_gamma)  # constants aside, all is functions
        and np.array_equal(a.control_limits, b.control_limits)
        and all(np.array_equal(x, y) for x, y in zip(one.constants, other.constants, strict=True))
    )


def _kind(learner: FusedTD) -> tuple[object, ...]:
    return learner.weight.shape, learner.weight.dtype, learner.network.sigmoid


def _time(learner: FusedTD) -> tuple[float, float]:
    return learner.settings.dt, learner.settings.trial_duration


class PopulationTD:
    """Up to :data:`LANES` learners of one problem. Changes their networks, and with vario-eta their rates, in place.

    Parameters
    ----------
    learners : sequence of FusedTD
        With networks of one size and dtype. Their settings may differ in everything but time.
    """

    def __init__(self, learners: Sequence[FusedTD]) -> None:
        if not 1 <= len(learners) <= LANES:
            raise ValueError(f"a population has 1 to {LANES} learners, got {len(learners)}")
        (learner, *others) = learners
        network, problem = learner.network, learner.problem
        require_euler(problem)
        for other in others:
            if not _same_problem(other.problem, problem):
                raise ValueError("learners of a population must have one problem and one s_gamma")
            if _kind(other) != _kind(learner):
                raise ValueError("networks of a population must have one size, one dtype and one sigmoid")
            if _time(other) != _time(learner):
                raise ValueError("learners of a population must have one dt and one trial_duration")
        self.learners = list(learners)
        self.problem = problem
        compiled = problem.form(CompiledForm)
        assert compiled is not None  # or there would be no FusedTD of it
        self._constants, *functions = compiled
        self._limits = np.asarray(problem.control_limits, dtype=np.float64)
        n, m, p, q = network.n_neurons, network.n_inputs, problem.state_size, len(self._limits)
        dtype = network.weight.detach().numpy().dtype
        self._connected = network.connected.numpy()
        n_weights = int(self._connected.sum())
        self._rate_each = any(learner.rate_each for learner in learners)
        kind = (dtype == np.float32, self._rate_each, network.sigmoid == "logistic")
        self._kernel = _compile(*functions, m, *kind)
        shapes = (
            (n_weights, LANES),
            (n_weights, LANES),
            (n_weights if self._rate_each else n, LANES),
            (2, m + n, LANES),
            (2, n, LANES),
            (m + n, LANES),
            *[(LANES,)] * 3,
            (m + 1,),
            (m,),
        )
        real = [aligned_zeros(shape, dtype) for shape in shapes]
        state = [np.zeros(shape) for shape in ((p,), (LANES, p), (LANES, p), (LANES, p, q))]
        lanes = [aligned_zeros((size * LANES,), np.float64) for size in (p, p, q, p, 1, 1, 1)]
        self._ws = Workspace(*real, *state, LanesWorkspace(*lanes))
        self._lanes = problem.form(LanesForm)
        s_lambda = [learner.settings.s_lambda for learner in learners]
        self._s_lambda = np.array(s_lambda + [0.0] * (LANES - len(learners)))

    @property
    def final_states(self) -> Array:
        """Where the last trial of each learner ended, shape (learners, p)."""
        p, count = self.problem.state_size, len(self.learners)
        if self._lanes is None:
            return self._ws.x[:count].copy()
        return self._ws.lanes.x.reshape(p, LANES).T[:count].copy()

    def _load(self, name: str) -> Real:
        """Tensors ``name`` of the learners, as the kernel has them: (n_weights, LANES); idle lanes have zeros."""
        tensors = [getattr(learner, name).numpy()[self._connected] for learner in self.learners]
        idle = [np.zeros_like(tensors[0])] * (LANES - len(tensors))
        return np.stack(tensors + idle, axis=-1)

    def train(self, initial_states: Array) -> TrialStatistics:
        """Trials of all learners, from ``initial_states`` (trials, learners, p); statistics are (trials, learners)."""
        states = np.asarray(initial_states, dtype=np.float64)
        count, p = len(self.learners), self.problem.state_size
        if states.ndim != 3 or states.shape[1:] != (count, p):
            raise ValueError(f"initial_states must have shape (trials, {count}, {p}), got {states.shape}")
        states = np.ascontiguousarray(states[:, np.arange(LANES) % count])
        ws, statistics = self._ws, np.empty((len(states), LANES, 3))
        ws.weight[:] = self._load("weight")
        rate = self._load("rate")
        ws.rate[:] = rate if self._rate_each else rate[np.cumsum(self._connected.sum(axis=1)) - 1]
        vario = [learner.settings.vario is not None for learner in self.learners]
        stretch = 1 if any(vario) else max(len(states), 1)
        for k in range(0, len(states), stretch):
            before = ws.weight.copy() if any(vario) else None
            self._train(states[k : k + stretch], statistics[k : k + stretch])
            if before is not None:
                self._adapt(before)
        for lane, learner in enumerate(self.learners):
            learner.weight.numpy()[self._connected] = ws.weight[:, lane]
            if self._rate_each:
                learner.rate.numpy()[self._connected] = ws.rate[:, lane]
        return TrialStatistics(*np.moveaxis(statistics[:, :count], -1, 0))

    def _train(self, states: Array, statistics: Array) -> None:
        settings, lanes = self.learners[0].settings, self._lanes
        train, constants = (
            (self._kernel.train, (self._constants,)) if lanes is None else (self._kernel.train_lanes, lanes)
        )
        train(
            *constants,
            self._limits,
            states,
            settings.steps_per_trial,
            settings.dt,
            self.problem.s_gamma,
            self._s_lambda,
            self.learners[0].network.n_neurons,
            self._ws,
            statistics,
        )

    def _adapt(self, before: Real) -> None:
        """Vario-eta after a trial, for the learners that have it."""
        for lane, learner in enumerate(self.learners):
            settings, vario = learner.settings, learner.settings.vario
            if vario is None:
                continue
            learns = learner.base_rate.numpy()[self._connected] > 0
            variance = learner.variance.numpy()
            change = (self._ws.weight[:, lane] - before[:, lane])[learns]
            place = tuple(axis[learns] for axis in np.nonzero(self._connected))
            v = vario_eta.variance(variance[place], change, self._ws.rate[learns, lane], vario.beta)
            variance[place] = v
            rate = vario_eta.learning_rate(v, settings.eta, vario.epsilon)
            self._ws.rate[learns, lane] = learner.base_rate.numpy()[place] * rate
