"""Continuous TD(lambda), to be read beside equation 2 of Coulom (2002), after Doya (2000).

The learner integrates, along a trajectory that is greedy with respect to its own value estimate V_w,

    dw/dt = eta H e                                         weights
    de/dt = -(s_gamma + s_lambda) e + dV_w(x)/dw            eligibility traces
    dx/dt = f(x, pi(x))                                     state
    H     = r(x) - s_gamma V_w(x) + dV_w/dx . f(x, pi(x))   Hamiltonian

by Euler steps: every right-hand side is taken at time t. Because f is affine in the control and r does not depend on
it, H is largest for bang-bang control, u_i = U_i sign([B(x)^T dV/dx]_i). Where a problem has controls that cost, or
that are chosen to be held, they are those of :func:`~swimmer_mj.learning.networks.policy.decision`, as a policy's.

This is the reference, with gradients by torch's autograd; :mod:`swimmer_mj.learning.td.fused` does the same on the same
tensors, some 2,800 times as fast (``swimmer-mj bench``), and a test holds them equal.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from swimmer_mj.learning.networks.actors import actor_for
from swimmer_mj.learning.networks.networks import ValueNetwork
from swimmer_mj.learning.networks.policy import GreedyPolicy, decision, hamiltonian
from swimmer_mj.learning.problems.caution import warn_of
from swimmer_mj.learning.problems.forms import HoldForm, Moment
from swimmer_mj.learning.problems.problem import ControlProblem
from swimmer_mj.learning.problems.settings import require_not_negative, require_positive
from swimmer_mj.learning.td import vario_eta
from swimmer_mj.learning.td.vario_eta import VarioEta

__all__ = [
    "ContinuousTD",
    "TDSettings",
    "trace_derivative",
    "value_and_gradients",
    "weight_derivative",
]

Array = NDArray[np.float64]
T = TypeVar("T", float, Array, Tensor)


MOST_STEPS = 10_000_000
"""In a trial, which nothing interrupts; more are taken for a slip."""


@dataclass(frozen=True)
class TDSettings:
    """What defines a learner, besides its problem and its network."""

    eta: float = 0.01
    """Learning rate (paper)."""
    s_lambda: float = 1.0
    """Decay of eligibility besides s_gamma, 1/s (open in the paper; chosen: 1 and 3 were seen to learn alike)."""
    dt: float = 0.01
    """Euler step, s (paper)."""
    trial_duration: float = 5.0
    """Length of a trial, s (paper)."""
    output_scaling: bool = True
    """Scale the output unit's rate by 1 / sqrt(n) (paper, 3.3)."""
    vario: VarioEta | None = None
    """Vario-eta (paper, 3.2), which then sets the rates after each trial; None: rates are fixed."""

    def __post_init__(self) -> None:
        require_positive(self, "eta", "dt", "trial_duration")
        require_not_negative(self, "s_lambda")
        if self.trial_duration < self.dt:
            raise ValueError(f"trial_duration must be at least dt = {self.dt}, got {self.trial_duration!r}")
        if self.trial_duration / self.dt > MOST_STEPS:
            raise ValueError(
                f"a trial must have at most {MOST_STEPS:,} steps, got trial_duration {self.trial_duration!r} "
                f"and dt {self.dt!r}"
            )

    @property
    def initial_rate(self) -> float:
        """Learning rate in the first trial, before scaling of the output unit."""
        if self.vario is None:
            return self.eta
        return vario_eta.learning_rate(self.vario.initial_variance, self.eta, self.vario.epsilon)

    @property
    def steps_per_trial(self) -> int:
        """Learning steps in a trial."""
        return round(self.trial_duration / self.dt)


def weight_derivative(eta: T, H: float, e: T) -> T:
    """dw/dt = eta H e."""
    return eta * H * e


def trace_derivative(e: T, dVdw: T, s_gamma: float, s_lambda: float) -> T:
    """de/dt = -(s_gamma + s_lambda) e + dV/dw."""
    return -(s_gamma + s_lambda) * e + dVdw


def value_and_gradients(
    network: ValueNetwork, problem: ControlProblem, x: Array
) -> tuple[float, Array, list[Tensor]]:
    """V_w(x), dV/dx (p,) in float64, and dV/dw for each parameter in the network's dtype."""
    weights = list(network.parameters())
    state = torch.tensor(x, dtype=weights[0].dtype, requires_grad=True)
    V = network(problem.inputs(state))
    dVdx, *dVdw = torch.autograd.grad(V, [state, *weights])
    return V.item(), dVdx.double().numpy(), dVdw


class ContinuousTD:
    """The learner of equation 2, one Euler step at a time. It changes the network's weights in place.

    Parameters
    ----------
    problem : ControlProblem
        What to learn.
    network : ValueNetwork
        V_w.
    settings : TDSettings
        The algorithm's constants.
    """

    def __init__(
        self, problem: ControlProblem, network: ValueNetwork, settings: TDSettings | None = None
    ) -> None:
        warn_of(problem)
        self.problem = problem
        self.network = network
        self.settings = settings = TDSettings() if settings is None else settings
        self.weights = list(network.parameters())
        self.traces = [torch.zeros_like(w) for w in self.weights]
        self.base_rates = network.learning_rates(1.0, settings.output_scaling)
        v0 = settings.vario.initial_variance if settings.vario else 0.0
        self.variances = [torch.full_like(w, v0) for w in self.weights]
        self.rates = [settings.initial_rate * base for base in self.base_rates]
        actor = None if problem.form(HoldForm) is None else actor_for(problem, network)
        self._slope = partial(GreedyPolicy(problem, network).slope, actor)

    def value_and_slope(self, x: Array) -> tuple[float, Array]:
        """V and dV/dx (p,) at x (p,); for :meth:`step_weights`, dV/dw there."""
        with torch.enable_grad():
            V, dVdx, self._dVdw = value_and_gradients(self.network, self.problem, x)
        return V, dVdx

    @torch.no_grad()
    def step_weights(self, H: float) -> None:
        """One step of weights and traces after :meth:`value_and_slope`."""
        dt, s_gamma, s_lambda = self.settings.dt, self.problem.s_gamma, self.settings.s_lambda
        for w, e, eta, gradient in zip(self.weights, self.traces, self.rates, self._dVdw, strict=True):
            w += dt * weight_derivative(eta, H, e)
            e += dt * trace_derivative(e, gradient, s_gamma, s_lambda)

    @torch.no_grad()
    def learn_at(self, x: Array) -> Moment:
        """One step of weights and traces at state ``x`` (p,), which the caller then moves on under the control."""
        problem = self.problem
        V, dVdx = self.value_and_slope(x)
        a, B = problem.drift_and_control_matrix(x)
        u, r = decision(problem, x, dVdx, B, self._slope, self.settings.dt)
        H = float(hamiltonian(float(r), V, dVdx, a + B @ u, problem.s_gamma))
        self.step_weights(H)
        return Moment(u, V, H)

    def start_trial(self) -> None:
        """Forget the past: zero traces."""
        for e in self.traces:
            e.zero_()
        self._weights_before = [w.detach().clone() for w in self.weights]

    @torch.no_grad()
    def end_trial(self) -> None:
        """With vario-eta: new variances and rates from the trial's change of each weight."""
        vario = self.settings.vario
        if vario is None:
            return
        for v, w, before, rate, base in zip(
            self.variances, self.weights, self._weights_before, self.rates, self.base_rates, strict=True
        ):
            connected = base > 0
            v[connected] = vario_eta.variance(
                v[connected], w[connected] - before[connected], rate[connected], vario.beta
            )
            rate[connected] = base[connected] * vario_eta.learning_rate(
                v[connected], self.settings.eta, vario.epsilon
            )

    def run_trial(self, x: Array) -> list[Moment]:
        """Learn along one trial that starts at ``x`` (p,)."""
        self.start_trial()
        moments = []
        for _ in range(self.settings.steps_per_trial):
            moments.append(self.learn_at(x))
            x = self.problem.step(x, moments[-1].control, self.settings.dt)
        self.end_trial()
        return moments
