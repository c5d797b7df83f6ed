"""Continuous TD(lambda) for the cascade network as one compiled loop, on the tensors of the torch module.

The algorithm is that of :mod:`~swimmer_mj.learning.td.continuous_td`, step by step; what differs is when and in which
order its arithmetic is done (:mod:`~swimmer_mj.learning.td.fused_kernel`). In float32, tanh is that of
:mod:`swimmer_mj.compiled.elementary`; in float64 it is the C library's.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from swimmer_mj.learning.networks.networks import Cascade
from swimmer_mj.learning.problems.forms import CompiledForm, CostForm, HoldForm, Moment
from swimmer_mj.learning.problems.problem import ControlProblem, as_states, episode_steps, require_euler
from swimmer_mj.learning.td import fused_kernel as kernel
from swimmer_mj.learning.td.continuous_td import TDSettings

__all__ = [
    "FusedTD",
    "Rollouts",
    "SampleStatistics",
    "TrialStatistics",
    "compiled_form",
    "obstacle",
]

Array = NDArray[np.float64]
Real = NDArray[Any]  # the learner's dtype


def obstacle(problem: ControlProblem) -> str | None:
    """Why compiled learners cannot learn ``problem``, to be read after its name; None if they can.

    The control that they decide on is free, and that of the instant.
    """
    if problem.form(CompiledForm) is None:
        return "has no compiled form"
    if problem.form(CostForm) is not None:
        return "has controls that cost"
    return None if problem.form(HoldForm) is None else "chooses controls to be held"


def compiled_form(problem: ControlProblem) -> CompiledForm:
    """The compiled form of ``problem``; ValueError if a compiled learner cannot learn it."""
    compiled, why = problem.form(CompiledForm), obstacle(problem)
    if compiled is None or why is not None:
        raise ValueError(f"problem {problem.name!r} {why}; use SteppedTD")
    return compiled


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


class FusedTD:
    """The learner of equation 2 for a cascade network, compiled. It changes the network's weights in place.

    Several instances may run in as many threads: the compiled loops hold no lock.

    Parameters
    ----------
    problem : ControlProblem
        What to learn; must have a compiled form, and controls of the instant that cost nothing.
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
        compiled = compiled_form(problem)
        if network.n_inputs != problem.n_inputs:
            raise ValueError(f"{problem.name} has {problem.n_inputs} inputs, the network {network.n_inputs}")
        self.problem = problem
        self.network = network
        self.settings = settings = TDSettings() if settings is None else settings
        dtype = network.weight.dtype
        if dtype not in (torch.float32, torch.float64):
            raise TypeError(f"the network must be float32 or float64, got {dtype}")
        self._constants = compiled.constants
        (base,) = network.learning_rates(1.0, settings.output_scaling)
        alike = torch.equal(base, base[:, :1] * network.connected)
        self.rate_each = rate_each = rate_each or settings.vario is not None or not alike
        self.trace = torch.zeros_like(network.weight.data)
        self._form = kernel.form_of(
            compiled, problem.n_inputs, self.trace.numpy().dtype, rate_each, network.sigmoid == "logistic"
        )
        self.base_rate = base
        self.variance = torch.full_like(base, settings.vario.initial_variance if settings.vario else 0.0)
        self.rate = settings.initial_rate * base
        self._limits = np.asarray(problem.control_limits, dtype=np.float64)
        self._ws = kernel.workspace(
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
        kernel.load_weights(self._form, weight, self.trace.numpy(), self.rate.numpy(), self._ws)

    def train(self, initial_states: Array) -> TrialStatistics:
        """One trial from each of ``initial_states`` (trials, p), one after the other."""
        require_euler(self.problem)
        states = as_states(initial_states, self.problem.state_size)
        settings, vario = self.settings, self.settings.vario
        statistics = np.empty((len(states), 3))
        kernel.train(
            self._form,
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
        V, H = kernel.learn_once(
            self._form,
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
        kernel.store_weights(self._form, self.network.weight.data.numpy(), self.trace.numpy(), self._ws)

    def sample(self, states: Array) -> SampleStatistics:
        """V and H at each of ``states`` (count, p); nothing is learned."""
        states = as_states(states, self.problem.state_size)
        out = np.empty((len(states), 2))
        self._load()
        kernel.sample(self._form, self._constants, self._limits, states, self.problem.s_gamma, self._ws, out)
        return SampleStatistics(*out.T)

    def rollout(
        self, initial_states: Array, duration: float, skip: float = 0.0, dt: float = 0.01
    ) -> Rollouts:
        """Greedy episodes of ``duration`` seconds by RK4 with the control held for ``dt``; nothing is learned."""
        states = as_states(initial_states, self.problem.state_size)
        n_steps, n_skip = episode_steps(duration, skip, dt)
        out = np.empty((len(states), 2))
        self._load()
        kernel.rollout(
            self._form,
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
