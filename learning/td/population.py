"""Many independent learners at once, one in each lane of a SIMD vector: equation 2, sixteen times side by side.

Each learner has its own network, traces and trajectory, and is the sequential algorithm of
:mod:`~swimmer_mj.learning.td.continuous_td`; nothing passes from lane to lane, so that what a learner does depends
neither on its lane nor on its companions. Where :mod:`~swimmer_mj.learning.td.fused` waits for one tanh after the
other, a pack of learners waits once for all: its time goes into moving weights and traces through the cache.
The kernel is :mod:`~swimmer_mj.learning.td.population_kernel`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swimmer_mj.compiled.vectors import LANES
from swimmer_mj.learning.problems.forms import CompiledForm, LanesForm
from swimmer_mj.learning.problems.problem import ControlProblem, require_euler
from swimmer_mj.learning.td import population_kernel as kernel
from swimmer_mj.learning.td import vario_eta
from swimmer_mj.learning.td.fused import FusedTD, TrialStatistics
from swimmer_mj.learning.td.vario_eta import VarioEta

__all__ = ["LANES", "PopulationTD"]

Array = NDArray[np.float64]
Real = NDArray[Any]  # the learners' dtype
Mask = NDArray[np.bool_]


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
        compiled = problem.form(LanesForm) or problem.form(CompiledForm)
        assert compiled is not None  # or there would be no FusedTD of it
        self._constants = compiled.constants
        self._limits = np.asarray(problem.control_limits, dtype=np.float64)
        n, m, p, q = network.n_neurons, network.n_inputs, problem.state_size, len(self._limits)
        dtype = network.weight.detach().numpy().dtype
        # As of a whole cascade: what is not there has rate 0.
        self._connected = np.tri(n, m + n, m, dtype=np.bool_)
        self._rate_each = any(learner.rate_each for learner in learners)
        self._form = kernel.form_of(compiled, m, dtype, self._rate_each, network.sigmoid == "logistic")
        self._ws = kernel.workspace(int(self._connected.sum()), n, m, p, q, dtype, self._rate_each)
        s_lambda = [learner.settings.s_lambda for learner in learners]
        self._s_lambda = np.array(s_lambda + [0.0] * (LANES - len(learners)))

    @property
    def final_states(self) -> Array:
        """Where the last trial of each learner ended, shape (learners, p)."""
        p, count = self.problem.state_size, len(self.learners)
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
        ws.source[:], ws.delta[:] = 0, 0  # they may be NaN, if a learner diverged before
        ws.weight[:] = self._load("weight")
        rate = self._load("rate")
        ws.rate[:] = rate if self._rate_each else rate[np.cumsum(self._connected.sum(axis=1)) - 1]
        base_rate, variance = self._load("base_rate"), self._load("variance")
        vario = self._vario(base_rate)
        stretch = 1 if vario else max(len(states), 1)
        for k in range(0, len(states), stretch):
            before = ws.weight.copy() if vario else ws.weight
            self._train(states[k : k + stretch], statistics[k : k + stretch])
            for (eta, constants), learns in vario.items():
                self._adapt(before, variance, base_rate, learns, eta, constants)
        for lane, learner in enumerate(self.learners):
            learner.weight.numpy()[self._connected] = ws.weight[:, lane]
            if self._rate_each:
                learner.rate.numpy()[self._connected] = ws.rate[:, lane]
            if learner.settings.vario is not None:
                learner.variance.numpy()[self._connected] = variance[:, lane]
        return TrialStatistics(*np.moveaxis(statistics[:, :count], -1, 0))

    def _train(self, states: Array, statistics: Array) -> None:
        settings = self.learners[0].settings
        kernel.train(
            self._form,
            self._constants,
            self._limits,
            states,
            settings.steps_per_trial,
            settings.dt,
            self.problem.s_gamma,
            self._s_lambda,
            self._ws,
            statistics,
        )

    def _vario(self, base_rate: Real) -> dict[tuple[float, VarioEta], Mask]:
        """What learns by vario-eta, (n_weights, LANES), by eta and constants: one mask if learners have the same."""
        masks: dict[tuple[float, VarioEta], Mask] = {}
        for lane, learner in enumerate(self.learners):
            settings = learner.settings
            if settings.vario is not None:
                none = np.zeros(base_rate.shape, dtype=np.bool_)
                mask = masks.setdefault((settings.eta, settings.vario), none)
                mask[:, lane] = base_rate[:, lane] > 0
        return masks

    def _adapt(
        self, before: Real, variance: Real, base_rate: Real, learns: Mask, eta: float, vario: VarioEta
    ) -> None:
        """Vario-eta after a trial, where ``learns``. Changes ``variance`` and the rates."""
        change = self._ws.weight[learns] - before[learns]
        v = vario_eta.variance(variance[learns], change, self._ws.rate[learns], vario.beta)
        variance[learns] = v
        self._ws.rate[learns] = base_rate[learns] * vario_eta.learning_rate(v, eta, vario.epsilon)
